//! What can be asked for.

use super::feed::Feed;
use crate::board::{Board, Mode};
use crate::guard::{COOKIE_NAME, Guard};
use crate::inbox::{Change, Refusal};
use crate::map_picture::{LEVELS, PICTURE_SIDE};
use bytes::Bytes;
use floorprint::geometry::{Polygon, Pose2};
use floorprint::localization::Start;
use floorprint::map::Occupancy;
use floorprint::session::Region;
use floorprint_io::{Annotations, NamedPlace, map_bytes};
use http_body_util::combinators::UnsyncBoxBody;
use http_body_util::{BodyExt as _, Full, Limited};
use hyper::body::Incoming;
use hyper::header::{
    CACHE_CONTROL, CONTENT_DISPOSITION, CONTENT_SECURITY_POLICY, CONTENT_TYPE, HeaderValue, LOCATION, REFERRER_POLICY,
    SET_COOKIE, X_CONTENT_TYPE_OPTIONS,
};
use hyper::{Method, Request, Response, StatusCode};
use serde::Deserialize;
use std::convert::Infallible;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tokio::sync::Semaphore;

const PAGE: &str = include_str!("page.html");
const SCRIPT: &str = include_str!("page.js");
const EDIT_SCRIPT: &str = include_str!("edit.js");
const STYLE: &str = include_str!("page.css");
const ICON: &str = include_str!("icon.svg");

/// The page takes nothing from anywhere else, and no other page may frame it.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; \
    base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
/// The type of what viewers are told.
pub(super) const EVENTS: &str = "text/event-stream";
/// The picture of the mask of keep-out areas.
const MASK: &str = "keepout.pgm";
/// Viewers that are told what happens, at most.
const MOST_VIEWERS: usize = 16;
/// Longest command, bytes, and how long it may take to come.
const LONGEST_COMMAND: usize = 4096;
/// Longest list of places and areas, bytes.
const LONGEST_ANNOTATIONS: usize = 256 << 10;
const COMMAND_TIME: Duration = Duration::from_secs(5);

pub(super) type Answer = Response<UnsyncBoxBody<Bytes, Infallible>>;

/// Answers requests.
pub(super) struct Api {
    board: Arc<Board>,
    guard: Mutex<Guard>,
    viewers: Arc<Semaphore>,
}

impl Api {
    pub(super) fn new(board: Arc<Board>, guard: Guard) -> Self {
        Self { board, guard: Mutex::new(guard), viewers: Arc::new(Semaphore::new(MOST_VIEWERS)) }
    }

    pub(super) async fn answer(&self, request: Request<Incoming>) -> Answer {
        let mut answer = self.unsecured_answer(request).await;
        let headers = answer.headers_mut();
        headers.insert(CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY));
        headers.insert(X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
        headers.insert(REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
        headers.insert("cross-origin-resource-policy", HeaderValue::from_static("same-origin"));
        headers.entry(CACHE_CONTROL).or_insert(HeaderValue::from_static("no-store"));
        answer
    }

    async fn unsecured_answer(&self, request: Request<Incoming>) -> Answer {
        {
            let mut guard = self.guard.lock().unwrap_or_else(PoisonError::into_inner);
            if let Err(status) = guard.admit(&request) {
                return refusal(status);
            }
            if let Some(token) = guard.offered_in_address(&request) {
                let cookie = format!("{COOKIE_NAME}={token}; HttpOnly; SameSite=Strict; Path=/");
                let mut answer = refusal(StatusCode::SEE_OTHER);
                answer.headers_mut().insert(LOCATION, HeaderValue::from_static("/"));
                if let Ok(cookie) = HeaderValue::from_str(&cookie) {
                    answer.headers_mut().insert(SET_COOKIE, cookie);
                }
                return answer;
            }
        }
        let path = request.uri().path().to_owned();
        match (request.method(), path.as_str()) {
            (&Method::GET, "/") => found("text/html; charset=utf-8", PAGE),
            (&Method::GET, "/page.js") => found("text/javascript; charset=utf-8", SCRIPT),
            (&Method::GET, "/edit.js") => found("text/javascript; charset=utf-8", EDIT_SCRIPT),
            (&Method::GET, "/page.css") => found("text/css; charset=utf-8", STYLE),
            (&Method::GET, "/icon.svg") => found("image/svg+xml", ICON),
            (&Method::GET, "/events") => self.events(),
            (&Method::GET, "/map.yaml") => self.map_file("map.pgm", 0),
            (&Method::GET, "/map.pgm") => self.map_file("map.pgm", 1),
            (&Method::GET, "/keepout.yaml") => self.map_file(MASK, 0),
            (&Method::GET, "/keepout.pgm") => self.map_file(MASK, 1),
            (&Method::GET, "/annotations.geojson") => {
                let text = self.board.overlay().annotations.to_geojson();
                attachment("application/geo+json", "annotations.geojson", text)
            }
            (&Method::GET, path) => match path.strip_prefix("/tiles/") {
                Some(place) => self.tile(place, request.uri().query().unwrap_or_default()),
                None => refusal(StatusCode::NOT_FOUND),
            },
            (&Method::POST, "/pose" | "/relocalise" | "/pause" | "/restrict" | "/annotations") => {
                self.command(&path, request).await
            }
            _ => refusal(StatusCode::METHOD_NOT_ALLOWED),
        }
    }

    fn events(&self) -> Answer {
        let Ok(permit) = Arc::clone(&self.viewers).try_acquire_owned() else {
            return refusal(StatusCode::SERVICE_UNAVAILABLE);
        };
        let mut answer = Response::new(Feed::new(&self.board, permit).boxed_unsync());
        answer.headers_mut().insert(CONTENT_TYPE, HeaderValue::from_static(EVENTS));
        answer
    }

    /// The YAML file (0) or the picture (1) of the map, or of the mask of keep-out areas.
    fn map_file(&self, picture: &str, which: usize) -> Answer {
        let Some(mut raster) = self.board.picture().map.to_raster() else { return refusal(StatusCode::NOT_FOUND) };
        if picture == MASK {
            raster = self.board.overlay().annotations.keep_out_mask(&raster);
        }
        let [description, pixels] = map_bytes(picture, &raster);
        match which {
            0 => attachment("application/yaml", &picture.replace(".pgm", ".yaml"), description),
            _ => attachment("image/x-portable-graymap", picture, pixels),
        }
    }

    /// `LEVEL/COLUMN/ROW`.
    fn tile(&self, place: &str, query: &str) -> Answer {
        let mut numbers = place.split('/').map(|number| number.parse::<i32>().ok());
        let (Some(Some(level)), Some(Some(column)), Some(Some(row)), None) =
            (numbers.next(), numbers.next(), numbers.next(), numbers.next())
        else {
            return refusal(StatusCode::NOT_FOUND);
        };
        let level = u8::try_from(level).ok().filter(|level| *level < LEVELS);
        let cells = level.and_then(|level| self.board.picture().map.picture(level, (column, row)));
        let Some(cells) = cells else { return refusal(StatusCode::NOT_FOUND) };
        match png(&cells, query.split('&').any(|pair| pair == "dark")) {
            Ok(bytes) => {
                let mut answer = found("image/png", bytes);
                // The address names the revision.
                answer.headers_mut().insert(CACHE_CONTROL, HeaderValue::from_static("private, max-age=3600"));
                answer
            }
            Err(_) => refusal(StatusCode::INTERNAL_SERVER_ERROR),
        }
    }

    /// Asks for a change and waits until it is done.
    async fn change(&self, change: Change) -> Answer {
        let inbox = Arc::clone(&self.board.inbox);
        match tokio::task::spawn_blocking(move || inbox.change(change)).await {
            Ok(Ok(())) => refusal(StatusCode::NO_CONTENT),
            Ok(Err(error @ (Refusal::Mode(_) | Refusal::Stale))) => explained(StatusCode::CONFLICT, error.to_string()),
            Ok(Err(error)) => explained(StatusCode::UNPROCESSABLE_ENTITY, error.to_string()),
            Err(_) => refusal(StatusCode::INTERNAL_SERVER_ERROR),
        }
    }

    async fn command(&self, path: &str, request: Request<Incoming>) -> Answer {
        let longest = if path == "/annotations" { LONGEST_ANNOTATIONS } else { LONGEST_COMMAND };
        let body = Limited::new(request.into_body(), longest).collect();
        let body = match tokio::time::timeout(COMMAND_TIME, body).await {
            Ok(Ok(body)) => body.to_bytes(),
            Ok(Err(_)) => return refusal(StatusCode::PAYLOAD_TOO_LARGE),
            Err(_) => return refusal(StatusCode::REQUEST_TIMEOUT),
        };
        match (path, self.board.mode) {
            ("/pause", Mode::Mapping | Mode::Localization) => match serde_json::from_slice::<Pause>(&body) {
                Ok(Pause { paused }) => self.board.inbox.pause(paused),
                Err(_) => return refusal(StatusCode::BAD_REQUEST),
            },
            ("/relocalise", Mode::Localization) => self.board.inbox.set_start(Start::Unknown),
            ("/pose", Mode::Localization) => match serde_json::from_slice::<Place>(&body) {
                Ok(Place { x, y, theta }) if x.is_finite() && y.is_finite() && theta.is_finite() => {
                    self.board.inbox.set_start(Start::At(Pose2::new(x, y, theta)));
                }
                _ => return refusal(StatusCode::BAD_REQUEST),
            },
            ("/restrict", _) if self.board.is_editable => {
                let region = serde_json::from_slice::<Restriction>(&body).ok().and_then(Restriction::region);
                return match region {
                    Some(region) => self.change(Change::Restrict(region)).await,
                    None => refusal(StatusCode::BAD_REQUEST),
                };
            }
            ("/annotations", _) if self.board.is_editable => {
                let Ok(Annotated { revision, places, keep_out }) = serde_json::from_slice(&body) else {
                    return refusal(StatusCode::BAD_REQUEST);
                };
                return match Annotations::new(places, keep_out) {
                    Ok(annotations) => self.change(Change::Annotate(revision, annotations)).await,
                    Err(error) => explained(StatusCode::BAD_REQUEST, error.to_string()),
                };
            }
            // While a map is made poses follow from the drive.
            _ => return refusal(StatusCode::CONFLICT),
        }
        refusal(StatusCode::NO_CONTENT)
    }
}

/// What is to be left of the map.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Restriction {
    keep: Side,
    polygon: Vec<[f64; 2]>,
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
enum Side {
    Inside,
    Outside,
}

impl Restriction {
    fn region(self) -> Option<Region> {
        let polygon = Polygon::new(self.polygon).ok()?;
        Some(match self.keep {
            Side::Inside => Region::Inside(polygon),
            Side::Outside => Region::Outside(polygon),
        })
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Annotated {
    revision: u64,
    places: Vec<NamedPlace>,
    keep_out: Vec<Vec<[f64; 2]>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Place {
    x: f64,
    y: f64,
    theta: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Pause {
    paused: bool,
}

/// Something to be downloaded. The name is one of ours.
fn attachment(kind: &'static str, name: &str, body: impl Into<Bytes>) -> Answer {
    let mut answer = found(kind, body);
    if let Ok(disposition) = HeaderValue::from_str(&format!("attachment; filename=\"{name}\"")) {
        answer.headers_mut().insert(CONTENT_DISPOSITION, disposition);
    }
    answer
}

/// A refusal that says why.
fn explained(status: StatusCode, why: String) -> Answer {
    let mut answer = found("text/plain; charset=utf-8", why);
    *answer.status_mut() = status;
    answer
}

fn found(kind: &'static str, body: impl Into<Bytes>) -> Answer {
    let mut answer = Response::new(Full::new(body.into()).boxed_unsync());
    answer.headers_mut().insert(CONTENT_TYPE, HeaderValue::from_static(kind));
    answer
}

/// An answer that is its status.
fn refusal(status: StatusCode) -> Answer {
    let text = match status {
        StatusCode::UNAUTHORIZED => "This needs the token: open http://…/?token=TOKEN\n".to_owned(),
        StatusCode::NO_CONTENT => String::new(),
        status => format!("{status}\n"),
    };
    let mut answer = found("text/plain; charset=utf-8", text);
    *answer.status_mut() = status;
    answer
}

/// A picture of cells: what is unknown is transparent.
fn png(cells: &[Occupancy], is_dark: bool) -> Result<Vec<u8>, png::EncodingError> {
    let palette: [u8; 9] =
        if is_dark { [0, 0, 0, 44, 50, 60, 226, 232, 240] } else { [0, 0, 0, 255, 255, 255, 20, 24, 32] };
    let pixels: Vec<u8> = cells
        .chunks_exact(4)
        .map(|four| {
            four.iter().fold(0, |byte, cell| {
                byte << 2
                    | match cell {
                        Occupancy::Unknown => 0,
                        Occupancy::Free => 1,
                        Occupancy::Occupied => 2,
                    }
            })
        })
        .collect();
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, PICTURE_SIDE as u32, PICTURE_SIDE as u32);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::Two);
    encoder.set_palette(&palette[..]);
    encoder.set_trns(&[0_u8][..]);
    encoder.set_compression(png::Compression::Fast);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&pixels)?;
    writer.finish()?;
    Ok(bytes)
}

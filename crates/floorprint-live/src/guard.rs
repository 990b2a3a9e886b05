//! Who may come in: this machine, or whoever knows the token; and no other site in between.

use crate::bucket::Bucket;
use hyper::header::{AUTHORIZATION, CONTENT_TYPE, COOKIE, HOST, HeaderName, ORIGIN};
use hyper::{Method, Request, StatusCode};
use std::net::IpAddr;
use thiserror::Error;

/// What the cookie with the token is called.
pub(crate) const COOKIE_NAME: &str = "floorprint";
/// Shorter tokens can be guessed.
const SHORTEST_TOKEN: usize = 16;
/// Requests a second, of all viewers together, and how many may come at once.
const REQUESTS_PER_S: f64 = 500.0;
const REQUESTS_AT_ONCE: f64 = 1000.0;

/// A secret that lets its bearer in.
#[derive(Clone)]
pub struct Token(String);

/// Why nobody can be let in so.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum AccessError {
    /// Everybody could look, and say where the robot is.
    #[error("{0} can be reached from other machines: that needs a token (--token, or FLOORPRINT_TOKEN)")]
    NoToken(IpAddr),
    /// It would be guessed, or not survive in a cookie.
    #[error("a token has 16 or more letters, digits, - and _; such as that of `openssl rand -hex 16`")]
    WeakToken,
}

impl Token {
    /// A token.
    ///
    /// # Errors
    /// When it is too short, or holds what cannot stand in an address or a cookie.
    pub fn new(token: &str) -> Result<Self, AccessError> {
        let is_plain = token.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_');
        if token.len() < SHORTEST_TOKEN || !is_plain { Err(AccessError::WeakToken) } else { Ok(Self(token.to_owned())) }
    }

    /// Whether it is this one; takes as long for a wrong one as for a right one.
    pub(crate) fn is(&self, offered: &str) -> bool {
        let differences =
            self.0.bytes().zip(offered.bytes()).fold(0, |differences, (own, other)| differences | (own ^ other));
        self.0.len() == offered.len() && differences == 0
    }
}

impl std::fmt::Debug for Token {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("Token")
    }
}

/// Decides about requests.
pub(crate) struct Guard {
    token: Option<Token>,
    bucket: Bucket,
}

impl Guard {
    /// Of a server that listens at an address.
    pub(crate) fn new(address: IpAddr, token: Option<Token>) -> Result<Self, AccessError> {
        if !address.is_loopback() && token.is_none() {
            return Err(AccessError::NoToken(address));
        }
        Ok(Self { token, bucket: Bucket::new(REQUESTS_PER_S, REQUESTS_AT_ONCE) })
    }

    /// Whether a request of the page may be answered; else how it is refused.
    pub(crate) fn admit<B>(&mut self, request: &Request<B>) -> Result<(), StatusCode> {
        self.admit_host(request)?;
        let host = header(request, HOST).unwrap_or_default();
        if let Some(origin) = header(request, ORIGIN)
            && origin.split_once("://").is_none_or(|(_, origin)| !origin.eq_ignore_ascii_case(host))
        {
            return Err(StatusCode::FORBIDDEN);
        }
        // Forms of other sites cannot send this.
        let is_json = header(request, CONTENT_TYPE).is_some_and(|kind| kind.starts_with("application/json"));
        if request.method() == Method::POST && !is_json {
            return Err(StatusCode::UNSUPPORTED_MEDIA_TYPE);
        }
        self.admit_bearer(request)
    }

    /// Whether a viewer may come in that is no page of ours, but Foxglove; else how it is refused.
    #[cfg(feature = "foxglove")]
    pub(crate) fn admit_viewer<B>(&mut self, request: &Request<B>) -> Result<(), StatusCode> {
        self.admit_host(request)?;
        // Who knows the token may come from any site; a cookie does not count, for browsers send it along by themselves.
        if self.token.is_none() && header(request, ORIGIN).is_some_and(|origin| !is_viewers(origin)) {
            return Err(StatusCode::FORBIDDEN);
        }
        if header(request, ORIGIN).is_some_and(|origin| origin.starts_with("http"))
            && let Some(token) = &self.token
            && !self.offered_in_address(request).is_some_and(|offered| token.is(offered))
        {
            return Err(StatusCode::UNAUTHORIZED);
        }
        self.admit_bearer(request)
    }

    /// Whether there are not too many requests, and this machine is asked for under its own name.
    fn admit_host<B>(&mut self, request: &Request<B>) -> Result<(), StatusCode> {
        if !self.bucket.take() {
            return Err(StatusCode::TOO_MANY_REQUESTS);
        }
        // Another site may point its name at this machine; it is then asked for under that name.
        if self.token.is_none() && !is_this_machine(header(request, HOST).unwrap_or_default()) {
            return Err(StatusCode::MISDIRECTED_REQUEST);
        }
        Ok(())
    }

    /// Whether a request knows the token, where there is one.
    fn admit_bearer<B>(&self, request: &Request<B>) -> Result<(), StatusCode> {
        let Some(token) = &self.token else { return Ok(()) };
        let bearer = header(request, AUTHORIZATION).and_then(|value| value.strip_prefix("Bearer "));
        let cookie = header(request, COOKIE).into_iter().flat_map(|cookies| cookies.split(';')).find_map(|cookie| {
            let (name, value) = cookie.trim().split_once('=')?;
            (name == COOKIE_NAME).then_some(value)
        });
        let offered = bearer.or(cookie).or(self.offered_in_address(request));
        if offered.is_some_and(|offered| token.is(offered)) { Ok(()) } else { Err(StatusCode::UNAUTHORIZED) }
    }

    /// The token in an address such as `/?token=…`, by which a browser comes in the first time.
    pub(crate) fn offered_in_address<'a, B>(&self, request: &'a Request<B>) -> Option<&'a str> {
        self.token.as_ref()?;
        request.uri().query()?.split('&').find_map(|pair| pair.strip_prefix("token="))
    }
}

fn header<B>(request: &Request<B>, name: HeaderName) -> Option<&str> {
    request.headers().get(name).and_then(|value| value.to_str().ok())
}

/// Where viewers that know the protocol come from: Foxglove's own site, pages of this machine, or no site at all (programs
/// on the desktop name a file or themselves).
#[cfg(feature = "foxglove")]
fn is_viewers(origin: &str) -> bool {
    const FOXGLOVES: &str = "foxglove.dev";
    match origin.split_once("://") {
        Some(("http" | "https", host)) if is_this_machine(host) => true,
        Some(("https", host)) => host == FOXGLOVES || host.ends_with(&format!(".{FOXGLOVES}")),
        Some((scheme, _)) => scheme != "http",
        // `null`: a page that hides where it is from.
        None => false,
    }
}

/// Whether a `Host` header names this machine, as only this machine can.
fn is_this_machine(host: &str) -> bool {
    let name = match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    };
    name.eq_ignore_ascii_case("localhost") || name.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::Ipv4Addr;

    const SECRET: &str = "0123456789abcdef";

    fn asked(guard: &mut Guard, method: &str, uri: &str, headers: &[(&str, &str)]) -> Result<(), StatusCode> {
        let mut request = Request::builder().method(method).uri(uri);
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        guard.admit(&request.body(()).unwrap())
    }

    #[test]
    fn other_sites_are_kept_out() {
        let mut guard = Guard::new(Ipv4Addr::LOCALHOST.into(), None).unwrap();
        let mut asked = |method, headers: &[(&str, &str)]| asked(&mut guard, method, "/", headers);
        let host = ("host", "127.0.0.1:8080");
        assert_eq!(asked("GET", &[host]), Ok(()));
        assert_eq!(asked("GET", &[("host", "localhost:8080"), ("origin", "http://localhost:8080")]), Ok(()));
        assert_eq!(asked("GET", &[("host", "[::1]:8080")]), Ok(()));
        assert_eq!(asked("GET", &[("host", "evil.example:8080")]), Err(StatusCode::MISDIRECTED_REQUEST));
        assert_eq!(asked("GET", &[("host", "localhost.evil.example")]), Err(StatusCode::MISDIRECTED_REQUEST));
        assert_eq!(asked("GET", &[]), Err(StatusCode::MISDIRECTED_REQUEST));
        assert_eq!(asked("GET", &[host, ("origin", "http://evil.example")]), Err(StatusCode::FORBIDDEN));
        assert_eq!(asked("GET", &[host, ("origin", "null")]), Err(StatusCode::FORBIDDEN));
        assert_eq!(asked("POST", &[host, ("content-type", "text/plain")]), Err(StatusCode::UNSUPPORTED_MEDIA_TYPE));
        assert_eq!(asked("POST", &[host, ("content-type", "application/json")]), Ok(()));
    }

    #[test]
    fn from_elsewhere_only_with_the_token() {
        let everywhere = IpAddr::from(Ipv4Addr::UNSPECIFIED);
        assert_eq!(Guard::new(everywhere, None).err(), Some(AccessError::NoToken(everywhere)));
        assert_eq!(Token::new("short").err(), Some(AccessError::WeakToken));
        assert_eq!(Token::new("0123456789abcde;f").err(), Some(AccessError::WeakToken));
        let mut guard = Guard::new(everywhere, Some(Token::new(SECRET).unwrap())).unwrap();
        let host = ("host", "robot.local");
        assert_eq!(asked(&mut guard, "GET", "/", &[host]), Err(StatusCode::UNAUTHORIZED));
        assert_eq!(asked(&mut guard, "GET", "/?token=0123456789abcdeX", &[host]), Err(StatusCode::UNAUTHORIZED));
        assert_eq!(asked(&mut guard, "GET", "/?token=0123456789abcdef", &[host]), Ok(()));
        let cookie = ("cookie", "other=1; floorprint=0123456789abcdef");
        assert_eq!(asked(&mut guard, "GET", "/events", &[host, cookie]), Ok(()));
        let bearer = ("authorization", "Bearer 0123456789abcdef");
        assert_eq!(asked(&mut guard, "GET", "/events", &[host, bearer]), Ok(()));
    }

    #[cfg(feature = "foxglove")]
    #[test]
    fn viewers_come_from_foxglove_or_this_machine() {
        let mut guard = Guard::new(Ipv4Addr::LOCALHOST.into(), None).unwrap();
        let mut admit = |host: &str, origin: Option<&str>| {
            let mut request = Request::builder().uri("/").header("host", host);
            if let Some(origin) = origin {
                request = request.header("origin", origin);
            }
            guard.admit_viewer(&request.body(()).unwrap())
        };
        for origin in [None, Some("https://app.foxglove.dev"), Some("http://localhost:8080"), Some("file://")] {
            assert_eq!(admit("localhost:8765", origin), Ok(()), "{origin:?}");
        }
        for origin in ["https://evil.example", "null", "http://app.foxglove.dev", "https://evilfoxglove.dev"] {
            assert_eq!(admit("localhost:8765", Some(origin)), Err(StatusCode::FORBIDDEN), "{origin}");
        }
        assert_eq!(admit("evil.example", None), Err(StatusCode::MISDIRECTED_REQUEST));
        // With a token it is the token that counts, and none that a browser sends along by itself.
        let mut guard = Guard::new(Ipv4Addr::UNSPECIFIED.into(), Some(Token::new(SECRET).unwrap())).unwrap();
        let mut admit = |uri: &str, headers: &[(&str, &str)]| {
            let request = headers
                .iter()
                .fold(Request::builder().uri(uri), |request, (name, value)| request.header(*name, *value));
            guard.admit_viewer(&request.body(()).unwrap())
        };
        assert_eq!(admit("/?token=0123456789abcdef", &[("origin", "https://app.foxglove.dev")]), Ok(()));
        let cookie = ("cookie", "floorprint=0123456789abcdef");
        assert_eq!(admit("/", &[cookie, ("origin", "https://evil.example")]), Err(StatusCode::UNAUTHORIZED));
        assert_eq!(admit("/", &[]), Err(StatusCode::UNAUTHORIZED));
    }

    #[test]
    fn a_flood_of_requests_is_stemmed() {
        let mut guard = Guard::new(Ipv4Addr::LOCALHOST.into(), None).unwrap();
        let answers: Vec<_> = (0..5000).map(|_| asked(&mut guard, "GET", "/", &[("host", "localhost")])).collect();
        assert_eq!(answers.first(), Some(&Ok(())));
        assert!(answers.contains(&Err(StatusCode::TOO_MANY_REQUESTS)));
    }
}

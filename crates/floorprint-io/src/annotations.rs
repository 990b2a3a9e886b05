//! What people say of a map: what places are called, and where robots are not to go.

use floorprint::geometry::{Polygon, PolygonError, Pose2};
use floorprint::map::{Occupancy, Raster};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use thiserror::Error;

/// Places and areas at most, and corners of an area: what a person can draw.
const MOST: usize = 500;
/// Longest name, characters.
const LONGEST_NAME: usize = 80;

/// A place with a name.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NamedPlace {
    /// What it is called.
    pub name: String,
    /// Where it is in the map, metres.
    pub at: [f64; 2],
}

/// Names of places and keep-out areas of a map, in its frame.
///
/// Written as GeoJSON (RFC 7946) whose coordinates are metres in the map's frame, as those of all exports.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Annotations {
    places: Vec<NamedPlace>,
    keep_out: Vec<Polygon>,
}

/// Why something is no annotation.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum AnnotationError {
    /// A name is empty, too long or holds what cannot be shown.
    #[error("a name has 1 to {LONGEST_NAME} characters on one line")]
    Name,
    /// A place is nowhere.
    #[error("a position is not finite")]
    Position,
    /// There are too many.
    #[error("there are at most {MOST} places, areas and corners of an area")]
    TooMany,
    /// An area is none.
    #[error("a keep-out area: {0}")]
    Area(#[from] PolygonError),
    /// The text is none that was written here.
    #[error("no annotations of a map: {0}")]
    Format(String),
}

impl Annotations {
    /// Annotations of a map.
    ///
    /// # Errors
    /// When one of them is none, or there are too many.
    pub fn new(places: Vec<NamedPlace>, keep_out: Vec<Vec<[f64; 2]>>) -> Result<Self, AnnotationError> {
        if places.len() > MOST || keep_out.len() > MOST || keep_out.iter().any(|corners| corners.len() > MOST) {
            return Err(AnnotationError::TooMany);
        }
        for place in &places {
            let length = place.name.chars().count();
            if place.name.trim().is_empty() || length > LONGEST_NAME || place.name.chars().any(char::is_control) {
                return Err(AnnotationError::Name);
            }
            if !place.at.iter().all(|coordinate| coordinate.is_finite()) {
                return Err(AnnotationError::Position);
            }
        }
        let keep_out = keep_out.into_iter().map(Polygon::new).collect::<Result<_, _>>()?;
        Ok(Self { places, keep_out })
    }

    /// The places.
    #[must_use]
    pub fn places(&self) -> &[NamedPlace] {
        &self.places
    }

    /// Where robots are not to go.
    #[must_use]
    pub fn keep_out(&self) -> &[Polygon] {
        &self.keep_out
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.places.is_empty() && self.keep_out.is_empty()
    }

    /// The same in a frame whose axes lie elsewhere.
    #[must_use]
    pub fn moved(&self, new_from_old: &Pose2) -> Self {
        let moved = |at: [f64; 2]| new_from_old.transform_point(at);
        let mut all = self.clone();
        all.places.iter_mut().for_each(|place| place.at = moved(place.at));
        let areas =
            self.keep_out.iter().map(|area| Polygon::new(area.corners_m().iter().copied().map(moved).collect()));
        // Corners that were finite stay so.
        all.keep_out = areas.filter_map(Result::ok).collect();
        all
    }

    /// These and others of the same map, in the same frame.
    ///
    /// # Errors
    /// When there are too many together.
    pub fn joined(mut self, others: Self) -> Result<Self, AnnotationError> {
        self.places.extend(others.places);
        self.keep_out.extend(others.keep_out);
        if self.places.len().max(self.keep_out.len()) > MOST { Err(AnnotationError::TooMany) } else { Ok(self) }
    }

    /// As a feature collection: points with the property `name`, polygons with the property `keep_out`.
    #[must_use]
    pub fn to_geojson(&self) -> String {
        let feature = |properties: Value, kind: &str, coordinates: Value| json!({"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": coordinates}});
        let places = self.places.iter().map(|place| feature(json!({"name": place.name}), "Point", json!(place.at)));
        let areas = self.keep_out.iter().map(|area| {
            let corners = area.corners_m();
            let ring: Vec<_> = corners.iter().chain(corners.first()).collect();
            feature(json!({"keep_out": true}), "Polygon", json!([ring]))
        });
        let features: Vec<Value> = places.chain(areas).collect();
        json!({"type": "FeatureCollection", "features": features}).to_string()
    }

    /// What [`to_geojson`](Self::to_geojson) wrote.
    ///
    /// # Errors
    /// When it is something else.
    pub fn from_geojson(text: &str) -> Result<Self, AnnotationError> {
        let format = |error: serde_json::Error| AnnotationError::Format(error.to_string());
        let collection: Collection = serde_json::from_str(text).map_err(format)?;
        let (mut places, mut keep_out) = (Vec::new(), Vec::new());
        for Feature { properties, geometry } in collection.features {
            match geometry {
                Geometry::Point(at) => {
                    let name = properties.get("name").and_then(Value::as_str).unwrap_or_default().to_owned();
                    places.push(NamedPlace { name, at });
                }
                // The first corner stands at the end once more.
                Geometry::Polygon([mut ring]) => {
                    ring.pop();
                    keep_out.push(ring);
                }
            }
        }
        Self::new(places, keep_out)
    }

    /// The mask that filters of Nav2's costmaps take (`KeepoutFilter`): cells of the map in whose middle a robot is not to be
    /// are occupied, the others free.
    #[must_use]
    pub fn keep_out_mask(&self, map: &Raster<Occupancy>) -> Raster<Occupancy> {
        map.map(|_, center| {
            let is_kept_out = self.keep_out.iter().any(|area| area.contains(center));
            if is_kept_out { Occupancy::Occupied } else { Occupancy::Free }
        })
    }
}

#[derive(Deserialize)]
struct Collection {
    features: Vec<Feature>,
}

#[derive(Deserialize)]
struct Feature {
    properties: Map<String, Value>,
    geometry: Geometry,
}

#[derive(Deserialize)]
#[serde(tag = "type", content = "coordinates")]
enum Geometry {
    Point([f64; 2]),
    Polygon([Vec<[f64; 2]>; 1]),
}

#[cfg(test)]
mod tests {
    use super::*;

    fn annotations() -> Annotations {
        let place = NamedPlace { name: "Küche \"2\"".to_owned(), at: [1.5, -2.0] };
        Annotations::new(vec![place], vec![vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]]).unwrap()
    }

    #[test]
    fn what_is_written_is_read_again() {
        let written = annotations().to_geojson();
        assert_eq!(Annotations::from_geojson(&written).unwrap(), annotations());
        assert!(written.contains(r#"[[[0.0,0.0],[1.0,0.0],[1.0,1.0],[0.0,0.0]]]"#), "{written}");
        for wrong in ["", "{}", r#"{"features":[{"properties":{},"geometry":{"type":"Point","coordinates":[1,2]}}]}"#] {
            assert!(Annotations::from_geojson(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let named = |name: &str| Annotations::new(vec![NamedPlace { name: name.to_owned(), at: [0.0; 2] }], Vec::new());
        assert!(named("dock").is_ok());
        for name in ["", "  ", "two\nlines", &"x".repeat(81)] {
            assert_eq!(named(name), Err(AnnotationError::Name), "{name:?}");
        }
        let nowhere = NamedPlace { name: "dock".to_owned(), at: [f64::NAN, 0.0] };
        assert_eq!(Annotations::new(vec![nowhere], Vec::new()), Err(AnnotationError::Position));
        assert!(matches!(Annotations::new(Vec::new(), vec![vec![[0.0; 2]; 2]]), Err(AnnotationError::Area(_))));
        assert_eq!(Annotations::new(Vec::new(), vec![Vec::new(); 501]), Err(AnnotationError::TooMany));
    }

    #[test]
    fn the_mask_lies_as_the_map_does() {
        let map = Raster {
            width: 4,
            height: 2,
            resolution_m: 0.5,
            // No middle lies on an edge.
            origin_m: [-0.5, 0.1],
            cells: vec![Occupancy::Unknown; 8],
        };
        let mask = annotations().keep_out_mask(&map);
        let occupied: Vec<_> = (0..8).filter(|&cell| mask.cells[cell] == Occupancy::Occupied).collect();
        let expected: Vec<_> = (0..8)
            .filter(|&cell| {
                let [x, y] = map.center_m(cell);
                x > 0.0 && x < 1.0 && y < x
            })
            .collect();
        assert_eq!(occupied, expected);
        assert!(!occupied.is_empty() && mask.cells.len() == 8 && !mask.cells.contains(&Occupancy::Unknown));
    }
}

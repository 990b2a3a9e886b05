//! What other programs see of a session.

use super::geopackage::{line, make_features, point, put_picture, set_extent};
use floorprint::map::{Occupancy, Raster};
use floorprint::session::Session;
use floorprint::texture::TextureMap;
use rusqlite::{Connection, params};

/// A session with its map and, where it was painted, its floor.
#[derive(Debug, Clone, Copy)]
pub struct Layers<'a> {
    /// The session.
    pub session: &'a Session,
    /// Its occupancy map.
    pub map: &'a Raster<Occupancy>,
    /// The colours of the floor.
    pub floor: Option<&'a TextureMap>,
}

/// Free, occupied and unknown as map_server draws them.
const FREE: [u8; 4] = [254, 254, 254, 255];
const OCCUPIED: [u8; 4] = [0, 0, 0, 255];
const UNKNOWN: [u8; 4] = [0; 4];

impl Layers<'_> {
    pub(super) fn draw(&self, connection: &Connection) -> rusqlite::Result<()> {
        let map = self.map.map(|index, _| match self.map.cells[index] {
            Occupancy::Unknown => UNKNOWN,
            Occupancy::Free => FREE,
            Occupancy::Occupied => OCCUPIED,
        });
        put_picture(connection, "occupancy", "occupancy map: white is free, black occupied", &map)?;
        if let Some(floor) = self.floor {
            let colors = floor.map(|index, _| floor.cells[index].map_or(UNKNOWN, |[r, g, b]| [r, g, b, 255]));
            put_picture(connection, "floor", "colours of the floor", &colors)?;
        }
        self.draw_features(connection)
    }

    fn draw_features(&self, connection: &Connection) -> rusqlite::Result<()> {
        let trajectory = self.session.trajectory();
        let points: Vec<[f64; 2]> = trajectory.iter().map(|stamped| [stamped.pose.x, stamped.pose.y]).collect();
        let columns = [("frames", "INTEGER"), ("start_s", "DOUBLE"), ("end_s", "DOUBLE"), ("length_m", "DOUBLE")];
        make_features(connection, "trajectory", "the body's way", "LINESTRING", &columns)?;
        if let (Some(first), Some(last), true) = (trajectory.first(), trajectory.last(), points.len() > 1) {
            let steps = points.windows(2).map(|pair| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]));
            connection.execute(
                "INSERT INTO trajectory (geom, frames, start_s, end_s, length_m) VALUES (?1, ?2, ?3, ?4, ?5)",
                params![line(&points), points.len() as i64, first.stamp_s, last.stamp_s, steps.sum::<f64>()],
            )?;
        }
        set_extent(connection, "trajectory", &points)?;

        let places = self.session.places();
        let at = |frame: usize| points.get(frame).copied().unwrap_or_default();
        make_features(
            connection,
            "submaps",
            "middles of submaps",
            "POINT",
            &[("number", "INTEGER"), ("frame", "INTEGER")],
        )?;
        let mut middles = Vec::new();
        for (number, submap) in places.iter().flat_map(|places| places.submaps()).enumerate() {
            middles.push(at(submap.middle_frame));
            connection.execute(
                "INSERT INTO submaps (geom, number, frame) VALUES (?1, ?2, ?3)",
                params![point(at(submap.middle_frame)), number as i64, submap.middle_frame as i64],
            )?;
        }
        set_extent(connection, "submaps", &middles)?;

        let columns = [("older", "INTEGER"), ("newer", "INTEGER"), ("verdict", "TEXT"), ("correction_m", "DOUBLE")];
        make_features(connection, "closures", "comparisons of places", "LINESTRING", &columns)?;
        let mut ends = Vec::new();
        for closure in places.map(|places| places.reports()).unwrap_or_default() {
            let pair = closure.frames.map(at);
            ends.extend(pair);
            connection.execute(
                "INSERT INTO closures (geom, older, newer, verdict, correction_m) VALUES (?1, ?2, ?3, ?4, ?5)",
                params![
                    line(&pair),
                    closure.older as i64,
                    closure.newer as i64,
                    closure.verdict.meaning(),
                    closure.correction_m
                ],
            )?;
        }
        set_extent(connection, "closures", &ends)
    }
}

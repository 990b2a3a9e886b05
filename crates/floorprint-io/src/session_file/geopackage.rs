//! The tables that make an SQLite database a GeoPackage (OGC 12-128r18), and what goes into them.

use crate::picture::{Picture, Pixels, decode_png, png_bytes};
use floorprint::map::Raster;
use rusqlite::{Connection, OptionalExtension, params};

/// "GPKG", and version 1.3.0.
const APPLICATION_ID: i64 = 0x4750_4B47;
const USER_VERSION: i64 = 10_300;
/// Reference system of coordinates in metres that lie nowhere on Earth.
const CARTESIAN: i64 = -1;
/// Side of a tile, pixels.
const TILE: usize = 256;

const TABLES: &str = "
CREATE TABLE gpkg_spatial_ref_sys (
    srs_name TEXT NOT NULL, srs_id INTEGER NOT NULL PRIMARY KEY, organization TEXT NOT NULL,
    organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL, description TEXT);
INSERT INTO gpkg_spatial_ref_sys VALUES
    ('Undefined cartesian SRS', -1, 'NONE', -1, 'undefined', 'metres in the frame of the map'),
    ('Undefined geographic SRS', 0, 'NONE', 0, 'undefined', NULL),
    ('WGS 84', 4326, 'EPSG', 4326, 'GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.257223563]],PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433],AUTHORITY[\"EPSG\",\"4326\"]]', NULL);
CREATE TABLE gpkg_contents (
    table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL, identifier TEXT UNIQUE, description TEXT DEFAULT '',
    last_change DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')),
    min_x DOUBLE, min_y DOUBLE, max_x DOUBLE, max_y DOUBLE, srs_id INTEGER,
    CONSTRAINT fk_gc_r_srs_id FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys(srs_id));
CREATE TABLE gpkg_geometry_columns (
    table_name TEXT NOT NULL, column_name TEXT NOT NULL, geometry_type_name TEXT NOT NULL, srs_id INTEGER NOT NULL,
    z TINYINT NOT NULL, m TINYINT NOT NULL, CONSTRAINT pk_geom_cols PRIMARY KEY (table_name, column_name),
    CONSTRAINT uk_gc_table_name UNIQUE (table_name),
    CONSTRAINT fk_gc_tn FOREIGN KEY (table_name) REFERENCES gpkg_contents(table_name),
    CONSTRAINT fk_gc_srs FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys (srs_id));
CREATE TABLE gpkg_tile_matrix_set (
    table_name TEXT NOT NULL PRIMARY KEY, srs_id INTEGER NOT NULL, min_x DOUBLE NOT NULL, min_y DOUBLE NOT NULL,
    max_x DOUBLE NOT NULL, max_y DOUBLE NOT NULL,
    CONSTRAINT fk_gtms_table_name FOREIGN KEY (table_name) REFERENCES gpkg_contents(table_name),
    CONSTRAINT fk_gtms_srs FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys (srs_id));
CREATE TABLE gpkg_tile_matrix (
    table_name TEXT NOT NULL, zoom_level INTEGER NOT NULL, matrix_width INTEGER NOT NULL, matrix_height INTEGER NOT NULL,
    tile_width INTEGER NOT NULL, tile_height INTEGER NOT NULL, pixel_x_size DOUBLE NOT NULL, pixel_y_size DOUBLE NOT NULL,
    CONSTRAINT pk_ttm PRIMARY KEY (table_name, zoom_level),
    CONSTRAINT fk_tmm_table_name FOREIGN KEY (table_name) REFERENCES gpkg_contents(table_name));
";

/// Makes an empty database a GeoPackage.
pub(super) fn initialise(connection: &Connection) -> rusqlite::Result<()> {
    connection.pragma_update(None, "application_id", APPLICATION_ID)?;
    connection.pragma_update(None, "user_version", USER_VERSION)?;
    connection.execute_batch(TABLES)
}

/// Takes a layer out, where there is one.
fn remove(connection: &Connection, table: &str) -> rusqlite::Result<()> {
    for of in ["gpkg_tile_matrix", "gpkg_tile_matrix_set", "gpkg_geometry_columns", "gpkg_contents"] {
        connection.execute(&format!("DELETE FROM {of} WHERE table_name = ?1"), [table])?;
    }
    connection.execute_batch(&format!("DROP TABLE IF EXISTS \"{table}\""))
}

/// Puts a picture of the plane in as a pyramid of tiles: each pixel has red, green, blue and opacity.
pub(super) fn put_picture(
    connection: &Connection,
    table: &str,
    description: &str,
    picture: &Raster<[u8; 4]>,
) -> rusqlite::Result<()> {
    remove(connection, table)?;
    let levels = (0..).find(|&level| (TILE << level) >= picture.width.max(picture.height)).unwrap_or(0);
    let side_m = (TILE << levels) as f64 * picture.resolution_m;
    let [min_x, min_y] = picture.origin_m;
    let (width_m, height_m) =
        (picture.width as f64 * picture.resolution_m, picture.height as f64 * picture.resolution_m);
    // Tiles are counted from the upper left corner.
    let top = min_y + height_m;
    connection.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier, description, min_x, min_y, max_x, max_y, srs_id)
         VALUES (?1, 'tiles', ?1, ?2, ?3, ?4, ?5, ?6, ?7)",
        params![table, description, min_x, min_y, min_x + width_m, top, CARTESIAN],
    )?;
    connection.execute(
        "INSERT INTO gpkg_tile_matrix_set VALUES (?1, ?2, ?3, ?4, ?5, ?6)",
        params![table, CARTESIAN, min_x, top - side_m, min_x + side_m, top],
    )?;
    connection.execute_batch(&format!(
        "CREATE TABLE \"{table}\" (id INTEGER PRIMARY KEY AUTOINCREMENT, zoom_level INTEGER NOT NULL,
         tile_column INTEGER NOT NULL, tile_row INTEGER NOT NULL, tile_data BLOB NOT NULL,
         UNIQUE (zoom_level, tile_column, tile_row))"
    ))?;
    let mut level_picture = Level { width: picture.width, height: picture.height, rgba: picture.cells.clone() };
    for level in (0..=levels).rev() {
        let tiles = 1_usize << level;
        let pixel_m = side_m / (tiles * TILE) as f64;
        connection.execute(
            "INSERT INTO gpkg_tile_matrix VALUES (?1, ?2, ?3, ?3, ?4, ?4, ?5, ?5)",
            params![table, level as i64, tiles as i64, TILE as i64, pixel_m],
        )?;
        let mut insert = connection.prepare_cached(&format!(
            "INSERT INTO \"{table}\" (zoom_level, tile_column, tile_row, tile_data) VALUES (?1, ?2, ?3, ?4)"
        ))?;
        for row in 0..level_picture.height.div_ceil(TILE) {
            for column in 0..level_picture.width.div_ceil(TILE) {
                if let Some(tile) = level_picture.tile(row, column) {
                    let png =
                        png_bytes(&tile).map_err(|error| rusqlite::Error::ToSqlConversionFailure(Box::new(error)))?;
                    insert.execute(params![level as i64, column as i64, row as i64, png])?;
                }
            }
        }
        level_picture = level_picture.halved();
    }
    Ok(())
}

/// Pixels that a picture may have, whatever its tiles show …
const FREE_PIXELS: f64 = 6.4e7;
/// … and for each pixel of its tiles.
const PIXELS_PER_TILE_PIXEL: f64 = 64.0;

/// The picture that was put in as `table`; `None` where there is none.
pub(super) fn picture(connection: &Connection, table: &str) -> rusqlite::Result<Option<Raster<[u8; 4]>>> {
    let extent = "SELECT min_x, min_y, max_x, max_y FROM gpkg_contents WHERE table_name = ?1 AND data_type = 'tiles'";
    let extent = connection
        .query_row(extent, [table], |row| Ok([row.get::<_, f64>(0)?, row.get(1)?, row.get(2)?, row.get(3)?]))
        .optional()?;
    let Some([min_x, min_y, max_x, max_y]) = extent else { return Ok(None) };
    let finest = "SELECT zoom_level, pixel_x_size FROM gpkg_tile_matrix WHERE table_name = ?1 ORDER BY zoom_level DESC";
    let (level, resolution_m) =
        connection.query_row(finest, [table], |row| Ok((row.get::<_, i64>(0)?, row.get::<_, f64>(1)?)))?;
    let side = |length_m: f64| (length_m / resolution_m).round();
    let (width, height) = (side(max_x - min_x), side(max_y - min_y));
    let count = format!("SELECT count(*) FROM \"{table}\" WHERE zoom_level = ?1");
    let tiles: f64 = connection.query_row(&count, [level], |row| row.get::<_, i64>(0)).map(|tiles| tiles as f64)?;
    let most_pixels = FREE_PIXELS + tiles * (TILE * TILE) as f64 * PIXELS_PER_TILE_PIXEL;
    if !(width >= 1.0 && height >= 1.0 && width * height <= most_pixels) {
        return Err(rusqlite::Error::IntegralValueOutOfRange(0, level));
    }
    let (width, height) = (width as usize, height as usize);
    let mut cells = vec![[0; 4]; width * height];
    let mut select = connection
        .prepare(&format!("SELECT tile_column, tile_row, tile_data FROM \"{table}\" WHERE zoom_level = ?1"))?;
    let mut tiles = select.query([level])?;
    while let Some(tile) = tiles.next()? {
        let (left, top) = (tile.get::<_, i64>(0)? * TILE as i64, tile.get::<_, i64>(1)? * TILE as i64);
        let bytes: Vec<u8> = tile.get(2)?;
        let damaged =
            |what: String| rusqlite::Error::FromSqlConversionFailure(2, rusqlite::types::Type::Blob, what.into());
        let Picture { width: tile_width, pixels: Pixels::Rgba8(pixels), .. } = decode_png(&bytes).map_err(damaged)?
        else {
            return Err(damaged("a tile without opacity".to_owned()));
        };
        for (index, pixel) in pixels.into_iter().enumerate() {
            let (x, y) = (left + (index % tile_width) as i64, top + (index / tile_width) as i64);
            if let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y))
                && x < width
                && y < height
            {
                cells[y * width + x] = pixel;
            }
        }
    }
    Ok(Some(Raster { width, height, resolution_m, origin_m: [min_x, min_y], cells }))
}

/// Rows of pixels from the upper left corner.
struct Level {
    width: usize,
    height: usize,
    rgba: Vec<[u8; 4]>,
}

impl Level {
    fn at(&self, row: usize, column: usize) -> [u8; 4] {
        if row < self.height && column < self.width { self.rgba[row * self.width + column] } else { [0; 4] }
    }

    /// A tile; `None` where nothing is to be seen.
    fn tile(&self, row: usize, column: usize) -> Option<Picture> {
        let pixels: Vec<[u8; 4]> =
            (0..TILE * TILE).map(|pixel| self.at(row * TILE + pixel / TILE, column * TILE + pixel % TILE)).collect();
        pixels.iter().any(|pixel| pixel[3] > 0).then_some(Picture {
            width: TILE,
            height: TILE,
            pixels: Pixels::Rgba8(pixels),
        })
    }

    /// The same at half the size; of each four pixels the darkest that can be seen, so that thin walls stay.
    fn halved(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let darkest = |index: usize| {
            let (row, column) = (2 * (index / width), 2 * (index % width));
            let four = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(down, right)| self.at(row + down, column + right));
            let seen = four.into_iter().filter(|pixel| pixel[3] > 0);
            seen.min_by_key(|&[r, g, b, _]| u32::from(r) + u32::from(g) + u32::from(b)).unwrap_or([0; 4])
        };
        Self { width, height, rgba: (0..width * height).map(darkest).collect() }
    }
}

/// A column of a feature table: its name and its type in SQLite.
pub(super) type Column = (&'static str, &'static str);

/// Makes an empty feature table in place of the one that is there.
pub(super) fn make_features(
    connection: &Connection,
    table: &str,
    description: &str,
    geometry_type: &str,
    columns: &[Column],
) -> rusqlite::Result<()> {
    remove(connection, table)?;
    connection.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier, description, srs_id)
         VALUES (?1, 'features', ?1, ?2, ?3)",
        params![table, description, CARTESIAN],
    )?;
    connection.execute(
        "INSERT INTO gpkg_geometry_columns VALUES (?1, 'geom', ?2, ?3, 0, 0)",
        params![table, geometry_type, CARTESIAN],
    )?;
    let columns: String = columns.iter().map(|(name, kind)| format!(", {name} {kind}")).collect();
    connection
        .execute_batch(&format!("CREATE TABLE \"{table}\" (fid INTEGER PRIMARY KEY AUTOINCREMENT, geom BLOB{columns})"))
}

/// Sets the extent of a feature table: the rectangle around its points, metres.
pub(super) fn set_extent(connection: &Connection, table: &str, points_m: &[[f64; 2]]) -> rusqlite::Result<()> {
    if points_m.is_empty() {
        return Ok(());
    }
    let least = |axis: usize| points_m.iter().map(|point| point[axis]).fold(f64::INFINITY, f64::min);
    let most = |axis: usize| points_m.iter().map(|point| point[axis]).fold(f64::NEG_INFINITY, f64::max);
    connection
        .execute(
            "UPDATE gpkg_contents SET min_x = ?2, min_y = ?3, max_x = ?4, max_y = ?5 WHERE table_name = ?1",
            params![table, least(0), least(1), most(0), most(1)],
        )
        .map(drop)
}

/// A point as GeoPackage stores it, metres.
pub(super) fn point(point_m: [f64; 2]) -> Vec<u8> {
    let mut bytes = header();
    bytes.extend([1, 1, 0, 0, 0]);
    bytes.extend(point_m.iter().flat_map(|value| value.to_le_bytes()));
    bytes
}

/// A line as GeoPackage stores it, metres.
pub(super) fn line(points_m: &[[f64; 2]]) -> Vec<u8> {
    let mut bytes = header();
    bytes.extend([1, 2, 0, 0, 0]);
    bytes.extend((points_m.len() as u32).to_le_bytes());
    bytes.extend(points_m.iter().flatten().flat_map(|value| value.to_le_bytes()));
    bytes
}

/// "GP", version 0, little endian without an envelope, the reference system; well-known binary follows.
fn header() -> Vec<u8> {
    let mut bytes = vec![b'G', b'P', 0, 1];
    bytes.extend((CARTESIAN as i32).to_le_bytes());
    bytes
}

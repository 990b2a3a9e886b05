//! Maps and floors as cloud-optimised GeoTIFF: tiles and overviews for QGIS, GDAL and map servers.

use crate::error::{Problem, WriteError};
use crate::replace::write_file;
use floorprint::map::{Occupancy, Raster};
use floorprint::texture::TextureMap;
use geotiff_writer::{
    CogBuilder, Compression, ExtraSample, GeoKeyValue, GeoTiffBuilder, ModelType, PhotometricInterpretation,
    RasterType, Resampling,
};
use ndarray::Array3;
use std::io::Cursor;
use std::path::Path;

/// Side of a tile, pixels.
const TILE: u32 = 256;
/// "User-defined" (OGC 19-008r4): metres in the frame of the map, which lies nowhere on Earth.
const LOCAL: ModelType = ModelType::Unknown(32_767);
const PROJECTED_LINEAR_UNITS: u16 = 3076;
const METRE: u16 = 9001;

/// Writes a map at `path`: one band, 0 where it is occupied, 254 where it is free, and 205, declared to be no data,
/// where nothing is known.
///
/// # Errors
/// When the file cannot be written, or the map has no cells.
pub fn write_map_geotiff(path: &Path, map: &Raster<Occupancy>) -> Result<(), WriteError> {
    let levels = map.map(|index, _| match map.cells[index] {
        Occupancy::Occupied => [0],
        Occupancy::Unknown => [205],
        Occupancy::Free => [254],
    });
    let builder = builder(&levels).photometric(PhotometricInterpretation::MinIsBlack).nodata("205");
    write(path, builder, &levels)
}

/// Writes the colours of a floor at `path`: red, green, blue and opacity, which is 0 where nothing was seen.
///
/// # Errors
/// When the file cannot be written, or the floor has no cells.
pub fn write_floor_geotiff(path: &Path, floor: &TextureMap) -> Result<(), WriteError> {
    let colors = floor.map(|index, _| floor.cells[index].map_or([0; 4], |[red, green, blue]| [red, green, blue, 255]));
    let builder = builder(&colors)
        .photometric(PhotometricInterpretation::Rgb)
        .extra_samples(vec![ExtraSample::UnassociatedAlpha]);
    write(path, builder, &colors)
}

fn builder<const BANDS: usize>(raster: &Raster<[u8; BANDS]>) -> GeoTiffBuilder {
    let side = |cells: usize| u32::try_from(cells).unwrap_or(u32::MAX);
    let top_m = raster.origin_m[1] + raster.height as f64 * raster.resolution_m;
    GeoTiffBuilder::new(side(raster.width), side(raster.height))
        .bands(BANDS as u32)
        .model_type(LOCAL)
        .geokey(PROJECTED_LINEAR_UNITS, GeoKeyValue::Short(METRE))
        .raster_type(RasterType::PixelIsArea)
        .pixel_scale(raster.resolution_m, raster.resolution_m)
        .origin(raster.origin_m[0], top_m)
        .compression(Compression::Deflate)
        .tile_size(TILE, TILE)
}

fn write<const BANDS: usize>(
    path: &Path,
    builder: GeoTiffBuilder,
    raster: &Raster<[u8; BANDS]>,
) -> Result<(), WriteError> {
    let problem = |found: String| WriteError::from(Problem::new(path, found));
    let samples = raster.cells.as_flattened().to_vec();
    let samples = Array3::from_shape_vec((raster.height, raster.width, BANDS), samples)
        .map_err(|error| problem(error.to_string()))?;
    // Halved until one tile shows it all.
    let longest = raster.width.max(raster.height) as u32;
    let overviews = (1..16).map(|level| 1 << level).take_while(|factor| longest / (factor / 2) > TILE).collect();
    let mut bytes = Cursor::new(Vec::new());
    CogBuilder::new(builder)
        .overview_levels(overviews)
        .resampling(Resampling::NearestNeighbor)
        .write_3d_to(&mut bytes, samples.view())
        .map_err(|error| problem(error.to_string()))?;
    write_file(path, bytes.get_ref())
}

//! `trajectories.svg`: the map with trajectory, dead reckoning and loop closures, in metres and without loss at any size.

use crate::report::page::{View, map_png};
use crate::solve::Solution;
use floorprint::back_end::Verdict;
use floorprint::map::{Occupancy, Raster};

/// How lines look; their widths are pixels at any zoom. The colours are those of the pictures.
const STYLE: &str = "path{fill:none;stroke-width:2px;vector-effect:non-scaling-stroke;stroke-linejoin:round}\
    image{image-rendering:pixelated}.trajectory{stroke:#dc2626}.odometry{stroke:#2563eb;stroke-width:1.5px}\
    .loops{stroke:#16a34a;stroke-width:1px}svg{background:#cdcdcd}";

/// The drawing as an SVG file.
///
/// # Errors
/// The map cannot be encoded as a picture.
pub(crate) fn map_drawing(map: &Raster<Occupancy>, solution: &Solution) -> Result<String, png::EncodingError> {
    let view = View::around(&[&solution.trajectory, &solution.odometry], map);
    let accepted = solution.closures.iter().filter(|closure| closure.verdict == Verdict::Accepted);
    let ends = accepted.filter_map(|closure| {
        let [older, newer] = closure.frames.map(|frame| solution.trajectory.get(frame));
        Some([older?, newer?])
    });
    let lines = [
        view.image("cells", map.origin_m, map.width, map.height, map.resolution_m, &map_png(map)?),
        view.path("odometry", &solution.odometry),
        view.path("trajectory", &solution.trajectory),
        view.segments("loops", ends),
    ];
    let view_box = view.view_box();
    Ok(format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"{view_box}\"><style>{STYLE}</style>\n{}\n</svg>\n",
        lines.join("\n")
    ))
}

//! A drive as a small drawing: walls, truth, odometry, and what was claimed.

use floorprint::geometry::Pose2;
use floorprint::simulator::Wall;
use std::fmt::Write as _;

/// Longest side of a drawing, SVG units.
const SIDE: f64 = 420.0;
/// Lines are drawn through so many points at most.
const POINTS: usize = 500;
/// Walls are drawn this far around the drive, metres.
const MARGIN_M: f64 = 12.0;

/// What is drawn; poses are seen from the first scan's.
pub(super) struct Picture<'a> {
    pub(super) walls: &'a [Wall],
    /// Pose of the first scan in the walls' frame.
    pub(super) start: Pose2,
    pub(super) truth: Vec<Pose2>,
    pub(super) odometry: Vec<Pose2>,
    /// Each with whether the robot is said to be lost.
    pub(super) live: Vec<(Pose2, bool)>,
    pub(super) result: Vec<(Pose2, bool)>,
}

impl Picture<'_> {
    /// The drawing: truth green, odometry blue, the live poses orange, the final ones red; dotted where the robot is
    /// said to be lost.
    pub(super) fn to_svg(&self) -> String {
        let shown = self.truth.iter().chain(self.result.iter().map(|(pose, _)| pose));
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for pose in shown {
            for (axis, value) in [pose.x, pose.y].into_iter().enumerate() {
                (low[axis], high[axis]) = (low[axis].min(value - MARGIN_M), high[axis].max(value + MARGIN_M));
            }
        }
        let size_m = [0, 1].map(|axis| (high[axis] - low[axis]).max(1.0));
        let scale = SIDE / size_m[0].max(size_m[1]);
        let place = |[x, y]: [f64; 2]| [(x - low[0]) * scale, (high[1] - y) * scale];
        let [width, height] = size_m.map(|length_m| length_m * scale);
        let mut walls = String::new();
        let start_from_building = self.start.inverse();
        for wall in self.walls {
            let ends = [wall.from_m, wall.to_m].map(|point| start_from_building.transform_point(point));
            let is_shown = ends.iter().any(|end| (0..2).all(|axis| (low[axis]..high[axis]).contains(&end[axis])));
            if is_shown {
                let [[ax, ay], [bx, by]] = ends.map(place);
                let _ = write!(walls, "M{ax:.1} {ay:.1}L{bx:.1} {by:.1}");
            }
        }
        let line = |poses: &mut dyn Iterator<Item = Pose2>| {
            let mut path = String::new();
            for pose in poses {
                let [x, y] = place([pose.x, pose.y]);
                let _ = write!(path, "{}{x:.1} {y:.1}", if path.is_empty() { 'M' } else { 'L' });
            }
            path
        };
        let step = |count: usize| (count / POINTS).max(1);
        let truth = line(&mut self.truth.iter().step_by(step(self.truth.len())).copied());
        let odometry = line(&mut self.odometry.iter().step_by(step(self.odometry.len())).copied());
        let claimed = |claims: &[(Pose2, bool)], class: &str| {
            let thinned: Vec<(Pose2, bool)> = claims.iter().step_by(step(claims.len())).copied().collect();
            let stretches = thinned.chunk_by(|a, b| a.1 == b.1);
            let draw = |stretch: &[(Pose2, bool)]| {
                let dots = if stretch[0].1 { r#" stroke-dasharray="2 3""# } else { "" };
                format!(r#"<path class="{class}"{dots} d="{}"/>"#, line(&mut stretch.iter().map(|(pose, _)| *pose)))
            };
            stretches.map(draw).collect::<String>()
        };
        let (live, result) = (claimed(&self.live, "live"), claimed(&self.result, "result"));
        let bar_m = crate::figure::scale_bar_length_m(size_m[0]);
        let (bar, below) = (bar_m * scale, height - 8.0);
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" width=\"{width:.0}\" height=\"{height:.0}\"><style>path{{fill:none;stroke-width:1.4}}.walls{{stroke:#9aa3af;stroke-width:.8}}.truth{{stroke:#16a34a;stroke-width:3}}.odometry{{stroke:#2563eb}}.live{{stroke:#f59e0b}}.result{{stroke:#dc2626}}text{{font:11px system-ui}}</style><rect width=\"100%\" height=\"100%\" fill=\"#fff\"/><path class=\"walls\" d=\"{walls}\"/><path class=\"truth\" d=\"{truth}\"/><path class=\"odometry\" d=\"{odometry}\"/>{live}{result}<path stroke=\"#14181f\" d=\"M8 {below:.1}h{bar:.1}\"/><text x=\"8\" y=\"{:.1}\">{bar_m} m</text></svg>\n",
            below - 4.0
        )
    }
}

//! Line charts as SVG, drawn with the page's own colours.

use floorprint::survey::silences;
use std::fmt::Write;

/// A chart's drawing area, SVG units.
pub(crate) const WIDTH: f64 = 640.0;
pub(crate) const HEIGHT: f64 = 196.0;
const LEFT: f64 = 58.0;
const RIGHT: f64 = 10.0;
const TOP: f64 = 12.0;
const BOTTOM: f64 = 32.0;
/// Long series are drawn as the envelope over this many columns.
const COLUMNS: usize = 400;

/// A line chart of a value over time, or another quantity.
pub(crate) struct Chart<'a> {
    /// What is shown, with its unit.
    pub(crate) title: &'a str,
    /// Class of the line; the style sheet gives it its colour.
    pub(crate) class: &'a str,
    /// Time (seconds), or the other quantity, and value of each point.
    pub(crate) points: Vec<[f64; 2]>,
    /// Top of the value axis, where it is known beforehand.
    pub(crate) maximum: Option<f64>,
}

impl Chart<'_> {
    /// The chart over seconds as a `<figure>` with what it means; empty when there is nothing to draw.
    pub(crate) fn to_html(&self, meaning: &str) -> String {
        let title = self.title;
        self.to_svg("s", None).map_or(String::new(), |svg| {
            format!(r#"<figure class="chart"><figcaption>{title}</figcaption>{svg}<p class="caption">{meaning}</p></figure>"#)
        })
    }

    /// The chart as an `<svg>`; `None` when there is nothing to draw. The horizontal axis has a unit, and
    /// begins at a number or with the first point. In the former case points are marked.
    pub(crate) fn to_svg(&self, unit: &str, from: Option<f64>) -> Option<String> {
        let (title, lines) = (self.title, self.lines(unit, from)?);
        Some(format!(r#"<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{title}">{lines}</svg>"#))
    }

    /// What is in that `<svg>`.
    pub(crate) fn lines(&self, unit: &str, from: Option<f64>) -> Option<String> {
        let points = || self.points.iter().filter(|point| point[1].is_finite());
        let extreme = |axis: usize, pick: fn(f64, f64) -> f64| points().map(|point| point[axis]).reduce(pick);
        let (Some(start), Some(end), Some(low), Some(high)) =
            (extreme(0, f64::min), extreme(0, f64::max), extreme(1, f64::min), extreme(1, f64::max))
        else {
            return None;
        };
        let marked = from.is_some();
        // One point in time is no course of things.
        if !marked && end <= start {
            return None;
        }
        let start = from.unwrap_or(start);
        let times = Axis::new(0.0, (end - start).max(1e-9));
        let low = low.min(0.0);
        let heights = Axis::new(low, self.maximum.unwrap_or(high).max(low + 1e-9));
        let x = |time: f64| LEFT + (time - start) / times.high * (WIDTH - LEFT - RIGHT);
        let y = |value: f64| TOP + (heights.high - value) / (heights.high - heights.low) * (HEIGHT - TOP - BOTTOM);

        let mut svg = String::new();
        for tick in heights.ticks() {
            let (at, right, label) = (y(tick), WIDTH - RIGHT, heights.label(tick));
            let _ = write!(
                svg,
                r#"<path class="grid" d="M{LEFT} {at:.1}H{right:.1}"/><text class="tick" x="{:.1}" y="{:.1}" text-anchor="end">{label}</text>"#,
                LEFT - 6.0,
                at + 3.5
            );
        }
        for tick in times.ticks() {
            let (at, below, label) = (x(start + tick), HEIGHT - 8.0, times.label(tick));
            let _ = write!(
                svg,
                r#"<text class="tick" x="{at:.1}" y="{below:.1}" text-anchor="middle">{label} {unit}</text>"#
            );
        }
        let mut path = String::new();
        let pieces = if marked { vec![self.points.as_slice()] } else { between_silences(&self.points) };
        let in_a_column = self.points.len().div_ceil(COLUMNS);
        for piece in pieces {
            let mut command = 'M';
            for [time, value] in envelope(piece, in_a_column) {
                let (right, down) = (x(time), y(value.min(heights.high)));
                let _ = write!(path, "{command}{right:.1} {down:.1}");
                command = 'L';
                if marked {
                    let _ = write!(svg, r#"<circle class="mark" cx="{right:.1}" cy="{down:.1}" r="3"/>"#);
                }
            }
        }
        let class = self.class;
        Some(format!(r#"{svg}<path class="line {class}" d="{path}"/>"#))
    }
}

/// The points over time in pieces: where a sensor is silent nothing is known, and no line is drawn.
fn between_silences(points: &[[f64; 2]]) -> Vec<&[[f64; 2]]> {
    let stamps_s: Vec<f64> = points.iter().map(|point| point[0]).collect();
    let silences = silences(&stamps_s);
    let mut ends = silences.iter().peekable();
    points
        .chunk_by(|before, after| ends.next_if(|[from_s, to_s]| before[0] <= *from_s && after[0] >= *to_s).is_none())
        .collect()
}

/// The lowest and highest point of each stretch of so many, so that no peak is lost; few points as they are.
fn envelope(points: &[[f64; 2]], in_a_stretch: usize) -> Vec<[f64; 2]> {
    let points: Vec<[f64; 2]> = points.iter().copied().filter(|point| point[1].is_finite()).collect();
    if in_a_stretch <= 2 {
        return points;
    }
    let mut kept = Vec::with_capacity(2 * COLUMNS);
    for stretch in points.chunks(in_a_stretch) {
        let by_value = |a: &&[f64; 2], b: &&[f64; 2]| a[1].total_cmp(&b[1]);
        let ends = stretch.iter().min_by(by_value).zip(stretch.iter().max_by(by_value));
        let Some((low, high)) = ends else { continue };
        if low[0] <= high[0] { kept.extend([*low, *high]) } else { kept.extend([*high, *low]) }
    }
    kept
}

/// An axis with round ticks.
struct Axis {
    low: f64,
    high: f64,
    step: f64,
}

impl Axis {
    fn new(low: f64, high: f64) -> Self {
        let rough = (high - low) / 4.0;
        let magnitude = 10_f64.powf(rough.log10().floor());
        let factor = [1.0, 2.0, 5.0].into_iter().find(|factor| factor * magnitude >= rough).unwrap_or(10.0);
        Self { low, high, step: factor * magnitude }
    }

    fn ticks(&self) -> impl Iterator<Item = f64> + '_ {
        let first = (self.low / self.step).ceil() as i64;
        (first..).map(|index| index as f64 * self.step).take_while(|tick| *tick <= self.high + self.step * 1e-6)
    }

    fn label(&self, tick: f64) -> String {
        let decimals = (-self.step.log10().floor()).max(0.0) as usize;
        format!("{tick:.decimals$}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let axis = Axis::new(0.0, 123.0);
        assert_eq!(axis.ticks().collect::<Vec<_>>(), [0.0, 50.0, 100.0]);
        assert_eq!(Axis::new(0.0, 0.9).label(0.5), "0.5");
    }

    #[test]
    fn the_envelope_keeps_peaks() {
        let mut points: Vec<[f64; 2]> = (0..10_000).map(|i| [f64::from(i), 0.0]).collect();
        points[7777][1] = 5.0;
        let kept = envelope(&points, points.len() / COLUMNS);
        assert!(kept.len() <= 2 * COLUMNS && kept.contains(&[7777.0, 5.0]));
        assert!(kept.windows(2).all(|pair| pair[0][0] <= pair[1][0]));
    }

    #[test]
    fn no_line_is_drawn_over_a_silence() {
        let points: Vec<[f64; 2]> =
            (0..40).map(|i| [f64::from(i) * 0.1 + if i < 20 { 0.0 } else { 9.0 }, 1.0]).collect();
        let lines_of =
            |chart: &Chart<'_>, from| chart.lines("s", from).unwrap().rsplit_once("d=").unwrap().1.matches('M').count();
        let chart = Chart { title: "t", class: "", points, maximum: None };
        assert_eq!(lines_of(&chart, None), 2);
        assert_eq!(lines_of(&chart, Some(0.0)), 1, "what is no time knows no silence");
    }

    #[test]
    fn nothing_is_drawn_from_nothing() {
        let chart = |points: Vec<[f64; 2]>| Chart { title: "t", class: "", points, maximum: None }.to_html("m");
        assert_eq!((chart(vec![]), chart(vec![[3.0, 1.0]])), (String::new(), String::new()));
        assert_ne!(chart(vec![[3.0, 1.0], [4.0, 1.0]]), "");
    }
}

//! How several images of one cell become one colour.

use super::config::Blend;

/// The cells of a tile while images are laid into them, in the images' order.
pub(super) enum Canvas {
    /// Sums of weighted red, green and blue, and of the weights.
    Mean(Vec<[f32; 4]>),
    /// Every view, to be sorted at the end.
    Median(Vec<View>),
    /// The newest sharp view so far, and the greatest weight so far.
    Newest(Vec<([f32; 3], f32)>),
}

/// What one image says about one cell.
#[derive(Debug, Clone, Copy)]
pub(super) struct View {
    cell: u32,
    weight: f32,
    rgb: [f32; 3],
}

/// A view counts as sharp when its weight is at least this part of the greatest.
const SHARP: f32 = 0.5;

impl Canvas {
    pub(super) fn new(mode: Blend, cells: usize) -> Self {
        match mode {
            Blend::Mean => Self::Mean(vec![[0.0; 4]; cells]),
            Blend::Median => Self::Median(Vec::new()),
            Blend::Newest => Self::Newest(vec![([0.0; 3], 0.0); cells]),
        }
    }

    /// Lays a view of positive weight into a cell.
    pub(super) fn add(&mut self, cell: usize, weight: f32, rgb: [f32; 3]) {
        match self {
            Self::Mean(sums) => {
                for (sum, value) in sums[cell].iter_mut().zip([rgb[0], rgb[1], rgb[2], 1.0]) {
                    *sum += weight * value;
                }
            }
            Self::Median(views) => views.push(View { cell: cell as u32, weight, rgb }),
            Self::Newest(cells) => {
                let (newest, greatest) = &mut cells[cell];
                if weight >= SHARP * *greatest {
                    *newest = rgb;
                    *greatest = greatest.max(weight);
                }
            }
        }
    }

    /// The colours of `cells` cells; `None` where there was no view.
    pub(super) fn colors(self, cells: usize) -> Vec<Option<[u8; 3]>> {
        let rounded = |rgb: [f32; 3]| Some(rgb.map(|value| value.round() as u8));
        match self {
            Self::Mean(sums) => sums
                .into_iter()
                .map(|[r, g, b, weight]| if weight > 0.0 { rounded([r, g, b].map(|sum| sum / weight)) } else { None })
                .collect(),
            Self::Median(mut views) => {
                let mut colors = vec![None; cells];
                views.sort_by_key(|view| view.cell);
                for views in views.chunk_by_mut(|a, b| a.cell == b.cell) {
                    colors[views[0].cell as usize] = rounded([0, 1, 2].map(|channel| weighted_median(views, channel)));
                }
                colors
            }
            Self::Newest(cells) => {
                cells.into_iter().map(|(rgb, weight)| if weight > 0.0 { rounded(rgb) } else { None }).collect()
            }
        }
    }
}

/// The value of a channel with half of the weight on either side.
fn weighted_median(views: &mut [View], channel: usize) -> f32 {
    views.sort_by(|a, b| a.rgb[channel].total_cmp(&b.rgb[channel]));
    let half = views.iter().map(|view| view.weight).sum::<f32>() / 2.0;
    let mut below = 0.0;
    let middle = views.iter().position(|view| {
        below += view.weight;
        below >= half
    });
    views[middle.unwrap_or(views.len() - 1)].rgb[channel]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn blended(mode: Blend, views: &[(f32, f32)]) -> Option<[u8; 3]> {
        let mut canvas = Canvas::new(mode, 2);
        for &(weight, grey) in views {
            canvas.add(1, weight, [grey; 3]);
        }
        let colors = canvas.colors(2);
        assert_eq!(colors[0], None);
        colors[1]
    }

    #[test]
    fn the_mean_follows_the_weights() {
        assert_eq!(blended(Blend::Mean, &[(3.0, 100.0), (1.0, 200.0)]), Some([125; 3]));
    }

    #[test]
    fn the_median_ignores_a_ghost() {
        assert_eq!(blended(Blend::Median, &[(1.0, 100.0), (1.0, 255.0), (1.0, 102.0)]), Some([102; 3]));
    }

    #[test]
    fn the_newest_wins_unless_it_is_blurred() {
        assert_eq!(blended(Blend::Newest, &[(1.0, 10.0), (0.8, 20.0), (0.1, 30.0)]), Some([20; 3]));
        assert_eq!(blended(Blend::Newest, &[(0.1, 30.0), (1.0, 10.0)]), Some([10; 3]));
    }

    #[test]
    fn a_cell_without_a_view_stays_empty() {
        for mode in [Blend::Mean, Blend::Median, Blend::Newest] {
            assert_eq!(blended(mode, &[]), None);
        }
    }
}

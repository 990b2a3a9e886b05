//! The trees of frames that a recording states (TF), and what in them is fixed.
//!
//! A frame's pose in its parent is *fixed* when it is on a static topic, or when all its samples agree: ROS 1
//! repeats mounts again and again. Everything that is fixed to the robot hangs together by fixed edges; the first
//! edge above that moves is odometry. What is wrong with trees in practice: a frame with two parents, mounts
//! from leaf to root, leading slashes, `map → odom` with the map below.

use super::messages::Placed;
use floorprint::geometry::Pose3;
use std::collections::BTreeMap;

/// Samples of a mount agree within this, metres and entries of the rotation's matrix.
const AGREEMENT: f64 = 1e-4;

/// So many samples tell by how much an edge's clock differs.
const MOST_DELAYS: usize = 1000;

/// Frames of the world: what moves in them is a place in a map, not odometry.
const WORLDS: [&str; 4] = ["map", "world", "earth", "utm"];

/// All edges of all trees, by child.
#[derive(Default)]
pub(super) struct Transforms {
    edges: BTreeMap<String, Vec<Edge>>,
}

/// A frame's pose in a parent.
struct Edge {
    parent: String,
    /// `parent_from_child`: the newest sample of what is static, else the first.
    pose: Pose3,
    is_static: bool,
    /// How far any sample is from the one before that counts.
    deviation: f64,
    samples: usize,
    /// By how much each of the first ones was recorded after its stamp, seconds.
    delays_s: Vec<f64>,
}

impl Edge {
    fn is_fixed(&self) -> bool {
        self.is_static || self.deviation <= AGREEMENT
    }

    /// A few stamps may be nonsense.
    fn median_delay_s(&self) -> f64 {
        let mut delays_s = self.delays_s.clone();
        let middle = delays_s.len() / 2;
        *delays_s.select_nth_unstable_by(middle, f64::total_cmp).1
    }
}

/// An edge that moves: odometry.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct MovingEdge {
    pub(super) parent: String,
    pub(super) child: String,
    pub(super) samples: usize,
    /// By how much its first samples were recorded after their stamps, the median, seconds.
    pub(super) delay_s: f64,
}

impl Transforms {
    /// Takes one more sample of an edge, recorded so many seconds after its stamp.
    pub(super) fn add(&mut self, sample: &Placed, is_static: bool, delay_s: f64) {
        let Pose3 { rotation, translation_m } = &sample.pose;
        if sample.child == sample.parent || !rotation.iter().chain(translation_m).all(|value| value.is_finite()) {
            return;
        }
        if !self.edges.contains_key(&sample.child) {
            self.edges.insert(sample.child.clone(), Vec::new());
        }
        let Some(parents) = self.edges.get_mut(&sample.child) else { return };
        let Some(edge) = parents.iter_mut().find(|edge| edge.parent == sample.parent) else {
            parents.push(Edge {
                parent: sample.parent.clone(),
                pose: sample.pose,
                is_static,
                deviation: 0.0,
                samples: 1,
                delays_s: vec![delay_s],
            });
            return;
        };
        let moved = (sample.pose.translation_m - edge.pose.translation_m).amax();
        let turned = (sample.pose.rotation - edge.pose.rotation).amax();
        edge.deviation = edge.deviation.max(moved.max(turned));
        edge.is_static |= is_static;
        // What is stated anew of what is static was mended.
        if is_static {
            edge.pose = sample.pose;
        }
        edge.samples += 1;
        if edge.delays_s.len() < MOST_DELAYS {
            edge.delays_s.push(delay_s);
        }
    }

    /// Takes the edges of other trees for frames that have no parent here.
    pub(super) fn add_unknown(&mut self, others: Self) {
        for (child, edges) in others.edges {
            self.edges.entry(child).or_insert(edges);
        }
    }

    /// Whether another tree says something else of where a frame is in its parent, or how it moves there.
    pub(super) fn contradicts(&self, other: &Self) -> bool {
        let are_different = |a: &Edge, b: &Edge| {
            let off =
                (a.pose.translation_m - b.pose.translation_m).amax().max((a.pose.rotation - b.pose.rotation).amax());
            a.parent == b.parent && off.max((a.deviation - b.deviation).abs()) > AGREEMENT
        };
        self.edges.iter().any(|(child, edges)| {
            let others = other.edges.get(child).into_iter().flatten();
            others.into_iter().any(|other| edges.iter().any(|edge| are_different(edge, other)))
        })
    }

    /// Whether a frame is known at all.
    pub(super) fn knows(&self, frame: &str) -> bool {
        self.edges.contains_key(frame) || self.edges.values().flatten().any(|edge| edge.parent == frame)
    }

    /// The names of all frames.
    pub(super) fn frames(&self) -> impl Iterator<Item = &str> {
        self.edges.iter().flat_map(|(child, parents)| {
            std::iter::once(child.as_str()).chain(parents.iter().map(|edge| edge.parent.as_str()))
        })
    }

    /// `frame` and the frames above it to which it is fixed, each with `ancestor_from_frame`.
    fn fixed_ancestors<'a>(&'a self, frame: &'a str) -> Vec<(&'a str, Pose3)> {
        let mut chain = vec![(frame, Pose3::identity())];
        while let Some(&(child, child_from_frame)) = chain.last() {
            let edge = self.edges.get(child).into_iter().flatten().find(|edge| {
                // A world is nothing that a robot's part is fixed to, even when the robot rests.
                edge.is_fixed() && !is_world(&edge.parent) && edge.parent != "odom"
            });
            let Some(edge) = edge.filter(|edge| chain.iter().all(|(known, _)| *known != edge.parent)) else { break };
            chain.push((&edge.parent, edge.pose.compose(&child_from_frame)));
        }
        chain
    }

    /// The topmost frame to which `frame` is fixed.
    pub(super) fn topmost<'a>(&'a self, frame: &'a str) -> &'a str {
        self.fixed_ancestors(frame).last().map_or(frame, |(top, _)| top)
    }

    /// `to_from_from` of two frames that are fixed to each other.
    pub(super) fn between(&self, to: &str, from: &str) -> Option<Pose3> {
        if to == from {
            return Some(Pose3::identity());
        }
        let above = self.fixed_ancestors(from);
        self.fixed_ancestors(to).iter().find_map(|(frame, frame_from_to)| {
            let (_, frame_from_from) = above.iter().find(|(other, _)| other == frame)?;
            Some(frame_from_to.inverse().compose(frame_from_from))
        })
    }

    /// Whether an edge that moves lies between two frames of one tree.
    pub(super) fn moves_between(&self, to: &str, from: &str) -> bool {
        let all_above = |frame: &str| {
            let mut chain = vec![frame.to_owned()];
            while let Some(edge) = chain.last().and_then(|child| self.edges.get(child)?.first()) {
                if is_world(&edge.parent) || edge.parent == "odom" || chain.contains(&edge.parent) {
                    break;
                }
                chain.push(edge.parent.clone());
            }
            chain
        };
        let above = all_above(from);
        self.between(to, from).is_none() && all_above(to).iter().any(|frame| above.contains(frame))
    }

    /// The edge by which all that is fixed to `base` moves in an odometry's frame: the first one above that moves.
    pub(super) fn odometry_of(&self, base: &str) -> Option<MovingEdge> {
        self.fixed_ancestors(base).iter().find_map(|&(child, _)| {
            let moving = self.edges.get(child).into_iter().flatten();
            let moving = moving.filter(|edge| !edge.is_fixed() && !is_world(&edge.parent));
            let best = moving.max_by_key(|edge| (edge.parent.contains("odom"), edge.samples))?;
            Some(MovingEdge {
                parent: best.parent.clone(),
                child: child.to_owned(),
                samples: best.samples,
                delay_s: best.median_delay_s(),
            })
        })
    }
}

/// Whether a frame is that of a map, in which who moves has a place rather than odometry.
pub(super) fn is_world(frame: &str) -> bool {
    WORLDS.contains(&frame)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `parent → child` at these places along x.
    fn tree(edges: &[(&str, &str, &[f64])]) -> Transforms {
        let mut transforms = Transforms::default();
        for (parent, child, places) in edges {
            for &x_m in *places {
                transforms.add(
                    &Placed {
                        stamp_s: 0.0,
                        parent: (*parent).to_owned(),
                        child: (*child).to_owned(),
                        pose: Pose3::from_quaternion([x_m, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]),
                    },
                    false,
                    0.0,
                );
            }
        }
        transforms
    }

    #[test]
    fn what_is_fixed_hangs_together_and_moves_in_the_odometry() {
        let transforms = tree(&[
            ("map", "odom", &[0.0, 0.5]),
            ("odom", "base_footprint", &[0.0, 1.0, 2.0]),
            ("base_footprint", "base_link", &[0.1, 0.1]),
            ("base_link", "laser", &[0.2, 0.2]),
            ("base_link", "wheel", &[0.0, 0.3]),
        ]);
        assert_eq!(transforms.topmost("laser"), "base_footprint");
        assert!((transforms.between("base_footprint", "laser").unwrap().translation_m.x - 0.3).abs() < 1e-12);
        assert!((transforms.between("laser", "base_link").unwrap().translation_m.x + 0.2).abs() < 1e-12);
        let edge = transforms.odometry_of("base_link").unwrap();
        assert_eq!((edge.parent.as_str(), edge.child.as_str(), edge.samples), ("odom", "base_footprint", 3));
        assert!(transforms.between("base_link", "wheel").is_none() && transforms.moves_between("base_link", "wheel"));
        assert!(!transforms.moves_between("base_link", "nowhere"));
    }

    #[test]
    fn trees_that_are_upside_down_or_circles_end() {
        // The footprint hangs below the base; the map below the odometry.
        let transforms = tree(&[
            ("odom", "base_link", &[0.0, 1.0]),
            ("base_link", "base_footprint", &[-0.1, -0.1]),
            ("odom", "map", &[0.0, 0.2]),
            ("a", "b", &[0.0]),
            ("b", "a", &[0.0]),
        ]);
        assert_eq!(transforms.odometry_of("base_footprint").unwrap().child, "base_link");
        assert_eq!(transforms.topmost("a"), "b");
        // A place in a map is no odometry.
        assert!(tree(&[("map", "base_link", &[0.0, 1.0])]).odometry_of("base_link").is_none());
    }
}

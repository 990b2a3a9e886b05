//! Pose graphs in the plane in the g2o format: `VERTEX_SE2`, `EDGE_SE2`, `EDGE_PRIOR_SE2`
//! and `FIX` lines (Kümmerle et al. 2011, "g2o: a general framework for graph optimization").

use crate::error::{Problem, ReadError, WriteError, quoted};
use crate::number::{Tokens, parse_count};
use crate::regular_file::read_regular;
use crate::replace::write_file;
use floorprint::geometry::Pose2;
use floorprint::pose_graph::{BetweenFactor, PoseGraph, PoseGraphError, PriorFactor, RobustKernel};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::Path;

/// Information of the prior that stands for a `FIX` line: a tenth of a millimetre and of a milliradian.
const FIXED_INFORMATION: f64 = 1e8;

/// A pose graph with what a file says of it besides.
#[derive(Debug, Clone, PartialEq)]
pub struct G2o {
    /// The graph.
    pub graph: PoseGraph,
    /// What the file calls each node; rising.
    pub ids: Vec<usize>,
    /// Which of the graph's priors stand for `FIX` lines.
    pub fixed: BTreeSet<usize>,
}

impl From<PoseGraph> for G2o {
    /// The graph with its nodes called by their numbers.
    fn from(graph: PoseGraph) -> Self {
        Self { ids: (0..graph.poses().len()).collect(), graph, fixed: BTreeSet::new() }
    }
}

/// Writes a graph at its current estimates, fixed vertices where they were fixed.
///
/// The format knows no robust kernels: they are left out. Weights are multiplied into
/// the information, and relative measurements with weight 0 are left out.
///
/// # Errors
/// When the file cannot be written, or a vertex lies so far away that it could not be read again.
pub fn write_g2o(path: &Path, graph: &G2o) -> Result<(), WriteError> {
    let far = graph.graph.poses().iter().zip(&graph.ids).find(|(pose, _)| !is_near(pose));
    if let Some((pose, id)) = far {
        let found = format!("vertex {id} at ({:e}, {:e})", pose.x, pose.y);
        return Err(Problem::new(path, found).expected("vertices within 1e30 of the origin").into());
    }
    write_file(path, format_g2o(graph).as_bytes())
}

fn format_g2o(G2o { graph, ids, fixed }: &G2o) -> String {
    let mut text = String::new();
    let mut line = |tag: &str, nodes: &[usize], numbers: &[f64]| {
        text.push_str(tag);
        // Writing to a string cannot fail.
        nodes.iter().for_each(|&node| _ = write!(text, " {}", ids[node]));
        // Exact, and short for the smallest and largest numbers, too.
        numbers.iter().for_each(|number| _ = write!(text, " {number:?}"));
        text.push('\n');
    };
    let mut poses = graph.poses().to_vec();
    for &prior in fixed {
        let PriorFactor { node, world_from_node, .. } = graph.prior_factors()[prior];
        poses[node] = world_from_node;
    }
    for (node, pose) in poses.iter().enumerate() {
        line("VERTEX_SE2", &[node], &[pose.x, pose.y, pose.theta]);
    }
    let numbers = |pose: &Pose2, information: [[f64; 3]; 3], weight: f64| {
        let [[xx, xy, xt], [_, yy, yt], [_, _, tt]] = information.map(|row| row.map(|value| weight * value));
        [pose.x, pose.y, pose.theta, xx, xy, xt, yy, yt, tt]
    };
    for (prior, factor) in graph.prior_factors().iter().enumerate() {
        if fixed.contains(&prior) {
            line("FIX", &[factor.node], &[]);
        } else {
            line("EDGE_PRIOR_SE2", &[factor.node], &numbers(&factor.world_from_node, factor.information.into(), 1.0));
        }
    }
    for factor in graph.between_factors().iter().filter(|factor| factor.weight > 0.0) {
        let numbers = numbers(&factor.from_from_to, factor.information.into(), factor.weight);
        line("EDGE_SE2", &[factor.from, factor.to], &numbers);
    }
    text
}

/// Reads a graph. Nodes are numbered in the order of their ids in the file, from 0.
///
/// A `FIX` line becomes a strong prior at the vertex's estimate. Empty lines and lines
/// beginning with `#` are skipped.
///
/// # Errors
/// When the file cannot be read, holds no vertex, a line is of another kind or does not hold what
/// its kind holds, a vertex comes twice, or an edge names a vertex that is not there.
pub fn read_g2o(path: &Path) -> Result<G2o, ReadError> {
    let text = read_regular(path)?;
    parse_g2o(path, &text)
}

/// A line that refers to vertices; those may come later in the file.
enum Constraint {
    Between { ids: [usize; 2], from_from_to: Pose2, information: [[f64; 3]; 3] },
    Prior { id: usize, world_from_node: Pose2, information: [[f64; 3]; 3] },
    Fix { id: usize },
}

fn parse_g2o(path: &Path, text: &[u8]) -> Result<G2o, ReadError> {
    let mut vertices: BTreeMap<usize, Pose2> = BTreeMap::new();
    let mut constraints = Vec::new();
    for (index, line) in text.split(|&byte| byte == b'\n').map(<[u8]>::trim_ascii).enumerate() {
        let place = || format!("line {}", index + 1);
        let tokens = &mut Tokens::new(line);
        let kind = tokens.next().unwrap_or_default();
        let (parsed, expected) = match kind {
            b"" => continue,
            _ if kind.starts_with(b"#") => continue,
            b"VERTEX_SE2" => {
                let vertex = (|| Some((tokens.count()?, pose(tokens).filter(is_near)?)))();
                if let Some((id, pose)) = vertex
                    && vertices.insert(id, pose).is_some()
                {
                    return Err(Problem::new(path, format!("vertex {id} for the second time")).at(place()).into());
                }
                (vertex.map(|_| vec![]), "VERTEX_SE2 id x y theta, within 1e30 of the origin")
            }
            b"EDGE_SE2" => (between(tokens), "EDGE_SE2 from to x y theta and six numbers of information"),
            b"EDGE_PRIOR_SE2" => (prior(tokens), "EDGE_PRIOR_SE2 id x y theta and six numbers of information"),
            b"FIX" => (fix(tokens), "FIX and the ids of vertices"),
            _ => (None, "a graph in the plane: VERTEX_SE2, EDGE_SE2, EDGE_PRIOR_SE2 or FIX"),
        };
        let parsed = parsed.filter(|_| tokens.next().is_none());
        let found = parsed.ok_or_else(|| Problem::new(path, quoted(line)).at(place()).expected(expected))?;
        constraints.extend(found.into_iter().map(|constraint| (constraint, index + 1)));
    }
    if vertices.is_empty() {
        return Err(Problem::new(path, "it holds no VERTEX_SE2").expected("a graph in the plane").into());
    }
    build(path, &vertices, constraints)
}

fn build(
    path: &Path,
    vertices: &BTreeMap<usize, Pose2>,
    constraints: Vec<(Constraint, usize)>,
) -> Result<G2o, ReadError> {
    let mut graph = PoseGraph::default();
    let mut fixed = BTreeSet::new();
    let node_of: BTreeMap<usize, usize> = vertices.iter().map(|(id, pose)| (*id, graph.add_node(*pose))).collect();
    for (constraint, line) in constraints {
        let place = || format!("line {line}");
        let node = |id: usize| {
            let missing = || Problem::new(path, format!("no vertex {id}")).at(place());
            node_of.get(&id).copied().ok_or_else(missing)
        };
        let added = match constraint {
            Constraint::Between { ids: [from, to], .. } if from == to => {
                return Err(Problem::new(path, format!("an edge from vertex {from} to itself")).at(place()).into());
            }
            Constraint::Between { ids: [from, to], from_from_to, information } => graph.add_between(BetweenFactor {
                from: node(from)?,
                to: node(to)?,
                from_from_to,
                information: information.into(),
                kernel: RobustKernel::Quadratic,
                weight: 1.0,
            }),
            Constraint::Prior { id, world_from_node, information } => {
                graph.add_prior(PriorFactor { node: node(id)?, world_from_node, information: information.into() })
            }
            Constraint::Fix { id } => {
                let node = node(id)?;
                let mut information = [[0.0; 3]; 3];
                (0..3).for_each(|i| information[i][i] = FIXED_INFORMATION);
                let world_from_node = graph.poses()[node];
                let added = graph.add_prior(PriorFactor { node, world_from_node, information: information.into() });
                fixed.extend(added.as_ref().ok());
                added
            }
        };
        added.map_err(|error| {
            // The graph knows nodes by other names than the file.
            let found = match error {
                PoseGraphError::BadFactor { what, .. } => what.to_owned(),
                other => other.to_string(),
            };
            Problem::new(path, found).at(place())
        })?;
    }
    Ok(G2o { graph, ids: vertices.keys().copied().collect(), fixed })
}

fn between(tokens: &mut Tokens) -> Option<Vec<Constraint>> {
    let ids = [tokens.count()?, tokens.count()?];
    Some(vec![Constraint::Between { ids, from_from_to: pose(tokens)?, information: information(tokens)? }])
}

fn prior(tokens: &mut Tokens) -> Option<Vec<Constraint>> {
    let id = tokens.count()?;
    Some(vec![Constraint::Prior { id, world_from_node: pose(tokens)?, information: information(tokens)? }])
}

fn fix(tokens: &mut Tokens) -> Option<Vec<Constraint>> {
    let fixed: Option<Vec<_>> = tokens.map(|id| Some(Constraint::Fix { id: parse_count(id)? })).collect();
    fixed.filter(|fixed| !fixed.is_empty())
}

fn pose(tokens: &mut Tokens) -> Option<Pose2> {
    let [x, y, theta] = tokens.triple()?;
    Some(Pose2::new(x, y, theta))
}

/// Whether a pose's distances from others can be squared.
fn is_near(pose: &Pose2) -> bool {
    pose.distance() <= 1e30
}

/// The upper triangle, row by row.
fn information(tokens: &mut Tokens) -> Option<[[f64; 3]; 3]> {
    let ([xx, xy, xt], [yy, yt, tt]) = (tokens.triple()?, tokens.triple()?);
    Some([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use floorprint::pose_graph::Optimizer;

    const TRIANGLE: &str = "\
# a triangle that does not close
VERTEX_SE2 10 0 0 0
VERTEX_SE2 12 1.1 0 2
VERTEX_SE2 11 0.5 0.9 -2
FIX 10
EDGE_SE2 10 12 1 0 2.0943951 500 1 2 600 3 700
EDGE_SE2 12 11 1 0 2.0943951 500 0 0 500 0 500
EDGE_SE2 11 10 1.03 0 2.0943951 500 0 0 500 0 500
";

    fn parse(text: &str) -> Result<G2o, ReadError> {
        parse_g2o(Path::new("a.g2o"), text.as_bytes())
    }

    #[test]
    fn a_graph_comes_back_as_it_was_written() {
        let mut file = parse(TRIANGLE).unwrap();
        assert_eq!(file.ids, [10, 11, 12]);
        assert_eq!(file.graph.poses()[1], Pose2::new(0.5, 0.9, -2.0));
        let first = &file.graph.between_factors()[0];
        assert_eq!((first.from, first.to), (0, 2));
        assert_eq!((first.information[(1, 2)], first.information[(2, 1)]), (3.0, 3.0));
        assert_eq!(parse(&format_g2o(&file)).unwrap(), file);

        Optimizer::default().optimize(&mut file.graph).unwrap();
        assert!(file.graph.poses()[0].distance() < 1e-4);
        let text = format_g2o(&file);
        assert!(text.starts_with("VERTEX_SE2 10 0.0 0.0 0.0\n"), "what is fixed does not move: {text}");
        assert!(text.contains("\nFIX 10\n") && text.contains("\nEDGE_SE2 10 12 "), "{text}");
        let read = parse(&text).unwrap();
        assert_eq!(read.graph.poses()[1..], file.graph.poses()[1..]);
        assert_eq!((read.ids, read.fixed), (file.ids, file.fixed));
    }

    #[test]
    fn several_vertices_may_be_fixed_at_once_and_small_numbers_stay_short() {
        let file = parse("VERTEX_SE2 3 1e-200 0 0\nVERTEX_SE2 9 1 0 0\nFIX 3 9\n").unwrap();
        assert_eq!(file.graph.prior_factors().len(), 2);
        assert_eq!(format_g2o(&file), "VERTEX_SE2 3 1e-200 0.0 0.0\nVERTEX_SE2 9 1.0 0.0 0.0\nFIX 3\nFIX 9\n");
    }

    #[test]
    fn weights_go_into_the_information_and_what_is_switched_off_is_left_out() {
        let mut file = parse(TRIANGLE).unwrap();
        file.graph.set_weight(0, 0.5);
        file.graph.set_weight(1, 0.0);
        let read = parse(&format_g2o(&file)).unwrap().graph;
        assert_eq!(read.between_factors().len(), 2);
        assert_eq!(read.between_factors()[0].information[(0, 0)], 250.0);
    }

    #[test]
    fn what_could_not_be_read_again_is_not_written() {
        let chain = "VERTEX_SE2 6 1e30 0 0\nVERTEX_SE2 7 1e30 0 0\nFIX 6\nEDGE_SE2 6 7 1e30 0 0 1 0 0 1 0 1\n";
        let mut file = parse(chain).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("solved.g2o");
        write_g2o(&path, &file).unwrap();
        Optimizer::default().optimize(&mut file.graph).unwrap();
        let error = write_g2o(&path, &file).unwrap_err().to_string();
        assert!(error.contains("vertex 7 at (2e30"), "{error}");
        assert!(read_g2o(&path).is_ok());
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        for (text, place, found) in [
            ("VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1", "line 1", "VERTEX_SE3"),
            ("VERTEX_SE2 0 0 0", "line 1", "VERTEX_SE2 0 0 0"),
            ("", "", "no VERTEX_SE2"),
            ("VERTEX_SE2 0 0 0 0 0", "line 1", "VERTEX_SE2 0 0 0 0 0"),
            ("VERTEX_SE2 0 0 nan 0", "line 1", "nan"),
            ("VERTEX_SE2 0 1e300 0 0", "line 1", "1e300"),
            ("VERTEX_SE2 0 0 0 0\nFIX", "line 2", "FIX"),
            ("VERTEX_SE2 0 0 0 0\nFIX 0 x", "line 2", "FIX 0 x"),
            ("VERTEX_SE2 0 0 0 0\nVERTEX_SE2 0 0 0 0", "line 2", "second time"),
            ("\nVERTEX_SE2 0 0 0 0\nEDGE_SE2 0 7 1 0 0 1 0 0 1 0 1", "line 3", "no vertex 7"),
            ("VERTEX_SE2 7 0 0 0\nEDGE_SE2 7 7 1 0 0 1 0 0 1 0 1", "line 2", "from vertex 7 to itself"),
            ("VERTEX_SE2 7 0 0 0\nEDGE_PRIOR_SE2 7 1 0 0 -1 0 0 1 0 1", "line 2", "an information matrix"),
            ("VERTEX_SE2 7 0 0 0\nEDGE_PRIOR_SE2 7 1 0 0 1 5 0 1 0 1", "line 2", "negative"),
            ("VERTEX_SE2 7 0 0 0\nEDGE_PRIOR_SE2 7 1 0 0 1e300 0 0 1 0 1", "line 2", "1e30"),
        ] {
            let error = parse(text).unwrap_err();
            let problem = error.problem();
            assert!(problem.place == place && problem.found.contains(found), "{problem:?}");
        }
    }
}

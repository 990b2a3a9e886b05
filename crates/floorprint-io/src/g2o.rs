//! Pose graphs in the plane in the g2o format: `VERTEX_SE2`, `EDGE_SE2`, `EDGE_PRIOR_SE2`
//! and `FIX` lines (Kümmerle et al. 2011, "g2o: a general framework for graph optimization").

use crate::error::{Problem, ReadError, WriteError};
use crate::number::Tokens;
use crate::replace::write_file;
use floorprint::geometry::Pose2;
use floorprint::pose_graph::{BetweenFactor, PoseGraph, PriorFactor, RobustKernel};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs;
use std::path::Path;

/// Information of the prior that stands for a `FIX` line: a tenth of a millimetre and of a milliradian.
const FIXED_INFORMATION: f64 = 1e8;

/// Writes a graph at its current estimates.
///
/// The format knows no robust kernels: they are left out. Weights are multiplied into
/// the information, and relative measurements with weight 0 are left out.
///
/// # Errors
/// When the file cannot be written.
pub fn write_g2o(path: &Path, graph: &PoseGraph) -> Result<(), WriteError> {
    write_file(path, format_g2o(graph).as_bytes())
}

fn format_g2o(graph: &PoseGraph) -> String {
    let mut text = String::new();
    let mut line = |tag: &str, ids: &[usize], numbers: &[f64]| {
        text.push_str(tag);
        // Writing to a string cannot fail.
        ids.iter().for_each(|id| _ = write!(text, " {id}"));
        numbers.iter().for_each(|number| _ = write!(text, " {number}"));
        text.push('\n');
    };
    for (node, pose) in graph.poses().iter().enumerate() {
        line("VERTEX_SE2", &[node], &[pose.x, pose.y, pose.theta]);
    }
    let numbers = |pose: &Pose2, information: [[f64; 3]; 3], weight: f64| {
        let [[xx, xy, xt], [_, yy, yt], [_, _, tt]] = information.map(|row| row.map(|value| weight * value));
        [pose.x, pose.y, pose.theta, xx, xy, xt, yy, yt, tt]
    };
    for factor in graph.prior_factors() {
        line("EDGE_PRIOR_SE2", &[factor.node], &numbers(&factor.world_from_node, factor.information.into(), 1.0));
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
/// When the file cannot be read, a line is of another kind or does not hold what its kind
/// holds, a vertex comes twice, or an edge names a vertex that is not there.
pub fn read_g2o(path: &Path) -> Result<PoseGraph, ReadError> {
    let text = fs::read(path).map_err(|error| ReadError::io(path, &error))?;
    parse_g2o(path, &text)
}

/// A line that refers to vertices; those may come later in the file.
enum Constraint {
    Between { ids: [usize; 2], from_from_to: Pose2, information: [[f64; 3]; 3] },
    Prior { id: usize, world_from_node: Pose2, information: [[f64; 3]; 3] },
    Fix { id: usize },
}

fn parse_g2o(path: &Path, text: &[u8]) -> Result<PoseGraph, ReadError> {
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
                let vertex = (|| Some((tokens.count()?, pose(tokens)?)))();
                if let Some((id, pose)) = vertex
                    && vertices.insert(id, pose).is_some()
                {
                    return Err(Problem::new(path, format!("vertex {id} for the second time")).at(place()).into());
                }
                (vertex.map(|_| None), "VERTEX_SE2 id x y theta")
            }
            b"EDGE_SE2" => (between(tokens).map(Some), "EDGE_SE2 from to x y theta and six numbers of information"),
            b"EDGE_PRIOR_SE2" => {
                (prior(tokens).map(Some), "EDGE_PRIOR_SE2 id x y theta and six numbers of information")
            }
            b"FIX" => (tokens.count().map(|id| Some(Constraint::Fix { id })), "FIX id"),
            _ => (None, "a graph in the plane: VERTEX_SE2, EDGE_SE2, EDGE_PRIOR_SE2 or FIX"),
        };
        let constraint = parsed
            .ok_or_else(|| Problem::new(path, format!("\"{}\"", line.escape_ascii())).at(place()).expected(expected))?;
        constraints.extend(constraint.map(|constraint| (constraint, index + 1)));
    }
    build(path, &vertices, constraints)
}

fn build(
    path: &Path,
    vertices: &BTreeMap<usize, Pose2>,
    constraints: Vec<(Constraint, usize)>,
) -> Result<PoseGraph, ReadError> {
    let mut graph = PoseGraph::default();
    let node_of: BTreeMap<usize, usize> = vertices.iter().map(|(id, pose)| (*id, graph.add_node(*pose))).collect();
    for (constraint, line) in constraints {
        let place = || format!("line {line}");
        let node = |id: usize| {
            let missing = || Problem::new(path, format!("no vertex {id}")).at(place());
            node_of.get(&id).copied().ok_or_else(missing)
        };
        let added = match constraint {
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
                graph.add_prior(PriorFactor { node, world_from_node, information: information.into() })
            }
        };
        added.map_err(|error| Problem::new(path, error.to_string()).at(place()))?;
    }
    Ok(graph)
}

fn between(tokens: &mut Tokens) -> Option<Constraint> {
    let ids = [tokens.count()?, tokens.count()?];
    Some(Constraint::Between { ids, from_from_to: pose(tokens)?, information: information(tokens)? })
}

fn prior(tokens: &mut Tokens) -> Option<Constraint> {
    let id = tokens.count()?;
    Some(Constraint::Prior { id, world_from_node: pose(tokens)?, information: information(tokens)? })
}

fn pose(tokens: &mut Tokens) -> Option<Pose2> {
    let [x, y, theta] = tokens.triple()?;
    Some(Pose2::new(x, y, theta))
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

    fn parse(text: &str) -> Result<PoseGraph, ReadError> {
        parse_g2o(Path::new("a.g2o"), text.as_bytes())
    }

    #[test]
    fn a_graph_comes_back_as_it_was_written() {
        let mut graph = parse(TRIANGLE).unwrap();
        assert_eq!(graph.poses().len(), 3);
        assert_eq!(graph.poses()[1], Pose2::new(0.5, 0.9, -2.0));
        let first = &graph.between_factors()[0];
        assert_eq!((first.from, first.to), (0, 2));
        assert_eq!((first.information[(1, 2)], first.information[(2, 1)]), (3.0, 3.0));
        assert_eq!(parse(&format_g2o(&graph)).unwrap(), graph);

        Optimizer::default().optimize(&mut graph).unwrap();
        assert!(graph.poses()[0].distance() < 1e-4);
        assert_eq!(parse(&format_g2o(&graph)).unwrap(), graph);
    }

    #[test]
    fn weights_go_into_the_information_and_what_is_switched_off_is_left_out() {
        let mut graph = parse(TRIANGLE).unwrap();
        graph.set_weight(0, 0.5);
        graph.set_weight(1, 0.0);
        let read = parse(&format_g2o(&graph)).unwrap();
        assert_eq!(read.between_factors().len(), 2);
        assert_eq!(read.between_factors()[0].information[(0, 0)], 250.0);
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        for (text, place, found) in [
            ("VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1", "line 1", "VERTEX_SE3"),
            ("VERTEX_SE2 0 0 0", "line 1", "VERTEX_SE2 0 0 0"),
            ("VERTEX_SE2 0 0 nan 0", "line 1", "nan"),
            ("VERTEX_SE2 0 0 0 0\nVERTEX_SE2 0 0 0 0", "line 2", "second time"),
            ("\nVERTEX_SE2 0 0 0 0\nEDGE_SE2 0 7 1 0 0 1 0 0 1 0 1", "line 3", "no vertex 7"),
            ("VERTEX_SE2 0 0 0 0\nEDGE_SE2 0 0 1 0 0 1 0 0 1 0 1", "line 2", "itself"),
            ("VERTEX_SE2 0 0 0 0\nEDGE_PRIOR_SE2 0 1 0 0 -1 0 0 1 0 1", "line 2", "negative"),
        ] {
            let error = parse(text).unwrap_err();
            let problem = error.problem();
            assert!(problem.place == place && problem.found.contains(found), "{problem:?}");
        }
    }
}

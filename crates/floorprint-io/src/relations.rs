//! Relations of the Freiburg SLAM benchmark: lines of `stamp stamp x y z roll pitch yaw`
//! (Kümmerle et al. 2009, "On measuring the accuracy of SLAM algorithms").

use crate::error::{Problem, ReadError, quoted};
use crate::number::Tokens;
use crate::source::read_unpacked;
use floorprint::evaluation::Relation;
use floorprint::geometry::Pose2;
use std::path::Path;

/// Reads relations, gzipped or not, projected onto the plane. Empty lines and lines beginning with `#` are skipped.
///
/// # Errors
/// When the file cannot be read, a line does not hold eight finite numbers, or there is no relation at all.
pub fn read_relations(path: &Path) -> Result<Vec<Relation>, ReadError> {
    let text = read_unpacked(path)?;
    parse_relations(path, &text)
}

fn parse_relations(path: &Path, text: &[u8]) -> Result<Vec<Relation>, ReadError> {
    let mut relations = Vec::new();
    for (index, line) in text.split(|&byte| byte == b'\n').map(<[u8]>::trim_ascii).enumerate() {
        if line.is_empty() || line.starts_with(b"#") {
            continue;
        }
        relations.push(parse_relation(line).ok_or_else(|| {
            Problem::new(path, quoted(line))
                .at(format!("line {}", index + 1))
                .expected("eight finite numbers: stamp stamp x y z roll pitch yaw")
        })?);
    }
    if relations.is_empty() {
        return Err(Problem::new(path, "the file holds no relation").into());
    }
    Ok(relations)
}

fn parse_relation(line: &[u8]) -> Option<Relation> {
    let mut tokens = Tokens::new(line);
    let (first_stamp_s, second_stamp_s) = (tokens.finite()?, tokens.finite()?);
    let [x, y, _z] = tokens.triple()?;
    let [_roll, _pitch, yaw] = tokens.triple()?;
    Some(Relation { first_stamp_s, second_stamp_s, first_from_second: Pose2::new(x, y, yaw) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn relations_are_read_and_bad_lines_named() {
        let path = Path::new("a.relations");
        let text = b"976052905.167303 976052911.885496 -0.05 -0.12 0 0 0 -1.5\r\n\n1 2 3 4 5 6 7\n";
        let relations = parse_relations(path, &text[..59]).unwrap();
        assert_eq!(relations[0].first_stamp_s, 976_052_905.167_303);
        assert_eq!(relations[0].first_from_second, Pose2::new(-0.05, -0.12, -1.5));
        assert_eq!(parse_relations(path, text).unwrap_err().problem().place, "line 3");
        assert!(parse_relations(path, b"# nothing\n").is_err());
    }
}

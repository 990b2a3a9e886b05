//! Trajectories in the TUM format: lines of `stamp x y z qx qy qz qw`.

use crate::error::{Problem, ReadError, WriteError, quoted};
use crate::number::{Tokens, push_fixed};
use crate::replace::write_file;
use crate::source::read_unpacked;
use floorprint::geometry::Pose2;
use floorprint::sensors::StampedPose;
use std::path::Path;

/// Writes a trajectory in the plane: seconds to the microsecond, metres, a unit quaternion about z.
///
/// # Errors
/// When the file cannot be written.
pub fn write_trajectory(path: &Path, trajectory: &[StampedPose]) -> Result<(), WriteError> {
    write_file(path, format_trajectory(trajectory).as_bytes())
}

/// The text of a trajectory file.
fn format_trajectory(trajectory: &[StampedPose]) -> String {
    let mut text = String::with_capacity(trajectory.len() * 80);
    for StampedPose { stamp_s, pose } in trajectory {
        let (qz, qw) = (pose.theta / 2.0).sin_cos();
        let columns = [(*stamp_s, 6, " "), (pose.x, 6, " "), (pose.y, 6, " 0 0 0 "), (qz, 9, " "), (qw, 9, "\n")];
        for (value, decimals, behind) in columns {
            push_fixed(&mut text, value, decimals);
            text.push_str(behind);
        }
    }
    text
}

/// Writes a trajectory as KITTI has them: the first three rows of each pose's matrix, `world_from_body`, without stamps.
///
/// # Errors
/// When the file cannot be written.
pub fn write_kitti(path: &Path, trajectory: &[StampedPose]) -> Result<(), WriteError> {
    let mut text = String::with_capacity(trajectory.len() * 100);
    for StampedPose { pose, .. } in trajectory {
        let (sin, cos) = pose.theta.sin_cos();
        let rows = [(cos, 9, " "), (0.0 - sin, 9, " 0 "), (pose.x, 6, " "), (sin, 9, " "), (cos, 9, " 0 ")];
        for (value, decimals, behind) in rows.into_iter().chain([(pose.y, 6, " 0 0 1 0\n")]) {
            push_fixed(&mut text, value, decimals);
            text.push_str(behind);
        }
    }
    write_file(path, text.as_bytes())
}

/// Reads a trajectory, gzipped or not, and projects it onto the plane: z, roll and pitch are left out.
///
/// Empty lines and lines beginning with `#` are skipped.
///
/// # Errors
/// When the file cannot be read, or a line does not hold eight finite numbers of which the last four are a rotation.
pub fn read_trajectory(path: &Path) -> Result<Vec<StampedPose>, ReadError> {
    let text = read_unpacked(path)?;
    parse_trajectory(path, &text)
}

fn parse_trajectory(path: &Path, text: &[u8]) -> Result<Vec<StampedPose>, ReadError> {
    let mut trajectory = Vec::new();
    for (index, line) in text.split(|&byte| byte == b'\n').map(<[u8]>::trim_ascii).enumerate() {
        if line.is_empty() || line.starts_with(b"#") {
            continue;
        }
        trajectory.push(parse_pose(line).ok_or_else(|| {
            let problem = Problem::new(path, quoted(line)).at(format!("line {}", index + 1));
            if eight_numbers(line).is_none() {
                return problem.expected("eight finite numbers: stamp x y z qx qy qz qw");
            }
            problem
                .expected("a rotation: the last four numbers are a quaternion of length 1")
                .advice("Relations of the Freiburg SLAM benchmark have eight numbers, too: floorprint evaluate relations reads them")
        })?);
    }
    Ok(trajectory)
}

fn eight_numbers(line: &[u8]) -> Option<[f64; 8]> {
    let mut tokens = Tokens::new(line);
    let stamp_s = tokens.finite()?;
    let [x, y, z] = tokens.triple()?;
    let [qx, qy, qz] = tokens.triple()?;
    Some([stamp_s, x, y, z, qx, qy, qz, tokens.finite()?])
}

fn parse_pose(line: &[u8]) -> Option<StampedPose> {
    let [stamp_s, x, y, _z, qx, qy, qz, qw] = eight_numbers(line)?;
    let theta = (2.0 * (qw * qz + qx * qy)).atan2(qw * qw + qx * qx - qy * qy - qz * qz);
    let length = (qx * qx + qy * qy + qz * qz + qw * qw).sqrt();
    // However coarsely it was written.
    (0.9..1.1).contains(&length).then(|| StampedPose { stamp_s, pose: Pose2::new(x, y, theta) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kitti_has_the_first_three_rows_of_each_pose() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trajectory.kitti");
        let pose = Pose2::new(1.5, -2.0, std::f64::consts::FRAC_PI_2);
        write_kitti(&path, &[StampedPose { stamp_s: 1.0, pose: Pose2::IDENTITY }, StampedPose { stamp_s: 2.0, pose }])
            .unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let rows: Vec<Vec<f64>> =
            text.lines().map(|line| line.split(' ').map(|number| number.parse().unwrap()).collect()).collect();
        assert_eq!(rows[0], [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        assert_eq!(rows[1], [0.0, -1.0, 0.0, 1.5, 1.0, 0.0, 0.0, -2.0, 0.0, 0.0, 1.0, 0.0]);
        assert!(!text.contains("-0.000000000"), "{text}");
    }
    use floorprint::geometry::wrap_angle;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_written_is_read_again(
            poses in proptest::collection::vec((0.0..2e9_f64, -1e4..1e4_f64, -1e4..1e4_f64, -3.1..3.1_f64), 0..20)
        ) {
            let written: Vec<_> = poses
                .iter()
                .map(|&(stamp_s, x, y, theta)| StampedPose { stamp_s, pose: Pose2::new(x, y, theta) })
                .collect();
            let read = parse_trajectory(Path::new("t.tum"), format_trajectory(&written).as_bytes()).unwrap();
            prop_assert_eq!(read.len(), written.len());
            for (a, b) in read.iter().zip(&written) {
                prop_assert!((a.stamp_s - b.stamp_s).abs() < 1e-6);
                prop_assert!(a.pose.between(&b.pose).distance() < 2e-6);
                prop_assert!(wrap_angle(a.pose.theta - b.pose.theta).abs() < 1e-8);
            }
        }

        #[test]
        fn any_bytes_are_a_trajectory_or_an_error(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            let _ = parse_trajectory(Path::new("t.tum"), &bytes);
        }
    }

    /// Their eight numbers were taken for a trajectory with errors of 10⁹ m.
    #[test]
    fn relations_are_no_trajectory() {
        let relation = b"976052905.167303 976052911.885496 -0.05 -0.12 0 0 0 -1.68\n";
        let error = parse_trajectory(Path::new("a.relations"), relation).unwrap_err();
        assert!(error.to_string().contains("evaluate relations"), "{error}");
        assert_eq!(parse_trajectory(Path::new("t.tum"), b"1 2 3 0 0 0 0.71 0.71\n").unwrap().len(), 1);
    }

    #[test]
    fn gzipped_trajectories_are_read_and_damaged_ones_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("truth.tum.gz");
        let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        std::io::Write::write_all(&mut packed, b"1 2 3 0 0 0 0 1\n2 2 3 0 0 0 0 1\n").unwrap();
        let packed = packed.finish().unwrap();
        std::fs::write(&path, &packed).unwrap();
        assert_eq!(read_trajectory(&path).unwrap().len(), 2);
        std::fs::write(&path, &packed[..packed.len() - 12]).unwrap();
        assert!(read_trajectory(&path).unwrap_err().to_string().contains("cut off"));
    }

    #[test]
    fn a_bad_line_is_named() {
        let error = parse_trajectory(Path::new("t.tum"), b"# x\n1 2 3 0 0 0 0 1\n1 2 nan 0 0 0 0 1\n").unwrap_err();
        assert_eq!(error.problem().place, "line 3");
        let long = [b"1 2 3 ".as_slice(), &[b'x'; 1000]].concat();
        let error = parse_trajectory(Path::new("t.tum"), &long).unwrap_err();
        assert!(error.to_string().len() < 200, "{error}");
    }
}

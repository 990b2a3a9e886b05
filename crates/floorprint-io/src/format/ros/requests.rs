//! What services are asked for, taken out of CDR.

use super::cursor::Cursor;
use floorprint::geometry::{Pose2, Pose3};

/// The text that a request consists of (`string filename`, or `std_msgs/String`); `None` of anything else.
#[must_use]
pub fn text_of(cdr: &[u8]) -> Option<String> {
    Cursor::cdr(cdr)?.text().map(str::to_owned)
}

/// The truth value that a request consists of; `None` of anything else.
#[must_use]
pub fn truth_of(cdr: &[u8]) -> Option<bool> {
    Cursor::cdr(cdr)?.u8().map(|value| value != 0)
}

/// A `slam_toolbox/srv/DeserializePoseGraph`.
#[derive(Debug, Clone, PartialEq)]
pub struct DeserializeRequest {
    /// The file's name.
    pub name: String,
    /// 1 to start at the first node, 2 at the pose, 3 to localise from there.
    pub match_type: u8,
    /// `map_from_body`.
    pub pose: Pose2,
}

impl DeserializeRequest {
    /// Takes it apart. The pose is a `Pose2D` up to Jazzy and a `Pose` later, which are told apart by their length.
    #[must_use]
    pub fn of(cdr: &[u8]) -> Option<Self> {
        let mut cursor = Cursor::cdr(cdr)?;
        let (name, match_type) = (cursor.text()?.to_owned(), cursor.u8()?);
        let [x, y, third] = cursor.f64s()?;
        let pose = match cursor.f64s::<4>() {
            Some(quaternion) => Pose3::from_quaternion([x, y, third], quaternion).in_plane(),
            None => Pose2::new(x, y, third),
        };
        pose.is_finite().then_some(Self { name, match_type, pose })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poses_are_flat_or_not() {
        // A text of four bytes and a NUL, the type, and padding up to where numbers of 64 bits may lie.
        let mut cdr = vec![0, 1, 0, 0, 5, 0, 0, 0];
        cdr.extend(b"site\0\x02");
        cdr.resize(4 + 16, 0);
        let number = |cdr: &mut Vec<u8>, value: f64| cdr.extend(value.to_le_bytes());
        let mut flat = cdr.clone();
        [1.0, -2.0, 0.5].into_iter().for_each(|value| number(&mut flat, value));
        let expected = DeserializeRequest { name: "site".to_owned(), match_type: 2, pose: Pose2::new(1.0, -2.0, 0.5) };
        assert_eq!(DeserializeRequest::of(&flat), Some(expected));
        let mut in_space = cdr.clone();
        [1.0, -2.0, 7.0, 0.0, 0.0, 0.25_f64.sin(), 0.25_f64.cos()]
            .into_iter()
            .for_each(|value| number(&mut in_space, value));
        let found = DeserializeRequest::of(&in_space).unwrap();
        assert!((found.pose.theta - 0.5).abs() < 1e-12 && (found.pose.x, found.pose.y) == (1.0, -2.0), "{found:?}");
        assert_eq!(DeserializeRequest::of(&flat[..flat.len() - 1]), None);
        assert_eq!(DeserializeRequest::of(&[]), None);
    }
}

//! The course ECE276A's layout: a folder with `EncodersN.npz`, `HokuyoN.npz`, `ImuN.npz`, `KinectN.npz`
//! and the Kinect's images, where N is the number of the drive.
//!
//! Images lie in `dataRGBD/RGBN/rgbN_i.png` and `dataRGBD/DisparityN/disparityN_i.png`, or without
//! either folder; image i, from 1, was taken at the i-th stamp. Every part may be missing.

use super::Format;
use crate::calibration;
use crate::data_set::{DataSet, DropCounts, DropReason, OpenOptions};
use crate::error::{Problem, ReadError};
use crate::images::{ImageEntry, ImageIndex};
use crate::npz::Npz;
use crate::source::{FolderSource, InputHash, Source, folder_names};
use crate::stamps::rising;
use floorprint::sensors::{EncoderReading, ImuReading, Record, Scan, ScanGeometry};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

pub(super) const FORMAT: Format = Format {
    name: "ece276a",
    description: "a folder with EncodersN.npz, HokuyoN.npz, ImuN.npz, KinectN.npz",
    recognises,
    read,
};

/// Standard gravity, m/s²: the IMU's unit of acceleration.
const GRAVITY_M_S2: f64 = 9.80665;

fn recognises(source: &Source) -> bool {
    matches!(source, Source::Folder(folder) if !drives(folder).is_empty())
}

/// The four archives of a drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Part {
    Encoders,
    Hokuyo,
    Imu,
    Kinect,
}

impl Part {
    const ALL: [Self; 4] = [Self::Encoders, Self::Hokuyo, Self::Imu, Self::Kinect];

    fn stem(self) -> &'static str {
        match self {
            Self::Encoders => "encoders",
            Self::Hokuyo => "hokuyo",
            Self::Imu => "imu",
            Self::Kinect => "kinect",
        }
    }

    /// What a drive without this part cannot give.
    fn loss(self) -> &'static str {
        match self {
            Self::Encoders => "no encoders: the motion between scans comes from matching them",
            Self::Hokuyo => "no Hokuyo: there are no scans, so no map can be made",
            Self::Imu => "no IMU: yaw comes from the wheels",
            Self::Kinect => "no Kinect: the floor cannot be painted",
        }
    }
}

/// The archives in a folder, by drive and part.
fn drives(folder: &FolderSource) -> BTreeMap<u32, BTreeMap<Part, PathBuf>> {
    let mut drives: BTreeMap<u32, BTreeMap<Part, PathBuf>> = BTreeMap::new();
    for name in &folder.names {
        let lower = name.to_ascii_lowercase();
        let found = Part::ALL.into_iter().find_map(|part| {
            let number = lower.strip_prefix(part.stem())?.strip_suffix(".npz")?;
            Some((number.parse().ok()?, part))
        });
        if let Some((drive, part)) = found {
            drives.entry(drive).or_default().insert(part, folder.path.join(name));
        }
    }
    drives
}

fn read(source: &Source, options: &OpenOptions) -> Result<DataSet, ReadError> {
    let Source::Folder(folder) = source else {
        return Err(Problem::new(source.path(), "a file").expected(FORMAT.description).into());
    };
    let mut drives = drives(folder);
    let present: Vec<String> = drives.keys().map(u32::to_string).collect();
    let (drive, parts) = match options.drive {
        Some(drive) => drives.remove_entry(&drive).ok_or_else(|| {
            Problem::new(&folder.path, format!("there is no drive {drive}"))
                .expected(format!("one of the drives {}", present.join(", ")))
        })?,
        None if drives.len() > 1 => {
            return Err(Problem::new(&folder.path, format!("it holds the drives {}", present.join(", ")))
                .expected("a single drive")
                .advice(format!("Choose one with --drive {}", present[0]))
                .into());
        }
        None => drives.pop_first().ok_or_else(|| Problem::new(&folder.path, "it holds no drive"))?,
    };
    Drive::default().read(&folder.path, drive, &parts)
}

/// What has been read of a drive so far.
#[derive(Default)]
struct Drive {
    records: Vec<Record>,
    dropped: DropCounts,
    notes: Vec<String>,
    hash: InputHash,
}

impl Drive {
    fn read(mut self, folder: &Path, number: u32, parts: &BTreeMap<Part, PathBuf>) -> Result<DataSet, ReadError> {
        let mut robot = calibration::ece276a();
        let mut images = None;
        for part in Part::ALL {
            let Some(path) = parts.get(&part) else {
                self.notes.push(part.loss().to_owned());
                continue;
            };
            let bytes = fs::read(path).map_err(|error| ReadError::io(path, &error))?;
            self.hash.add_content(path, &bytes);
            let mut npz = Npz::new(path, &bytes)?;
            match part {
                Part::Encoders => self.read_encoders(&mut npz)?,
                Part::Hokuyo => self.read_hokuyo(&mut npz)?,
                Part::Imu => self.read_imu(&mut npz)?,
                Part::Kinect => images = self.read_kinect(&mut npz, folder, number)?,
            }
        }
        if !parts.contains_key(&Part::Encoders) {
            robot.wheels = None;
        }
        if images.is_none() {
            robot.camera = None;
        }
        // Stable: at equal stamps what moved comes before what was seen.
        self.records.sort_by(|a, b| a.stamp_s().total_cmp(&b.stamp_s()));
        Ok(DataSet {
            format: FORMAT,
            robot,
            records: self.records,
            images,
            dropped: self.dropped,
            notes: self.notes,
            input_hash: self.hash.finish(),
        })
    }

    /// Counts of the four wheels since the previous reading. The ticks of a reading whose stamp is
    /// unusable are added to the next one, so that no distance is lost.
    fn read_encoders(&mut self, npz: &mut Npz) -> Result<(), ReadError> {
        let stamps_s = npz.vector("time_stamps")?;
        let counts = npz.columns::<f64>("counts", Some(4), stamps_s.len())?;
        let keep = rising(&stamps_s, false);
        let (mut left_ticks, mut right_ticks) = (0.0, 0.0);
        for ((&stamp_s, counts), keep) in stamps_s.iter().zip(&counts).zip(keep) {
            if let &[front_right, front_left, rear_right, rear_left] = &counts[..]
                && counts.iter().all(|count| count.is_finite())
            {
                left_ticks += (front_left + rear_left) / 2.0;
                right_ticks += (front_right + rear_right) / 2.0;
            } else {
                self.dropped.add(DropReason::NotFinite);
                continue;
            }
            if keep {
                self.records.push(Record::Encoders(EncoderReading { stamp_s, left_ticks, right_ticks }));
                (left_ticks, right_ticks) = (0.0, 0.0);
            } else {
                self.dropped.add(DropReason::StampJump);
            }
        }
        Ok(())
    }

    fn read_imu(&mut self, npz: &mut Npz) -> Result<(), ReadError> {
        let stamps_s = npz.vector("time_stamps")?;
        let angular = npz.columns::<f64>("angular_velocity", Some(3), stamps_s.len())?;
        let linear = npz.columns::<f64>("linear_acceleration", Some(3), stamps_s.len())?;
        let keep = rising(&stamps_s, true);
        for (((&stamp_s, angular), linear), keep) in stamps_s.iter().zip(&angular).zip(&linear).zip(keep) {
            let (&[wx, wy, wz], &[ax, ay, az]) = (&angular[..], &linear[..]) else { continue };
            if !keep {
                self.dropped.add(DropReason::StampJump);
            } else if [wx, wy, wz, ax, ay, az].iter().all(|value| value.is_finite()) {
                self.records.push(Record::Imu(ImuReading {
                    stamp_s,
                    angular_velocity_rad_s: [wx, wy, wz],
                    linear_acceleration_m_s2: [ax, ay, az].map(|acceleration_g| acceleration_g * GRAVITY_M_S2),
                }));
            } else {
                self.dropped.add(DropReason::NotFinite);
            }
        }
        Ok(())
    }

    fn read_hokuyo(&mut self, npz: &mut Npz) -> Result<(), ReadError> {
        let stamps_s = npz.vector("time_stamps")?;
        let scans = npz.columns::<f32>("ranges", None, stamps_s.len())?;
        let rays = scans.first().map_or(0, Vec::len);
        let geometry = Arc::new(read_geometry(npz, rays)?);
        let keep = rising(&stamps_s, true);
        for ((&stamp_s, ranges_m), keep) in stamps_s.iter().zip(scans).zip(keep) {
            if keep {
                let geometry = Arc::clone(&geometry);
                self.records.push(Record::Scan(Scan { stamp_s, ranges_m, geometry, odometry: None }));
            } else {
                self.dropped.add(DropReason::StampJump);
            }
        }
        Ok(())
    }

    /// Finds the images that belong to the Kinect's stamps; none when there is not a single one.
    fn read_kinect(&mut self, npz: &mut Npz, folder: &Path, drive: u32) -> Result<Option<ImageIndex>, ReadError> {
        let disparity_stamps_s = npz.vector("disparity_time_stamps")?;
        let color_stamps_s = npz.vector("rgb_time_stamps")?;
        let index = ImageIndex {
            disparity: self.find_images(folder, "Disparity", drive, &disparity_stamps_s)?,
            color: self.find_images(folder, "RGB", drive, &color_stamps_s)?,
        };
        if index.disparity.is_empty() || index.color.is_empty() {
            self.notes.push("no images of the Kinect beside its stamps: the floor cannot be painted".to_owned());
            return Ok(None);
        }
        Ok(Some(index))
    }

    /// The images of one kind that exist, by time.
    fn find_images(
        &mut self,
        folder: &Path,
        kind: &str,
        drive: u32,
        stamps_s: &[f64],
    ) -> Result<Vec<ImageEntry>, ReadError> {
        let own = format!("{kind}{drive}");
        let places =
            [folder.join("dataRGBD").join(&own), folder.join(&own), folder.join("dataRGBD"), folder.to_path_buf()];
        let mut entries = Vec::new();
        let keep = rising(stamps_s, false);
        let listings: Vec<(&PathBuf, BTreeSet<String>)> = places
            .iter()
            .filter(|place| place.is_dir())
            .map(|place| Ok((place, folder_names(place).map_err(|error| ReadError::io(place, &error))?)))
            .collect::<Result<_, ReadError>>()?;
        for (index, (&stamp_s, keep)) in stamps_s.iter().zip(keep).enumerate() {
            let name = format!("{}{drive}_{}.png", kind.to_ascii_lowercase(), index + 1);
            match listings.iter().find(|(_, names)| names.contains(&name)) {
                None => self.dropped.add(DropReason::MissingImage),
                Some(_) if !keep => self.dropped.add(DropReason::StampJump),
                Some((place, _)) => entries.push(ImageEntry { stamp_s, path: place.join(name) }),
            }
        }
        for entry in &entries {
            self.hash.add_size(&entry.path).map_err(|error| ReadError::io(&entry.path, &error))?;
        }
        Ok(entries)
    }
}

/// Angles and limits of the rays; their times follow from the calibration's sweep.
fn read_geometry(npz: &mut Npz, rays: usize) -> Result<ScanGeometry, ReadError> {
    let angle_min_rad = npz.scalar("angle_min")?;
    let angle_step_rad = npz.scalar("angle_increment")?;
    let (range_min_m, range_max_m) = (npz.scalar("range_min")?, npz.scalar("range_max")?);
    Ok(ScanGeometry {
        angles_rad: (0..rays).map(|ray| angle_min_rad + ray as f64 * angle_step_rad).collect(),
        time_offsets_s: vec![0.0; rays],
        range_min_m: range_min_m as f32,
        range_max_m: range_max_m as f32,
        // Hokuyo's drivers write a range of about nothing where nothing came back.
        below_minimum_is_no_return: true,
    })
}

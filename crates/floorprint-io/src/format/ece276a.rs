//! The course ECE276A's layout: a folder with `EncodersN.npz`, `HokuyoN.npz`, `ImuN.npz`, `KinectN.npz`
//! and the Kinect's images, where N is the number of the drive.
//!
//! Images lie in `dataRGBD/RGBN/rgbN_i.png` and `dataRGBD/DisparityN/disparityN_i.png`, or without
//! either folder; image i, from 1, was taken at the i-th stamp. Every part may be missing.
//!
//! As the course hands them out the archives lie in `data` and the images beside it; the path may lead to either of the two,
//! or to the folder above. Case does not matter, and neither do numbers where there is but one drive.

use super::Format;
use crate::data_set::{DataSet, DriveEntry, DropCounts, DropReason, OpenOptions};
use crate::error::{Problem, ReadError};
use crate::images::{ImageEntry, ImageIndex};
use crate::npz::{Npz, problem};
use crate::regular_file::read_regular;
use crate::source::{FolderSource, InputHash, Source, folder_names};
use crate::stamps::rising;
use floorprint::SensorId;
use floorprint::sensors::{EncoderReading, ImuReading, Record, RobotConfig, Scan, ScanGeometry};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

pub(super) const FORMAT: Format = Format {
    name: "ece276a",
    description: "a folder with EncodersN.npz, HokuyoN.npz, ImuN.npz, KinectN.npz",
    scans: "a HokuyoN.npz",
    has_topics: false,
    recognises,
    read,
};

/// Standard gravity, m/s²: the IMU's unit of acceleration.
const GRAVITY_M_S2: f64 = 9.80665;

fn recognises(source: &Source) -> bool {
    matches!(source, Source::Folder(folder) if !places(folder).is_empty())
}

/// A folder with archives, and the drives that they are of.
struct Place {
    folder: PathBuf,
    drives: BTreeMap<u32, BTreeMap<Part, PathBuf>>,
}

/// The folder itself where it holds archives; else those of its folders that do.
fn places(folder: &FolderSource) -> Vec<Place> {
    let place = |path: PathBuf, names: &BTreeSet<String>| {
        let drives = drives(&path, names);
        (!drives.is_empty()).then_some(Place { folder: path, drives })
    };
    if let Some(own) = place(folder.path.clone(), &folder.names) {
        return vec![own];
    }
    let below = folder.names.iter().map(|name| folder.path.join(name)).filter(|path| path.is_dir());
    below.filter_map(|path| folder_names(&path).ok().and_then(|names| place(path, &names))).collect()
}

/// The four archives of a drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Part {
    Encoders,
    Imu,
    Hokuyo,
    Kinect,
}

impl Part {
    /// In the order in which they are read; at equal stamps what moved comes before what was seen.
    const ALL: [Self; 4] = [Self::Encoders, Self::Imu, Self::Hokuyo, Self::Kinect];

    fn stem(self) -> &'static str {
        match self {
            Self::Encoders => "encoders",
            Self::Hokuyo => "hokuyo",
            Self::Imu => "imu",
            Self::Kinect => "kinect",
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Encoders => "encoders",
            Self::Hokuyo => "Hokuyo",
            Self::Imu => "IMU",
            Self::Kinect => "Kinect",
        }
    }

    /// What a drive without this part cannot give.
    fn loss(self, present: &BTreeMap<Self, PathBuf>) -> &'static str {
        match self {
            Self::Imu if !present.contains_key(&Self::Encoders) => "no IMU",
            Self::Encoders if !present.contains_key(&Self::Hokuyo) => "no encoders",
            Self::Hokuyo if !present.contains_key(&Self::Encoders) => "no Hokuyo: there is no LiDAR and so no map",
            Self::Encoders => "no encoders: the motion between scans comes from matching them",
            Self::Hokuyo => "no Hokuyo: there is no LiDAR and so no map, only dead reckoning",
            Self::Imu => "no IMU: yaw comes from the wheels",
            Self::Kinect => "no Kinect: the floor cannot be painted",
        }
    }
}

/// The archives in a folder, by drive and part. Those without a number are of drive 0.
fn drives(folder: &Path, names: &BTreeSet<String>) -> BTreeMap<u32, BTreeMap<Part, PathBuf>> {
    let mut drives: BTreeMap<u32, BTreeMap<Part, PathBuf>> = BTreeMap::new();
    for name in names {
        let lower = name.to_ascii_lowercase();
        let found = Part::ALL.into_iter().find_map(|part| {
            let number = lower.strip_prefix(part.stem())?.strip_suffix(".npz")?;
            Some((if number.is_empty() { 0 } else { number.parse().ok()? }, part))
        });
        if let Some((drive, part)) = found {
            drives.entry(drive).or_default().insert(part, folder.join(name));
        }
    }
    drives
}

/// The drives in a folder, with what there is of each.
pub(super) fn drive_entries(folder: &FolderSource) -> Vec<DriveEntry> {
    let places = places(folder);
    let path = |place: &Place| if places.len() == 1 { folder.path.clone() } else { place.folder.clone() };
    let entry = |place: &Place, drive: u32, parts: &BTreeMap<Part, PathBuf>| {
        let names: Vec<&str> = parts.keys().map(|part| part.name()).collect();
        let drive = (place.drives.len() > 1).then_some(drive);
        DriveEntry { path: path(place), drive, holds: names.join(", ") }
    };
    let entries = |place: &Place| -> Vec<DriveEntry> {
        place.drives.iter().map(|(&drive, parts)| entry(place, drive, parts)).collect()
    };
    places.iter().flat_map(entries).collect()
}

fn read(source: &Source, options: &OpenOptions) -> Result<DataSet, ReadError> {
    let Source::Folder(folder) = source else {
        return Err(Problem::new(source.path(), "a file").expected(FORMAT.description).into());
    };
    let mut places = places(folder);
    if places.len() > 1 {
        let list: Vec<String> = places.iter().map(|place| place.folder.display().to_string()).collect();
        return Err(Problem::new(&folder.path, format!("several of its folders hold drives: {}", list.join(", ")))
            .expected("a single one")
            .advice("Name one of them")
            .into());
    }
    let Some(Place { folder: place, mut drives }) = places.pop() else {
        return Err(Problem::new(&folder.path, "it holds no drive").into());
    };
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
    Drive { max_expansion: options.max_expansion, ..Drive::default() }.read(&place, drive, &parts)
}

/// What has been read of a drive so far.
#[derive(Default)]
struct Drive {
    records: Vec<Record>,
    dropped: DropCounts,
    notes: Vec<String>,
    hash: InputHash,
    /// How many times its size on disk a file may take in memory.
    max_expansion: f64,
}

impl Drive {
    fn read(mut self, folder: &Path, number: u32, parts: &BTreeMap<Part, PathBuf>) -> Result<DataSet, ReadError> {
        let mut robot = RobotConfig::ece276a();
        let mut images = None;
        for part in Part::ALL {
            let Some(path) = parts.get(&part) else {
                self.notes.push(part.loss(parts).to_owned());
                continue;
            };
            let bytes = read_regular(path)?;
            self.hash.add_content(path, &bytes);
            let mut npz = Npz::new(path, &bytes, self.max_expansion)?;
            if npz.is_cut_off() {
                let name = path.file_name().unwrap_or_default().to_string_lossy();
                self.notes.push(format!("{name} was cut off: what is missing at its end counts as not measured"));
            }
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
        // A stable sort: it keeps the order of the parts at equal stamps.
        self.records.sort_by(|a, b| a.stamp_s().total_cmp(&b.stamp_s()));
        Ok(DataSet {
            format: FORMAT,
            robot,
            records: self.records,
            images,
            dropped: self.dropped,
            notes: self.notes,
            input_hash: self.hash.finish(),
            bag: None,
            live: None,
            unpacked: None,
        })
    }

    /// Counts of the four wheels since the previous reading. The ticks of a reading whose stamp is
    /// unusable are added to the next one, so that no distance is lost.
    fn read_encoders(&mut self, npz: &mut Npz) -> Result<(), ReadError> {
        let stamps_s = npz.vector("time_stamps")?;
        npz.take::<(Vec<f64>, Vec<f64>, Record)>(stamps_s.len())?;
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
        npz.take::<(Vec<f64>, Vec<f64>, Record)>(stamps_s.len())?;
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
        npz.take::<(Vec<f64>, Vec<f64>, Record)>(stamps_s.len())?;
        let scans = npz.columns::<f32>("ranges", None, stamps_s.len())?;
        let rays = scans.first().map_or(0, Vec::len);
        let geometry = Arc::new(read_geometry(npz, rays)?);
        let keep = rising(&stamps_s, true);
        for ((&stamp_s, ranges_m), keep) in stamps_s.iter().zip(scans).zip(keep) {
            if keep {
                let geometry = Arc::clone(&geometry);
                self.records.push(Record::Scan(Scan {
                    sensor: SensorId::default(),
                    stamp_s,
                    ranges_m,
                    geometry,
                    odometry: None,
                }));
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
            depth: self.find_images(folder, "Disparity", drive, &disparity_stamps_s)?,
            color: self.find_images(folder, "RGB", drive, &color_stamps_s)?,
            recorded: None,
        };
        if index.depth.is_empty() || index.color.is_empty() {
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
        let number = if drive == 0 { String::new() } else { drive.to_string() };
        let mut entries = Vec::new();
        let keep = rising(stamps_s, false);
        let listings = image_folders(folder, &format!("{kind}{number}"))?;
        for (index, (&stamp_s, keep)) in stamps_s.iter().zip(keep).enumerate() {
            let name = format!("{}{number}_{}.png", kind.to_ascii_lowercase(), index + 1);
            match listings.iter().find_map(|(place, names)| Some(place.join(names.get(&name)?))) {
                None => self.dropped.add(DropReason::MissingImage),
                Some(_) if !keep => self.dropped.add(DropReason::StampJump),
                Some(path) => {
                    self.hash.add_size(&path).map_err(|error| ReadError::io(&path, &error))?;
                    entries.push(ImageEntry::in_file(stamp_s, path, self.max_expansion));
                }
            }
        }
        Ok(entries)
    }
}

/// A folder with what is in it: names in lower case, and as they are.
type Listing = (PathBuf, BTreeMap<String, String>);

/// The folders in which images of a kind may lie: beside the archives, below, and beside their folder.
fn image_folders(archives: &Path, own: &str) -> Result<Vec<Listing>, ReadError> {
    let refused = |path: &Path| {
        let path = path.to_path_buf();
        move |error: std::io::Error| ReadError::io(&path, &error)
    };
    let list = |path: PathBuf| -> Result<Listing, ReadError> {
        let names = folder_names(&path).map_err(refused(&path))?;
        Ok((path, names.into_iter().map(|name| (name.to_ascii_lowercase(), name)).collect()))
    };
    // The folder above may hold anything, even thousands of drives: only the one for images counts there.
    let above = archives.canonicalize().map_err(refused(archives))?.parent().map(Path::to_path_buf);
    let mut around = vec![list(archives.to_path_buf())?];
    around.extend(above.filter(|above| above.is_dir()).and_then(|above| list(above).ok()));
    let mut found = Vec::new();
    for (index, (path, names)) in around.into_iter().enumerate() {
        let below =
            |name: &str| names.get(&name.to_ascii_lowercase()).map(|name| path.join(name)).filter(|at| at.is_dir());
        for folder in [below("dataRGBD"), Some(path.clone()).filter(|_| index == 0)].into_iter().flatten() {
            let folder = list(folder)?;
            let inner = folder.1.get(&own.to_ascii_lowercase()).map(|name| folder.0.join(name));
            if let Some(inner) = inner.filter(|inner| inner.is_dir()) {
                found.push(list(inner)?);
            }
            found.push(folder);
        }
    }
    Ok(found)
}

/// Angles and limits of the rays; their times follow from the calibration's sweep.
fn read_geometry(npz: &mut Npz, rays: usize) -> Result<ScanGeometry, ReadError> {
    let angle_min_rad = npz.scalar("angle_min")?;
    let angle_step_rad = npz.scalar("angle_increment")?;
    let (range_min_m, range_max_m) = (npz.scalar("range_min")?, npz.scalar("range_max")?);
    let problem = |name, found: f64, expected| problem(npz.path(), name, found.to_string(), expected);
    if !angle_min_rad.is_finite() {
        return Err(problem("angle_min", angle_min_rad, "an angle in radians").into());
    }
    if !angle_step_rad.is_finite() || angle_step_rad == 0.0 {
        return Err(problem("angle_increment", angle_step_rad, "an angle in radians, not 0").into());
    }
    if range_max_m.is_nan() || range_max_m <= range_min_m {
        return Err(problem("range_max", range_max_m, "a range beyond range_min").into());
    }
    Ok(ScanGeometry {
        angles_rad: (0..rays).map(|ray| angle_min_rad + ray as f64 * angle_step_rad).collect(),
        time_offsets_s: vec![0.0; rays],
        range_min_m: range_min_m as f32,
        range_max_m: range_max_m as f32,
        // Hokuyo's drivers write a range of about nothing where nothing came back.
        below_minimum_is_no_return: true,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::budget::USUAL_EXPANSION;
    use crate::npy::tests::npy;
    use proptest::prelude::*;
    use std::fs;
    use std::io::{Cursor, Write};
    use zip::write::SimpleFileOptions;
    use zip::{CompressionMethod, ZipWriter};

    type Arrays<'a> = &'a [(&'a str, Vec<u8>)];

    fn npz(arrays: Arrays, method: CompressionMethod) -> Vec<u8> {
        let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
        for (name, array) in arrays {
            archive.start_file(format!("{name}.npy"), SimpleFileOptions::default().compression_method(method)).unwrap();
            archive.write_all(array).unwrap();
        }
        archive.finish().unwrap().into_inner()
    }

    fn doubles(shape: &str, values: &[f64]) -> Vec<u8> {
        npy("<f8", false, shape, &values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<_>>())
    }

    /// A drive of three readings of each sensor.
    fn hokuyo(stamps_s: [f64; 3]) -> Vec<(&'static str, Vec<u8>)> {
        vec![
            ("angle_min", doubles("()", &[-1.0])),
            ("angle_increment", doubles("(1, 1)", &[0.5])),
            ("range_min", doubles("(1,)", &[0.1])),
            ("range_max", doubles("()", &[30.0])),
            ("ranges", doubles("(2, 3)", &[1.0, 2.0, 3.0, 10.0, 20.0, f64::NAN])),
            ("time_stamps", doubles("(1, 3)", &stamps_s)),
        ]
    }

    fn encoders(stamps_s: &[f64]) -> Vec<(&'static str, Vec<u8>)> {
        let counts: Vec<u8> = (0..4).flat_map(|_| 1..=stamps_s.len() as u8).collect();
        let shape = format!("(4, {})", stamps_s.len());
        vec![
            ("counts", npy("|i1", false, &shape, &counts)),
            ("time_stamps", doubles(&format!("({},)", stamps_s.len()), stamps_s)),
        ]
    }

    fn folder(files: &[(&str, Vec<u8>)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for (name, bytes) in files {
            fs::write(folder.path().join(name), bytes).unwrap();
        }
        folder
    }

    fn open(folder: &tempfile::TempDir) -> Result<DataSet, ReadError> {
        crate::open(folder.path(), &OpenOptions::default())
    }

    #[test]
    fn a_drive_may_lie_flat_in_its_folder_stored_or_deflated() {
        let kinect =
            [("disparity_time_stamps", doubles("(2,)", &[1.0, 2.0])), ("rgb_time_stamps", doubles("(1,)", &[1.5]))];
        for method in [CompressionMethod::Stored, CompressionMethod::Deflated] {
            let drive = open(&folder(&[
                ("Hokuyo7.npz", npz(&hokuyo([1.0, 2.0, 3.0]), method)),
                ("Encoders7.npz", npz(&encoders(&[1.0, 2.0]), method)),
                ("Kinect7.npz", npz(&kinect, method)),
                ("disparity7_2.png", vec![]),
                ("rgb7_1.png", vec![]),
            ]))
            .unwrap();
            let scans: Vec<_> = drive.scans().collect();
            assert_eq!(scans[1].ranges_m, [2.0, 20.0]);
            assert_eq!(scans[0].geometry.angles_rad, [-1.0, -0.5]);
            assert!(matches!(drive.records[0], Record::Encoders(_)) && matches!(drive.records[1], Record::Scan(_)));
            let images = drive.images.unwrap();
            assert_eq!((images.depth[0].stamp_s, images.color[0].stamp_s), (2.0, 1.5));
            assert!(images.depth[0].load_depth().is_err() && images.color[0].load_color().is_err());
            assert_eq!(drive.dropped.count(DropReason::MissingImage), 1);
            assert_eq!(drive.notes, ["no IMU: yaw comes from the wheels"]);
        }
    }

    #[test]
    fn every_shape_in_which_the_course_hands_out_its_data_is_read() {
        let kinect = [("disparity_time_stamps", doubles("(1,)", &[1.0])), ("rgb_time_stamps", doubles("(1,)", &[1.5]))];
        let stored = |arrays: Arrays| npz(arrays, CompressionMethod::Stored);
        for (number, archives, images) in [
            ("7", "data", "dataRGBD/Disparity7"),
            ("7", "data", "dataRGBD"),
            ("7", "Data", "datargbd/disparity7"),
            ("", "data", "data"),
        ] {
            let course = tempfile::tempdir().unwrap();
            let at = |name: String| course.path().join(name);
            fs::create_dir_all(at(archives.to_owned())).unwrap();
            let colors = images.replace("isparity7", "").replace("/D", "/RGB7").replace("/d", "/rgb7");
            fs::create_dir_all(at(images.to_owned())).unwrap();
            fs::create_dir_all(at(colors.clone())).unwrap();
            fs::write(at(format!("{archives}/hokuyo{number}.npz")), stored(&hokuyo([1.0, 2.0, 3.0]))).unwrap();
            fs::write(at(format!("{archives}/Kinect{number}.npz")), stored(&kinect)).unwrap();
            fs::write(at(format!("{images}/Disparity{number}_1.png")), []).unwrap();
            fs::write(at(format!("{colors}/rgb{number}_1.png")), []).unwrap();
            for path in [at(archives.to_owned()), course.path().to_path_buf()] {
                let drive = crate::open(&path, &OpenOptions::default()).unwrap();
                assert_eq!(drive.scans().count(), 3);
                let images = drive.images.expect(images);
                assert_eq!((images.depth.len(), images.color.len()), (1, 1), "{path:?}");
            }
            // Two such folders are not guessed between.
            fs::create_dir(at("other".to_owned())).unwrap();
            fs::write(at("other/Hokuyo7.npz".to_owned()), stored(&hokuyo([1.0, 2.0, 3.0]))).unwrap();
            let error = crate::open(course.path(), &OpenOptions::default()).unwrap_err().to_string();
            assert!(error.contains("several of its folders") && error.contains("other"), "{error}");
        }
    }

    #[test]
    fn ticks_survive_stamps_that_do_not() {
        let stamps_s = [1.0, f64::NAN, 3.0, 900.0, 0.5, 4.0, 4.0];
        let drive = open(&folder(&[("encoders1.npz", npz(&encoders(&stamps_s), CompressionMethod::Stored))])).unwrap();
        let ticks: Vec<_> = drive
            .records
            .iter()
            .map(|record| match record {
                Record::Encoders(reading) => (reading.stamp_s, reading.left_ticks, reading.right_ticks),
                other => panic!("{other:?}"),
            })
            .collect();
        assert_eq!(ticks, [(1.0, 1.0, 1.0), (3.0, 5.0, 5.0), (4.0, 15.0, 15.0), (4.0, 7.0, 7.0)]);
        assert_eq!(drive.dropped.count(DropReason::StampJump), 3);
    }

    #[test]
    fn what_does_not_fit_is_named() {
        let with = |name: &'static str, array: Vec<u8>| {
            let mut arrays = hokuyo([1.0, 2.0, 3.0]);
            arrays.retain(|(other, _)| *other != name);
            arrays.extend((!array.is_empty()).then_some((name, array)));
            open(&folder(&[("Hokuyo1.npz", npz(&arrays, CompressionMethod::Deflated))])).unwrap_err().to_string()
        };
        assert!(with("time_stamps", doubles("(2,)", &[1.0, 2.0])).contains("array ranges"));
        assert!(with("ranges", doubles("(3, 2)", &[1.0; 6])).contains("(rays, 3)"));
        assert!(with("ranges", vec![]).contains("expected an array called ranges"));
        assert!(with("angle_increment", doubles("()", &[0.0])).contains("angle_increment"));
        assert!(with("range_max", doubles("()", &[f64::NAN])).contains("range_max"));
        assert!(with("angle_min", doubles("(2,)", &[0.0; 2])).contains("a single number"));
    }

    #[test]
    fn an_archive_that_was_cut_off_is_used_as_far_as_it_goes() {
        let scans = 50;
        let mut arrays = hokuyo([1.0, 2.0, 3.0]);
        arrays.retain(|(name, _)| !["ranges", "time_stamps"].contains(name));
        let stamps_s: Vec<f64> = (0..scans).map(f64::from).collect();
        arrays.push(("time_stamps", doubles(&format!("({scans},)"), &stamps_s)));
        let ranges: Vec<u8> = (0..scans * 8).flat_map(|k| (1.0 + f64::from(k) * 0.37).to_le_bytes()).collect();
        arrays.push(("ranges", npy("<f8", true, &format!("(8, {scans})"), &ranges)));
        for method in [CompressionMethod::Stored, CompressionMethod::Deflated] {
            let whole = npz(&arrays, method);
            let cut = whole[..whole.len() * 2 / 3].to_vec();
            let drive = open(&folder(&[("Hokuyo1.npz", cut)])).unwrap();
            let seen = drive.scans().filter(|scan| scan.ranges_m.iter().all(|range_m| range_m.is_finite())).count();
            assert!((10..45).contains(&seen), "{seen}");
            assert!(drive.notes.iter().any(|note| note.contains("cut off")), "{:?}", drive.notes);
            let error = open(&folder(&[("Hokuyo1.npz", whole[..300].to_vec())])).unwrap_err().to_string();
            assert!(error.contains("cut off") && error.contains("an array called"), "{error}");
        }
    }

    #[test]
    fn what_unpacks_to_a_thousandfold_is_refused_unless_allowed() {
        let count = 80_000_000;
        let mut arrays = hokuyo([1.0, 2.0, 3.0]);
        arrays.retain(|(name, _)| *name != "ranges");
        arrays.push(("ranges", npy("|u1", false, &format!("({}, 3)", count / 3), &vec![5; count])));
        let drive = folder(&[("Hokuyo1.npz", npz(&arrays, CompressionMethod::Deflated))]);
        let error = open(&drive).unwrap_err();
        assert!(error.problem().advice.contains("--max-expansion"), "{error}");
        assert_eq!(error.problem().place, "array ranges");
    }

    #[cfg(unix)]
    #[test]
    fn pipes_among_the_images_are_refused_at_once() {
        let kinect = [("disparity_time_stamps", doubles("(1,)", &[1.0])), ("rgb_time_stamps", doubles("(1,)", &[1.5]))];
        let files = [
            ("Hokuyo7.npz", npz(&hokuyo([1.0, 2.0, 3.0]), CompressionMethod::Stored)),
            ("Kinect7.npz", npz(&kinect, CompressionMethod::Stored)),
            ("rgb7_1.png", vec![]),
        ];
        let folder = folder(&files);
        let pipe = folder.path().join("disparity7_1.png");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let images = open(&folder).unwrap().images.unwrap();
        let error = images.depth[0].load_depth().unwrap_err();
        assert!(error.to_string().contains("a pipe or a device"), "{error}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(128))]
        #[test]
        fn damaged_archives_are_errors_or_drives(
            damage in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..4),
            cut in any::<prop::sample::Index>(),
            is_cut in any::<bool>(),
            deflated in any::<bool>()
        ) {
            let method = if deflated { CompressionMethod::Deflated } else { CompressionMethod::Stored };
            let mut bytes = npz(&hokuyo([1.0, 2.0, 3.0]), method);
            for (position, byte) in damage {
                let position = position.index(bytes.len());
                bytes[position] = byte;
            }
            if is_cut {
                bytes.truncate(cut.index(bytes.len()));
            }
            let path = Path::new("Hokuyo1.npz");
            let mut drive = Drive::default();
            if let Ok(mut npz) = Npz::new(path, &bytes, USUAL_EXPANSION)
                && drive.read_hokuyo(&mut npz).is_ok()
            {
                prop_assert!(drive.records.len() <= 3);
            }
        }
    }
}

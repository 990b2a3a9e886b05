//! The RGB-D camera of a recording: which topics hold its images, its intrinsics, and where it sits.
//!
//! Of all pairs of a topic of colour images and one of depth images the best is used whose intrinsics
//! (`sensor_msgs/CameraInfo` of the same namespace, else of the same frame) are known. Images on a topic that is called
//! rectified have the intrinsics of P and no distortion; others those of K and D. The optical frame is where the
//! transforms put the images' `frame_id`. Depth images may be registered to the colour camera or have their own.
//!
//! Sources: REP 103 (optical frames), REP 104 (`CameraInfo`), REP 118 (depth images).

use super::cursor::{Cursor, frame_name};
use super::messages::Kind;
use super::roles::{Roles, Unfulfilled, named};
use super::survey::{Survey, Topic};
use crate::data_set::TopicChoice;
use floorprint::geometry::{Mount, Pose3};
use floorprint::sensors::{DepthCameraConfig, PinholeConfig};

/// `camera_from_optical` has x ahead, y left and z up for z ahead, x right and y down: as a quaternion.
const CAMERA_FROM_OPTICAL: [f64; 4] = [-0.5, 0.5, -0.5, 0.5];

/// A camera that looks up steeper than this (sine) cannot be one that is to see the floor: its frame is no optical one.
const UPWARDS: f64 = 0.5;

/// Frames that lie on the floor end so.
const FLOOR_FRAME: &str = "footprint";

/// Last parts of names of topics that only say how images are transported.
const TRANSPORTS: [&str; 2] = ["compressed", "compressedDepth"];

/// A camera that is used.
pub(super) struct Camera {
    pub(super) depth_topic: String,
    pub(super) color_topic: String,
    /// Its calibration; none where transforms do not say where it sits.
    pub(super) config: Option<DepthCameraConfig>,
}

/// `sensor_msgs/CameraInfo`.
#[derive(Debug, Clone)]
pub(super) struct Calibration {
    pub(super) stamp_s: f64,
    pub(super) frame: String,
    size_px: [usize; 2],
    model: String,
    /// D.
    distortion: Vec<f64>,
    /// Focal lengths and principal point along columns and rows, of K.
    raw: Intrinsics,
    /// The same of P, for rectified images.
    rectified: Intrinsics,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Intrinsics {
    focal_px: [f64; 2],
    center_px: [f64; 2],
}

impl Calibration {
    /// Takes a message apart.
    pub(super) fn read(cursor: &mut Cursor<'_>) -> Option<Self> {
        let header = cursor.header()?;
        let (stamp_s, frame) = (header.stamp_s, header.frame.to_owned());
        let (rows, columns) = (cursor.u32()? as usize, cursor.u32()? as usize);
        let model = cursor.text()?.to_owned();
        let distortion = cursor.list(Cursor::f64)?;
        let (k, _rotation): ([f64; 9], [f64; 9]) = (cursor.f64s()?, cursor.f64s()?);
        let p: [f64; 12] = cursor.f64s()?;
        Some(Self::new(stamp_s, frame, [columns, rows], model, distortion, &k, &p))
    }

    /// Of the matrices K and P.
    pub(super) fn new(
        stamp_s: f64,
        frame: String,
        size_px: [usize; 2],
        model: String,
        distortion: Vec<f64>,
        k: &[f64; 9],
        p: &[f64; 12],
    ) -> Self {
        let raw = Intrinsics { focal_px: [k[0], k[4]], center_px: [k[2], k[5]] };
        let rectified = Intrinsics { focal_px: [p[0], p[5]], center_px: [p[2], p[6]] };
        Self { stamp_s, frame, size_px, model, distortion, raw, rectified }
    }

    /// The camera of images of a size, rectified or not, at a mount; the error says what cannot be.
    fn pinhole(&self, size_px: Option<[usize; 2]>, is_rectified: bool, mount: Mount) -> Result<PinholeConfig, String> {
        let Intrinsics { focal_px, center_px } = if is_rectified { self.rectified } else { self.raw };
        let distortion = if is_rectified || self.distortion.iter().all(|&term| term == 0.0) {
            Vec::new()
        } else {
            let is_known = matches!(self.model.as_str(), "" | "plumb_bob" | "rational_polynomial");
            if !is_known || self.distortion.len() > 8 {
                return Err(format!(
                    "its distortion \"{}\" is not known, only plumb_bob and rational_polynomial are",
                    self.model
                ));
            }
            self.distortion.clone()
        };
        if !focal_px.iter().all(|focal| focal.is_finite() && *focal > 0.0) {
            return Err("its CameraInfo holds no focal length: the camera was never calibrated".to_owned());
        }
        // Images that were made smaller have intrinsics that are smaller by as much.
        let size_px = size_px.unwrap_or(self.size_px);
        let ratio = |axis: usize| match self.size_px[axis] {
            0 => 1.0,
            stated => size_px[axis] as f64 / stated as f64,
        };
        let scaled = [0, 1].map(|axis| {
            let ratio = ratio(axis);
            if ratio == 1.0 {
                return (focal_px[axis], center_px[axis]);
            }
            (focal_px[axis] * ratio, (center_px[axis] + 0.5) * ratio - 0.5)
        });
        let [columns_px, rows_px] = size_px.map(|pixels| u32::try_from(pixels).unwrap_or(u32::MAX));
        let [(focal_columns_px, center_column_px), (focal_rows_px, center_row_px)] = scaled;
        Ok(PinholeConfig {
            mount,
            columns_px,
            rows_px,
            focal_columns_px,
            focal_rows_px,
            center_column_px,
            center_row_px,
            distortion,
        })
    }
}

/// A topic of images with all that is known of its camera.
struct View<'a> {
    name: &'a str,
    topic: &'a Topic,
    calibration: &'a Calibration,
    /// `base_from_optical`.
    place: Option<Pose3>,
}

/// Chooses the camera by which the floor is painted, if there is one.
pub(super) fn choose(roles: &mut Roles, survey: &Survey, wanted: &TopicChoice) -> Result<(), Unfulfilled> {
    let is_image = |topic: &Topic, is_depth: bool| {
        let layout = topic.image.as_ref().and_then(|image| image.layout);
        topic.usable() > 0 && layout.is_some_and(|layout| layout.is_depth() == is_depth)
    };
    let mut views = [true, false].map(|is_depth| -> Vec<(&String, &Topic)> {
        survey.topics.iter().filter(|(_, topic)| is_image(topic, is_depth)).collect()
    });
    let asked = [("--depth", &wanted.depth, "depth images", true), ("--color", &wanted.color, "colour images", false)];
    for ((option, name, what, is_depth), views) in asked.into_iter().zip(&mut views) {
        if let Some(name) = name {
            let topic = named(survey, option, name, what, |topic| is_image(topic, is_depth))?;
            views.retain(|(name, _)| *name == topic);
        }
    }
    for (name, topic) in &survey.topics {
        if let Some(image) = topic.image.as_ref().filter(|image| image.layout.is_none()) {
            roles.because("not used", name, format!("images as {} are not read", image.encoding));
        }
    }
    if views.iter().any(Vec::is_empty) {
        for (name, _) in views.iter().flatten() {
            roles.because("not used", *name, "painting the floor needs both colour and depth images");
        }
        return Ok(());
    }
    let base = roles.base.clone();
    let [depths, colors] = views.map(|topics| -> Vec<View<'_>> {
        let view = |(name, topic): (_, _)| {
            let view = View::new(survey, &base, name, topic);
            if view.is_none() {
                roles.because("not used", name, "no CameraInfo belongs to it");
            }
            view
        };
        topics.into_iter().filter_map(view).collect()
    });
    if depths.is_empty() || colors.is_empty() {
        roles.notes.push("the floor is not painted: intrinsics of the cameras (CameraInfo) are missing".to_owned());
        return Ok(());
    }
    let pairs = colors.iter().flat_map(|color| depths.iter().map(move |depth| (depth, color)));
    let Some((depth, color)) = pairs.max_by_key(|(depth, color)| rank(depth, color)) else { return Ok(()) };
    for other in depths.iter().chain(&colors).filter(|view| view.name != depth.name && view.name != color.name) {
        let option = if depths.iter().any(|view| view.name == other.name) { "--depth" } else { "--color" };
        let reason = format!("{} and {} are used; {option} {} takes this one", color.name, depth.name, other.name);
        roles.because("not used", other.name, reason);
    }
    roles.because("colour", color.name, format!("with {}", color.described()));
    roles.because("depth", depth.name, format!("with {}", depth.described()));
    let config = config(roles, survey, depth, color);
    let config = config.map_err(|why| roles.notes.push(format!("the floor is not painted: {why}"))).ok();
    roles.camera = Some(Camera { depth_topic: depth.name.to_owned(), color_topic: color.name.to_owned(), config });
    Ok(())
}

/// What makes one pair of topics better than another.
fn rank(depth: &View<'_>, color: &View<'_>) -> impl Ord + use<> {
    let root = |view: &View<'_>| view.name.trim_start_matches('/').split('/').next().map(str::to_owned);
    let layout = |view: &View<'_>| view.topic.image.as_ref().and_then(|image| image.layout);
    (
        depth.place.is_some() && color.place.is_some(),
        root(depth) == root(color),
        layout(color).is_some_and(super::image::Layout::has_hues),
        depth.topic.frame() == color.topic.frame(),
        depth.topic.usable().min(color.topic.usable()),
        !layout(color).is_some_and(super::image::Layout::is_packed),
        std::cmp::Reverse(depth.name.len() + color.name.len()),
    )
}

/// The calibration of both cameras; the error says why there is none.
fn config(roles: &Roles, survey: &Survey, depth: &View<'_>, color: &View<'_>) -> Result<DepthCameraConfig, String> {
    // Where the body's frame does not lie on the floor, a frame that does says how high it is.
    let footprint = survey.transforms.frames().filter(|frame| frame.ends_with(FLOOR_FRAME));
    let footprint = footprint.min().and_then(|frame| survey.transforms.between(&roles.base, frame));
    let floor_m = footprint.map_or(0.0, |pose| pose.translation_m.z);
    let pinhole = |view: &View<'_>| {
        let Some(mut place) = view.place else {
            let what = if survey.transforms.moves_between(&roles.base, view.topic.frame()) {
                "moves on"
            } else {
                "is not tied by transforms to"
            };
            let (frame, base) = (view.topic.frame(), &roles.base);
            return Err(format!(
                "{frame}, the frame of {}, {what} {base} (robot.depth_camera sets a camera)",
                view.name
            ));
        };
        place.translation_m.z -= floor_m;
        if place.translation_m.z <= 0.0 {
            let height_m = place.translation_m.z;
            return Err(format!("{} lies {height_m:.3} m above the floor by its transforms", view.name));
        }
        let size_px = view.topic.image.as_ref().and_then(|image| image.size_px);
        view.calibration
            .pinhole(size_px, view.is_rectified(), mount(&place))
            .map_err(|why| format!("{}: {why}", view.name))
    };
    Ok(DepthCameraConfig::new(pinhole(depth)?, pinhole(color)?))
}

/// The mount of a camera whose frame is at `base_from_frame`: an optical frame, unless that would look up.
fn mount(base_from_frame: &Pose3) -> Mount {
    let optical_axis_up = base_from_frame.rotation[(2, 2)];
    let axis_ahead_up = base_from_frame.rotation[(2, 0)];
    if optical_axis_up > UPWARDS && axis_ahead_up < UPWARDS {
        return Mount::of(base_from_frame);
    }
    let optical_from_camera = Pose3::from_quaternion([0.0; 3], CAMERA_FROM_OPTICAL).inverse();
    Mount::of(&base_from_frame.compose(&optical_from_camera))
}

impl<'a> View<'a> {
    /// `None` where no intrinsics belong to it.
    fn new(survey: &'a Survey, base: &str, name: &'a String, topic: &'a Topic) -> Option<Self> {
        let calibration = calibration_of(survey, name, topic)?;
        Some(Self { name, topic, calibration, place: survey.transforms.between(base, topic.frame()) })
    }

    fn is_rectified(&self) -> bool {
        bare(self.name).rsplit('/').next().is_some_and(|last| last.contains("rect"))
    }

    fn described(&self) -> String {
        let encoding = self.topic.image.as_ref().map_or("", |image| image.encoding.trim());
        let lens = if self.is_rectified() {
            "rectified"
        } else if self.calibration.distortion.iter().all(|&term| term == 0.0) {
            "no distortion"
        } else {
            "distortion removed"
        };
        let frame = self.topic.frame();
        match &self.place {
            Some(pose) => {
                let [x_m, y_m, z_m]: [f64; 3] = pose.translation_m.into();
                format!("{encoding}, {lens}; {frame} sits at {x_m:.3} m, {y_m:.3} m, {z_m:.3} m")
            }
            None => format!("{encoding}, {lens}; no transform says where {frame} sits"),
        }
    }
}

/// A topic's name without what only says how images are transported.
fn bare(name: &str) -> &str {
    match name.rsplit_once('/') {
        Some((before, last)) if TRANSPORTS.contains(&last) => before,
        _ => name,
    }
}

/// The intrinsics that belong to a topic of images.
fn calibration_of<'a>(survey: &'a Survey, name: &str, topic: &Topic) -> Option<&'a Calibration> {
    let bare = bare(name);
    let namespace = bare.rsplit_once('/').map_or("", |(namespace, _)| namespace);
    let beside = [format!("{namespace}/camera_info"), format!("{bare}/camera_info")];
    let beside = beside.iter().find_map(|name| survey.topics.get(name)?.calibration.as_ref());
    beside.or_else(|| {
        let infos = survey.topics.values().filter(|other| other.kind == Some(Kind::CameraInfo));
        let mut of_frame = infos.filter_map(|other| other.calibration.as_ref());
        of_frame.find(|calibration| frame_name(&calibration.frame) == topic.frame())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use floorprint::sensors::RobotConfig;

    #[test]
    fn an_optical_frame_and_one_that_looks_along_x_are_the_same_mount() {
        let kinect = RobotConfig::ece276a().camera.unwrap().mount;
        let base_from_camera = kinect.body_from_sensor();
        let base_from_optical = base_from_camera.compose(&Pose3::from_quaternion([0.0; 3], CAMERA_FROM_OPTICAL));
        // The optical axis looks where the camera does.
        let ahead = base_from_optical.rotation.column(2) - base_from_camera.rotation.column(0);
        assert!(ahead.norm() < 1e-12);
        for pose in [base_from_optical, base_from_camera] {
            let again = mount(&pose).body_from_sensor();
            assert!((again.rotation - base_from_camera.rotation).norm() < 1e-9);
            assert_eq!(again.translation_m, base_from_camera.translation_m);
        }
    }

    fn calibration(model: &str, distortion: Vec<f64>) -> Calibration {
        let intrinsics = |focal| Intrinsics { focal_px: [focal, focal + 1.0], center_px: [319.5, 239.5] };
        Calibration {
            stamp_s: 0.0,
            frame: "camera".to_owned(),
            size_px: [640, 480],
            model: model.to_owned(),
            distortion,
            raw: intrinsics(500.0),
            rectified: intrinsics(480.0),
        }
    }

    #[test]
    fn lenses_are_corrected_or_refused_but_never_ignored() {
        let pinhole =
            |calibration: &Calibration, is_rectified| calibration.pinhole(None, is_rectified, Mount::default());
        let plumb_bob = calibration("plumb_bob", vec![-0.1, 0.0, 0.0, 0.0, 0.0]);
        let raw = pinhole(&plumb_bob, false).unwrap();
        assert_eq!((raw.focal_columns_px, raw.focal_rows_px, raw.distortion.len()), (500.0, 501.0, 5));
        let rectified = pinhole(&plumb_bob, true).unwrap();
        assert_eq!((rectified.focal_columns_px, rectified.distortion.len()), (480.0, 0));
        let fisheye = calibration("equidistant", vec![0.1, 0.0, 0.0, 0.0]);
        assert!(pinhole(&fisheye, false).unwrap_err().contains("equidistant"));
        assert!(pinhole(&calibration("equidistant", vec![0.0; 4]), false).is_ok());
        let mut blank = calibration("", Vec::new());
        blank.raw.focal_px = [0.0; 2];
        assert!(pinhole(&blank, false).unwrap_err().contains("never calibrated"));
    }

    #[test]
    fn smaller_images_have_smaller_intrinsics() {
        let half = calibration("", Vec::new()).pinhole(Some([320, 240]), false, Mount::default()).unwrap();
        assert_eq!((half.columns_px, half.focal_columns_px, half.center_column_px), (320, 250.0, 159.5));
    }
}

//! The floor of a drive that is pushed by hand, from the images that come with it.

use crate::images::RgbdImage;
use floorprint::Config;
use floorprint::geometry::Pose2;
use floorprint::odometry::{DeadReckoning, Trajectory};
use floorprint::sensors::StampedPose;
use floorprint::texture::{CameraError, FloorMapper, FloorPatch, RgbdCamera, RgbdFrame, TextureConfig, TextureMap};

/// Takes images as they come, and paints whenever it is asked to.
pub(crate) struct Painter {
    mapper: FloorMapper,
    config: TextureConfig,
    /// All of dead reckoning, of which the synchroniser keeps the latest stretch only.
    knots: Vec<StampedPose>,
    next_knot: usize,
    /// Images that dead reckoning has not passed yet.
    waiting: Vec<RgbdImage>,
    patches: Vec<FloorPatch>,
    /// Where the last image was taken that is painted with, by dead reckoning.
    last: Option<Pose2>,
}

impl Painter {
    /// A painter; `None` for a robot that states no camera.
    ///
    /// # Errors
    /// The camera's calibration cannot be that of a camera above the floor.
    pub(crate) fn new(config: &Config) -> Result<Option<Self>, CameraError> {
        let Some(camera) = RgbdCamera::of(&config.robot) else { return Ok(None) };
        let mapper = FloorMapper::new(&config.texture, camera, config.seed)?;
        let config = config.texture.clone();
        let (knots, waiting, patches) = (Vec::new(), Vec::new(), Vec::new());
        Ok(Some(Self { mapper, config, knots, next_knot: 0, waiting, patches, last: None }))
    }

    /// Takes in an image.
    pub(crate) fn push(&mut self, image: RgbdImage) {
        self.waiting.push(image);
    }

    /// Follows dead reckoning, and takes up the images that it has passed.
    pub(crate) fn follow(&mut self, dead_reckoning: &DeadReckoning) {
        let (knots, next) = dead_reckoning.knots_from(self.next_knot);
        self.knots.extend(knots);
        self.next_knot = next;
        let Some([_, end_s]) = dead_reckoning.span_s() else { return };
        let is_passed = |image: &&RgbdImage| image.color.stamp_s.max(image.depth.stamp_s) <= end_s;
        let passed = self.waiting.iter().take_while(is_passed).count();
        for image in self.waiting.drain(..passed).collect::<Vec<_>>() {
            self.take_up(&image, dead_reckoning);
        }
    }

    /// No odometry follows: takes up the images that still wait.
    pub(crate) fn flush(&mut self, dead_reckoning: &DeadReckoning) {
        self.follow(dead_reckoning);
        for image in std::mem::take(&mut self.waiting) {
            self.take_up(&image, dead_reckoning);
        }
    }

    /// Keeps the floor that an image shows, unless it was taken where the one before was.
    fn take_up(&mut self, image: &RgbdImage, dead_reckoning: &DeadReckoning) {
        let here = dead_reckoning.pose_at(image.color.stamp_s);
        let is_near = self.last.is_some_and(|last| {
            let motion = last.between(&here);
            motion.distance() < self.config.image_spacing_m && motion.theta.abs() < self.config.image_spacing_rad
        });
        if is_near {
            return;
        }
        self.last = Some(here);
        let motion = dead_reckoning.motion(image.depth.stamp_s, image.color.stamp_s);
        let frame = RgbdFrame { depth: &image.depth, color: &image.color, depth_body_from_color_body: motion };
        // What shows no floor adds nothing.
        self.patches.extend(self.mapper.patch(&frame));
    }

    /// The floor along a trajectory; `None` where no image showed any.
    pub(crate) fn paint(&self, trajectory: &[StampedPose]) -> Option<TextureMap> {
        if self.patches.is_empty() {
            return None;
        }
        let dead_reckoning = DeadReckoning::new(self.knots.iter().copied());
        let trajectory = Trajectory::new(trajectory);
        let place = |patch: &FloorPatch| trajectory.pose_at(patch.stamp_s, &dead_reckoning);
        let places: Vec<Pose2> = self.patches.iter().map(place).collect();
        Some(self.mapper.paint(&self.patches, &places))
    }
}

//! Which topics and frames play which role, chosen by what is in them, with the reason in words.
//!
//! * **Base**: the frame whose pose the odometry states, else the topmost frame to which the LiDAR is fixed.
//! * **LiDARs**: of the planar ones whose mount is known and that look level, the one that sees most. Others at its
//!   height can be asked for beside it: a map is a slice through the building, and slices at different heights differ. Not the one that the truth is made
//!   of, when there is another. Without a planar one a cloud of points is sliced.
//! * **Odometry**: a topic of poses, else the first moving frame above the base. Joints that are wheels, where asked for.
//! * **Truth**: poses on a topic whose name says so.

use super::camera::{self, Camera};
use super::cursor::frame_name;
use super::messages::Kind;
use super::survey::{Survey, Topic};
use super::transforms::{MovingEdge, is_world};
use super::wheels::Wheels;
use crate::data_set::TopicChoice;
use floorprint::geometry::{Mount, Pose3};
use std::collections::BTreeSet;

/// Planes of LiDARs that are used together lie at one height within this, metres: furniture has edges of all
/// heights, but what is seen from within a hand's breadth is mostly the same.
const SAME_HEIGHT_M: f64 = 0.3;

/// A LiDAR sees little if its field of view is less than this share of another's, however many rays there are in it.
const NARROW: f64 = 0.5;

/// A planar LiDAR that leans more than this (cosine, 30°) sees floors and ceilings.
const LEVEL_COSINE: f64 = 0.866;

/// Share of a truth's stamps that are a LiDAR's own when it is made of that LiDAR's scans.
const MADE_OF: f64 = 0.9;

/// Clocks of topics that differ more than this cannot be used together, seconds: networks are not so slow.
const SAME_CLOCK_S: f64 = 10.0;

/// Who differs by more than this is told of it, seconds: sensors and networks are quicker.
const LATE_S: f64 = 2.0;

/// Parts of topics' names that announce the truth.
const TRUTH_NAMES: [&str; 9] =
    ["ground_truth", "groundtruth", "truth", "gt", "mocap", "vicon", "optitrack", "qualisys", "motion_capture"];

/// Who plays which role.
pub(super) struct Roles {
    /// The frame in which everything of the robot is expressed; empty when no frame has a name.
    pub(super) base: String,
    /// In the order of their sensor numbers.
    pub(super) lidars: Vec<Lidar>,
    pub(super) odometry: Option<Odometry>,
    /// The IMU's topic, and `base_from_imu`.
    pub(super) imu: Option<(String, Pose3)>,
    /// The topic of the true poses.
    pub(super) truth: Option<String>,
    /// The RGB-D camera by which the floor is painted.
    pub(super) camera: Option<Camera>,
    /// Whether transforms say where all LiDARs sit.
    pub(super) all_places_known: bool,
    /// Whether messages count as taken when they were recorded: where their own stamps are nonsense.
    pub(super) by_log_time: bool,
    /// Namespaces of other robots, whose messages play no role.
    pub(super) other_robots: Vec<String>,
    /// What was chosen and what was not, with the reason.
    pub(super) reasons: Vec<Reason>,
    /// What the user ought to know.
    pub(super) notes: Vec<String>,
}

/// A LiDAR that is used.
pub(super) struct Lidar {
    pub(super) topic: String,
    pub(super) mount: Mount,
    /// `base_from_lidar`, which for a cloud is more than the mount of its slice.
    pub(super) base_from_lidar: Pose3,
    /// From the first ray to the last, seconds.
    pub(super) sweep_s: f64,
    pub(super) zero_means_no_return: bool,
    /// From this range on readings mean that nothing came back, metres.
    pub(super) no_return_mark_m: Option<f32>,
    /// The frame of its scans, where its topic holds those of others, too.
    pub(super) only_frame: Option<String>,
}

impl Lidar {
    /// Whether a scan in a frame is its own.
    pub(super) fn is_of(&self, frame: &str) -> bool {
        self.only_frame.as_ref().is_none_or(|only| only == frame)
    }
}

/// Where odometry comes from.
pub(super) enum Odometry {
    /// A topic, and `child_from_base` of the frame whose pose it states.
    Topic(String, Pose3),
    /// An edge of the tree of frames, and `child_from_base`.
    Edge(MovingEdge, Pose3),
    /// A topic of joints, and those that are wheels.
    Wheels(String, Wheels),
}

/// Why something plays a role, or none.
pub(super) struct Reason {
    pub(super) role: &'static str,
    /// The topic, or the frames of an edge.
    pub(super) what: String,
    pub(super) why: String,
}

/// A wish that cannot be fulfilled.
pub(super) struct Unfulfilled {
    /// The option.
    pub(super) option: &'static str,
    /// What was asked for.
    pub(super) wanted: String,
    /// Why it cannot be.
    pub(super) why: String,
    /// What could be asked for.
    pub(super) candidates: Vec<String>,
}

impl Roles {
    /// Chooses all roles among what belongs to one robot.
    pub(super) fn of_one_robot(survey: &mut Survey, wanted: &TopicChoice) -> Result<Self, Unfulfilled> {
        let asked_for = wanted.scans.iter().chain(&wanted.odometry).map(String::as_str);
        let other_robots = survey.leave_one_robot(&asked_for.collect::<Vec<_>>());
        let mut roles = Self::choose(survey, wanted)?;
        if let Some(other) = other_robots.first() {
            roles.notes.push(format!(
                "several robots were recorded, whose frames have the same names; those in {} are not used: --scan {other}… takes that one",
                other_robots.join(", ")
            ));
        }
        roles.other_robots = other_robots;
        Ok(roles)
    }

    /// Chooses all roles.
    pub(super) fn choose(survey: &Survey, wanted: &TopicChoice) -> Result<Self, Unfulfilled> {
        let mut roles = Self {
            base: String::new(),
            lidars: Vec::new(),
            odometry: None,
            imu: None,
            truth: None,
            camera: None,
            all_places_known: true,
            by_log_time: false,
            other_robots: Vec::new(),
            reasons: Vec::new(),
            notes: Vec::new(),
        };
        roles.choose_truth(survey, wanted)?;
        let odometry = roles.choose_odometry_topic(survey, wanted)?;
        let scans = roles.scan_candidates(survey, wanted)?;
        roles.choose_base(survey, wanted, odometry.as_deref(), &scans)?;
        roles.choose_odometry(survey, odometry);
        roles.choose_lidars(survey, scans, !wanted.scans.is_empty());
        roles.choose_imu(survey);
        camera::choose(&mut roles, survey, wanted)?;
        roles.choose_clock(survey);
        Ok(roles)
    }

    pub(super) fn because(&mut self, role: &'static str, what: impl Into<String>, why: impl Into<String>) {
        self.reasons.push(Reason { role, what: what.into(), why: why.into() });
    }

    fn choose_truth(&mut self, survey: &Survey, wanted: &TopicChoice) -> Result<(), Unfulfilled> {
        let can = |topic: &Topic| {
            matches!(topic.kind, Some(Kind::Odometry | Kind::PoseStamped | Kind::PoseWithCovarianceStamped))
                && topic.usable() > 0
        };
        if let Some(name) = &wanted.truth {
            let topic = named(survey, "--truth", name, "poses", can)?;
            self.because("truth", topic, "asked for");
            self.truth = Some(topic.to_owned());
            return Ok(());
        }
        let named_so = survey.topics.iter().filter(|(name, topic)| can(topic) && is_called_truth(name));
        // Of several the one with most poses.
        let best = named_so.max_by_key(|(name, topic)| (topic.usable(), std::cmp::Reverse(name.len())));
        if let Some((name, _)) = best {
            self.because("truth", name, "its name says so");
            self.truth = Some(name.clone());
        }
        Ok(())
    }

    /// The topic of the odometry, if one is to be used.
    fn choose_odometry_topic(&mut self, survey: &Survey, wanted: &TopicChoice) -> Result<Option<String>, Unfulfilled> {
        let can = |topic: &Topic| topic.kind == Some(Kind::Odometry) && topic.usable() > 0;
        if let Some(name) = &wanted.odometry {
            let wheels = |topic: &Topic| Wheels::among(&topic.joints);
            let or_other =
                |topic: &Topic| can(topic) || topic.kind == Some(Kind::Transforms) || wheels(topic).is_some();
            let topic = named(survey, "--odom", name, "odometry", or_other)?;
            if let Some(wheels) = survey.topics.get(topic).and_then(wheels) {
                self.because("odometry", topic, format!("asked for: the wheels {wheels}"));
                self.notes.push(format!(
                    "{topic} states angles of wheels: robot.wheels says what they mean (left_m_per_tick and right_m_per_tick are the radius in metres, track_width_m)"
                ));
                self.odometry = Some(Odometry::Wheels(topic.to_owned(), wheels));
                return Ok(None);
            }
            return Ok(survey.topics.get(topic).filter(|topic| can(topic)).map(|_| topic.to_owned()));
        }
        let candidates = survey
            .topics
            .iter()
            .filter(|(name, topic)| can(topic) && !is_called_truth(name) && self.truth.as_ref() != Some(*name));
        // The one that the tree of frames repeats is what the robot itself goes by. A place in a map is what others have made of
        // the drive, and of a frame to which no sensor is tied nobody knows where it sits on the robot.
        let sensors: Vec<&str> =
            survey.topics.values().filter(|topic| topic.kind.is_some_and(Kind::is_scan)).map(Topic::frame).collect();
        let rank = |(name, topic): &(&String, &Topic)| {
            let edges = topic.children.iter().filter_map(|child| survey.transforms.odometry_of(child));
            let repeated = edges.into_iter().any(|edge| topic.frames.contains_key(&edge.parent));
            let in_a_map = is_world(topic.frame());
            let is_tied = topic
                .children
                .iter()
                .filter(|child| !child.is_empty())
                .any(|child| sensors.iter().any(|sensor| survey.transforms.between(child, sensor).is_some()));
            (!in_a_map, repeated, is_tied, name.ends_with("odom"), topic.usable(), std::cmp::Reverse(name.len()))
        };
        let best = candidates.max_by_key(rank);
        // Rather what moves on /tf than a place in a map.
        let moves_on_tf = || sensors.iter().any(|sensor| survey.transforms.odometry_of(sensor).is_some());
        Ok(best.filter(|(_, topic)| !is_world(topic.frame()) || !moves_on_tf()).map(|(name, _)| name.clone()))
    }

    /// The topics that may hold the scans: those that were asked for, else planar ones, else clouds.
    fn scan_candidates(&self, survey: &Survey, wanted: &TopicChoice) -> Result<Vec<String>, Unfulfilled> {
        let is_planar = |topic: &Topic| {
            matches!(topic.kind, Some(Kind::LaserScan | Kind::MultiEchoLaserScan)) && topic.usable() > 0
        };
        let is_cloud = |topic: &Topic| topic.kind == Some(Kind::PointCloud2) && topic.usable() > 0;
        if !wanted.scans.is_empty() {
            let can = |topic: &Topic| is_planar(topic) || is_cloud(topic);
            let topics =
                wanted.scans.iter().map(|name| named(survey, "--scan", name, "scans or clouds of points", can));
            let mut chosen: Vec<String> = Vec::new();
            for topic in topics {
                let topic = topic?;
                if !chosen.iter().any(|known| known == topic) {
                    chosen.push(topic.to_owned());
                }
            }
            return Ok(chosen);
        }
        let all = |can: &dyn Fn(&Topic) -> bool| -> Vec<String> {
            survey.topics.iter().filter(|(_, topic)| can(topic)).map(|(name, _)| name.clone()).collect()
        };
        let planar = all(&is_planar);
        Ok(if planar.is_empty() { all(&is_cloud) } else { planar })
    }

    fn choose_base(
        &mut self,
        survey: &Survey,
        wanted: &TopicChoice,
        odometry: Option<&str>,
        scans: &[String],
    ) -> Result<(), Unfulfilled> {
        if let Some(base) = &wanted.base {
            let base = frame_name(base);
            let stated =
                survey.topics.values().any(|topic| topic.children.contains(base) || topic.frames.contains_key(base));
            if !survey.transforms.knows(base) && !stated {
                let candidates: BTreeSet<String> = survey.transforms.frames().map(str::to_owned).collect();
                return Err(Unfulfilled {
                    option: "--base",
                    wanted: base.to_owned(),
                    why: "there is no such frame".to_owned(),
                    candidates: candidates.into_iter().collect(),
                });
            }
            base.clone_into(&mut self.base);
            self.because("base", base, "asked for");
            return Ok(());
        }
        let child = odometry
            .and_then(|name| survey.topics.get(name))
            .and_then(|topic| topic.children.iter().find(|child| !child.is_empty()));
        let transforms = &survey.transforms;
        let alias = odometry.and_then(|name| survey.topics.get(name)).zip(child).and_then(|(topic, child)| {
            let sensor = survey.topics.get(scans.first()?)?.frame();
            let edge = transforms.odometry_of(sensor).filter(|edge| topic.frames.contains_key(&edge.parent))?;
            (!transforms.knows(child)).then_some(edge.child)
        });
        if let (Some(alias), Some(child)) = (alias, child) {
            self.because("base", &alias, format!("the odometry states the pose of {child}, which no transform knows; /tf moves this frame in the same one"));
            self.base = alias;
        } else if let Some(child) = child {
            child.clone_into(&mut self.base);
            self.because("base", child, "the odometry states its pose");
        } else if let Some(frame) = scans.first().and_then(|name| survey.topics.get(name)).map(Topic::frame) {
            let top = survey.transforms.topmost(frame).to_owned();
            self.because("base", &top, "the topmost frame to which the LiDAR is fixed");
            self.base = top;
        }
        Ok(())
    }

    fn choose_odometry(&mut self, survey: &Survey, topic: Option<String>) {
        if let Some(name) = topic {
            let Some(topic) = survey.topics.get(&name) else { return };
            let child = topic.children.iter().find(|child| !child.is_empty());
            let child_from_base = match child {
                None => Pose3::identity(),
                Some(child) => survey.transforms.between(child, &self.base).unwrap_or_else(|| {
                    self.notes.push(format!(
                        "the frames {child} of the odometry and {} are not tied to each other: taken to be one",
                        self.base
                    ));
                    Pose3::identity()
                }),
            };
            self.because("odometry", &name, "the robot's own poses");
            let is_other = |(other, topic): &(&String, &Topic)| {
                topic.kind == Some(Kind::Odometry) && **other != name && self.truth.as_ref() != Some(*other)
            };
            let others: Vec<&String> = survey.topics.iter().filter(is_other).map(|(other, _)| other).collect();
            for other in others {
                self.because("not used", other, format!("{name} is the odometry; --odom {other} takes this one"));
            }
            self.odometry = Some(Odometry::Topic(name, child_from_base));
        } else if let (None, Some(edge)) = (&self.odometry, survey.transforms.odometry_of(&self.base)) {
            let child_from_base = survey.transforms.between(&edge.child, &self.base).unwrap_or_else(Pose3::identity);
            self.because(
                "odometry",
                format!("{} → {} on /tf", edge.parent, edge.child),
                "the first moving frame above the base",
            );
            self.odometry = Some(Odometry::Edge(edge, child_from_base));
        }
        self.mention_wheels(survey);
    }

    /// Says how wheels that are not used could be.
    fn mention_wheels(&mut self, survey: &Survey) {
        if matches!(self.odometry, Some(Odometry::Wheels(..))) {
            return;
        }
        for (name, topic) in &survey.topics {
            if let Some(wheels) = Wheels::among(&topic.joints) {
                let how = format!("with --odom {name} and robot.wheels (radius, track width) they are the odometry");
                self.because("not used", name, format!("the wheels {wheels}: {how}"));
            }
        }
    }

    fn choose_lidars(&mut self, survey: &Survey, topics: Vec<String>, asked_for: bool) {
        let mut candidates: Vec<Candidate> =
            topics.iter().filter_map(|name| Candidate::new(survey, &self.base, name)).collect();
        if !asked_for {
            // The one that sees most comes first.
            let widest_rad = candidates.iter().map(|c| c.field_of_view_rad).fold(0.0, f64::max);
            let is_narrow = |c: &Candidate| c.field_of_view_rad < NARROW * widest_rad;
            candidates.sort_by(|a, b| {
                let by_hits = || b.hits_per_s.total_cmp(&a.hits_per_s).then(a.topic.len().cmp(&b.topic.len()));
                is_narrow(a).cmp(&is_narrow(b)).then_with(by_hits)
            });
            self.leave_out_doubtful(survey, &mut candidates);
        }
        for candidate in candidates {
            let Candidate { topic, frame, place, is_cloud, .. } = candidate;
            let Some(contents) = survey.topics.get(&topic) else { continue };
            self.all_places_known &= matches!(place, Place::Known(_));
            let base_from_lidar = match place {
                Place::Known(pose) => pose,
                Place::Moving => {
                    self.notes
                        .push(format!("{topic}: its frame {frame} moves on the robot; taken to sit at {}", self.base));
                    Pose3::identity()
                }
                Place::Unknown => {
                    self.notes.push(format!(
                        "{topic}: no transform says where {frame} sits on {}; taken to be at its origin, looking ahead (robot.lidar.mount sets it)",
                        self.base
                    ));
                    Pose3::identity()
                }
            };
            let mut mount = Mount::of(&base_from_lidar);
            if is_cloud {
                // A slice is made in the base's axes.
                mount = Mount { roll_rad: 0.0, pitch_rad: 0.0, yaw_rad: 0.0, ..mount };
            }
            let why = if asked_for {
                "asked for"
            } else if is_cloud {
                "the only kind of scans; a level slice of it is used"
            } else {
                "a level LiDAR"
            };
            self.because(
                "scans",
                &topic,
                format!(
                    "{why}; {frame} sits at {:.3} m, {:.3} m, {:.3} m, yaw {:.1}°",
                    mount.x_m,
                    mount.y_m,
                    mount.z_m,
                    mount.yaw_rad.to_degrees()
                ),
            );
            let zero_means_no_return = contents.rays.zero_means_no_return();
            if zero_means_no_return {
                self.notes.push(format!("{topic}: ranges of 0 mean that nothing came back"));
            }
            let no_return_mark_m = contents.rays.no_return_mark_m();
            if let Some(mark_m) = no_return_mark_m {
                self.notes.push(format!("{topic}: ranges of {mark_m} m and more mean that nothing came back"));
            }
            if let (scans, Some(fields_of_view)) = contents.rays.contradictory
                && 2 * scans > contents.messages
            {
                let [made_deg, stated_deg] = fields_of_view.map(f64::to_degrees);
                self.notes.push(format!(
                    "{topic}: by angle_increment its rays span {made_deg:.1}°, by angle_min and angle_max {stated_deg:.1}°: one of them is wrong; angle_increment is believed"
                ));
            }
            // Of a frame that no transform ties to the robot nobody knows whether it is another LiDAR's or another name.
            let place_of = |name: &str| survey.transforms.between(&self.base, name);
            let is_elsewhere =
                |name: &&String| **name != frame && place_of(name).is_some_and(|place| place != base_from_lidar);
            let others: Vec<&str> = contents.frames.keys().filter(is_elsewhere).map(String::as_str).collect();
            let only_frame = (!others.is_empty() && place_of(&frame).is_some()).then_some(frame);
            if let Some(frame) = &only_frame {
                self.notes.push(format!(
                    "{topic} holds scans of several LiDARs: those in {frame} are used, those in {} are not",
                    others.join(", ")
                ));
            }
            self.lidars.push(Lidar {
                mount,
                base_from_lidar,
                sweep_s: contents.sweep_s(),
                zero_means_no_return,
                no_return_mark_m,
                only_frame,
                topic,
            });
        }
    }

    /// Leaves out LiDARs that would not show the same slice of the building, or show it twice.
    fn leave_out_doubtful(&mut self, survey: &Survey, candidates: &mut Vec<Candidate>) {
        let mut left_out = Vec::new();
        let mut leave_out = |candidates: &mut Vec<Candidate>,
                             is_out: &dyn Fn(&Candidate) -> bool,
                             why: &dyn Fn(&Candidate) -> String| {
            if candidates.iter().all(is_out) {
                return;
            }
            let out = candidates.extract_if(.., |candidate| is_out(candidate));
            left_out.extend(out.map(|candidate| (candidate.topic.clone(), why(&candidate))));
        };
        leave_out(candidates, &|c| matches!(c.place, Place::Moving), &|c| {
            format!("its frame {} moves on the robot", c.frame)
        });
        leave_out(
            candidates,
            &|c| matches!(&c.place, Place::Known(pose) if !c.is_cloud && pose.rotation[(2, 2)].abs() < LEVEL_COSINE),
            &|_| "it leans too far".to_owned(),
        );
        leave_out(candidates, &|c| matches!(c.place, Place::Unknown), &|c| {
            format!("no transform says where {} sits", c.frame)
        });
        if let Some((name, truth)) = self.truth.as_ref().and_then(|name| Some((name, survey.topics.get(name)?))) {
            let is_made_of =
                |c: &Candidate| survey.topics.get(&c.topic).is_some_and(|topic| shared_stamps(truth, topic) > MADE_OF);
            leave_out(candidates, &is_made_of, &|_| {
                format!("{name} has its stamps: what is made of a LiDAR is no measure for it")
            });
        }
        if let Some(first) = candidates.first() {
            let (main, frame, height_m) = (first.topic.clone(), first.frame.clone(), first.height_m());
            let is_known = matches!(first.place, Place::Known(_));
            let is_cloud = first.is_cloud;
            leave_out(candidates, &|c| c.topic != main && (c.frame == frame || !is_known || is_cloud), &|c| {
                if c.frame == frame {
                    format!("it is in the frame of {main}: the same LiDAR")
                } else {
                    format!("{main} is used")
                }
            });
            leave_out(candidates, &|c| (c.height_m() - height_m).abs() > SAME_HEIGHT_M, &|c| {
                format!(
                    "it looks {:.2} m {} {main}, which sees more: another slice of the building",
                    (c.height_m() - height_m).abs(),
                    if c.height_m() > height_m { "above" } else { "below" }
                )
            });
            let mut frames = BTreeSet::new();
            let again: BTreeSet<String> =
                candidates.iter().filter(|c| !frames.insert(c.frame.clone())).map(|c| c.topic.clone()).collect();
            leave_out(candidates, &|c| again.contains(&c.topic), &|c| {
                format!("another topic is in its frame {}: the same LiDAR", c.frame)
            });
            // Recorded mounts of further LiDARs are often wrong by centimetres, and two maps are worse than half of one.
            leave_out(candidates, &|c| c.topic != main, &|c| {
                format!("{main} sees more; with --scan {main} --scan {} both are used", c.topic)
            });
        }
        for (topic, why) in left_out {
            let why = if why.contains("--scan") { why } else { format!("{why}; --scan {topic} takes it") };
            self.because("not used", topic, why);
        }
    }

    fn choose_imu(&mut self, survey: &Survey) {
        let is_imu = |(_, topic): &(&String, &Topic)| topic.kind == Some(Kind::Imu) && topic.usable() > 0;
        for (name, _) in survey.topics.iter().filter(is_imu).filter(|(_, topic)| topic.has_no_gyro()) {
            self.because("not used", name, "its angular velocities are 0 throughout: it holds no gyro");
        }
        let gyros = survey.topics.iter().filter(is_imu).filter(|(_, topic)| !topic.has_no_gyro());
        let Some((name, topic)) = gyros.max_by_key(|(_, topic)| (topic.turns, topic.usable())) else { return };
        let pose = survey.transforms.between(&self.base, topic.frame());
        self.because(
            "IMU",
            name,
            if pose.is_some() {
                "turned into the base's axes"
            } else {
                "no transform says how it sits: taken to be level, x ahead"
            },
        );
        self.imu = Some((name.clone(), pose.unwrap_or_else(Pose3::identity)));
    }

    /// Stamps of headers, unless they do not go on as times do or are of clocks that have nothing in common.
    fn choose_clock(&mut self, survey: &Survey) {
        // A map can be made without an IMU; for its sake nobody else's stamps are given up.
        if let Some((name, _)) = &self.imu
            && survey.topics.get(name).is_some_and(|topic| !topic.stamps_advance())
            && self.lidars.iter().all(|lidar| survey.topics.get(&lidar.topic).is_some_and(Topic::stamps_advance))
        {
            self.notes.push(format!("the stamps of {name} do not advance: it is not used"));
            self.reasons.retain(|reason| reason.role != "IMU");
            self.imu = None;
        }
        let (odometry, edge) = match &self.odometry {
            Some(Odometry::Topic(name, _) | Odometry::Wheels(name, _)) => (Some(name), None),
            Some(Odometry::Edge(edge, _)) => (None, Some(edge)),
            None => (None, None),
        };
        let topics: Vec<(&String, &Topic)> = self
            .lidars
            .iter()
            .map(|lidar| &lidar.topic)
            .chain(odometry)
            .filter_map(|name| Some((name, survey.topics.get(name)?)))
            .collect();
        let stopped = topics.iter().find(|(_, topic)| !topic.stamps_advance());
        let of_topics = topics.iter().map(|(name, topic)| ((*name).clone(), topic.delay_s()));
        let of_edge = edge.map(|edge| (format!("{} → {} on /tf", edge.parent, edge.child), edge.delay_s));
        let delays_s: Vec<(String, f64)> = of_topics.chain(of_edge).collect();
        let Some((first, first_delay_s)) = delays_s.first() else { return };
        let beyond = |limit_s: f64| delays_s.iter().find(move |(_, delay_s)| (delay_s - first_delay_s).abs() > limit_s);
        let apart = beyond(SAME_CLOCK_S);
        let note = match (stopped, apart) {
            (Some((name, _)), _) => {
                format!("the stamps of {name} do not advance: messages count as taken when they were recorded")
            }
            (None, Some((name, delay_s))) => format!(
                "the stamps of {name} are {:.1} s off those of {first}: messages count as taken when they were recorded",
                (delay_s - first_delay_s).abs()
            ),
            (None, None) => {
                if let Some((name, delay_s)) = beyond(LATE_S) {
                    let behind_s = delay_s - first_delay_s;
                    self.notes.push(format!(
                        "by when messages were recorded the stamps of {name} are {:.1} s {} those of {first}; they are taken as they are. Where the clocks differ rather than the delays, correct the stamps (robot.lag has small ones)",
                        behind_s.abs(),
                        if behind_s > 0.0 { "behind" } else { "ahead of" }
                    ));
                }
                return;
            }
        };
        self.notes.push(note);
        self.by_log_time = true;
    }
}

/// A LiDAR that might be used.
struct Candidate {
    topic: String,
    frame: String,
    place: Place,
    is_cloud: bool,
    /// Rays that hit something, a second.
    hits_per_s: f64,
    field_of_view_rad: f64,
}

/// Where a LiDAR sits.
enum Place {
    /// `base_from_lidar`.
    Known(Pose3),
    /// It is moved by a joint.
    Moving,
    Unknown,
}

impl Candidate {
    fn new(survey: &Survey, base: &str, name: &str) -> Option<Self> {
        let topic = survey.topics.get(name)?;
        let frame = topic.frame();
        let place = match survey.transforms.between(base, frame) {
            Some(pose) => Place::Known(pose),
            None if survey.transforms.moves_between(base, frame) => Place::Moving,
            None => Place::Unknown,
        };
        let hits_per_s = topic.rays.hits as f64 / topic.messages.max(1) as f64 * topic.rate_hz();
        Some(Self {
            topic: name.to_owned(),
            frame: frame.to_owned(),
            place,
            is_cloud: topic.kind == Some(Kind::PointCloud2),
            hits_per_s,
            field_of_view_rad: topic.rays.field_of_view_rad,
        })
    }

    fn height_m(&self) -> f64 {
        match &self.place {
            Place::Known(pose) => pose.translation_m.z,
            Place::Moving | Place::Unknown => 0.0,
        }
    }
}

/// The share of `of`'s stamps that are `among`'s, to the microsecond.
fn shared_stamps(of: &Topic, among: &Topic) -> f64 {
    let microseconds = |stamp_s: &f64| (stamp_s * 1e6).round() as i64;
    let known: BTreeSet<i64> = among.stamps_s.iter().map(microseconds).collect();
    let shared = of.stamps_s.iter().filter(|stamp_s| known.contains(&microseconds(stamp_s))).count();
    shared as f64 / of.stamps_s.len().max(1) as f64
}

fn is_called_truth(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    name.split('/').any(|part| {
        TRUTH_NAMES.iter().any(|truth| match *truth {
            "gt" => part.split('_').any(|word| word == "gt"),
            truth => part.contains(truth),
        })
    })
}

/// The topic that an option names, with or without its leading slash.
pub(super) fn named<'a>(
    survey: &'a Survey,
    option: &'static str,
    name: &str,
    what: &str,
    can: impl Fn(&Topic) -> bool,
) -> Result<&'a str, Unfulfilled> {
    let bare = |name: &str| name.trim_start_matches('/').to_owned();
    let found = survey.topics.iter().find(|(topic, _)| bare(topic) == bare(name));
    let why = match found {
        Some((topic, contents)) if can(contents) => return Ok(topic),
        Some((_, contents)) if contents.kind.is_none() && Kind::of(&contents.type_name).is_some() => {
            "it is of another robot than the rest; one at a time is mapped".to_owned()
        }
        Some((_, contents)) => format!("it holds {}, no {what}", contents.type_name),
        None => "there is no such topic".to_owned(),
    };
    let candidates = survey.topics.iter().filter(|(_, topic)| can(topic)).map(|(name, _)| name.clone()).collect();
    Err(Unfulfilled { option, wanted: name.to_owned(), why, candidates })
}

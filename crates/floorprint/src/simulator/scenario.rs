//! A whole drive drawn at random: a world, a robot with its sensors, and what goes wrong.

use super::config::SimulationConfig;
use super::random_faults::{self, random_faults};
use super::random_robot::random_robot;
use super::random_world::{WorldKind, random_world};
use super::world::World;
use super::{SimulatedDrive, SimulationError, simulate};
use crate::random::{Stage, generator};
use rand::RngExt;

/// A drive that follows from its seed alone.
#[derive(Debug, Clone)]
pub struct Scenario {
    /// Its number.
    pub seed: u64,
    /// What kind of world it is.
    pub world_kind: &'static str,
    /// How the robot drives and what it tells of that.
    pub base: &'static str,
    /// The LiDAR, by its maker's name.
    pub lidar: &'static str,
    /// What goes wrong: names joined by "+", or "none".
    pub fault_kind: String,
    /// The world.
    pub world: World,
    /// Everything else.
    pub config: SimulationConfig,
}

impl Scenario {
    /// The scenario of a number.
    #[must_use]
    pub fn random(seed: u64) -> Self {
        let random = &mut generator(seed, Stage::World, 101, u64::MAX);
        let kind = WorldKind::draw(random);
        let (mut config, robot) = random_robot(random, kind.is_outdoors());
        config.motion.speed_m_s = random.random_range(if kind.is_outdoors() { 0.8..1.6 } else { 0.35..1.1 });
        config.motion.turn_rate_rad_s = random.random_range(0.6..1.5);
        // Most drives take a minute to five; a few go on for kilometres.
        let minutes =
            if random.random_bool(0.03) { random.random_range(8.0..20.0) } else { random.random_range(1.0..4.5) };
        let length_m = (minutes * 60.0 * config.motion.speed_m_s).min(2000.0);
        let world = random_world(kind, seed, length_m);
        let duration_s = world.route_length_m() / config.motion.speed_m_s;
        let (faults, fault_kind) = random_faults(random, &world, duration_s);
        config.faults = faults;
        if robot.base == "no_odometry" {
            config.robot.wheels = None;
        }
        Self { seed, world_kind: kind.name(), base: robot.base, lidar: robot.lidar, fault_kind, world, config }
    }

    /// What can go wrong on a drive, as [`Scenario::with_fault`] takes it.
    pub const FAULT_KINDS: &[&str] = &random_faults::KINDS;

    /// The same drive with nothing going wrong but what `kind` is, one of [`Scenario::FAULT_KINDS`]: when and how much
    /// follows from the scenario's number. `None` for any other kind.
    #[must_use]
    pub fn with_fault(mut self, kind: &str) -> Option<Self> {
        if !Self::FAULT_KINDS.contains(&kind) {
            return None;
        }
        let random = &mut generator(self.seed, Stage::World, 103, u64::MAX);
        let duration_s = self.world.route_length_m() / self.config.motion.speed_m_s;
        self.config.faults = random_faults::draw(kind, random, &self.world, duration_s);
        kind.clone_into(&mut self.fault_kind);
        Some(self)
    }

    /// The numbers of `count` scenarios that a seed stands for.
    pub fn seeds(seed: u64, count: u64) -> impl Iterator<Item = u64> {
        // Short enough to be typed.
        (0..count).map(move |index| u64::from(generator(seed, Stage::World, 102, index).random::<u32>()))
    }

    /// The drive.
    ///
    /// # Errors
    /// A setting that cannot be simulated.
    pub fn simulate(&self) -> Result<SimulatedDrive, SimulationError> {
        simulate(self.world.clone(), self.config.clone(), self.seed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scenario_follows_from_its_number() {
        for seed in Scenario::seeds(5, 3) {
            let (a, b) = (Scenario::random(seed), Scenario::random(seed));
            assert_eq!((a.world.walls(), &a.config), (b.world.walls(), &b.config));
            let (a, b) = (a.simulate().unwrap(), b.simulate().unwrap());
            assert_eq!(a.scan(3).ranges_m, b.scan(3).ranges_m);
        }
    }

    #[test]
    fn a_scenario_can_have_any_one_fault() {
        let scenario = Scenario::random(7);
        for &kind in Scenario::FAULT_KINDS {
            let [a, b] = [&scenario, &Scenario::random(7)].map(|scenario| scenario.clone().with_fault(kind).unwrap());
            assert_eq!((&a.config, a.fault_kind.as_str()), (&b.config, kind));
            assert!(!a.config.faults.is_empty(), "{kind}");
        }
        assert!(scenario.clone().with_fault("misprint").is_none());
        let kidnapped = scenario.with_fault("kidnapping").unwrap();
        assert!(matches!(kidnapped.config.faults[..], [crate::simulator::Fault::Kidnapping { .. }]));
    }

    /// The robot drives through no wall and arrives, whatever the world: what the LiDAR sees is never inside its body.
    #[test]
    fn every_random_route_keeps_clear_of_walls() {
        for seed in Scenario::seeds(0, 60) {
            let mut scenario = Scenario::random(seed);
            let config = &mut scenario.config;
            *config = config.clone().without_noise();
            config.faults.clear();
            (config.robot.lidar.mount.x_m, config.robot.lidar.mount.y_m) = (0.0, 0.0);
            (config.lidar.beams, config.lidar.rate_hz, config.lidar.range_min_m) = (60, 1.0, 0.001);
            config.robot.lidar.sweep_duration_s = 0.0;
            config.lidar.field_of_view_rad = std::f64::consts::TAU;
            scenario.world.walkers.clear();
            let drive = scenario.simulate().unwrap();
            let kind = scenario.world_kind;
            for scan in (0..drive.scan_count()).step_by(2) {
                let nearest_m = drive.scan(scan).ranges_m.into_iter().fold(f32::INFINITY, f32::min);
                assert!(nearest_m > 0.15, "{kind} {seed}: {nearest_m} m at {:?}", drive.truth()[scan]);
            }
            let last = drive.world().route().last().unwrap().position_m;
            let end = drive.start.compose(&drive.truth().last().unwrap().pose);
            assert!((end.x - last[0]).hypot(end.y - last[1]) < 0.3, "{kind} {seed} does not arrive: {end:?}, {last:?}");
        }
    }
}

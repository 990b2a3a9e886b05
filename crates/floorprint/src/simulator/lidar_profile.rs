//! Real planar LiDARs in figures, as their makers state them.

use super::config::LidarSimulationConfig;

/// A LiDAR as its data sheet has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LidarProfile {
    /// Its name.
    pub name: &'static str,
    /// Where the figures stand.
    pub source: &'static str,
    /// Rays over the whole field of view at the rate that its data sheet calls typical.
    pub beams: usize,
    /// Angle from the first ray to the last, degrees.
    pub field_of_view_deg: f64,
    /// Scans a second; typical first, then others that it can be set to or is often thinned to.
    pub rates_hz: &'static [f64],
    /// Whether the rays of a turn are fewer the faster it turns: it measures at a fixed rate.
    pub has_fixed_sample_rate: bool,
    /// Time in which the rays of a scan are taken, seconds, at the typical rate.
    pub sweep_s: f64,
    /// Nearest range, metres.
    pub range_min_m: f64,
    /// Farthest range, metres.
    pub range_max_m: f64,
    /// Standard deviation of a range below 10 m and from there on, metres.
    pub noise_m: [f64; 2],
    /// What is added to them, as a share of the range.
    pub noise_share: f64,
    /// Limit of the systematic error, metres.
    pub bias_m: f64,
    /// Whether sunlight drowns it.
    pub is_blinded_by_sunlight: bool,
}

/// Those that the simulator knows.
pub(super) const PROFILES: [LidarProfile; 8] = [
    LidarProfile {
        name: "ld19",
        source: "LDROBOT LD19 data sheet: 4500 measurements a second, 5 to 13 Hz (10), 0.02 to 12 m at 70 %, mean ±45 mm, deviation 10 mm, 30 klx",
        beams: 450,
        field_of_view_deg: 359.2,
        rates_hz: &[10.0, 6.0],
        has_fixed_sample_rate: true,
        sweep_s: 0.1,
        range_min_m: 0.02,
        range_max_m: 12.0,
        noise_m: [0.01, 0.01],
        noise_share: 0.0,
        bias_m: 0.045,
        is_blinded_by_sunlight: true,
    },
    LidarProfile {
        name: "rplidar_c1",
        source: "Slamtec RPLIDAR C1 data sheet rev. 1.1: 5000 measurements a second, 8 to 12 Hz (10), 0.05 to 12 m at 70 %, ±30 mm, resolution 15 mm, 40 klx",
        beams: 500,
        field_of_view_deg: 359.28,
        rates_hz: &[10.0, 8.0],
        has_fixed_sample_rate: true,
        sweep_s: 0.1,
        range_min_m: 0.05,
        range_max_m: 12.0,
        noise_m: [0.015, 0.015],
        noise_share: 0.0,
        bias_m: 0.03,
        is_blinded_by_sunlight: true,
    },
    LidarProfile {
        name: "rplidar_a1",
        source: "Slamtec RPLIDAR A1 data sheet: triangulation, 360 rays a turn at 5.5 Hz (1 to 10), 0.15 to 12 m on white, below 1 % of the range",
        beams: 360,
        field_of_view_deg: 359.0,
        rates_hz: &[5.5, 8.0],
        has_fixed_sample_rate: true,
        sweep_s: 1.0 / 5.5,
        range_min_m: 0.15,
        range_max_m: 12.0,
        noise_m: [0.002, 0.002],
        noise_share: 0.006,
        bias_m: 0.01,
        is_blinded_by_sunlight: true,
    },
    LidarProfile {
        name: "urg_04lx",
        source: "Hokuyo URG-04LX specification C-42-3389: steps 44 to 725 of 1024, 600 rpm, 0.06 to 4 m, ±10 mm below 1 m, then ±1 %",
        beams: 682,
        field_of_view_deg: 239.77,
        rates_hz: &[10.0, 5.0],
        has_fixed_sample_rate: false,
        sweep_s: 0.0666,
        range_min_m: 0.06,
        range_max_m: 4.0,
        noise_m: [0.004, 0.004],
        noise_share: 0.004,
        bias_m: 0.01,
        is_blinded_by_sunlight: true,
    },
    LidarProfile {
        name: "utm_30lx",
        source: "Hokuyo UTM-30LX specification: 1081 steps of 0.25°, 25 ms, 0.1 to 30 m, ±30 mm below 10 m, then ±50 mm, repeated σ below 10 and 30 mm",
        beams: 1081,
        field_of_view_deg: 270.0,
        rates_hz: &[40.0, 20.0, 10.0],
        has_fixed_sample_rate: false,
        sweep_s: 0.01875,
        range_min_m: 0.1,
        range_max_m: 30.0,
        noise_m: [0.01, 0.03],
        noise_share: 0.0,
        bias_m: 0.02,
        is_blinded_by_sunlight: false,
    },
    LidarProfile {
        name: "tim781",
        source: "SICK TiM781 data sheet: 270° by 0.33°, 15 Hz, 0.05 to 25 m, systematic ±60 mm, statistical 20 mm, 80 klx",
        beams: 811,
        field_of_view_deg: 270.0,
        rates_hz: &[15.0, 7.5],
        has_fixed_sample_rate: false,
        sweep_s: 0.05,
        range_min_m: 0.05,
        range_max_m: 25.0,
        noise_m: [0.02, 0.02],
        noise_share: 0.0,
        bias_m: 0.06,
        is_blinded_by_sunlight: false,
    },
    LidarProfile {
        name: "lms200",
        source: "SICK LMS200 technical description: 180° by 1°, 13.3 ms a turn, 80 m, systematic ±15 mm, statistical 5 mm up to 8 m",
        beams: 181,
        field_of_view_deg: 180.0,
        rates_hz: &[5.0, 10.0, 1.4],
        has_fixed_sample_rate: false,
        sweep_s: 0.0067,
        range_min_m: 0.1,
        range_max_m: 80.0,
        noise_m: [0.005, 0.015],
        noise_share: 0.0,
        bias_m: 0.015,
        is_blinded_by_sunlight: false,
    },
    LidarProfile {
        name: "lms291",
        source: "SICK LMS291 technical description: 180° by 1°, 13.3 ms a turn, 80 m, systematic ±35 mm, statistical 10 mm up to 20 m; 180 rays as logs of CARMEN have them",
        beams: 180,
        field_of_view_deg: 179.0,
        rates_hz: &[5.0, 10.0, 1.4],
        has_fixed_sample_rate: false,
        sweep_s: 0.0067,
        range_min_m: 0.1,
        range_max_m: 80.0,
        noise_m: [0.01, 0.02],
        noise_share: 0.0,
        bias_m: 0.035,
        is_blinded_by_sunlight: false,
    },
];

impl LidarProfile {
    /// All profiles.
    #[must_use]
    pub fn all() -> &'static [Self] {
        &PROFILES
    }

    /// The simulation's settings at a rate, scans a second, without bias, mixed pixels and sunlight; and the time in
    /// which a scan is taken, seconds.
    #[must_use]
    pub fn simulation(&self, rate_hz: f64) -> (LidarSimulationConfig, f64) {
        let slowdown = if self.has_fixed_sample_rate { self.rates_hz[0] / rate_hz } else { 1.0 };
        let config = LidarSimulationConfig {
            beams: (self.beams as f64 * slowdown) as usize,
            field_of_view_rad: self.field_of_view_deg.to_radians(),
            rate_hz,
            range_min_m: self.range_min_m,
            range_max_m: self.range_max_m,
            near_noise_m: self.noise_m[0],
            far_noise_m: self.noise_m[1],
            noise_share: self.noise_share,
            short_share: 0.002,
            ..LidarSimulationConfig::default()
        };
        (config, (self.sweep_s * slowdown).min(1.0 / rate_hz))
    }
}

//! Inertial measurements.

/// One reading of an IMU, in the body's axes (x ahead, y left, z up).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuReading {
    /// Time of the reading, seconds.
    pub stamp_s: f64,
    /// Angular velocity about x, y and z, rad/s.
    pub angular_velocity_rad_s: [f64; 3],
    /// Specific force along x, y and z, m/s².
    pub linear_acceleration_m_s2: [f64; 3],
}

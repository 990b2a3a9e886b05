//! Definitions of the messages, each with those of all types in it, as MCAP wants them (`ros2msg`).

/// Puts between two definitions what MCAP's specification wants there.
macro_rules! with {
    ($own:literal $(, $name:literal: $definition:ident)* $(,)?) => {
        concat!($own $(, "================================================================================\nMSG: ", $name, "\n", $definition!())*)
    };
}

macro_rules! time {
    () => {
        "int32 sec\nuint32 nanosec\n"
    };
}

macro_rules! header {
    () => {
        "builtin_interfaces/Time stamp\nstring frame_id\n"
    };
}

macro_rules! point {
    () => {
        "float64 x\nfloat64 y\nfloat64 z\n"
    };
}

macro_rules! vector3 {
    () => {
        "float64 x\nfloat64 y\nfloat64 z\n"
    };
}

macro_rules! quaternion {
    () => {
        "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
    };
}

macro_rules! pose {
    () => {
        "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"
    };
}

macro_rules! pose_with_covariance {
    () => {
        "geometry_msgs/Pose pose\nfloat64[36] covariance\n"
    };
}

macro_rules! twist {
    () => {
        "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n"
    };
}

macro_rules! twist_with_covariance {
    () => {
        "geometry_msgs/Twist twist\nfloat64[36] covariance\n"
    };
}

macro_rules! transform {
    () => {
        "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n"
    };
}

macro_rules! transform_stamped {
    () => {
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n"
    };
}

macro_rules! map_meta_data {
    () => {
        "builtin_interfaces/Time map_load_time\nfloat32 resolution\nuint32 width\nuint32 height\ngeometry_msgs/Pose origin\n"
    };
}

macro_rules! particle {
    () => {
        "geometry_msgs/Pose pose\nfloat64 weight\n"
    };
}

macro_rules! key_value {
    () => {
        "string key\nstring value\n"
    };
}

macro_rules! diagnostic_status {
    () => {
        "byte level\nstring name\nstring message\nstring hardware_id\ndiagnostic_msgs/KeyValue[] values\n"
    };
}

/// `sensor_msgs/LaserScan`.
pub(super) const LASER_SCAN: &str = with!(
    "std_msgs/Header header\nfloat32 angle_min\nfloat32 angle_max\nfloat32 angle_increment\nfloat32 time_increment\nfloat32 scan_time\nfloat32 range_min\nfloat32 range_max\nfloat32[] ranges\nfloat32[] intensities\n",
    "std_msgs/Header": header,
    "builtin_interfaces/Time": time,
);

/// `sensor_msgs/Imu`.
pub(super) const IMU: &str = with!(
    "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\ngeometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\ngeometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance\n",
    "std_msgs/Header": header,
    "builtin_interfaces/Time": time,
    "geometry_msgs/Quaternion": quaternion,
    "geometry_msgs/Vector3": vector3,
);

/// `nav_msgs/Odometry`.
pub(super) const ODOMETRY: &str = with!(
    "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist\n",
    "std_msgs/Header": header,
    "builtin_interfaces/Time": time,
    "geometry_msgs/PoseWithCovariance": pose_with_covariance,
    "geometry_msgs/Pose": pose,
    "geometry_msgs/Point": point,
    "geometry_msgs/Quaternion": quaternion,
    "geometry_msgs/TwistWithCovariance": twist_with_covariance,
    "geometry_msgs/Twist": twist,
    "geometry_msgs/Vector3": vector3,
);

/// `tf2_msgs/TFMessage`.
pub(super) const TF_MESSAGE: &str = with!(
    "geometry_msgs/TransformStamped[] transforms\n",
    "geometry_msgs/TransformStamped": transform_stamped,
    "std_msgs/Header": header,
    "builtin_interfaces/Time": time,
    "geometry_msgs/Transform": transform,
    "geometry_msgs/Vector3": vector3,
    "geometry_msgs/Quaternion": quaternion,
);

/// `geometry_msgs/PoseWithCovarianceStamped`.
pub(super) const POSE_WITH_COVARIANCE: &str = with!(
    "std_msgs/Header header\ngeometry_msgs/PoseWithCovariance pose\n",
    "std_msgs/Header": header,
    "builtin_interfaces/Time": time,
    "geometry_msgs/PoseWithCovariance": pose_with_covariance,
    "geometry_msgs/Pose": pose,
    "geometry_msgs/Point": point,
    "geometry_msgs/Quaternion": quaternion,
);

/// `nav2_msgs/ParticleCloud`.
pub(super) const PARTICLE_CLOUD: &str = with!(
    "std_msgs/Header header\nnav2_msgs/Particle[] particles\n",
    "std_msgs/Header": header,
    "builtin_interfaces/Time": time,
    "nav2_msgs/Particle": particle,
    "geometry_msgs/Pose": pose,
    "geometry_msgs/Point": point,
    "geometry_msgs/Quaternion": quaternion,
);

/// `nav_msgs/OccupancyGrid`.
pub(super) const OCCUPANCY_GRID: &str = with!(
    "std_msgs/Header header\nnav_msgs/MapMetaData info\nint8[] data\n",
    "std_msgs/Header": header,
    "builtin_interfaces/Time": time,
    "nav_msgs/MapMetaData": map_meta_data,
    "geometry_msgs/Pose": pose,
    "geometry_msgs/Point": point,
    "geometry_msgs/Quaternion": quaternion,
);

/// `nav_msgs/MapMetaData`.
pub(super) const MAP_META_DATA: &str = with!(
    "builtin_interfaces/Time map_load_time\nfloat32 resolution\nuint32 width\nuint32 height\ngeometry_msgs/Pose origin\n",
    "builtin_interfaces/Time": time,
    "geometry_msgs/Pose": pose,
    "geometry_msgs/Point": point,
    "geometry_msgs/Quaternion": quaternion,
);

/// `map_msgs/OccupancyGridUpdate`.
pub(super) const OCCUPANCY_GRID_UPDATE: &str = with!(
    "std_msgs/Header header\nint32 x\nint32 y\nuint32 width\nuint32 height\nint8[] data\n",
    "std_msgs/Header": header,
    "builtin_interfaces/Time": time,
);

/// `diagnostic_msgs/DiagnosticArray`.
pub(super) const DIAGNOSTICS: &str = with!(
    "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status\n",
    "std_msgs/Header": header,
    "builtin_interfaces/Time": time,
    "diagnostic_msgs/DiagnosticStatus": diagnostic_status,
    "diagnostic_msgs/KeyValue": key_value,
);

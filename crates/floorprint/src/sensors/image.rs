//! Images of an RGB-D camera.

/// A depth image as the camera stores it.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthImage {
    /// Time of the image, seconds.
    pub stamp_s: f64,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Raw values, row by row from the top left: disparities of the course's Kinect, else depths in millimetres along
    /// the optical axis with 0 where nothing was measured. The robot's calibration says which.
    pub values: Vec<u16>,
}

/// A colour image.
#[derive(Debug, Clone, PartialEq)]
pub struct ColorImage {
    /// Time of the image, seconds.
    pub stamp_s: f64,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Red, green and blue of each pixel, row by row from the top left.
    pub rgb: Vec<[u8; 3]>,
}

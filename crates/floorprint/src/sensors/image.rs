//! Images of an RGB-D camera.

/// A disparity image as the Kinect's driver stores it.
#[derive(Debug, Clone, PartialEq)]
pub struct DisparityImage {
    /// Time of the image, seconds.
    pub stamp_s: f64,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Raw disparity units, row by row from the top left.
    pub disparity: Vec<u16>,
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

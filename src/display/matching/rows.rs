//! The pictures that are compared, and the disparities under which they are.

/// Disparities that are compared, evenly from 0 to 255.
pub(super) const LEVELS: usize = 32;

/// A cost of 1, the mean squared difference of a pixel's bytes, in whole numbers.
pub(super) const COST_UNIT: i16 = 4;

/// The value for each level.
pub(super) type Levels = [i16; LEVELS];

/// A view beside a picture.
#[derive(Clone, Copy, Debug)]
pub struct SideView<'a> {
    /// The place of its eye, eye separations to the right of the picture's.
    pub eye: f64,
    /// Red, green, blue and coverage, in rows from the top: a ray for every second pixel of every
    /// second row of the picture.
    pub color: &'a [[u8; 4]],
}

/// A picture in rows.
pub(super) struct Rows<'a> {
    pub(super) width: usize,
    pub(super) color: &'a [[u8; 4]],
    /// The disparity of each pixel's ray.
    pub(super) rays: &'a [u8],
}

impl Rows<'_> {
    pub(super) fn height(&self) -> usize {
        self.color.len() / self.width
    }

    /// A row of the picture.
    pub(super) fn row(&self, y: usize) -> &[[u8; 4]] {
        &self.color[y * self.width..][..self.width]
    }
}

//! How near each pixel of a picture is, without unit.

/// Closeness of every pixel, in rows from the top left: 0 for the background, 1 for the nearest
/// surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Closeness {
    size_px: [u32; 2],
    values: Vec<f32>,
}

impl Closeness {
    /// Values of 0 to 1 for every pixel; values outside are clamped. `None` where they do not fill
    /// the size.
    #[must_use]
    pub fn new(size_px: [u32; 2], mut values: Vec<f32>) -> Option<Self> {
        let expected = u64::from(size_px[0]) * u64::from(size_px[1]);
        if values.len() as u64 != expected || expected == 0 {
            return None;
        }
        values.iter_mut().for_each(|value| *value = value.clamp(0.0, 1.0));
        Some(Self { size_px, values })
    }

    /// Width and height, pixels.
    #[must_use]
    pub const fn size_px(&self) -> [u32; 2] {
        self.size_px
    }

    /// The value of every pixel.
    #[must_use]
    pub fn values(&self) -> &[f32] {
        &self.values
    }
}

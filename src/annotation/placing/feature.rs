//! The features to which points snap.

/// The feature to which a point snaps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SnapFeature {
    /// Where the values cross a level.
    Surface {
        /// The level, HU: -32768 to 32767.
        hu: f64,
    },
    /// Where the values cross the level halfway between the two kinds of matter that are around (N.
    /// Otsu, "A threshold selection method from gray-level histograms", 1979).
    Boundary,
    /// Where the gradient is steepest along its own direction. Of several such edges the one with
    /// the largest magnitude times 1 - (distance/radius)² counts; the place is the nearest on it.
    Gradient,
    /// The nearest local minimum that stands out at least half as far from the mean around as the
    /// deepest one.
    Minimum,
    /// The nearest local maximum that stands out at least half as far from the mean around as the
    /// highest one.
    Maximum,
}

/// The feature in words, as in "no edge within 5 mm".
impl std::fmt::Display for SnapFeature {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Surface { hu } => write!(f, "surface of {hu} HU"),
            Self::Boundary => f.write_str("boundary between two kinds of matter"),
            Self::Gradient => f.write_str("edge"),
            Self::Minimum => f.write_str("local minimum"),
            Self::Maximum => f.write_str("local maximum"),
        }
    }
}

//! The patient's point that lies on the plane of the screen.
//!
//! A display of several views is sharpest on the plane of the screen. Spaces: patient LPS in mm;
//! view depth in mm.

use relief_base::{DepthLimits, ScaledDepth};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// The point of interest, which depth limits put on the plane of the screen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ScreenPlane {
    /// `"cursor"`: the cursor of a live view, where it has one.
    Cursor,
    /// `[x, y, z]`: a point, patient mm.
    PointMm([f64; 3]),
}

/// The word for the cursor in requests.
const CURSOR: &str = "cursor";

impl Serialize for ScreenPlane {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Cursor => serializer.serialize_str(CURSOR),
            Self::PointMm(point) => point.serialize(serializer),
        }
    }
}

/// By hand, so that a refusal names the allowed values.
impl<'de> Deserialize<'de> for ScreenPlane {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged)]
        enum Written {
            Word(String),
            PointMm([f64; 3]),
        }
        match Written::deserialize(deserializer) {
            Ok(Written::Word(word)) if word == CURSOR => Ok(Self::Cursor),
            Ok(Written::PointMm(point)) => Ok(Self::PointMm(point)),
            _ => Err(serde::de::Error::custom("expected a point [x, y, z] in mm, \"cursor\" or null")),
        }
    }
}

/// The narrowest limits that hold the same surfaces and have a view depth on the plane of the
/// screen, which lies at `screen`. A depth before or behind the surfaces counts as the nearest or
/// the farthest of them.
#[must_use]
pub(crate) fn limits_around(limits: DepthLimits, depth_mm: f64, screen: ScaledDepth) -> DepthLimits {
    let DepthLimits { near_mm, far_mm } = limits;
    let depth_mm = depth_mm.clamp(near_mm, far_mm);
    let extent = ((depth_mm - near_mm) / screen.0).max((far_mm - depth_mm) / (1.0 - screen.0));
    let near = depth_mm - screen.0 * extent;
    DepthLimits::new(near, near + extent).unwrap_or(limits)
}

#[cfg(test)]
mod tests {
    use super::*;
    use relief_base::ViewDepth;

    #[test]
    fn a_point_lies_on_the_screen_and_all_surfaces_between_the_limits() {
        let limits = DepthLimits::new(500.0, 800.0).unwrap();
        for screen in [0.46, 0.5, 0.1, 0.9] {
            for depth_mm in [500.0, 560.0, 638.0, 799.0] {
                let found = limits_around(limits, depth_mm, ScaledDepth(screen));
                let z = found.scaled(ViewDepth(depth_mm as f32)).0;
                assert!((z - screen).abs() < 1e-6, "{depth_mm} mm lies at {z}, not at {screen}");
                assert!(found.near_mm <= 500.0 + 1e-9 && found.far_mm >= 800.0 - 1e-9, "{found:?}");
                let is_tight = (found.near_mm - 500.0).abs() < 1e-9 || (found.far_mm - 800.0).abs() < 1e-9;
                assert!(is_tight, "{found:?} is wider than it has to be");
            }
        }
        // A point far behind does not flatten the visible part.
        let behind = limits_around(limits, 5000.0, ScaledDepth(0.5));
        assert_eq!(behind, limits_around(limits, 800.0, ScaledDepth(0.5)));
    }

    #[test]
    fn the_json_form_is_a_point_or_the_cursor() {
        for (json, expected) in
            [("\"cursor\"", ScreenPlane::Cursor), ("[1.0,2.0,3.5]", ScreenPlane::PointMm([1.0, 2.0, 3.5]))]
        {
            let read: ScreenPlane = serde_json::from_str(json).unwrap();
            assert_eq!((read, serde_json::to_string(&read).unwrap().as_str()), (expected, json));
        }
        for json in ["\"landmark\"", "[1, 2]", "7", "{}"] {
            let refused = serde_json::from_str::<ScreenPlane>(json).unwrap_err().to_string();
            assert!(refused.contains("[x, y, z]") && refused.contains("cursor"), "{json}: {refused}");
        }
    }
}

//! Panels with slanted lenses, and the files that describe them.
//!
//! Lengths are pixels of the panel, places (x, y) from its top left corner.

use super::cone::{USUAL_VIEW_CONE_DEG, check_cone};
use relief_base::OutOfRange;
use serde::{Deserialize, Serialize};

/// Pixels from lens to lens that make sense: below one there is no room for two views.
const PITCHES_PX: std::ops::RangeInclusive<f64> = 1.0..=1000.0;
const SLANTS: std::ops::RangeInclusive<f64> = -10.0..=10.0;
const CENTERS: std::ops::RangeInclusive<f64> = -1e4..=1e4;

/// How the lenses of a panel lie over its pixels.
///
/// A point at (x, y) is at `fract((x + y slant) / pitch - center)` behind its lens, from 0 to 1, and
/// shows the view with that share of the views on its left; the right one if `is_reversed`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LensPanel {
    /// Pixels from lens to lens along a line.
    pub pitch_px: f64,
    /// The shift of a lens to the left from one line to the next, pixels.
    #[serde(default)]
    pub slant: f64,
    /// The start of a lens at the top left corner, in lenses.
    #[serde(default)]
    pub center: f64,
    /// The order of red, green and blue within a pixel.
    #[serde(default)]
    pub subpixels: Subpixels,
    /// Whether the views behind a lens go from right to left.
    #[serde(default)]
    pub is_reversed: bool,
    /// The view cone, degrees; `None` leaves it to the settings.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub view_cone_deg: Option<f64>,
}

/// The order of the thirds of a pixel, from the left.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Subpixels {
    /// Red, green, blue.
    #[default]
    Rgb,
    /// Blue, green, red.
    Bgr,
}

/// A file that describes no panel.
#[derive(Debug, thiserror::Error)]
pub enum PanelError {
    /// It is neither form of JSON.
    #[error(
        "the file describes no panel: {0}; allowed: pitch_px with slant, center, subpixels, is_reversed and \
         view_cone_deg, or the calibration of a Looking Glass"
    )]
    Format(#[from] serde_json::Error),
    /// A value is out of range.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// The panel has its own pattern of subpixels.
    #[error(
        "the calibration has subpixelCells, a pattern of its own for red, green and blue; only panels with \
         stripes of red, green and blue are supported"
    )]
    SubpixelCells,
    /// The panel is mounted upside down.
    #[error("the calibration sets flipImageY, which turns pictures upside down; this is not supported")]
    FlippedRows,
}

impl Default for LensPanel {
    /// Lenses over five pixels, slanted by a third of a pixel a line: a common panel.
    fn default() -> Self {
        Self {
            pitch_px: 5.0,
            slant: 0.333,
            center: 0.0,
            subpixels: Subpixels::Rgb,
            is_reversed: false,
            view_cone_deg: None,
        }
    }
}

impl LensPanel {
    /// Reads the description of a panel: its keys as JSON, or the calibration file of a Looking
    /// Glass (`visual.json`).
    ///
    /// # Errors
    /// When the file is neither, or a value is out of range.
    pub fn from_json(file: &[u8]) -> Result<Self, PanelError> {
        let value: serde_json::Value = serde_json::from_slice(file)?;
        let panel = if value.get("serial").is_some() || value.get("configVersion").is_some() {
            LookingGlass::deserialize(&value)?.panel()?
        } else {
            Self::deserialize(&value)?
        };
        panel.check()?;
        Ok(panel)
    }

    /// Whether every value is in range.
    ///
    /// # Errors
    /// The first value that is not.
    pub fn check(&self) -> Result<(), OutOfRange> {
        let values = [
            ("pitch_px", self.pitch_px, PITCHES_PX),
            ("slant", self.slant, SLANTS),
            ("center", self.center, CENTERS),
        ];
        match values.into_iter().find(|(_, value, allowed)| !allowed.contains(value)) {
            Some((key, value, allowed)) => {
                let allowed = format!("{} to {}", allowed.start(), allowed.end());
                Err(OutOfRange::new(key, value, allowed))
            }
            None => self.view_cone_deg.map_or(Ok(()), |cone_deg| check_cone("view_cone_deg", cone_deg)),
        }
    }

    /// The views, of `count`, that red, green and blue of a pixel show.
    pub(super) fn views_at(&self, [x, y]: [usize; 2], count: usize) -> [usize; 3] {
        let thirds = match self.subpixels {
            Subpixels::Rgb => [0.5, 1.5, 2.5],
            Subpixels::Bgr => [2.5, 1.5, 0.5],
        };
        thirds.map(|third| {
            let lenses = (x as f64 + third / 3.0 + y as f64 * self.slant) / self.pitch_px - self.center;
            let view = (((lenses - lenses.floor()) * count as f64) as usize).min(count - 1);
            if self.is_reversed { count - 1 - view } else { view }
        })
    }
}

/// A number in a calibration file.
#[derive(Clone, Copy, Debug, Deserialize)]
struct Value {
    value: f64,
}

/// The calibration of a Looking Glass. Pitch is lenses an inch across them, slope the lines to a
/// pixel of slant, centre in lenses at the bottom left corner.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct LookingGlass {
    pitch: Value,
    slope: Value,
    center: Value,
    #[serde(rename = "DPI")]
    dots_per_inch: Value,
    screen_h: Value,
    #[serde(default)]
    view_cone: Option<Value>,
    #[serde(default)]
    inv_view: Option<Value>,
    #[serde(default)]
    flip_image_x: Option<Value>,
    #[serde(default)]
    flip_image_y: Option<Value>,
    #[serde(default)]
    flip_subp: Option<Value>,
    #[serde(default)]
    subpixel_cells: Vec<serde_json::Value>,
}

impl LookingGlass {
    /// Its lenses. The manufacturer's shader (`holoplay-core` 0.0.11) takes, at (u, v) from the
    /// bottom left, each from 0 to 1, for red, green and blue i = 0, 1, 2,
    /// `1 - fract((u + i / (3 W) + v tilt) pitch W / DPI cos(atan(1 / slope)) - center)` with
    /// `tilt = H / (W slope)`.
    fn panel(&self) -> Result<LensPanel, PanelError> {
        if !self.subpixel_cells.is_empty() {
            return Err(PanelError::SubpixelCells);
        }
        let is_set = |value: Option<Value>, usual: bool| value.map_or(usual, |value| value.value != 0.0);
        if is_set(self.flip_image_y, false) {
            return Err(PanelError::FlippedRows);
        }
        let mirror = if is_set(self.flip_image_x, false) { -1.0 } else { 1.0 };
        let slant_up = mirror / self.slope.value;
        let pitch_px = self.dots_per_inch.value / (self.pitch.value * (1.0 / self.slope.value).atan().cos());
        // Their red is in the middle of a pixel, v begins at the lower edge of the panel.
        let shift_px = 1.0 / 3.0 + (self.screen_h.value - 0.5) * slant_up;
        Ok(LensPanel {
            pitch_px,
            slant: -slant_up,
            center: (self.center.value - shift_px / pitch_px).rem_euclid(1.0),
            subpixels: if is_set(self.flip_subp, false) { Subpixels::Bgr } else { Subpixels::Rgb },
            is_reversed: is_set(self.inv_view, true),
            view_cone_deg: Some(self.view_cone.map_or(USUAL_VIEW_CONE_DEG, |cone| cone.value)),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The shader of `holoplay-core` 0.0.11 for the view at a third of a pixel, in f64.
    fn vendor(
        pitch: f64,
        slope: f64,
        center: f64,
        [w, h]: [f64; 2],
        dpi: f64,
        at: [usize; 3],
        count: usize,
    ) -> usize {
        let tilt = h / (w * slope);
        let pitch = pitch * w / dpi * (1.0 / slope).atan().cos();
        let (u, v) = ((at[0] as f64 + 0.5) / w, 1.0 - (at[1] as f64 + 0.5) / h);
        let lenses = (u + at[2] as f64 / (3.0 * w) + v * tilt) * pitch - center;
        ((1.0 - (lenses - lenses.floor())).clamp(0.00001, 0.999_999) * count as f64) as usize
    }

    #[test]
    fn the_calibration_of_a_looking_glass_gives_the_views_of_its_own_shader() {
        for (pitch, slope, center, size, dpi) in
            [(47.57, -5.44, 0.041, [2560.0, 1600.0], 338.0), (52.6, -7.19, 0.5, [1536.0, 2048.0], 324.0)]
        {
            let [w, h] = size;
            let file = serde_json::json!({
                "configVersion": "1.0", "serial": "LKG-2K-00000", "pitch": {"value": pitch}, "slope": {"value": slope},
                "center": {"value": center}, "viewCone": {"value": 40.0}, "invView": {"value": 1},
                "DPI": {"value": dpi}, "screenW": {"value": w}, "screenH": {"value": h},
                "flipImageX": {"value": 0}, "flipImageY": {"value": 0}, "flipSubp": {"value": 0}
            });
            let panel = LensPanel::from_json(file.to_string().as_bytes()).unwrap();
            let mut different = 0;
            for at in
                (0..w as usize).step_by(7).flat_map(|x| (0..h as usize).step_by(13).map(move |y| [x, y]))
            {
                let views = panel.views_at(at, 45);
                for (third, view) in views.into_iter().enumerate() {
                    different +=
                        u32::from(view != vendor(pitch, slope, center, size, dpi, [at[0], at[1], third], 45));
                }
            }
            // Rounding at the edge between two views.
            assert!(different < 20, "{different}");
        }
    }

    #[test]
    fn views_repeat_with_the_lenses_and_go_left_with_the_slant() {
        let panel = LensPanel { pitch_px: 3.0, slant: 1.0, ..LensPanel::default() };
        // A lens over three pixels and nine views: one view to a third of a pixel.
        assert_eq!(panel.views_at([0, 0], 9), [0, 1, 2]);
        assert_eq!(panel.views_at([2, 0], 9), [6, 7, 8]);
        assert_eq!(panel.views_at([3, 0], 9), [0, 1, 2]);
        assert_eq!(panel.views_at([0, 1], 9), [3, 4, 5]);
        let reversed = LensPanel { is_reversed: true, subpixels: Subpixels::Bgr, ..panel };
        assert_eq!(reversed.views_at([0, 0], 9), [6, 7, 8]);
    }

    #[test]
    fn files_that_describe_no_panel_are_refused_with_the_reason() {
        let refused = |text: &str| LensPanel::from_json(text.as_bytes()).unwrap_err().to_string();
        assert!(refused("{}").contains("missing field `pitch_px`"), "{}", refused("{}"));
        assert!(refused(r#"{"pitch_px": 0.5}"#).starts_with("pitch_px is 0.5, allowed: 1 to 1000"));
        assert!(refused(r#"{"pitch_px": 5, "tilt": 1}"#).contains("unknown field `tilt`"));
        assert!(refused(r#"{"serial": "x"}"#).contains("missing field `pitch`"));
        let cells = r#"{"serial": "x", "pitch": {"value": 45}, "slope": {"value": -5}, "center": {"value": 0}, "DPI": {"value": 324},
            "screenH": {"value": 2048}, "subpixelCells": [{}]}"#;
        assert!(refused(cells).contains("subpixelCells"));
        let turned = cells.replace(r#""subpixelCells": [{}]"#, r#""flipImageY": {"value": 1}"#);
        assert!(refused(&turned).contains("flipImageY"), "{}", refused(&turned));
        let flat = cells.replace("-5", "0").replace("[{}]", "[]");
        assert!(refused(&flat).contains("allowed"), "{}", refused(&flat));
    }
}

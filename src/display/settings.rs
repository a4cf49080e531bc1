//! The `display` object of a render request: display, layout, header settings and depth limits.
//!
//! The JSON and its validation. [`DisplaySettings::encoder`] makes the encoder that packs frames.
//! Depth limits are view depth in mm.

use serde::de::{self, MapAccess, Visitor, value::MapAccessDeserializer};
use serde::{Deserialize, Deserializer, Serialize};

use super::depth_range::DepthRange;
use super::filter::DepthFilter;
use super::header::{ContentType, Header};
use super::layout::FrameEncoder;
use super::profile::{DisparityConstants, DisplayProfile, ProfileError, ProfileName, VZ_RANGE};
use crate::layout::error::LayoutError;
use crate::layout::table::Layout;
use crate::screen_plane::{ScreenPlane, limits_around};
use crate::views::{LensPanel, check_cone};
use relief_base::{DepthLimits, OutOfRange, ScaledDepth};

/// Eye separations between the outermost views. 0 gives equal views; 60 is a cone of about 50 degrees.
pub const VIEW_SPANS: std::ops::RangeInclusive<f64> = 0.0..=60.0;

/// How a picture becomes a frame. Every key has a default; unknown keys are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DisplaySettings {
    /// The display; `null` is the usual one of the layout: `dimenco-4k` for `wowvx-4k`, else
    /// `philips-42`.
    pub profile: Option<ProfileSetting>,
    /// The layout of picture and depth in the frame.
    pub layout: Layout,
    /// Kind of content, for the header.
    pub content: ContentType,
    /// Depth effect, 0..=255; 64 is 100 % of the display's recommendation. Any other value also
    /// sets the header's factor-select bit, without which displays use their own optimum.
    #[serde(deserialize_with = "byte")]
    pub factor: u8,
    /// Disparity on the screen plane, 0..=255. Any value but 128 also sets the header's
    /// offset-select bit.
    #[serde(deserialize_with = "byte")]
    pub offset: u8,
    /// Eye separations between the outermost views of layouts of views, 0 to 60; `null` is 1 for
    /// two views and 2 for more.
    pub view_span: Option<f64>,
    /// The angle between the cameras of the outermost views, seen from the middle of the screen,
    /// degrees, 0 to 90. It replaces `view_span`. `null` is the view cone of the panel, if it has one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub view_cone_deg: Option<f64>,
    /// The lenses of the panel that layouts `lenses-N` are for; `null` is a common panel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub panel: Option<LensPanel>,
    /// The filter of depth before it becomes Z or D. Picks and depth in mm are never filtered.
    pub depth_filter: DepthFilter,
    /// The rule for the limits below where they are `null`.
    pub depth_range: DepthRange,
    /// The point on the plane of the screen; `null` leaves that to the limits.
    pub screen_plane: Option<ScreenPlane>,
    /// View depth that becomes Z = 0, mm.
    pub near_mm: Option<f64>,
    /// View depth that becomes Z = 1, mm.
    pub far_mm: Option<f64>,
}

/// The display of a request: a name, its viewing distance, or all constants.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ProfileSetting {
    /// `"philips-42"`
    Named(ProfileName),
    /// `{"vz": 7.6}`: the constants follow by the one-parameter family.
    Custom {
        /// Zd, vz, M and C.
        constants: DisparityConstants,
        /// The frame; `None` is the usual one of the layout.
        frame_px: Option<[u32; 2]>,
        /// The sub-image; `None` is the layout's half of the frame.
        sub_image_px: Option<[u32; 2]>,
    },
}

impl Default for DisplaySettings {
    fn default() -> Self {
        let Header { content, factor, offset, .. } = Header::default();
        Self {
            profile: None,
            layout: Layout::default(),
            content,
            factor,
            offset,
            view_span: None,
            view_cone_deg: None,
            panel: None,
            depth_filter: DepthFilter::default(),
            depth_range: DepthRange::default(),
            screen_plane: None,
            near_mm: None,
            far_mm: None,
        }
    }
}

impl DisplaySettings {
    /// The first setting that is out of range or does not fit the others, if there is one.
    ///
    /// # Errors
    /// The invalid setting with its path, its value and the permitted values.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        for (path, limit) in [("display.near_mm", self.near_mm), ("display.far_mm", self.far_mm)] {
            if let Some(mm) = limit.filter(|mm| !mm.is_finite()) {
                return Err(OutOfRange::new(path, mm, "a finite number or null"));
            }
        }
        if let (Some(near), Some(far)) = (self.near_mm, self.far_mm) {
            checked_limits(near, far)?;
        }
        self.validate_screen_plane()?;
        self.validate_views()?;
        if let Some(panel) = self.panel {
            panel.check().map_err(|error| error.within("display.panel"))?;
        }
        self.encoder().map(|_| ())
    }

    fn validate_views(&self) -> Result<(), OutOfRange> {
        if let Some(span) = self.view_span.filter(|span| !VIEW_SPANS.contains(span)) {
            let allowed = format!("{} to {} eye separations, or null", VIEW_SPANS.start(), VIEW_SPANS.end());
            return Err(OutOfRange::new("display.view_span", span, allowed));
        }
        if let Some(cone_deg) = self.view_cone_deg {
            check_cone("display.view_cone_deg", cone_deg)?;
            if let Some(span) = self.view_span {
                let allowed = "null beside view_cone_deg, which is another way to say it";
                return Err(OutOfRange::new("display.view_span", span, allowed));
            }
        }
        Ok(())
    }

    /// The view cone of these settings or of their panel, degrees; `None` if eye separations count.
    #[must_use]
    pub fn view_cone(&self) -> Option<f64> {
        let of_panel = || match (self.layout, self.view_span) {
            (Layout::Lenses(_), None) => self.panel.and_then(|panel| panel.view_cone_deg),
            _ => None,
        };
        self.view_cone_deg.or_else(of_panel)
    }

    fn validate_screen_plane(&self) -> Result<(), OutOfRange> {
        let path = "display.screen_plane";
        let Some(plane) = self.screen_plane else { return Ok(()) };
        if let ScreenPlane::PointMm(point) = plane
            && !point.iter().all(|mm| (-1e6..=1e6).contains(mm))
        {
            return Err(OutOfRange::new(path, format_args!("{point:?}"), "-1000000 to 1000000 mm each"));
        }
        if self.near_mm.is_some() || self.far_mm.is_some() {
            return Err(OutOfRange::new(
                path,
                "set",
                "null beside near_mm and far_mm, which place the screen themselves",
            ));
        }
        Ok(())
    }

    /// These settings with the cursor of a view, patient mm, in place of the word. Without a cursor the
    /// limits place the screen.
    #[must_use]
    pub fn with_cursor(&self, cursor_mm: Option<[f64; 3]>) -> Self {
        match self.screen_plane {
            Some(ScreenPlane::Cursor) => {
                Self { screen_plane: cursor_mm.map(ScreenPlane::PointMm), ..self.clone() }
            }
            _ => self.clone(),
        }
    }

    /// The settings that decide which disparity a depth has, and the default ones in place of the
    /// others. Frames of other layouts on the same display have equal ones.
    #[must_use]
    pub fn of_depth(&self) -> Self {
        let profile = self.profile.unwrap_or(ProfileSetting::Named(self.usual_profile()));
        Self {
            profile: Some(profile),
            layout: Layout::Rgbd, // it fits every profile
            content: Header::default().content,
            view_span: None,
            view_cone_deg: None,
            panel: None,
            depth_filter: DepthFilter::default(),
            ..self.clone()
        }
    }

    /// The display where the settings name none.
    fn usual_profile(&self) -> ProfileName {
        match self.layout {
            Layout::Wowvx4k => ProfileName::Dimenco4k,
            _ => ProfileName::Philips42,
        }
    }

    /// The display that the settings name.
    ///
    /// # Errors
    /// When a constant or size of it is out of range.
    pub fn profile(&self) -> Result<DisplayProfile, OutOfRange> {
        match self.profile.unwrap_or(ProfileSetting::Named(self.usual_profile())) {
            ProfileSetting::Named(name) => Ok(DisplayProfile::named(name)),
            ProfileSetting::Custom { constants, frame_px, sub_image_px } => {
                let frame_px = frame_px.unwrap_or(self.layout.usual_frame_px());
                let sub_image_px = sub_image_px.unwrap_or_else(|| usual_sub_image(self.layout, frame_px));
                DisplayProfile::new(frame_px, sub_image_px, constants)
                    .map_err(|error| profile_refusal(&error))
            }
        }
    }

    /// The header that frames carry.
    #[must_use]
    pub fn header(&self) -> Header {
        let usual = Header::default();
        Header {
            content: self.content,
            factor: self.factor,
            offset: self.offset,
            use_factor: self.factor != usual.factor,
            use_offset: self.offset != usual.offset,
            extended: usual.extended,
        }
    }

    /// The encoder for these settings; it says at which size to render.
    ///
    /// # Errors
    /// When the profile is out of range or does not fit the layout.
    pub fn encoder(&self) -> Result<FrameEncoder, OutOfRange> {
        let encoder = FrameEncoder::new(self.layout, self.profile()?, self.header());
        encoder
            .map(|encoder| encoder.with_depth_filter(self.depth_filter).with_view_span(self.view_span))
            .map(|encoder| encoder.with_panel(self.panel.unwrap_or_default()))
            .map_err(|error| match error {
                LayoutError::Profile { remedy, frame_px: [w, h], .. } => {
                    let found = format!("for frames of {w}x{h}");
                    OutOfRange::new("display.profile", found, format!("for {}: {remedy}", self.layout))
                }
                other => OutOfRange::new(
                    "display.layout",
                    self.layout,
                    format!("layouts that fit the profile ({other})"),
                ),
            })
    }

    /// The limits between which depth is scaled: the request's, and the volume's where the request
    /// has `null`.
    ///
    /// # Errors
    /// When near is not below far, or one is not finite.
    pub fn limits(&self, of_volume: DepthLimits) -> Result<DepthLimits, OutOfRange> {
        checked_limits(self.near_mm.unwrap_or(of_volume.near_mm), self.far_mm.unwrap_or(of_volume.far_mm))
    }

    /// As [`DisplaySettings::limits`], with those of the visible surfaces, where there are any, if the
    /// range is that. A limit of the request that contradicts these is held against the volume's.
    /// `depth_of` gives the view depth of a point, patient mm, for the plane of the screen.
    ///
    /// # Errors
    /// As [`DisplaySettings::limits`].
    pub fn limits_between(
        &self,
        of_volume: DepthLimits,
        visible: impl FnOnce() -> Option<DepthLimits>,
        depth_of: impl FnOnce([f64; 3]) -> f64,
    ) -> Result<DepthLimits, OutOfRange> {
        let of_request = self.limits(of_volume)?;
        let follows =
            self.depth_range == DepthRange::Visible && (self.near_mm.is_none() || self.far_mm.is_none());
        let visible = follows.then(visible).flatten().and_then(|visible| self.limits(visible).ok());
        let limits = visible.unwrap_or(of_request);
        let Some(ScreenPlane::PointMm(point)) = self.screen_plane else { return Ok(limits) };
        let screen = self.profile()?.constants().zd;
        Ok(limits_around(limits, depth_of(point), ScaledDepth(screen)))
    }
}

fn checked_limits(near: f64, far: f64) -> Result<DepthLimits, OutOfRange> {
    DepthLimits::new(near, far).ok_or_else(|| {
        OutOfRange::new("display.near_mm", near, format!("finite and below the far limit ({far} mm)"))
    })
}

fn profile_refusal(error: &ProfileError) -> OutOfRange {
    let size = |[w, h]: [u32; 2]| format!("{w}x{h}");
    let (path, value): (_, String) = match error {
        ProfileError::ViewingDistance(vz) | ProfileError::ViewerInside { vz, .. } => {
            ("display.profile.vz", vz.to_string())
        }
        ProfileError::DisplayPlane(zd) => ("display.profile.zd", zd.to_string()),
        ProfileError::Slope(m) => ("display.profile.m", m.to_string()),
        ProfileError::ScreenDisparity(c) => ("display.profile.c", c.to_string()),
        ProfileError::Size { what: "frame_px", size_px } => ("display.profile.frame_px", size(*size_px)),
        ProfileError::Size { size_px, .. } => ("display.profile.sub_image_px", size(*size_px)),
    };
    let message = error.to_string();
    let allowed = message.split_once("allowed: ").map_or(message.as_str(), |(_, allowed)| allowed);
    OutOfRange::new(path, value, allowed)
}

/// The layout's half of a frame.
fn usual_sub_image(layout: Layout, [width, height]: [u32; 2]) -> [u32; 2] {
    match layout {
        Layout::WowvxFullHeight | Layout::Wowvx4k => [width / 2, height],
        _ => [width / 2, height / 2],
    }
}

/// A whole number 0..=255, with a message that says so.
fn byte<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u8, D::Error> {
    let value = f64::deserialize(deserializer)?;
    if value.fract() != 0.0 || !(0.0..=255.0).contains(&value) {
        return Err(de::Error::custom(format!("{value} is out of range; allowed: whole numbers 0 to 255")));
    }
    Ok(value as u8)
}

/// Two whole numbers of pixels, which JSON may also write as `3.0`.
fn sides_px<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<[u32; 2]>, D::Error> {
    let Some(sides) = Option::<[f64; 2]>::deserialize(deserializer)? else { return Ok(None) };
    let is_whole = |side: f64| side.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&side);
    match sides.into_iter().find(|side| !is_whole(*side)) {
        Some(wrong) => Err(de::Error::custom(format!("{wrong} is no whole number of 0 to {}", u32::MAX))),
        None => Ok(Some(sides.map(|side| side as u32))),
    }
}

/// The object form of a profile: `vz` alone, or all four constants; sizes are optional.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CustomProfile {
    vz: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    zd: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    m: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    c: Option<f64>,
    #[serde(default, deserialize_with = "sides_px", skip_serializing_if = "Option::is_none")]
    frame_px: Option<[u32; 2]>,
    #[serde(default, deserialize_with = "sides_px", skip_serializing_if = "Option::is_none")]
    sub_image_px: Option<[u32; 2]>,
}

/// Why a profile's object is refused.
#[derive(Debug, thiserror::Error)]
enum CustomProfileError {
    #[error("a profile has vz alone, or all of zd, vz, m and c")]
    Keys,
    #[error(transparent)]
    Constants(#[from] ProfileError),
}

impl CustomProfile {
    fn setting(self) -> Result<ProfileSetting, CustomProfileError> {
        let Self { vz, zd, m, c, frame_px, sub_image_px } = self;
        let constants = match (zd, m, c) {
            (None, None, None) => DisparityConstants::from_viewing_distance(vz)?,
            // Checked with the sizes, by [`DisplaySettings::profile`].
            (Some(zd), Some(m), Some(c)) => DisparityConstants { zd, vz, m, c },
            _ => return Err(CustomProfileError::Keys),
        };
        Ok(ProfileSetting::Custom { constants, frame_px, sub_image_px })
    }
}

impl Serialize for ProfileSetting {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match *self {
            Self::Named(name) => serializer.serialize_str(name.name()),
            Self::Custom { constants: DisparityConstants { zd, vz, m, c }, frame_px, sub_image_px } => {
                let (zd, m, c) = (Some(zd), Some(m), Some(c));
                CustomProfile { vz, zd, m, c, frame_px, sub_image_px }.serialize(serializer)
            }
        }
    }
}

impl<'de> Deserialize<'de> for ProfileSetting {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(ProfileVisitor)
    }
}

struct ProfileVisitor;

impl<'de> Visitor<'de> for ProfileVisitor {
    type Value = ProfileSetting;

    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let names = ProfileName::ALL.map(ProfileName::name).join(", ");
        let (low, high) = (VZ_RANGE.start(), VZ_RANGE.end());
        write!(f, "a profile: one of {names}, or {{\"vz\": {low} to {high}}}, or all of zd, vz, m and c")
    }

    fn visit_str<E: de::Error>(self, name: &str) -> Result<Self::Value, E> {
        ProfileName::from_name(name)
            .map(ProfileSetting::Named)
            .ok_or_else(|| E::invalid_value(de::Unexpected::Str(name), &self))
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
        let custom = CustomProfile::deserialize(MapAccessDeserializer::new(map))?;
        custom.setting().map_err(de::Error::custom)
    }
}

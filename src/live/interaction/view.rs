//! The state of a view: camera, clip plane, cursor, and the history for undo.
//!
//! The eye is at the distance of [`relief_volume::Orbit`] from the focal point, and zoom narrows
//! the field of view as there. View axes: x right, y up, z towards the viewer, mm. The origin of
//! places in view space is the focal point.

use std::collections::VecDeque;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::aspect::Aspect;
use super::grab::Grab;
use super::stage::Stage;
use relief_base::{Patient, Point, Vector, ViewDepth};
use relief_volume::{Camera, CameraError};

/// Steps that can be taken back.
const MAX_HISTORY: usize = 64;

/// Kinds of changes: those of one kind in quick succession are taken back together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ChangeKind {
    Orbit,
    Turn,
    Pan,
    Zoom,
    Clip,
    Grab,
    /// It is never merged with another change.
    Single,
}

/// The state of a view; see the module. Only [`ViewState::apply`] changes it.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewState {
    pub(super) aspect: Aspect,
    pub(super) cursor: Option<Point<Patient>>,
    pub(super) placing: bool,
    pub(super) grab: Option<Grab>,
    pub(super) history: VecDeque<Aspect>,
    /// The steps that may go on, and when each last did: a pinch zooms and pans alternately.
    pub(super) going: Vec<(ChangeKind, u64)>,
    pub(super) revision: u64,
}

/// A plane that hides everything nearer to the eye.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CutPlane {
    /// The point of the plane that is nearest to the centre of the volume.
    pub point: Point<Patient>,
    /// Points away from the eye, to the side that is kept; of unit length.
    pub normal: Vector<Patient>,
}

/// The cursor as a ball to be drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct CursorMark {
    /// Its centre.
    pub at: Point<Patient>,
    /// Its radius in pixels of the picture's full size.
    pub radius_px: f64,
    /// Display-referred sRGB, 0..1: yellow, orange while the volume is held, white while something
    /// is being placed.
    pub rgb: [f64; 3],
}

/// The picture that a user points at. A pixel refers to the displayed picture, not to the newest
/// view.
pub struct DisplayedPicture<'a> {
    /// The camera that it was made with.
    pub camera: Camera,
    /// View depth at a pixel (u right, v down, centres at +0.5); a miss where nothing is seen, or
    /// outside.
    pub depth: &'a dyn Fn([f64; 2]) -> ViewDepth,
}

/// A view as clients get it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ViewRecord {
    /// The focal point.
    pub look_at_mm: [f64; 3],
    /// `patient_from_view`, w not negative.
    pub orientation_xyzw: [f64; 4],
    /// 1 fits the whole into the picture.
    pub zoom: f64,
    /// At zoom 1; 0 is a parallel projection.
    pub vertical_fov_deg: f64,
    /// The preset; null where the volume is shown otherwise.
    pub preset: Option<String>,
    /// Depth of the clip plane behind the front of the bounding sphere; null where nothing is cut.
    pub clip_mm: Option<f64>,
    /// The cursor; null where there is no cursor.
    pub cursor_mm: Option<[f64; 3]>,
    /// Whether a hand holds the volume.
    pub grabbed: bool,
    /// Whether something is being placed.
    pub placing: bool,
    /// The number of changes that can be undone.
    pub undo: usize,
    /// Counts changes; equal revisions of one view are equal states.
    pub revision: u64,
}

impl ViewState {
    /// The view that a session begins with.
    #[must_use]
    pub fn home(stage: &Stage) -> Self {
        Self {
            aspect: Aspect::home(stage),
            cursor: None,
            placing: false,
            grab: None,
            history: VecDeque::new(),
            going: Vec::new(),
            revision: 0,
        }
    }

    /// The camera of this view.
    ///
    /// # Errors
    /// None for a state that was made on this stage; see [`Camera::new`] for others.
    pub fn camera(&self, stage: &Stage) -> Result<Camera, CameraError> {
        let Aspect { look_at, patient_from_view, .. } = self.aspect;
        let (distance_mm, projection) = self.aspect.lens(stage)?;
        let eye = look_at + Vector::from_xyz(patient_from_view * DVec3::Z * distance_mm);
        Camera::new(eye, look_at, Vector::from_xyz(patient_from_view * DVec3::Y), projection)
    }

    /// The plane before which everything is cut away, if any.
    ///
    /// It lies across the viewing axis and turns with the view; its depth is counted from the front
    /// of the bounding sphere, wherever the focal point is.
    #[must_use]
    pub fn cut_plane(&self, stage: &Stage) -> Option<CutPlane> {
        let away = Vector::from_xyz(self.aspect.patient_from_view * DVec3::NEG_Z);
        let point = stage.center + away * (self.aspect.cut_mm - stage.radius_mm);
        (self.aspect.cut_mm > 0.0).then_some(CutPlane { point, normal: away })
    }

    /// The cursor, if there is one.
    #[must_use]
    pub fn cursor(&self) -> Option<Point<Patient>> {
        self.cursor
    }

    /// The cursor as it is to be drawn, if there is one.
    #[must_use]
    pub fn cursor_mark(&self, stage: &Stage) -> Option<CursorMark> {
        let rgb = match (self.placing, self.grab.is_some()) {
            (true, _) => [1.0, 1.0, 1.0],
            (false, true) => [1.0, 0.55, 0.1],
            (false, false) => [1.0, 0.9, 0.2],
        };
        self.cursor.map(|at| CursorMark { at, radius_px: cursor_px(stage), rgb })
    }

    /// The preset; `None` where the volume is shown otherwise.
    #[must_use]
    pub fn preset(&self) -> Option<&str> {
        self.aspect.preset.as_deref()
    }

    /// How far a point may be from the cursor that is taken hold of: the cursor's ball and half as
    /// much again, where the focal point is, mm.
    ///
    /// # Errors
    /// As [`ViewState::camera`].
    pub fn reach_mm(&self, stage: &Stage) -> Result<f64, CameraError> {
        let px_mm = self.aspect.height_mm(stage)? / f64::from(stage.size_px[1]);
        Ok(1.5 * cursor_px(stage) * px_mm)
    }

    /// Whether a hand holds the volume.
    #[must_use]
    pub fn is_grabbed(&self) -> bool {
        self.grab.is_some()
    }

    /// Whether something is being placed.
    #[must_use]
    pub fn is_placing(&self) -> bool {
        self.placing
    }

    /// Counts changes.
    #[must_use]
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// The view as clients get it.
    #[must_use]
    pub fn record(&self) -> ViewRecord {
        let Aspect { look_at, patient_from_view: q, zoom, vertical_fov_deg, ref preset, cut_mm } =
            self.aspect;
        let upper = if q.w < 0.0 { -q } else { q };
        ViewRecord {
            look_at_mm: look_at.xyz.to_array(),
            orientation_xyzw: upper.to_array(),
            zoom,
            vertical_fov_deg,
            preset: preset.clone(),
            clip_mm: (cut_mm > 0.0).then_some(cut_mm),
            cursor_mm: self.cursor.map(|at| at.xyz.to_array()),
            grabbed: self.grab.is_some(),
            placing: self.placing,
            undo: self.history.len(),
            revision: self.revision,
        }
    }

    /// Keeps the state before, so that it can come back; the oldest goes when there is too much.
    pub(super) fn remember(&mut self, before: Aspect) {
        if self.history.len() == MAX_HISTORY {
            self.history.pop_front();
        }
        self.history.push_back(before);
    }
}

/// Radius of the cursor, pixels of the picture's full size.
fn cursor_px(stage: &Stage) -> f64 {
    (f64::from(stage.size_px[1]) / 90.0).clamp(2.0, 64.0)
}

//! The effect of each intent on a view.

use glam::{DQuat, DVec3};

use super::aspect::{Aspect, ZOOMS, orientation_of};
use super::grab::{Grab, Hand};
use super::intent::{Intent, IntentError, PlacePhase, unit};
use super::stage::Stage;
use super::view::{ChangeKind, DisplayedPicture, ViewState};
use relief_base::{Patient, Point, Vector, View, ViewDepth};
use relief_volume::{Camera, CameraError};

/// Changes of one kind that follow one another faster than this are one step back, ns.
const ONE_STEP_NS: u64 = 1_000_000_000;

/// The effect of an intent.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AppliedIntent {
    /// Whether the state is another one now; its revision has gone up then.
    pub changed: bool,
    /// Its effect beyond the view.
    pub event: Option<IntentEffect>,
}

/// Effects beyond the view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum IntentEffect {
    /// Something is to be set down here; until then it follows the cursor.
    Placing(Point<Patient>),
    /// Place a landmark here, or take hold of one that is here.
    Taking(Point<Patient>),
    /// Something was set down here.
    Placed(Point<Patient>),
    /// It was not.
    PlacingCancelled,
    /// The next label is wanted.
    NextLabel,
}

impl ViewState {
    /// Applies an intent. `t_ns` is the intent's time: changes that are close in time are undone
    /// together. `seen` is the picture that `at_px` refers to; without one the cursor keeps its
    /// depth.
    ///
    /// # Errors
    /// When a value is out of range, a preset is not there, or there is no cursor to place at.
    /// Nothing has changed then.
    pub fn apply(
        &mut self,
        stage: &Stage,
        t_ns: u64,
        intent: &Intent,
        seen: Option<&DisplayedPicture<'_>>,
    ) -> Result<AppliedIntent, IntentError> {
        intent.validate()?;
        match intent {
            Intent::Cursor { .. } => {
                let wanted = stage.clamped_cursor(self.wanted_cursor(stage, intent, seen)?);
                let changed = self.cursor.replace(wanted) != Some(wanted);
                let event = (changed && self.placing).then_some(IntentEffect::Placing(wanted));
                Ok(self.applied(changed, event))
            }
            Intent::Place { phase } => self.place(*phase),
            Intent::NextLabel {} => Ok(self.applied(false, Some(IntentEffect::NextLabel))),
            Intent::Grab { position_mm, orientation_xyzw, mode, pivot } => {
                let hand = hand(position_mm, orientation_xyzw)?;
                let was_held = self.grab.is_some();
                self.grab = Some(Grab::new(&self.aspect, self.cursor, hand, *mode, *pivot));
                Ok(self.applied(!was_held, None))
            }
            Intent::Move { position_mm, orientation_xyzw } => {
                let hand = hand(position_mm, orientation_xyzw)?;
                Ok(self.carry(stage, t_ns, hand))
            }
            Intent::Release {} => {
                self.going.retain(|(step, _)| *step != ChangeKind::Grab); // the next grab is another step
                let changed = self.grab.take().is_some();
                Ok(self.applied(changed, None))
            }
            Intent::Undo {} => {
                let earlier = self.history.pop_back();
                self.going.clear();
                let changed = earlier.is_some();
                self.aspect = earlier.unwrap_or_else(|| self.aspect.clone());
                self.hold_anew();
                Ok(self.applied(changed, None))
            }
            _ => self.alter(stage, t_ns, intent),
        }
    }

    /// The intents that change the aspect at once.
    fn alter(&mut self, stage: &Stage, t_ns: u64, intent: &Intent) -> Result<AppliedIntent, IntentError> {
        let mut aspect = self.aspect.clone();
        let step = match intent {
            Intent::Orbit { azimuth_deg, elevation_deg } => {
                aspect.orbit(*azimuth_deg, *elevation_deg);
                ChangeKind::Orbit
            }
            Intent::Turn { rotation_xyzw } => {
                let turned = unit("rotation_xyzw", rotation_xyzw)?;
                aspect.patient_from_view = (aspect.patient_from_view * turned.inverse()).normalize();
                ChangeKind::Turn
            }
            Intent::Look { azimuth_deg, elevation_deg, zoom, vertical_fov_deg } => {
                aspect.patient_from_view = orientation_of(*azimuth_deg, *elevation_deg);
                aspect.zoom = zoom.unwrap_or(aspect.zoom);
                aspect.vertical_fov_deg = vertical_fov_deg.unwrap_or(aspect.vertical_fov_deg);
                ChangeKind::Single
            }
            Intent::Pan { right, up } => {
                let height_mm = aspect.height_mm(stage).map_err(|error| no_camera(&error))?;
                // The picture moves right when the eye moves left.
                let shift = Vector::from_xyz(DVec3::new(-right, -up, 0.0) * height_mm);
                aspect.look_at = stage.clamped_focus(aspect.in_patient(shift));
                ChangeKind::Pan
            }
            Intent::Zoom { factor } => {
                aspect.zoom = (aspect.zoom * factor).clamp(*ZOOMS.start(), *ZOOMS.end());
                ChangeKind::Zoom
            }
            Intent::Clip { by_mm, to_mm } => {
                let wanted = to_mm.unwrap_or(aspect.cut_mm + by_mm.unwrap_or(0.0));
                aspect.cut_mm = wanted.clamp(0.0, 2.0 * stage.radius_mm);
                ChangeKind::Clip
            }
            Intent::Preset { name, step } => {
                aspect.preset = chosen_preset(stage, aspect.preset.as_deref(), name.as_deref(), *step)?;
                ChangeKind::Single
            }
            Intent::Reset {} => {
                aspect = Aspect::home(stage);
                ChangeKind::Single
            }
            _ => return Ok(AppliedIntent::default()),
        };
        let changed = self.take(aspect, step, t_ns);
        if changed {
            self.hold_anew();
        }
        Ok(self.applied(changed, None))
    }

    /// Moves the held volume.
    fn carry(&mut self, stage: &Stage, t_ns: u64, hand: Hand) -> AppliedIntent {
        let Some(mut grab) = self.grab.take() else { return AppliedIntent::default() };
        let (look_at, patient_from_view) = grab.moved(hand);
        self.grab = Some(grab);
        let aspect =
            Aspect { look_at: stage.clamped_focus(look_at), patient_from_view, ..self.aspect.clone() };
        let changed = self.take(aspect, ChangeKind::Grab, t_ns);
        self.applied(changed, None)
    }

    /// Changes the aspect and stores the previous one for undo.
    fn take(&mut self, aspect: Aspect, step: ChangeKind, t_ns: u64) -> bool {
        if aspect == self.aspect {
            return false;
        }
        let before = std::mem::replace(&mut self.aspect, aspect);
        if step == ChangeKind::Single {
            self.going.clear();
            self.remember(before);
            return true;
        }
        let last = self.going.iter_mut().find(|(going, _)| *going == step);
        // A grab is one step however long it takes; a release ends it.
        let goes_on = |then: u64| step == ChangeKind::Grab || t_ns.abs_diff(then) <= ONE_STEP_NS;
        match last {
            Some((_, then)) if goes_on(*then) => *then = t_ns,
            Some((_, then)) => {
                *then = t_ns;
                self.remember(before);
            }
            None => {
                self.going.push((step, t_ns));
                self.remember(before);
            }
        }
        true
    }

    /// A hand that holds the volume continues from the current view.
    fn hold_anew(&mut self) {
        self.grab = self.grab.take().map(|grab| grab.renewed(&self.aspect, self.cursor));
    }

    fn applied(&mut self, changed: bool, event: Option<IntentEffect>) -> AppliedIntent {
        self.revision += u64::from(changed);
        AppliedIntent { changed, event }
    }

    fn place(&mut self, phase: PlacePhase) -> Result<AppliedIntent, IntentError> {
        let was_placing = self.placing;
        let event = match phase {
            PlacePhase::Preview => Some(IntentEffect::Placing(self.cursor.ok_or(IntentError::NoCursor)?)),
            PlacePhase::Take => Some(IntentEffect::Taking(self.cursor.ok_or(IntentError::NoCursor)?)),
            PlacePhase::Commit => Some(IntentEffect::Placed(self.cursor.ok_or(IntentError::NoCursor)?)),
            PlacePhase::Cancel => was_placing.then_some(IntentEffect::PlacingCancelled),
        };
        self.placing = matches!(phase, PlacePhase::Preview | PlacePhase::Take);
        Ok(self.applied(self.placing != was_placing, event))
    }

    fn wanted_cursor(
        &self,
        stage: &Stage,
        intent: &Intent,
        seen: Option<&DisplayedPicture<'_>>,
    ) -> Result<Point<Patient>, IntentError> {
        let Intent::Cursor { at_px, at_view_mm, by_view_mm, point_mm } = intent else {
            return Ok(self.aspect.look_at);
        };
        let vector = |xyz: &[f64; 3]| Vector::<View>::from_xyz(DVec3::from_array(*xyz));
        let known = self.cursor.unwrap_or(self.aspect.look_at);
        Ok(match (at_px, at_view_mm, by_view_mm, point_mm) {
            (Some(pixel), ..) => {
                let camera = match seen {
                    Some(seen) => seen.camera,
                    None => self.camera(stage).map_err(|error| no_camera(&error))?,
                };
                let depth = seen.map_or(ViewDepth::MISS, |seen| (seen.depth)(*pixel));
                let own = -(camera.view_from_patient() * known).xyz.z;
                let depth_mm = if depth.is_hit() { f64::from(depth.0) } else { own };
                at_pixel(&camera, stage.size_px, *pixel, depth_mm)
            }
            (_, Some(place), ..) => self.aspect.in_patient(vector(place)),
            (_, _, Some(shift), _) => {
                known + Vector::from_xyz(self.aspect.patient_from_view * DVec3::from_array(*shift))
            }
            (.., Some(point)) => Point::from_xyz(DVec3::from_array(*point)),
            _ => known,
        })
    }
}

impl Aspect {
    /// Turns the eye about the patient's long axis, and up or down about the picture's horizontal.
    ///
    /// Upright views end at the poles. One that was turned over freely comes back but goes no
    /// further.
    fn orbit(&mut self, azimuth_deg: f64, elevation_deg: f64) {
        let back = self.patient_from_view * DVec3::Z;
        let up = self.patient_from_view * DVec3::Y;
        // In the plane across the picture's horizontal: the elevation, of an upright view.
        let (sine, cosine) = (back.z, up.z);
        let is_level = sine.hypot(cosine) > 1e-6;
        let wanted = elevation_deg.to_radians();
        let raised = if is_level {
            let now = sine.atan2(cosine);
            let quarter = std::f64::consts::FRAC_PI_2;
            (now + wanted).clamp(now.min(-quarter), now.max(quarter)) - now
        } else {
            wanted // a view along the patient's horizontal, on its side, has no poles
        };
        let turned = DQuat::from_rotation_z(azimuth_deg.to_radians()) * self.patient_from_view;
        self.patient_from_view = (turned * DQuat::from_rotation_x(-raised)).normalize();
    }
}

fn hand(position_mm: &[f64; 3], orientation_xyzw: &[f64; 4]) -> Result<Hand, IntentError> {
    let orientation = unit("orientation_xyzw", orientation_xyzw)?;
    Ok(Hand { position: DVec3::from_array(*position_mm), orientation })
}

fn chosen_preset(
    stage: &Stage,
    now: Option<&str>,
    name: Option<&str>,
    step: Option<i32>,
) -> Result<Option<String>, IntentError> {
    let presets = &stage.presets;
    if let Some(name) = name {
        let refuse = || IntentError::Range {
            field: "name",
            found: format!("{:?}", name.chars().take(40).collect::<String>()),
            allowed: presets.join(", "),
        };
        return presets.iter().find(|preset| *preset == name).cloned().map(Some).ok_or_else(refuse);
    }
    let count = presets.len() as i64;
    let step = i64::from(step.unwrap_or(0));
    // Without a preset a step forwards goes to the first one, and a step back to the last.
    let at = now.and_then(|now| presets.iter().position(|preset| preset == now));
    let from = at.map_or(if step > 0 { -1 } else { 0 }, |at| at as i64);
    let Some(to) = (from + step).checked_rem_euclid(count) else { return Ok(None) };
    Ok(presets.get(to as usize).cloned())
}

/// The patient point that a pixel shows at this view depth.
fn at_pixel(camera: &Camera, size_px: [u32; 2], [u, v]: [f64; 2], depth_mm: f64) -> Point<Patient> {
    let [width, height] = size_px.map(f64::from);
    let [half_x, half_y] = camera.half_extent(size_px);
    let spread = match camera.projection() {
        relief_volume::Projection::Perspective { .. } => depth_mm,
        relief_volume::Projection::Orthographic { .. } => 1.0,
    };
    let x = (2.0 * u / width - 1.0) * half_x * spread;
    let y = (1.0 - 2.0 * v / height) * half_y * spread;
    camera.patient_from_view() * Point::new(x, y, -depth_mm)
}

/// A state has a camera on the stage that it was made for.
fn no_camera(error: &CameraError) -> IntentError {
    IntentError::Range {
        field: "view",
        found: error.to_string(),
        allowed: "a view of this volume".to_owned(),
    }
}

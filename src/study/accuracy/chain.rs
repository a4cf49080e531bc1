//! A landmark in the view of a user, and one placement of it: pick, snap, error.

use glam::DVec3;

use super::report::WayReport;
use crate::StudyError;
use relief_annotation::{Snap, SnapFeature, snap_point};
use relief_base::{Patient, Point, Vector, View};
use relief_render::{ClipPlane, RenderRequest, RenderedFrame, Renderer, SceneFile};
use relief_tracking::Random;
use relief_volume::{Camera, Orbit, PhantomLandmark, Projection, Volume};

/// The picture, and the part of the patient in it: the user came closer.
const SIZE_PX: [u32; 2] = [960, 540];
pub(super) const HEIGHT_MM: f64 = 120.0;
const EYE_MM: f64 = 600.0;

/// A view shows a landmark where its picture is no farther from it than this, mm.
const SEEN_MM: f64 = 3.0;

/// The clip plane stops this far before the landmark, mm: a user does not cut to the millimetre.
const CUT_MM: [f64; 2] = [1.0, 3.0];

/// Largest distance of the landmark from the picture's middle along each axis, mm.
const ASIDE_MM: f64 = 40.0;

/// From the patient to the eye of the standard views: front, back, left, right, head, feet.
const STANDARD: [DVec3; 6] = [DVec3::NEG_Y, DVec3::Y, DVec3::X, DVec3::NEG_X, DVec3::Z, DVec3::NEG_Z];

/// A landmark and the frame of its placement.
pub(super) struct PresentedLandmark {
    frame: RenderedFrame,
    truth: Point<Patient>,
    pub(super) sight: Visibility,
}

/// How a landmark comes into view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Visibility {
    /// As it is.
    Plain,
    /// The volume before the landmark is cut away.
    Cut,
    /// Not visible: the cursor lands on the surface before it.
    Hidden,
}

impl PresentedLandmark {
    /// The nearest standard view in which the landmark is visible, with the preset that shows its
    /// tissue. Where no view shows it: the nearest in which it is visible after the clip plane has
    /// removed the volume before it; or else the nearest.
    ///
    /// # Errors
    /// When a picture cannot be rendered.
    pub(super) fn new(
        renderer: &mut Renderer,
        volume: &Volume,
        landmark: &PhantomLandmark,
        seed: u64,
        cuts: bool,
    ) -> Result<Self, StudyError> {
        let truth = Point::from_xyz(landmark.position_mm.into());
        let outward = DVec3::from(landmark.outward);
        let preset = if landmark.on == "skin" { "skin" } else { "bone" };
        let scene = SceneFile::default().with_preset(preset).with_size(SIZE_PX);
        let request = scene.resolve(volume.grid(), &Orbit::default())?.request;
        let mut views = STANDARD;
        views.sort_by(|a, b| outward.dot(*b).total_cmp(&outward.dot(*a)));
        let mut random = Random::new(seed);
        let mut nearest: Option<Self> = None;
        let sights: &[Visibility] =
            if cuts { &[Visibility::Plain, Visibility::Cut] } else { &[Visibility::Plain] };
        for &sight in sights {
            for toward_eye in views {
                let aside = [0; 2].map(|_| random.between(-ASIDE_MM, ASIDE_MM));
                let mut seen = RenderRequest { camera: camera(truth, toward_eye, aside)?, ..request.clone() };
                if sight == Visibility::Cut {
                    let before = toward_eye * random.between(CUT_MM[0], CUT_MM[1]);
                    let point = truth + Vector::from_xyz(before);
                    seen.clip.planes.push(ClipPlane { point, normal: Vector::from_xyz(-toward_eye) });
                }
                let shown = Self { frame: renderer.render(volume, &seen)?, truth, sight };
                if shown.pick(truth).is_some_and(|at| at.distance(truth) < SEEN_MM) {
                    return Ok(shown);
                }
                nearest = nearest.or(Some(Self { sight: Visibility::Hidden, ..shown }));
            }
        }
        nearest.ok_or(StudyError::HandLost)
    }

    /// Places it once: `offset` is the distance of the cursor from the landmark along view axes.
    pub(super) fn place(&self, volume: &Volume, offset: DVec3, radius_mm: f64, way: &mut WayReport) {
        let in_view = Vector::<View>::from_xyz(offset);
        let tip = self.truth + self.frame.camera.patient_from_view() * in_view;
        let is_ray = way.way == "ray";
        let Some(placed) = (if is_ray { self.pick(tip) } else { Some(tip) }) else {
            way.missed += 1;
            return;
        };
        let to = match way.snap {
            "boundary" => Some(SnapFeature::Boundary),
            "gradient" => Some(SnapFeature::Gradient),
            _ => None,
        };
        let ray = is_ray.then(|| placed - self.frame.camera.eye());
        let snapped = to.and_then(|to| snap_point(volume, placed, ray, &Snap { to, radius_mm }).ok());
        way.missed += usize::from(way.snap != "none" && snapped.is_none());
        let at = snapped.map_or(placed, |found| found.at);
        way.errors_mm.push(at.distance(self.truth));
    }

    /// The visible surface of the frame at the cursor.
    fn pick(&self, cursor: Point<Patient>) -> Option<Point<Patient>> {
        let (u, v, _) = self.frame.camera.project(cursor, SIZE_PX)?;
        let inside = [u, v].iter().zip(SIZE_PX).all(|(at, side)| (0.0..f64::from(side)).contains(at));
        inside.then(|| self.frame.pick([u as u32, v as u32])).flatten()
    }
}

/// Looks along a standard direction, up where the head's up is; the place is so far aside of the
/// middle.
fn camera(place: Point<Patient>, toward_eye: DVec3, [right, up]: [f64; 2]) -> Result<Camera, StudyError> {
    let upwards = if toward_eye.z.abs() > 0.9 { DVec3::NEG_Y } else { DVec3::Z };
    let look_at = place + Vector::from_xyz(upwards.cross(toward_eye) * right + upwards * up);
    let eye = look_at + Vector::from_xyz(toward_eye * EYE_MM);
    let vertical_fov = 2.0 * (HEIGHT_MM / 2.0 / EYE_MM).atan();
    Ok(Camera::new(eye, look_at, Vector::from_xyz(upwards), Projection::Perspective { vertical_fov })?)
}

//! A landmark as a user sees it, and what becomes of a placing: pick, snap, error.

use std::f64::consts::PI;

use anyhow::Context;
use glam::{DQuat, DVec3};

use super::Way;
use crate::camera::{Camera, Orbit, Projection};
use crate::placing::{Snap, Target, snap};
use crate::render::{ClipPlane, RenderRequest, RenderedFrame, Renderer, SceneFile};
use crate::space::{Patient, Point, Vector, View};
use crate::volume::Volume;
use crate::volume::phantom::Landmark;

/// The picture, and how much of the patient it shows.
const SIZE_PX: [u32; 2] = [480, 270];
const HEIGHT_MM: f64 = 120.0;
const EYE_MM: f64 = 600.0;

/// A view shows a landmark where its picture is no farther from it than this, mm.
const SEEN_MM: f64 = 2.0;

/// How far before a landmark the plane is that cuts away what hides it, mm.
const CUT_MM: f64 = 6.0;

/// Angles between the landmark's own direction and the viewing ray that are tried.
const TILTS_DEG: [f64; 4] = [10.0, 25.0, 40.0, 55.0];

/// A landmark and the frame in which it is placed.
pub(super) struct Shown {
    frame: RenderedFrame,
    truth: Point<Patient>,
    level_hu: f64,
}

impl Shown {
    /// Turns the head until the landmark is seen, with the preset that shows its tissue; cuts away what is before it if need be.
    ///
    /// # Errors
    /// When a picture cannot be rendered.
    pub(super) fn new(renderer: &mut Renderer, volume: &Volume, landmark: &Landmark) -> anyhow::Result<Self> {
        let truth = Point::from_xyz(landmark.position_mm.into());
        let outward = DVec3::from(landmark.outward);
        let preset = if landmark.on == "skin" { "skin" } else { "bone" };
        let scene = SceneFile::default().with_preset(preset).with_size(SIZE_PX);
        let request = scene.resolve(volume.grid(), &Orbit::default())?.request;
        let side = outward.any_orthonormal_vector();
        let mut best: Option<(f64, RenderedFrame)> = None;
        // What lies before it is cut away where nothing else helps.
        let tilts = [false, true].into_iter().flat_map(|cut| TILTS_DEG.map(|tilt| (cut, tilt.to_radians())));
        for (cut, tilt) in tilts {
            for turn in 0..6 {
                let across = DQuat::from_axis_angle(outward, f64::from(turn) * PI / 3.0) * side;
                let toward_eye = outward * tilt.cos() + across * tilt.sin();
                let mut seen = RenderRequest { camera: camera(truth, toward_eye)?, ..request.clone() };
                if cut {
                    let point = truth + Vector::from_xyz(toward_eye * CUT_MM);
                    seen.clip.planes.push(ClipPlane { point, normal: Vector::from_xyz(-toward_eye) });
                }
                let frame = renderer.render(volume, &seen)?;
                let middle = frame.pick(SIZE_PX.map(|side| side / 2));
                let off = middle.map_or(f64::INFINITY, |at| at.distance(truth));
                if best.as_ref().is_none_or(|(least, _)| off < *least) {
                    best = Some((off, frame));
                }
            }
            if best.as_ref().is_some_and(|(off, _)| *off < SEEN_MM) {
                break;
            }
        }
        let (_, frame) = best.context("no view was tried")?;
        Ok(Self { frame, truth, level_hu: landmark.level_hu })
    }

    /// Places it once: `offsets` are those of the tip, for each lever in the order of `ways`.
    pub(super) fn place(&self, volume: &Volume, offsets: &[DVec3], radius_mm: f64, ways: &mut [Way]) {
        for way in ways {
            let offset = match way.lever_mm {
                lever_mm if lever_mm == super::USUAL_LEVER_MM => offsets[0],
                _ => offsets[offsets.len() - 1],
            };
            // The beacon's axes are those of the view: a millimetre of the hand is one in the patient.
            let in_view = Vector::<View>::from_xyz(offset);
            let tip = self.truth + self.frame.camera.patient_from_view() * in_view;
            let placed = if way.way == "ray" { self.pick(tip) } else { Some(tip) };
            let Some(placed) = placed else {
                way.missed += 1;
                continue;
            };
            let to = match way.snap {
                "surface" => Some(Target::Surface { hu: self.level_hu }),
                "gradient" => Some(Target::Gradient),
                _ => None,
            };
            let ray = placed - self.frame.camera.eye();
            let snapped = to.map(|to| snap(volume, placed, Some(ray), &Snap { to, radius_mm }));
            let at = match snapped {
                Some(Ok(found)) => found.at,
                Some(Err(_)) => {
                    way.missed += 1;
                    placed
                }
                None => placed,
            };
            way.errors_mm.push(at.distance(self.truth));
        }
    }

    /// What the frame shows where the cursor is.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked to be inside")]
    fn pick(&self, cursor: Point<Patient>) -> Option<Point<Patient>> {
        let (u, v, _) = self.frame.camera.project(cursor, SIZE_PX)?;
        let inside = [u, v].iter().zip(SIZE_PX).all(|(at, side)| (0.0..f64::from(side)).contains(at));
        inside.then(|| self.frame.pick([u as u32, v as u32])).flatten()
    }
}

/// Looks at a place from a direction, up where the head's up is.
fn camera(at: Point<Patient>, toward_eye: DVec3) -> anyhow::Result<Camera> {
    let up = if toward_eye.z.abs() > 0.9 { DVec3::NEG_Y } else { DVec3::Z };
    let eye = at + Vector::from_xyz(toward_eye.normalize() * EYE_MM);
    let vertical_fov = 2.0 * (HEIGHT_MM / 2.0 / EYE_MM).atan();
    Ok(Camera::new(eye, at, Vector::from_xyz(up), Projection::Perspective { vertical_fov })?)
}

//! Cut faces: where the volume's edge, a clip plane or the cut-away sphere opens a body; as
//! `shaders/raycast/faces.wgsl`.
//!
//! Inside of a body, gradients follow noise and no surface. The first sample distance behind a face
//! is therefore lit by the face's normal, which then fades into the gradient's direction. Directions
//! along the patient axes; distances in mm along the rays.

use relief_lanes::{Lanes, Mask as _, Real as _, Triple};

use super::super::cut::CutFaces;
use super::face_light::FaceLight;
use super::ray::Rays;
use super::scene::{Hit, Scene};

/// Cut faces on which the slice is painted.
pub(super) struct PaintedFaces<L: Lanes> {
    /// The rays that have one.
    pub(super) on: L::Mask,
    /// Distances along the rays, mm.
    pub(super) t: L::Real,
    pub(super) grey: L::Real,
}

impl<L: Lanes> PaintedFaces<L> {
    /// The rays, up to what hides them before their faces: for a face at the entry nothing is left.
    #[inline(always)]
    pub(super) fn end(&self, rays: &Rays<L>, distance_mm: L::Real) -> Rays<L> {
        let is_entry = self.t.le(rays.entry);
        let end = (rays.entry - distance_mm).or_where_not(is_entry, rays.cut[0]);
        rays.ending_at(end.or_where_not(self.on, rays.exit))
    }

    /// What the rays show, with their faces behind it.
    #[inline(always)]
    pub(super) fn paint(&self, hit: Hit<L>, one: L::Real) -> Hit<L> {
        let behind = Triple::of((one - hit.opacity) * self.grey);
        Hit {
            color: hit.color.plus(behind).or_where_not([self.on; 3], hit.color),
            opacity: one.or_where_not(self.on, hit.opacity),
            t: self.t.or_where_not(self.on & !hit.hits, hit.t),
            hits: hit.hits | self.on,
        }
    }
}

impl<L: Lanes> Scene<'_, L> {
    /// Distances of points at t mm behind the face before them. Behind the sphere they are negative,
    /// from -1 mm on.
    #[inline(always)]
    pub(super) fn behind_face(&self, rays: &Rays<L>, t: L::Real) -> L::Real {
        let behind = (t - rays.entry).max(self.number(0.0));
        if !self.is_cut {
            return behind;
        }
        let [_, cut_out] = rays.cut;
        let is_wall = rays.entry.lt(cut_out) & cut_out.le(t);
        (cut_out - t - self.number(1.0)).or_where_not(is_wall, behind)
    }

    /// The faces before points at these distances; `normals` are those of the entry and of the
    /// sphere.
    #[inline(always)]
    pub(super) fn face_light(
        &self,
        behind: L::Real,
        normals: impl FnOnce() -> [Triple<L::Real>; 2],
    ) -> FaceLight<L> {
        let (zero, one) = (self.number(0.0), self.number(1.0));
        let is_wall = behind.lt(zero);
        let distance = (-behind - one).or_where_not(is_wall, behind);
        let share = (distance - self.view.distance_mm()) / self.view.face_fade_mm();
        let shows = share.lt(one).any();
        let normal = if shows {
            let [entry, wall] = normals();
            wall.or_where_not([is_wall; 3], entry)
        } else {
            Triple::of(zero)
        };
        FaceLight { lanes: self.lanes, share, normal, shows }
    }

    /// The first faces of the chosen rays with a value above the window's lowest, where the request
    /// has them painted.
    #[inline(always)]
    pub(super) fn painted_faces(&self, rays: &Rays<L>, chosen: L::Mask) -> Option<PaintedFaces<L>> {
        let CutFaces::Slice { .. } = self.request.cut else { return None };
        let zero = self.number(0.0);
        let chosen = chosen & rays.entry.lt(rays.exit);
        let grey = self.face_grey(rays, rays.entry);
        let mut on = chosen & zero.lt(grey);
        let mut faces = PaintedFaces { on, t: rays.entry, grey };
        if self.is_cut {
            let [_, cut_out] = rays.cut;
            on = on & !rays.is_cut(rays.entry);
            let wall = self.face_grey(rays, cut_out);
            let inside = rays.entry.lt(cut_out) & cut_out.lt(rays.exit);
            let is_wall = chosen & !on & inside & zero.lt(wall);
            faces.t = cut_out.or_where_not(is_wall, faces.t);
            faces.grey = wall.or_where_not(is_wall, grey);
            faces.on = on | is_wall;
        }
        Some(faces)
    }

    #[inline(always)]
    fn face_grey(&self, rays: &Rays<L>, t: L::Real) -> L::Real {
        let [lowest_hu, per_hu] = self.request.cut.window().map(|value| self.number(value));
        ((self.field.hu(rays.voxel_at(t)) - lowest_hu) * per_hu).min(self.number(1.0))
    }
}

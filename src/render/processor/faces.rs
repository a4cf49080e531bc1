//! Cut faces: where the volume's edge, a clip plane or the cut-away sphere opens a body; as
//! `shaders/raycast/faces.wgsl`.
//!
//! Inside of a body, gradients follow noise and no surface. The first sample distance behind a face
//! is therefore lit by the face's normal, which then fades into the gradient's direction. Directions
//! along the patient axes; distances in mm along the rays.

use relief_lanes::{Lanes, Mask as _, Real as _, Triple};

use super::super::cut::CutFaces;
use super::color::NO_GRADIENT;
use super::face_zone::FaceZone;
use super::pending::Pending;
use super::ray::Rays;
use super::scene::{Hit, Scene};

/// A sample that no ray has.
const NO_SAMPLE: f64 = 1e30;

/// Cut faces on which the slice is painted.
pub(super) struct PaintedFaces<L: Lanes> {
    /// The rays that have one.
    pub(super) on: L::Mask,
    /// Distances along the rays, mm.
    pub(super) t: L::Real,
    pub(super) grey: L::Real,
}

impl<L: Lanes> PaintedFaces<L> {
    /// The ends of the rays before their faces: at the sphere, or before their first sample.
    #[inline(always)]
    pub(super) fn exit(&self, rays: &Rays<L>, distance_mm: L::Real) -> L::Real {
        let is_entry = self.t.le(rays.entry);
        let end = (rays.entry - distance_mm).or_where_not(is_entry, rays.cut[0]);
        end.or_where_not(self.on, rays.exit)
    }

    /// Hits, with painted faces behind them.
    #[inline(always)]
    pub(super) fn paint(&self, hit: &Hit<L>, one: L::Real) -> Hit<L> {
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
    /// The zone behind the faces of rays; half a sample wider, for paths.
    #[inline(always)]
    pub(super) fn face_zone(&self, rays: &Rays<L>) -> FaceZone<L> {
        let half = self.number(0.5);
        let distance = self.view.distance_mm();
        let reach = distance + self.view.face_fade_mm();
        let [_, cut_out] = rays.cut;
        let behind_sphere = if self.is_cut {
            let is_met = rays.entry.lt(cut_out);
            let first =
                ((cut_out - rays.first) / distance - half).or_where_not(is_met, self.number(NO_SAMPLE));
            Some([first, (cut_out + reach - rays.first) / distance + half])
        } else {
            None
        };
        let (mm_per_voxel, start) = rays.along();
        FaceZone {
            last: (rays.entry + reach - rays.first) / distance + half,
            behind_sphere,
            mm_per_voxel,
            entry: start + rays.entry,
            sphere: start + cut_out,
        }
    }

    /// The directions by which waiting samples are lit: gradients, or normals of faces where samples
    /// are marked. Voxel indices, the rays' directions and the gradients of the samples are given.
    /// Lengths have no meaning.
    #[inline(always)]
    pub(super) fn turned<const N: usize>(
        &self,
        zone: &FaceZone<L>,
        pending: &Pending<L, N>,
        [p, direction, gradient]: [Triple<L::Real>; 3],
        marked: L::Mask,
    ) -> Triple<L::Real> {
        if !marked.any() {
            return gradient;
        }
        let (zero, one) = (self.number(0.0), self.number(1.0));
        let along = pending.of_rays(zone.mm_per_voxel).dot(p);
        let mut behind = along - pending.number_of_rays(zone.entry);
        let mut normal = pending.of_rays(pending.face_normals[0]);
        if self.is_cut {
            let behind_sphere = along - pending.number_of_rays(zone.sphere);
            // But for rounding; the sphere that a ray does not meet ends before its entry.
            let margin = -self.view.distance_mm() * self.number(0.01);
            let is_wall = margin.le(behind_sphere) & behind_sphere.lt(behind);
            normal = pending.of_rays(pending.face_normals[1]).or_where_not([is_wall; 3], normal);
            behind = behind_sphere.or_where_not(is_wall, behind);
        }
        let share = ((behind - self.view.distance_mm()) * self.view.per_face_fade()).max(zero);
        let length = gradient.dot(gradient).max(self.number(NO_GRADIENT)).sqrt();
        // Towards the eye, as normals are.
        let is_averted = zero.lt(gradient.dot(direction));
        let per_length = one / length;
        let slope = gradient.scaled((-per_length).or_where_not(is_averted, per_length));
        // Slowly at first: opaque bodies show little of the noise behind.
        let blended = normal.plus_times(slope.minus(normal), share * share);
        blended.or_where_not([marked & share.lt(one); 3], gradient)
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
        let [lowest_hu, per_hu] = self.request.cut.window();
        let (lowest_hu, per_hu) = (self.number(lowest_hu), self.number(per_hu));
        ((self.field.hu(rays.voxel_at(t)) - lowest_hu) * per_hu).min(self.number(1.0))
    }
}

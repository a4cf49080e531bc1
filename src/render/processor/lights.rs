//! Light of a visible sample: the headlight or placed lights, their shadows, and the
//! occlusion by its surroundings; as `shaders/lib/lights.wgsl`.
//!
//! Spaces: voxel index; directions along the patient axes, unit length; places in mm from the
//! volume's centre, along the patient axes. Shadows and openness are looked up in cells, a cell's
//! width before the surface on the eye's side, so that a surface does not shade itself.

use glam::DVec3;
use relief_lanes::{Lanes, Real as _, Triple};
use relief_volume::Grid;

use super::super::light::InPatient;
use super::super::request::RenderRequest;
use super::color::{Headlight, NO_GRADIENT};
use super::field::Field;
use super::light_cells::LightCells;
use crate::illumination::Cells;

/// The light of a picture.
pub(super) struct Lights<'a, L: Lanes> {
    head: Headlight<L>,
    placed: Option<Placed<'a, L>>,
}

/// Lights in place of the headlight, and the light in cells.
struct Placed<'a, L: Lanes> {
    lanes: L,
    cells: &'a LightCells,
    strides: [i32; 2],
    last_cell: Triple<L::Real>,
    cells_per_voxel: Triple<L::Real>,
    /// A step of one cell along a normal: columns.
    cells_from_normal: [Triple<L::Real>; 3],
    /// Columns, and where voxel 0 is.
    place_from_voxel: [Triple<L::Real>; 4],
    lights: Vec<PlacedLight<L>>,
    /// The shares of shadows and of occlusion that show, 0..1.
    shadows: L::Real,
    occlusion: L::Real,
}

struct PlacedLight<L: Lanes> {
    /// Unit vector towards a distant light, or the place of a near one.
    toward: Triple<L::Real>,
    is_near: bool,
    /// Colour times intensity.
    rgb: Triple<L::Real>,
}

impl<'a, L: Lanes> Lights<'a, L> {
    #[inline(always)]
    pub(super) fn new(lanes: L, request: &RenderRequest, grid: &Grid, cells: &'a LightCells) -> Self {
        let head = Headlight::new(lanes, &request.shading);
        let placed = request.has_own_light().then(|| Placed::new(lanes, request, grid, cells));
        Self { head, placed }
    }

    /// Whether there is more than the headlight.
    #[inline(always)]
    pub(super) fn are_placed(&self) -> bool {
        self.placed.is_some()
    }

    /// The headlight.
    #[inline(always)]
    pub(super) fn head(&self) -> &Headlight<L> {
        &self.head
    }

    /// The colours of samples at voxel indices, seen along `direction`. `turn` gives the direction that
    /// lights them for a gradient. The gradient's length does not
    /// matter; without a gradient there is only ambient light.
    #[inline(always)]
    pub(super) fn lit(
        &self,
        field: &Field<'_, L>,
        rgb: Triple<L::Real>,
        direction: Triple<L::Real>,
        p: Triple<L::Real>,
        turn: impl FnOnce(Triple<L::Real>) -> Triple<L::Real>,
    ) -> Triple<L::Real> {
        if !self.need_gradient() {
            return self.head.ambient(rgb);
        }
        let gradient = turn(field.gradient(p));
        match &self.placed {
            None => self.head.lit(rgb, gradient, direction),
            Some(placed) => placed.lanes.apart(
                #[inline(always)]
                || placed.lit(&self.head, rgb, gradient, direction, p),
            ),
        }
    }

    /// Whether samples are lit by their gradients.
    #[inline(always)]
    fn need_gradient(&self) -> bool {
        self.head.needs_gradient || self.placed.as_ref().is_some_and(|placed| placed.cells.openness.is_some())
    }
}

impl<'a, L: Lanes> Placed<'a, L> {
    fn new(lanes: L, request: &RenderRequest, grid: &Grid, light: &'a LightCells) -> Self {
        let triple = |value: DVec3| Triple(value.to_array().map(|x| lanes.splat(x)));
        let cells = Cells::of(grid);
        let [nx, ny, _] = cells.dims;
        let center = grid.center().xyz;
        let place_from_voxel = grid.patient_from_voxel().affine;
        let [a, b, c] = place_from_voxel.matrix3.to_cols_array_2d().map(|column| triple(column.into()));
        let lights = request.lights.iter().map(|light| {
            let (toward, is_near) = match light.in_patient(&request.camera) {
                InPatient::Direction(direction) => (direction.xyz, false),
                InPatient::Position(position) => (position.xyz - center, true),
            };
            let rgb = triple(DVec3::from(light.rgb) * light.intensity);
            PlacedLight { toward: triple(toward), is_near, rgb }
        });
        Self {
            lanes,
            cells: light,
            strides: [nx as i32, (nx * ny) as i32],
            last_cell: triple(DVec3::from(cells.dims.map(|side| (side - 1) as f64))),
            cells_per_voxel: triple(DVec3::from(cells.voxels.map(|voxels| 1.0 / voxels as f64))),
            cells_from_normal: [DVec3::X, DVec3::Y, DVec3::Z]
                .map(|normal| triple(Cells::step_before(grid, normal))),
            place_from_voxel: [a, b, c, triple(place_from_voxel.translation - center)],
            lights: lights.collect(),
            shadows: lanes.splat(request.illumination.shadows),
            occlusion: lanes.splat(request.illumination.occlusion.strength),
        }
    }

    #[inline(always)]
    fn lit(
        &self,
        head: &Headlight<L>,
        rgb: Triple<L::Real>,
        gradient: Triple<L::Real>,
        direction: Triple<L::Real>,
        p: Triple<L::Real>,
    ) -> Triple<L::Real> {
        let number = |x: f64| self.lanes.splat(x);
        let length_squared = gradient.dot(gradient);
        let is_surface = number(NO_GRADIENT).le(length_squared);
        let length = length_squared.max(number(NO_GRADIENT)).sqrt();
        let nothing = Triple::of(number(0.0));
        let slope = gradient.over(Triple::of(length)).or_where_not([is_surface; 3], nothing);
        // Towards the eye's side.
        let is_averted = number(0.0).lt(slope.dot(direction));
        let normal = nothing.minus(slope).or_where_not([is_averted; 3], slope);
        let cell = p.plus(Triple::of(number(0.5))).times(self.cells_per_voxel);
        let cell = cell.plus(Triple::of_columns(self.cells_from_normal, normal));
        let open = self.openness(cell);
        if self.lights.is_empty() || !head.needs_gradient {
            // The headlight stands for light from all directions: enclosed places receive less of it.
            let lit =
                if head.needs_gradient { head.lit(rgb, gradient, direction) } else { head.ambient(rgb) };
            return lit.scaled(open);
        }
        let placed = self.placed(head, rgb, normal, direction, p, cell);
        let placed = placed.or_where_not([is_surface; 3], nothing);
        head.ambient(rgb).scaled(open).plus(placed)
    }

    /// The share of ambient light that is left: all of it where half of all directions is open, as
    /// before an even wall.
    #[inline(always)]
    fn openness(&self, cell: Triple<L::Real>) -> L::Real {
        let (one, two) = (self.lanes.splat(1.0), self.lanes.splat(2.0));
        let Some(open) = &self.cells.openness else { return one };
        let mut sum = self.lanes.splat(0.0);
        for corner in 0..8 {
            let (at, weight) = self.corner(cell, corner);
            sum = sum + self.lanes.numbers(open, at) * weight;
        }
        one - self.occlusion * (one - (sum * two).min(one))
    }

    /// The shares of the lights that reach a position in cells.
    #[inline(always)]
    fn shares(&self, cell: Triple<L::Real>) -> [L::Real; 4] {
        let (zero, one) = (self.lanes.splat(0.0), self.lanes.splat(1.0));
        let Some(shadows) = &self.cells.shadows else { return [one; 4] };
        let mut sum = [zero; 4];
        for corner in 0..8 {
            let (at, weight) = self.corner(cell, corner);
            let shares = self.lanes.entries(shadows, at);
            for light in 0..4 {
                sum[light] = sum[light] + shares[light] * weight;
            }
        }
        for share in &mut sum {
            *share = one - self.shadows * (one - *share);
        }
        sum
    }

    /// The place and the weight of one of the eight cells around a position; outside the outermost
    /// centres values go on.
    #[inline(always)]
    fn corner(&self, cell: Triple<L::Real>, corner: usize) -> (L::Index, L::Real) {
        let (zero, one) = (self.lanes.splat(0.0), self.lanes.splat(1.0));
        let p = cell.minus(Triple::of(self.lanes.splat(0.5))).max(Triple::of(zero)).min(self.last_cell);
        let base = p.floor();
        let Triple(high) = p.minus(base);
        let step = |axis: usize| if corner >> axis & 1 == 1 { one } else { zero };
        let share = |axis: usize| if corner >> axis & 1 == 1 { high[axis] } else { one - high[axis] };
        let place = base.plus(Triple([step(0), step(1), step(2)])).min(self.last_cell);
        (self.lanes.places(place, self.strides), share(0) * share(1) * share(2))
    }

    /// Diffuse light and highlights (Blinn) of all lights, each less its shadow.
    #[inline(always)]
    fn placed(
        &self,
        head: &Headlight<L>,
        rgb: Triple<L::Real>,
        normal: Triple<L::Real>,
        direction: Triple<L::Real>,
        p: Triple<L::Real>,
        cell: Triple<L::Real>,
    ) -> Triple<L::Real> {
        let (zero, one) = (self.lanes.splat(0.0), self.lanes.splat(1.0));
        let least = self.lanes.splat(1e-6);
        let shares = self.shares(cell);
        let [a, b, c, moved] = self.place_from_voxel;
        let place = Triple::of_columns([a, b, c], p).plus(moved);
        let mut sum = Triple::of(zero);
        for (light, share) in self.lights.iter().zip(shares) {
            let mut toward = light.toward;
            if light.is_near {
                let arm = toward.minus(place);
                toward = arm.over(Triple::of(arm.dot(arm).sqrt().max(least)));
            }
            let facing = normal.dot(toward).min(one);
            let mut given = rgb.scaled(head.diffuse * facing);
            if head.has_highlight {
                let between = toward.minus(direction);
                let length = between.dot(between).sqrt().max(least);
                let across = (normal.dot(between).max(zero) / length).min(one);
                given = given.plus(Triple::of(head.highlight(across)));
            }
            let reached = share.or_where_not(zero.lt(facing), zero);
            sum = sum.plus(given.times(light.rgb).scaled(reached));
        }
        sum
    }
}

//! From a value to a colour under the headlight; as `shaders/lib/classify.wgsl`.
//!
//! Colours are display-referred sRGB 0..1, not premultiplied; opacity is that of one sample.

use relief_lanes::{Lanes, Mask as _, Real as _, Triple};

use super::super::request::Shading;
use super::super::tables::Tables;
use relief_volume::GradientTable;

/// Squared length below which a gradient is rounding.
pub(super) const NO_GRADIENT: f64 = 1e-12;

/// A transfer table, and its opacities one behind the other.
pub(super) struct Colors<'a, L: Lanes> {
    lanes: L,
    entries: &'a [[f32; 4]],
    opacities: &'a [f32],
    first_hu: L::Real,
    entries_per_hu: L::Real,
    last: L::Real,
    pub(super) lowest_visible_hu: L::Real,
}

impl<'a, L: Lanes> Colors<'a, L> {
    #[inline(always)]
    pub(super) fn new(lanes: L, tables: &'a Tables, opacities: &'a [f32]) -> Self {
        let table = &tables.own;
        Self {
            lanes,
            entries: &table.entries,
            opacities,
            first_hu: lanes.splat(table.first_hu.into()),
            entries_per_hu: lanes.splat(1.0 / f64::from(table.step_hu)),
            last: lanes.splat((table.entries.len() - 1) as f64),
            lowest_visible_hu: lanes.splat(tables.lowest_visible_hu().into()),
        }
    }

    /// The entries below values, and the values' shares of the way to the next ones.
    #[inline(always)]
    fn entry(&self, hu: L::Real) -> (L::Index, L::Real) {
        let (zero, one) = (self.lanes.splat(0.0), self.lanes.splat(1.0));
        let x = ((hu - self.first_hu) * self.entries_per_hu).clamped(zero, self.last);
        let i = x.floor().min(self.last - one);
        (self.lanes.place(i), x - i)
    }

    /// Opacities of values.
    #[inline(always)]
    pub(super) fn opacity(&self, hu: L::Real) -> L::Real {
        let (at, share) = self.entry(hu);
        let [low, high] = self.lanes.real_pairs(self.opacities, at);
        low.lerp(high, share)
    }

    /// Colours of values.
    #[inline(always)]
    pub(super) fn rgb(&self, hu: L::Real) -> Triple<L::Real> {
        let (at, share) = self.entry(hu);
        let [[r, g, b, _], [r_behind, g_behind, b_behind, _]] = self.lanes.entry_pairs(self.entries, at);
        Triple([r.lerp(r_behind, share), g.lerp(g_behind, share), b.lerp(b_behind, share)])
    }
}

/// Opacity by gradient: a factor of opacity, by the gradient's length.
pub(super) struct GradientOpacity<'a, L: Lanes> {
    lanes: L,
    factors: &'a [f32],
    entries_per_hu_mm: L::Real,
    last: L::Real,
    path_units: L::Real,
}

impl<'a, L: Lanes> GradientOpacity<'a, L> {
    #[inline(always)]
    pub(super) fn new(lanes: L, table: &'a GradientTable) -> Self {
        Self {
            lanes,
            factors: &table.entries,
            entries_per_hu_mm: lanes.splat(table.entries_per_hu_mm.into()),
            last: lanes.splat((table.entries.len() - 1) as f64),
            path_units: lanes.splat(table.path_units.into()),
        }
    }

    /// The factor at gradients, HU/mm.
    #[inline(always)]
    pub(super) fn factor(&self, gradient: Triple<L::Real>) -> L::Real {
        let x = (gradient.dot(gradient).sqrt() * self.entries_per_hu_mm).min(self.last);
        let i = x.floor().min(self.last - self.lanes.splat(1.0));
        let [low, high] = self.lanes.real_pairs(self.factors, self.lanes.place(i));
        low.lerp(high, x - i)
    }

    /// Opacity of samples from that of their values, per opacity unit, and its factor.
    #[inline(always)]
    pub(super) fn modulated(&self, opacity: L::Real, factor: L::Real) -> L::Real {
        let one = self.lanes.splat(1.0);
        let transparency = (one - opacity * factor).max(self.lanes.splat(1e-30));
        one - transparency.pow(self.path_units)
    }
}

/// A share of a highlight that no picture shows.
const FAINT: f64 = 1.0 / (1u32 << 20) as f64;

/// The headlight at the eye, two-sided.
pub(super) struct Headlight<L: Lanes> {
    lanes: L,
    pub(super) needs_gradient: bool,
    pub(super) has_highlight: bool,
    pub(super) ambient: L::Real,
    pub(super) diffuse: L::Real,
    specular: L::Real,
    shininess: L::Real,
    /// The cosine whose highlight is [`FAINT`].
    least_cosine: L::Real,
}

impl<L: Lanes> Headlight<L> {
    #[inline(always)]
    pub(super) fn new(lanes: L, shading: &Shading) -> Self {
        Self {
            lanes,
            needs_gradient: shading.needs_gradient(),
            has_highlight: shading.specular > 0.0,
            ambient: lanes.splat(shading.ambient),
            diffuse: lanes.splat(shading.diffuse),
            specular: lanes.splat(shading.specular),
            shininess: lanes.splat(shading.shininess),
            least_cosine: lanes.splat(FAINT.powf(1.0 / shading.shininess)),
        }
    }

    /// Colours under ambient light alone.
    #[inline(always)]
    pub(super) fn ambient(&self, rgb: Triple<L::Real>) -> Triple<L::Real> {
        rgb.scaled(self.ambient)
    }

    /// Lit colours. A gradient without length has no direction: ambient light alone. `gradient` and
    /// `direction` along the patient axes; the gradient's length does not matter.
    #[inline(always)]
    pub(super) fn lit(
        &self,
        rgb: Triple<L::Real>,
        gradient: Triple<L::Real>,
        direction: Triple<L::Real>,
    ) -> Triple<L::Real> {
        let number = |x: f64| self.lanes.splat(x);
        let length_squared = gradient.dot(gradient);
        let is_flat = length_squared.lt(number(NO_GRADIENT));
        let length = length_squared.max(number(NO_GRADIENT)).sqrt();
        let facing = (gradient.dot(direction).abs() / length).min(number(1.0));
        let light = self.ambient + self.diffuse * facing;
        let highlight = if self.has_highlight { self.highlight(facing) } else { number(0.0) };
        let lit = rgb.scaled(light).plus(Triple::of(highlight));
        self.ambient(rgb).or_where_not([is_flat; 3], lit)
    }
    /// Highlights by the cosine of the angle from their middle. Fainter ones than [`FAINT`] are 0: most
    /// samples have none, and powers take long.
    #[inline(always)]
    pub(super) fn highlight(&self, cosine: L::Real) -> L::Real {
        let shows = self.least_cosine.lt(cosine);
        if !shows.any() {
            return self.lanes.splat(0.0);
        }
        let shine = cosine.max(self.least_cosine).pow(self.shininess);
        self.specular * shine.or_where_not(shows, self.lanes.splat(0.0))
    }
}

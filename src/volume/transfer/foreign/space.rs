//! The colour spaces in which VTK goes from one colour to the next, and the way in each.
//!
//! Display-referred sRGB 0..1 goes in and comes out. Lab is CIE L*a*b* of sRGB under D65;
//! `Diverging` is Moreland's way through Msh, polar coordinates of Lab, with white between two
//! saturated colours (Diverging Color Maps for Scientific Visualization, 2009). The constants are
//! VTK's, so that maps look as they do there; a test compares.

use std::f64::consts::PI;

/// The fraction of the distance between two nodes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum NodeFraction {
    /// A straight line, this share done.
    Line(f64),
    /// A step, before or after it.
    Step {
        /// Whether the step has been taken.
        is_over: bool,
    },
    /// A bent line.
    Bent {
        /// The share, bent already.
        share: f64,
        /// The strength of the bend.
        sharpness: f64,
    },
}

/// The colour space of mixtures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ColorSpace {
    /// Red, green and blue.
    Rgb,
    /// Hue, saturation and value; `wraps` takes the shorter way round the hues.
    Hsv {
        /// Whether red lies between magenta and orange.
        wraps: bool,
    },
    /// CIE L*a*b*.
    Lab,
    /// Moreland's diverging maps.
    Diverging,
    /// No way at all: the colour of the node to the right.
    Step,
}

impl ColorSpace {
    /// The colour between two.
    pub(super) fn between(self, way: NodeFraction, low: [f64; 3], high: [f64; 3]) -> [f64; 3] {
        let mix = |a: [f64; 3], b: [f64; 3]| std::array::from_fn(|c| way.between(a[c], b[c]));
        if let NodeFraction::Step { is_over } = way {
            return if is_over { high } else { low };
        }
        match self {
            Self::Rgb => mix(low, high),
            Self::Hsv { wraps } => {
                let (mut a, mut b) = (hsv_of(low), hsv_of(high));
                if wraps && (a[0] - b[0]).abs() > 0.5 {
                    if a[0] > b[0] { a[0] -= 1.0 } else { b[0] -= 1.0 }
                }
                let mut mixed = mix(a, b);
                if mixed[0] < 0.0 {
                    mixed[0] += 1.0;
                }
                rgb_of_hsv(mixed)
            }
            Self::Lab => rgb_of_lab(mix(lab_of(low), lab_of(high))),
            Self::Diverging => diverging(way, low, high),
            Self::Step => high,
        }
    }
}

fn hsv_of([r, g, b]: [f64; 3]) -> [f64; 3] {
    let (most, least) = (r.max(g).max(b), r.min(g).min(b));
    let spread = most - least;
    if spread <= 0.0 {
        return [0.0, 0.0, most];
    }
    let hue = if r == most {
        (g - b) / spread
    } else if g == most {
        2.0 + (b - r) / spread
    } else {
        4.0 + (r - g) / spread
    };
    [(hue / 6.0).rem_euclid(1.0), spread / most, most]
}

fn rgb_of_hsv([h, s, v]: [f64; 3]) -> [f64; 3] {
    [5.0, 3.0, 1.0].map(|n| {
        let k = (n + h * 6.0).rem_euclid(6.0);
        v - v * s * k.min(4.0 - k).clamp(0.0, 1.0)
    })
}

/// CIE XYZ of white under D65.
const WHITE: [f64; 3] = [0.9505, 1.0, 1.089];

const XYZ_FROM_RGB: [[f64; 3]; 3] =
    [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]];

const RGB_FROM_XYZ: [[f64; 3]; 3] =
    [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]];

fn product(matrix: [[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    matrix.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

fn lab_of(rgb: [f64; 3]) -> [f64; 3] {
    let linear = |c: f64| if c > 0.04045 { ((c + 0.055) / 1.055).powf(2.4) } else { c / 12.92 };
    let xyz = product(XYZ_FROM_RGB, rgb.map(linear));
    let root = |t: f64| if t > 0.008856 { t.cbrt() } else { 7.787 * t + 16.0 / 116.0 };
    let [x, y, z] = std::array::from_fn(|c| root(xyz[c] / WHITE[c]));
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

fn rgb_of_lab([l, a, b]: [f64; 3]) -> [f64; 3] {
    let y = (l + 16.0) / 116.0;
    let cube = |t: f64| if t.powi(3) > 0.008856 { t.powi(3) } else { (t - 16.0 / 116.0) / 7.787 };
    let relative = [a / 500.0 + y, y, y - b / 200.0].map(cube);
    let xyz = std::array::from_fn(|c| relative[c] * WHITE[c]);
    let encode = |c: f64| if c > 0.0031308 { 1.055 * c.powf(1.0 / 2.4) - 0.055 } else { 12.92 * c };
    let rgb = product(RGB_FROM_XYZ, xyz).map(encode);
    // Too bright for a display: the hue stays, the brightness goes.
    let most = rgb.into_iter().fold(1.0, f64::max);
    rgb.map(|channel| (channel / most).max(0.0))
}

/// Magnitude, saturation angle and hue angle.
fn msh_of(rgb: [f64; 3]) -> [f64; 3] {
    let [l, a, b] = lab_of(rgb);
    let m = (l * l + a * a + b * b).sqrt();
    let s = if m > 0.001 { (l / m).clamp(-1.0, 1.0).acos() } else { 0.0 };
    let h = if s > 0.001 { b.atan2(a) } else { 0.0 };
    [m, s, h]
}

fn rgb_of_msh([m, s, h]: [f64; 3]) -> [f64; 3] {
    rgb_of_lab([m * s.cos(), m * s.sin() * h.cos(), m * s.sin() * h.sin()])
}

/// Saturated enough to have a hue.
const HAS_HUE: f64 = 0.05;
/// Magnitude of the white between two hues, at least.
const WHITE_BETWEEN: f64 = 88.0;

fn diverging(way: NodeFraction, low: [f64; 3], high: [f64; 3]) -> [f64; 3] {
    let (mut a, mut b) = (msh_of(low), msh_of(high));
    let mut way = way;
    let apart = (a[2] - b[2]).rem_euclid(2.0 * PI);
    let apart = apart.min(2.0 * PI - apart);
    if a[1] > HAS_HUE && b[1] > HAS_HUE && apart > 0.33 * PI {
        let middle = [a[0].max(b[0]).max(WHITE_BETWEEN), 0.0, 0.0];
        let (is_first, halved) = way.half();
        way = halved;
        if is_first { b = middle } else { a = middle }
    }
    if a[1] < HAS_HUE && b[1] > HAS_HUE {
        a[2] = hue_towards(b, a[0]);
    } else if b[1] < HAS_HUE && a[1] > HAS_HUE {
        b[2] = hue_towards(a, b[0]);
    }
    rgb_of_msh(std::array::from_fn(|c| way.between(a[c], b[c])))
}

/// The hue at which to leave a saturated colour for one without hue of this magnitude: turned so
/// that the way stays smooth in Lab, away from purple.
fn hue_towards([m, s, h]: [f64; 3], magnitude: f64) -> f64 {
    if m >= magnitude - 0.1 {
        return h;
    }
    let turn = s * (magnitude * magnitude - m * m).sqrt() / (m * s.sin());
    if h > -0.3 * PI { h + turn } else { h - turn }
}

impl NodeFraction {
    /// The half of the way that this lies in, and the way within that half.
    fn half(self) -> (bool, Self) {
        let split = |s: f64| if s < 0.5 { (true, 2.0 * s) } else { (false, 2.0 * s - 1.0) };
        match self {
            Self::Line(s) => {
                let (is_first, s) = split(s);
                (is_first, Self::Line(s))
            }
            Self::Bent { share, sharpness } => {
                let (is_first, share) = split(share);
                (is_first, Self::Bent { share, sharpness })
            }
            step @ Self::Step { is_over } => (!is_over, step),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COLORS: [[f64; 3]; 6] = [
        [0.0, 0.0, 0.0],
        [1.0, 1.0, 1.0],
        [0.23, 0.30, 0.75],
        [0.71, 0.02, 0.15],
        [1.0, 0.6, 0.1],
        [0.2, 0.9, 0.4],
    ];

    #[test]
    fn every_space_leads_there_and_back() {
        for color in COLORS {
            for back in [rgb_of_hsv(hsv_of(color)), rgb_of_lab(lab_of(color)), rgb_of_msh(msh_of(color))] {
                for (found, expected) in back.into_iter().zip(color) {
                    assert!((found - expected).abs() < 5e-4, "{color:?} came back as {back:?}");
                }
            }
        }
    }

    #[test]
    fn every_way_begins_and_ends_at_its_colours() {
        use ColorSpace::{Diverging, Hsv, Lab, Rgb};
        for space in [Rgb, Hsv { wraps: true }, Hsv { wraps: false }, Lab, Diverging] {
            for (low, high) in COLORS.into_iter().zip(COLORS.into_iter().cycle().skip(1)) {
                for (share, end) in [(0.0, low), (1.0, high)] {
                    let found = space.between(NodeFraction::Line(share), low, high);
                    let far = found.iter().zip(end).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                    assert!(far < 1e-3, "{space:?} {low:?} {high:?}: {found:?}");
                }
            }
        }
    }

    #[test]
    fn a_diverging_way_passes_white_and_hsv_the_shorter_way_round() {
        let cool_warm = ColorSpace::Diverging.between(NodeFraction::Line(0.5), COLORS[2], COLORS[3]);
        assert!(cool_warm.iter().all(|channel| (channel - 0.865).abs() < 0.01), "{cool_warm:?}");
        let [magenta, orange] = [[1.0, 0.0, 0.5], [1.0, 0.5, 0.0]];
        let short = ColorSpace::Hsv { wraps: true }.between(NodeFraction::Line(0.5), magenta, orange);
        assert!(short[1] < 1e-9 && short[2] < 1e-9, "red lies between: {short:?}");
        let long = ColorSpace::Hsv { wraps: false }.between(NodeFraction::Line(0.5), magenta, orange);
        assert!(long[1] > 0.9, "{long:?}");
    }
}

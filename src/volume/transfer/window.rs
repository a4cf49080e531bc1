//! Windows: a range of values shown as a ramp of greys or of colours.
//!
//! A value is `(hu - center) / width + 0.5` of the ramp, clamped: DICOM's LINEAR_EXACT (PS3.3,
//! C.11.2.1.3). Colours are display-referred sRGB 0..1. On black, a maximum projection with a
//! translucent window looks like a slice with the opaque one.

use super::{ControlPoint, TransferError, TransferFunction};

/// The colours of a window's ramp, from its dark end to its light one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum WindowMap {
    /// Black to white.
    #[default]
    Grey,
    /// Black, red, yellow, white.
    Hot,
    /// Black, blue, cyan, white.
    Ice,
}

impl WindowMap {
    /// All maps.
    pub const ALL: [Self; 3] = [Self::Grey, Self::Hot, Self::Ice];

    /// The name in requests.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Grey => "grey",
            Self::Hot => "hot",
            Self::Ice => "ice",
        }
    }

    /// Share of the ramp, and the colour there; straight lines between.
    const fn stops(self) -> &'static [(f64, [f64; 3])] {
        const BLACK: (f64, [f64; 3]) = (0.0, [0.0; 3]);
        const WHITE: (f64, [f64; 3]) = (1.0, [1.0; 3]);
        match self {
            Self::Grey => &[BLACK, WHITE],
            Self::Hot => &[BLACK, (1.0 / 3.0, [1.0, 0.0, 0.0]), (2.0 / 3.0, [1.0, 1.0, 0.0]), WHITE],
            Self::Ice => &[BLACK, (1.0 / 3.0, [0.0, 0.0, 1.0]), (2.0 / 3.0, [0.0, 1.0, 1.0]), WHITE],
        }
    }
}

/// A range of values and its display.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// The middle of the range, HU, within ±32768.
    pub center_hu: f64,
    /// Its width, HU, 1 to 65536.
    pub width_hu: f64,
    /// Assigns colours to values.
    pub map: WindowMap,
    /// Low values at the light end.
    pub is_inverted: bool,
}

impl Window {
    /// A ramp from black to white.
    #[must_use]
    pub const fn grey(center_hu: f64, width_hu: f64) -> Self {
        Self { center_hu, width_hu, map: WindowMap::Grey, is_inverted: false }
    }

    /// For rays: the brightest channel of a colour is its opacity, and the rest is the colour.
    /// Grey is white of rising opacity.
    ///
    /// # Errors
    /// When the window is narrower than 1 HU or outside ±32768 HU.
    pub fn translucent(&self) -> Result<TransferFunction, TransferError> {
        let stops = self.map.stops();
        let point = |i: usize| {
            let (share, color) = stops[i];
            let opacity = color.into_iter().fold(0.0, f64::max);
            // Black has no colour of its own: that of its neighbour, so that the way between is
            // straight.
            let pure = if opacity > 0.0 { color } else { stops[i + 1].1 };
            let brightest = pure.into_iter().fold(0.0, f64::max);
            let [r, g, b] = pure.map(|channel| channel / brightest);
            (share, [r, g, b, opacity])
        };
        self.through((0..stops.len()).map(point).collect())
    }

    /// For slices: opaque colours.
    ///
    /// # Errors
    /// As [`Window::translucent`].
    pub fn opaque(&self) -> Result<TransferFunction, TransferError> {
        self.through(self.map.stops().iter().map(|&(share, [r, g, b])| (share, [r, g, b, 1.0])).collect())
    }

    fn through(&self, mut stops: Vec<(f64, [f64; 4])>) -> Result<TransferFunction, TransferError> {
        let Self { center_hu, width_hu, .. } = *self;
        if !(1.0..=65536.0).contains(&width_hu) {
            let (what, allowed) = ("width_hu", "1 to 65536");
            return Err(TransferError::Window { what, found: width_hu, allowed });
        }
        if !(-32768.0..=32768.0).contains(&center_hu) {
            let (what, allowed) = ("center_hu", "-32768 to 32768");
            return Err(TransferError::Window { what, found: center_hu, allowed });
        }
        if self.is_inverted {
            stops.reverse();
            for (share, _) in &mut stops {
                *share = 1.0 - *share;
            }
        }
        let point = |(share, rgba)| ControlPoint { hu: center_hu + (share - 0.5) * width_hu, rgba };
        TransferFunction::new(stops.into_iter().map(point).collect(), 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_translucent_window_on_black_is_the_opaque_one() {
        for map in WindowMap::ALL {
            for is_inverted in [false, true] {
                let window = Window { map, is_inverted, ..Window::grey(40.0, 400.0) };
                let (rays, slice) = (window.translucent().unwrap(), window.opaque().unwrap());
                for hu in (-300..=400).step_by(7).map(f64::from) {
                    let ([r, g, b, opacity], seen) = (rays.at(hu), slice.at(hu));
                    let on_black = [r * opacity, g * opacity, b * opacity];
                    let off = on_black.iter().zip(seen).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                    assert!(off < 1e-12, "{map:?}, inverted {is_inverted}, {hu} HU: {on_black:?} {seen:?}");
                }
            }
        }
    }

    #[test]
    fn inverting_turns_the_ramp_round_its_centre() {
        for map in WindowMap::ALL {
            let window = Window { map, ..Window::grey(100.0, 200.0) };
            let inverted = Window { is_inverted: true, ..window };
            let (plain, turned) = (window.opaque().unwrap(), inverted.opaque().unwrap());
            for off in [-300.0, -100.0, -61.0, 0.0, 33.0, 100.0, 500.0] {
                let pair = plain.at(100.0 + off).into_iter().zip(turned.at(100.0 - off));
                assert!(pair.into_iter().all(|(a, b)| (a - b).abs() < 1e-12), "{map:?} {off}");
            }
        }
    }

    #[test]
    fn every_ramp_rises_from_black_to_white() {
        for map in WindowMap::ALL {
            let ramp = Window { map, ..Window::grey(0.0, 100.0) }.opaque().unwrap();
            assert_eq!(
                (ramp.at(-50.0)[..3].to_vec(), ramp.at(50.0)[..3].to_vec()),
                (vec![0.0; 3], vec![1.0; 3])
            );
            let light = |hu: f64| ramp.at(hu)[..3].iter().sum::<f64>();
            assert!((-50..50).all(|hu| light(f64::from(hu) + 1.0) > light(f64::from(hu))), "{map:?}");
        }
    }
}

//! A SpaceMouse, as spacenavd reports it: the cap turns, shifts and zooms the view. While the first
//! button is held, the cap moves the cursor. The second button places a landmark at the cursor.
//!
//! spacenavd sends events of eight 32-bit integers in the machine's byte order. Type 0 is a movement:
//! x right, y up, z away from the user, the rotations about these axes, and the time since the last
//! event, ms. Type 1 is a pressed button and type 2 a released one, with its number. The signs are
//! those of `spnav_posrot_moveobj` in libspnav 1.0: positions (x, y, -z), rotations (rx, ry, -rz).

use glam::{DQuat, DVec3};

use super::{Intent, PlacePhase};

/// Bytes of an event.
pub const SPACENAV_EVENT_BYTES: usize = 32;
/// Deflection that counts as full: what devices reach with the usual sensitivity.
const FULL: f64 = 350.0;
/// Speeds at full deflection, per second: degrees of turning, heights of the picture, exponent of
/// zooming, mm of the cursor.
const TURN_DEG_S: f64 = 120.0;
const PAN_S: f64 = 0.8;
const ZOOM_S: f64 = 1.2;
const CURSOR_MM_S: f64 = 60.0;
/// Longest time that one event counts for, s: the first one after a rest reports the whole rest.
const LONGEST_S: f64 = 0.05;
/// One event of spacenavd.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SpaceMouseEvent {
    /// The cap is moved.
    Motion {
        /// Shares of full deflection along the view axes.
        shift: DVec3,
        /// Shares of full deflection about the view axes.
        turn: DVec3,
        /// Duration, s.
        seconds: f64,
    },
    /// A button is pressed or released.
    Button {
        /// Its number, from 0.
        number: i32,
        /// Whether it is pressed now.
        is_pressed: bool,
    },
    /// Something else.
    Other,
}

impl SpaceMouseEvent {
    /// Reads an event in the machine's byte order.
    #[must_use]
    pub fn read(bytes: &[u8; SPACENAV_EVENT_BYTES]) -> Self {
        let mut numbers = [0; 8];
        for (number, bytes) in numbers.iter_mut().zip(bytes.as_chunks::<4>().0) {
            *number = i32::from_ne_bytes(*bytes);
        }
        let [kind, x, y, z, rx, ry, rz, period_ms] = numbers;
        let share = |value: i32| (f64::from(value) / FULL).clamp(-1.0, 1.0);
        match kind {
            0 => Self::Motion {
                shift: DVec3::new(share(x), share(y), -share(z)),
                turn: DVec3::new(share(rx), share(ry), -share(rz)),
                seconds: (f64::from(period_ms) / 1e3).clamp(0.0, LONGEST_S),
            },
            1 | 2 => Self::Button { number: x, is_pressed: kind == 1 },
            _ => Self::Other,
        }
    }

    /// Its effect on the view; `moves_cursor` while the first button is held.
    #[must_use]
    pub fn intents(self, moves_cursor: bool) -> Vec<Intent> {
        match self {
            Self::Motion { shift: DVec3::ZERO, .. } if moves_cursor => Vec::new(),
            Self::Motion { shift, seconds, .. } if moves_cursor => {
                let by = shift * CURSOR_MM_S * seconds;
                vec![Intent::Cursor {
                    at_px: None,
                    at_view_mm: None,
                    by_view_mm: Some(by.to_array()),
                    point_mm: None,
                }]
            }
            Self::Motion { shift, turn, seconds } => {
                let rotation = DQuat::from_scaled_axis(turn * (TURN_DEG_S * seconds).to_radians());
                let mut intents = Vec::new();
                if turn != DVec3::ZERO {
                    intents.push(Intent::Turn { rotation_xyzw: rotation.to_array() });
                }
                if shift.truncate() != glam::DVec2::ZERO {
                    let [right, up] = (shift.truncate() * PAN_S * seconds).to_array();
                    intents.push(Intent::Pan { right, up });
                }
                if shift.z != 0.0 {
                    // Towards the viewer is closer.
                    intents.push(Intent::Zoom { factor: (shift.z * ZOOM_S * seconds).exp() });
                }
                intents
            }
            Self::Button { number: 1, is_pressed: true } => vec![Intent::Place { phase: PlacePhase::Commit }],
            Self::Button { .. } | Self::Other => Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(numbers: [i32; 8]) -> SpaceMouseEvent {
        let bytes: Vec<u8> = numbers.iter().flat_map(|number| number.to_ne_bytes()).collect();
        SpaceMouseEvent::read(bytes.as_array().unwrap())
    }

    #[test]
    fn movements_are_shares_of_the_full_deflection_for_their_time() {
        let motion = event([0, 350, -175, 70, 0, 700, 0, 10]);
        let SpaceMouseEvent::Motion { shift, turn, seconds } = motion else { panic!("{motion:?}") };
        assert_eq!((shift, turn, seconds), (DVec3::new(1.0, -0.5, -0.2), DVec3::new(0.0, 1.0, 0.0), 0.01));
        let [Intent::Turn { rotation_xyzw }, Intent::Pan { right, up }, Intent::Zoom { factor }] =
            &*motion.intents(false)
        else {
            panic!("{motion:?}")
        };
        let turned = DQuat::from_array(*rotation_xyzw).to_scaled_axis();
        assert!((turned - DVec3::Y * 1.2_f64.to_radians()).length() < 1e-9, "{turned}");
        assert!(
            (right - 0.008).abs() < 1e-12 && (up + 0.004).abs() < 1e-12 && *factor < 1.0,
            "{right} {up} {factor}"
        );
        let [Intent::Cursor { by_view_mm: Some(by), .. }] = &*motion.intents(true) else {
            panic!("{motion:?}")
        };
        assert!((DVec3::from(*by) - DVec3::new(0.6, -0.3, -0.12)).length() < 1e-12, "{by:?}");
    }

    #[test]
    fn buttons_hold_the_cursor_and_place() {
        assert_eq!(event([1, 0, 0, 0, 0, 0, 0, 0]), SpaceMouseEvent::Button { number: 0, is_pressed: true });
        assert_eq!(event([2, 0, 0, 0, 0, 0, 0, 0]), SpaceMouseEvent::Button { number: 0, is_pressed: false });
        assert_eq!(
            event([1, 1, 0, 0, 0, 0, 0, 0]).intents(false),
            vec![Intent::Place { phase: PlacePhase::Commit }]
        );
        assert_eq!(event([i32::MIN, i32::MIN, 0, 0, 0, 0, 0, i32::MIN]).intents(true), vec![]);
        let still = event([0, 0, 0, 0, 0, 0, 0, i32::MAX]);
        assert_eq!(still.intents(false), vec![]);
    }
}

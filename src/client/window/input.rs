//! Mouse and keys as intents.

use winit::event::{ElementState, MouseButton, MouseScrollDelta};
use winit::keyboard::{Key, ModifiersState, NamedKey};

use crate::place::PicturePlace;
use relief_live::{Intent, PlacePhase};

/// Degrees for each pixel of the picture that is dragged.
const DEG_PER_PX: f64 = 0.4;
/// Degrees for each press of an arrow.
const DEG_PER_KEY: f64 = 5.0;
/// Closer by this for each step of the wheel, or press of a key.
const ZOOM_STEP: f64 = 1.1;
/// Pixels that a touchpad scrolls for a step.
const PX_PER_STEP: f64 = 20.0;
const CLIP_STEP_MM: f64 = 5.0;

/// The effect of a key.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Meaning {
    Intent(Intent),
    Fullscreen,
    Quit,
}

/// The state of mouse and keys.
#[derive(Debug, Default)]
pub(super) struct Input {
    at: Option<[f64; 2]>,
    turning: bool,
    shifting: bool,
    control: bool,
}

impl Input {
    pub(super) fn modifiers(&mut self, state: ModifiersState) {
        self.control = state.control_key();
    }

    /// The mouse moved to this place of the frame.
    pub(super) fn moved(&mut self, to: [f64; 2], place: PicturePlace) -> Option<Intent> {
        let from = self.at.replace(to)?;
        let (dx, dy) = (to[0] - from[0], (to[1] - from[1]) / place.step as f64);
        if self.turning {
            return Some(Intent::Orbit { azimuth_deg: -dx * DEG_PER_PX, elevation_deg: dy * DEG_PER_PX });
        }
        let height = place.rows.max(1) as f64;
        self.shifting.then(|| Intent::Pan { right: dx / height, up: -dy / height })
    }

    pub(super) fn button(
        &mut self,
        button: MouseButton,
        state: ElementState,
        place: PicturePlace,
    ) -> Option<Intent> {
        let pressed = state == ElementState::Pressed;
        match button {
            MouseButton::Left if pressed && self.control => {
                let at_px = place.pixel(self.at?)?;
                Some(Intent::Cursor {
                    at_px: Some(at_px),
                    at_view_mm: None,
                    by_view_mm: None,
                    point_mm: None,
                })
            }
            MouseButton::Left => {
                self.turning = pressed;
                None
            }
            MouseButton::Right => {
                self.shifting = pressed;
                None
            }
            _ => None,
        }
    }

    pub(super) fn wheel(delta: MouseScrollDelta) -> Option<Intent> {
        let steps = match delta {
            MouseScrollDelta::LineDelta(_, y) => f64::from(y),
            MouseScrollDelta::PixelDelta(position) => position.y / PX_PER_STEP,
        };
        let factor = ZOOM_STEP.powf(steps.clamp(-20.0, 20.0));
        (steps != 0.0).then_some(Intent::Zoom { factor })
    }

    /// The meaning of pressing or releasing a key.
    pub(super) fn key(key: &Key, state: ElementState, repeat: bool) -> Option<Meaning> {
        let orbit = |azimuth, elevation| Intent::Orbit {
            azimuth_deg: azimuth * DEG_PER_KEY,
            elevation_deg: elevation * DEG_PER_KEY,
        };
        let clip = |steps: f64| Intent::Clip { by_mm: Some(steps * CLIP_STEP_MM), to_mm: None };
        let preset = |step| Intent::Preset { name: None, step: Some(step) };
        if *key == Key::Named(NamedKey::Space) {
            let phase = if state == ElementState::Pressed { PlacePhase::Take } else { PlacePhase::Commit };
            return (!repeat).then_some(Meaning::Intent(Intent::Place { phase }));
        }
        if state == ElementState::Released {
            return None;
        }
        // Held keys go on turning and zooming, and do nothing else twice.
        let goes_on = match key.as_ref() {
            Key::Named(NamedKey::ArrowLeft) => Some(orbit(-1.0, 0.0)),
            Key::Named(NamedKey::ArrowRight) => Some(orbit(1.0, 0.0)),
            Key::Named(NamedKey::ArrowUp) => Some(orbit(0.0, 1.0)),
            Key::Named(NamedKey::ArrowDown) => Some(orbit(0.0, -1.0)),
            Key::Named(NamedKey::PageUp) => Some(clip(-1.0)),
            Key::Named(NamedKey::PageDown) => Some(clip(1.0)),
            Key::Character("+" | "=") => Some(Intent::Zoom { factor: ZOOM_STEP }),
            Key::Character("-") => Some(Intent::Zoom { factor: 1.0 / ZOOM_STEP }),
            _ => None,
        };
        if let Some(intent) = goes_on {
            return Some(Meaning::Intent(intent));
        }
        let once = match key.as_ref() {
            Key::Character("[") => Meaning::Intent(preset(-1)),
            Key::Character("]") => Meaning::Intent(preset(1)),
            Key::Character("u" | "U") => Meaning::Intent(Intent::Undo {}),
            Key::Character("n" | "N") => Meaning::Intent(Intent::NextLabel {}),
            Key::Character("r" | "R") | Key::Named(NamedKey::Home) => Meaning::Intent(Intent::Reset {}),
            Key::Character("f" | "F") => Meaning::Fullscreen,
            Key::Character("q" | "Q") | Key::Named(NamedKey::Escape) => Meaning::Quit,
            _ => return None,
        };
        (!repeat).then_some(once)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relief_display::Layout;

    const PRESSED: ElementState = ElementState::Pressed;

    #[test]
    fn dragging_turns_by_pixels_of_the_picture() {
        let place = PicturePlace::of(Layout::Wowvx, [1920, 1080]);
        let mut input = Input::default();
        assert_eq!(input.moved([10.0, 10.0], place), None);
        assert_eq!(input.moved([20.0, 10.0], place), None, "no button is held");
        input.button(MouseButton::Left, PRESSED, place);
        let turned = input.moved([30.0, 50.0], place);
        assert_eq!(turned, Some(Intent::Orbit { azimuth_deg: -4.0, elevation_deg: 8.0 }));
        input.button(MouseButton::Left, ElementState::Released, place);
        input.button(MouseButton::Right, PRESSED, place);
        let shifted = input.moved([30.0 + 540.0, 50.0], place);
        assert_eq!(shifted, Some(Intent::Pan { right: 1.0, up: 0.0 }));
    }

    #[test]
    fn control_and_click_set_the_cursor_in_the_picture_alone() {
        let place = PicturePlace::of(Layout::Wowvx, [1920, 1080]);
        let mut input = Input::default();
        input.modifiers(ModifiersState::CONTROL);
        input.moved([100.5, 400.0], place);
        let Some(Intent::Cursor { at_px, .. }) = input.button(MouseButton::Left, PRESSED, place) else {
            panic!("no cursor")
        };
        assert_eq!(at_px, Some([100.5, 200.0]));
        input.moved([1100.5, 400.0], place);
        assert_eq!(input.button(MouseButton::Left, PRESSED, place), None, "depth has no place for a cursor");
    }

    #[test]
    fn every_intent_of_keys_and_wheel_is_valid() {
        let keys = [NamedKey::ArrowLeft, NamedKey::PageDown, NamedKey::Home, NamedKey::Space].map(Key::Named);
        let letters = ["+", "-", "[", "]", "u", "n", "r"].map(|c| Key::Character(c.into()));
        for key in keys.into_iter().chain(letters) {
            match Input::key(&key, PRESSED, false) {
                Some(Meaning::Intent(intent)) => intent.validate().unwrap(),
                other => panic!("{key:?}: {other:?}"),
            }
        }
        for steps in [1e9, -1e9, 0.5] {
            Input::wheel(MouseScrollDelta::LineDelta(0.0, steps)).unwrap().validate().unwrap();
        }
        assert_eq!(Input::key(&Key::Character("u".into()), PRESSED, true), None, "held, it undoes once");
    }
}

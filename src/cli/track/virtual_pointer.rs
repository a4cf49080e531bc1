//! The Wiimote as an absolute pointer of the desktop, by the kernel's uinput.
//!
//! The pointer is where the Wiimote's ray meets the screen. The names of the other keys are those of
//! a keyboard, because desktops know them.

use std::path::PathBuf;

use anyhow::Context;
use evdev::uinput::VirtualDevice;
use evdev::{
    AbsInfo, AbsoluteAxisCode, AbsoluteAxisEvent, AttributeSet, InputEvent, KeyCode, KeyEvent, UinputAbsSetup,
};
use relief_tracking::{Buttons, SensorPose, ToolPlacement};

use crate::tool_placement::read_placement;

const NAME: &str = "Relief Wiimote pointer";
/// The right and the lower edge of the screen.
const FARTHEST: i32 = 65_535;

/// The key of each button for other programs.
const KEYS: [(Buttons, KeyCode); 11] = [
    (Buttons::A, KeyCode::BTN_LEFT),
    (Buttons::B, KeyCode::BTN_RIGHT),
    (Buttons::ONE, KeyCode::BTN_SIDE),
    (Buttons::TWO, KeyCode::BTN_EXTRA),
    (Buttons::LEFT, KeyCode::KEY_LEFT),
    (Buttons::RIGHT, KeyCode::KEY_RIGHT),
    (Buttons::UP, KeyCode::KEY_UP),
    (Buttons::DOWN, KeyCode::KEY_DOWN),
    (Buttons::PLUS, KeyCode::KEY_PAGEUP),
    (Buttons::MINUS, KeyCode::KEY_PAGEDOWN),
    (Buttons::HOME, KeyCode::KEY_HOME),
];

#[derive(Debug, clap::Args)]
pub(super) struct VirtualPointerArguments {
    /// Offer the Wiimote to this desktop as a pointer, on a screen of this size in mm. Needs write
    /// permission for /dev/uinput
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = screen_size)]
    uinput: Option<[f64; 2]>,
    /// Where the beacon is: display_from_tracker of JSON as in relief client --tracker-geometry, from
    /// the beacon to the centre of the screen; the beacon is at the centre where left out
    #[arg(long, value_name = "FILE.json", requires = "uinput")]
    tracker_geometry: Option<PathBuf>,
}

/// A device of the kernel, which is there as long as this value.
pub(super) struct VirtualPointer {
    device: VirtualDevice,
    placement: ToolPlacement,
    size_mm: [f64; 2],
    held: Buttons,
    /// Where the pointer is, in units of the device.
    at: Option<[i32; 2]>,
}

fn screen_size(text: &str) -> Result<[f64; 2], String> {
    let sizes = text.split_once('x').and_then(|(width, height)| {
        let side = |text: &str| text.parse().ok().filter(|mm| (10.0..=20_000.0).contains(mm));
        Some([side(width)?, side(height)?])
    });
    sizes.ok_or_else(|| "sizes are WIDTHxHEIGHT in mm, 10 to 20000 each, such as 930x523".to_owned())
}

impl VirtualPointerArguments {
    /// Creates the chosen device.
    pub(super) fn create(&self) -> anyhow::Result<Option<VirtualPointer>> {
        let Some(size_mm) = self.uinput else { return Ok(None) };
        let placement = read_placement(self.tracker_geometry.as_deref())?;
        let device = device().context(
            "cannot create a pointer by /dev/uinput. Load the kernel module uinput (modprobe uinput), and give this \
             user permission to write to /dev/uinput",
        )?;
        eprintln!("{NAME} on a screen of {} by {} mm", size_mm[0], size_mm[1]);
        Ok(Some(VirtualPointer { device, placement, size_mm, held: Buttons::default(), at: None }))
    }
}

fn device() -> std::io::Result<VirtualDevice> {
    let range = AbsInfo::new(0, 0, FARTHEST, 0, 0, 0);
    VirtualDevice::builder()?
        .name(NAME)
        .with_keys(&KEYS.iter().map(|(_, key)| *key).collect::<AttributeSet<KeyCode>>())?
        .with_absolute_axis(&UinputAbsSetup::new(AbsoluteAxisCode::ABS_X, range))?
        .with_absolute_axis(&UinputAbsSetup::new(AbsoluteAxisCode::ABS_Y, range))?
        .build()
}

impl VirtualPointer {
    /// Moves the pointer and its buttons; without a pose it stays where it is.
    pub(super) fn update(&mut self, pose: Option<&SensorPose>, buttons: Buttons) -> anyhow::Result<()> {
        let mut events: Vec<InputEvent> = Vec::new();
        let at = pose.and_then(|pose| self.placement.aim(pose)).map(|mm| place(mm, self.size_mm));
        if let Some(at @ [x, y]) = at.filter(|at| self.at != Some(*at)) {
            events.push(AbsoluteAxisEvent::new(AbsoluteAxisCode::ABS_X, x).into());
            events.push(AbsoluteAxisEvent::new(AbsoluteAxisCode::ABS_Y, y).into());
            self.at = Some(at);
        }
        for (button, key) in KEYS {
            if self.held.contains(button) != buttons.contains(button) {
                events.push(KeyEvent::new(key, i32::from(buttons.contains(button))).into());
            }
        }
        self.held = buttons;
        if !events.is_empty() {
            self.device.emit(&events).context("the pointer by /dev/uinput is gone")?;
        }
        Ok(())
    }
}

/// The device's units of a point to the right and up from the screen's centre; beside the screen the
/// nearest edge.
fn place([right, up]: [f64; 2], [width, height]: [f64; 2]) -> [i32; 2] {
    [right / width, -up / height]
        .map(|share| ((share + 0.5).clamp(0.0, 1.0) * f64::from(FARTHEST)).round() as i32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_screen_is_the_whole_range() {
        let size = [930.0, 523.0];
        assert_eq!(place([0.0, 0.0], size), [32_768, 32_768]);
        assert_eq!(place([-465.0, 261.5], size), [0, 0]);
        assert_eq!(place([465.0, -261.5], size), [FARTHEST, FARTHEST]);
        assert_eq!(place([-5000.0, -5000.0], size), [0, FARTHEST]);
    }

    #[test]
    fn sizes_are_two_lengths() {
        assert_eq!(screen_size("930x523"), Ok([930.0, 523.0]));
        for wrong in ["", "930", "930x", "x5", "0x523", "930x-1", "nanx5", "1e9x5"] {
            assert!(screen_size(wrong).is_err(), "{wrong}");
        }
    }
}

//! `relief inspect PANEL.json`: the lenses of a panel, and the address of the kiosk page for it.

use std::path::Path;
use std::process::ExitCode;

use crate::output::{print_json, say};
use crate::panel::read_panel;
use relief_display::{LensPanel, Subpixels};

pub(super) fn run(path: &Path, json: bool) -> anyhow::Result<ExitCode> {
    let panel = read_panel(path)?;
    if json {
        print_json(&panel)?;
    } else {
        let LensPanel { pitch_px, slant, center, subpixels, is_reversed, view_cone_deg } = panel;
        let order = if subpixels == Subpixels::Rgb { "red, green, blue" } else { "blue, green, red" };
        say!("pitch      {pitch_px:.6} pixels from lens to lens");
        say!("slant      {slant:.6} pixels to the left on the next line");
        say!("center     {center:.6} lenses at the top left corner");
        say!("subpixels  {order}");
        say!("views      from {}", if is_reversed { "right to left" } else { "left to right" });
        if let Some(cone_deg) = view_cone_deg {
            say!("view cone  {cone_deg} degrees from the first view to the last");
        }
        say!("kiosk      {}", address(&panel));
    }
    Ok(ExitCode::SUCCESS)
}

/// The parameters of the kiosk page for a panel.
fn address(panel: &LensPanel) -> String {
    let LensPanel { pitch_px, slant, center, .. } = panel;
    let bgr = if panel.subpixels == Subpixels::Bgr { "&subpixels=bgr" } else { "" };
    let swap = if panel.is_reversed { "&swap" } else { "" };
    format!("output=lenses&lens={pitch_px:.6},{slant:.6},{center:.6}{bgr}{swap}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kiosk_gets_every_value_of_the_panel() {
        let panel = LensPanel { pitch_px: 4.5, slant: 0.25, ..LensPanel::default() };
        assert_eq!(address(&panel), "output=lenses&lens=4.500000,0.250000,0.000000");
        let reversed = LensPanel { subpixels: Subpixels::Bgr, is_reversed: true, ..panel };
        assert!(address(&reversed).ends_with("&subpixels=bgr&swap"), "{}", address(&reversed));
    }
}

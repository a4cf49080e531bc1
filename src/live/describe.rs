//! Descriptions of the protocol for programs, filled from the code's tables.

use std::sync::LazyLock;

use relief_display::{BackStart, DisplayProfile, FrameContent, Layout, MAX_VIEWS, ProfileName, ViewGrid};
use serde_json::json;

use super::format::LiveLayout;

/// The description without its layouts.
const TEMPLATE: &str = include_str!("protocol.json");
const NO_LAYOUTS: &str = "\"layouts\": {}";

/// The protocol for programs: header, formats, close codes, and JSON Schemas of all messages.
#[must_use]
pub fn protocol() -> &'static str {
    static PROTOCOL: LazyLock<String> = LazyLock::new(|| {
        let rows =
            LiveLayout::all().map(|layout| format!("    \"{}\": \"{}\"", layout.byte(), layout.name()));
        let rows: Vec<String> = rows.collect();
        TEMPLATE.replace(NO_LAYOUTS, &format!("\"layouts\": {{\n{}\n  }}", rows.join(",\n")))
    });
    &PROTOCOL
}

/// The JavaScript module from which pages compose frames: `LAYOUTS`, by the number in the header.
#[must_use]
pub fn layouts_script() -> &'static str {
    static SCRIPT: LazyLock<String> = LazyLock::new(|| {
        let rows = Layout::TABLE.iter().filter_map(|info| Some((info.live_byte?, info)));
        let rows = rows.map(|(byte, info)| {
            let placement = match info.content {
                FrameContent::Disparity(placement) => json!({
                    "frameLines": placement.frame_lines,
                    "lineStep": placement.line_step,
                    "back": placement.back.map(|start| match start {
                        BackStart::Below => "below",
                        BackStart::LineOne => "line-one",
                    }),
                }),
                _ => json!(null),
            };
            let row = json!({ "name": info.name, "hasHeader": info.has_header, "placement": placement });
            format!("  {byte}: {row},\n")
        });
        let profiles = ProfileName::ALL.map(|name| {
            let profile = DisplayProfile::named(name);
            let row = json!({ "m": profile.constants().m, "screenWidthMm": profile.screen_width_mm() });
            format!("  {}: {row},\n", json!(name.name()))
        });
        let grids = (2..=MAX_VIEWS).filter_map(ViewGrid::of_count);
        let grids = grids.map(|grid| format!("  {}: [{}, {}],\n", grid.count(), grid.columns(), grid.rows()));
        format!(
            "// Layouts that live clients compose, by the number in the header of a frame. Made from\n\
             // the server's table.\nexport const LAYOUTS = {{\n{}}};\n\n\
             // Displays: slope of their parallax by disparity, and width of their screens.\n\
             export const PROFILES = {{\n{}}};\n\n\
             // Columns and rows of the usual quilt of a number of views.\n\
             export const GRIDS = {{\n{}}};\n",
            rows.collect::<String>(),
            profiles.concat(),
            grids.collect::<String>()
        )
    });
    &SCRIPT
}

//! The protocol of live sessions: whatever is written reads back, whatever comes from outside is a
//! value or an error, and docs/LIVE.md, protocol.json and the code say the same.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod bytes;
mod document;
mod messages;

use relief_display::{DisplaySettings, Layout};
use relief_live::{ColorFormat, DepthFormat, FrameHeader, LiveLayout};

fn header() -> FrameHeader {
    FrameHeader {
        still: true,
        back_layer: false,
        color: ColorFormat::RgbZstd,
        depth: DepthFormat::D8Zstd,
        sequence: 7,
        shows_seq: 1 << 40,
        shows_t_ns: 123_456_789_012,
        total_us: 50_000,
        render_us: 40_000,
        wait_us: 6_000,
        encode_us: 3_000,
        size_px: [8, 4],
        full_px: [8, 4],
        limits_mm: [100.0, 300.0],
        display: DisplaySettings::default().header().fields(),
        layout: LiveLayout::Of(Layout::Wowvx),
        color_bytes: 0,
        depth_bytes: 0,
        eye_mm: [0.0, -900.0, 40.0],
        look_at_mm: [0.0, 0.0, 40.0],
        up: [0.0, 0.0, 1.0],
        projection: [22.0, 0.0],
    }
}

//! `relief inspect FRAME.png`: which layout a frame has, what its header says, what is wrong and what to do.
//!
//! Exit status 0 when nothing is wrong, 1 when something is.

use std::fmt::Write as _;
use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, ensure};

use super::output;
use crate::display::{FrameReport, Layout, inspect_png};

/// The largest file that is read: more than an uncompressed frame of the largest size needs.
const MAX_FILE_BYTES: u64 = 1 << 30;

pub(super) fn run(path: &Path, json: bool) -> anyhow::Result<ExitCode> {
    let file = read_bounded(path).with_context(|| format!("cannot read {}", path.display()))?;
    let report = inspect_png(&file).with_context(|| format!("cannot inspect {}", path.display()))?;
    if json {
        output::print_json(&report)?;
    } else {
        print!("{}", readable(&report));
    }
    Ok(if report.problems.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn read_bounded(path: &Path) -> anyhow::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    File::open(path)?.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes)?;
    ensure!(bytes.len() as u64 <= MAX_FILE_BYTES, "the file is larger than 1 GiB; frames are smaller");
    Ok(bytes)
}

fn readable(report: &FrameReport) -> String {
    let mut text = String::new();
    let [width, height] = report.frame_px;
    let mut line = |name: &str, value: std::fmt::Arguments<'_>| {
        let _ = writeln!(text, "{name:<9} {value}"); // a String takes everything
    };
    line("layout", format_args!("{} ({})", report.layout, description(report.layout)));
    line("frame", format_args!("{width}x{height}"));
    line("header", format_args!("{}", report.header_hex.as_deref().unwrap_or("none")));
    if let (Some(factor), Some(offset), Some(select)) = (report.factor, report.offset, report.select) {
        let source = |selected| if selected { "to be used" } else { "the display's own optimum is used" };
        let content = report.content.map_or("unknown".to_owned(), |content| content.to_string());
        line("content", format_args!("{content}"));
        line("factor", format_args!("{factor} = {:.0} % ({})", f64::from(factor) / 0.64, source(select.factor)));
        line("offset", format_args!("{offset} ({})", source(select.offset)));
    }
    if let Some(extended) = &report.extended_hex {
        line("extended", format_args!("{extended}"));
    }
    if let Some(depth) = report.depth {
        let far = 100.0 * depth.at_far_limit as f64 / depth.pixels.max(1) as f64;
        line("depth", format_args!(
            "{} (farthest) to {} (nearest), {} values, {far:.1} % at the far limit",
            depth.farthest, depth.nearest, depth.distinct
        ));
    }
    line("problems", format_args!("{}", problems(report)));
    text
}

const fn description(layout: Layout) -> &'static str {
    match layout {
        Layout::Wowvx => "picture and depth side by side on the even lines, odd lines black",
        Layout::WowvxFullHeight | Layout::Wowvx4k => "picture and depth side by side on all lines",
        Layout::Rgbd => "picture and depth side by side, no header: WoWvx displays show it as plain 2D",
        Layout::Color => "a plain picture, or no layout that is known",
        Layout::Depth16 => "depth alone in 16 bits, nearest brightest",
    }
}

fn problems(report: &FrameReport) -> String {
    if report.problems.is_empty() {
        return "none".to_owned();
    }
    let mut text = report.problems.len().to_string();
    for problem in &report.problems {
        let _ = write!(text, "\n  {}: {problem}\n    {}", problem.code(), problem.advice());
    }
    text
}

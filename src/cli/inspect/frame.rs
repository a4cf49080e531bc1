//! `relief inspect FRAME.png`: layout, header and errors of a frame, with remedies.
//!
//! Exit status 0 when nothing is wrong, 1 when something is.

use std::fmt::Write as _;
use std::path::Path;
use std::process::ExitCode;

use anyhow::Context;

use crate::against_true::AgainstTrue;
use crate::frame_file::read_bounded;
use crate::output::{self, say};
use crate::preview::{ViewOptions, views};
use relief_display::{FrameReport, Layout, inspect_png};

pub(crate) fn run(
    path: &Path,
    against_true: &AgainstTrue,
    view_span: Option<f64>,
    json: bool,
) -> anyhow::Result<ExitCode> {
    let file = read_bounded(path).with_context(|| format!("cannot read {}", path.display()))?;
    let report = inspect_png(&file).with_context(|| format!("cannot inspect {}", path.display()))?;
    let options = ViewOptions { view_span, ..ViewOptions::default() };
    let likeness = against_true.compare_made(|layout| {
        let made = views(options, layout, &file);
        Ok(made.with_context(|| format!("cannot make views of {}", path.display()))?.0)
    })?;
    if json {
        let against_true = likeness.map(|likeness| likeness.report());
        output::print_json(&Compared { report: &report, against_true })?;
    } else {
        say!("{}", readable(&report).trim_end());
        if let Some(likeness) = likeness {
            say!("likeness  {}", likeness.words());
        }
    }
    Ok(if report.problems.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// The report as JSON.
#[derive(serde::Serialize)]
struct Compared<'a> {
    #[serde(flatten)]
    report: &'a FrameReport,
    /// The likeness of the views to true ones, where they were compared.
    #[serde(skip_serializing_if = "Option::is_none")]
    against_true: Option<serde_json::Value>,
}

fn readable(report: &FrameReport) -> String {
    let mut text = String::new();
    let [width, height] = report.frame_px;
    let mut line = |name: &str, value: std::fmt::Arguments<'_>| {
        let _ = writeln!(text, "{name:<9} {value}"); // a String takes everything
    };
    line("layout", format_args!("{} ({})", report.layout, report.layout.info().summary));
    line("frame", format_args!("{width}x{height}"));
    line("header", format_args!("{}", report.header_hex.as_deref().unwrap_or("none")));
    if let (Some(factor), Some(offset), Some(select)) = (report.factor, report.offset, report.select) {
        let source = |selected| if selected { "to be used" } else { "the display's own optimum is used" };
        let content = report.content.map_or("unknown".to_owned(), |content| content.to_string());
        line("content", format_args!("{content}"));
        line(
            "factor",
            format_args!("{factor} = {:.0} % ({})", f64::from(factor) / 0.64, source(select.factor)),
        );
        line("offset", format_args!("{offset} ({})", source(select.offset)));
    }
    if let Some(extended) = &report.extended_hex {
        line("extended", format_args!("{extended}"));
    }
    if let Some(depth) = report.depth {
        let far = 100.0 * depth.at_far_limit as f64 / depth.pixels.max(1) as f64;
        line(
            "depth",
            format_args!(
                "{} (farthest) to {} (nearest), {} values, {far:.1} % at the far limit",
                depth.farthest, depth.nearest, depth.distinct
            ),
        );
    }
    if let Some(views) = report.views {
        let ([width, height], order) = (views.size_px, "the leftmost at the bottom left, rows upwards");
        let place = match (report.layout, views.rows) {
            (Layout::Anaglyph, _) => "mixed in every pixel: its views cannot be separated".to_owned(),
            (Layout::Wiggle, _) => "shown one after the other, to and fro".to_owned(),
            (_, 1) => "beside each other, the leftmost on the left".to_owned(),
            (_, rows) => format!("in {} columns and {rows} rows, {order}", views.columns),
        };
        line("views", format_args!("{} of {width}x{height} {place}", views.count));
    }
    line("problems", format_args!("{}", problems(report)));
    text
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

#[cfg(test)]
mod tests {
    use super::*;
    use relief_base::DepthLimits;
    use relief_display::{DisplaySettings, Frame, Picture, Pixels, encode_png, inspect_frame};

    /// A frame of the usual layout: everything at half depth, one pixel missed.
    fn frame() -> Frame {
        let mut depth_mm = vec![200.0; 960 * 540];
        depth_mm[7] = f32::INFINITY;
        let color = vec![[9, 8, 7, 255]; 960 * 540];
        let picture = Picture::new([960, 540], &color, &depth_mm).unwrap();
        let limits = DepthLimits::new(100.0, 300.0).unwrap();
        DisplaySettings::default().encoder().unwrap().encode(&picture, limits).unwrap()
    }

    #[test]
    fn the_report_reads_as_documented() {
        let text = readable(&inspect_frame(&frame()));
        assert_eq!(
            text,
            "layout    wowvx (picture and disparity side by side on the even lines, odd lines black, header on line 0)\n\
             frame     1920x1080\n\
             header    F10440800000ADD437A1\n\
             content   cgi\n\
             factor    64 = 100 % (the display's own optimum is used)\n\
             offset    128 (the display's own optimum is used)\n\
             extended  F2140000000000000000000000000000000036958221\n\
             depth     0 (farthest) to 119 (nearest), 2 values, 0.0 % at the far limit\n\
             problems  none\n"
        );
    }

    #[test]
    fn problems_come_with_their_code_and_what_to_do() {
        let Pixels::Rgb8(mut samples) = frame().pixels().clone() else { unreachable!("the layout is RGB") };
        samples[3 * 1920] = 1;
        let text = readable(&inspect_frame(&Frame::new([1920, 1080], Pixels::Rgb8(samples)).unwrap()));
        let (_, problems) = text.split_once("problems  ").unwrap();
        assert_eq!(
            problems,
            "1\n  odd-lines: odd lines that are not black: 1, with 1 coloured pixels, the first at x 0, y 1\n    \
             put line i of both halves on line 2i and leave the odd lines black, or use wowvx-full-height\n"
        );
    }

    #[test]
    fn the_exit_status_says_whether_the_frame_is_right() {
        let folder = tempfile::tempdir().unwrap();
        let status = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            run(&path, &AgainstTrue::default(), None, true).map(|status| status == ExitCode::SUCCESS)
        };
        let right = encode_png(&frame()).unwrap();
        assert!(status("right.png", &right).unwrap());
        let black = Frame::new([1920, 1080], Pixels::Rgb8(vec![0; 3 * 1920 * 1080])).unwrap();
        assert!(!status("wrong.png", &encode_png(&black).unwrap()).unwrap());
        let error = status("cut.png", &right[..1000]).unwrap_err();
        assert!(format!("{error:#}").contains("damaged or cut"), "{error:#}");
    }
}

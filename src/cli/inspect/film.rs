//! `relief inspect FILM`: whether every picture of a film is a frame with an intact header.
//!
//! Exit status 0 when nothing is wrong, 1 when something is.

use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, bail};
use serde::Serialize;

use crate::output::{print_json, say};
use relief_display::{Frame, FrameReport, Layout, Pixels, inspect_frame};
use relief_film::{Ffmpeg, FilmReader};

/// Endings of films.
const ENDINGS: [&str; 6] = ["mkv", "mp4", "mov", "avi", "webm", "m4v"];
/// Pictures whose problems are listed; others are counted.
const MAX_LISTED: usize = 10;

/// The content of a film.
#[derive(Debug, Serialize)]
struct FilmReport {
    size_px: [u32; 2],
    frames_per_s: f64,
    frames: u64,
    /// Layout and header of the first frame.
    layout: Option<Layout>,
    header_hex: Option<String>,
    /// Frames with another layout or another header than the first.
    different: u64,
    /// Frames with problems.
    bad: u64,
    problems: Vec<FrameProblems>,
}

/// The problems of one frame.
#[derive(Debug, Serialize)]
struct FrameProblems {
    /// Its number, from 1.
    frame: u64,
    problems: Vec<String>,
}

/// Whether a file is a film, by its ending.
pub(super) fn is_film(path: &Path) -> bool {
    let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
    path.is_file() && ENDINGS.iter().any(|known| ending.eq_ignore_ascii_case(known))
}

pub(super) fn run(path: &Path, ffmpeg: &Path, json: bool) -> anyhow::Result<ExitCode> {
    let report = report(path, ffmpeg).with_context(|| format!("cannot inspect {}", path.display()))?;
    if json {
        print_json(&report)?;
    } else {
        print(&report);
    }
    Ok(if report.bad + report.different == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn report(path: &Path, ffmpeg: &Path) -> anyhow::Result<FilmReport> {
    let film = FilmReader::open(&Ffmpeg::find(ffmpeg)?, path)?;
    let mut report = FilmReport {
        size_px: film.size_px(),
        frames_per_s: film.rate().per_second(),
        frames: 0,
        layout: None,
        header_hex: None,
        different: 0,
        bad: 0,
        problems: Vec::new(),
    };
    for picture in film {
        let picture = picture?;
        let frame = Frame::new([picture.width(), picture.height()], Pixels::Rgb8(picture.into_raw()))?;
        report.add(inspect_frame(&frame));
    }
    if report.frames == 0 {
        bail!("the film has no pictures");
    }
    Ok(report)
}

impl FilmReport {
    fn add(&mut self, frame: FrameReport) {
        self.frames += 1;
        if self.frames == 1 {
            (self.layout, self.header_hex) = (Some(frame.layout), frame.header_hex);
        } else if self.layout != Some(frame.layout) || self.header_hex != frame.header_hex {
            self.different += 1;
        }
        if frame.problems.is_empty() {
            return;
        }
        self.bad += 1;
        if self.problems.len() < MAX_LISTED {
            let in_words = |problem| format!("{problem}: {}", relief_display::FrameProblem::advice(problem));
            let problems = frame.problems.iter().map(in_words).collect();
            self.problems.push(FrameProblems { frame: self.frames, problems });
        }
    }
}

fn print(report: &FilmReport) {
    let [width, height] = report.size_px;
    say!("film      {} frames of {width}x{height}, {:.2} per second", report.frames, report.frames_per_s);
    if let Some(layout) = report.layout {
        say!("layout    {layout} ({})", layout.info().summary);
    }
    say!("header    {}", report.header_hex.as_deref().unwrap_or("none"));
    if report.different > 0 {
        say!("changes   {} frames have another layout or header than the first", report.different);
    }
    if report.bad == 0 {
        return say!("problems  none");
    }
    say!("problems  {} frames", report.bad);
    for FrameProblems { frame, problems } in &report.problems {
        say!("  frame {frame}: {}", problems.join("; "));
    }
    if report.bad > report.problems.len() as u64 {
        say!("  and {} more frames", report.bad - report.problems.len() as u64);
    }
}

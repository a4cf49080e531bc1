//! The destination of poses: a file, lines on stdout, or a table that stays in its place on a terminal.

use std::io::IsTerminal;
use std::path::Path;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::output::{GrowingFile, print_line};
use relief_tracking::{DroppedReports, PoseRecord, TrackingState};

pub(crate) enum Sink {
    File(GrowingFile),
    Lines,
    Table,
}

impl Sink {
    pub(crate) fn choose(out: Option<&Path>, json: bool) -> anyhow::Result<Self> {
        Ok(match out {
            Some(path) => Self::File(GrowingFile::create(path)?),
            None if json || !std::io::stdout().is_terminal() => Self::Lines,
            None => Self::Table,
        })
    }
}

/// Shows poses and counts them.
pub(crate) struct Display {
    sink: Sink,
    table: ProgressBar,
    counts: [u64; 4],
    first_ns: Option<u64>,
    last_ns: u64,
    solve_us: Vec<f32>,
}

/// Times that are kept for the median: those of three minutes.
const KEPT_TIMES: usize = 18_000;
const STATES: [(TrackingState, &str); 4] = [
    (TrackingState::Searching, "searching"),
    (TrackingState::Tracking, "tracking"),
    (TrackingState::Ambiguous, "ambiguous"),
    (TrackingState::Lost, "lost"),
];

impl Display {
    pub(crate) fn new(sink: Sink) -> Self {
        // Shortest interval between redraws of a progress bar, which appears on terminals only.
        let target = ProgressDrawTarget::stderr_with_hz(20);
        let hidden = matches!(sink, Sink::Lines) && std::io::stdout().is_terminal();
        let table =
            ProgressBar::with_draw_target(None, if hidden { ProgressDrawTarget::hidden() } else { target });
        let style =
            ProgressStyle::with_template("{msg}").unwrap_or_else(|_| ProgressStyle::default_spinner());
        Self {
            sink,
            table: table.with_style(style),
            counts: [0; 4],
            first_ns: None,
            last_ns: 0,
            solve_us: Vec::new(),
        }
    }

    pub(crate) fn show(&mut self, record: &PoseRecord) -> anyhow::Result<()> {
        for (count, (state, _)) in self.counts.iter_mut().zip(STATES) {
            *count += u64::from(state == record.state);
        }
        self.first_ns.get_or_insert(record.t_ns);
        self.last_ns = record.t_ns;
        if self.solve_us.len() < KEPT_TIMES {
            self.solve_us.push(record.solve_us as f32);
        }
        match &mut self.sink {
            Sink::File(file) => file.line(&serde_json::to_string(record)?)?,
            Sink::Lines => print_line(format_args!("{}", serde_json::to_string(record)?)),
            Sink::Table => {}
        }
        if !self.table.is_hidden() {
            self.table.set_message(table(record));
        }
        Ok(())
    }

    /// Publishes the file and prints a summary.
    pub(crate) fn finish(self, dropped: DroppedReports) -> anyhow::Result<()> {
        self.table.finish_and_clear();
        let Self { sink, counts, first_ns, last_ns, mut solve_us, .. } = self;
        if let Sink::File(file) = sink {
            file.finish()?;
        }
        let total: u64 = counts.iter().sum();
        let seconds = last_ns.saturating_sub(first_ns.unwrap_or(last_ns)) as f64 * 1e-9;
        let states: Vec<String> = counts
            .iter()
            .zip(STATES)
            .filter(|(count, _)| **count > 0)
            .map(|(count, (_, name))| format!("{count} {name}"))
            .collect();
        solve_us.sort_by(f32::total_cmp);
        let median = solve_us.get(solve_us.len() / 2).copied().unwrap_or(0.0);
        eprintln!(
            "{total} frames in {seconds:.1} s: {}; {median:.0} µs a frame (median); {} late and {} repeated reports dropped",
            if states.is_empty() { "none".to_owned() } else { states.join(", ") },
            dropped.late,
            dropped.repeated
        );
        Ok(())
    }
}

fn table(record: &PoseRecord) -> String {
    let state = STATES.iter().find(|(state, _)| *state == record.state).map_or("", |(_, name)| *name);
    let mut text = format!("{state:10} {} LEDs, {:.0} µs", record.leds, record.solve_us);
    if let Some(rms) = record.rms_px {
        text += &format!(", {rms:.2} px");
    }
    let spread = |at: usize| record.covariance.as_ref().map_or(0.0, |c| c[at * 7].max(0.0).sqrt());
    if let Some([x, y, z]) = record.position_mm {
        let [sx, sy, sz] = [0, 1, 2].map(spread);
        text += &format!("\n  position   {x:9.1} {y:9.1} {z:9.1} mm   ± {sx:.1} {sy:.1} {sz:.1}");
    }
    if let Some([x, y, z, w]) = record.orientation_xyzw {
        let [sx, sy, sz] = [3, 4, 5].map(|at| spread(at).to_degrees());
        text +=
            &format!("\n  quaternion {x:9.4} {y:9.4} {z:9.4} {w:9.4}   ± {sx:.2} {sy:.2} {sz:.2} degrees");
    }
    text
}

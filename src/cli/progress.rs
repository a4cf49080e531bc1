//! Progress of reading and retrieving a series: a bar on a terminal, log lines elsewhere.

use std::io::IsTerminal;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use parking_lot::Mutex;
use relief_dicom::{Progress, Stage};

/// Work shorter than this is done before anyone wonders.
const WORTH_TELLING: Duration = Duration::from_secs(1);

/// A progress bar on a terminal, log lines at quarters elsewhere.
pub(super) struct Reporter {
    started: Instant,
    bar: Mutex<Option<ProgressBar>>,
    quarters: AtomicUsize,
}

impl Default for Reporter {
    fn default() -> Self {
        Self { started: Instant::now(), bar: Mutex::default(), quarters: AtomicUsize::default() }
    }
}

/// Progress of a retrieval from an archive.
#[derive(Default)]
pub(super) struct RetrievalBar(Reporter);

impl RetrievalBar {
    /// The number of files that have arrived.
    pub(super) fn report(&self, done: usize, all: usize) {
        self.0.report_as("retrieving slices", done, all);
    }
}

impl Reporter {
    pub(super) fn report(&self, Progress { stage, done, total }: Progress) {
        self.report_as(verb(stage), done, total);
    }

    fn report_as(&self, verb: &'static str, done: usize, total: usize) {
        self.log_quarter(verb, done, total);
        let mut bar = self.bar.lock();
        let bar = bar.get_or_insert_with(|| new_bar(verb, total));
        bar.inc(1);
        if bar.position() >= total as u64 {
            bar.finish_and_clear();
        }
    }

    fn log_quarter(&self, verb: &str, done: usize, total: usize) {
        if std::io::stderr().is_terminal() || self.started.elapsed() < WORTH_TELLING {
            return;
        }
        let quarter = done * 4 / total.max(1);
        if self.quarters.fetch_max(quarter, Ordering::Relaxed) < quarter {
            tracing::info!("{verb}: {done} of {total}");
        }
    }
}

/// Draws on a terminal only; a series that loads at once shows nothing.
fn new_bar(verb: &'static str, total: usize) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(total as u64), ProgressDrawTarget::stderr_with_hz(10));
    let style = ProgressStyle::with_template("{prefix} {bar:40} {pos}/{len} {eta}");
    bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar())).with_prefix(verb)
}

fn verb(stage: Stage) -> &'static str {
    match stage {
        Stage::Headers => "reading headers",
        Stage::Slices => "decoding slices",
    }
}

//! The intents of a recording's buttons and poses, as JSON lines.

use std::path::Path;

use anyhow::Context;

use crate::output::GrowingFile;
use relief_live::{Gestures, HandOptions, HandSample, Intent};
use relief_tracking::{InputReport, TrackedSample};

/// A file of intents that grows with the reports.
pub(crate) struct Intents {
    gestures: Gestures,
    file: GrowingFile,
}

#[derive(serde::Serialize)]
struct Line<'a> {
    t_ns: u64,
    #[serde(flatten)]
    intent: &'a Intent,
}

impl Intents {
    /// Of a hand with the options of this JSON file.
    pub(crate) fn create(path: &Path, hand: Option<&Path>) -> anyhow::Result<Self> {
        let options = hand.map_or_else(|| Ok(HandOptions::default()), read_options)?;
        Ok(Self { gestures: Gestures::new(options)?, file: GrowingFile::create(path)? })
    }

    /// The buttons of a report, whether it has a picture or not.
    pub(crate) fn report(&mut self, t_ns: u64, report: &InputReport) -> anyhow::Result<()> {
        let intents = report.buttons().map_or_else(Vec::new, |buttons| self.gestures.hold(t_ns, buttons));
        self.write(t_ns, &intents)
    }

    pub(crate) fn sample(&mut self, sample: &TrackedSample) -> anyhow::Result<()> {
        let intents = self.gestures.track(&HandSample::from(sample));
        self.write(sample.t_ns, &intents)
    }

    /// The file appears.
    pub(crate) fn finish(self) -> anyhow::Result<()> {
        self.file.finish()
    }

    fn write(&mut self, t_ns: u64, intents: &[Intent]) -> anyhow::Result<()> {
        for intent in intents {
            self.file.line(&serde_json::to_string(&Line { t_ns, intent })?)?;
        }
        Ok(())
    }
}

fn read_options(path: &Path) -> anyhow::Result<HandOptions> {
    let wrong = || format!("{} has no options of a hand", path.display());
    let options: HandOptions =
        serde_json::from_str(&crate::text_file::read_text(path)?).with_context(wrong)?;
    options.validate().with_context(wrong)?;
    Ok(options)
}

//! `relief batch run --send`: DICOM objects of finished jobs, stored in an archive.

use std::collections::BTreeMap;

use anyhow::{Context, bail};
use relief_archive::{ArchiveAddress, StoreOutcome};
use relief_batch::{Copies, FILMS, Job, Product, Record, Sink, turntable_capture};
use serde::Serialize;

use crate::send::outgoing;

/// Largest object that is sent, bytes.
const LARGEST: u64 = 1 << 30;

/// The outcome of sending objects.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub(super) struct SentObjects {
    stored: usize,
    already_there: usize,
    pub(super) refused: usize,
}

/// The archive of an option.
pub(super) fn parse_archive(text: &str) -> Result<ArchiveAddress, String> {
    let address: ArchiveAddress = text.parse().map_err(|error| format!("{error}"))?;
    if address.study().is_some() || !address.query().is_empty() {
        return Err("give the root of the archive, without studies and without a query".to_owned());
    }
    Ok(address)
}

/// Refuses to send where no job makes an object.
pub(super) fn expect_objects(jobs: &[Job]) -> anyhow::Result<()> {
    if jobs.iter().flat_map(|job| &job.products).any(|product| product.is_object()) {
        return Ok(());
    }
    bail!(
        "--send stores DICOM objects, and no job makes one: plan with --products capture or annotated-capture"
    )
}

/// Stores the objects of all jobs that are done; those of a turntable as one object of several
/// frames, when all its views are done. An object that the archive has is not sent again.
pub(super) fn send(
    jobs: &[Job],
    out: &Sink,
    copies: &Copies,
    archive: &ArchiveAddress,
) -> anyhow::Result<SentObjects> {
    let mut sent = SentObjects::default();
    let mut turntables: BTreeMap<(&str, &str, Product), Turntable> = BTreeMap::new();
    for job in jobs {
        let series = &*job.series.name;
        let record = Record::of_done(job, out);
        for &product in job.products.iter().filter(|product| product.is_object()) {
            let output = record.as_ref().and_then(|record| record.output(product));
            let file = output.map(|output| format!("{series}/{output}"));
            if FILMS.contains(&&*job.group) {
                let turntable = turntables.entry((series, &job.group, product)).or_default();
                turntable.missing += usize::from(file.is_none());
                turntable.files.extend(file);
            } else if let Some(file) = file {
                let about = || failure(&file);
                let object = out.read(&file, LARGEST).with_context(about)?.with_context(about)?;
                sent.count(&file, store(copies, archive, object).with_context(about)?);
            }
        }
    }
    for ((series, group, product), Turntable { mut files, missing }) in turntables {
        let name = format!("{series}/{group}.{}", product.ending());
        files.sort(); // jobs of phases are in another order
        let about = || failure(&name);
        if missing > 0 {
            eprintln!("not sent: {name}, {missing} of its {} views are not done", files.len() + missing);
        } else if let Some(object) = turntable_capture(out, &files).with_context(about)? {
            sent.count(&name, store(copies, archive, object).with_context(about)?);
        } else if let [file] = &*files {
            let object = out.read(file, LARGEST).with_context(about)?.with_context(about)?;
            sent.count(file, store(copies, archive, object).with_context(about)?);
        }
    }
    Ok(sent)
}

/// The captures of a turntable, in its order, and the number of those that are not done.
#[derive(Default)]
struct Turntable {
    files: Vec<String>,
    missing: usize,
}

fn failure(name: &str) -> String {
    format!("cannot send {name}; run again to send the missing objects")
}

fn store(copies: &Copies, archive: &ArchiveAddress, object: Vec<u8>) -> anyhow::Result<StoreOutcome> {
    Ok(copies.store_in_archive(archive, &outgoing(object)?)?)
}

impl SentObjects {
    fn count(&mut self, name: &str, outcome: StoreOutcome) {
        match outcome {
            StoreOutcome::Stored => self.stored += 1,
            StoreOutcome::AlreadyThere => self.already_there += 1,
            StoreOutcome::Refused { reason } => {
                self.refused += 1;
                let reason =
                    reason.map_or_else(String::new, |reason| format!(" (failure reason {reason:#06x})"));
                eprintln!("refused: {name}{reason}");
            }
        }
    }

    /// The outcome in words.
    pub(super) fn describe(&self) -> String {
        let Self { stored, already_there, refused } = self;
        format!("{stored} objects stored, {already_there} there already, {refused} refused by the archive")
    }
}

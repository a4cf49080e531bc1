//! `relief batch run --send`: DICOM objects of finished jobs, stored in an archive.

use anyhow::{Context, bail};
use relief_archive::{ArchiveAddress, StoreOutcome};
use relief_batch::{Copies, Job, Record, Sink};
use serde::Serialize;

use crate::send::outgoing;

/// Largest object that is sent, bytes.
const LARGEST: u64 = 1 << 30;

/// What became of objects.
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

/// Stores the objects of all jobs that are done. An object that the archive has is not sent again.
pub(super) fn send(
    jobs: &[Job],
    out: &Sink,
    copies: &Copies,
    archive: &ArchiveAddress,
) -> anyhow::Result<SentObjects> {
    let mut sent = SentObjects::default();
    for job in jobs.iter().filter(|job| job.products.iter().any(|product| product.is_object())) {
        let Some(record) = Record::of_done(job, out) else { continue };
        let objects = job.products.iter().filter(|product| product.is_object());
        for name in objects.filter_map(|&product| record.output(product)) {
            let about =
                || format!("cannot send {}/{name}; run again to send what is missing", job.series.name);
            let file = out.read(&format!("{}/{name}", job.series.name), LARGEST).with_context(about)?;
            let object = outgoing(file.with_context(about)?).with_context(about)?;
            match copies.store_in_archive(archive, &object).with_context(about)? {
                StoreOutcome::Stored => sent.stored += 1,
                StoreOutcome::AlreadyThere => sent.already_there += 1,
                StoreOutcome::Refused { reason } => {
                    sent.refused += 1;
                    let reason =
                        reason.map_or_else(String::new, |reason| format!(" (failure reason {reason:#06x})"));
                    eprintln!("refused: {}/{name}{reason}", job.series.name);
                }
            }
        }
    }
    Ok(sent)
}

impl SentObjects {
    /// The outcome in words.
    pub(super) fn describe(&self) -> String {
        let Self { stored, already_there, refused } = self;
        format!("{stored} objects stored, {already_there} there already, {refused} refused by the archive")
    }
}

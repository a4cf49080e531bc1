//! `relief serve --receive`: series that arrive by the DICOM network are served.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context;
use relief_archive::{AllowedCaller, Inbox, Receiver, ReceiverOptions};

use crate::memory::parse_bytes;
use crate::serve::load::{Arrivals, SeriesLocation};

/// Options about series that arrive by the DICOM network.
#[derive(Debug, clap::Args)]
pub(crate) struct ReceptionArguments {
    /// Serve CT series that arrive by the DICOM network (C-STORE); they are kept in this folder, and
    /// served again after a restart. See relief receive
    #[arg(long, value_name = "DIR", requires = "receive_caller")]
    receive: Option<PathBuf>,
    /// A caller that may send series, by its title and, better, its address; may be given several
    /// times
    #[arg(long, value_name = "TITLE[@ADDRESS[:PORT]]", requires = "receive")]
    receive_caller: Vec<AllowedCaller>,
    /// Address to receive series on; port 0 takes a free one
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:11112", requires = "receive")]
    receive_listen: SocketAddr,
    /// Application entity title by which callers address this receiver
    #[arg(long, value_name = "TITLE", default_value = "RELIEF", requires = "receive")]
    receive_aet: String,
    /// Bytes that the folder may have; objects beyond are refused
    #[arg(long, value_name = "BYTES", default_value = "64GiB", value_parser = parse_bytes, requires = "receive")]
    receive_quota: u64,
    /// A series is complete when nothing of it has arrived for this many seconds
    #[arg(
        long, value_name = "SECONDS", default_value_t = 10, requires = "receive",
        value_parser = clap::value_parser!(u16).range(1..=3600)
    )]
    receive_quiet: u16,
}

/// A receiver that runs until it is dropped.
#[derive(Debug)]
pub(crate) struct Reception {
    inbox: Arc<Inbox>,
    quiet: Duration,
    /// Stops listening when dropped.
    _receiver: Receiver,
}

impl ReceptionArguments {
    /// Starts to receive, if a folder is named.
    ///
    /// # Errors
    /// When the folder cannot be used, or the address not be listened on.
    pub(crate) fn start(&self) -> anyhow::Result<Option<Reception>> {
        let Some(folder) = &self.receive else { return Ok(None) };
        let mut options = ReceiverOptions::new(&self.receive_aet).with_context(|| {
            format!("--receive-aet {:?} is not an application entity title", self.receive_aet)
        })?;
        options.callers.clone_from(&self.receive_caller);
        let inbox = Inbox::open(folder, self.receive_quota);
        let inbox = Arc::new(inbox.with_context(|| format!("cannot use the folder {}", folder.display()))?);
        let receiver = Receiver::start(self.receive_listen, options, Arc::clone(&inbox))
            .with_context(|| format!("cannot listen on {} (--receive-listen)", self.receive_listen))?;
        eprintln!("receiving series on {} as {}", receiver.address(), self.receive_aet);
        let quiet = Duration::from_secs(self.receive_quiet.into());
        Ok(Some(Reception { inbox, quiet, _receiver: receiver }))
    }

    /// The series that the folder has from before.
    ///
    /// # Errors
    /// When it cannot be read.
    pub(crate) fn kept(&self) -> anyhow::Result<Vec<SeriesLocation>> {
        let Some(folder) = self.receive.as_deref().filter(|folder| folder.exists()) else {
            return Ok(Vec::new());
        };
        let about = || format!("cannot read the folder {}", folder.display());
        let mut series = Vec::new();
        for study in folders_in(folder).with_context(about)? {
            series.extend(folders_in(&study).with_context(about)?);
        }
        series.sort();
        Ok(series.iter().map(|folder| SeriesLocation::received(folder)).collect())
    }
}

impl Reception {
    /// The folders of series that become complete.
    pub(crate) fn arrivals(&self) -> Arrivals {
        let (inbox, quiet) = (Arc::clone(&self.inbox), self.quiet);
        Box::new(move || inbox.completed(quiet).into_iter().map(|series| series.folder).collect())
    }
}

fn folders_in(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut folders = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_type()?.is_dir() {
            folders.push(entry.path());
        }
    }
    Ok(folders)
}

//! `relief receive`: takes CT series that an archive or a scanner sends by the DICOM network.

use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context;
use relief_archive::{AllowedCaller, CompletedSeries, Inbox, Receiver, ReceiverOptions};
use serde_json::json;

use crate::memory::parse_bytes;
use crate::output::say;
use crate::stop::stop_signal;

/// Receive CT series by the DICOM network (C-STORE) into a folder
///
/// Each series gets a folder of its own, DIR/STUDY/SERIES, with names that do not tell UIDs. An object
/// is a whole file on the disk before it is acknowledged. A line is printed for each series of which
/// nothing has arrived for --quiet seconds; its folder is a --series of the other commands. If a transfer
/// is interrupted, the folder has a file INTERRUPTED until the series is sent again, and reading it warns.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  relief receive --into inbox --caller PACS@10.0.0.7 --listen 0.0.0.0:11112
  relief receive --into inbox --caller PACS@10.0.0.7:104  storage commitment is reported to port 104
  relief receive --into inbox --caller SCANNER --port 104 on this machine alone
  echoscu -aec RELIEF -aet SCANNER 127.0.0.1 11112        ask whether it answers (DCMTK)
  storescu -aec RELIEF -aet SCANNER +sd +r 127.0.0.1 11112 chest

The DICOM network has no encryption and no proof of identity: a caller is known by its title and its
address alone. Beyond one machine, use it in networks that you trust.")]
pub(super) struct ReceiveArguments {
    /// Folder that series are put into; created if it does not exist
    #[arg(long, value_name = "DIR")]
    into: PathBuf,
    /// Application entity title by which callers address this receiver
    #[arg(long, value_name = "TITLE", default_value = "RELIEF")]
    aet: String,
    /// Address to listen on; port 0 takes a free one
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:11112")]
    listen: SocketAddr,
    /// The same as --listen 127.0.0.1:PORT
    #[arg(long, conflicts_with = "listen")]
    port: Option<u16>,
    /// A caller that is known, by its title and, better, its address; reports about storage
    /// commitment go to the port, or without it into the caller's association; may be given several
    /// times
    #[arg(long, value_name = "TITLE[@ADDRESS[:PORT]]", required_unless_present = "any_caller")]
    caller: Vec<AllowedCaller>,
    /// Take objects of every caller
    #[arg(long, conflicts_with = "caller")]
    any_caller: bool,
    /// Bytes that the folder may have; objects beyond are refused
    #[arg(long, value_name = "BYTES", default_value = "64GiB", value_parser = parse_bytes)]
    quota: u64,
    /// A series is complete when nothing of it has arrived for this many seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 10, value_parser = clap::value_parser!(u16).range(1..=3600))]
    quiet: u16,
    /// Print a JSON object for each series, a line each
    #[arg(long)]
    json: bool,
}

/// The time between two checks whether a series is complete.
const CHECK: Duration = Duration::from_millis(200);

impl ReceiveArguments {
    fn address(&self) -> SocketAddr {
        self.port.map_or(self.listen, |port| SocketAddr::from(([127, 0, 0, 1], port)))
    }
}

pub(super) fn run(arguments: &ReceiveArguments) -> anyhow::Result<ExitCode> {
    let mut options = ReceiverOptions::new(&arguments.aet)
        .with_context(|| format!("--aet {:?} is not an application entity title", arguments.aet))?;
    options.callers.clone_from(&arguments.caller);
    warn_of_strangers(arguments);
    let folder = arguments.into.display();
    let inbox = Inbox::open(&arguments.into, arguments.quota);
    let inbox = Arc::new(inbox.with_context(|| format!("cannot use the folder {folder}"))?);
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
    let mut stop = runtime.block_on(async { stop_signal().map(Box::pin) })?;
    let receiver = Receiver::start(arguments.address(), options, Arc::clone(&inbox))
        .with_context(|| format!("cannot listen on {}", arguments.address()))?;
    say!("listening on {} as {}", receiver.address(), arguments.aet);
    let quiet = Duration::from_secs(arguments.quiet.into());
    runtime.block_on(async {
        loop {
            tokio::select! {
                () = &mut stop => return,
                () = tokio::time::sleep(CHECK) => report(&inbox, quiet, arguments.json),
            }
        }
    });
    drop(receiver);
    report(&inbox, Duration::ZERO, arguments.json);
    Ok(ExitCode::SUCCESS)
}

fn report(inbox: &Inbox, quiet: Duration, json: bool) {
    for series in inbox.completed(quiet) {
        if json {
            let CompletedSeries { folder, objects, is_interrupted } = series;
            say!("{}", json!({ "series": folder, "objects": objects, "interrupted": is_interrupted }));
        } else {
            let broken = if series.is_interrupted { "; the transfer was interrupted" } else { "" };
            say!("{}: {} objects{broken}", series.folder.display(), series.objects);
        }
    }
}

fn warn_of_strangers(arguments: &ReceiveArguments) {
    let is_near = |address: IpAddr| address.is_loopback();
    if !is_near(arguments.address().ip()) && arguments.any_caller {
        eprintln!(
            "warning: every machine that reaches {} can fill the folder; name callers by --caller",
            arguments.address()
        );
    }
}

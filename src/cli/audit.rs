//! `relief audit`: whether an audit log is whole and unchanged.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::bail;
use serde_json::json;

use crate::output::{print_json, say};
use relief_server::verify_audit_log;

/// Check that no record of an audit log was changed, moved or removed
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Each line is the SHA-256 of a record and the record; each record names the hash before it. Keep the
printed newest hash where the server cannot write: --contains then shows that nothing up to it was
removed or rewritten.

Examples:
  relief audit audit.log
  relief audit audit.log.1 audit.log       # a log that was moved while the server wrote it
  relief audit audit.log --contains 2cf24dba5fb0a30e26e83b2ac5b9e29e1b161e5c1fa7425e73043362938b9824")]
pub(super) struct AuditArguments {
    /// The log of `relief serve --audit-log`. If it was moved while a server wrote it: all of its files,
    /// the oldest first
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,
    /// Fail unless the log has the record of this hash
    #[arg(long, value_name = "SHA256")]
    contains: Option<String>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &AuditArguments) -> anyhow::Result<ExitCode> {
    let summary = verify_audit_log(&arguments.files, arguments.contains.as_deref())?;
    if let Some(hash) = &arguments.contains
        && !summary.contains
    {
        bail!("no record has the hash {hash}: the log was cut, or rewritten");
    }
    if arguments.json {
        print_json(&json!({ "records": summary.records, "torn": summary.torn, "refused": summary.refused,
            "lost": summary.lost, "head": summary.head }))?;
    } else {
        say!("{} records, unchanged; the newest is {}", summary.records, summary.head);
        if summary.torn > 0 {
            say!("{} lines were cut off by crashes", summary.torn);
        }
        if summary.refused > 0 {
            say!("{} further requests were refused; the log only counts them", summary.refused);
        }
        if summary.lost > 0 {
            say!("{} requests have no record, because the disk was too slow or full", summary.lost);
        }
    }
    Ok(ExitCode::SUCCESS)
}

//! Taking rights away from this process for good: before it reads the first byte of a file.
//!
//! Limits (rlimit) hold everywhere. Landlock and seccomp are taken where the kernel has them; the
//! child says which ones it got.

use std::collections::BTreeMap;
use std::os::fd::AsFd;

use landlock::{
    ABI, Access, AccessFs, AccessNet, CompatLevel, Compatible, PathBeneath, Ruleset, RulesetAttr,
    RulesetCreatedAttr, RulesetStatus,
};
use rustix::process::{Resource, Rlimit, Signal, getrlimit, set_parent_process_death_signal, setrlimit};
use seccompiler::{BpfProgram, SeccompAction, SeccompFilter, TargetArch};

use super::window::FILE_BYTES;

/// Processor time of a child, seconds.
const CPU_S: u64 = 600;
/// Open descriptors of a child: the standard ones, a file for each thread, and the levels of a
/// folder.
const DESCRIPTORS: u64 = 1024;

/// A limit that could not be set.
#[derive(Debug, thiserror::Error)]
pub(crate) enum SandboxError {
    /// A resource limit.
    #[error("a resource limit cannot be set")]
    Limit(#[source] rustix::io::Errno),
    /// Landlock.
    #[error("Landlock refuses")]
    Landlock(#[source] landlock::RulesetError),
    /// seccomp.
    #[error("seccomp refuses")]
    Seccomp(#[source] seccompiler::Error),
    /// The filter of system calls cannot be made for this processor.
    #[error("seccomp has no filter for this processor")]
    Filter(#[source] seccompiler::BackendError),
}

/// The restrictions of this process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Held {
    /// Whether it can open no file but the given one.
    pub(crate) files: bool,
    /// Whether it makes no connection and starts no program.
    pub(crate) calls: bool,
}

/// Limits this process to `address_space` bytes (fewer if the system allows fewer) and to reading
/// `file`, which may be a folder. It cannot be undone, and holds for all threads that are started later.
pub(crate) fn enter(file: impl AsFd, address_space: u64) -> Result<Held, SandboxError> {
    // The child ends with its parent, because the parent alone reads its result.
    set_parent_process_death_signal(Some(Signal::KILL)).map_err(SandboxError::Limit)?;
    for (resource, most) in [
        (Resource::As, address_space),
        (Resource::Cpu, CPU_S),
        (Resource::Nofile, DESCRIPTORS),
        (Resource::Fsize, FILE_BYTES),
        (Resource::Core, 0),
    ] {
        // The system may allow less already (`ulimit`, `LimitAS=`), and it cannot be raised.
        let most = getrlimit(resource).maximum.map_or(most, |allowed| allowed.min(most));
        let limit = Rlimit { current: Some(most), maximum: Some(most) };
        setrlimit(resource, limit).map_err(SandboxError::Limit)?;
    }
    let files = forbid_files(file)?;
    let calls = forbid_calls()?;
    Ok(Held { files, calls })
}

/// No file but this one, or those below this folder; no network where the kernel's Landlock knows
/// it.
fn forbid_files(file: impl AsFd) -> Result<bool, SandboxError> {
    let is_folder = rustix::fs::fstat(&file)
        .is_ok_and(|status| rustix::fs::FileType::from_raw_mode(status.st_mode).is_dir());
    let reads = if is_folder { AccessFs::ReadFile | AccessFs::ReadDir } else { AccessFs::ReadFile.into() };
    let restricted = || {
        Ruleset::default()
            .set_compatibility(CompatLevel::BestEffort)
            .handle_access(AccessFs::from_all(ABI::V5))?
            .handle_access(AccessNet::from_all(ABI::V5))?
            .create()?
            .add_rule(PathBeneath::new(file, reads))?
            .restrict_self()
    };
    let status = restricted().map_err(SandboxError::Landlock)?;
    Ok(status.ruleset != RulesetStatus::NotEnforced)
}

/// No connections, no programs, no look into other processes. These calls fail with EPERM; all
/// others pass, because decoders and the allocator differ in their needs.
fn forbid_calls() -> Result<bool, SandboxError> {
    let denied = [
        libc::SYS_socket,
        libc::SYS_connect,
        libc::SYS_bind,
        libc::SYS_listen,
        libc::SYS_accept,
        libc::SYS_accept4,
        libc::SYS_execve,
        libc::SYS_execveat,
        libc::SYS_ptrace,
        libc::SYS_process_vm_readv,
        libc::SYS_process_vm_writev,
        libc::SYS_kill,
        libc::SYS_mount,
        libc::SYS_umount2,
        libc::SYS_unshare,
        libc::SYS_setns,
        libc::SYS_bpf,
        libc::SYS_perf_event_open,
        libc::SYS_userfaultfd,
        libc::SYS_io_uring_setup,
        libc::SYS_keyctl,
        libc::SYS_add_key,
        libc::SYS_init_module,
        libc::SYS_finit_module,
        libc::SYS_memfd_create,
        libc::SYS_pidfd_open,
        libc::SYS_pidfd_getfd,
    ];
    let rules: BTreeMap<i64, _> = denied.into_iter().map(|call| (call, Vec::new())).collect();
    let Ok(arch) = TargetArch::try_from(std::env::consts::ARCH) else { return Ok(false) };
    let (passed, refused) = (SeccompAction::Allow, SeccompAction::Errno(libc::EPERM as u32));
    let filter = SeccompFilter::new(rules, passed, refused, arch).map_err(SandboxError::Filter)?;
    let program = BpfProgram::try_from(filter).map_err(SandboxError::Filter)?;
    match seccompiler::apply_filter(&program) {
        Ok(()) => Ok(true),
        // A kernel without seccomp.
        Err(seccompiler::Error::Prctl(error)) if error.raw_os_error() == Some(libc::EINVAL) => Ok(false),
        Err(error) => Err(SandboxError::Seccomp(error)),
    }
}

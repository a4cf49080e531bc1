//! `--isolation` of servers and batches: whether files from outside are read in a child process.

/// The process that reads uploads and series from buckets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Isolation {
    /// In a child process without rights
    On,
    /// In the process itself
    Off,
}

impl Isolation {
    /// The default of this system.
    pub(crate) const DEFAULT: Self = if cfg!(target_os = "linux") { Self::On } else { Self::Off };
}

/// The error of `--isolation on` on other systems.
#[cfg(not(target_os = "linux"))]
pub(crate) const NEEDS_LINUX: &str =
    "--isolation on needs Linux; this system reads them in the process itself: --isolation off";

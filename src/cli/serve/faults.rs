//! Failures that `relief serve --fault KIND=VALUE` brings about on purpose, to see that a server
//! recovers from them. For tests; the option is hidden.

use std::str::FromStr;
use std::time::Duration;

use relief_annotation::Timestamp;
use relief_session::{FaultKind, InjectedFault};
use relief_store::StoreFaults;

/// One failure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Fault {
    /// `device-lost=N`: the graphics device is lost before every N-th picture.
    DeviceLost(u32),
    /// `device-memory=N`: every N-th picture finds the graphics memory full once.
    DeviceMemory(u32),
    /// `disk-full=BYTES`: the file of annotations cannot exceed this size.
    DiskFull(u64),
    /// `disk-slow=MS`: every change of annotations takes this much longer.
    DiskSlow(u32),
    /// `clock-back=SECONDS`: each reading of the clock is this much earlier than the one before.
    ClockBack(u32),
}

/// A value of `--fault` that names no failure.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "--fault is {0:?}; allowed: device-lost=N, device-memory=N, disk-full=BYTES, disk-slow=MS, clock-back=SECONDS"
)]
pub(crate) struct FaultError(String);

impl FromStr for Fault {
    type Err = FaultError;

    fn from_str(text: &str) -> Result<Self, FaultError> {
        let refused = || FaultError(text.to_owned());
        let (kind, value) = text.split_once('=').ok_or_else(refused)?;
        let bytes: u64 = value.parse().ok().filter(|value| *value > 0).ok_or_else(refused)?;
        let number = u32::try_from(bytes).map_err(|_| refused());
        Ok(match kind {
            "device-lost" => Self::DeviceLost(number?),
            "device-memory" => Self::DeviceMemory(number?),
            "disk-full" => Self::DiskFull(bytes),
            "disk-slow" => Self::DiskSlow(number?),
            "clock-back" => Self::ClockBack(number?),
            _ => return Err(refused()),
        })
    }
}

/// The faults of the graphics device.
pub(crate) fn of_device(faults: &[Fault]) -> Vec<InjectedFault> {
    let device = |fault: &Fault| match fault {
        Fault::DeviceLost(every) => Some(InjectedFault::new(FaultKind::DeviceLost, *every)),
        Fault::DeviceMemory(every) => Some(InjectedFault::new(FaultKind::OutOfMemory, *every)),
        _ => None,
    };
    faults.iter().filter_map(device).collect()
}

/// The faults of the log of annotations.
pub(crate) fn of_store(faults: &[Fault]) -> StoreFaults {
    let mut all = StoreFaults::default();
    for fault in faults {
        match fault {
            Fault::DiskFull(bytes) => all.most_bytes = Some(*bytes),
            Fault::DiskSlow(ms) => all.delay = Duration::from_millis((*ms).into()),
            _ => {}
        }
    }
    all
}

/// Begins the faults of the clock.
pub(crate) fn begin_clock(faults: &[Fault]) {
    for fault in faults {
        if let Fault::ClockBack(seconds) = fault {
            Timestamp::turn_clock_back(Duration::from_secs((*seconds).into()));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_read_and_others_refused() {
        assert_eq!("device-lost=3".parse(), Ok(Fault::DeviceLost(3)));
        assert_eq!("disk-full=5000000000".parse(), Ok(Fault::DiskFull(5_000_000_000)));
        for wrong in
            ["", "device-lost", "device-lost=0", "device-lost=-1", "device-lost=5000000000", "fire=1"]
        {
            assert_eq!(wrong.parse::<Fault>(), Err(FaultError(wrong.to_owned())));
        }
    }
}

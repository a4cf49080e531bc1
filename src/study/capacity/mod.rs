//! The capacity of a server: the viewers that one machine serves, and the machines that more
//! viewers need.

mod measure;
mod plan;

pub use measure::{CapacityMeasurement, FrameRates, measure_capacity};
pub use plan::{Capacity, GroupNeeds, ViewerHabits};

impl CapacityMeasurement {
    /// The capacity of this machine for viewers with these habits.
    #[must_use]
    pub fn capacity(&self, habits: &ViewerHabits) -> Capacity {
        self.rates().capacity(habits)
    }

    /// The needs of 1 to 10,000 viewers; empty where this machine is too slow for one.
    #[must_use]
    pub fn needs(&self, habits: &ViewerHabits) -> Vec<GroupNeeds> {
        let rates = self.rates();
        plan::GROUPS.into_iter().filter_map(|viewers| rates.needs(habits, viewers)).collect()
    }
}

/// A memory figure of this process in MiB, where the system reports it: `VmHWM:` for the peak,
/// `VmRSS:` for the current value.
#[must_use]
pub fn process_mib(field: &str) -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with(field))?;
    let kib: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib / 1024.0)
}

//! The capacity model: from the measured rates of one server to the needs of many viewers.
//! Arithmetic only.
//!
//! A viewer moves its view for a share of the time, in stretches of a few seconds. A moving view is
//! rendered at a fixed frame rate and a reduced size; each stretch ends with one lossless frame of
//! full size. Viewers move independently of one another.

use serde::Serialize;
use statrs::function::beta::beta_reg;

/// Numbers of viewers in the report.
pub(super) const GROUPS: [u64; 5] = [1, 10, 100, 1_000, 10_000];

/// The measured rates of one server.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct ServerRates {
    /// Frames of moving views per second, of all viewers together.
    pub moving_per_s: f64,
    /// Bytes of one.
    pub moving_bytes: f64,
    /// Lossless frames of full size per second, of all viewers together.
    pub still_per_s: f64,
    /// Bytes of one.
    pub still_bytes: f64,
    /// Pictures of full size per second, by request.
    pub view_per_s: f64,
    /// Memory of the process without volumes, MiB.
    pub base_mib: f64,
    /// Memory of one volume, MiB: voxels and adapter.
    pub volume_mib: f64,
}

/// The assumed behaviour of viewers, and the reserve of a server.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct ViewerHabits {
    /// Frames per second of a moving view.
    pub viewer_fps: f64,
    /// Share of the time in which a viewer moves, 0 to 1.
    pub moving_share: f64,
    /// Length of one stretch of moving, s.
    pub stretch_s: f64,
    /// Viewers of one volume at a time.
    pub viewers_per_volume: f64,
    /// Edits of annotations per viewer and hour.
    pub edits_per_hour: f64,
    /// Highest planned load of a server, 0 to 1.
    pub load: f64,
    /// Highest share of time in which more views move together than the server can render.
    pub crowded: f64,
}

impl Default for ViewerHabits {
    fn default() -> Self {
        Self {
            viewer_fps: 20.0,
            moving_share: 0.1,
            stretch_s: 4.0,
            viewers_per_volume: 2.0,
            edits_per_hour: 60.0,
            load: 0.7,
            crowded: 0.05,
        }
    }
}

/// The capacity of one server.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Capacity {
    /// Most viewers; 0 where the server is too slow for one.
    pub viewers: u64,
    /// Share of the time in which more views move at once than the server can render.
    pub crowded: f64,
    /// Load of the server, 0 to 1.
    pub load: f64,
    /// Pictures of full size per hour, without live viewers.
    pub views_per_hour: f64,
    /// Mean data rate of one viewer, Mbit/s.
    pub viewer_mbit_s: f64,
}

/// The needs of a group of viewers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct GroupNeeds {
    /// Number of viewers.
    pub viewers: u64,
    /// Servers for them, and one spare.
    pub servers: u64,
    /// Mean data rate of all viewers together, Mbit/s.
    pub mean_mbit_s: f64,
    /// Data rate that is exceeded in one of 1000 moments, Mbit/s.
    pub peak_mbit_s: f64,
    /// Number of volumes that are shown at the same time.
    pub volumes: u64,
    /// Memory of a server, MiB, if consistent hashing assigns it 1.5 times its share of the
    /// volumes.
    pub server_mib: f64,
    /// Edits of all viewers per second.
    pub edits_per_s: f64,
    /// Events per second that the servers read from the database: each server reads every event.
    pub events_read_per_s: f64,
    /// Connections of nginx: one to a viewer and one to a server each.
    pub connections: u64,
}

impl ServerRates {
    /// The capacity of one server.
    pub(super) fn capacity(&self, habits: &ViewerHabits) -> Capacity {
        let fits = |viewers: u64| {
            self.load(habits, viewers) <= habits.load && self.crowded(habits, viewers) <= habits.crowded
        };
        // Load and crowding rise with the number of viewers, so bisection finds the most.
        let (mut most, mut too_many) = (0, 1);
        while fits(too_many) && too_many < 1 << 20 {
            (most, too_many) = (too_many, too_many * 2);
        }
        while too_many - most > 1 {
            let middle = u64::midpoint(most, too_many);
            if fits(middle) { most = middle } else { too_many = middle }
        }
        Capacity {
            viewers: most,
            crowded: self.crowded(habits, most),
            load: self.load(habits, most),
            views_per_hour: 3600.0 * self.view_per_s,
            viewer_mbit_s: self.viewer_bytes_per_s(habits) * 8e-6,
        }
    }

    /// The resources for this number of viewers; `None` where the server is too slow for one.
    pub(super) fn needs(&self, habits: &ViewerHabits, viewers: u64) -> Option<GroupNeeds> {
        let carried = self.capacity(habits).viewers;
        if carried == 0 {
            return None;
        }
        let busy = viewers.div_ceil(carried);
        let servers = busy + 1;
        let volumes = (viewers as f64 / habits.viewers_per_volume).ceil();
        let edits_per_s = viewers as f64 * habits.edits_per_hour / 3600.0;
        let moving = moving_at_most(viewers, habits.moving_share, 0.001) as f64;
        let stills = viewers as f64 * habits.stills_per_s() * self.still_bytes;
        let peak = moving * habits.viewer_fps * self.moving_bytes + stills;
        let volumes_of_one = (1.5 * volumes / busy as f64).ceil().min(volumes);
        Some(GroupNeeds {
            viewers,
            servers,
            mean_mbit_s: viewers as f64 * self.viewer_bytes_per_s(habits) * 8e-6,
            peak_mbit_s: peak * 8e-6,
            volumes: volumes as u64,
            server_mib: self.base_mib + volumes_of_one * self.volume_mib,
            edits_per_s,
            events_read_per_s: edits_per_s * servers as f64,
            connections: 2 * viewers,
        })
    }

    /// Load of a server with this number of viewers.
    fn load(&self, habits: &ViewerHabits, viewers: u64) -> f64 {
        let moving = habits.moving_share * habits.viewer_fps / self.moving_per_s;
        viewers as f64 * (moving + habits.stills_per_s() / self.still_per_s)
    }

    /// Share of the time in which more views move than the server can render.
    fn crowded(&self, habits: &ViewerHabits, viewers: u64) -> f64 {
        let for_stills = viewers as f64 * habits.stills_per_s() / self.still_per_s;
        let places = (self.moving_per_s * (1.0 - for_stills) / habits.viewer_fps).floor();
        if places < 1.0 {
            return 1.0;
        }
        more_than(viewers, habits.moving_share, places as u64)
    }

    fn viewer_bytes_per_s(&self, habits: &ViewerHabits) -> f64 {
        habits.moving_share * habits.viewer_fps * self.moving_bytes + habits.stills_per_s() * self.still_bytes
    }
}

impl ViewerHabits {
    /// Lossless frames per second and viewer: one at the end of each stretch.
    fn stills_per_s(&self) -> f64 {
        self.moving_share / self.stretch_s
    }
}

/// The probability that more than `most` of the viewers move: the tail of the binomial
/// distribution.
fn more_than(viewers: u64, share: f64, most: u64) -> f64 {
    if most >= viewers || share <= 0.0 {
        return 0.0;
    }
    if share >= 1.0 {
        return 1.0;
    }
    // With the regularized incomplete beta function: P(X > k) = I_p(k + 1, n - k) (DLMF 8.17.5).
    beta_reg((most + 1) as f64, (viewers - most) as f64, share)
}

/// The smallest number that is exceeded with at most this probability.
fn moving_at_most(viewers: u64, share: f64, probability: f64) -> u64 {
    let (mut too_few, mut enough) = (0, viewers);
    if more_than(viewers, share, 0) <= probability {
        return 0;
    }
    while enough - too_few > 1 {
        let middle = u64::midpoint(too_few, enough);
        if more_than(viewers, share, middle) <= probability { enough = middle } else { too_few = middle }
    }
    enough
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATES: ServerRates = ServerRates {
        moving_per_s: 100.0,
        moving_bytes: 50_000.0,
        still_per_s: 10.0,
        still_bytes: 1e6,
        view_per_s: 8.0,
        base_mib: 100.0,
        volume_mib: 200.0,
    };

    #[test]
    fn tails_are_those_of_the_binomial_distribution() {
        for (viewers, share, most, expected) in [
            (3, 0.1, 1, 0.028),           // 3 p² (1 - p) + p³
            (10, 0.5, 5, 386.0 / 1024.0), // (252 stays below, by symmetry)
            (4, 0.25, 0, 1.0 - 81.0 / 256.0),
            (5, 0.3, 5, 0.0),
            (5, 1.0, 4, 1.0),
        ] {
            let found = more_than(viewers, share, most);
            assert!((found - expected).abs() < 1e-12, "{viewers} {share} {most}: {found}");
        }
        // Of 10,000 with a tenth moving, 1,000 on average with a deviation of 30: 1,093 is 3.1
        // deviations above.
        let high = moving_at_most(10_000, 0.1, 0.001);
        assert!((1_090..=1_097).contains(&high), "{high}");
        assert_eq!(moving_at_most(1, 0.1, 0.001), 1);
    }

    #[test]
    fn capacity_keeps_load_and_crowding_within_their_limits() {
        let habits = ViewerHabits::default();
        let carried = RATES.capacity(&habits);
        // The load of one viewer is 0.1 x 20 / 100 + 0.025 / 10.
        let each = 0.1 * 20.0 / 100.0 + 0.1 / 4.0 / 10.0;
        assert!((carried.load - carried.viewers as f64 * each).abs() < 1e-12);
        assert!(carried.load <= 0.7 && carried.crowded <= 0.05);
        let one_more = carried.viewers + 1;
        assert!(RATES.load(&habits, one_more) > 0.7 || RATES.crowded(&habits, one_more) > 0.05);
        assert!((carried.viewer_mbit_s - (2.0 * 50_000.0 + 0.025 * 1e6) * 8e-6).abs() < 1e-12);
        assert!((carried.views_per_hour - 28_800.0).abs() < 1e-9);
        // A server that is too slow for one viewer has no capacity.
        let slow = ServerRates { moving_per_s: 19.0, ..RATES };
        assert_eq!(slow.capacity(&habits).viewers, 0);
        assert_eq!(slow.needs(&habits, 10), None);
    }

    #[test]
    fn needs_of_groups_follow_from_the_capacity_of_one_server() {
        let habits = ViewerHabits::default();
        let carried = RATES.capacity(&habits).viewers;
        for viewers in GROUPS {
            let needs = RATES.needs(&habits, viewers).unwrap();
            assert_eq!(needs.servers, viewers.div_ceil(carried) + 1);
            assert_eq!(needs.volumes, viewers.div_ceil(2));
            assert!((needs.edits_per_s - viewers as f64 / 60.0).abs() < 1e-9);
            assert!(needs.peak_mbit_s >= needs.mean_mbit_s, "{needs:?}");
            assert!(needs.server_mib >= 300.0, "at least one volume: {needs:?}");
        }
    }
}

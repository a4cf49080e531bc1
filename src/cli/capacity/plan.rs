//! From what one server was measured to do, to what many viewers need: arithmetic, and nothing else.
//!
//! A viewer moves the view for a share of the time, in stretches of some seconds. While it moves, so many frames a second are
//! rendered small enough for that; each stretch ends in one lossless picture of full size. Viewers move independently of one another.

use serde::Serialize;
use statrs::function::beta::beta_reg;

/// Groups of viewers that are planned for.
pub(super) const GROUPS: [u64; 5] = [1, 10, 100, 1_000, 10_000];

/// What one server does, measured.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Rates {
    /// Frames per second while views move, rendered, encoded, of all viewers together.
    pub(super) moving_per_s: f64,
    /// Bytes of one.
    pub(super) moving_bytes: f64,
    /// Lossless pictures of full size per second, of all viewers together.
    pub(super) still_per_s: f64,
    /// Bytes of one.
    pub(super) still_bytes: f64,
    /// Frames of full size as PNG per second, by request.
    pub(super) view_per_s: f64,
    /// Memory of the process without volumes, MiB.
    pub(super) base_mib: f64,
    /// Memory of one volume that is shown, MiB: voxels, and what the adapter has of it.
    pub(super) volume_mib: f64,
}

/// What viewers do, and what is kept in reserve.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Habits {
    /// Frames per second that a viewer is to have while moving.
    pub(super) viewer_fps: f64,
    /// Share of the time in which a viewer moves, 0 to 1.
    pub(super) moving_share: f64,
    /// Length of one stretch of moving, s.
    pub(super) stretch_s: f64,
    /// Viewers of one volume at a time.
    pub(super) viewers_per_volume: f64,
    /// Edits of annotations per viewer and hour.
    pub(super) edits_per_hour: f64,
    /// Most of a server's time that is planned for.
    pub(super) load: f64,
    /// Most of the time in which more may move at once than a server draws at that rate.
    pub(super) crowded: f64,
}

impl Default for Habits {
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

/// What one server carries.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(super) struct Carried {
    /// Viewers; 0 where not even one gets its frames.
    pub(super) viewers: u64,
    /// Share of the time in which more of them move at once than get their frames.
    pub(super) crowded: f64,
    /// Share of the server's time that they take.
    pub(super) load: f64,
    /// Frames of full size per hour, where nobody looks live.
    pub(super) views_per_hour: f64,
    /// Mean rate of what one viewer is sent, Mbit/s.
    pub(super) viewer_mbit_s: f64,
}

/// What a group of viewers needs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(super) struct Needed {
    pub(super) viewers: u64,
    /// Servers that carry them, and one more that may fail.
    pub(super) servers: u64,
    /// What they are sent together, Mbit/s, on average and in 999 of 1000 moments.
    pub(super) mean_mbit_s: f64,
    pub(super) peak_mbit_s: f64,
    /// Volumes that are shown at a time.
    pub(super) volumes: u64,
    /// Memory of a server, MiB, where consistent hashing deals it half as many volumes again as its share.
    pub(super) server_mib: f64,
    /// Edits per second of all together.
    pub(super) edits_per_s: f64,
    /// Events per second that servers read from the database: each reads every one.
    pub(super) events_read_per_s: f64,
    /// Connections of nginx: one to each viewer, and one to a server.
    pub(super) connections: u64,
}

impl Rates {
    /// Viewers that one server carries.
    pub(super) fn carried(&self, habits: &Habits) -> Carried {
        let fits = |viewers: u64| {
            self.load(habits, viewers) <= habits.load && self.crowded(habits, viewers) <= habits.crowded
        };
        // More viewers never fit better, so the most is found by halves.
        let (mut most, mut too_many) = (0, 1);
        while fits(too_many) && too_many < 1 << 20 {
            (most, too_many) = (too_many, too_many * 2);
        }
        while too_many - most > 1 {
            let middle = u64::midpoint(most, too_many);
            if fits(middle) { most = middle } else { too_many = middle }
        }
        Carried {
            viewers: most,
            crowded: self.crowded(habits, most),
            load: self.load(habits, most),
            views_per_hour: 3600.0 * self.view_per_s,
            viewer_mbit_s: self.viewer_bytes_per_s(habits) * 8e-6,
        }
    }

    /// What so many viewers need; `None` where a server does not carry even one.
    pub(super) fn needed(&self, habits: &Habits, viewers: u64) -> Option<Needed> {
        let carried = self.carried(habits).viewers;
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
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a count of viewers, or fewer"
        )]
        Some(Needed {
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

    /// Share of a server's time that so many viewers take.
    fn load(&self, habits: &Habits, viewers: u64) -> f64 {
        let moving = habits.moving_share * habits.viewer_fps / self.moving_per_s;
        viewers as f64 * (moving + habits.stills_per_s() / self.still_per_s)
    }

    /// Share of the time in which more of so many viewers move than get their frames.
    fn crowded(&self, habits: &Habits, viewers: u64) -> f64 {
        let for_stills = viewers as f64 * habits.stills_per_s() / self.still_per_s;
        let places = (self.moving_per_s * (1.0 - for_stills) / habits.viewer_fps).floor();
        if places < 1.0 {
            return 1.0;
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "at least 1, and saturating is right"
        )]
        more_than(viewers, habits.moving_share, places as u64)
    }

    fn viewer_bytes_per_s(&self, habits: &Habits) -> f64 {
        habits.moving_share * habits.viewer_fps * self.moving_bytes + habits.stills_per_s() * self.still_bytes
    }
}

impl Habits {
    /// Lossless pictures per second and viewer: one at the end of each stretch.
    fn stills_per_s(&self) -> f64 {
        self.moving_share / self.stretch_s
    }
}

/// The probability that of so many who each move with this probability more than `most` do: the tail of the binomial distribution.
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

/// The fewest that more move than with no more than this probability.
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

    const RATES: Rates = Rates {
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
        // Of 10,000 with a tenth moving, 1,000 on average with a deviation of 30: 1,093 is 3.1 deviations above.
        let high = moving_at_most(10_000, 0.1, 0.001);
        assert!((1_090..=1_097).contains(&high), "{high}");
        assert_eq!(moving_at_most(1, 0.1, 0.001), 1);
    }

    #[test]
    fn a_server_carries_what_it_has_time_and_places_for() {
        let habits = Habits::default();
        let carried = RATES.carried(&habits);
        // Each takes 0.1 x 20 / 100 + 0.025 / 10 of the time; five places, less what stills take.
        let each = 0.1 * 20.0 / 100.0 + 0.1 / 4.0 / 10.0;
        assert!((carried.load - carried.viewers as f64 * each).abs() < 1e-12);
        assert!(carried.load <= 0.7 && carried.crowded <= 0.05);
        let one_more = carried.viewers + 1;
        assert!(RATES.load(&habits, one_more) > 0.7 || RATES.crowded(&habits, one_more) > 0.05);
        assert!((carried.viewer_mbit_s - (2.0 * 50_000.0 + 0.025 * 1e6) * 8e-6).abs() < 1e-12);
        assert!((carried.views_per_hour - 28_800.0).abs() < 1e-9);
        // Who is not given one place is not carried.
        let slow = Rates { moving_per_s: 19.0, ..RATES };
        assert_eq!(slow.carried(&habits).viewers, 0);
        assert_eq!(slow.needed(&habits, 10), None);
    }

    #[test]
    fn what_groups_need_follows_from_what_one_server_carries() {
        let habits = Habits::default();
        let carried = RATES.carried(&habits).viewers;
        for viewers in GROUPS {
            let needed = RATES.needed(&habits, viewers).unwrap();
            assert_eq!(needed.servers, viewers.div_ceil(carried) + 1);
            assert_eq!(needed.volumes, viewers.div_ceil(2));
            assert!((needed.edits_per_s - viewers as f64 / 60.0).abs() < 1e-9);
            assert!(needed.peak_mbit_s >= needed.mean_mbit_s, "{needed:?}");
            assert!(needed.server_mib >= 300.0, "at least one volume: {needed:?}");
        }
    }
}

//! Depth limits of a live view, which follow the visible part without a jump.
//!
//! Limits that follow every frame exactly would make the relief breathe while the camera moves. Small
//! changes are left out, larger ones take up to a second; a view at rest has its exact limits. While
//! something is placed, they stay. While phases play, they only widen: all phases have one range.

use std::time::Instant;

use relief_base::{DepthLimits, OutOfRange};
use relief_display::{DepthRange, DisplaySettings};
use relief_render::RenderedFrame;
use relief_volume::ContentHash;

/// Changes up to this share of the extent are left out.
const HYSTERESIS: f64 = 0.05;
/// How fast limits move, in extents per second.
const EXTENTS_PER_S: f64 = 1.0;

/// The activity of a view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Activity {
    Moving,
    Still,
    Placing,
    /// Phases play, and nothing else changes.
    Playing,
}

impl Activity {
    pub(super) fn of(is_still: bool, is_placing: bool, plays: bool) -> Self {
        match (is_placing, plays, is_still) {
            (true, ..) => Self::Placing,
            (false, true, _) => Self::Playing,
            (false, false, true) => Self::Still,
            (false, false, false) => Self::Moving,
        }
    }
}

/// The limits of the newest frame.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SteadyLimits {
    shown: Option<(DepthLimits, Instant)>,
    volume: Option<ContentHash>,
}

impl SteadyLimits {
    /// The limits of a job's frame, which is of this volume; phases of one region count as one.
    ///
    /// # Errors
    /// When the limits of the display settings contradict each other.
    pub(super) fn of(
        &mut self,
        volume: ContentHash,
        display: &DisplaySettings,
        frame: &RenderedFrame,
        activity: Activity,
    ) -> Result<DepthLimits, OutOfRange> {
        if self.volume.replace(volume) != Some(volume) || display.depth_range == DepthRange::Volume {
            self.shown = None;
        }
        Ok(self.next(frame.limits_for(display)?, activity, Instant::now()))
    }

    /// The limits of the next frame, whose own would be `target`.
    fn next(&mut self, target: DepthLimits, activity: Activity, now: Instant) -> DepthLimits {
        let limits = match (self.shown, activity) {
            (None, _) | (_, Activity::Still) => target,
            (Some((shown, _)), Activity::Placing) => shown,
            // Those of all phases, once each was shown.
            (Some((shown, _)), Activity::Playing) => DepthLimits {
                near_mm: shown.near_mm.min(target.near_mm),
                far_mm: shown.far_mm.max(target.far_mm),
            },
            (Some((shown, since)), Activity::Moving) => {
                let extent = shown.far_mm - shown.near_mm;
                let most = extent * EXTENTS_PER_S * now.saturating_duration_since(since).as_secs_f64();
                let toward = |from: f64, to: f64| from + (to - from).clamp(-most, most);
                let is_near = |a: f64, b: f64| (a - b).abs() <= HYSTERESIS * extent;
                if is_near(shown.near_mm, target.near_mm) && is_near(shown.far_mm, target.far_mm) {
                    shown
                } else {
                    let moved = [toward(shown.near_mm, target.near_mm), toward(shown.far_mm, target.far_mm)];
                    DepthLimits::new(moved[0], moved[1]).unwrap_or(target)
                }
            }
        };
        self.shown = Some((limits, now));
        limits
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn limits(near_mm: f64, far_mm: f64) -> DepthLimits {
        DepthLimits { near_mm, far_mm }
    }

    #[test]
    fn limits_move_without_a_jump_and_rest_exactly() {
        let (mut steady, start) = (SteadyLimits::default(), Instant::now());
        let at = |ms: u64| start + Duration::from_millis(ms);
        assert_eq!(steady.next(limits(500.0, 700.0), Activity::Moving, at(0)), limits(500.0, 700.0));
        assert_eq!(
            steady.next(limits(508.0, 693.0), Activity::Moving, at(40)),
            limits(500.0, 700.0),
            "small"
        );
        assert_eq!(
            steady.next(limits(300.0, 702.0), Activity::Moving, at(80)),
            limits(492.0, 702.0),
            "40 ms"
        );
        assert_eq!(steady.next(limits(300.0, 702.0), Activity::Placing, at(90)), limits(492.0, 702.0));
        assert_eq!(steady.next(limits(300.0, 702.0), Activity::Still, at(99)), limits(300.0, 702.0));
        assert_eq!(steady.next(limits(310.0, 690.0), Activity::Playing, at(199)), limits(300.0, 702.0));
        assert_eq!(steady.next(limits(290.0, 710.0), Activity::Playing, at(299)), limits(290.0, 710.0));
    }
}

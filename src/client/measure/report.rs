//! The results of a measurement.

use std::sync::Arc;

use super::MeasurePlan;
use super::meter::{Measurements, Meter};
use super::stalled::StalledLoad;

/// The results of a measurement. Times in ms; percentiles are over all frames of all healthy
/// clients while the view moved; `None` without frames.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct MeasureReport {
    /// The time for which the view moved.
    pub seconds: f64,
    /// Clients that took and acknowledged their frames.
    pub clients: usize,
    /// Frames a second of one of them, on average.
    pub frames_per_s: f64,
    /// Of the slowest.
    pub frames_per_s_min: f64,
    /// Of the quickest.
    pub frames_per_s_max: f64,
    /// Frames of all.
    pub frames: u64,
    /// Poses that were sent.
    pub poses: u64,
    /// Server time: from the pose's arrival to the hand-over, without rendering and waiting.
    pub overhead_ms_p50: Option<f64>,
    /// Of one frame in a hundred it was longer.
    pub overhead_ms_p99: Option<f64>,
    /// From the pose to its frame, on this client's clock.
    pub pose_to_frame_ms_p50: Option<f64>,
    /// Of one frame in a hundred it was longer.
    pub pose_to_frame_ms_p99: Option<f64>,
    /// Rendering, as the server says.
    pub render_ms_p50: Option<f64>,
    /// Waiting for the renderer and for acknowledgements, as the server says.
    pub wait_ms_p50: Option<f64>,
    /// Encoding, as the server says.
    pub encode_ms_p50: Option<f64>,
    /// Unpacking and composing a frame here.
    pub compose_ms_p50: Option<f64>,
    /// Mean size of a frame.
    pub bytes_per_frame: Option<f64>,
    /// Pixels of a moving frame, median.
    pub pixels_p50: Option<f64>,
    /// Share of moving frames with lossless colour.
    pub lossless_share: Option<f64>,
    /// Share of moving frames of full size.
    pub full_size_share: Option<f64>,
    /// From the last pose to the still, lossless frame, of the slowest client that moved.
    pub still_ms: Option<f64>,
    /// Clients that moved and got no still frame.
    pub still_missing: usize,
    /// Size of the first client's still frame.
    pub still_bytes: Option<u64>,
    /// Frames that were composed, and whose header row was read back.
    pub checked: u64,
    /// Of those, frames with an unexpected header.
    pub bad_headers: u64,
    /// Frames that could not be unpacked.
    pub malformed: u64,
    /// Messages that could not be read.
    pub unreadable: u64,
    /// Errors that the server reported.
    pub refusals: u64,
    /// Connections that were lost and made again.
    pub reconnects: u64,
    /// Clients that took or acknowledged nothing.
    pub stalled: usize,
    /// Most frames that one of those got without acknowledging any.
    pub stalled_frames_max: u32,
    /// Connections of stalled clients that the server ended.
    pub stalled_ended: u64,
    /// Stalled clients that could not connect at all.
    pub stalled_failed: u64,
}

impl MeasureReport {
    pub(super) fn of(plan: &MeasurePlan, meters: &[Arc<Meter>], burden: StalledLoad) -> Self {
        let all = |values: fn(&Measurements) -> &Vec<u32>| -> Vec<u32> {
            meters.iter().flat_map(|meter| values(&meter.seen()).clone()).collect()
        };
        let sum =
            |value: fn(&Measurements) -> u64| meters.iter().map(|meter| value(&meter.seen())).sum::<u64>();
        let ms = |values: fn(&Measurements) -> &Vec<u32>, share: f64| {
            percentile(all(values), share).map(|us| us * 1e-3)
        };
        let rates: Vec<f64> = meters
            .iter()
            .map(|meter| meter.seen())
            .map(|seen| if seen.seconds > 0.0 { seen.frames as f64 / seen.seconds } else { 0.0 })
            .collect();
        let frames = sum(|seen| seen.frames);
        let share = |count: u64| (frames > 0).then(|| count as f64 / frames as f64);
        let moving: Vec<_> = (0..meters.len()).filter(|&at| super::moves(plan, at)).collect();
        let stills: Vec<_> = moving.iter().filter_map(|&at| meters[at].seen().still_us).collect();
        let first = meters.first().map(|meter| meter.seen().still_bytes);
        Self {
            seconds: meters.first().map_or(0.0, |meter| meter.seen().seconds),
            clients: meters.len(),
            frames_per_s: rates.iter().sum::<f64>() / rates.len().max(1) as f64,
            frames_per_s_min: rates.iter().copied().reduce(f64::min).unwrap_or(0.0),
            frames_per_s_max: rates.iter().copied().reduce(f64::max).unwrap_or(0.0),
            frames,
            poses: sum(|seen| seen.poses),
            overhead_ms_p50: ms(|seen| &seen.overhead_us, 0.5),
            overhead_ms_p99: ms(|seen| &seen.overhead_us, 0.99),
            pose_to_frame_ms_p50: ms(|seen| &seen.pose_to_frame_us, 0.5),
            pose_to_frame_ms_p99: ms(|seen| &seen.pose_to_frame_us, 0.99),
            render_ms_p50: ms(|seen| &seen.render_us, 0.5),
            wait_ms_p50: ms(|seen| &seen.wait_us, 0.5),
            encode_ms_p50: ms(|seen| &seen.encode_us, 0.5),
            compose_ms_p50: ms(|seen| &seen.compose_us, 0.5),
            bytes_per_frame: share(sum(|seen| seen.bytes)),
            pixels_p50: percentile(all(|seen| &seen.pixels), 0.5),
            lossless_share: share(sum(|seen| seen.lossless)),
            full_size_share: share(sum(|seen| seen.full_size)),
            still_ms: stills.iter().max().map(|&us| f64::from(us) * 1e-3),
            still_missing: moving.len() - stills.len(),
            still_bytes: first.flatten(),
            checked: sum(|seen| seen.checked),
            bad_headers: sum(|seen| seen.bad_headers),
            malformed: sum(|seen| seen.malformed),
            unreadable: sum(|seen| seen.unreadable),
            refusals: sum(|seen| seen.refusals),
            reconnects: sum(|seen| seen.reconnects),
            stalled: plan.stalled,
            stalled_frames_max: burden.frames_max,
            stalled_ended: burden.ended,
            stalled_failed: burden.failed,
        }
    }
}

/// The smallest value that at least this share of the values does not exceed.
fn percentile(mut values: Vec<u32>, share: f64) -> Option<f64> {
    values.sort_unstable();
    let rank = (share * values.len() as f64).ceil() as usize;
    values.get(rank.saturating_sub(1)).map(|&value| f64::from(value))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_by_nearest_rank() {
        let values: Vec<u32> = (1..=100).rev().collect();
        assert_eq!(percentile(values.clone(), 0.5), Some(50.0));
        assert_eq!(percentile(values.clone(), 0.99), Some(99.0));
        assert_eq!(percentile(values, 1.0), Some(100.0));
        assert_eq!(percentile(vec![7], 0.5), Some(7.0));
        assert_eq!(percentile(vec![], 0.5), None);
    }
}

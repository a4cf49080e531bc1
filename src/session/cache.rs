//! The frames rendered last, so that a pick, a depth map or another encoding of a frame is not
//! rendered again.
//!
//! Frames are found by content: the volume's hash and the complete request.

use std::collections::VecDeque;
use std::sync::Arc;

use relief_render::{RenderRequest, RenderedFrame};
use relief_volume::ContentHash;

/// The identity of an order.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FrameKey {
    pub(super) volume: ContentHash,
    pub(super) request: RenderRequest,
}

/// Most frames kept. A look for a frame compares it with all, and small frames are soon rendered
/// again.
const MOST_FRAMES: usize = 64;

/// Recent frames, the latest first, within a limit of bytes and of [`MOST_FRAMES`].
#[derive(Debug)]
pub(super) struct FrameCache {
    frames: VecDeque<(FrameKey, Arc<RenderedFrame>)>,
    bytes: usize,
    limit_bytes: usize,
}

impl FrameCache {
    pub(super) fn new(limit_bytes: usize) -> Self {
        Self { frames: VecDeque::new(), bytes: 0, limit_bytes }
    }

    /// The frame of an equal order; it becomes the latest.
    pub(super) fn get(&mut self, key: &FrameKey) -> Option<Arc<RenderedFrame>> {
        let at = self.frames.iter().position(|(known, _)| known == key)?;
        let found = self.frames.remove(at)?;
        let frame = Arc::clone(&found.1);
        self.frames.push_front(found);
        Some(frame)
    }

    /// Remembers a frame and forgets the oldest over the limits. A frame larger than the limit is
    /// not kept.
    pub(super) fn put(&mut self, key: FrameKey, frame: Arc<RenderedFrame>) {
        self.bytes += size_of_entry(&key, &frame);
        self.frames.push_front((key, frame));
        while self.bytes > self.limit_bytes || self.frames.len() > MOST_FRAMES {
            let Some((key, oldest)) = self.frames.pop_back() else { break };
            self.bytes -= size_of_entry(&key, &oldest);
        }
    }

    /// Forgets all frames of a volume.
    pub(super) fn forget(&mut self, volume: ContentHash) {
        self.frames.retain(|(key, _)| key.volume != volume);
        self.bytes = self.frames.iter().map(|(key, frame)| size_of_entry(key, frame)).sum();
    }
}

/// Bytes of a frame and of the order that it is found by: the latter's control points outweigh a
/// small picture.
fn size_of_entry(key: &FrameKey, frame: &RenderedFrame) -> usize {
    let request = &key.request;
    let gradient = request.transfer.gradient_opacity().map_or(0, |opacity| size_of_val(opacity.points()));
    let lists = size_of_val(request.transfer.points())
        + gradient
        + size_of_val(request.clip.planes.as_slice())
        + request.overlays.size_bytes()
        + request.labels.as_ref().map_or(0, |labels| labels.size_bytes())
        + size_of_val(request.lights.as_slice());
    let layer = |color: &[[u8; 4]], depth: &[f32]| size_of_val(color) + size_of_val(depth);
    let back = frame.back.as_ref().map_or(0, |back| layer(&back.color_rgba, &back.depth_mm));
    let pixels = layer(&frame.color_rgba, &frame.depth_mm) + back;
    let display = frame.display_mm.as_ref().map_or(0, |depth| size_of_val(depth.as_slice()));
    size_of_val(key) + lists + size_of_val(frame) + pixels + display
}

#[cfg(test)]
mod tests {
    use super::*;
    use relief_base::DepthLimits;
    use relief_render::{SceneFile, Timings};
    use relief_volume::{ControlPoint, Grid, Orbit, TransferFunction};

    fn key(azimuth_deg: f64) -> FrameKey {
        let grid = Grid::axis_aligned([4; 3], [1.0; 3], [0.0; 3]).unwrap();
        let orbit = Orbit { azimuth_deg, ..Orbit::default() };
        let request = SceneFile::default().resolve(&grid, &orbit).unwrap().request;
        FrameKey { volume: ContentHash([7; 32]), request }
    }

    fn frame(key: &FrameKey) -> Arc<RenderedFrame> {
        Arc::new(RenderedFrame {
            size_px: [10, 10],
            color_rgba: vec![[0; 4]; 100],
            depth_mm: vec![0.0; 100],
            display_mm: None,
            back: None,
            camera: key.request.camera,
            limits: DepthLimits::new(1.0, 2.0).unwrap(),
            nearest_ball_mm: None,
            is_partial: false,
            timings: Timings::default(),
        })
    }

    #[test]
    fn the_least_recently_used_frame_goes_first() {
        let each = size_of_entry(&key(0.0), &frame(&key(0.0)));
        let mut cache = FrameCache::new(2 * each);
        for azimuth in [0.0, 1.0] {
            cache.put(key(azimuth), frame(&key(azimuth)));
        }
        assert!(cache.get(&key(0.0)).is_some());
        cache.put(key(2.0), frame(&key(2.0)));
        let kept = [0.0, 1.0, 2.0].map(|azimuth| cache.get(&key(azimuth)).is_some());
        assert_eq!(kept, [true, false, true]);
        assert_eq!(cache.bytes, 2 * each);
    }

    #[test]
    fn a_frame_over_the_limit_is_not_kept() {
        let pixels = 100 * (4 + 4);
        let mut cache = FrameCache::new(pixels);
        cache.put(key(0.0), frame(&key(0.0)));
        assert!(cache.get(&key(0.0)).is_none());
        assert_eq!(cache.bytes, 0);
    }

    #[test]
    fn another_volume_is_another_frame() {
        let mut cache = FrameCache::new(8000);
        cache.put(key(0.0), frame(&key(0.0)));
        assert!(cache.get(&FrameKey { volume: ContentHash([8; 32]), ..key(0.0) }).is_none());
    }

    /// A 1x1 picture through as many control points as there may be.
    fn small(mark: u32) -> (FrameKey, Arc<RenderedFrame>) {
        let point = |i: usize| ControlPoint { hu: i as f64, rgba: [0.5; 4] };
        let transfer = TransferFunction::new((0..TransferFunction::MAX_POINTS).map(point).collect(), 1.0);
        let mut key = key(f64::from(mark) * 0.01);
        key.request.transfer = transfer.unwrap();
        let pixels = (vec![[0; 4]; 1], vec![0.0; 1]);
        let one = RenderedFrame {
            size_px: [1, 1],
            color_rgba: pixels.0,
            depth_mm: pixels.1,
            ..(*frame(&key)).clone()
        };
        (key, Arc::new(one))
    }

    #[test]
    fn ten_thousand_small_frames_stay_within_the_limits() {
        let points = TransferFunction::MAX_POINTS * size_of::<ControlPoint>();
        let mut by_count = FrameCache::new(64 << 20);
        let mut by_bytes = FrameCache::new(10 * points);
        for mark in 0..10_000 {
            let (key, frame) = small(mark);
            by_count.put(key.clone(), Arc::clone(&frame));
            by_bytes.put(key, frame);
        }
        assert_eq!(by_count.frames.len(), MOST_FRAMES);
        assert_eq!(by_bytes.frames.len(), 9, "ten lists of points leave no room for ten frames");
        assert!(by_count.get(&small(9999).0).is_some() && by_count.get(&small(9999 - 64).0).is_none());
    }

    #[test]
    fn a_forgotten_volume_takes_its_frames_and_their_bytes_along() {
        let mut cache = FrameCache::new(1 << 20);
        let kept = FrameKey { volume: ContentHash([8; 32]), ..key(0.0) };
        cache.put(kept.clone(), frame(&kept));
        let bytes = cache.bytes;
        for azimuth in [0.0, 1.0] {
            cache.put(key(azimuth), frame(&key(azimuth)));
        }
        cache.forget(ContentHash([7; 32]));
        assert!(cache.get(&key(0.0)).is_none() && cache.get(&key(1.0)).is_none());
        assert!(cache.get(&kept).is_some());
        assert_eq!(cache.bytes, bytes);
    }
}

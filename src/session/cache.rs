//! The frames rendered last, so that a pick, a depth map or another encoding of a frame is not rendered again.
//!
//! Frames are found by content: the volume's hash and the complete request.

use std::collections::VecDeque;
use std::sync::Arc;

use crate::render::{RenderRequest, RenderedFrame};
use crate::volume::ContentHash;

/// What makes two orders equal.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FrameKey {
    pub(super) volume: ContentHash,
    pub(super) request: RenderRequest,
}

/// Recent frames, the latest first, within a limit of bytes.
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

    /// Remembers a frame and forgets the oldest over the limit. A frame larger than the limit is not kept.
    pub(super) fn put(&mut self, key: FrameKey, frame: Arc<RenderedFrame>) {
        self.bytes += size_of_frame(&frame);
        self.frames.push_front((key, frame));
        while self.bytes > self.limit_bytes {
            let Some((_, oldest)) = self.frames.pop_back() else { break };
            self.bytes -= size_of_frame(&oldest);
        }
    }
}

fn size_of_frame(frame: &RenderedFrame) -> usize {
    size_of_val(frame.color_rgba.as_slice()) + size_of_val(frame.depth_mm.as_slice())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Orbit;
    use crate::render::{SceneFile, Timings};
    use crate::units::DepthLimits;
    use crate::volume::Grid;

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
            camera: key.request.camera,
            limits: DepthLimits::new(1.0, 2.0).unwrap(),
            timings: Timings::default(),
        })
    }

    #[test]
    fn the_least_recently_used_frame_goes_first() {
        let mut cache = FrameCache::new(2 * 800);
        for azimuth in [0.0, 1.0] {
            cache.put(key(azimuth), frame(&key(azimuth)));
        }
        assert!(cache.get(&key(0.0)).is_some());
        cache.put(key(2.0), frame(&key(2.0)));
        let kept = [0.0, 1.0, 2.0].map(|azimuth| cache.get(&key(azimuth)).is_some());
        assert_eq!(kept, [true, false, true]);
        assert_eq!(cache.bytes, 1600);
    }

    #[test]
    fn a_frame_over_the_limit_is_not_kept() {
        let mut cache = FrameCache::new(799);
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
}

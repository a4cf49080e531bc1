//! Work for the first picture of a volume on another thread, while the renderer draws another volume.
//!
//! It needs no adapter: ranges of bricks, and for the processor's ray caster the tables and the map of
//! empty space. Spaces: bricks, HU.

use super::appearance::PreparedBricks;
use super::processor::PreparedAppearance;
use super::request::RenderRequest;
use super::volume_plan::VolumeLimits;
use relief_volume::Volume;

/// Prepares volumes for a renderer; see [`super::Renderer::preparation`].
#[derive(Clone, Copy, Debug)]
pub struct Preparation {
    pub(super) limits: VolumeLimits,
    /// Whether the processor's ray caster will draw.
    pub(super) on_processor: bool,
}

/// A volume, and the appearance of a request, as a renderer needs them before the first ray; see
/// [`super::Renderer::adopt`].
pub struct PreparedVolume {
    pub(super) bricks: PreparedBricks,
    /// `None` for a graphics adapter, and with segments.
    pub(super) appearance: Option<PreparedAppearance>,
}

impl Preparation {
    /// Prepares the volume that a request shows; `None` where the renderer's limits do not allow it.
    #[must_use]
    pub fn of(&self, volume: &Volume, request: &RenderRequest) -> Option<PreparedVolume> {
        let volume = request.shown(volume);
        let plan = self.limits.plan(volume.grid().dims()).ok()?;
        let bricks = PreparedBricks::new(volume, &plan);
        let has_appearance = self.on_processor && request.labels.is_none();
        let appearance =
            has_appearance.then(|| PreparedAppearance::new(volume, &bricks.bricks, None, request));
        Some(PreparedVolume { bricks, appearance })
    }
}

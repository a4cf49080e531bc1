//! The GPU renderer as the service's backend: it can be recreated after its device failed.

use std::ops::ControlFlow;

use super::{BackendError, RenderBackend};
use relief_render::{
    GpuError, MemoryUse, Progress, RenderError, RenderRequest, RenderedFrame, Renderer, SceneFile,
};
use relief_volume::{ContentHash, Grid, Orbit, Volume};

/// Opens the adapter and makes a renderer, as at the start.
pub(crate) type OpenRenderer = Box<dyn Fn() -> Result<Renderer, RenderError> + Send>;

/// A renderer, and the function that recreates it.
pub struct GpuBackend {
    renderer: Renderer,
    open: OpenRenderer,
    faults: Vec<InjectedFault>,
}

/// An injected failure, by which tests check that a server recovers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InjectedFault {
    kind: FaultKind,
    /// Pictures from one failure to the next.
    every: u32,
    /// Pictures until then.
    left: u32,
}

/// The kind of a failure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultKind {
    /// The device is lost before the picture.
    DeviceLost,
    /// The first attempt at the picture finds no memory.
    OutOfMemory,
}

impl InjectedFault {
    /// Fails at every `every`-th picture, the first of them included.
    #[must_use]
    pub const fn new(kind: FaultKind, every: u32) -> Self {
        Self { kind, every, left: 0 }
    }

    /// Whether the next picture meets the failure.
    fn strikes(&mut self) -> bool {
        let strikes = self.left == 0;
        self.left = if strikes { self.every.saturating_sub(1) } else { self.left - 1 };
        strikes
    }
}

impl GpuBackend {
    /// A backend with the renderer that `open` makes, now and after a failure.
    ///
    /// # Errors
    /// When the adapter cannot be opened, or refuses the shaders.
    pub fn open(open: OpenRenderer) -> Result<Self, RenderError> {
        Ok(Self { renderer: open()?, open, faults: Vec::new() })
    }

    /// The renderer in use.
    #[must_use]
    pub fn renderer(&self) -> &Renderer {
        &self.renderer
    }

    /// The same, with injected failures.
    #[must_use]
    pub fn with_faults(self, faults: Vec<InjectedFault>) -> Self {
        Self { faults, ..self }
    }

    /// A picture of a cube of eight voxels: whether the adapter renders at all.
    fn probe(&mut self) -> Result<(), RenderError> {
        // A fixed grid and request, so these cannot fail.
        let Ok(grid) = Grid::axis_aligned([2; 3], [1.0; 3], [0.0; 3]) else { return Ok(()) };
        let Ok(volume) = Volume::new(grid.clone(), vec![0; 8]) else { return Ok(()) };
        let Ok(scene) = SceneFile::default().with_size([16, 16]).resolve(&grid, &Orbit::default()) else {
            return Ok(());
        };
        self.renderer.render(&volume, &scene.request)?;
        self.renderer.forget(volume.content_hash());
        Ok(())
    }
}

impl RenderBackend for GpuBackend {
    fn render(
        &mut self,
        volume: &Volume,
        request: &RenderRequest,
        goes_on: &mut dyn FnMut(Progress) -> ControlFlow<()>,
    ) -> Result<RenderedFrame, BackendError> {
        let mut rendered = None;
        for fault in self.faults.iter_mut().filter_map(|fault| fault.strikes().then_some(fault.kind)) {
            match fault {
                FaultKind::DeviceLost => self.renderer.lose_device(),
                FaultKind::OutOfMemory => {
                    rendered = Some(Err(GpuError::OutOfMemory { what: "an injected fault" }.into()));
                }
            }
        }
        let mut rendered = rendered.unwrap_or_else(|| self.renderer.render_watched(volume, request, goes_on));
        if let Err(RenderError::Gpu(GpuError::OutOfMemory { .. })) = &rendered {
            // Other volumes, and whatever else is cached, make room.
            self.renderer.release();
            rendered = self.renderer.render_watched(volume, request, goes_on);
        }
        rendered.map_err(of_render)
    }

    fn expect_others(&mut self, are_there: bool) {
        self.renderer.set_short_bands(are_there);
    }

    fn can_be_renewed(&self) -> bool {
        true
    }

    fn renew(&mut self) -> Result<(), BackendError> {
        let failed = |error: RenderError| BackendError::Failed(error.into());
        self.renderer = (self.open)().map_err(failed)?;
        self.probe().map_err(failed)
    }

    fn forget(&mut self, volume: ContentHash) {
        self.renderer.forget(volume);
    }

    fn memory(&self) -> MemoryUse {
        self.renderer.memory()
    }
}

/// A renderer that is not recreated.
impl RenderBackend for Renderer {
    fn render(
        &mut self,
        volume: &Volume,
        request: &RenderRequest,
        goes_on: &mut dyn FnMut(Progress) -> ControlFlow<()>,
    ) -> Result<RenderedFrame, BackendError> {
        self.render_watched(volume, request, goes_on).map_err(of_render)
    }

    fn expect_others(&mut self, are_there: bool) {
        self.set_short_bands(are_there);
    }

    fn forget(&mut self, volume: ContentHash) {
        // Inherent methods go first, so this is the renderer's own.
        self.forget(volume);
    }

    fn memory(&self) -> MemoryUse {
        self.memory()
    }
}

fn of_render(error: RenderError) -> BackendError {
    match error {
        RenderError::Cancelled => BackendError::Cancelled,
        // Too little memory for one picture says nothing about the next.
        RenderError::Request(_)
        | RenderError::VolumeTooLarge { .. }
        | RenderError::VolumeOverTexture { .. }
        | RenderError::VolumeOverMemory { .. }
        | RenderError::BeyondProcessor { .. }
        | RenderError::Gpu(GpuError::OutOfMemory { .. }) => BackendError::Refused(error.into()),
        RenderError::Gpu(_) => BackendError::Failed(error.into()),
    }
}

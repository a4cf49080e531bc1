//! `--adapter`: which graphics adapter render, bench and serve use.

use anyhow::Context;

use crate::memory::parse_bytes;
use relief_render::{AdapterChoice, Renderer, VolumeLimits};
use relief_session::GpuBackend;

/// The graphics adapter to use.
#[derive(Debug, clap::Args)]
pub(super) struct AdapterArguments {
    /// The renderer: best, cpu, software, or a part of a graphics adapter's name. `best` is a
    /// graphics card, or else `cpu`, Relief's own ray caster, which needs no driver; `software` is a
    /// software driver such as lavapipe. What `cpu` cannot do falls to the best graphics adapter
    #[arg(long, value_name = "NAME", default_value = "best", env = "RELIEF_ADAPTER")]
    adapter: String,
    /// Graphics memory for volumes, their gradients and maps of empty space, such as 512MiB or
    /// 8GiB; of several volumes the one least recently shown goes first
    #[arg(long, value_name = "BYTES", default_value = "4GiB", value_parser = parse_bytes)]
    gpu_memory: u64,
}

impl AdapterArguments {
    /// A backend on the chosen adapter that can be recreated after a failure.
    pub(super) fn open_backend(&self) -> anyhow::Result<GpuBackend> {
        let (choice, memory_bytes) = (AdapterChoice::parse(&self.adapter), self.gpu_memory);
        let open = move || {
            let mut renderer = Renderer::open(&choice)?;
            renderer.set_volume_limits(VolumeLimits { memory_bytes, ..renderer.volume_limits() });
            Ok(renderer)
        };
        GpuBackend::open(Box::new(open)).context("the renderer cannot start")
    }

    /// A renderer on the chosen adapter.
    pub(super) fn open_renderer(&self) -> anyhow::Result<Renderer> {
        let choice = AdapterChoice::parse(&self.adapter);
        let mut renderer = Renderer::open(&choice).context("the renderer cannot start")?;
        let limits = VolumeLimits { memory_bytes: self.gpu_memory, ..renderer.volume_limits() };
        renderer.set_volume_limits(limits);
        Ok(renderer)
    }

    /// As [`AdapterArguments::open_renderer`], for a volume of these dimensions: one that the
    /// adapter cannot take is refused here, before it is read.
    pub(super) fn open_renderer_for(&self, dims: [usize; 3]) -> anyhow::Result<Renderer> {
        let renderer = self.open_renderer()?;
        renderer.volume_limits().plan(dims)?;
        Ok(renderer)
    }
}

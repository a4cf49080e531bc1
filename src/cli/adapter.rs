//! `--adapter`: which graphics adapter render, bench and serve use.

use anyhow::Context;

use crate::gpu::{AdapterChoice, Gpu};
use crate::render::Renderer;

/// The graphics adapter to use.
#[derive(Debug, clap::Args)]
pub(super) struct AdapterArguments {
    /// Graphics adapter: best, software, or a part of its name
    #[arg(long, value_name = "NAME", default_value = "best", env = "RELIEF_ADAPTER")]
    adapter: String,
}

impl AdapterArguments {
    /// A renderer on the chosen adapter.
    pub(super) fn open_renderer(&self) -> anyhow::Result<Renderer> {
        let gpu = Gpu::open(&AdapterChoice::parse(&self.adapter))?;
        Renderer::new(gpu).context("the renderer cannot start")
    }
}

//! The storage of the transfer table: a uniform or a storage buffer.

use crate::gpu::{AdapterKind, Gpu};

/// The kind of buffer of the transfer table: which one is fast differs between software drivers and
/// graphics cards.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TableStorage {
    Uniform,
    Storage,
}

impl TableStorage {
    pub(super) fn of(gpu: &Gpu) -> Self {
        if gpu.description().kind == AdapterKind::Software { Self::Uniform } else { Self::Storage }
    }

    pub(super) fn source(self) -> &'static str {
        match self {
            Self::Uniform => include_str!("../../shaders/table/uniform.wgsl"),
            Self::Storage => include_str!("../../shaders/table/storage.wgsl"),
        }
    }

    pub(super) fn binding(self) -> wgpu::BufferBindingType {
        match self {
            Self::Uniform => wgpu::BufferBindingType::Uniform,
            Self::Storage => wgpu::BufferBindingType::Storage { read_only: true },
        }
    }
}

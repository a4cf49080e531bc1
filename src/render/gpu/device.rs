//! An open device, read-back from it, and its errors as values.

use std::sync::mpsc::sync_channel;
use std::time::Duration;

use super::adapter::{AdapterDescription, choose};
use super::error::{GpuError, StallError};
use crate::gpu::choice::AdapterChoice;

pub(crate) use wgpu::SubmissionIndex;

/// The time of a frame after which the device counts as hung. Software adapters need seconds for
/// large pictures.
const PATIENCE: Duration = Duration::from_secs(300);

/// The limits of an adapter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct GpuLimits {
    /// Largest side of a 3D texture, voxels.
    pub texture_3d_side: u32,
    /// Largest buffer that a shader can write, bytes.
    pub storage_bytes: u64,
    /// Whether signed normalised 16-bit textures can be filtered; otherwise values are stored as
    /// half floats.
    pub norm16_textures: bool,
}

/// An open device and its queue.
#[derive(Debug)]
pub struct Gpu {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    description: AdapterDescription,
    limits: GpuLimits,
}

impl Gpu {
    /// Opens the adapter of this choice.
    ///
    /// # Errors
    /// When there is no such adapter, or its driver refuses.
    pub fn open(choice: &AdapterChoice) -> Result<Self, GpuError> {
        let adapter = choose(choice)?;
        let description = AdapterDescription::of(&adapter);
        let features = adapter.features() & wgpu::Features::TEXTURE_FORMAT_16BIT_NORM;
        let limits = adapter.limits();
        let request = wgpu::DeviceDescriptor {
            label: Some("relief"),
            required_features: features,
            required_limits: limits.clone(),
            ..Default::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&request)).map_err(|error| {
            GpuError::Device { adapter: description.to_string(), source: Box::new(error) }
        })?;
        // Errors are caught in scopes; one that escapes is logged, where the default would end the
        // process.
        device.on_uncaptured_error(std::sync::Arc::new(
            |error| tracing::error!(%error, "uncaptured GPU error"),
        ));
        device.set_device_lost_callback(|reason, message| {
            // Dropping a device loses it, too.
            if reason != wgpu::DeviceLostReason::Destroyed {
                tracing::error!(?reason, message, "the graphics device was lost");
            }
        });
        let limits = GpuLimits {
            texture_3d_side: limits.max_texture_dimension_3d,
            storage_bytes: limits.max_storage_buffer_binding_size,
            norm16_textures: !features.is_empty(),
        };
        Ok(Self { device, queue, description, limits })
    }

    /// The adapter in words.
    #[must_use]
    pub fn description(&self) -> &AdapterDescription {
        &self.description
    }

    /// The limits of the adapter.
    #[must_use]
    pub fn limits(&self) -> GpuLimits {
        self.limits
    }

    /// Waits until all submitted work is done; `what` names it in messages.
    pub(crate) fn wait(&self, what: &'static str) -> Result<(), GpuError> {
        let wait = wgpu::PollType::Wait { submission_index: None, timeout: Some(PATIENCE) };
        let stalled = |error: wgpu::PollError| GpuError::Stalled { what, source: error.into() };
        self.device.poll(wait).map(|_| ()).map_err(stalled)
    }

    /// Waits until this submission is done, and with it all before; `what` names it in messages.
    pub(crate) fn wait_for(&self, submission: SubmissionIndex, what: &'static str) -> Result<(), GpuError> {
        let wait = wgpu::PollType::Wait { submission_index: Some(submission), timeout: Some(PATIENCE) };
        let stalled = |error: wgpu::PollError| GpuError::Stalled { what, source: error.into() };
        self.device.poll(wait).map(|_| ()).map_err(stalled)
    }
}

/// Catches the errors of the commands between its opening and [`ErrorScope::close`].
pub(crate) struct ErrorScope {
    what: &'static str,
    memory: wgpu::ErrorScopeGuard,
    validation: wgpu::ErrorScopeGuard,
}

impl ErrorScope {
    /// Opens a scope; `what` names the work in messages.
    pub(crate) fn open(gpu: &Gpu, what: &'static str) -> Self {
        let memory = gpu.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let validation = gpu.device.push_error_scope(wgpu::ErrorFilter::Validation);
        Self { what, memory, validation }
    }

    /// The first error since the scope was opened.
    pub(crate) fn close(self) -> Result<(), GpuError> {
        let refused = pollster::block_on(self.validation.pop());
        let exhausted = pollster::block_on(self.memory.pop());
        match (exhausted, refused) {
            (Some(_), _) => Err(GpuError::OutOfMemory { what: self.what }),
            (None, Some(error)) => Err(GpuError::Refused { what: self.what, source: Box::new(error.into()) }),
            (None, None) => Ok(()),
        }
    }
}

/// A buffer on the device and the one that brings its content back.
#[derive(Debug)]
pub(crate) struct Readback {
    pub(crate) storage: wgpu::Buffer,
    staging: wgpu::Buffer,
    bytes: u64,
}

impl Readback {
    /// A pair of buffers of this size.
    pub(crate) fn new(gpu: &Gpu, label: &'static str, bytes: u64) -> Self {
        let buffer = |usage| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: bytes,
                usage,
                mapped_at_creation: false,
            })
        };
        let storage = buffer(wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC);
        let staging = buffer(wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST);
        Self { storage, staging, bytes }
    }

    /// Brings the content of a buffer back that is seldom read: it has to be usable as a copy's
    /// source.
    pub(crate) fn once<T>(
        gpu: &Gpu,
        label: &'static str,
        storage: &wgpu::Buffer,
        read: impl FnOnce(&[u8]) -> T,
    ) -> Result<T, GpuError> {
        let bytes = storage.size();
        let scope = ErrorScope::open(gpu, label);
        let staging = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: bytes,
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let readback = Self { storage: storage.clone(), staging, bytes };
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        readback.record(&mut encoder);
        gpu.queue.submit([encoder.finish()]);
        scope.close()?;
        readback.read(gpu, read)
    }

    /// Records the copy from device to host.
    pub(crate) fn record(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.copy_buffer_to_buffer(&self.storage, 0, &self.staging, 0, self.bytes);
    }

    /// Waits for the submitted work and hands the bytes to `read`.
    pub(crate) fn read<T>(&self, gpu: &Gpu, read: impl FnOnce(&[u8]) -> T) -> Result<T, GpuError> {
        let what = "a frame";
        let stalled = |source: StallError| GpuError::Stalled { what, source };
        let (sender, receiver) = sync_channel(1);
        self.staging.map_async(wgpu::MapMode::Read, .., move |outcome| {
            // The receiver is gone only when the wait below has already failed.
            let _ = sender.send(outcome);
        });
        let wait = wgpu::PollType::Wait { submission_index: None, timeout: Some(PATIENCE) };
        gpu.device.poll(wait).map_err(|error| stalled(error.into()))?;
        receiver.try_recv().map_err(|error| stalled(error.into()))?.map_err(|error| stalled(error.into()))?;
        let result = {
            let view = self.staging.get_mapped_range(..).map_err(|error| stalled(error.into()))?;
            read(&view)
        };
        self.staging.unmap();
        Ok(result)
    }
}

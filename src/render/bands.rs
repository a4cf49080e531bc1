//! Bands of rows of a picture, submitted one after another, so that a render can be cancelled
//! between them.
//!
//! Only software adapters need several for pictures of usual sizes: they take seconds where
//! graphics cards take milliseconds. Every pixel is computed as in a single dispatch, so the bytes
//! do not depend on the bands.

use std::mem::offset_of;
use std::time::{Duration, Instant};

use super::error::RenderError;
use super::pipelines::WORKGROUP_SIDE;
use super::region::Region;
use super::uniform::FrameUniform;
use super::watch::Watch;
use crate::gpu::{AdapterKind, ErrorScope, Gpu, SubmissionIndex};

/// The time of a band of a software adapter: a picture that is cancelled ends after one or
/// two of them.
const LONG_BAND: Duration = Duration::from_millis(16);
/// The same while several callers share the render thread.
const SHORT_BAND: Duration = Duration::from_millis(4);
/// The time between two questions of the processor's own ray caster, whose threads do not wait
/// for an answer.
const PROCESSOR_PACE: Duration = Duration::from_millis(1);

/// Rows of pixels that one dispatch makes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Band {
    first_row: u32,
    rows: u32,
}

/// How a picture is cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Bands {
    /// Pixels of the first band, about; whole rows of tiles at least.
    pub(super) pixels: u32,
    /// Samples that the rays of the first band may take, about.
    pub(super) samples: f64,
    /// The time that later bands should take, on the processor the time between two questions whether
    /// to continue; `None` where all bands have one size.
    pub(super) duration: Option<Duration>,
}

impl Bands {
    /// The bands for a kind of adapter. Software drivers share the tiles of a dispatch out among the
    /// cores and wait for the last tile: each band costs about a millisecond. The length of rays is
    /// known only when a band is done.
    pub(super) fn of(kind: AdapterKind) -> Self {
        let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        match kind {
            AdapterKind::Software => Self {
                pixels: (1 << 15) * cores.min(128) as u32,
                samples: f64::from(1 << 22) * cores as f64,
                duration: Some(LONG_BAND),
            },
            _ => Self { pixels: 1 << 22, samples: 1e10, duration: None },
        }
    }

    /// The bands of the processor's own ray caster: one of all rows, which asks at this pace.
    pub(super) fn of_processor() -> Self {
        Self { duration: Some(PROCESSOR_PACE), ..Self::of_pixels(u32::MAX) }
    }

    /// Casts the bands of a region: calls `cast` with the first row of each and its number of rows, and
    /// asks after each whether to continue. `cast` returns the number of rows that it cast, from the
    /// first on: all, unless it was cancelled. `done` counts the rows of the region, from its top,
    /// that are cast: by an earlier call on entry, in all on return.
    ///
    /// # Errors
    /// When the caller cancels.
    pub(super) fn each(
        self,
        region: Region,
        done: &mut u32,
        mut cast: impl FnMut(u32, u32, &mut Watch<'_>) -> (u32, Result<(), RenderError>),
        watch: &mut Watch<'_>,
    ) -> Result<(), RenderError> {
        while let Some(band) = self.next(region, *done) {
            let (rows, outcome) = cast(band.first_row, band.rows, watch);
            *done += rows;
            outcome?;
            watch.band_done(*done < region.size[1])?;
        }
        Ok(())
    }

    /// Bands of the given number of pixels, whatever the length of their rays.
    pub(super) fn of_pixels(pixels: u32) -> Self {
        Self { pixels, samples: f64::INFINITY, duration: None }
    }

    /// These bands with the short or the long duration, if they have a duration.
    pub(super) fn shortened(self, are_short: bool) -> Self {
        let Some(before) = self.duration else { return self };
        let wanted = if are_short { SHORT_BAND } else { LONG_BAND };
        // The first band is cut by its samples, because nothing is timed yet.
        let samples = self.samples * (wanted.as_secs_f64() / before.as_secs_f64());
        Self { duration: Some(wanted), samples, ..self }
    }

    /// Bands for rays of at most the given number of samples.
    pub(super) fn for_rays(self, samples_of_ray: f64) -> Self {
        let pixels = (self.samples / samples_of_ray.max(1.0)) as u32;
        Self { pixels: self.pixels.min(pixels), ..self }
    }

    /// The next bands, from the time of the last one: at most twice and at least a quarter its size.
    fn after(self, took: Duration) -> Self {
        let Some(wanted) = self.duration else { return self };
        let factor = (wanted.as_secs_f64() / took.as_secs_f64().max(1e-6)).clamp(0.25, 2.0);
        Self { pixels: ((f64::from(self.pixels) * factor) as u32).max(1), ..self }
    }

    /// The next band of a region of which this many rows are done; `None` when all are.
    fn next(self, Region { first: [_, top], size: [width, height] }: Region, done: u32) -> Option<Band> {
        let tile_rows = (self.pixels / (width.max(1) * WORKGROUP_SIDE)).max(1);
        let rows = tile_rows.saturating_mul(WORKGROUP_SIDE).min(height.checked_sub(done)?);
        (rows > 0).then_some(Band { first_row: top + done, rows })
    }
}

/// Values that all bands of a picture share.
pub(super) struct Dispatch<'a> {
    pub(super) gpu: &'a Gpu,
    /// The stage that renders the picture.
    pub(super) region: Region,
    pub(super) bands: Bands,
    /// The stage's `Frame`, but for the row that a band begins at.
    pub(super) uniform: &'a wgpu::Buffer,
    pub(super) pipeline: &'a wgpu::ComputePipeline,
    /// From group 0 on.
    pub(super) groups: &'a [&'a wgpu::BindGroup],
}

impl Dispatch<'_> {
    /// Submits all bands, the last one with `finish` behind it, and asks after each completed band
    /// whether to continue. The next band is submitted before the present one ends, so that the
    /// adapter never waits. Returns before the last band is done.
    ///
    /// `rows` counts the rows of the region, from its top, that an earlier call submitted; on return,
    /// all that were submitted. It is `None` if pixels of a cancelled call are not kept.
    ///
    /// # Errors
    /// When the adapter refuses a command, or the caller cancels.
    pub(super) fn submit(
        &self,
        rows: Option<&mut u32>,
        mut finish: impl FnMut(&mut wgpu::CommandEncoder),
        watch: &mut Watch<'_>,
    ) -> Result<(), RenderError> {
        let (is_kept, mut unused) = (rows.is_some(), 0);
        let rows = rows.unwrap_or(&mut unused);
        let mut before: Option<SubmissionIndex> = None;
        let Region { first: [first_column, top], size: [_, height] } = self.region;
        let at = offset_of!(FrameUniform, first_column) as u64;
        self.gpu.queue.write_buffer(self.uniform, at, bytemuck::bytes_of(&first_column));
        let (mut bands, mut since) = (self.bands, Instant::now());
        // The read-back is recorded with the last band, so that one is rendered again if need be.
        *rows = self.region.rows_above_last_tiles().min(*rows);
        while let Some(band) = bands.next(self.region, *rows) {
            let is_last = band.first_row + band.rows == top + height;
            let submitted = self.submit_band(band, |encoder| {
                if is_last {
                    finish(encoder);
                }
            })?;
            *rows = band.first_row + band.rows - top;
            if let Some(before) = before.replace(submitted) {
                self.gpu.wait_for(before, "a band")?;
                bands = bands.after(since.elapsed());
                since = Instant::now();
                watch.band_done(is_kept)?;
            }
        }
        // All rows are submitted: making room for another picture gains nothing.
        watch.band_done(false)
    }

    fn submit_band(
        &self,
        band: Band,
        finish: impl FnOnce(&mut wgpu::CommandEncoder),
    ) -> Result<SubmissionIndex, RenderError> {
        let Self { gpu, uniform, .. } = self;
        let scope = ErrorScope::open(gpu, "a frame");
        let at = offset_of!(FrameUniform, first_row) as u64;
        // Takes effect with the submission below, behind those before.
        gpu.queue.write_buffer(uniform, at, bytemuck::bytes_of(&band.first_row));
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_pipeline(self.pipeline);
            for (index, group) in (0..).zip(self.groups) {
                pass.set_bind_group(index, *group, &[]);
            }
            let [x, y] = [self.region.size[0], band.rows].map(|side| side.div_ceil(WORKGROUP_SIDE));
            pass.dispatch_workgroups(x, y, 1);
        }
        finish(&mut encoder);
        let submitted = gpu.queue.submit([encoder.finish()]);
        scope.close()?;
        Ok(submitted)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cut(bands: Bands, size_px: [u32; 2]) -> Vec<Band> {
        let mut done = 0;
        let next = || {
            let band = bands.next(Region::whole(size_px), done)?;
            done += band.rows;
            Some(band)
        };
        std::iter::from_fn(next).collect()
    }

    #[test]
    fn bands_are_whole_rows_of_tiles_that_cover_the_picture_once() {
        for (pixels, size_px, first_rows) in [
            (1 << 16, [960, 540], (0..9).map(|i| i * 64).collect::<Vec<_>>()),
            (1 << 22, [960, 540], vec![0]),
            (1, [960, 20], vec![0, 8, 16]),
            (1 << 16, [8192, 2048], (0..256).map(|i| i * 8).collect()),
            (u32::MAX, [1, 1], vec![0]),
        ] {
            let bands = cut(Bands::of_pixels(pixels), size_px);
            assert_eq!(
                bands.iter().map(|band| band.first_row).collect::<Vec<_>>(),
                first_rows,
                "{size_px:?}"
            );
            let rows: u32 = bands.iter().map(|band| band.rows).sum();
            assert_eq!(rows, size_px[1]);
        }
    }

    #[test]
    fn long_rays_make_small_bands() {
        let bands = Bands { pixels: 1 << 16, samples: 6.5e7, duration: None };
        assert_eq!(bands.for_rays(100.0).pixels, 1 << 16);
        assert_eq!(bands.for_rays(6500.0).pixels, 10_000);
        assert_eq!(bands.for_rays(f64::INFINITY).pixels, 0);
        assert_eq!(Bands::of_pixels(u32::MAX).for_rays(1e9).pixels, u32::MAX);
        assert_eq!(cut(bands.for_rays(f64::INFINITY), [960, 540]).len(), 68, "a row of tiles each");
    }

    #[test]
    fn bands_get_the_size_that_takes_as_long_as_wanted() {
        let bands = Bands { duration: Some(Duration::from_millis(8)), ..Bands::of_pixels(10_000) };
        for (took_ms, pixels) in [(8, 10_000), (10, 8000), (4, 20_000), (1, 20_000), (0, 20_000), (900, 2500)]
        {
            assert_eq!(bands.after(Duration::from_millis(took_ms)).pixels, pixels, "{took_ms} ms");
        }
        let software = Bands::of(AdapterKind::Software);
        let short = software.shortened(true);
        assert!(short.samples < software.samples / 3.0 && short == short.shortened(true));
        assert!((short.shortened(false).samples / software.samples - 1.0).abs() < 1e-9);
        assert_eq!(Bands::of_pixels(7).after(Duration::from_millis(1)).pixels, 7);
    }
}

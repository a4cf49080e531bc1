//! The driver's own rate of trilinear samples: the yardstick for the ray
//! caster.

use std::time::Instant;

use super::pipelines::WORKGROUP_SIDE;
use crate::gpu::{ErrorScope, Gpu, GpuError, Readback, Shader};

/// The stage's sources.
pub(super) const CALIBRATE_SOURCES: [&str; 1] = [include_str!("../../shaders/calibrate.wgsl")];

/// Rays along each side and samples along each ray, as in the shader.
pub(super) const SIDE: u32 = 320;
pub(super) const STEPS: u32 = 192;

/// Measured runs after a warm-up; the fastest counts, since it shows what the driver can do.
const RUNS: usize = 5;

/// Trilinear samples per second on this volume.
pub(super) fn sampling_rate(
    gpu: &Gpu,
    volume: &wgpu::TextureView,
    sampler: &wgpu::Sampler,
) -> Result<f64, GpuError> {
    let scope = ErrorScope::open(gpu, "the calibration");
    let pipeline = Shader::new("calibrate", &CALIBRATE_SOURCES)?.pipeline(gpu, None, &[])?;
    let sums = Readback::new(gpu, "sums", u64::from(SIDE * SIDE) * 4);
    let resources = [
        wgpu::BindingResource::TextureView(volume),
        wgpu::BindingResource::Sampler(sampler),
        sums.storage.as_entire_binding(),
    ];
    let entries: Vec<_> =
        (0..).zip(resources).map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource }).collect();
    let bindings = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("calibrate"),
        layout: &pipeline.get_bind_group_layout(0),
        entries: &entries,
    });
    scope.close()?;
    let mut fastest = f64::INFINITY;
    for run in 0..=RUNS {
        let start = Instant::now();
        dispatch(gpu, &pipeline, &bindings, &sums);
        sums.read(gpu, |_| ())?;
        if run > 0 {
            fastest = fastest.min(start.elapsed().as_secs_f64());
        }
    }
    Ok(f64::from(SIDE * SIDE) * f64::from(STEPS) / fastest)
}

fn dispatch(gpu: &Gpu, pipeline: &wgpu::ComputePipeline, bindings: &wgpu::BindGroup, sums: &Readback) {
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, bindings, &[]);
        pass.dispatch_workgroups(SIDE / WORKGROUP_SIDE, SIDE / WORKGROUP_SIDE, 1);
    }
    sums.record(&mut encoder);
    gpu.queue.submit([encoder.finish()]);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constants_mirror_the_shader() {
        let module = naga::front::wgsl::parse_str(&CALIBRATE_SOURCES.join("\n")).expect("the shader parses");
        for (name, mirror) in [("SIDE", SIDE), ("STEPS", STEPS)] {
            let (_, constant) =
                module.constants.iter().find(|(_, c)| c.name.as_deref() == Some(name)).expect(name);
            let value = &module.global_expressions[constant.init];
            assert!(
                matches!(value, naga::Expression::Literal(naga::Literal::U32(n)) if *n == mirror),
                "{name}: {value:?} in the shader, {mirror} here"
            );
        }
        assert_eq!(module.entry_points[0].workgroup_size, [WORKGROUP_SIDE, WORKGROUP_SIDE, 1]);
    }
}

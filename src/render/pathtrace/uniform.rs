//! The Rust mirror of `struct Path` in `shaders/lib/path.wgsl`, and how a request fills it.

use bytemuck::{Pod, Zeroable};

use crate::light::{InView, Light};
use crate::request::RenderRequest;
use relief_volume::{Camera, MediumTable, linear_from_srgb};

/// One light as the shader has it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(super) struct LightUniform {
    toward: [f32; 3],
    is_near: u32,
    radiance: [f32; 3],
    cos_half: f32,
}

/// The parameters of one dispatch, in the shader's layout; the shader defines meanings and units.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct PathUniform {
    pub(super) first_pass: u32,
    pub(super) passes: u32,
    seed: u32,
    light_count: u32,
    environment: [f32; 3],
    exposure: f32,
    background: [f32; 3],
    anisotropy: f32,
    surface: f32,
    surface_hu_per_mm: f32,
    table_first_hu: f32,
    table_step_hu: f32,
    table_last: u32,
    brick_edge: u32,
    scatterings: u32,
    padding: u32,
    lights: [LightUniform; Light::MAX],
}

impl PathUniform {
    /// The parameters of `request`, for no pass yet. `near_mm` is the view depth of the plane that
    /// start space begins at.
    pub(super) fn new(request: &RenderRequest, near_mm: f64, table: &MediumTable, brick_edge: usize) -> Self {
        let settings = &request.path_trace;
        let mut lights = [LightUniform::default(); Light::MAX];
        for (light, out) in request.lights.iter().zip(&mut lights) {
            *out = LightUniform::new(light, &request.camera, near_mm);
        }
        Self {
            first_pass: 0,
            passes: 0,
            seed: settings.seed,
            light_count: request.lights.len() as u32,
            environment: [settings.environment as f32; 3],
            exposure: settings.exposure as f32,
            background: request.background_rgb.map(|channel| linear_from_srgb(channel) as f32),
            anisotropy: settings.anisotropy as f32,
            surface: settings.surface as f32,
            surface_hu_per_mm: settings.surface_hu_per_mm as f32,
            table_first_hu: table.first_hu,
            table_step_hu: table.step_hu,
            table_last: (table.entries.len() - 1) as u32,
            brick_edge: brick_edge as u32,
            scatterings: settings.scatterings,
            padding: 0,
            lights,
        }
    }
}

impl LightUniform {
    fn new(light: &Light, camera: &Camera, near_mm: f64) -> Self {
        let (toward, is_near) = match light.in_view(camera) {
            InView::Direction(direction) => (direction, 0),
            InView::Position(position) => (position + glam::DVec3::new(0.0, 0.0, near_mm), 1),
        };
        Self {
            toward: toward.as_vec3().to_array(),
            is_near,
            radiance: light.rgb.map(|channel| (linear_from_srgb(channel) * light.intensity) as f32),
            cos_half: (light.size / 2.0).cos() as f32,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::mem::{offset_of, size_of};

    use super::super::denoise::Guide;
    use super::super::stage::{GUIDES, PATHTRACE, StageParts};
    use super::{LightUniform, PathUniform};
    use crate::light::Light;
    use crate::pipelines::WORKGROUP_SIDE;

    fn reflected(stage: &StageParts) -> naga::Module {
        naga::front::wgsl::parse_str(&stage.sources.join("\n")).expect("the shader parses")
    }

    fn members(module: &naga::Module, name: &str) -> (Vec<(String, u32)>, u32) {
        let (_, found) = module.types.iter().find(|(_, t)| t.name.as_deref() == Some(name)).unwrap();
        let naga::TypeInner::Struct { members, span } = &found.inner else { panic!("{name} is a struct") };
        (members.iter().map(|m| (m.name.clone().unwrap(), m.offset)).collect(), *span)
    }

    macro_rules! mirror {
        ($of:ident: $($field:ident),* $(,)?) => {
            (vec![$((stringify!($field).to_owned(), offset_of!($of, $field) as u32)),*], size_of::<$of>() as u32)
        };
    }

    #[test]
    fn path_uniform_mirrors_the_shader() {
        let module = reflected(&PATHTRACE);
        let path = mirror!(
            PathUniform: first_pass, passes, seed, light_count, environment, exposure, background, anisotropy,
            surface, surface_hu_per_mm, table_first_hu, table_step_hu, table_last, brick_edge, scatterings, padding,
            lights,
        );
        assert_eq!(path, members(&module, "Path"));
        assert_eq!(mirror!(LightUniform: toward, is_near, radiance, cos_half), members(&module, "PathLight"));
        let (_, most) =
            module.constants.iter().find(|(_, c)| c.name.as_deref() == Some("MAX_LIGHTS")).unwrap();
        let value = &module.global_expressions[most.init];
        assert!(
            matches!(value, naga::Expression::Literal(naga::Literal::U32(n)) if *n as usize == Light::MAX)
        );
    }

    #[test]
    fn bindings_and_workgroup_mirror_the_shaders() {
        for stage in [&PATHTRACE, &GUIDES] {
            let module = reflected(stage);
            let mut bindings: Vec<(u32, u32, &str)> = module
                .global_variables
                .iter()
                .filter_map(|(_, g)| g.binding.map(|at| (at.group, at.binding, g.name.as_deref().unwrap())))
                // Fields of shared shader files that only the ray caster uses.
                .filter(|(_, _, name)| !["bricks", "brick_distances", "gradients"].contains(name))
                .collect();
            bindings.sort_unstable();
            assert_eq!(bindings, stage.bindings);
            assert_eq!(module.entry_points[0].workgroup_size, [WORKGROUP_SIDE, WORKGROUP_SIDE, 1]);
        }
    }

    #[test]
    fn guides_mirror_the_shader() {
        let guide =
            mirror!(Guide: albedo, coverage, normal, distance_mm, light, unused_a, shadowed, unused_b);
        let (members, span) = members(&reflected(&GUIDES), "Guide");
        assert_eq!((guide.1, members.len()), (span, 4));
        let places: Vec<u32> = guide.0.iter().step_by(2).map(|(_, offset)| *offset).collect();
        assert_eq!(places, members.iter().map(|(_, offset)| *offset).collect::<Vec<_>>());
    }
}

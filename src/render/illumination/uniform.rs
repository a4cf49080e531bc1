//! The Rust mirrors of `struct Lighting` in `shaders/lib/lights.wgsl` and of `struct Illumination`
//! in `shaders/illuminate.wgsl`, and how a request fills them.

use bytemuck::{Pod, Zeroable};
use glam::{DAffine3, DMat4, DVec3};

use super::cells::{Cells, DIRECTIONS, disc_rays, sphere_direction};
use super::stage::CELLS_SIDE;
use crate::classification::Classification;
use crate::illumination::quantity::LightQuantity;
use crate::light::{InPatient, Light};
use crate::limits::depth_limits;
use crate::request::RenderRequest;
use relief_volume::Grid;

/// One light as rays have it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(super) struct PlacedLight {
    toward: [f32; 3],
    is_near: u32,
    rgb: [f32; 3],
    padding: f32,
}

/// The light of a frame as rays have it; meanings and units are in the shader.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(super) struct LightingUniform {
    place_from_voxel: [[f32; 4]; 4],
    texture_from_normal: [[f32; 4]; 3],
    cells_from_voxel: [f32; 3],
    light_count: u32,
    shadows: f32,
    occlusion: f32,
    padding_a: f32,
    padding_b: f32,
    lights: [PlacedLight; Light::MAX],
}

impl LightingUniform {
    /// The light of `request` on a volume of this grid.
    pub(super) fn new(request: &RenderRequest, grid: &Grid, cells: &Cells) -> Self {
        let center = grid.center().xyz;
        let place_from_voxel = DAffine3::from_translation(-center) * grid.patient_from_voxel().affine;
        let texture = DVec3::from(cells.dims.map(|n| 1.0 / n as f64));
        let column = |normal: DVec3| (Cells::step_before(grid, normal) * texture).extend(0.0);
        let columns = [DVec3::X, DVec3::Y, DVec3::Z].map(column);
        let mut lights = [PlacedLight::default(); Light::MAX];
        for (light, out) in request.lights.iter().zip(&mut lights) {
            let (toward, is_near) = match light.in_patient(&request.camera) {
                InPatient::Direction(direction) => (direction.xyz, 0),
                InPatient::Position(position) => (position.xyz - center, 1),
            };
            let rgb = light.rgb.map(|channel| (channel * light.intensity) as f32);
            *out = PlacedLight { toward: toward.as_vec3().to_array(), is_near, rgb, padding: 0.0 };
        }
        Self {
            place_from_voxel: DMat4::from(place_from_voxel).as_mat4().to_cols_array_2d(),
            texture_from_normal: columns.map(|column| column.as_vec4().to_array()),
            cells_from_voxel: std::array::from_fn(|axis| (texture[axis] / cells.voxels[axis] as f64) as f32),
            light_count: request.lights.len() as u32,
            shadows: request.illumination.shadows as f32,
            occlusion: request.illumination.occlusion.strength as f32,
            padding_a: 0.0,
            padding_b: 0.0,
            lights,
        }
    }
}

/// One light as cells have it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(super) struct SourceUniform {
    toward: [f32; 3],
    is_near: u32,
    cos_half: f32,
    rays: u32,
    padding_a: u32,
    padding_b: u32,
}

/// One dispatch over cells; meanings and units are in the shader.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct IlluminationUniform {
    start_from_voxel: [[f32; 4]; 4],
    cell_voxels: [f32; 3],
    pub(super) first_layer: u32,
    cells: [u32; 3],
    source_count: u32,
    begin_mm: f32,
    radius_mm: f32,
    reach: u32,
    padding: u32,
    sources: [SourceUniform; Light::MAX],
    directions: [[f32; 4]; DIRECTIONS],
}

impl IlluminationUniform {
    /// The parameters for the cells of a grid, in the start space of `request`'s camera; bricks
    /// have `brick_edge` voxels.
    pub(super) fn new(
        request: &RenderRequest,
        grid: &Grid,
        brick_edge: usize,
        cells: &Cells,
        sought: &LightQuantity,
    ) -> Self {
        let start = DVec3::new(0.0, 0.0, depth_limits(&request.camera, grid).near_mm);
        let start_from_patient =
            DAffine3::from_translation(start) * request.camera.view_from_patient().affine;
        let start_from_voxel = start_from_patient * grid.patient_from_voxel().affine;
        let turned = |direction: DVec3| start_from_patient.transform_vector3(direction).as_vec3();
        let mut sources = [SourceUniform::default(); Light::MAX];
        let (lights, radius_mm): (&[_], f64) = match sought {
            LightQuantity::Shadows(lights) => (lights, 0.0),
            LightQuantity::Openness { radius_mm } => (&[], *radius_mm),
        };
        for ((placement, size), out) in lights.iter().zip(&mut sources) {
            let (toward, is_near) = match *placement {
                InPatient::Direction(direction) => (turned(direction.xyz), 0),
                InPatient::Position(place) => (start_from_patient.transform_point3(place.xyz).as_vec3(), 1),
            };
            let (cos_half, rays) = ((size / 2.0).cos() as f32, disc_rays(*size));
            let toward = toward.to_array();
            *out = SourceUniform { toward, is_near, cos_half, rays, padding_a: 0, padding_b: 0 };
        }
        // A path reaches into the next brick.
        let is_pre_integrated = request.classification == Classification::PreIntegrated;
        Self {
            start_from_voxel: DMat4::from(start_from_voxel).as_mat4().to_cols_array_2d(),
            cell_voxels: cells.voxels.map(|n| n as f32),
            first_layer: 0,
            cells: cells.dims.map(|n| n as u32),
            source_count: lights.len() as u32,
            begin_mm: cells.begin_mm() as f32,
            radius_mm: radius_mm as f32,
            reach: cells.reach(brick_edge) as u32 + u32::from(is_pre_integrated),
            padding: 0,
            sources,
            directions: std::array::from_fn(|i| turned(sphere_direction(i)).extend(0.0).to_array()),
        }
    }

    /// Workgroups along i, j, k.
    pub(super) fn dispatch_size(&self) -> [u32; 3] {
        self.cells.map(|n| n.div_ceil(CELLS_SIDE))
    }
}

#[cfg(test)]
mod tests {
    use std::mem::{offset_of, size_of};

    use super::super::stage::{CELL_BINDINGS, LIGHTING_BINDINGS, illuminate_sources};
    use super::*;
    use crate::pipelines::{RAYCAST, stage_sources};
    use crate::table_storage::TableStorage;

    fn members(module: &naga::Module, name: &str) -> (Vec<(String, u32)>, u32) {
        let (_, found) = module.types.iter().find(|(_, t)| t.name.as_deref() == Some(name)).unwrap();
        let naga::TypeInner::Struct { members, span } = &found.inner else { panic!("{name} is a struct") };
        (members.iter().map(|m| (m.name.clone().unwrap(), m.offset)).collect(), *span)
    }

    fn constant(module: &naga::Module, name: &str) -> u32 {
        let (_, found) = module.constants.iter().find(|(_, c)| c.name.as_deref() == Some(name)).unwrap();
        match module.global_expressions[found.init] {
            naga::Expression::Literal(naga::Literal::U32(value)) => value,
            _ => panic!("{name} is a number"),
        }
    }

    fn bindings_of_group(module: &naga::Module, group: u32) -> Vec<(u32, &str)> {
        let bindings = module.global_variables.iter().filter_map(|(_, global)| {
            let at = global.binding.filter(|at| at.group == group)?;
            Some((at.binding, global.name.as_deref()?))
        });
        let mut bindings: Vec<_> = bindings.collect();
        bindings.sort_unstable();
        bindings
    }

    macro_rules! mirror {
        ($of:ident: $($field:ident),* $(,)?) => {
            (vec![$((stringify!($field).to_owned(), offset_of!($of, $field) as u32)),*], size_of::<$of>() as u32)
        };
    }

    #[test]
    fn lighting_mirrors_the_shader() {
        let source = stage_sources(TableStorage::Uniform, RAYCAST).join("\n");
        let module = naga::front::wgsl::parse_str(&source).expect("the shader parses");
        let lighting = mirror!(
            LightingUniform: place_from_voxel, texture_from_normal, cells_from_voxel, light_count, shadows,
            occlusion, padding_a, padding_b, lights,
        );
        assert_eq!(lighting, members(&module, "Lighting"));
        assert_eq!(mirror!(PlacedLight: toward, is_near, rgb, padding), members(&module, "PlacedLight"));
        assert_eq!(constant(&module, "MAX_PLACED") as usize, Light::MAX);
        assert_eq!(bindings_of_group(&module, 1), LIGHTING_BINDINGS);
    }

    #[test]
    fn illumination_mirrors_the_shader() {
        for table in [TableStorage::Uniform, TableStorage::Storage] {
            let source = illuminate_sources(table).join("\n");
            let module = naga::front::wgsl::parse_str(&source).expect("the shader parses");
            let uniform = mirror!(
                IlluminationUniform: start_from_voxel, cell_voxels, first_layer, cells, source_count, begin_mm,
                radius_mm, reach, padding, sources, directions,
            );
            assert_eq!(uniform, members(&module, "Illumination"));
            let source = mirror!(SourceUniform: toward, is_near, cos_half, rays, padding_a, padding_b);
            assert_eq!(source, members(&module, "Source"));
            assert_eq!(constant(&module, "MAX_SOURCES") as usize, Light::MAX);
            assert_eq!(constant(&module, "DIRECTIONS") as usize, DIRECTIONS);
            for group in [0, 1] {
                let of_group = CELL_BINDINGS.iter().filter(|(of, _, _)| *of == group);
                let expected: Vec<_> = of_group.map(|&(_, binding, name)| (binding, name)).collect();
                assert_eq!(bindings_of_group(&module, group), expected);
            }
            assert_eq!(module.entry_points[0].workgroup_size, [CELLS_SIDE; 3]);
        }
    }
}

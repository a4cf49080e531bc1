//! The Rust mirror of `struct Frame` in `shaders/lib/frame.wgsl`, and how a request fills it.
//!
//! The test below compares names, offsets and sizes with naga's reflection of the shader.

use bytemuck::{Pod, Zeroable};

use super::classification::Classification;
use super::limits::depth_limits;
use super::request::{Clip, RenderRequest};
use super::skipping::EmptySpaceSkipping;
use super::surface::Surface;
use super::upload::Appearance;
use crate::gradients::patient_from_voxel_gradient;
use relief_base::{Transform, View, Voxel};
use relief_volume::{Camera, Grid, Projection, Volume};

/// The parameters of one frame, in the shader's layout; the shader defines meanings and units.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct FrameUniform {
    voxel_from_start: [[f32; 4]; 4],
    patient_from_view: [[f32; 4]; 3],
    patient_from_voxel_gradient: [[f32; 4]; 3],
    dims: [f32; 3],
    sample_distance_mm: f32,
    texture_per_voxel: [f32; 3],
    pub(super) first_row: u32,
    half_extent: [f32; 2],
    size_px: [u32; 2],
    background_rgb: [f32; 3],
    is_orthographic: u32,
    ambient: f32,
    diffuse: f32,
    specular: f32,
    shininess: f32,
    table_first_hu: f32,
    table_entries_per_hu: f32,
    table_last: u32,
    depth_fraction: f32,
    clip_plane_count: u32,
    near_mm: f32,
    lowest_visible_hu: f32,
    skipping: u32,
    brick_dims: [f32; 3],
    bricks_per_voxel: f32,
    cut_center: [f32; 3],
    cut_radius_mm: f32,
    clip_planes: [[f32; 4]; Clip::MAX_PLANES],
    lowest_hu: f32,
    span_hu: f32,
    units_per_sample: f32,
    surface_count: u32,
    gradient_scale: f32,
    pub(super) first_column: u32,
    lens_shift: [f32; 2],
    surface_hu: [[f32; 4]; Surface::MOST / 4],
    surface_rgba: [[f32; 4]; Surface::MOST],
    face_fade_mm: f32,
    face_lowest_hu: f32,
    face_per_hu: f32,
    padding: f32,
}

impl FrameUniform {
    /// The parameters of `request` on a volume.
    pub(super) fn new(
        request: &RenderRequest,
        volume: &Volume,
        appearance: &Appearance,
        skipping: EmptySpaceSkipping,
    ) -> Self {
        let grid = volume.grid();
        let (lowest_hu, span_hu) = brightness_range(volume);
        let camera = &request.camera;
        let near_mm = depth_limits(camera, grid).near_mm;
        let start = glam::DVec3::new(0.0, 0.0, -near_mm);
        let voxel_from_start = voxel_from_view(camera, grid).affine * glam::DAffine3::from_translation(start);
        let light = &request.shading;
        let table = &appearance.tables.own;
        let [face_lowest_hu, face_per_hu] = request.cut.window();
        let cut = request.clip.sphere;
        let cut_radius_mm = cut.map_or(0.0, |sphere| sphere.radius_mm);
        let cut_center =
            cut.map_or(glam::DVec3::ZERO, |sphere| (camera.view_from_patient() * sphere.center).xyz);
        Self {
            voxel_from_start: glam::DMat4::from(voxel_from_start).as_mat4().to_cols_array_2d(),
            patient_from_view: columns(camera.patient_from_view().linear()),
            patient_from_voxel_gradient: columns(patient_from_voxel_gradient(grid)),
            dims: grid.dims().map(|n| n as f32),
            sample_distance_mm: request.sample_distance_mm as f32,
            texture_per_voxel: grid.dims().map(|n| 1.0 / n as f32),
            first_row: 0,
            half_extent: camera.half_extent(request.size_px).map(|mm| mm as f32),
            size_px: request.size_px,
            background_rgb: request.background_rgb.map(|channel| channel as f32),
            is_orthographic: matches!(camera.projection(), Projection::Orthographic { .. }).into(),
            ambient: light.ambient as f32,
            diffuse: light.diffuse as f32,
            specular: light.specular as f32,
            shininess: light.shininess as f32,
            table_first_hu: table.first_hu,
            // Exact: the step is a power of two.
            table_entries_per_hu: 1.0 / table.step_hu,
            table_last: (table.entries.len() - 1) as u32,
            depth_fraction: request.depth.of_rays().fraction().unwrap_or(0.0) as f32,
            clip_plane_count: request.clip.planes.len() as u32,
            near_mm: near_mm as f32,
            lowest_visible_hu: appearance.tables.lowest_visible_hu(),
            skipping: u32::from(
                skipping == EmptySpaceSkipping::On
                    && paths_end_in_neighbours(request, grid, appearance.bricks.edge),
            ),
            brick_dims: appearance.bricks.dims.map(|n| n as f32),
            bricks_per_voxel: 1.0 / appearance.bricks.edge as f32,
            cut_center: (cut_center + glam::DVec3::Z * near_mm).to_array().map(|mm| mm as f32),
            cut_radius_mm: cut_radius_mm as f32,
            clip_planes: clip_planes_in_view(camera, &request.clip)
                .map(|[x, y, z, d]| [x, y, z, d - z * near_mm].map(|value| value as f32)),
            lowest_hu: lowest_hu as f32,
            span_hu: span_hu as f32,
            units_per_sample: (request.sample_distance_mm / request.transfer.opacity_unit_mm()) as f32,
            surface_count: request.surfaces.len() as u32,
            gradient_scale: appearance.gradient_scale,
            first_column: 0,
            lens_shift: camera.lens_shift().map(|mm| mm as f32),
            surface_hu: surface_values(&request.surfaces),
            surface_rgba: surface_colors(&request.surfaces),
            face_fade_mm: face_fade_mm(grid) as f32,
            face_lowest_hu: face_lowest_hu as f32,
            face_per_hu: face_per_hu as f32,
            padding: 0.0,
        }
    }
}

/// Distance over which the light of a cut face fades into that of gradients: four voxels, mm.
pub(super) fn face_fade_mm(grid: &Grid) -> f64 {
    4.0 * grid.spacing_mm().into_iter().fold(f64::INFINITY, f64::min)
}

/// Whether a pre-integrated sample's path, half of it to each side, stays within the bricks next to
/// its own: what lets bricks be skipped.
pub(super) fn paths_end_in_neighbours(request: &RenderRequest, grid: &Grid, brick_edge: usize) -> bool {
    let finest_mm = grid.spacing_mm().into_iter().fold(f64::INFINITY, f64::min);
    request.classification == Classification::Sampled
        || 0.5 * request.sample_distance_mm <= finest_mm * brick_edge as f64
}

/// A matrix as a uniform has it: each column padded to four.
fn columns(matrix: glam::DMat3) -> [[f32; 4]; 3] {
    matrix.to_cols_array_2d().map(|[x, y, z]| [x as f32, y as f32, z as f32, 0.0])
}

/// The volume's smallest value, and the range of its values, at least 1; HU.
pub(super) fn brightness_range(volume: &Volume) -> (f64, f64) {
    let (lowest, largest) = volume.range_hu();
    (f64::from(lowest), (f64::from(largest) - f64::from(lowest)).max(1.0))
}

/// The values that rays have to pass, four to a vector.
fn surface_values(surfaces: &[Surface]) -> [[f32; 4]; Surface::MOST / 4] {
    let mut values = [[0.0; 4]; Surface::MOST / 4];
    for (surface, value) in surfaces.iter().zip(values.as_flattened_mut()) {
        *value = surface.level_hu() as f32;
    }
    values
}

/// Colour and opacity of each surface.
fn surface_colors(surfaces: &[Surface]) -> [[f32; 4]; Surface::MOST] {
    let mut colors = [[0.0; 4]; Surface::MOST];
    for (surface, color) in surfaces.iter().zip(&mut colors) {
        let [r, g, b] = surface.rgb;
        *color = [r, g, b, surface.opacity].map(|value| value as f32);
    }
    colors
}

/// Voxel index of a view position.
pub(super) fn voxel_from_view(camera: &Camera, grid: &Grid) -> Transform<Voxel, View> {
    grid.voxel_from_patient() * camera.patient_from_view()
}

/// Clip planes as (n, d) in view space: kept where `n·p + d >= 0`. Unused ones are zero.
pub(super) fn clip_planes_in_view(camera: &Camera, clip: &Clip) -> [[f64; 4]; Clip::MAX_PLANES] {
    let view_from_patient = camera.view_from_patient();
    let mut planes = [[0.0; 4]; Clip::MAX_PLANES];
    for (plane, out) in clip.planes.iter().zip(&mut planes) {
        let normal = (view_from_patient * plane.normal).xyz.normalize();
        let point = (view_from_patient * plane.point).xyz;
        *out = normal.extend(-normal.dot(point)).to_array();
    }
    planes
}

#[cfg(test)]
mod tests {
    use std::mem::{offset_of, size_of};

    use super::super::pipelines::{BINDINGS, RAYCAST, WORKGROUP_SIDE, stage_sources};
    use super::super::table_storage::TableStorage;
    use super::FrameUniform;

    /// The stage as naga reads it, with the transfer table in either place.
    fn reflected() -> [naga::Module; 2] {
        [TableStorage::Uniform, TableStorage::Storage].map(|table| {
            naga::front::wgsl::parse_str(&stage_sources(table, RAYCAST).join("\n"))
                .expect("the shader parses")
        })
    }

    /// Invariant: The Rust mirror of each shader's uniform has the same names, offsets, sizes and
    /// bindings.
    #[test]
    fn frame_uniform_mirrors_the_shader() {
        macro_rules! mirror {
            ($($field:ident),* $(,)?) => {
                vec![$((stringify!($field), offset_of!(FrameUniform, $field) as u32)),*]
            };
        }
        let mirror = mirror!(
            voxel_from_start,
            patient_from_view,
            patient_from_voxel_gradient,
            dims,
            sample_distance_mm,
            texture_per_voxel,
            first_row,
            half_extent,
            size_px,
            background_rgb,
            is_orthographic,
            ambient,
            diffuse,
            specular,
            shininess,
            table_first_hu,
            table_entries_per_hu,
            table_last,
            depth_fraction,
            clip_plane_count,
            near_mm,
            lowest_visible_hu,
            skipping,
            brick_dims,
            bricks_per_voxel,
            cut_center,
            cut_radius_mm,
            clip_planes,
            lowest_hu,
            span_hu,
            units_per_sample,
            surface_count,
            gradient_scale,
            first_column,
            lens_shift,
            surface_hu,
            surface_rgba,
            face_fade_mm,
            face_lowest_hu,
            face_per_hu,
            padding,
        );
        let [module, _] = reflected();
        let (_, frame) = module.types.iter().find(|(_, t)| t.name.as_deref() == Some("Frame")).unwrap();
        let naga::TypeInner::Struct { members, span } = &frame.inner else { panic!("Frame is a struct") };
        let shader: Vec<_> = members.iter().map(|m| (m.name.as_deref().unwrap(), m.offset)).collect();
        assert_eq!(mirror, shader);
        assert_eq!(size_of::<FrameUniform>(), *span as usize);
    }

    /// Invariant: The Rust mirror of each shader's uniform has the same names, offsets, sizes and
    /// bindings.
    #[test]
    fn bindings_and_workgroup_mirror_the_shader() {
        for module in reflected() {
            let mut bindings: Vec<(u32, &str)> = module
                .global_variables
                .iter()
                .filter_map(|(_, global)| {
                    // `illumination` has the second group.
                    let at = global.binding.filter(|at| at.group == 0)?;
                    Some((at.binding, global.name.as_deref()?))
                })
                .collect();
            bindings.sort_unstable();
            assert_eq!(bindings, BINDINGS);
            assert_eq!(module.entry_points[0].workgroup_size, [WORKGROUP_SIDE, WORKGROUP_SIDE, 1]);
        }
    }
}

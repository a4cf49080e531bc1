//! The camera of a picture in the conventions of computer vision: a matrix of intrinsics, a pose,
//! and places of the surface seen.
//!
//! Axes are OpenCV's: x right, y down, z forward; the world is patient LPS, mm. Pixel centres of
//! `K` have integer coordinates, as in OpenCV: (0.5, 0.5) of this program, COLMAP and NeRF's
//! readers is (0, 0) there.

use glam::{DMat3, DMat4, DVec3};
use serde::{Deserialize, Serialize};

use super::error::SeriesError;
use relief_render::RenderedFrame;
use relief_volume::Projection;

/// The content of `VIEW.camera.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ViewCamera {
    /// Width and height of the picture.
    pub size_px: [u32; 2],
    /// Intrinsics, row by row, px; the centre of the first pixel is (0, 0). There is no distortion.
    #[serde(rename = "K")]
    pub intrinsics: [[f64; 3]; 3],
    /// From patient mm to camera mm, row by row: `[R | t]` and a row of 0 0 0 1.
    pub camera_from_patient: [[f64; 4]; 4],
    /// View depths between which the volume lies, mm.
    pub near_mm: f64,
    /// See `near_mm`.
    pub far_mm: f64,
    /// The unit of `VIEW.depth.png`, mm.
    pub depth_png_unit_mm: f64,
    /// Places that the picture shows: column and row of the pixel, patient x, y and z in mm, red,
    /// green and blue.
    pub surface: Vec<[f64; 8]>,
}

/// Places of the surface for each picture, about.
const PLACES: f64 = 400.0;
/// Coverage from which a pixel shows a surface.
const COVERED: u8 = 128;

impl ViewCamera {
    /// The camera of a picture.
    ///
    /// # Errors
    /// When it is parallel: neither OpenCV nor COLMAP has such cameras.
    pub(super) fn of(frame: &RenderedFrame) -> Result<Self, SeriesError> {
        let camera = &frame.camera;
        if let Projection::Orthographic { .. } = camera.projection() {
            let reason = "product camera is for perspective views; slices and parallel projections have no matrix of intrinsics";
            return Err(SeriesError::permanent(reason));
        }
        let [width, height] = frame.size_px.map(f64::from);
        let [half_x, half_y] = camera.half_extent(frame.size_px);
        let [shift_x, shift_y] = camera.lens_shift();
        let (fx, fy) = (width / (2.0 * half_x), height / (2.0 * half_y));
        let (cx, cy) = (width / 2.0 - shift_x * fx - 0.5, height / 2.0 + shift_y * fy - 0.5);
        let to_opencv = DMat4::from_scale(DVec3::new(1.0, -1.0, -1.0));
        let pose = to_opencv * DMat4::from(camera.view_from_patient().affine);
        Ok(Self {
            size_px: frame.size_px,
            intrinsics: [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]],
            camera_from_patient: pose.transpose().to_cols_array_2d(),
            near_mm: frame.limits.near_mm,
            far_mm: frame.limits.far_mm,
            depth_png_unit_mm: crate::product::DEPTH_UNIT_MM,
            surface: surface(frame),
        })
    }

    pub(super) fn to_json(&self) -> Vec<u8> {
        serde_json::to_vec(self).unwrap_or_default()
    }

    /// The pose as a matrix.
    pub(super) fn pose(&self) -> DMat4 {
        DMat4::from_cols_array_2d(&self.camera_from_patient).transpose()
    }

    /// The pose as a quaternion (w, x, y, z) and a translation, as COLMAP writes it.
    pub(super) fn rotation_and_translation(&self) -> ([f64; 4], [f64; 3]) {
        let pose = self.pose();
        let [x, y, z, w] = glam::DQuat::from_mat3(&DMat3::from_mat4(pose)).normalize().to_array();
        ([w, x, y, z], pose.w_axis.truncate().to_array())
    }

    /// Focal lengths and principal point with the corner of the first pixel at (0, 0), as COLMAP
    /// and NeRF's readers have them.
    pub(super) fn pinhole(&self) -> [f64; 4] {
        let [[fx, _, cx], [_, fy, cy], _] = self.intrinsics;
        [fx, fy, cx + 0.5, cy + 0.5]
    }
}

/// Points of a grid of pixels that show something.
fn surface(frame: &RenderedFrame) -> Vec<[f64; 8]> {
    let [width, height] = frame.size_px;
    let step = (f64::from(width) * f64::from(height) / PLACES).sqrt().ceil() as u32;
    let thousandths = |mm: f64| (mm * 1e3).round() / 1e3;
    let rows = (step / 2..height).step_by(step as usize);
    let pixels =
        rows.flat_map(|row| (step / 2..width).step_by(step as usize).map(move |column| [column, row]));
    let place = |pixel: [u32; 2]| {
        let [r, g, b, coverage] = frame.color_rgba[(pixel[1] * width + pixel[0]) as usize];
        let at = frame.pick(pixel).filter(|_| coverage >= COVERED)?;
        let [x, y, z] = at.xyz.to_array().map(thousandths);
        Some([f64::from(pixel[0]), f64::from(pixel[1]), x, y, z, r.into(), g.into(), b.into()])
    };
    pixels.filter_map(place).collect()
}

//! Rendered pictures: colour and depth as arrays, and files of them.

use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::error::{ReliefError, raised};
use relief_base::ViewDepth;
use relief_display::{DisplaySettings, Layout};
use relief_render::{BackLayer, RenderedFrame};
use relief_session::{FileFormat, Product, encode};

/// A picture with its depth. The arrays are the picture: changes to them go into its files.
#[pyclass(frozen, module = "relief._native")]
pub(crate) struct Frame {
    /// Everything but the pixels.
    frame: RenderedFrame,
    display: DisplaySettings,
    /// The depth as it was rendered, where there is another one for displays; else empty.
    rendered_mm: Vec<f32>,
    color: Py<PyArray3<u8>>,
    depth_mm: Py<PyArray2<f32>>,
}

impl Frame {
    /// Moves the pixels into arrays.
    pub(crate) fn new(py: Python<'_>, mut frame: RenderedFrame, display: DisplaySettings) -> PyResult<Self> {
        let [width, height] = frame.size_px.map(|side| side as usize);
        let rgba: Vec<u8> = bytemuck::allocation::cast_vec(std::mem::take(&mut frame.color_rgba));
        let color = PyArray1::from_vec(py, rgba).reshape([height, width, 4])?.unbind();
        let depth = std::mem::take(&mut frame.depth_mm);
        let rendered_mm = if frame.display_mm.is_some() { depth.clone() } else { Vec::new() };
        let depth_mm = PyArray1::from_vec(py, depth).reshape([height, width])?.unbind();
        Ok(Self { frame, display, rendered_mm, color, depth_mm })
    }

    /// The picture with its pixels.
    fn whole(&self, py: Python<'_>) -> PyResult<RenderedFrame> {
        let color: PyReadonlyArray3<'_, u8> = self.color.bind(py).readonly();
        let depth: PyReadonlyArray2<'_, f32> = self.depth_mm.bind(py).readonly();
        let rgba: Vec<u8> = color.as_array().iter().copied().collect();
        let back = self.frame.back.as_ref();
        let back = back
            .map(|back| BackLayer { color_rgba: back.color_rgba.clone(), depth_mm: back.depth_mm.clone() });
        let depth_mm: Vec<f32> = depth.as_array().iter().copied().collect();
        // A depth that was changed replaces the one that was made for displays.
        let is_changed = depth_mm != self.rendered_mm;
        let display_mm = self.frame.display_mm.clone().filter(|_| !is_changed);
        Ok(RenderedFrame {
            color_rgba: rgba.as_chunks::<4>().0.to_vec(),
            depth_mm,
            display_mm,
            back,
            ..self.frame.clone()
        })
    }
}

#[pymethods]
impl Frame {
    /// Red, green, blue and coverage, [row, column, channel].
    #[getter]
    fn color<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray3<u8>> {
        self.color.bind(py).clone()
    }

    /// View depth in mm, [row, column]; infinity where a ray hit nothing.
    #[getter]
    fn depth_mm<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f32>> {
        self.depth_mm.bind(py).clone()
    }

    /// Width and height, pixels.
    #[getter]
    fn size_px(&self) -> (u32, u32) {
        self.frame.size_px.into()
    }

    /// Time of rendering, ms.
    #[getter]
    fn render_ms(&self) -> f64 {
        self.frame.timings.render_ms
    }

    /// View depths between which disparity is spread, mm.
    fn limits_mm(&self, py: Python<'_>) -> PyResult<(f64, f64)> {
        let limits = self.whole(py)?.limits_for(&self.display).map_err(|error| raised(&error))?;
        Ok((limits.near_mm, limits.far_mm))
    }

    /// The patient position that a pixel shows, LPS mm; None where its ray hit nothing.
    fn pick(&self, py: Python<'_>, x: u32, y: u32) -> PyResult<Option<[f64; 3]>> {
        let [width, height] = self.frame.size_px;
        if x >= width || y >= height {
            return Err(ReliefError::new_err(format!(
                "pixel {x}, {y} is outside of a picture of {width}x{height}"
            )));
        }
        let depth = self.depth_mm.bind(py).readonly().as_array()[[y as usize, x as usize]];
        Ok(self.frame.point_at([x, y], ViewDepth(depth)).map(|point| point.xyz.to_array()))
    }

    /// The bytes of a file: png in a layout, jpg of the colour, exr of colour and depth in mm.
    #[pyo3(signature = (layout=None, format="png"))]
    fn encode<'py>(
        &self,
        py: Python<'py>,
        layout: Option<&str>,
        format: &str,
    ) -> PyResult<Bound<'py, PyBytes>> {
        let known = [
            ("png", FileFormat::Png),
            ("jpg", FileFormat::Jpeg),
            ("exr", FileFormat::Exr),
            ("raw", FileFormat::Raw),
        ];
        let found = known.into_iter().find(|(name, _)| *name == format);
        let (_, format) = found.ok_or_else(|| {
            ReliefError::new_err(format!("no format {format:?}; allowed: png, jpg, exr, raw"))
        })?;
        let mut display = self.display.clone();
        if let Some(name) = layout {
            display.layout = name.parse::<Layout>().map_err(|error| raised(&error))?;
        }
        let frame = self.whole(py)?;
        let bytes = py.detach(|| {
            display.validate().map_err(|error| raised(&error))?;
            encode(&frame, &display, Product::Frame, format).map_err(|error| raised(&error))
        })?;
        Ok(PyBytes::new(py, &bytes))
    }
}

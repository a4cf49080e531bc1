//! Volumes.

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use numpy::{PyArray3, PyArrayMethods, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::error::{ReliefError, raised};
use crate::frame::Frame;
use crate::renderers;
use relief_archive::{ArchiveAccess, Credentials};
use relief_base::Transform;
use relief_batch::{Copies, CopiesOptions, Local, Location};
use relief_dicom::{Strictness, discover, is_volume_file, load, read_volume};
use relief_render::{SceneFile, Subject};
use relief_volume::{Grid, Orbit, PhantomKind, PhantomRecipe, UnknownPhantom};

/// A CT volume in HU.
#[pyclass(frozen, module = "relief._native")]
pub(crate) struct Volume {
    volume: relief_volume::Volume,
    warnings: Vec<String>,
}

/// Bytes that copies of series of archives and buckets may have together.
const COPIES_BYTES: u64 = 16 << 30;

/// Paths: the folder of copies, then login, token, authorities and identity for an archive.
type RemoteFiles = [Option<PathBuf>; 5];

/// A copy of a series of an archive or a bucket, with its folder, which goes with the value if it is a
/// temporary one.
fn copy(
    path: &Path,
    [folder, login, token, authorities, identity]: RemoteFiles,
) -> PyResult<(Copies, Local)> {
    if login.is_some() && token.is_some() {
        return Err(ReliefError::new_err("archive_login_file and archive_token_file exclude each other"));
    }
    let login = login.as_deref().map(Credentials::login_of).transpose().map_err(|error| raised(&error))?;
    let token = token.as_deref().map(Credentials::token_of).transpose().map_err(|error| raised(&error))?;
    let archives = ArchiveAccess { credentials: login.or(token), authorities, identity };
    let options = CopiesOptions { folder, bytes: COPIES_BYTES, archives, ..CopiesOptions::default() };
    let copies = Copies::new(options);
    let local = copies.local(path).map_err(|error| raised(&error))?;
    Ok((copies, local))
}

/// Loads a series or a volume file, of this machine, an archive or a bucket.
#[pyfunction]
#[pyo3(signature = (path, series_uid=None, strict=false, remote=[None, None, None, None, None]))]
pub(crate) fn open_volume(
    py: Python<'_>,
    path: PathBuf,
    series_uid: Option<String>,
    strict: bool,
    remote: RemoteFiles,
) -> PyResult<Volume> {
    py.detach(move || {
        // A copy stays until the series is read.
        let copy = Location::is_remote(&path).then(|| copy(&path, remote)).transpose()?;
        let path = copy.as_ref().map_or(&*path, |(_, local)| local.path());
        if is_volume_file(path) {
            let found = read_volume(path).map_err(|error| raised(&error))?;
            let warnings = found.warnings.into_iter().map(|warning| warning.message).collect();
            return Ok(Volume { volume: found.volume, warnings });
        }
        let strictness = if strict { Strictness::Strict } else { Strictness::Lenient };
        let found = discover(path, strictness, &|_| ()).map_err(|error| raised(&error))?;
        let entry = found.select(series_uid.as_deref()).map_err(|error| raised(&error))?;
        let loaded = load(entry, strictness, &|_| ()).map_err(|error| raised(&error))?;
        let warnings = found.warnings().into_iter().chain(loaded.warnings).map(|warning| warning.message);
        Ok(Volume { warnings: warnings.collect(), volume: loaded.volume })
    })
}

/// Makes a phantom.
#[pyfunction]
#[pyo3(signature = (kind="head", size=128))]
pub(crate) fn phantom(py: Python<'_>, kind: &str, size: usize) -> PyResult<Volume> {
    let kind: PhantomKind = kind.parse().map_err(|error: UnknownPhantom| raised(&error))?;
    let recipe = PhantomRecipe::new(kind).with_size(size).map_err(|error| raised(&error))?;
    Ok(py.detach(move || Volume { volume: recipe.make().volume, warnings: Vec::new() }))
}

impl Volume {
    /// The volume; voxels are shared.
    pub(crate) fn clone_volume(&self) -> relief_volume::Volume {
        self.volume.clone()
    }
}

#[pymethods]
impl Volume {
    /// A volume of an array of HU, [k, j, i], which is copied.
    #[staticmethod]
    fn from_hu(
        voxels: PyReadonlyArray3<'_, i16>,
        spacing_mm: [f64; 3],
        origin_mm: [f64; 3],
        direction: [f64; 9],
    ) -> PyResult<Self> {
        let shape = voxels.shape();
        let dims = [shape[2], shape[1], shape[0]];
        // Columns are the voxel axes; the array is row-major.
        let axes = DMat3::from_cols_array(&direction).transpose();
        let [x, y, z] = [0, 1, 2].map(|axis| axes.col(axis) * spacing_mm[axis]);
        let grid = Grid::new(dims, Transform::from_axes(x, y, z, DVec3::from(origin_mm)));
        let grid = grid.map_err(|error| raised(&error))?;
        // In the order of indices, whatever the order in memory.
        let voxels = voxels.as_array().iter().copied().collect();
        let volume = relief_volume::Volume::new(grid, voxels).map_err(|error| raised(&error))?;
        Ok(Self { volume, warnings: Vec::new() })
    }

    /// Voxels along k, j and i.
    #[getter]
    fn shape(&self) -> (usize, usize, usize) {
        let [nx, ny, nz] = self.volume.grid().dims();
        (nz, ny, nx)
    }

    #[getter]
    fn spacing_mm(&self) -> [f64; 3] {
        self.volume.grid().spacing_mm()
    }

    #[getter]
    fn origin_mm(&self) -> [f64; 3] {
        self.volume.grid().origin().xyz.to_array()
    }

    /// Columns are the voxel axes, row-major.
    #[getter]
    fn direction(&self) -> [f64; 9] {
        self.volume.grid().direction()
    }

    #[getter]
    fn range_hu(&self) -> (i16, i16) {
        self.volume.range_hu()
    }

    /// The first digits of the hash of voxels and placement: the id that a server shows.
    #[getter]
    fn id(&self) -> String {
        self.volume.content_hash().short()
    }

    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.warnings.clone()
    }

    /// The unit of the values: HU, or another RescaleType.
    #[getter]
    fn unit(&self) -> &'static str {
        self.volume.quantity().unit()
    }

    /// The voxels in HU, [k, j, i], as a new array.
    fn to_array<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<i16>>> {
        let (nz, ny, nx) = self.shape();
        numpy::PyArray1::from_slice(py, self.volume.voxels_hu()).reshape([nz, ny, nx])
    }

    /// HU at an index.
    fn hu(&self, k: usize, j: usize, i: usize) -> PyResult<i16> {
        let (nz, ny, nx) = self.shape();
        if k >= nz || j >= ny || i >= nx {
            return Err(pyo3::exceptions::PyIndexError::new_err(format!(
                "voxel [{k}, {j}, {i}] is outside of a volume of [{nz}, {ny}, {nx}]"
            )));
        }
        Ok(self.volume.hu([i, j, k]))
    }

    /// Renders a scene: the JSON of a request, and the view that applies if it has no camera.
    fn render_scene(
        &self,
        py: Python<'_>,
        scene: &str,
        view: (f64, f64, f64),
        adapter: &str,
    ) -> PyResult<Frame> {
        let (azimuth_deg, elevation_deg, zoom) = view;
        let orbit = Orbit { azimuth_deg, elevation_deg, zoom, ..Orbit::default() };
        orbit.validate().map_err(|error| raised(&error))?;
        let (frame, display) = py.detach(|| {
            let scene = SceneFile::parse(scene.as_bytes()).map_err(|error| raised(&error))?;
            let scene = scene
                .resolve_for(&Subject::of(&self.volume, None), &orbit)
                .map_err(|error| raised(&error))?;
            scene.expect_no_annotations().map_err(|error| raised(&error))?;
            let frame =
                renderers::render(adapter, &self.volume, &scene.request).map_err(|error| raised(&error))?;
            Ok::<_, PyErr>((frame, scene.display))
        })?;
        Frame::new(py, frame, display)
    }
}

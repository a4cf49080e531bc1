//! Annotations of jobs: a file beside the manifest, named by its hash, so that workers need no log
//! of annotations and a manifest keeps its meaning.
//!
//! The file contains drawn properties only: names, colours and geometry in patient LPS mm. Authors,
//! times, descriptions, cameras and frames of reference stay in the log.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use parking_lot::Mutex;
use serde::{Deserialize, Serialize};

use super::error::SeriesError;
use relief_annotation::{Geometry, Item};
use relief_base::{Point, read_at_most, sha256_of, write_whole};
use relief_session::{Drawables, SurfaceMesh};

/// The annotations that a job draws.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KeptAnnotations {
    /// Its place.
    pub path: PathBuf,
    /// SHA-256 of its bytes.
    pub sha256: String,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    items: Vec<KeptItem>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct KeptItem {
    name: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    rgb: Option<[f64; 3]>,
    geometry: Geometry,
    /// Of a region or mesh.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    shape: Option<KeptShape>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct KeptShape {
    vertices_mm: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
}

/// Annotations, read and ready to be drawn.
#[derive(Debug)]
pub(super) struct PreparedAnnotations {
    /// All of them.
    pub(super) drawables: Drawables,
    /// Regions and meshes by name, in order.
    pub(super) structures: Vec<(String, Arc<SurfaceMesh>)>,
}

/// Why a shape is no surface.
#[derive(Debug, thiserror::Error)]
enum ShapeError {
    #[error("a triangle has corner {index} of {count}")]
    Corner { index: u32, count: usize },
    #[error("a corner is beyond {most_mm} mm")]
    Far { most_mm: f64 },
}

/// Largest file that is read, bytes: a hundred structures of the most triangles.
const LARGEST: u64 = 512 << 20;

impl KeptAnnotations {
    /// Writes the drawn properties of these items into the folder, unless the file exists.
    /// `shape_of` returns the triangles of regions and meshes.
    ///
    /// # Errors
    /// When the folder or the file cannot be written.
    pub(super) fn keep<'a>(
        items: impl IntoIterator<Item = &'a Item>,
        mut shape_of: impl FnMut(&Geometry) -> Option<Arc<SurfaceMesh>>,
        folder: &Path,
    ) -> std::io::Result<Self> {
        let items = items.into_iter().filter_map(|item| {
            let geometry = item.geometry.clone().filter(|_| item.visible)?;
            let shape = shape_of(&geometry).map(|shape| KeptShape::of(&shape));
            Some(KeptItem { name: item.name.clone(), rgb: item.rgb, geometry, shape })
        });
        let bytes = serde_json::to_vec(&File { items: items.collect() })?;
        if bytes.len() as u64 > LARGEST {
            let reason =
                format!("the annotations of a series take {} bytes, allowed: {LARGEST}", bytes.len());
            return Err(std::io::Error::other(reason));
        }
        let sha256 = sha256_of(&bytes);
        let path = folder.join(format!("{sha256}.json"));
        if !path.exists() {
            std::fs::create_dir_all(folder)?;
            write_whole(&path, &bytes)?;
        }
        Ok(Self { path, sha256 })
    }

    /// Reads the file and checks that it is the one that was planned with.
    pub(super) fn read(&self) -> Result<PreparedAnnotations, SeriesError> {
        let wrong = |reason: &str| {
            SeriesError::permanent(format_args!(
                "the annotations {}: {reason}; plan again",
                self.path.display()
            ))
        };
        let refused = |error: std::io::Error| {
            SeriesError::retryable(format_args!("cannot read {}: {error}", self.path.display()))
        };
        let bytes = read_at_most(&self.path, LARGEST).map_err(refused)?;
        let bytes = bytes.ok_or_else(|| wrong("larger than any that are planned, or no file"))?;
        if sha256_of(&bytes) != self.sha256 {
            return Err(wrong("not those that were planned with"));
        }
        let file: File = serde_json::from_slice(&bytes).map_err(|error| wrong(&error.to_string()))?;
        let (mut items, mut shapes) = (Vec::new(), Vec::new());
        for KeptItem { name, rgb, geometry, shape } in file.items {
            let item = Item::new(&name, "batch", Some(geometry));
            let mut item = item.map_err(SeriesError::retryable)?;
            item.rgb = rgb;
            item.validate().map_err(|error| wrong(&error.to_string()))?;
            let shape = shape.map(KeptShape::shape).transpose().map_err(|error| wrong(&error.to_string()))?;
            items.push(item);
            shapes.push(shape.map(Arc::new));
        }
        let structures = items.iter().zip(&shapes);
        let structures =
            structures.filter_map(|(item, shape)| Some((item.name.clone(), shape.clone()?))).collect();
        // Shapes are requested in the order of the items; items without content are skipped.
        let mut in_order =
            items.iter().zip(shapes).filter(|(item, _)| is_structure(item)).map(|(_, shape)| shape);
        let drawables = Drawables::new(&items, |_| in_order.next().flatten());
        Ok(PreparedAnnotations { drawables, structures })
    }
}

fn is_structure(item: &Item) -> bool {
    item.geometry.as_ref().is_some_and(|geometry| geometry.content().is_some())
}

impl KeptShape {
    fn of(shape: &SurfaceMesh) -> Self {
        // Rounded to a thousandth of a millimetre: far below the resolution of a picture, and half
        // the file size.
        let rounded = |mm: f64| (mm * 1e3).round() / 1e3;
        let vertices_mm = shape.vertices.iter().map(|at| at.xyz.to_array().map(rounded)).collect();
        Self { vertices_mm, triangles: shape.triangles.to_vec() }
    }

    fn shape(self) -> Result<SurfaceMesh, ShapeError> {
        let count = self.vertices_mm.len();
        if let Some(index) = self.triangles.as_flattened().iter().find(|index| **index as usize >= count) {
            return Err(ShapeError::Corner { index: *index, count });
        }
        if !self.vertices_mm.as_flattened().iter().all(|mm| mm.abs() <= Item::FARTHEST_MM) {
            return Err(ShapeError::Far { most_mm: Item::FARTHEST_MM });
        }
        let vertices = self.vertices_mm.into_iter().map(|[x, y, z]| Point::new(x, y, z)).collect();
        Ok(SurfaceMesh { vertices, triangles: self.triangles.into() })
    }
}

/// The annotations that were read last: all views of a series have the same.
#[derive(Debug, Default)]
pub(super) struct LastAnnotations(Mutex<HashMap<String, Arc<PreparedAnnotations>>>);

impl LastAnnotations {
    pub(super) fn get(&self, kept: &KeptAnnotations) -> Result<Arc<PreparedAnnotations>, SeriesError> {
        let mut last = self.0.lock();
        if let Some(known) = last.get(&kept.sha256) {
            return Ok(Arc::clone(known));
        }
        let prepared = Arc::new(kept.read()?);
        last.clear();
        last.insert(kept.sha256.clone(), Arc::clone(&prepared));
        Ok(prepared)
    }
}

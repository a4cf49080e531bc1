//! Annotations of other programs' files, as JSON of the items that the HTTP interface has.

use std::path::PathBuf;

use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::error::{ReliefError, raised};
use relief_annotation::Item;
use relief_exchange::{Format, ReadContext, UnknownFormat, WriteContext, read, write};

/// Largest file of annotations, bytes.
const MAX_FILE_BYTES: u64 = 256 << 20;

fn format_of(name: &str) -> PyResult<Format> {
    name.parse().map_err(|error: UnknownFormat| raised(&error))
}

/// The items of a file as a JSON array, and warnings.
#[pyfunction]
#[pyo3(signature = (path, format=None))]
pub(crate) fn read_annotations(
    py: Python<'_>,
    path: PathBuf,
    format: Option<&str>,
) -> PyResult<(String, Vec<String>)> {
    let format = format.map(format_of).transpose()?;
    py.detach(move || {
        let shown = path.display().to_string();
        let failed =
            |error: &dyn std::error::Error| ReliefError::new_err(format!("cannot read {shown}: {error}"));
        if std::fs::metadata(&path).map_err(|error| failed(&error))?.len() > MAX_FILE_BYTES {
            return Err(ReliefError::new_err(format!("{shown} is larger than {MAX_FILE_BYTES} bytes")));
        }
        let bytes = std::fs::read(&path).map_err(|error| failed(&error))?;
        let format = format.or_else(|| Format::of(&path, &bytes)).ok_or_else(|| {
            ReliefError::new_err(format!("the format of {shown} is not recognised; name it by format"))
        })?;
        let list = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
        let context = ReadContext {
            author: "python",
            set: "default",
            list: &list,
            frame_of_reference: None,
            grid: None,
            series: None,
        };
        let found = read(format, &bytes, &context).map_err(|error| raised(&error))?;
        let items = serde_json::to_string(&found.items).map_err(|error| raised(&error))?;
        Ok((items, found.warnings))
    })
}

/// Writes items in a format: the file's bytes, and the values that the format cannot represent.
#[pyfunction]
pub(crate) fn write_annotations<'py>(
    py: Python<'py>,
    items: &str,
    format: &str,
) -> PyResult<(Bound<'py, PyBytes>, Vec<String>)> {
    let format = format_of(format)?;
    let items: Vec<Item> = serde_json::from_str(items).map_err(|error| raised(&error))?;
    let context = WriteContext { contents: &|_| None, grid: None, series: None, phase: None, warnings: &[] };
    let file = write(format, &items, &context).map_err(|error| raised(&error))?;
    let left_out = file.left_out.iter().map(|left| format!("{}: {}", left.what, left.reason)).collect();
    Ok((PyBytes::new(py, &file.bytes), left_out))
}

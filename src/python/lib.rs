//! The native part of the Python package `relief`: volumes, pictures and annotations.
//!
//! What it is: conversions between Python's values and those of the crates, with the interpreter's
//! lock released while something is read or rendered. What it is not: options and their defaults,
//! which are in `relief/__init__.py`; scenes pass as the JSON of requests.
//!
//! Arrays of voxels are [k, j, i], of pictures [row, column]; positions are patient LPS, mm.

mod annotations;
mod error;
mod frame;
mod live;
mod renderers;
mod volume;

use pyo3::prelude::*;
use pyo3::types::PyTuple;

use relief_volume::PRESETS;

#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("ReliefError", module.py().get_type::<error::ReliefError>())?;
    module.add("VERSION", env!("CARGO_PKG_VERSION"))?;
    module.add("PRESETS", PyTuple::new(module.py(), PRESETS.iter().map(|preset| preset.name))?)?;
    module.add_class::<volume::Volume>()?;
    module.add_class::<frame::Frame>()?;
    module.add_class::<live::LiveSession>()?;
    module.add_function(wrap_pyfunction!(volume::open_volume, module)?)?;
    module.add_function(wrap_pyfunction!(volume::phantom, module)?)?;
    module.add_function(wrap_pyfunction!(annotations::read_annotations, module)?)?;
    module.add_function(wrap_pyfunction!(annotations::write_annotations, module)?)
}

//! Errors as the exception `relief.ReliefError`, with the texts of the command line.

use std::error::Error;

use pyo3::PyErr;

pyo3::create_exception!(
    relief,
    ReliefError,
    pyo3::exceptions::PyValueError,
    "An error of Relief: the failure, its place, its cause and the remedy."
);

/// An error and its causes in one line.
pub(crate) fn raised(error: &dyn Error) -> PyErr {
    let mut texts = vec![error.to_string()];
    let mut cause = error.source();
    while let Some(error) = cause {
        texts.push(error.to_string());
        cause = error.source();
    }
    texts.dedup(); // transparent errors repeat the text of their cause
    ReliefError::new_err(texts.join(": "))
}

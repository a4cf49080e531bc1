//! Errors as the exception `relief.ReliefError`, with the texts of the command line.

use std::error::Error;

use pyo3::PyErr;

pyo3::create_exception!(relief, ReliefError, pyo3::exceptions::PyValueError, "What failed, where, why and what to do.");

/// An error and its causes in one line.
pub(crate) fn raised(error: &dyn Error) -> PyErr {
    let causes = std::iter::successors(Some(error), |error| error.source());
    let mut texts: Vec<String> = Vec::new();
    for text in causes.map(ToString::to_string) {
        // Transparent errors repeat the text of their cause.
        if texts.last() != Some(&text) {
            texts.push(text);
        }
    }
    ReliefError::new_err(texts.join(": "))
}

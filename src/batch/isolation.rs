//! Series of buckets are read in a child process without rights (see `relief_isolation`), so that a
//! hostile file ends the child and not the batch.
//!
//! Other systems than Linux have no such process: there [`IsolatedReader`] has no values.

#[cfg(target_os = "linux")]
pub(super) use relief_isolation::{FoundSeries, ListedSeries, Listing, SeriesChoice};
#[cfg(target_os = "linux")]
pub use relief_isolation::{IsolatedReader, IsolationError};

#[cfg(not(target_os = "linux"))]
pub(super) use absent::{FoundSeries, ListedSeries, Listing, SeriesChoice};
#[cfg(not(target_os = "linux"))]
pub use absent::{IsolatedReader, IsolationError};

/// The name of a series' files in errors: their own names may be those of patients.
pub(super) const SUBJECT: &str = "its files";

/// The choice of a DICOM series by its UID, or of a file of voxels.
pub(super) fn choice(uid: Option<&str>) -> SeriesChoice {
    SeriesChoice {
        uid: uid.map(str::to_owned),
        takes_volume_files: true,
        hashes_content: true,
        ..SeriesChoice::only(SUBJECT)
    }
}

#[cfg(not(target_os = "linux"))]
mod absent {
    use std::path::Path;

    use relief_base::Budget;
    use relief_session::{LoadedVolume, PlacedLabels};
    use relief_volume::Grid;

    /// A reader in child processes, which this system does not have.
    #[derive(Clone, Debug)]
    pub enum IsolatedReader {}

    /// Why a child did not read a file.
    #[derive(Debug, thiserror::Error)]
    #[error("series cannot be read in child processes on this system")]
    pub enum IsolationError {
        /// The caller does not want the series.
        Unwanted(Box<dyn std::error::Error + Send + Sync>),
        /// The child cannot be started.
        Start(std::io::Error),
        /// The machine has too little memory.
        NoMemory,
        /// The caller left.
        Cancelled(relief_base::BudgetError),
    }

    #[derive(Clone, Debug)]
    pub(crate) struct ListedSeries {
        pub(crate) uid: String,
        pub(crate) modality: String,
        pub(crate) dims: [usize; 3],
        pub(crate) pixel_mm: [f64; 2],
        pub(crate) thickness_mm: Option<f64>,
        pub(crate) frame_of_reference: Option<String>,
        pub(crate) sha256: Option<String>,
    }

    pub(crate) struct FoundSeries {
        pub(crate) dims: [usize; 3],
        pub(crate) sha256: Option<String>,
    }

    pub(crate) enum Listing {
        VolumeFile(Grid),
        Series(Vec<ListedSeries>),
    }

    pub(crate) struct SeriesChoice {
        pub(crate) uid: Option<String>,
        pub(crate) takes_volume_files: bool,
        pub(crate) hashes_content: bool,
    }

    impl SeriesChoice {
        pub(crate) fn only(_: &str) -> Self {
            Self { uid: None, takes_volume_files: false, hashes_content: false }
        }
    }

    impl IsolatedReader {
        pub(crate) fn list(&self, _: &Path, _: bool, _: &Budget) -> Result<Listing, IsolationError> {
            match *self {}
        }

        pub(crate) fn series(
            &self,
            _: &Path,
            _: SeriesChoice,
            _: u64,
            _: &Budget,
            _: impl FnOnce(&FoundSeries) -> Result<(), Box<dyn std::error::Error + Send + Sync>>,
        ) -> Result<(LoadedVolume, Vec<String>), IsolationError> {
            match *self {}
        }

        pub(crate) fn labels(&self, _: &Path, _: &Grid) -> Result<PlacedLabels, IsolationError> {
            match *self {}
        }
    }
}

//! Identity of a series by the bytes of its files: equal files under other names are the same
//! series.

use std::collections::BTreeMap;
use std::io::Read;

use rayon::prelude::*;
use sha2::{Digest, Sha256};

use super::error::{Defect, Error, Reasons};
use super::series::SeriesEntry;
use super::source::FileSource;
use relief_base::Budget;

impl SeriesEntry {
    /// SHA-256 of the SHA-256 of all its files, in rising order of these. Reads every byte.
    ///
    /// # Errors
    /// When a file cannot be read.
    pub fn content_sha256(&self) -> Result<[u8; 32], Error> {
        let files: BTreeMap<String, &FileSource> =
            self.frames.iter().map(|frame| (frame.file.source.to_string(), &frame.file.source)).collect();
        let digests: Result<Vec<[u8; 32]>, (String, Defect)> = files
            .into_par_iter()
            .map(|(name, file)| digest(file, &self.budget).map_err(|defect| (name, defect)))
            .collect();
        let mut digests = digests.map_err(|(name, defect)| Error::NothingDecoded {
            slices: self.frames.len(),
            reasons: Reasons::about([(name, defect.to_string())]),
        })?;
        digests.sort_unstable();
        let of_all = digests.iter().fold(Sha256::new(), Digest::chain_update);
        Ok(of_all.finalize().into())
    }
}

fn digest(file: &FileSource, budget: &Budget) -> Result<[u8; 32], Defect> {
    let (mut reader, _) = file.bytes(budget)?.open()?;
    let mut hasher = Sha256::new();
    let mut part = vec![0; 1 << 16];
    loop {
        match reader.read(&mut part)? {
            0 => return Ok(hasher.finalize().into()),
            read => hasher.update(&part[..read]),
        }
    }
}

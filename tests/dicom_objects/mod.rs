//! DICOM objects of annotations: reports and segmentations that Relief writes, read by others and
//! checked by validators; those of others and RT structure sets, read by Relief; and damage to all
//! of them.

#![expect(clippy::unwrap_used, reason = "tests fail and speak aloud")]

use crate::common;
mod damage;
mod foreign;
pub(crate) mod made;
mod overlaps;
mod peers;
mod reports;
mod segmentations;
mod structure_sets;
mod tools;

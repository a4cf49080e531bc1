//! Series and label maps as files: DICOM with all its codecs, zip, NIfTI, NRRD.

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use relief_base::Budget;
use relief_dicom::{
    COMMITMENT_TRANSFER_SYNTAXES, CommitmentRequest, CommitmentResult, FormatLimits, LoadLimits, Strictness,
    read_commitment_request, write_commitment_result,
};
use relief_session::load_labels;
use relief_volume::Grid;

/// Voxels that a file may have here: few, so that an execution is short.
const MOST_VOXELS: u64 = 1 << 20;

/// A request for storage commitment: one that is read comes back from the answer that commits to all of it.
pub(crate) fn commitment(bytes: &[u8]) {
    for syntax in COMMITMENT_TRANSFER_SYNTAXES {
        let Ok(request) = read_commitment_request(syntax, bytes) else { continue };
        let CommitmentRequest { transaction, objects } = request.clone();
        let answer = CommitmentResult { transaction, committed: objects, missing: Vec::new() };
        let answer = write_commitment_result(syntax, &answer).expect("a known transfer syntax");
        assert!(read_commitment_request(syntax, &answer).is_ok_and(|again| again == request));
    }
}

/// A file with these bytes, in memory or below RELIEF_FUZZ_FOLDER; one for each process.
fn file(name: &str, bytes: &[u8]) -> PathBuf {
    static FOLDER: LazyLock<PathBuf> = LazyLock::new(|| {
        let above = std::env::var_os("RELIEF_FUZZ_FOLDER").unwrap_or_else(|| "/dev/shm".into());
        let folder = PathBuf::from(above).join(format!("relief-fuzz-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a folder for files");
        folder
    });
    let path = FOLDER.join(name);
    std::fs::write(&path, bytes).expect("a file");
    path
}

fn series(path: &Path) {
    let budget = Budget::new(64 << 20, 256 << 20);
    let Ok(found) = relief_dicom::discover_within(&budget, path, Strictness::Lenient, &|_| ()) else {
        return;
    };
    for entry in &found.series {
        let limits = LoadLimits { voxel_bytes: 2 * MOST_VOXELS };
        let Ok(loaded) = relief_dicom::load_within(limits, entry, Strictness::Lenient, &|_| ()) else {
            continue;
        };
        let volume = loaded.volume;
        assert_eq!(volume.voxels_hu().len(), volume.grid().voxel_count());
        assert!(volume.grid().spacing_mm().iter().all(|mm| mm.is_finite() && *mm > 0.0));
    }
}

pub(crate) fn dicom(bytes: &[u8]) {
    series(&file("a.dcm", bytes));
}

pub(crate) fn zip(bytes: &[u8]) {
    series(&file("a.zip", bytes));
}

fn volume(path: &Path) {
    if let Ok(read) = relief_dicom::read_volume_within(FormatLimits { voxels: MOST_VOXELS }, path) {
        assert_eq!(read.volume.voxels_hu().len(), read.volume.grid().voxel_count());
    }
}

pub(crate) fn nifti(bytes: &[u8]) {
    volume(&file("a.nii.gz", bytes));
}

pub(crate) fn nrrd(bytes: &[u8]) {
    volume(&file("a.nrrd", bytes));
}

pub(crate) fn labels(bytes: &[u8]) {
    let grid = Grid::axis_aligned([8, 8, 8], [10.0; 3], [-40.0; 3]).expect("a grid");
    if let Ok(placed) = load_labels(&file("a.seg", bytes), MOST_VOXELS, &grid) {
        assert_eq!(placed.map.grid(), &grid);
    }
}

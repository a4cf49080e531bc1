//! Files that a failing case writes: pictures, magnified differences, numbers, and one page of all
//! of them.
//!
//! | file | shows |
//! |---|---|
//! | `expected.png`, `actual.png` | the golden and the present picture |
//! | `difference.png` | black where equal, else each channel's difference, magnified |
//! | `depth-expected.png`, `depth-actual.png` | nearest brightest, misses blue |
//! | `depth-difference.png` | red farther, blue nearer than expected; green hit in one only; white no depth |
//! | `frame-*.png` | as the first three, of the display's frame |
//! | `numbers.json` | adapter, driver, counts, largest differences, the command that would bless |

use std::fs;
use std::path::{Path, PathBuf};

use super::case_id::CaseId;
use super::compare::is_depth;
use super::error::GoldenError;
use super::raster::{Raster, Samples, rgb_png};
use crate::raster::Aspect;
use crate::report::CaseReport;
use crate::report::Pair;
use relief_render::AdapterDescription;

/// Brightness of the smallest difference, and of each step beyond.
const FAINTEST: f64 = 80.0;
const PER_COLOR_STEP: f64 = 12.0;
const PER_DEPTH_MM: f64 = 60.0;

/// The folder for pictures of failing cases, and the command that blesses them.
#[derive(Clone, Debug)]
pub struct Artefacts {
    dir: PathBuf,
    bless: String,
}

/// `numbers.json`.
#[derive(serde::Serialize)]
struct Numbers<'a> {
    adapter: &'a AdapterDescription,
    #[serde(flatten)]
    report: &'a CaseReport,
}

impl Artefacts {
    /// Artefacts under `dir` (usually `target/golden`); `bless` is the command that blesses the
    /// case named after it.
    #[must_use]
    pub fn new(dir: PathBuf, bless: String) -> Self {
        Self { dir, bless }
    }

    /// The page that shows all failures of the last check.
    #[must_use]
    pub fn index(&self) -> PathBuf {
        self.dir.join("index.html")
    }

    /// The folder of a case.
    #[must_use]
    pub fn folder(&self, id: &CaseId) -> PathBuf {
        self.dir.join(id.suite()).join(id.name())
    }

    pub(super) fn bless_command(&self, id: &CaseId) -> String {
        format!("{} {id}", self.bless)
    }

    /// Removes the files of an earlier failure of this case.
    pub(super) fn remove(&self, id: &CaseId) -> Result<(), GoldenError> {
        let folder = self.folder(id);
        match fs::remove_dir_all(&folder) {
            Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
                Err(GoldenError::Write { path: folder, source })
            }
            _ => {
                // Fails, as it should, while other cases of the suite have something there.
                let _ = fs::remove_dir(self.dir.join(id.suite()));
                Ok(())
            }
        }
    }

    /// Writes the pictures and numbers of a failing case.
    pub(super) fn keep(
        &self,
        report: &CaseReport,
        adapter: &AdapterDescription,
        pairs: &[Pair],
    ) -> Result<(), GoldenError> {
        self.remove(&report.case)?; // pictures of an earlier failure would mislead
        let folder = self.folder(&report.case);
        for Pair { aspect, expected, actual } in pairs {
            if let Some(expected) = expected {
                write(&folder.join(picture_name(*aspect, "expected")), &visible(expected)?)?;
                if let Some(difference) = magnified_difference(expected, actual) {
                    let png = rgb_png(actual.size_px, &difference)?;
                    write(&folder.join(picture_name(*aspect, "difference")), &png)?;
                }
            }
            write(&folder.join(picture_name(*aspect, "actual")), &visible(actual)?)?;
        }
        let numbers = serde_json::to_vec_pretty(&Numbers { adapter, report });
        write(&folder.join("numbers.json"), &numbers.expect("numbers and texts are JSON"))
    }

    /// Writes the page of a whole check.
    pub(super) fn write_index(&self, page: &str) -> Result<(), GoldenError> {
        write(&self.index(), page.as_bytes())
    }
}

/// The file that shows the expected picture, the actual one or their difference.
pub(super) fn picture_name(aspect: Aspect, role: &str) -> String {
    match aspect {
        Aspect::Color => format!("{role}.png"),
        Aspect::Depth | Aspect::Frame => format!("{}-{role}.png", aspect.name()),
    }
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), GoldenError> {
    let folder = path.parent().unwrap_or(Path::new("."));
    let written = fs::create_dir_all(folder).and_then(|()| fs::write(path, bytes));
    written.map_err(|source| GoldenError::Write { path: path.to_owned(), source })
}

/// A PNG to look at.
fn visible(raster: &Raster) -> Result<Vec<u8>, GoldenError> {
    match &raster.samples {
        Samples::Color(pixels) => rgb_png(raster.size_px, pixels),
        Samples::DepthMm(depths) => rgb_png(raster.size_px, &depth_in_grey(depths)),
    }
}

/// The nearest depth is white and the farthest dark grey; misses are blue and invalid depths red.
fn depth_in_grey(depths: &[f32]) -> Vec<[u8; 4]> {
    let hits = || depths.iter().copied().filter(|mm| mm.is_finite());
    let (near, far) = (hits().fold(f32::INFINITY, f32::min), hits().fold(0.0, f32::max));
    let grey = |mm: f32| (255.0 - 215.0 * (mm - near) / (far - near).max(f32::MIN_POSITIVE)) as u8;
    let pixel = |&mm: &f32| match (is_depth(mm), mm.is_finite()) {
        (false, _) => [255, 0, 0, 255],
        (true, false) => [12, 20, 60, 255],
        (true, true) => [grey(mm), grey(mm), grey(mm), 255],
    };
    depths.iter().map(pixel).collect()
}

/// A picture of the differences of two pictures; `None` when they are of different size.
fn magnified_difference(expected: &Raster, actual: &Raster) -> Option<Vec<[u8; 4]>> {
    if expected.size_px != actual.size_px {
        return None;
    }
    match (&expected.samples, &actual.samples) {
        (Samples::Color(a), Samples::Color(b)) => {
            Some(a.iter().zip(b).map(|(a, b)| color_apart(a, b)).collect())
        }
        (Samples::DepthMm(a), Samples::DepthMm(b)) => {
            Some(a.iter().zip(b).map(|(&a, &b)| depth_apart(a, b)).collect())
        }
        _ => None,
    }
}

/// Each channel's difference; a difference of coverage shows in all three.
fn color_apart(a: &[u8; 4], b: &[u8; 4]) -> [u8; 4] {
    let steps: [u8; 4] = std::array::from_fn(|channel| a[channel].abs_diff(b[channel]));
    let [r, g, b, coverage] = steps.map(|steps| brightness(f64::from(steps), PER_COLOR_STEP));
    [r.max(coverage), g.max(coverage), b.max(coverage), 255]
}

fn depth_apart(expected: f32, actual: f32) -> [u8; 4] {
    if !is_depth(expected) || !is_depth(actual) {
        return [255; 4];
    }
    if expected.is_finite() != actual.is_finite() {
        return [0, 255, 0, 255];
    }
    if !expected.is_finite() {
        return [0, 0, 0, 255];
    }
    let farther_mm = f64::from(actual) - f64::from(expected);
    let shade = brightness(farther_mm.abs(), PER_DEPTH_MM);
    if farther_mm > 0.0 { [shade, 0, 0, 255] } else { [shade / 3, shade / 2, shade, 255] }
}

/// 0 for no difference, else bright enough to be seen.
fn brightness(difference: f64, per_unit: f64) -> u8 {
    if difference == 0.0 { 0 } else { (FAINTEST + per_unit * difference).clamp(0.0, 255.0) as u8 }
}

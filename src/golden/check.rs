//! Rendering cases, comparing them with their goldens, and making goldens of them.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::path::PathBuf;

use image::ColorType;

use super::artefacts::Artefacts;
use super::case::Case;
use super::case_id::CaseId;
use super::collection::Collection;
use super::compare::{Comparison, compare, is_depth};
use super::error::GoldenError;
use super::html;
use super::raster::{Raster, Samples, check_size, decode_png, rgb_png, rgba_png};
use crate::raster::Aspect;
use crate::report::CaseReport;
use crate::report::CheckReport;
use crate::report::Pair;
use crate::report::Verdict;
use crate::source::Source;
use relief_display::DisplaySettings;
use relief_render::{AdapterDescription, AdapterKind, RenderedFrame, Renderer};
use relief_session::{FileFormat, Product, encode};
use relief_volume::Volume;

/// Renders cases. Keeps the volumes that it has made or loaded: many cases show the same.
pub struct Harness {
    renderer: Renderer,
    volumes: HashMap<Source, Volume>,
}

/// A golden to be written.
#[derive(Clone, Debug)]
pub struct Blessing {
    /// Its destination.
    pub path: PathBuf,
    /// How it differs from the existing golden.
    pub change: Change,
    /// The file.
    pub bytes: Vec<u8>,
}

/// How a new golden differs from the existing one.
#[derive(Clone, Debug)]
pub enum Change {
    /// No golden exists.
    New,
    /// The picture is the same: nothing needs to be written.
    Unchanged,
    /// It differs by this.
    Replaced(Comparison),
    /// The existing golden cannot be read.
    Damaged,
}

/// A case's picture as rendered and as it is to be shown.
struct RenderedCase {
    frame: RenderedFrame,
    display: DisplaySettings,
}

impl Harness {
    /// A harness that renders with this renderer.
    #[must_use]
    pub fn new(renderer: Renderer) -> Self {
        Self { renderer, volumes: HashMap::new() }
    }

    /// The adapter in use.
    #[must_use]
    pub fn adapter(&self) -> &AdapterDescription {
        self.renderer.adapter()
    }

    /// Compares every case of a collection with its goldens. What fails leaves its pictures with
    /// `artefacts`; what passes has them removed.
    ///
    /// # Errors
    /// When the artefacts cannot be written. A case that cannot be read or rendered is a finding,
    /// not an error.
    pub fn check(
        &mut self,
        collection: &Collection,
        artefacts: &Artefacts,
    ) -> Result<CheckReport, GoldenError> {
        let mut cases = Vec::with_capacity(collection.ids().len());
        for id in collection.ids() {
            let (report, pairs) = self.check_case(collection, id, artefacts);
            match report.verdict {
                Verdict::Failed => artefacts.keep(&report, self.adapter(), &pairs)?,
                Verdict::Identical | Verdict::Within => artefacts.remove(id)?,
            }
            cases.push(report);
        }
        let report = CheckReport { adapter: self.adapter().clone(), cases };
        artefacts.write_index(&html::page(&report, artefacts))?;
        Ok(report)
    }

    fn check_case(
        &mut self,
        collection: &Collection,
        id: &CaseId,
        artefacts: &Artefacts,
    ) -> (CaseReport, Vec<Pair>) {
        let mut report = CaseReport::failed(id, artefacts.bless_command(id));
        let mut pairs = Vec::new();
        let outcome = collection.read(id).and_then(|case| {
            report.purpose = case.purpose().to_owned();
            report.tolerance = Some(case.tolerance());
            let rendered = self.render(&case)?;
            for &aspect in case.aspects() {
                let actual = rendered.raster(aspect)?;
                pairs.push(report.add(&case, aspect, actual));
            }
            Ok(())
        });
        match outcome {
            Err(error) => report.problems.push(error.to_string()),
            Ok(()) if report.problems.is_empty() => report.verdict = report.success(),
            Ok(()) => {}
        }
        (report, pairs)
    }

    /// The goldens that a case would have if it were blessed now. Writes nothing.
    ///
    /// # Errors
    /// When the adapter is no software one, the case cannot be rendered, the picture shows nothing
    /// or has impossible depths, or a file would be too large.
    pub fn bless(&mut self, case: &Case) -> Result<Vec<Blessing>, GoldenError> {
        if self.adapter().kind > AdapterKind::Software {
            return Err(GoldenError::Adapter { adapter: self.adapter().to_string() });
        }
        let rendered = self.render(case)?;
        rendered.refuse_worthless(case.id())?;
        case.aspects().iter().map(|&aspect| rendered.blessing(case, aspect)).collect()
    }

    fn render(&mut self, case: &Case) -> Result<RenderedCase, GoldenError> {
        let volume = match self.volumes.entry(case.source().clone()) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(place) => place.insert(case.source().volume()?),
        };
        let scene = case.scene(volume)?;
        let frame = self.renderer.render(volume, &scene.request)?;
        Ok(RenderedCase { frame, display: scene.display })
    }
}

impl RenderedCase {
    fn raster(&self, aspect: Aspect) -> Result<Raster, GoldenError> {
        let samples = match aspect {
            Aspect::Color => Samples::Color(self.frame.color_rgba.clone()),
            Aspect::Depth => Samples::DepthMm(self.frame.depth_mm.clone()),
            Aspect::Frame => return self.displayed(),
        };
        Ok(Raster { size_px: self.frame.size_px, samples })
    }

    /// The frame as a display takes it, through the file that a display is sent.
    fn displayed(&self) -> Result<Raster, GoldenError> {
        let png = encode(&self.frame, &self.display, Product::Frame, FileFormat::Png)?;
        let layout = self.display.layout;
        decode_png(&png, ColorType::Rgb8).map_err(|source| GoldenError::Layout { layout, source })
    }

    fn blessing(&self, case: &Case, aspect: Aspect) -> Result<Blessing, GoldenError> {
        let raster = self.raster(aspect)?;
        let change = match case.expected(aspect) {
            Err(_) => Change::Damaged,
            Ok(None) => Change::New,
            Ok(Some(expected)) => {
                let comparison = compare(&expected, &raster, &case.tolerance());
                if comparison.is_identical() { Change::Unchanged } else { Change::Replaced(comparison) }
            }
        };
        let path = case.folder().join(aspect.file_name());
        let bytes = self.file(aspect, &raster)?;
        check_size(&path, &bytes)?;
        Ok(Blessing { path, change, bytes })
    }

    fn file(&self, aspect: Aspect, raster: &Raster) -> Result<Vec<u8>, GoldenError> {
        match (&raster.samples, aspect) {
            (Samples::Color(pixels), Aspect::Frame) => rgb_png(raster.size_px, pixels),
            (Samples::Color(pixels), _) => rgba_png(raster.size_px, pixels),
            (Samples::DepthMm(_), _) => {
                Ok(encode(&self.frame, &self.display, Product::Depth, FileFormat::Exr)?)
            }
        }
    }

    /// A picture that shows nothing passes every later check of nothing.
    fn refuse_worthless(&self, id: &CaseId) -> Result<(), GoldenError> {
        let refuse = |defect| Err(GoldenError::Worthless { case: id.to_string(), defect });
        if !self.frame.depth_mm.iter().all(|&mm| is_depth(mm)) {
            return refuse("has depths that are NaN, -inf or behind the eye");
        }
        if !self.frame.depth_mm.iter().any(|mm| mm.is_finite()) {
            return refuse("shows nothing: no ray hits");
        }
        Ok(())
    }
}

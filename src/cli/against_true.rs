//! `--against-true` of `relief preview` and `relief inspect`: compares the views of a frame with
//! rendered ones.

use std::borrow::Borrow;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

use crate::frame_file::read_bounded;
use crate::output::write_whole;
use relief_display::{Frame, Layout, Pixels, Views, decode_wiggle, encode_png, psnr_db, read_png};

/// The smallest difference that is white in a map: root mean square over views and channels, of 255.
const WHITE: f64 = 64.0;

/// The options of the comparison.
#[derive(Debug, Default, clap::Args)]
pub(crate) struct AgainstTrue {
    /// Compare the views with rendered ones and print the signal-to-noise ratio of each. TRUE.png is the
    /// output of relief render --views true, with the same layout and --view-span
    #[arg(long, value_name = "TRUE.png")]
    against_true: Option<PathBuf>,
    /// Write a picture of the differences. Equal pixels are black; a difference of 64 of 255 or more
    /// is white
    #[arg(long, value_name = "FILE.png", requires = "against_true", value_parser = super::preview::parse_png)]
    map: Option<PathBuf>,
}

/// The result of a comparison.
pub(crate) struct Likeness {
    /// PSNR of each view, dB; infinite where it is equal.
    psnr_db: Vec<f64>,
    /// Red, green, blue of each pixel of the map.
    map: Vec<u8>,
    size_px: [u32; 2],
}

impl AgainstTrue {
    /// Fails where the options are given, with the reason why they do not apply.
    pub(crate) fn refuse(&self, reason: &str) -> anyhow::Result<()> {
        if self.against_true.is_some() {
            bail!("--against-true {reason}");
        }
        Ok(())
    }

    /// Compares the views, where true ones are given, and writes the map.
    pub(crate) fn compare(&self, views: &Views) -> anyhow::Result<Option<Likeness>> {
        self.compare_made(|_| Ok(views))
    }

    /// As [`AgainstTrue::compare`], with views that `make` makes in the layout of the true ones.
    pub(crate) fn compare_made<V: Borrow<Views>>(
        &self,
        make: impl FnOnce(Layout) -> anyhow::Result<V>,
    ) -> anyhow::Result<Option<Likeness>> {
        let Some(path) = &self.against_true else { return Ok(None) };
        let cannot = || format!("cannot compare with {}", path.display());
        let (layout, truth) = true_views(path).with_context(cannot)?;
        let likeness = Likeness::of(&truth, make(layout)?.borrow()).with_context(cannot)?;
        if let Some(map) = &self.map {
            let frame = Frame::new(likeness.size_px, Pixels::Rgb8(likeness.map.clone()))?;
            write_whole(map, &encode_png(&frame)?)?;
        }
        Ok(Some(likeness))
    }
}

fn true_views(path: &Path) -> anyhow::Result<(Layout, Views)> {
    let file = read_bounded(path)?;
    let (frame, report) = read_png(&file)?;
    if report.layout == Layout::Wiggle {
        return Ok((report.layout, decode_wiggle(&file)?));
    }
    let decoded = report.layout.decode(&frame).ok().and_then(|decoded| decoded.views);
    let views = decoded.with_context(|| {
        format!("it has no views (layout {}): relief render --views true makes them", report.layout)
    })?;
    Ok((report.layout, views))
}

impl Likeness {
    fn of(truth: &Views, made: &Views) -> anyhow::Result<Self> {
        let [found, expected] = [truth, made].map(|views| (views.pictures().len(), views.size_px()));
        if found != expected {
            let [(count, [width, height]), (expected, [expected_width, expected_height])] = [found, expected];
            bail!(
                "it has {count} views of {width}x{height}, the frame's are {expected} of {expected_width}x{expected_height}"
            );
        }
        let pairs = || truth.pictures().iter().zip(made.pictures());
        let mut squared = vec![0.0; truth.pictures().first().map_or(0, Vec::len)];
        for (truth, made) in pairs() {
            for ((sum, truth), made) in squared.iter_mut().zip(truth).zip(made) {
                let differences = truth.iter().zip(made).map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2));
                *sum += differences.sum::<f64>();
            }
        }
        let values = 3.0 * truth.pictures().len() as f64;
        let gray = |sum: &f64| ((sum / values).sqrt() * 255.0 / WHITE).round().min(255.0) as u8;
        Ok(Self {
            psnr_db: pairs().map(|(truth, made)| psnr_db(truth, made)).collect(),
            map: squared.iter().flat_map(|sum| [gray(sum); 3]).collect(),
            size_px: truth.size_px(),
        })
    }

    /// The mean over the views that differ; `None` where all are equal.
    fn mean_db(&self) -> Option<f64> {
        let finite: Vec<f64> = self.psnr_db.iter().copied().filter(|db| db.is_finite()).collect();
        (!finite.is_empty()).then(|| finite.iter().sum::<f64>() / finite.len() as f64)
    }

    /// For the report as JSON, which has no infinity: a view that is equal has none.
    pub(crate) fn report(&self) -> serde_json::Value {
        let finite: Vec<Option<f64>> = self.psnr_db.iter().map(|db| db.is_finite().then_some(*db)).collect();
        serde_json::json!({ "psnr_db": finite, "psnr_mean_db": self.mean_db() })
    }

    /// The same in words.
    pub(crate) fn words(&self) -> String {
        let each: Vec<String> = self.psnr_db.iter().map(|db| format!("{db:.1}")).collect();
        match self.mean_db() {
            Some(mean) => {
                format!("{mean:.2} dB, mean of the views that differ from true ones: {}", each.join(" "))
            }
            None => "equal to the true views".to_owned(),
        }
    }
}

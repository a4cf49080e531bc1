//! The report of a batch: one self-contained HTML page, a contact sheet of each series, and its
//! turntable.

use std::collections::BTreeMap;

use data_encoding::BASE64;
use image::RgbImage;
use maud::{DOCTYPE, Markup, PreEscaped, html};
use rayon::prelude::*;

use super::dataset;
use super::error::{Failure, FailureKind};
use super::manifest::Job;
use super::product::Product;
use super::record::Record;
use super::sink::Sink;
use super::turntable::{FilmWriter, turntable_capture};
use super::views::FILMS;
use crate::picture::open;
use relief_display::{encode_png, shrunk_rgb};
use relief_session::{Thumbnail, contact_sheet};

/// Width of a thumbnail; the height follows.
const THUMBNAIL_PX: u32 = 240;
/// Columns of a contact sheet.
const SHEET_COLUMNS: usize = 4;
/// Longest text of a warning or a reason in the page, characters.
const LONGEST: usize = 400;

/// A job that is done.
struct ReportedJob {
    record: Record,
    /// Its picture in the page.
    jpeg: Option<Vec<u8>>,
}

/// Name of the page.
pub const REPORT: &str = "report.html";

/// Writes `report.html`, for each series with colours `contact-sheet.png` and, where it has one,
/// its turntable as films and as a DICOM object, and the tables of datasets: beside the outputs, in a
/// folder or a bucket.
///
/// # Errors
/// When records cannot be read, or a file cannot be written.
pub fn write_report(
    jobs: &[Job],
    failures: &[Failure],
    out: &Sink,
    films: &FilmWriter,
) -> std::io::Result<()> {
    let read = |job| Ok(Record::read(job, out)?.map(|record| (job, record)));
    let done: std::io::Result<Vec<Option<(&Job, Record)>>> = jobs.par_iter().map(read).collect();
    let mut series: BTreeMap<&str, Vec<(&Job, Record)>> = BTreeMap::new();
    for (job, record) in done?.into_iter().flatten() {
        series.entry(&job.series.name).or_default().push((job, record));
    }
    let series =
        series.into_par_iter().map(|(name, done)| Ok((name, report_series(name, done, out, films)?)));
    let series: BTreeMap<&str, Vec<ReportedJob>> = series.collect::<std::io::Result<_>>()?;
    let records = series.values().flatten().map(|one| &one.record);
    dataset::write_tables(records, out)?;
    out.put(REPORT, page(jobs.len(), &series, failures))
}

/// Writes the contact sheet and the turntable of a series. Of its pictures, JPEGs alone stay in
/// memory.
fn report_series(
    name: &str,
    done: Vec<(&Job, Record)>,
    out: &Sink,
    films: &FilmWriter,
) -> std::io::Result<Vec<ReportedJob>> {
    let small: Vec<Option<RgbImage>> = done.par_iter().map(|(job, _)| small_picture(job, out)).collect();
    let records = done.into_iter().map(|(_, record)| record);
    let jpegs = small.iter().map(|small| small.as_ref().and_then(jpeg));
    let shown: Vec<_> = records.zip(jpegs).map(|(record, jpeg)| ReportedJob { record, jpeg }).collect();
    if let Some(sheet) = sheet(&shown, &small) {
        out.put(&format!("{name}/contact-sheet.png"), sheet)?;
    }
    for group in FILMS {
        let film = format!("{name}/{group}");
        for product in [Product::Capture, Product::AnnotatedCapture] {
            match turntable_capture(out, &turns(name, &shown, group, product)) {
                Ok(Some(object)) => out.put(&format!("{film}.{}", product.ending()), object)?,
                Ok(None) => {}
                Err(error) => tracing::warn!("{film} is no DICOM object: {error}"),
            }
        }
        films.write_frames(out, &film, &turns(name, &shown, group, Product::Frame))?;
        films.write(out, &film, &turns(name, &shown, group, Product::Color))?;
    }
    Ok(shown)
}

/// The colours or the frames of a group, in the order of their names: jobs of phases are in another.
fn turns(series: &str, shown: &[ReportedJob], group: &str, product: Product) -> Vec<String> {
    let turns = shown.iter().filter(|one| one.record.group == group);
    let files = turns.filter_map(|one| one.record.output(product));
    let mut files: Vec<String> = files.map(|file| format!("{series}/{file}")).collect();
    files.sort();
    files
}

/// The colour of a job, made small, with annotations where it has them; of a frame its left half.
fn small_picture(job: &Job, out: &Sink) -> Option<RgbImage> {
    let known = [Product::Annotated, Product::Color, Product::AnnotatedFrame, Product::Frame];
    let product = known.into_iter().find(|wanted| job.products.contains(wanted))?;
    let mut picture = open(out, &format!("{}.{}", job.name(), product.ending()))?;
    if product.is_frame() {
        picture = picture.crop_imm(0, 0, picture.width() / 2, picture.height());
    }
    let (width, height) = (picture.width(), picture.height());
    if width == 0 || height == 0 {
        return None;
    }
    // Side-by-side frames with black lines between have half the rows twice as far apart.
    let wanted = u64::from(THUMBNAIL_PX) * u64::from(height) / u64::from(width);
    let small_height = u32::try_from(wanted).unwrap_or(1).clamp(1, 4 * THUMBNAIL_PX);
    let [from, to] =
        [[width, height], [THUMBNAIL_PX, small_height]].map(|size| size.map(|side| side as usize));
    RgbImage::from_raw(THUMBNAIL_PX, small_height, shrunk_rgb(from, &picture.into_rgb8(), to))
}

/// All views of a series in one picture; those of another shape than the first are left out.
fn sheet(shown: &[ReportedJob], small: &[Option<RgbImage>]) -> Option<Vec<u8>> {
    let (width, height) = small.iter().flatten().next().map(RgbImage::dimensions)?;
    let pixels = |small: &Option<RgbImage>| -> Option<Vec<[u8; 4]>> {
        let small = small.as_ref().filter(|small| small.dimensions() == (width, height))?;
        Some(rgba(small))
    };
    let pictures =
        shown.iter().zip(small).filter_map(|(one, small)| Some((&one.record.view, pixels(small)?)));
    let pictures: Vec<_> = pictures.collect();
    let thumbnails: Vec<Thumbnail<'_>> = pictures
        .iter()
        .map(|(name, color_rgba)| Thumbnail { name, size_px: [width, height], color_rgba })
        .collect();
    encode_png(&contact_sheet(&thumbnails, SHEET_COLUMNS).ok()?).ok()
}

const STYLE: &str = "\
:root{color-scheme:light dark;--ground:#f6f7f9;--card:#fff;--text:#17202a;--quiet:#5c6873;--line:#dde2e7;--bad:#b3261e}
@media(prefers-color-scheme:dark){:root{--ground:#12161b;--card:#1b2128;--text:#e8edf2;--quiet:#97a3ae;--line:#2c343d;--bad:#ff8a80}}
body{margin:0;padding:2rem;background:var(--ground);color:var(--text);font:15px/1.5 system-ui,sans-serif}
h1{font-size:1.5rem;margin:0 0 .25rem}h2{font-size:1.05rem;margin:2rem 0 .5rem;font-family:ui-monospace,monospace}
p{margin:.25rem 0}.quiet{color:var(--quiet)}.bad{color:var(--bad)}
.views{display:grid;grid-template-columns:repeat(auto-fill,minmax(200px,1fr));gap:12px}
figure{margin:0;background:var(--card);border:1px solid var(--line);border-radius:8px;overflow:hidden}
img{display:block;width:100%;background:#000}figcaption{padding:.4rem .6rem;font-size:.85rem}
table{border-collapse:collapse;background:var(--card)}td,th{border:1px solid var(--line);padding:.3rem .6rem;text-align:left}";

fn page(jobs: usize, series: &BTreeMap<&str, Vec<ReportedJob>>, failures: &[Failure]) -> String {
    let done: usize = series.values().map(Vec::len).sum();
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width";
                title { "Relief batch" }
                style { (PreEscaped(STYLE)) }
            }
            body {
                h1 { (done) " of " (jobs) " views of " (series.len()) " series" }
                p.quiet { (timings(series)) }
                @if !failures.is_empty() { (failure_table(failures)) }
                @for (name, views) in series {
                    h2 { (name) }
                    @for warning in views.first().map(|one| one.record.warnings.as_slice()).unwrap_or_default() {
                        p.quiet { "Warning: " (shortened(warning)) }
                    }
                    div.views { @for view in views { (figure(view)) } }
                }
            }
        }
    }
    .into_string()
}

fn failure_table(failures: &[Failure]) -> Markup {
    html! {
        h2.bad { "Failures" }
        table {
            tr { th { "View" } th { "Retry" } th { "Reason" } }
            @for failure in failures {
                tr {
                    td { (failure.name) }
                    td {
                        @match failure.kind {
                            FailureKind::Permanent => "no use",
                            FailureKind::Retryable => "may help",
                        }
                    }
                    td { (shortened(&failure.reason)) }
                }
            }
        }
    }
}

fn figure(ReportedJob { record, jpeg }: &ReportedJob) -> Markup {
    let [width, height] = record.size_px;
    let bytes: u64 = record.outputs.iter().map(|output| output.bytes).sum();
    html! {
        figure {
            @if let Some(jpeg) = jpeg {
                img alt=(record.view) src={ "data:image/jpeg;base64," (BASE64.encode(jpeg)) };
            }
            figcaption {
                (record.view)
                br;
                span.quiet {
                    (width) " × " (height) ", rendered in " (format!("{:.0}", record.render_ms)) " ms, "
                    (bytes.div_ceil(1000)) " kB"
                }
                @if let Some(warning) = &record.picture_warning {
                    br;
                    "Warning: " (shortened(warning))
                }
            }
        }
    }
}

fn jpeg(small: &RgbImage) -> Option<Vec<u8>> {
    relief_display::encode_jpeg([small.width(), small.height()], &rgba(small), 80).ok()
}

fn rgba(small: &RgbImage) -> Vec<[u8; 4]> {
    small.pixels().map(|image::Rgb([red, green, blue])| [*red, *green, *blue, u8::MAX]).collect()
}

fn timings(series: &BTreeMap<&str, Vec<ReportedJob>>) -> String {
    let mut ms: Vec<f64> = series.values().flatten().map(|one| one.record.render_ms).collect();
    ms.sort_by(f64::total_cmp);
    let Some(most) = ms.last() else { return "nothing was rendered".to_owned() };
    let median = ms[ms.len() / 2];
    format!(
        "A view takes {median:.0} ms to render (median), {most:.0} ms at most, with uploads to a graphics adapter. Relief {}.",
        env!("CARGO_PKG_VERSION")
    )
}

/// A text of at most [`LONGEST`] characters.
fn shortened(text: &str) -> String {
    text.chars().take(LONGEST).collect()
}

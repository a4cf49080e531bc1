//! The report of a batch: one self-contained HTML page, a contact sheet of each series, and its
//! turntable.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Cursor;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use image::{DynamicImage, ImageReader, Limits, RgbaImage};
use rayon::prelude::*;

use super::dataset;
use super::error::Failure;
use super::manifest::Job;
use super::product::Product;
use super::record::Record;
use super::sink::Sink;
use super::turntable::Films;
use relief_display::{MAX_FRAME_SIDE_PX, encode_png};
use relief_session::{Thumbnail, contact_sheet};

/// Width of a thumbnail; the height follows.
const THUMBNAIL_PX: u32 = 240;
/// Columns of a contact sheet.
const SHEET_COLUMNS: usize = 4;
/// Largest picture that is read, bytes.
pub(super) const LARGEST_PICTURE: u64 = 1 << 30;
/// Longest text of a warning or a reason in the page, characters.
const LONGEST: usize = 400;

/// A job that is done, with its picture made small.
struct Shown {
    record: Record,
    small: Option<RgbaImage>,
}

/// Name of the page.
pub const REPORT: &str = "report.html";

/// Writes `report.html`, for each series with colours `contact-sheet.png` and, where it has one,
/// its turntable as films, and the tables of datasets: beside the outputs, in a folder or a bucket.
///
/// # Errors
/// When records cannot be read, or a file cannot be written.
pub fn write_report(jobs: &[Job], failures: &[Failure], out: &Sink, films: &Films) -> std::io::Result<()> {
    let shown = |job| {
        let Some(record) = Record::read(job, out)? else { return Ok(None) };
        Ok(Some((job, Shown { record, small: small_picture(job, out) })))
    };
    let shown: std::io::Result<Vec<Option<(&Job, Shown)>>> = jobs.par_iter().map(shown).collect();
    let mut series: BTreeMap<&str, Vec<Shown>> = BTreeMap::new();
    for (job, shown) in shown?.into_iter().flatten() {
        series.entry(&job.series.name).or_default().push(shown);
    }
    series.par_iter().try_for_each(|(name, shown)| -> std::io::Result<()> {
        if let Some(sheet) = sheet(shown) {
            out.put(&format!("{name}/contact-sheet.png"), sheet)?;
        }
        films.write(out, name, &turns(name, shown))
    })?;
    let records = series.values().flatten().map(|one| &one.record);
    dataset::write_tables(records, out)?;
    out.put(REPORT, page(jobs.len(), &series, failures))
}

/// The colours of group `turntable`.
fn turns(series: &str, shown: &[Shown]) -> Vec<String> {
    let turns = shown.iter().filter(|one| one.record.group == "turntable");
    turns.filter_map(|one| one.record.output(Product::Color)).map(|file| format!("{series}/{file}")).collect()
}

/// The colour of a job, made small, with annotations where it has them; of a frame its left half.
fn small_picture(job: &Job, out: &Sink) -> Option<RgbaImage> {
    let known = [Product::Annotated, Product::Color, Product::AnnotatedFrame, Product::Frame];
    let product = known.into_iter().find(|wanted| job.products.contains(wanted))?;
    let mut picture = open(out, &format!("{}.{}", job.name(), product.ending()))?;
    if product.is_frame() {
        picture = picture.crop_imm(0, 0, picture.width() / 2, picture.height());
    }
    let (width, height) = (picture.width(), picture.height());
    // Side-by-side frames with black lines between have half the rows twice as far apart.
    let wanted = u64::from(THUMBNAIL_PX) * u64::from(height) / u64::from(width.max(1));
    let height = u32::try_from(wanted).unwrap_or(1).clamp(1, 4 * THUMBNAIL_PX);
    Some(picture.thumbnail_exact(THUMBNAIL_PX, height).into_rgba8())
}

/// A picture among the outputs; `None` if none can be read.
pub(super) fn open(out: &Sink, name: &str) -> Option<DynamicImage> {
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_FRAME_SIDE_PX);
    limits.max_image_height = Some(MAX_FRAME_SIDE_PX);
    let file = Cursor::new(out.read(name, LARGEST_PICTURE).ok()??);
    let mut reader = ImageReader::new(file).with_guessed_format().ok()?;
    reader.limits(limits);
    reader.decode().ok()
}

/// All views of a series in one picture; those of another shape than the first are left out.
fn sheet(shown: &[Shown]) -> Option<Vec<u8>> {
    let (width, height) = shown.iter().find_map(|one| one.small.as_ref()).map(RgbaImage::dimensions)?;
    let pixels = |one: &Shown| -> Option<Vec<[u8; 4]>> {
        let small = one.small.as_ref().filter(|small| small.dimensions() == (width, height))?;
        Some(small.pixels().map(|pixel| pixel.0).collect())
    };
    let pictures: Vec<_> = shown.iter().filter_map(|one| Some((&one.record.view, pixels(one)?))).collect();
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

fn page(jobs: usize, series: &BTreeMap<&str, Vec<Shown>>, failures: &[Failure]) -> String {
    let done: usize = series.values().map(Vec::len).sum();
    let mut html =
        String::from("<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Relief batch</title>");
    let _ = write!(
        html,
        "<meta name=\"viewport\" content=\"width=device-width\"><style>{STYLE}</style><h1>{done} of {jobs} views of {} series</h1>\
         <p class=\"quiet\">{}</p>",
        series.len(),
        timings(series)
    );
    if !failures.is_empty() {
        html.push_str("<h2 class=\"bad\">Not done</h2><table><tr><th>View<th>Again?<th>Why");
        for failure in failures {
            let again = match failure.kind {
                super::error::Lasting::Permanent => "no use",
                super::error::Lasting::Retryable => "may help",
            };
            let _ =
                write!(html, "<tr><td>{}<td>{again}<td>{}", escaped(&failure.name), escaped(&failure.reason));
        }
        html.push_str("</table>");
    }
    for (name, shown) in series {
        let _ = write!(html, "<h2>{}</h2>", escaped(name));
        for warning in shown.first().map(|one| one.record.warnings.as_slice()).unwrap_or_default() {
            let _ = write!(html, "<p class=\"quiet\">Warning: {}</p>", escaped(warning));
        }
        html.push_str("<div class=\"views\">");
        shown.iter().for_each(|one| figure(&mut html, one));
        html.push_str("</div>");
    }
    html
}

fn figure(html: &mut String, Shown { record, small }: &Shown) {
    html.push_str("<figure>");
    if let Some(jpeg) = small.as_ref().and_then(jpeg) {
        let _ = write!(
            html,
            "<img alt=\"{}\" src=\"data:image/jpeg;base64,{}\">",
            escaped(&record.view),
            STANDARD.encode(jpeg)
        );
    }
    let [width, height] = record.size_px;
    let bytes: u64 = record.outputs.iter().map(|output| output.bytes).sum();
    let _ = write!(
        html,
        "<figcaption>{}<br><span class=\"quiet\">{width} × {height}, rendered in {:.0} ms, {} kB</span></figcaption></figure>",
        escaped(&record.view),
        record.render_ms,
        bytes.div_ceil(1000)
    );
}

fn jpeg(small: &RgbaImage) -> Option<Vec<u8>> {
    let pixels: Vec<[u8; 4]> = small.pixels().map(|pixel| pixel.0).collect();
    relief_display::encode_jpeg([small.width(), small.height()], &pixels, 80).ok()
}

fn timings(series: &BTreeMap<&str, Vec<Shown>>) -> String {
    let mut ms: Vec<f64> = series.values().flatten().map(|one| one.record.render_ms).collect();
    ms.sort_by(f64::total_cmp);
    let Some(most) = ms.last() else { return "nothing was rendered".to_owned() };
    let median = ms[ms.len() / 2];
    format!(
        "A view takes {median:.0} ms to render (median), {most:.0} ms at most, uploads included. Relief {}.",
        env!("CARGO_PKG_VERSION")
    )
}

/// Text for HTML, cut where it is long.
fn escaped(text: &str) -> String {
    let mut out = String::new();
    for letter in text.chars().take(LONGEST) {
        match letter {
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '&' => out.push_str("&amp;"),
            '"' => out.push_str("&quot;"),
            other => out.push(other),
        }
    }
    out
}

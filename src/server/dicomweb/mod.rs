//! DICOM Supplement 228: rendered volumes by study and series (PS3.18 2024d, 10.4.1.1.7 and
//! 10.4.1.1.8).
//!
//! What it is: `GET /studies/{study}/series/{series}/rendered3D` and `.../renderedmpr`, which
//! return a JPEG or PNG of the series or, for `renderedvolumetricmetadata=yes`, the parameters in
//! use. What it is not: an archive: there are no instances, searches, presentation states or
//! animations. Perspectives, transfer functions and depth are at `/v1/volumes`.
//!
//! UIDs are compared and forgotten: no log line, metric or answer holds one.

mod parameters;
mod rendering;

use std::collections::BTreeSet;

use axum::extract::Path;
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};

use self::parameters::{Parameters, Reformat};
use self::rendering::{Rendering, rendering};
use super::frame::{Tagged, answer_as, entity_tag};
use super::negotiate::{accepts, negotiate};
use super::problem::Problem;
use super::state::Pictures;
use relief_dicom::WarningCode;
use relief_display::encode_jpeg;
use relief_session::{FileFormat, Product, encode};

const METADATA: &str = "application/dicom+json";

/// Pictures, the standard's default first (PS3.18, 8.7.4).
const PICTURES: [FileFormat; 2] = [FileFormat::Jpeg, FileFormat::Png];

/// Quality of a JPEG where the query says none, percent.
const USUAL_QUALITY: u8 = 90;

type Target = Path<(String, String)>;

/// A parallel projection of the series.
pub(super) async fn rendered_3d(
    pictures: Pictures,
    Path((study, series)): Target,
    uri: Uri,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    rendered(&pictures, [&study, &series], &uri, &headers, Reformat::ThreeD).await
}

/// A slice or slab of the series.
pub(super) async fn rendered_mpr(
    pictures: Pictures,
    Path((study, series)): Target,
    uri: Uri,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    rendered(&pictures, [&study, &series], &uri, &headers, Reformat::Mpr).await
}

async fn rendered(
    pictures: &Pictures,
    [study, series]: [&str; 2],
    uri: &Uri,
    headers: &HeaderMap,
    reformat: Reformat,
) -> Result<Response, Problem> {
    let entry = pictures.engine.volumes.find_series(study, series)?;
    let parameters = Parameters::of(uri, reformat)?;
    let accept = parameters.accept(headers)?;
    let Rendering { scene, module } = rendering(&parameters, reformat, &entry.grid, entry.anatomy)?;
    if parameters.metadata {
        return Ok(with_warnings(metadata(&accept, &module.to_string())?, &entry.warnings));
    }
    let media = negotiate(&accept, &PICTURES)?;
    let quality = parameters.quality.unwrap_or(USUAL_QUALITY);
    let tag = entity_tag(pictures, &entry, &scene, &format!("rendered {} {quality}", media.media_type()));
    let display = scene.display.clone();
    let job = move |frame: &relief_render::RenderedFrame| match media {
        FileFormat::Jpeg => Ok(encode_jpeg(frame.size_px, &frame.color_rgba, quality)?),
        _ => encode(frame, &display, Product::Frame, media),
    };
    let tagged = Tagged { method: Method::GET, media, tag: &tag };
    let response = answer_as(pictures, &entry, &scene, headers, tagged, job).await?;
    Ok(with_warnings(response, &entry.warnings))
}

/// The response with a `Warning` header (RFC 7234, 5.5; code 299) for each kind of warning of the
/// series.
fn with_warnings(mut response: Response, warnings: &[WarningCode]) -> Response {
    let kinds: BTreeSet<WarningCode> = warnings.iter().copied().collect();
    for kind in kinds {
        if let Ok(warning) = HeaderValue::from_str(&format!("299 relief \"{}\"", kind.summary())) {
            response.headers_mut().append(header::WARNING, warning);
        }
    }
    response
}

fn metadata(accept: &HeaderMap, module: &str) -> Result<Response, Problem> {
    if !accepts(accept, METADATA) {
        let detail = format!("Accept allows no media type of this answer; they are: {METADATA}");
        let problem = Problem::new(StatusCode::NOT_ACCEPTABLE, "not-acceptable", detail);
        return Err(problem.with("offers", vec![METADATA]));
    }
    let mut response = module.to_owned().into_response();
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(METADATA));
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("private, max-age=60"));
    headers.insert(header::VARY, HeaderValue::from_static("Accept"));
    Ok(response)
}

//! `GET /v1/session/{view}/views`: the rendered views of a live picture at rest, for displays that
//! make their views of one picture while it moves.

use std::sync::Arc;
use std::time::Duration;

use axum::extract::{Path, State};
use axum::http::{HeaderValue, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;

use super::plain::{PlainViewer, RELIEF_FRAME, find_view, query};
use crate::identity::Caller;
use crate::problem::Problem;
use crate::state::{LiveParts, Pictures};
use relief_display::{Frame, Pixels, encode_png};
use relief_live::{EyeViewLimits, EyeViewQuality};
use relief_session::{EyeViews, ViewFrame};

/// Longest wait for a picture at rest.
const PATIENCE: Duration = Duration::from_secs(10);

/// The query.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ViewsQuery {
    eyes: String,
    frame: Option<u64>,
    #[serde(default)]
    quality: EyeViewQuality,
}

/// `GET /v1/session/{view}/views`.
pub(crate) async fn eye_views(
    State(parts): State<LiveParts>,
    Pictures { engine, caller: key, .. }: Pictures,
    Path(name): Path<String>,
    uri: Uri,
    caller: Caller,
) -> Result<Response, Problem> {
    let ViewsQuery { eyes, frame: number, quality } = query(&uri)?;
    let eyes = eyes_of(&eyes)?;
    let view = find_view(&parts, &name)?;
    let is_at_rest = |newest: &Arc<ViewFrame>| newest.is_still && newest.revision == view.revision();
    let newest = view.frames.borrow().clone().filter(is_at_rest);
    // A view without viewers drops its frames: this viewer keeps them until the request is answered.
    let (newest, _place, _viewer) = match newest {
        Some(newest) => (Some(newest), Some(parts.live.place(&caller)?), None),
        None => {
            let mut viewer = PlainViewer::new(parts.clone(), &caller, &name).await?;
            let still = tokio::time::timeout(PATIENCE, viewer.still()).await;
            (still.ok().flatten(), None, Some(viewer))
        }
    };
    let no_store = (header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    let moved = || (StatusCode::NO_CONTENT, [no_store.clone()]).into_response();
    let is_wanted = |newest: &Arc<ViewFrame>| number.is_none_or(|number| number == newest.number);
    let Some(frame) = newest.filter(is_wanted) else { return Ok(moved()) };
    let [width, height] = frame.frame.size_px;
    if !EyeViewLimits::allow_size(frame.frame.size_px, eyes.len()) {
        let detail = format!(
            "eyes are {}, for views of {width}x{height}; allowed: {} pixels in {} rows",
            eyes.len(),
            EyeViewLimits::PIXELS,
            EyeViewLimits::ROWS
        );
        return Err(out_of_range(detail));
    }
    let rows = height * eyes.len() as u32;
    let asked = EyeViews { frame: &frame, eyes: &eyes, quality, caller: key };
    let Some(views) = asked.render(&engine, &view).await? else { return Ok(moved()) };
    let encode = move || {
        let pixels = views.concat().into_flattened();
        Frame::new([width, rows], Pixels::Rgb8(pixels)).map(|stacked| encode_png(&stacked))
    };
    let encoded = engine.blocking("encoding", encode).await?;
    let failed = |error: &dyn std::fmt::Display| Problem::internal("encoding", error);
    let png = encoded.map_err(|error| failed(&error))?.map_err(|error| failed(&error))?;
    parts.metrics.live.sent(true, png.len());
    let number = (RELIEF_FRAME.clone(), HeaderValue::from(frame.number));
    let kind = (header::CONTENT_TYPE, HeaderValue::from_static("image/png"));
    Ok(([no_store, number, kind], png).into_response())
}

fn eyes_of(text: &str) -> Result<Vec<f64>, Problem> {
    let eyes: Result<Vec<f64>, _> = text.split(',').map(|eye| eye.trim().parse::<f64>()).collect();
    match eyes {
        Ok(eyes) if EyeViewLimits::allow_eyes(&eyes) => Ok(eyes),
        _ => {
            let found: String = text.chars().take(100).collect();
            Err(out_of_range(format!(
                "eyes is {found}, allowed: 1 to {} numbers from {far} to {} with commas between them",
                EyeViewLimits::EYES,
                EyeViewLimits::FARTHEST,
                far = -EyeViewLimits::FARTHEST
            )))
        }
    }
}

fn out_of_range(detail: String) -> Problem {
    Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "out-of-range", detail).with("path", "eyes")
}

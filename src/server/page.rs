//! The pages: files built into the program, so that a page loads nothing from another host.

use std::sync::LazyLock;

use axum::Router;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use data_encoding::HEXLOWER;
use serde_json::json;
use sha2::{Digest, Sha256};

use super::negotiate::knows_tag;
use super::state::AppState;
use relief_exchange::Format;
use relief_live::layouts_script;

/// Own scripts and styles only; pictures arrive as blobs. The same for all files: only the page
/// itself obeys it.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; \
     connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

const HTML: &str = "text/html; charset=utf-8";
const STYLE: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";

/// Path, media type and content of every page for signed-in callers.
const PAGES: [(&str, &str, &str); 4] = [
    ("/", HTML, include_str!("page/index.html")),
    ("/annotate", HTML, include_str!("page/annotate/annotate.html")),
    ("/kiosk", HTML, include_str!("page/kiosk/kiosk.html")),
    ("/monitor", HTML, include_str!("page/kiosk/monitor.html")),
];

/// Path, media type and content of every other file, and of the page to sign in.
const FILES: [(&str, &str, &str); 94] = [
    ("/identity.js", SCRIPT, include_str!("page/identity.js")),
    ("/sign-in", HTML, include_str!("page/sign-in.html")),
    ("/sign-in.js", SCRIPT, include_str!("page/sign-in.js")),
    ("/sign-in.css", STYLE, include_str!("page/sign-in.css")),
    ("/style.css", STYLE, include_str!("page/style.css")),
    ("/stage.css", STYLE, include_str!("page/stage.css")),
    ("/panel.css", STYLE, include_str!("page/panel.css")),
    ("/icon.svg", "image/svg+xml", include_str!("page/icon.svg")),
    ("/archives.js", SCRIPT, include_str!("page/archives.js")),
    ("/archives.css", STYLE, include_str!("page/archives.css")),
    ("/app.js", SCRIPT, include_str!("page/app.js")),
    ("/state.js", SCRIPT, include_str!("page/state.js")),
    ("/address.js", SCRIPT, include_str!("page/address.js")),
    ("/keys.js", SCRIPT, include_str!("page/keys.js")),
    ("/series.js", SCRIPT, include_str!("page/series.js")),
    ("/lengths.js", SCRIPT, include_str!("page/lengths.js")),
    ("/likeness.js", SCRIPT, include_str!("page/likeness.js")),
    ("/notice.js", SCRIPT, include_str!("page/notice.js")),
    ("/stage.js", SCRIPT, include_str!("page/stage.js")),
    ("/picks.js", SCRIPT, include_str!("page/picks.js")),
    ("/orbit.js", SCRIPT, include_str!("page/orbit.js")),
    ("/projection.js", SCRIPT, include_str!("page/projection.js")),
    ("/vectors.js", SCRIPT, include_str!("page/vectors.js")),
    ("/view.js", SCRIPT, include_str!("page/view.js")),
    ("/draw.js", SCRIPT, include_str!("page/draw.js")),
    ("/files.js", SCRIPT, include_str!("page/files.js")),
    ("/preview.js", SCRIPT, include_str!("page/preview.js")),
    ("/presets.js", SCRIPT, include_str!("page/presets.js")),
    ("/labels.js", SCRIPT, include_str!("page/labels.js")),
    ("/cine.js", SCRIPT, include_str!("page/cine.js")),
    ("/crop.css", STYLE, include_str!("page/crop.css")),
    ("/volumes.css", STYLE, include_str!("page/volumes.css")),
    ("/crop.js", SCRIPT, include_str!("page/crop.js")),
    ("/phases.js", SCRIPT, include_str!("page/phases.js")),
    ("/planes.js", SCRIPT, include_str!("page/planes.js")),
    ("/thumbnails.js", SCRIPT, include_str!("page/thumbnails.js")),
    ("/volumes.js", SCRIPT, include_str!("page/volumes.js")),
    ("/slices.js", SCRIPT, include_str!("page/slices.js")),
    ("/light.js", SCRIPT, include_str!("page/light.js")),
    ("/surface.js", SCRIPT, include_str!("page/surface.js")),
    ("/gestures.js", SCRIPT, include_str!("page/gestures.js")),
    ("/kiosk.css", STYLE, include_str!("page/kiosk/kiosk.css")),
    ("/kiosk.js", SCRIPT, include_str!("page/kiosk/kiosk.js")),
    ("/session.js", SCRIPT, include_str!("page/kiosk/session.js")),
    ("/restore.js", SCRIPT, include_str!("page/kiosk/restore.js")),
    ("/frame.js", SCRIPT, include_str!("page/kiosk/frame.js")),
    ("/panel.js", SCRIPT, include_str!("page/kiosk/panel.js")),
    ("/outputs.js", SCRIPT, include_str!("page/kiosk/outputs.js")),
    ("/comfort.js", SCRIPT, include_str!("page/kiosk/comfort.js")),
    ("/synthesis.js", SCRIPT, include_str!("page/kiosk/synthesis.js")),
    ("/synthesis-worker.js", SCRIPT, include_str!("page/kiosk/synthesis-worker.js")),
    ("/synthesizer.js", SCRIPT, include_str!("page/kiosk/synthesizer.js")),
    ("/virtual-screen.js", SCRIPT, include_str!("page/kiosk/virtual-screen.js")),
    ("/true-views.js", SCRIPT, include_str!("page/kiosk/true-views.js")),
    ("/view-shader.js", SCRIPT, include_str!("page/kiosk/view-shader.js")),
    ("/controls.js", SCRIPT, include_str!("page/kiosk/controls.js")),
    ("/wiimote.js", SCRIPT, include_str!("page/kiosk/wiimote.js")),
    ("/spacemouse.js", SCRIPT, include_str!("page/kiosk/spacemouse.js")),
    ("/pairing.js", SCRIPT, include_str!("page/kiosk/pairing.js")),
    // A phone has no sign-in: its ticket opens the session.
    ("/wand", HTML, include_str!("page/wand/wand.html")),
    ("/wand.css", STYLE, include_str!("page/wand/wand.css")),
    ("/wand.js", SCRIPT, include_str!("page/wand/wand.js")),
    ("/attitude.js", SCRIPT, include_str!("page/wand/attitude.js")),
    ("/space.js", SCRIPT, include_str!("page/wand/space.js")),
    ("/monitor.js", SCRIPT, include_str!("page/kiosk/monitor.js")),
    ("/annotate/annotate.css", STYLE, include_str!("page/annotate/annotate.css")),
    ("/annotate/api.js", SCRIPT, include_str!("page/annotate/api.js")),
    ("/annotate/contents.js", SCRIPT, include_str!("page/annotate/contents.js")),
    ("/annotate/dialogs.js", SCRIPT, include_str!("page/annotate/dialogs.js")),
    ("/annotate/files.js", SCRIPT, include_str!("page/annotate/files.js")),
    ("/annotate/geometry.js", SCRIPT, include_str!("page/annotate/geometry.js")),
    ("/annotate/grab.js", SCRIPT, include_str!("page/annotate/grab.js")),
    ("/annotate/guide.css", STYLE, include_str!("page/annotate/guide.css")),
    ("/annotate/guide.js", SCRIPT, include_str!("page/annotate/guide.js")),
    ("/annotate/hand.js", SCRIPT, include_str!("page/annotate/hand.js")),
    ("/annotate/job.js", SCRIPT, include_str!("page/annotate/job.js")),
    ("/annotate/keys.js", SCRIPT, include_str!("page/annotate/keys.js")),
    ("/annotate/list.css", STYLE, include_str!("page/annotate/list.css")),
    ("/annotate/list.js", SCRIPT, include_str!("page/annotate/list.js")),
    ("/annotate/live.js", SCRIPT, include_str!("page/annotate/live.js")),
    ("/annotate/log.js", SCRIPT, include_str!("page/annotate/log.js")),
    ("/annotate/main.js", SCRIPT, include_str!("page/annotate/main.js")),
    ("/annotate/model.js", SCRIPT, include_str!("page/annotate/model.js")),
    ("/annotate/overlay.js", SCRIPT, include_str!("page/annotate/overlay.js")),
    ("/annotate/pane.js", SCRIPT, include_str!("page/annotate/pane.js")),
    ("/annotate/panes.css", STYLE, include_str!("page/annotate/panes.css")),
    ("/annotate/placing.js", SCRIPT, include_str!("page/annotate/placing.js")),
    ("/annotate/settings.js", SCRIPT, include_str!("page/annotate/settings.js")),
    ("/annotate/projections.js", SCRIPT, include_str!("page/annotate/projections.js")),
    ("/annotate/slice-pane.js", SCRIPT, include_str!("page/annotate/slice-pane.js")),
    ("/annotate/structures.js", SCRIPT, include_str!("page/annotate/structures.js")),
    ("/annotate/surfaces.js", SCRIPT, include_str!("page/annotate/surfaces.js")),
    ("/annotate/tools.js", SCRIPT, include_str!("page/annotate/tools.js")),
    ("/annotate/volume-pane.js", SCRIPT, include_str!("page/annotate/volume-pane.js")),
];

/// Routes of the pages.
pub(super) fn pages() -> Router<AppState> {
    with_files(Router::new(), &PAGES)
}

/// Routes of all other files.
pub(super) fn files() -> Router<AppState> {
    let layouts = get(|headers: HeaderMap| async move { file(&headers, SCRIPT, layouts_script()) });
    let formats = get(|headers: HeaderMap| async move { file(&headers, SCRIPT, &FORMATS) });
    let made = Router::new().route("/layouts.js", layouts).route("/annotate/formats.js", formats);
    with_files(made, &FILES)
}

fn with_files(
    routes: Router<AppState>,
    files: &[(&'static str, &'static str, &'static str)],
) -> Router<AppState> {
    files.iter().copied().fold(routes, |routes, (path, media, content)| {
        routes.route(path, get(move |headers: HeaderMap| async move { file(&headers, media, content) }))
    })
}

/// The module with the formats of annotation files: name, title, and whether they can be written.
static FORMATS: LazyLock<String> = LazyLock::new(|| {
    let rows = Format::TABLE.iter().map(|info| {
        let row = json!({ "name": info.name, "title": info.title, "isWritten": info.is_written });
        format!("  {row},\n")
    });
    format!(
        "// Formats of annotation files. Made from the server's table.\nexport const FORMATS = [\n{}];\n",
        rows.collect::<String>()
    )
});

/// All files share one tag: a browser never mixes those of two builds.
static TAG: LazyLock<String> = LazyLock::new(|| {
    let hash =
        PAGES.iter().chain(&FILES).fold(Sha256::new(), |hash, (_, _, content)| hash.chain_update(content));
    let hash = hash.chain_update(layouts_script()).chain_update(&*FORMATS).finalize();
    let digits = HEXLOWER.encode(&hash[..8]);
    format!("\"{digits}\"")
});

fn file(headers: &HeaderMap, media: &'static str, content: &'static str) -> Response {
    // For 304 too: browsers replace stored headers by those of the answer.
    let always = [
        (header::ETAG, TAG.as_str()),
        (header::CACHE_CONTROL, "no-cache"),
        (header::CONTENT_SECURITY_POLICY, POLICY),
    ];
    if knows_tag(headers, &TAG) {
        return (StatusCode::NOT_MODIFIED, always).into_response();
    }
    (always, [(header::CONTENT_TYPE, media)], content).into_response()
}

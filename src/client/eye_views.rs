//! The views of a picture at rest that the server renders for the eyes of a display
//! (`GET /v1/session/{view}/views`), over a connection of their own.
//!
//! Eyes are in eye separations to the right of the middle.

use std::time::Duration;

use bytes::Bytes;
use http_body_util::{BodyExt, Empty, Limited};
use hyper::header::{AUTHORIZATION, HOST};
use hyper::{Request, StatusCode};
use hyper_util::rt::TokioIo;
use serde_json::Value;
use tokio::time::timeout;

use super::error::{BoxedError, ClientError, LossError, ServerText};
use super::link::Options;
use super::socket::{MAX_FRAME_BYTES, detail, secured};
use relief_live::EyeViewQuality;

/// Longest time that the server may take: it renders a picture for each eye.
const RENDERED: Duration = Duration::from_secs(120);
/// The views of a live view's picture at rest, one above the other as PNG; `None` if the view moves.
///
/// # Errors
/// When the server cannot be reached, or refuses.
pub(super) async fn eye_views(
    options: &Options,
    view: &str,
    eyes: &[f64],
    quality: EyeViewQuality,
) -> Result<Option<Bytes>, ClientError> {
    let Options { server, access, .. } = options;
    let lost = |source| ClientError::Lost { server: server.clone(), source };
    let failed = |error: BoxedError| lost(LossError::Protocol(error));
    let eyes = eyes.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
    let path = server.path(&format!("/v1/session/{view}/views?eyes={eyes}&quality={}", quality.name()));
    let mut request = Request::get(path).header(HOST, server.authority());
    if let Some(authorization) = access.authorization() {
        request = request.header(AUTHORIZATION, authorization);
    }
    let request = request.body(Empty::<Bytes>::new()).map_err(|error| failed(error.into()))?;
    let stream = TokioIo::new(secured(server, access).await?);
    let (mut sender, connection) =
        hyper::client::conn::http1::handshake(stream).await.map_err(|error| failed(error.into()))?;
    let exchange = async move {
        let response = sender.send_request(request).await.map_err(|error| failed(error.into()))?;
        let status = response.status();
        let body = Limited::new(response.into_body(), MAX_FRAME_BYTES).collect().await;
        Ok::<_, ClientError>((status, body.map_err(failed)?.to_bytes()))
    };
    // The connection ends when the exchange does.
    let both = futures_util::future::join(exchange, connection);
    let (answer, _) = timeout(RENDERED, both).await.map_err(|_| lost(LossError::NoAnswer(RENDERED)))?;
    match answer? {
        (StatusCode::OK, png) => Ok(Some(png)),
        (StatusCode::NO_CONTENT, _) => Ok(None),
        (status, body) => {
            let problem = serde_json::from_slice::<Value>(&body).ok();
            let reason =
                problem.map_or_else(|| ServerText::new(&status.to_string()), |problem| detail(&problem));
            Err(ClientError::Refused { server: server.clone(), reason, passing: true, no_volume: false })
        }
    }
}

//! Errors as RFC 9457 problem documents.
//!
//! A [`Problem`] has a public part for the client, and a cause, which is logged once with the
//! request's id (see `observe`) and never sent.

use std::fmt::Display;

use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde_json::{Map, Value, json};

use relief_annotation::SnapError;
use relief_base::OutOfRange;
use relief_render::{SceneError, TrueViewsError};
use relief_session::{
    BackendError, JobError, LiveError, OpenError, ReadError, ServiceError, UploadRefused, VolumeError,
};

/// The media type of a problem document.
pub(super) const MEDIA_TYPE: &str = "application/problem+json";

/// A refusal or failure in the form that clients receive.
#[derive(Clone, Debug)]
pub(super) struct Problem {
    status: StatusCode,
    /// Last part of the problem's type.
    kind: &'static str,
    detail: String,
    members: Map<String, Value>,
    cause: Option<String>,
}

/// The internal cause of a response, for the log.
#[derive(Clone, Debug)]
pub(super) struct Cause(pub(super) String);

impl Problem {
    /// A problem of this status; `kind` is the last part of its type, `detail` a sentence for the
    /// client.
    pub(super) fn new(status: StatusCode, kind: &'static str, detail: impl Display) -> Self {
        Self { status, kind, detail: detail.to_string(), members: Map::new(), cause: None }
    }

    /// Adds a member for programs.
    pub(super) fn with(mut self, name: &str, value: impl Into<Value>) -> Self {
        self.members.insert(name.to_owned(), value.into());
        self
    }

    /// Something failed here: the client learns that, the log learns why.
    pub(super) fn internal(what: &str, cause: impl Display) -> Self {
        let problem = Self::new(StatusCode::INTERNAL_SERVER_ERROR, "internal", format!("{what} failed"));
        Self { cause: Some(cause.to_string()), ..problem }
    }

    /// The server can do this, but not now.
    pub(super) fn unavailable(kind: &'static str, detail: impl Display) -> Self {
        Self::new(StatusCode::SERVICE_UNAVAILABLE, kind, detail)
    }

    /// The description of the problem.
    pub(super) fn detail(&self) -> &str {
        &self.detail
    }

    /// The view refuses an intent.
    pub(super) fn refused_intent(error: impl Display) -> Self {
        Self::new(StatusCode::UNPROCESSABLE_ENTITY, "refused-intent", error).with("path", "intent")
    }

    /// A value out of range.
    pub(super) fn out_of_range(error: &OutOfRange) -> Self {
        Self::new(StatusCode::UNPROCESSABLE_ENTITY, "out-of-range", error)
            .with("path", error.path.as_str())
            .with("found", error.found.as_str())
            .with("allowed", error.allowed.as_str())
    }

    /// The path member and the detail with this name in place of the JSON path: for what came in a
    /// query.
    pub(super) fn renamed(mut self, from_path: &str, name: &str) -> Self {
        self.detail = self.detail.replacen(from_path, name, 1);
        self.with("path", name)
    }

    /// The document for the client.
    pub(super) fn document(&self) -> Value {
        let mut document = Map::from_iter([
            ("type".to_owned(), json!(format!("urn:relief:problem:{}", self.kind))),
            ("title".to_owned(), json!(self.status.canonical_reason().unwrap_or("Error"))),
            ("status".to_owned(), json!(self.status.as_u16())),
            ("code".to_owned(), json!(self.kind)),
            ("detail".to_owned(), json!(self.detail)),
        ]);
        document.extend(self.members.clone());
        Value::Object(document)
    }

    /// The cause of a failure, for the log.
    pub(super) fn cause(&self) -> Option<&str> {
        self.cause.as_deref()
    }

    /// The JSON path that this problem is about.
    pub(super) fn path(&self) -> Option<&str> {
        self.members.get("path").and_then(Value::as_str)
    }
}

impl From<&SceneError> for Problem {
    fn from(error: &SceneError) -> Self {
        match error {
            SceneError::Syntax { path, .. } => {
                Self::new(StatusCode::BAD_REQUEST, "malformed-scene", error).with("path", path.as_str())
            }
            SceneError::Range(range) => Self::out_of_range(range),
        }
    }
}

impl From<&OutOfRange> for Problem {
    fn from(error: &OutOfRange) -> Self {
        Self::out_of_range(error)
    }
}

impl From<&ServiceError> for Problem {
    fn from(error: &ServiceError) -> Self {
        match error {
            ServiceError::Busy(_) => Self::unavailable("busy", error),
            ServiceError::Stopped => Self::unavailable("stopping", "the renderer has stopped"),
            ServiceError::Panicked(_) => Self::internal("rendering", error),
            ServiceError::Backend(BackendError::Refused(reason)) => {
                Self::new(StatusCode::UNPROCESSABLE_ENTITY, "over-adapter-limits", reason)
            }
            ServiceError::Backend(BackendError::Cancelled) => Self::internal("rendering", error),
            ServiceError::Backend(BackendError::Failed(cause)) => Self::internal("rendering", cause),
        }
    }
}

impl From<&VolumeError> for Problem {
    fn from(error: &VolumeError) -> Self {
        let (status, kind) = match error {
            VolumeError::UnknownId => (StatusCode::NOT_FOUND, "no-such-volume"),
            VolumeError::NoVolume => (StatusCode::SERVICE_UNAVAILABLE, "no-volume"),
            VolumeError::UnknownSeries => (StatusCode::NOT_FOUND, "no-such-series"),
            VolumeError::NotRemovable => (StatusCode::FORBIDDEN, "not-removable"),
            VolumeError::OwnLabels => (StatusCode::FORBIDDEN, "not-replaceable"),
            VolumeError::MemoryFull(_) => (StatusCode::INSUFFICIENT_STORAGE, "memory-full"),
        };
        Self::new(status, kind, error)
    }
}

impl From<UploadRefused> for Problem {
    fn from(error: UploadRefused) -> Self {
        Self::new(StatusCode::INSUFFICIENT_STORAGE, "uploads-full", error)
    }
}

impl From<&JobError> for Problem {
    fn from(error: &JobError) -> Self {
        match error {
            JobError::Panicked { what, source } => Self::internal(what, source),
            JobError::Closed { what } => Self::internal(what, error),
            JobError::Abandoned => Self::unavailable("stopped", error),
        }
    }
}

impl From<&ReadError> for Problem {
    fn from(error: &ReadError) -> Self {
        match error {
            ReadError::MemoryFull(full) => Self::new(StatusCode::INSUFFICIENT_STORAGE, "memory-full", full)
                .with("needed_bytes", full.needed)
                .with("available_bytes", full.available),
            ReadError::Changed => Self::new(StatusCode::CONFLICT, "series-changed", error),
            ReadError::Job(job) => job.into(),
            ReadError::NoReader | ReadError::Reader(_) => Self::internal("reading the series again", error),
        }
    }
}

impl From<OpenError> for Problem {
    fn from(error: OpenError) -> Self {
        match error {
            OpenError::Full => Self::unavailable("views-full", error),
            OpenError::OfCaller(most) => {
                Self::new(StatusCode::TOO_MANY_REQUESTS, "too-many-views", error).with("allowed", most)
            }
        }
    }
}

impl From<&SnapError> for Problem {
    fn from(error: &SnapError) -> Self {
        match error {
            SnapError::OutOfRange(error) => error.into(),
            SnapError::NotFound { radius_mm, .. } => {
                Self::new(StatusCode::UNPROCESSABLE_ENTITY, "nothing-to-snap-to", error)
                    .with("radius_mm", *radius_mm)
            }
        }
    }
}

impl From<&TrueViewsError> for Problem {
    fn from(error: &TrueViewsError) -> Self {
        match error {
            TrueViewsError::Settings(error) => Self::out_of_range(error),
            _ => Self::new(StatusCode::UNPROCESSABLE_ENTITY, "no-true-views", error),
        }
    }
}

impl From<&LiveError> for Problem {
    fn from(error: &LiveError) -> Self {
        match error {
            LiveError::Scene(error) => error.into(),
            LiveError::Range(error) => error.into(),
            LiveError::Snap(error) => error.into(),
            LiveError::Voxels(error) => error.into(),
            LiveError::Service(error) => error.into(),
            LiveError::Job(error) => error.into(),
            LiveError::Encoding { what, source } => Self::internal(what, source),
            LiveError::Annotations(cause) => match cause.downcast_ref::<Self>() {
                Some(problem) => problem.clone(),
                None => Self::internal("reading the annotations", cause),
            },
            LiveError::Intent(_) | LiveError::Camera(_) => Self::refused_intent(error),
            LiveError::TrueViews(error) => error.into(),
            LiveError::SceneKey { .. } => {
                let problem = Self::new(StatusCode::UNPROCESSABLE_ENTITY, "out-of-range", error);
                match error.path() {
                    Some(path) => problem.with("path", path),
                    None => problem,
                }
            }
        }
    }
}

/// `From` for owned errors, so that handlers can use `?`.
macro_rules! owned {
    ($($error:ty),* $(,)?) => {$(
        impl From<$error> for Problem {
            fn from(error: $error) -> Self {
                Self::from(&error)
            }
        }
    )*};
}

owned!(SceneError, OutOfRange, ServiceError, JobError, ReadError, SnapError, VolumeError, LiveError);

impl Display for Problem {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.detail)
    }
}

impl std::error::Error for Problem {}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let mut response = (self.status, self.document().to_string()).into_response();
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(MEDIA_TYPE));
        headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
        let retry_after_s = match self.status {
            StatusCode::SERVICE_UNAVAILABLE | StatusCode::TOO_MANY_REQUESTS => Some("1"),
            // Space is freed by people, which takes longer.
            StatusCode::INSUFFICIENT_STORAGE => Some("60"),
            _ => None,
        };
        if let Some(seconds) = retry_after_s {
            headers.insert(header::RETRY_AFTER, HeaderValue::from_static(seconds));
        }
        if self.status == StatusCode::UNAUTHORIZED {
            headers.insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer realm=\"relief\""));
        }
        if self.status == StatusCode::NOT_ACCEPTABLE {
            headers.insert(header::VARY, HeaderValue::from_static("Accept"));
        }
        if let Some(cause) = self.cause {
            response.extensions_mut().insert(Cause(cause));
        }
        response
    }
}

/// A body of JSON.
///
/// # Errors
/// When it is malformed, with the path of the first fault.
pub(super) fn parse<T: serde::de::DeserializeOwned>(body: &[u8]) -> Result<T, Problem> {
    let mut reader = serde_json::Deserializer::from_slice(body);
    serde_path_to_error::deserialize(&mut reader).map_err(|error| malformed(&error, ""))
}

/// The problem of a fault in JSON, below the path `within`.
pub(super) fn malformed(error: &serde_path_to_error::Error<serde_json::Error>, within: &str) -> Problem {
    let path = format!("{within}{}", error.path());
    let detail = format!("{path}: {}", error.inner());
    Problem::new(StatusCode::BAD_REQUEST, "malformed-json", detail).with("path", path)
}

//! Errors of the store as problem documents.

use axum::http::StatusCode;
use serde_json::{Value, json};

use super::outward::{outward_item, outward_versioned};
use crate::problem::Problem;
use relief_base::OutOfRange;
use relief_store::StoreError;

impl From<StoreError> for Problem {
    fn from(error: StoreError) -> Self {
        let said = error.to_string();
        let refuse = |status, kind| Self::new(status, kind, &said);
        match error {
            StoreError::Conflict { id, expected, current, yours } => refuse(StatusCode::CONFLICT, "conflict")
                .with("id", id.to_string())
                .with("expected", expected)
                .with("current", current.map_or(Value::Null, |current| outward_versioned(&current)))
                .with("yours", yours.map_or(Value::Null, |yours| outward_item(&yours))),
            StoreError::Locked { id } => refuse(StatusCode::LOCKED, "locked").with("id", id.to_string()),
            StoreError::NotFound { id } => no_such_item(&id),
            StoreError::Exists { id } => refuse(StatusCode::CONFLICT, "exists").with("id", id.to_string()),
            StoreError::Content { id } => {
                refuse(StatusCode::NOT_FOUND, "no-such-content").with("content", id.as_str())
            }
            StoreError::NoTemplate { name } => {
                refuse(StatusCode::NOT_FOUND, "no-such-template").with("name", name)
            }
            StoreError::Invalid(error) => invalid(&error),
            StoreError::NothingToUndo => refuse(StatusCode::CONFLICT, "nothing-to-undo"),
            StoreError::NothingToRedo => refuse(StatusCode::CONFLICT, "nothing-to-redo"),
            StoreError::Replaced { .. } => refuse(StatusCode::PRECONDITION_FAILED, "changed-meanwhile"),
            StoreError::NotOwner { .. } => refuse(StatusCode::FORBIDDEN, "not-owner"),
            StoreError::ReadOnly => refuse(StatusCode::FORBIDDEN, "read-only"),
            StoreError::FileGone => Self::unavailable("log-gone", said),
            StoreError::Busy => Self::unavailable("busy", said),
            StoreError::Full => refuse(StatusCode::INSUFFICIENT_STORAGE, "log-full"),
            // These messages name files and databases: they are logged, not sent.
            StoreError::Schema { .. }
            | StoreError::Place(_)
            | StoreError::Foreign(_)
            | StoreError::Damaged(_)
            | StoreError::Unreachable(_)
            | StoreError::Unencrypted(_)
            | StoreError::Database(_) => Self::internal("the log of annotations", said),
        }
    }
}

/// A value of an item that may not be so.
pub(crate) fn invalid(error: &OutOfRange) -> Problem {
    Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "out-of-range", error)
        .with("path", error.path.as_str())
        .with("found", error.found.as_str())
        .with("allowed", error.allowed.as_str())
}

/// The item does not exist, or the author may not see it: the answer is the same.
pub(crate) fn no_such_item(id: &impl std::fmt::Display) -> Problem {
    let detail = format!("no item has the id {id} in this volume");
    Problem::new(StatusCode::NOT_FOUND, "no-such-item", detail).with("id", json!(id.to_string()))
}

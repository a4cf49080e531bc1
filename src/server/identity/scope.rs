//! Scopes, and the one that a request needs.

use std::fmt;

use axum::http::Method;
use serde::{Deserialize, Serialize};

/// The rights of an identity. Each scope contains those before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Scope {
    /// Look: frames, depth, picks, slices, annotations, live sessions.
    View,
    /// Change annotations and store results in archives, too.
    Annotate,
    /// Add and remove volumes and their label maps, too.
    Admin,
}

impl Scope {
    /// All scopes, the smallest first.
    pub const ALL: [Self; 3] = [Self::View, Self::Annotate, Self::Admin];

    /// Its name in token files and on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::View => "view",
            Self::Annotate => "annotate",
            Self::Admin => "admin",
        }
    }

    /// The scope that a request needs; `route` is the pattern of its path.
    pub(super) fn needed(method: &Method, route: &str) -> Self {
        /// Requests that compute an answer from a body, and change nothing.
        const READS_BY_POST: [&str; 8] =
            ["/frame", "/views", "/depth", "/pick", "/snap", "/intent", "/ticket", "/wand"];
        if method.is_safe() || READS_BY_POST.iter().any(|end| route.ends_with(end)) {
            Self::View
        } else if route.contains("/annotations") || route.ends_with("/frame/store") {
            Self::Annotate
        } else {
            Self::Admin
        }
    }
}

impl fmt::Display for Scope {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reading_requests_need_only_the_view_scope() {
        for (method, route, scope) in [
            (Method::GET, "/v1/volumes/{id}/annotations", Scope::View),
            (Method::POST, "/v1/volumes/{id}/frame", Scope::View),
            (Method::POST, "/v1/volumes/{id}/views", Scope::View),
            (Method::POST, "/v1/session/{view}/intent", Scope::View),
            (Method::POST, "/v1/volumes/{id}/annotations/snap", Scope::View),
            (Method::POST, "/v1/volumes/{id}/annotations", Scope::Annotate),
            (Method::PUT, "/v1/volumes/{id}/annotations/sets/{name}", Scope::Annotate),
            (Method::POST, "/v1/volumes/{id}/frame/store", Scope::Annotate),
            (Method::POST, "/v1/volumes/{id}/annotations/store", Scope::Annotate),
            (Method::POST, "/v1/volumes", Scope::Admin),
            (Method::DELETE, "/v1/volumes/{id}", Scope::Admin),
            (Method::POST, "/v1/volumes/{id}/labels", Scope::Admin),
        ] {
            assert_eq!(Scope::needed(&method, route), scope, "{method} {route}");
        }
        assert!(Scope::View < Scope::Annotate && Scope::Annotate < Scope::Admin);
    }
}

//! The task that tells live views what other servers and programs change in the log.

use std::sync::Arc;

use tokio::task::JoinHandle;

use super::annotation_service::{Annotations, follow};
use super::state::Server;

impl Server {
    /// Begins to tell live sessions what other programs change in the log of annotations: all that
    /// comes after this call, until the task is aborted. Where there is no log, there is nothing to
    /// do.
    pub async fn follow_annotations(self: &Arc<Self>) -> JoinHandle<()> {
        if let Some(annotations) = &self.annotations {
            // If the log cannot be read now, publishing starts when it can be.
            drop(annotations.turn().await);
        }
        let server = Arc::clone(self);
        tokio::spawn(async move {
            if let Some(annotations) = &server.annotations {
                tokio::join!(follow(annotations), look_again(&server, annotations));
            }
        })
    }
}

/// Wakes the views after every change. A request for a list may be the first to notice a change of
/// sets.
async fn look_again(server: &Server, annotations: &Annotations) {
    let mut changes = annotations.changes.subscribe();
    while changes.changed().await.is_ok() {
        server.live.views.wake();
    }
}

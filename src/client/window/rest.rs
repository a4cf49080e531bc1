//! The views of a picture at rest: requested from the server while nothing moves, dropped after any
//! movement.

use std::time::Duration;

use tokio::sync::watch;

use crate::error::ClientError;
use crate::eye_views::eye_views;
use crate::link::Options;
use relief_display::{Frame, read_png};
use relief_live::EyeViewQuality;

/// Delay between the last movement and the request for views.
const REST: Duration = Duration::from_millis(150);

/// A picture at rest in the window.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct AtRest {
    /// Name of the live view.
    pub(super) view: String,
    /// The eyes of the display's views, in eye separations to the right of the middle.
    pub(super) eyes: Vec<f64>,
    /// Number of the shown picture.
    pub(super) shown: u64,
}

/// Requests rendered views of each picture at rest, refined ones and then true ones, until the window
/// is gone. `show` takes [`AtRest::shown`] and the views, one above the other.
pub(super) async fn serve(
    mut resting: watch::Receiver<Option<AtRest>>,
    options: &Options,
    show: impl Fn(u64, Frame),
) {
    loop {
        let at_rest = resting.borrow_and_update().clone();
        let work = async {
            if let Some(at_rest) = &at_rest
                && let Err(error) = ask(options, at_rest, &show).await
            {
                tracing::warn!(%error, "the server renders no views of the picture at rest");
            }
            std::future::pending::<()>().await;
        };
        tokio::select! {
            changed = resting.changed() => if changed.is_err() { return },
            () = work => {}
        }
    }
}

async fn ask(options: &Options, at_rest: &AtRest, show: impl Fn(u64, Frame)) -> Result<(), ClientError> {
    tokio::time::sleep(REST).await;
    for quality in [EyeViewQuality::Refined, EyeViewQuality::True] {
        let Some(png) = eye_views(options, &at_rest.view, &at_rest.eyes, quality).await? else { break };
        match read_png(&png) {
            Ok((stacked, _)) => show(at_rest.shown, stacked),
            Err(error) => tracing::warn!(%error, "rendered views are damaged"),
        }
    }
    Ok(())
}

//! The views of a picture at rest for eyes beside its own, rendered by a camera for each eye.
//!
//! A display that makes its views of one picture shows these in their place while nothing moves.
//! Eyes are in eye separations to the right of the middle.

use std::sync::Arc;

use super::render_loop::BUSY;
use super::{LiveError, View, ViewFrame};
use crate::ServiceError;
use crate::engine::Engine;
use relief_display::synthesize;
use relief_live::EyeViewQuality;
use relief_render::{Refinement, RenderRequest, RenderedFrame, eye_cameras, true_views};

/// Views of a picture at rest.
pub struct EyeViews<'a> {
    /// The picture.
    pub frame: &'a Arc<ViewFrame>,
    /// The eyes.
    pub eyes: &'a [f64],
    /// How their views are made.
    pub quality: EyeViewQuality,
    /// The caller whose share of the render thread is used; see [`crate::RenderService::render_for`].
    pub caller: Option<Arc<str>>,
}

/// Red, green, blue of a view, in rows from the top.
type Pixels = Vec<[u8; 3]>;

impl std::fmt::Debug for EyeViews<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("EyeViews").field("eyes", &self.eyes).finish_non_exhaustive()
    }
}

impl EyeViews<'_> {
    /// The views of a picture of `view`; `None` as soon as the view shows something else. Dropping
    /// the future cancels what is being rendered.
    ///
    /// # Errors
    /// When the camera has no eye, the screen is behind it, or rendering fails.
    pub async fn render(&self, engine: &Engine, view: &View) -> Result<Option<Vec<Pixels>>, LiveError> {
        let revision = self.frame.revision;
        let mut frames = view.frames.subscribe();
        let moved = frames.wait_for(|newest| newest.as_ref().is_none_or(|other| other.revision != revision));
        tokio::select! {
            made = self.views(engine) => made.map(Some),
            _ = moved => Ok(None),
        }
    }

    async fn views(&self, engine: &Engine) -> Result<Vec<Pixels>, LiveError> {
        let Self { frame, eyes, quality, .. } = self;
        let picture = &frame.frame;
        let setup = true_views(&frame.display, &picture.camera, picture.size_px, frame.limits)?;
        let cameras = eye_cameras(&setup, &picture.camera, eyes)?;
        let warped = match quality {
            EyeViewQuality::Refined => self.warped(engine).await?,
            EyeViewQuality::True => Vec::new(),
        };
        let (mut warped, mut views) = (warped.into_iter(), Vec::with_capacity(eyes.len()));
        for (camera, eye) in cameras.into_iter().zip(*eyes) {
            let request = frame.request.seen_by(camera);
            views.push(match warped.next() {
                _ if *eye == 0.0 => colors(picture),
                None => colors(&*self.cast(engine, request).await?),
                Some(warped) => self.refined(engine, request, warped).await?,
            });
        }
        Ok(views)
    }

    /// The views that a display makes of the picture.
    async fn warped(&self, engine: &Engine) -> Result<Vec<Pixels>, LiveError> {
        let (frame, eyes) = (Arc::clone(self.frame), self.eyes.to_vec());
        let job = move || {
            let failed = |error| LiveError::encoding("making views", error);
            let encoder = frame.display.encoder()?;
            let size_px = frame.frame.size_px;
            let picture = frame.frame.picture().map_err(failed)?;
            let key = encoder.key_view(0.0, &picture, frame.limits);
            let views = synthesize(size_px, &key.layer, None, &encoder.parallax(size_px[0]), &eyes);
            Ok(views.map_err(failed)?.into_pictures())
        };
        engine.blocking("making views", job).await?
    }

    async fn refined(
        &self,
        engine: &Engine,
        request: RenderRequest,
        warped: Pixels,
    ) -> Result<Pixels, LiveError> {
        let picture = Arc::clone(&self.frame.frame);
        let begin = move || {
            let refinement = Refinement::new(warped, &picture, Refinement::USUAL_SHARE);
            (refinement.next_blocks(), refinement)
        };
        let (mut next, mut refinement) = engine.blocking("making views", begin).await?;
        while let Some(blocks) = next {
            let blocks = Arc::new(blocks);
            let request = RenderRequest { blocks: Some(Arc::clone(&blocks)), ..request.clone() };
            let cast = self.cast(engine, request).await?;
            let step = move || {
                refinement.take(&blocks, &cast);
                (refinement.next_blocks(), refinement)
            };
            (next, refinement) = engine.blocking("making views", step).await?;
        }
        Ok(refinement.into_view())
    }

    async fn cast(&self, engine: &Engine, request: RenderRequest) -> Result<Arc<RenderedFrame>, LiveError> {
        let volume = engine.voxels(&self.frame.entry).await?;
        let ticket = loop {
            match engine.service.render_for(self.caller.clone(), &volume, request.clone()) {
                Ok(ticket) => break ticket,
                Err(ServiceError::Busy(_)) => tokio::time::sleep(BUSY).await,
                Err(error) => return Err(error.into()),
            }
        };
        drop(volume);
        let outcome = ticket.await;
        engine.observe(&outcome);
        Ok(outcome?.frame)
    }
}

fn colors(frame: &RenderedFrame) -> Pixels {
    frame.color_rgba.iter().map(|[r, g, b, _]| [*r, *g, *b]).collect()
}

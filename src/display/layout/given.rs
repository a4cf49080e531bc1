//! Disparity without colour: a picture's depth as D or Z, and frames of given D.

use rayon::prelude::*;

use super::disparity::DisparityTable;
use super::{DecodedLayer, DisparityLayer, Frame, FrameEncoder, Layout, LayoutError, Picture, frame, pack};
use crate::views::{Views, synthesize};
use relief_base::{DepthLimits, ViewDepth};

impl FrameEncoder {
    /// D of every pixel, as [`FrameEncoder::encode`] puts it into frames: depth filtered, scaled
    /// between the limits and mapped by the display's curve. A miss is at the far limit. The
    /// background layer is a separate picture.
    #[must_use]
    pub fn disparity(&self, picture: &Picture<'_>, limits: DepthLimits) -> Vec<u8> {
        self.disparity_of(&self.filter.apply(picture), limits)
    }

    /// D of view depths in mm, not filtered: scaled between the limits and mapped by the display's
    /// curve. A miss is at the far limit.
    #[must_use]
    pub fn disparity_of(&self, depth_mm: &[f32], limits: DepthLimits) -> Vec<u8> {
        let table = DisparityTable::new(&self.profile, limits);
        depth_mm.par_iter().map(|&mm| table.byte(mm)).collect()
    }

    /// Z of every pixel in 16 bits, 65535 nearest, as layout `depth16` has it: depth filtered and
    /// scaled between the limits.
    #[must_use]
    pub fn scaled16(&self, picture: &Picture<'_>, limits: DepthLimits) -> Vec<u16> {
        let gray = |&mm: &f32| ((1.0 - limits.scaled(ViewDepth(mm)).0) * 65535.0).round() as u16;
        self.filter.apply(picture).iter().map(gray).collect()
    }

    /// Packs colour and disparity that are known already, such as those that came over a network:
    /// with what [`FrameEncoder::disparity`] gave, the bytes of [`FrameEncoder::encode`]. Layout
    /// `color` needs no disparity.
    ///
    /// # Errors
    /// As [`FrameEncoder::encode`]; when values do not fill the size; and for `depth16`, which is
    /// no disparity.
    pub fn pack<const N: usize>(
        &self,
        size_px: [u32; 2],
        front: DisparityLayer<'_, N>,
        back: Option<DisparityLayer<'_, N>>,
    ) -> Result<Frame, LayoutError> {
        self.expect_size(size_px)?;
        let expected = frame::pixel_count("a picture", size_px)?;
        let has_disparity = !matches!(self.layout, Layout::Color);
        for layer in std::iter::once(&front).chain(back.as_ref()) {
            for (what, found) in [("the colour", layer.color.len()), ("the disparity", layer.disparity.len())]
            {
                if found != expected && (has_disparity || what == "the colour") {
                    return Err(LayoutError::PixelCount { what, size_px, found, expected });
                }
            }
        }
        pack::pack(self, size_px, front, back)
    }

    /// The views of colour and disparity, for the layout's eyes.
    pub(super) fn views_of<const N: usize>(
        &self,
        size_px: [u32; 2],
        front: DisparityLayer<'_, N>,
        back: Option<DisparityLayer<'_, N>>,
    ) -> Result<Views, LayoutError> {
        const { assert!(N >= 3, "red, green and blue") };
        self.layout.check_size(size_px)?;
        let decoded = |layer: DisparityLayer<'_, N>| DecodedLayer {
            color: layer.color.iter().map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect(),
            disparity: layer.disparity.to_vec(),
        };
        let back = back.map(decoded);
        synthesize(size_px, &decoded(front), back.as_ref(), &self.parallax(size_px[0]), &self.eyes())
    }

    pub(super) fn expect_size(&self, found_px: [u32; 2]) -> Result<(), LayoutError> {
        match self.render_size_px() {
            Some(needed_px) if needed_px != found_px => {
                Err(LayoutError::PictureSize { layout: self.layout, needed_px, found_px })
            }
            _ => Ok(()),
        }
    }
}

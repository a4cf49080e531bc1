//! A picture and its estimated depth as a frame.

use std::path::Path;
use std::time::Instant;

use anyhow::Context;
use image::RgbImage;
use image::imageops::{FilterType, overlay, resize};

use relief_base::DepthLimits;
use relief_display::{Frame, FrameEncoder, Picture};
use relief_estimate::{Closeness, DepthNetwork, MAX_NETWORK_BYTES, Steady};

/// View depths of the nearest surface and of the background, mm. Estimates have no scale: any two
/// numbers give the same frame.
const NEAR_MM: f64 = 500.0;
const FAR_MM: f64 = 1500.0;

/// Estimates the depth of one picture after the other.
pub(super) struct Estimator {
    network: DepthNetwork,
    steady: Option<Steady>,
    times_ms: Vec<f64>,
}

impl Estimator {
    /// By the network of this file, or the built-in one. `is_film`: without flicker between
    /// pictures.
    pub(super) fn new(model: Option<&Path>, is_film: bool) -> anyhow::Result<Self> {
        let network = match model {
            Some(path) => read_network(path).with_context(|| format!("cannot use {}", path.display()))?,
            None => DepthNetwork::own()?,
        };
        Ok(Self { network, steady: is_film.then(Steady::default), times_ms: Vec::new() })
    }

    /// The frame of a picture, which is fitted into the size of the layout.
    pub(super) fn frame(&mut self, encoder: &FrameEncoder, picture: &RgbImage) -> anyhow::Result<Frame> {
        let start = Instant::now();
        let fitted = encoder.render_size_px().map(|size_px| fit(picture, size_px));
        let (picture, place) =
            fitted.as_ref().map_or((picture, None), |(fitted, place)| (fitted, Some(*place)));
        let closeness = self.closeness(picture, place)?;
        let far = |near: &f32| (FAR_MM - f64::from(*near) * (FAR_MM - NEAR_MM)) as f32;
        let depth_mm: Vec<f32> = closeness.values().iter().map(far).collect();
        let color: Vec<[u8; 4]> =
            picture.pixels().map(|pixel| [pixel.0[0], pixel.0[1], pixel.0[2], 255]).collect();
        let size_px = [picture.width(), picture.height()];
        let limits = DepthLimits { near_mm: NEAR_MM, far_mm: FAR_MM };
        let frame = encoder.encode(&Picture::new(size_px, &color, &depth_mm)?, limits)?;
        self.times_ms.push(start.elapsed().as_secs_f64() * 1e3);
        Ok(frame)
    }

    /// Closeness of a picture: of the part at `place`, where the rest is a margin.
    fn closeness(&mut self, picture: &RgbImage, place: Option<[u32; 4]>) -> anyhow::Result<Closeness> {
        let [left, top, width, height] = place.unwrap_or([0, 0, picture.width(), picture.height()]);
        let is_whole = [width, height] == [picture.width(), picture.height()];
        let part;
        let seen = if is_whole {
            picture
        } else {
            part = image::imageops::crop_imm(picture, left, top, width, height).to_image();
            &part
        };
        let mut found = self.network.estimate(seen)?;
        if let Some(steady) = &mut self.steady {
            found = steady.next(seen, found);
        }
        if is_whole {
            return Ok(found);
        }
        let mut values = vec![0.0; picture.width() as usize * picture.height() as usize];
        for (row, from) in found.values().chunks_exact(width as usize).enumerate() {
            let start = (top as usize + row) * picture.width() as usize + left as usize;
            values[start..start + width as usize].copy_from_slice(from);
        }
        Closeness::new([picture.width(), picture.height()], values).context("the picture has no pixels")
    }

    /// The median time of a frame, ms.
    pub(super) fn median_ms(&self) -> f64 {
        let mut times = self.times_ms.clone();
        times.sort_by(f64::total_cmp);
        times.get(times.len() / 2).copied().unwrap_or(0.0)
    }
}

fn read_network(path: &Path) -> anyhow::Result<DepthNetwork> {
    use std::io::Read;

    let mut file = Vec::new();
    std::fs::File::open(path)?.take(MAX_NETWORK_BYTES + 1).read_to_end(&mut file)?;
    Ok(DepthNetwork::from_onnx(file)?)
}

/// A picture in the middle of a black one of this size, as large as its proportions let it be, and
/// where it lies there: left, top, width, height.
fn fit(picture: &RgbImage, [width, height]: [u32; 2]) -> (RgbImage, [u32; 4]) {
    let scale = f64::min(
        f64::from(width) / f64::from(picture.width().max(1)),
        f64::from(height) / f64::from(picture.height().max(1)),
    );
    let side = |side: u32, most: u32| ((f64::from(side) * scale).round() as u32).clamp(1, most);
    let [own_width, own_height] = [side(picture.width(), width), side(picture.height(), height)];
    let place = [(width - own_width) / 2, (height - own_height) / 2, own_width, own_height];
    if picture.dimensions() == (width, height) {
        return (picture.clone(), place);
    }
    let resized = resize(picture, own_width, own_height, FilterType::CatmullRom);
    let mut fitted = RgbImage::new(width, height);
    overlay(&mut fitted, &resized, place[0].into(), place[1].into());
    (fitted, place)
}

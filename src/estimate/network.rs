//! Networks that estimate depth, in ONNX.
//!
//! Two kinds of network. One gives `closeness` (the output's name) from colours of 0 to 1: the
//! built-in one, which `scripts/depth-network` trains, and others trained by it. Any other is
//! treated as one of MiDaS (Ranftl et al., TPAMI 44(3), 2022) or Depth Anything (Yang et al., CVPR
//! 2024): colours normalised by the mean and deviation of ImageNet, and inverse depth without
//! scale, larger where nearer.

use std::panic::{AssertUnwindSafe, catch_unwind};

use image::RgbImage;
use image::imageops::{FilterType, resize};
use rten::{Dimension, Model, ModelOptions, OpRegistry, RunOptions, op_registry};
use rten_tensor::NdTensor;
use rten_tensor::prelude::*;

use crate::closeness::Closeness;
use crate::error::EstimateError;
use crate::joint;

/// Largest file of a network that is loaded: Depth Anything's large one has 1.3 GB.
pub const MAX_NETWORK_BYTES: u64 = 2 << 30;

/// The built-in network. docs/ESTIMATED_DEPTH.md names its training data.
static OWN: &[u8] = include_bytes!("depth.onnx");

/// Name of the output of networks that give closeness.
const CLOSENESS: &str = "closeness";
/// Pixels of the built-in network's input: those of 384 x 224.
const OWN_PIXELS: f64 = 384.0 * 224.0;
/// Pixels of the input of another network whose file leaves them open: those of 518 x 518.
const OTHER_PIXELS: f64 = 518.0 * 518.0;
/// Sides of inputs are multiples of this: the built-in network halves its input five times.
const OWN_STEP: u32 = 32;
/// The same for other networks: patches of 14 pixels in Depth Anything, of 32 in MiDaS.
const OTHER_STEP: u32 = 224;
/// Mean and deviation of ImageNet's colours, 0 to 1.
const IMAGENET: [[f32; 3]; 2] = [[0.485, 0.456, 0.406], [0.229, 0.224, 0.225]];
/// Closeness up to this is background: networks learn 0 for it, and 0.1 for the farthest surface.
const BACKGROUND: f32 = 0.05;
/// Shares of the pixels that are nearer and farther than the scale of a relative estimate.
const OUTLIERS: [f64; 2] = [0.01, 0.99];

/// A network that estimates depth.
pub struct DepthNetwork {
    model: Model,
    gives_closeness: bool,
    /// Width and height that the file fixes.
    fixed_px: [Option<u32>; 2],
}

impl std::fmt::Debug for DepthNetwork {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("DepthNetwork").field("gives_closeness", &self.gives_closeness).finish_non_exhaustive()
    }
}

impl DepthNetwork {
    /// The built-in network.
    ///
    /// # Errors
    /// Never with the network in this repository.
    pub fn own() -> Result<Self, EstimateError> {
        Self::from_onnx(OWN.to_vec())
    }

    /// A network from the bytes of an ONNX file.
    ///
    /// # Errors
    /// When the file is too large or no ONNX, or the network does not take one picture.
    pub fn from_onnx(file: Vec<u8>) -> Result<Self, EstimateError> {
        let bytes = file.len() as u64;
        if bytes > MAX_NETWORK_BYTES {
            return Err(EstimateError::TooLarge { bytes, most: MAX_NETWORK_BYTES });
        }
        let options = ModelOptions::with_ops(operators());
        let loaded = guarded(|| options.load(file));
        let model = loaded.map_err(|error| EstimateError::Load(error.into()))?;
        let fixed_px = input_sides(&model)?;
        let output = model.output_ids().first().and_then(|id| model.node_info(*id));
        let gives_closeness = output.is_some_and(|node| node.name() == Some(CLOSENESS));
        Ok(Self { model, gives_closeness, fixed_px })
    }

    /// Closeness of every pixel of a picture, with edges at the picture's edges.
    ///
    /// # Errors
    /// When the network fails or gives anything but one number a pixel.
    pub fn estimate(&self, picture: &RgbImage) -> Result<Closeness, EstimateError> {
        let (width, height) = picture.dimensions();
        if width == 0 || height == 0 {
            return Err(EstimateError::Empty { width, height });
        }
        let [input_width, input_height] = self.input_px([width, height]);
        let small = resize(picture, input_width, input_height, FilterType::Triangle);
        let (found_px, values) = self.run(&small)?;
        let scaled = if self.gives_closeness { with_flat_background(values) } else { relative(values) };
        let coarse =
            Closeness::new(found_px, scaled).ok_or_else(|| EstimateError::Output { found: Vec::new() })?;
        let guide = if found_px == [input_width, input_height] {
            small
        } else {
            resize(picture, found_px[0], found_px[1], FilterType::Triangle)
        };
        let values = joint::upsampled(&coarse, &guide, picture);
        Closeness::new([width, height], values).ok_or(EstimateError::Empty { width, height })
    }

    /// The size at which the network sees a picture: as the file fixes it, else with the picture's
    /// proportions.
    fn input_px(&self, [width, height]: [u32; 2]) -> [u32; 2] {
        let (pixels, step) = match self.gives_closeness {
            true => (OWN_PIXELS, OWN_STEP),
            false => (OTHER_PIXELS, OTHER_STEP),
        };
        let scale = (pixels / (f64::from(width) * f64::from(height))).sqrt();
        let side = |side: u32| {
            let steps = (f64::from(side) * scale / f64::from(step)).round();
            (steps.clamp(1.0, pixels / f64::from(step * step)) as u32) * step
        };
        [self.fixed_px[0].unwrap_or(side(width)), self.fixed_px[1].unwrap_or(side(height))]
    }

    /// The network's values for a picture of its input's size, and their width and height.
    fn run(&self, small: &RgbImage) -> Result<([u32; 2], Vec<f32>), EstimateError> {
        let (width, height) = small.dimensions();
        let [mean, deviation] = if self.gives_closeness { [[0.0; 3], [1.0; 3]] } else { IMAGENET };
        let input =
            NdTensor::<f32, 4>::from_fn([1, 3, height as usize, width as usize], |[_, channel, y, x]| {
                let byte = small.get_pixel(x as u32, y as u32).0[channel];
                (f32::from(byte) / 255.0 - mean[channel]) / deviation[channel]
            });
        let output = guarded(|| self.model.run_one(input.view().into(), None::<RunOptions>));
        let output = output.map_err(|error| EstimateError::Run(error.into()))?;
        let found = output.shape().to_vec();
        let sides = match found[..] {
            [1, height, width] | [1, 1, height, width] => [width, height].map(u32::try_from),
            _ => return Err(EstimateError::Output { found }),
        };
        let [Ok(width), Ok(height)] = sides else { return Err(EstimateError::Output { found }) };
        let values =
            output.into_tensor::<f32>().ok_or_else(|| EstimateError::Output { found: found.clone() })?;
        let values = values.into_data();
        if values.is_empty() {
            return Err(EstimateError::Output { found });
        }
        if values.iter().any(|value| !value.is_finite()) {
            return Err(EstimateError::NotFinite);
        }
        Ok(([width, height], values))
    }
}

/// The operators of the networks that are supported, which are the only ones in the program: those
/// of the built-in network, of MiDaS, and of Depth Anything.
fn operators() -> OpRegistry {
    op_registry!(
        Add,
        AveragePool,
        BatchNormalization,
        Cast,
        Clip,
        Concat,
        ConstantOfShape,
        Conv,
        ConvTranspose,
        Div,
        Equal,
        Erf,
        Exp,
        Expand,
        Flatten,
        Floor,
        Gather,
        Gelu,
        Gemm,
        GlobalAveragePool,
        HardSigmoid,
        HardSwish,
        Identity,
        LayerNormalization,
        LeakyRelu,
        MatMul,
        MaxPool,
        Mul,
        Pad,
        Pow,
        Range,
        Reciprocal,
        ReduceMean,
        Relu,
        Reshape,
        Resize,
        Shape,
        Sigmoid,
        Slice,
        Softmax,
        Split,
        Sqrt,
        Squeeze,
        Sub,
        Tanh,
        Transpose,
        Unsqueeze,
        Where
    )
}

/// Width and height of the input, where the file fixes them.
fn input_sides(model: &Model) -> Result<[Option<u32>; 2], EstimateError> {
    let [id] = model.input_ids() else {
        return Err(EstimateError::Input { found: format!("{} tensors", model.input_ids().len()) });
    };
    let Some(shape) = model.node_info(*id).and_then(|node| node.shape()) else { return Ok([None; 2]) };
    let refusal = || EstimateError::Input { found: format!("a tensor of {shape:?}") };
    let [count, channels, height, width] = &shape[..] else { return Err(refusal()) };
    let fits = |side: &Dimension, wanted: usize| match side {
        Dimension::Fixed(found) => *found == wanted,
        Dimension::Symbolic(_) => true,
    };
    if !fits(count, 1) || !fits(channels, 3) {
        return Err(refusal());
    }
    let fixed = |side: &Dimension| match side {
        Dimension::Fixed(pixels @ 1..=4096) => Ok(u32::try_from(*pixels).ok()),
        Dimension::Fixed(_) => Err(refusal()),
        Dimension::Symbolic(_) => Ok(None),
    };
    Ok([fixed(width)?, fixed(height)?])
}

/// Closeness whose background is exactly 0.
fn with_flat_background(mut values: Vec<f32>) -> Vec<f32> {
    values.iter_mut().for_each(|value| *value = ((*value - BACKGROUND) / (1.0 - BACKGROUND)).max(0.0));
    values
}

/// Values without scale as 0 to 1, without outliers.
fn relative(mut values: Vec<f32>) -> Vec<f32> {
    let mut sorted = values.clone();
    sorted.sort_unstable_by(f32::total_cmp);
    let [low, high] = OUTLIERS.map(|share| sorted[((sorted.len() - 1) as f64 * share) as usize]);
    let extent = high - low;
    let scale = if extent > f32::MIN_POSITIVE { 1.0 / extent } else { 0.0 };
    values.iter_mut().for_each(|value| *value = (*value - low) * scale);
    values
}

/// Why a call of the runtime has no result.
#[derive(Debug, thiserror::Error)]
enum CallError<E> {
    #[error(transparent)]
    Refused(E),
    #[error("the runtime panicked")]
    Panicked,
}

/// The result of the runtime, which may panic on an invalid network.
fn guarded<T, E>(call: impl FnOnce() -> Result<T, E>) -> Result<T, CallError<E>> {
    match catch_unwind(AssertUnwindSafe(call)) {
        Ok(result) => result.map_err(CallError::Refused),
        Err(_) => Err(CallError::Panicked),
    }
}

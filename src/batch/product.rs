//! Files that a job writes, by their names in manifests and options.

use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// A file that a job writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Product {
    /// The frame in the scene's layout, PNG.
    Frame,
    /// The colour, PNG.
    Color,
    /// View depth in mm, OpenEXR.
    Depth,
    /// View depth as 16-bit grey, PNG: tenths of a millimetre, 0 where nothing is seen.
    DepthPng,
    /// Intrinsics and pose of the camera and places of the surface that it sees, JSON.
    Camera,
    /// The colour with the annotations drawn over it, PNG.
    Annotated,
    /// The frame in the scene's layout with the annotations drawn in the same depth, PNG.
    AnnotatedFrame,
    /// The structure of the annotations that is nearest in each pixel, whatever of the volume lies
    /// before it: 8-bit grey, PNG.
    Labels,
    /// The colour as a DICOM Secondary Capture of the series' study.
    Capture,
    /// The colour with the annotations drawn over it, as a Secondary Capture.
    AnnotatedCapture,
}

/// The outputs that one word of `--products` names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProductSet(pub Vec<Product>);

impl Product {
    /// All of them.
    pub const ALL: [Self; 10] = [
        Self::Frame,
        Self::Color,
        Self::Depth,
        Self::DepthPng,
        Self::Camera,
        Self::Annotated,
        Self::AnnotatedFrame,
        Self::Labels,
        Self::Capture,
        Self::AnnotatedCapture,
    ];

    /// Colour, depth and camera: what those who learn from pictures need.
    pub const DATASET: [Self; 4] = [Self::Color, Self::Depth, Self::DepthPng, Self::Camera];

    /// Its name in manifests and options.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Frame => "frame",
            Self::Color => "color",
            Self::Depth => "depth",
            Self::DepthPng => "depth-png",
            Self::Camera => "camera",
            Self::Annotated => "annotated",
            Self::AnnotatedFrame => "annotated-frame",
            Self::Labels => "labels",
            Self::Capture => "capture",
            Self::AnnotatedCapture => "annotated-capture",
        }
    }

    /// The suffix of the file after the view's name.
    #[must_use]
    pub const fn ending(self) -> &'static str {
        match self {
            Self::Frame => "frame.png",
            Self::Color => "color.png",
            Self::Depth => "depth.exr",
            Self::DepthPng => "depth.png",
            Self::Camera => "camera.json",
            Self::Annotated => "annotated.png",
            Self::AnnotatedFrame => "annotated-frame.png",
            Self::Labels => "labels.png",
            Self::Capture => "capture.dcm",
            Self::AnnotatedCapture => "annotated-capture.dcm",
        }
    }

    /// Whether it has annotations in it.
    #[must_use]
    pub const fn needs_annotations(self) -> bool {
        matches!(self, Self::Annotated | Self::AnnotatedFrame | Self::Labels | Self::AnnotatedCapture)
    }

    /// Whether the picture's depth, or what is drawn in it, is part of it.
    #[must_use]
    pub const fn needs_depth(self) -> bool {
        !matches!(self, Self::Color | Self::Capture)
    }

    /// Whether it is a DICOM object, which an archive can store.
    #[must_use]
    pub const fn is_object(self) -> bool {
        matches!(self, Self::Capture | Self::AnnotatedCapture)
    }

    /// Whether the picture has to have the size of its layout.
    #[must_use]
    pub const fn is_frame(self) -> bool {
        matches!(self, Self::Frame | Self::AnnotatedFrame)
    }

    /// All names, for messages.
    #[must_use]
    pub fn names() -> String {
        Self::ALL.map(Self::name).join(", ")
    }
}

impl FromStr for ProductSet {
    type Err = UnknownProduct;

    fn from_str(name: &str) -> Result<Self, UnknownProduct> {
        if name == "dataset" {
            return Ok(Self(Product::DATASET.to_vec()));
        }
        let found = Product::ALL.into_iter().find(|known| known.name() == name);
        found.map(|product| Self(vec![product])).ok_or(UnknownProduct)
    }
}

/// A name that no product has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("products are {}, and dataset for color,depth,depth-png,camera", Product::names())]
pub struct UnknownProduct;

/// The unit of 16-bit depth: tenths of a millimetre.
pub(crate) const DEPTH_UNIT_MM: f64 = 0.1;

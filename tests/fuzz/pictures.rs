//! Frames as PNG and EXR, transfer functions of other tools, scenes.

use relief_display::{decode_exr, inspect_png};
use relief_render::SceneFile;
use relief_volume::{TransferImportChoice, import_transfer};

pub(crate) fn png(bytes: &[u8]) {
    let _ = inspect_png(bytes);
}

pub(crate) fn exr(bytes: &[u8]) {
    let _ = decode_exr(bytes);
}

pub(crate) fn transfer(bytes: &[u8]) {
    let _ = import_transfer(bytes, &TransferImportChoice::default());
}

pub(crate) fn scene(bytes: &[u8]) {
    let _ = SceneFile::parse(bytes);
}

//! Transfer functions from files: `--transfer` of commands that render, and `relief presets convert`.
//!
//! Only this module opens files. Over HTTP a path would let clients read the server's files, so a
//! request contains the transfer function itself; `relief presets convert` prints it.

use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use serde_json::{Value, json};

use relief_render::{SceneFile, Shading, shading_json, transfer_json};
use relief_volume::{ImportedTransfer, MAX_IMPORT_BYTES, TransferImportChoice, import_transfer};

/// A transfer function that overrides the scene's.
#[derive(Debug, clap::Args)]
pub(super) struct TransferArguments {
    /// Colour, opacity and light from a file: of 3D Slicer (presets.xml, .vp, .vp.json), a colour
    /// map of VTK or ParaView (JSON), or the "transfer" of a request
    #[arg(long, value_name = "FILE", conflicts_with_all = ["preset", "window_hu"])]
    transfer: Option<PathBuf>,
    /// The function, where the file of --transfer holds several
    #[arg(long, value_name = "NAME", requires = "transfer")]
    transfer_name: Option<String>,
    /// Stretch the colours of --transfer over this range of HU: for maps of 0 to 1
    #[arg(long, value_name = "LOW,HIGH", requires = "transfer", value_parser = parse_range, allow_hyphen_values = true)]
    transfer_range_hu: Option<Range>,
}

/// Two HU values.
#[derive(Clone, Copy, Debug)]
pub(super) struct Range(pub(super) [f64; 2]);

pub(super) fn parse_range(text: &str) -> Result<Range, String> {
    let parsed =
        text.split_once(',').and_then(|(a, b)| Some([a.trim().parse().ok()?, b.trim().parse().ok()?]));
    let range = parsed.filter(|[low, high]: &[f64; 2]| low < high);
    range.map(Range).ok_or_else(|| "a range is LOW,HIGH in HU, such as -200,1000".to_owned())
}

impl TransferArguments {
    /// The scene with the file's look, where a file is given.
    pub(super) fn apply(&self, scene: SceneFile) -> anyhow::Result<SceneFile> {
        let Some(path) = &self.transfer else { return Ok(scene) };
        let look = read_look(path, self.transfer_name.as_deref(), self.transfer_range_hu)?;
        let look = SceneFile::from_value(&look);
        Ok(scene.with_look_of(look.with_context(|| format!("{} has no usable look", path.display()))?))
    }
}

/// The look in a file as a part of a request: `transfer`, and `shading` where the file says.
///
/// Other content of the file is reported on stderr.
pub(super) fn read_look(path: &Path, name: Option<&str>, range: Option<Range>) -> anyhow::Result<Value> {
    let bytes = read_bounded(path)?;
    if let Some(own) = own_look(&bytes) {
        if name.is_some() || range.is_some() {
            bail!("{} is in a request's own form: it has one look, in HU", path.display());
        }
        return Ok(own);
    }
    let choice = TransferImportChoice { name, range_hu: range.map(|Range(range)| range) };
    let found = import_transfer(&bytes, &choice).with_context(|| format!("cannot use {}", path.display()))?;
    let ImportedTransfer { transfer, light, left_out, .. } = found;
    for what in left_out {
        eprintln!("warning: left out: {what}");
    }
    let mut look = json!({ "transfer": transfer_json(&transfer) });
    if let Some(light) = light {
        let ([ambient, diffuse, specular], shininess) = (light.shares, light.shininess);
        look["shading"] = shading_json(&Shading { ambient, diffuse, specular, shininess });
    }
    Ok(look)
}

/// The form of a request: a scene with a transfer function, or the function only.
fn own_look(bytes: &[u8]) -> Option<Value> {
    let json: Value = serde_json::from_slice(bytes).ok()?;
    if json.get("transfer").is_some() {
        return Some(json);
    }
    let is_function = ["points", "window"].iter().any(|key| json.get(key).is_some());
    is_function.then(|| json!({ "transfer": json }))
}

fn read_bounded(path: &Path) -> anyhow::Result<Vec<u8>> {
    let read = || -> std::io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        // One byte more than allowed, to detect files that are too large.
        std::fs::File::open(path)?.take(MAX_IMPORT_BYTES as u64 + 1).read_to_end(&mut bytes)?;
        Ok(bytes)
    };
    let bytes = read().with_context(|| format!("cannot read {}", path.display()))?;
    if bytes.len() > MAX_IMPORT_BYTES {
        bail!("{} has more than {MAX_IMPORT_BYTES} bytes: no file of transfer functions", path.display());
    }
    Ok(bytes)
}

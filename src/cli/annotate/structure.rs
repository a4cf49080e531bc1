//! Shared by grow, paint, fill and mesh: the volume, items by id or name, and the edit that stores
//! the result.

use anyhow::{Context, bail};
use serde_json::json;

use super::super::output::{print_json, say};
use super::super::series::SeriesArguments;
use super::log_options::{ByArguments, Log};
use relief_annotation::{
    Change, ContentId, Edit, FrameOfReference, Geometry, Item, ItemId, Method, Placement, Versioned,
};
use relief_base::{Patient, Point};
use relief_exchange::StoredContent;
use relief_store::Filter;
use relief_volume::{Mask, Volume};

/// Name and set of a new item.
#[derive(Debug, clap::Args)]
pub(super) struct NewArguments {
    /// Name of the new item
    #[arg(long, value_name = "TEXT")]
    pub(super) name: String,
    /// The set of the new item
    #[arg(long, value_name = "NAME", default_value = relief_annotation::Set::DEFAULT)]
    pub(super) set: String,
    #[command(flatten)]
    pub(super) by: ByArguments,
}

/// A volume and its frame of reference.
pub(super) struct Scan {
    pub(super) volume: Volume,
    pub(super) frame: FrameOfReference,
}

impl Scan {
    pub(super) fn load(series: &SeriesArguments) -> anyhow::Result<Self> {
        let (loaded, ()) = series.load_after(|_| Ok(()))?;
        let uid = loaded.identity.frame_of_reference().map(str::to_owned);
        // Without a UID: derived from the content of the volume.
        let frame = uid.unwrap_or_else(|| format!("volume:{}", loaded.volume.content_hash().short()));
        Ok(Self { volume: loaded.volume, frame: FrameOfReference(frame) })
    }
}

/// `x,y,z` in patient LPS mm.
pub(super) fn parse_place(text: &str) -> Result<Point<Patient>, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse::<f64>()).collect();
    match numbers.as_deref() {
        Ok(&[x, y, z]) if [x, y, z].iter().all(|number| number.is_finite()) => Ok(Point::new(x, y, z)),
        _ => Err("expected three numbers, x,y,z in patient LPS mm, such as 12.5,-40,3".to_owned()),
    }
}

/// The item with this id, or the only one with this name; of items with one name those of a wanted
/// kind come first.
pub(super) fn find(log: &Log, wanted: &str, kind: &str) -> anyhow::Result<Versioned> {
    if let Ok(id) = wanted.parse::<ItemId>() {
        return Ok(log.wait(log.store().item(id))?);
    }
    let listing = log.wait(log.store().list(&Filter::default()))?;
    let mut found: Vec<Versioned> = listing.items.into_iter().filter(|it| it.item.name == wanted).collect();
    let is_wanted =
        |it: &Versioned| it.item.geometry.as_ref().is_some_and(|geometry| geometry.kind() == kind);
    if found.iter().any(is_wanted) {
        found.retain(is_wanted);
    }
    match found.len() {
        1 => Ok(found.remove(0)),
        0 => bail!("there is no item {wanted:?}; relief annotate list shows names and ids"),
        count => bail!("{count} items are called {wanted:?}; give the id of one, from relief annotate list"),
    }
}

/// The voxels of a region item.
pub(super) fn mask_of(log: &Log, item: &Item) -> anyhow::Result<Mask> {
    let Some(Geometry::Region(summary)) = &item.geometry else {
        let kind = item.geometry.as_ref().map_or("nothing", Geometry::kind);
        bail!("item {:?} is a {kind}, expected a region", item.name);
    };
    let (_, bytes) = log.wait(log.store().content(&summary.content))?;
    relief_exchange::mask_of_content(summary, &bytes)
        .with_context(|| format!("cannot use the voxels of item {:?}", item.name))
}

/// A new item with its content, in one edit.
pub(super) fn keep_new<T>(
    log: &Log,
    new: &NewArguments,
    frame: Option<FrameOfReference>,
    kept: StoredContent<T>,
    geometry: impl FnOnce(T) -> Geometry,
) -> anyhow::Result<Item> {
    let author = new.by.who.name()?;
    let mut item = Item::new(&new.name, &author, Some(geometry(kept.summary)))?;
    item.set.clone_from(&new.set);
    item.frame_of_reference = frame;
    item.placement = Some(computed());
    keep(log, &new.by, (kept.media_type, &kept.bytes), Change::Create { item: Box::new(item.clone()) })?;
    Ok(item)
}

/// Puts a content, then makes the change that names it.
pub(super) fn keep(
    log: &Log,
    by: &ByArguments,
    content: (&str, &[u8]),
    change: Change,
) -> anyhow::Result<()> {
    let edit = Edit { author: by.who.name()?, reason: by.reason.clone(), changes: vec![change] };
    edit.validate()?; // before anything is written
    let _: ContentId = log.wait(log.store().put_content(content.0, content.1))?;
    log.wait(log.store().apply(&edit))?;
    Ok(())
}

pub(super) fn computed() -> Placement {
    Placement { method: Method::Computed, device: None, camera: None, snapped_mm: None }
}

/// The result, as text or JSON.
pub(super) fn report(item: &Item, extra: &serde_json::Value, is_json: bool) -> anyhow::Result<()> {
    let measures = item.geometry.as_ref().map_or_else(Vec::new, relief_annotation::measures);
    if is_json {
        return print_json(&json!({ "item": item, "measures": measures, "result": extra }));
    }
    let kind = item.geometry.as_ref().map_or("item", Geometry::kind);
    let shown: Vec<String> = measures
        .iter()
        .map(|measure| format!("{} {:.2} {}", measure.name, measure.value, measure.unit.replace("mL", "ml")))
        .collect();
    say!("{kind} {:?}: {}", item.name, shown.join(", "));
    for (key, value) in extra.as_object().into_iter().flatten() {
        say!("  {}: {}", key.replace('_', " "), value.to_string().trim_matches('"'));
    }
    say!("  id: {}", item.id);
    Ok(())
}

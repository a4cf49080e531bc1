//! The frame of requests that compute a structure: credit, permit, and the edit that stores the
//! result.
//!
//! The work is done on blocking threads, one structure at a time, as it takes all cores. It ends
//! within a moment, or after the step it is at, when the client leaves or the deadline comes: the
//! request's future is dropped then.

use std::sync::Arc;

use axum::http::StatusCode;
use axum::response::Response;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

use super::asked::{EditRequest, JsonBody, created};
use super::edit::parse_value;
use crate::annotation_service::Visible;
use crate::annotation_service::{invalid, no_such_item};
use crate::problem::Problem;
use relief_annotation::{
    Change, Geometry, Item, ItemId, Method, Placement, RegionSummary, Set, State, Versioned,
};
use relief_dicom::write_seg_nrrd;
use relief_session::{JobError, Waiting, region_of_content, while_awaited};
use relief_volume::{Mask, Segment};

/// Largest body.
pub(super) const MOST_BYTES: usize = 256 << 10;
/// Media type of a region's content.
const REGION: &str = "application/x-seg-nrrd";
/// The label of a region in its content.
pub(super) const LABEL: u16 = 1;

/// The keys of a body that do not describe the structure.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Attribution {
    name: Option<String>,
    set: Option<String>,
    author: Option<String>,
    reason: String,
}

impl Attribution {
    const KEYS: [&str; 4] = ["name", "set", "author", "reason"];
}

/// Author, name and set of a new item.
pub(super) struct NewStructure {
    pub(super) asked: EditRequest,
    author: String,
    reason: String,
    pub(super) name: String,
    set: String,
}

impl NewStructure {
    /// The order of a body, and its other members.
    ///
    /// # Errors
    /// When a key of the body is malformed or unknown, or a name is invalid.
    pub(super) fn read<T: DeserializeOwned>(
        asked: EditRequest,
        JsonBody(mut body): JsonBody<MOST_BYTES>,
        usual_name: &str,
    ) -> Result<(Self, T), Problem> {
        let mut credit = Map::new();
        if let Some(body) = body.as_object_mut() {
            credit.extend(Attribution::KEYS.iter().filter_map(|key| body.remove_entry(*key)));
        }
        let what = parse_value(body)?;
        let Attribution { name, set, author, reason } = parse_value(Value::Object(credit))?;
        let author = asked.author(author)?;
        let name = name.unwrap_or_else(|| usual_name.to_owned());
        let set = set.unwrap_or_else(|| Set::DEFAULT.to_owned());
        // Before the work.
        let item = Item { set: set.clone(), ..item(&name, &author)? };
        item.validate().map_err(|error| invalid(&error))?;
        Ok((Self { asked, author, reason, name, set }, what))
    }

    /// Makes an item of a geometry.
    pub(super) async fn create(self, geometry: Geometry) -> Result<Response, Problem> {
        let placement = Placement { method: Method::Computed, device: None, camera: None, snapped_mm: None };
        let item = Item {
            set: self.set.clone(),
            state: State::Defined,
            geometry: Some(geometry),
            placement: Some(placement),
            ..item(&self.name, &self.author)?
        };
        self.change(Change::Create { item: Box::new(item) }).await
    }

    pub(super) async fn change(self, change: Change) -> Result<Response, Problem> {
        let events = self.asked.edit(&self.author, &self.reason, vec![change]).await?;
        Ok(created(&events))
    }

    /// An item that the author sees.
    pub(super) async fn find(&self, id: ItemId) -> Result<Arc<Versioned>, Problem> {
        let mut found = self.find_all(&[id]).await?;
        found.pop().ok_or_else(|| no_such_item(&id))
    }

    /// Items that the author sees, in this order.
    pub(super) async fn find_all(&self, ids: &[ItemId]) -> Result<Vec<Arc<Versioned>>, Problem> {
        let snapshot = self.asked.annotations.snapshot(&self.asked.entry.frame_of_reference()).await?;
        let visible = Visible::new(&snapshot.sets, Some(&self.author));
        let known = |id: &ItemId| {
            let known = snapshot.get(*id).filter(|known| visible.sees(&known.item.set));
            known.cloned().ok_or_else(|| no_such_item(id))
        };
        ids.iter().map(known).collect()
    }

    /// Runs a job that uses all cores when its turn has come. The job learns when the client
    /// leaves.
    pub(super) async fn work<T: Send + 'static>(
        &self,
        what: &'static str,
        job: impl FnOnce(&Waiting) -> Result<T, Problem> + Send + 'static,
    ) -> Result<T, Problem> {
        let place = Arc::clone(&self.asked.annotations.structures).acquire_owned().await;
        let place = place.map_err(|_| JobError::Closed { what })?;
        while_awaited(place, what, job).await
    }

    /// Keeps the voxels of a region.
    pub(super) async fn keep(&self, mask: Mask, rgb: Option<[f64; 3]>) -> Result<Geometry, Problem> {
        let (voxels, volume_ml) = (mask.voxels(), mask.volume_ml());
        if voxels == 0 {
            let detail = "the region would have no voxel";
            return Err(Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "nothing-there", detail));
        }
        let bytes = self.file_of(mask, rgb).await?;
        let content = self.asked.keep_content(REGION, &bytes).await?;
        Ok(Geometry::Region(RegionSummary { content, label: LABEL, voxels, volume_ml }))
    }

    /// The voxels of a region as a file, whose label is [`LABEL`].
    pub(super) async fn file_of(&self, mask: Mask, rgb: Option<[f64; 3]>) -> Result<Vec<u8>, Problem> {
        let segment = Segment::new(LABEL, Some(&self.name), rgb);
        let job = move |_: &Waiting| {
            write_seg_nrrd(&mask.to_labels(segment))
                .map_err(|error| Problem::internal("writing a region", error))
        };
        self.work("writing a region", job).await
    }

    /// The voxels of a region.
    pub(super) async fn voxels(&self, region: &RegionSummary) -> Result<Mask, Problem> {
        let (_, bytes) = self.asked.annotations.store.content(&region.content).await?;
        let label = region.label;
        let job =
            move |_: &Waiting| region_of_content(&bytes, label).map_err(|reason| unusable("region", &reason));
        self.work("reading a region", job).await
    }
}

fn item(name: &str, author: &str) -> Result<Item, Problem> {
    Item::new(name, author, None).map_err(|error| Problem::internal("drawing a random id", error))
}

pub(super) fn unusable(path: &str, reason: &impl std::fmt::Display) -> Problem {
    Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "unusable", reason).with("path", path)
}

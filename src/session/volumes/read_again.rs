//! Voxels that were evicted are read again.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use super::error::ReadError;
use super::{VolumeEntry, Volumes};
use crate::JobError;
use crate::blocking::on_blocking_thread;
use relief_volume::Volume;

/// A volume with its voxels, which are read again after an eviction.
pub(crate) async fn voxels(volumes: &Volumes, entry: &VolumeEntry) -> Result<Volume, ReadError> {
    const WHAT: &str = "reading the series again";
    let residents = volumes.residents();
    residents.touch(&entry.voxels);
    if let Some(volume) = entry.voxels.get() {
        return Ok(volume);
    }
    let permit = Arc::clone(&residents.reading).acquire_owned().await;
    let permit = permit.map_err(|_| JobError::Closed { what: WHAT })?;
    // Another request may have read it while this one waited for its turn.
    if let Some(volume) = entry.voxels.get() {
        return Ok(volume);
    }
    let reader = entry.voxels.reader.clone().ok_or(ReadError::NoReader)?;
    volumes.make_room(entry.memory_bytes())?;
    let read = on_blocking_thread(permit, WHAT, move || {
        let volume = reader()?;
        // These take as long as reading: not on an async thread.
        let _ = (volume.content_hash(), volume.without_table());
        Ok(volume)
    });
    let volume = read.await?.map_err(ReadError::Reader)?;
    if volume.content_hash() != entry.hash {
        return Err(ReadError::Changed);
    }
    residents.reads.fetch_add(1, Ordering::Relaxed);
    *entry.voxels.lock() = Some(volume.clone());
    Ok(volume)
}

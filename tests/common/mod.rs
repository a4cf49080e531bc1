//! Shared by the tests: the software adapter, the location of real data, and messages if either is
//! missing.
//!
//! Data stay outside of the repository, in `../shared/data`; archives are unpacked once into
//! `.relief/data`.
#![allow(dead_code, reason = "each test binary uses a part of this")]
#![allow(clippy::print_stderr, reason = "a test that cannot run says so aloud")]

pub(crate) mod child;
pub(crate) mod ffmpeg;
pub(crate) mod hostile;

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Arc, LazyLock, Mutex, OnceLock};

use relief_render::{AdapterChoice, Gpu};
use relief_volume::{Phantom, PhantomKind, PhantomRecipe, Volume};

/// The software adapter, or `None` after saying aloud that `what` was not tested.
///
/// # Panics
/// Without an adapter, if `RELIEF_REQUIRE_ADAPTER` is set.
pub(crate) fn software_adapter(what: &str) -> Option<Gpu> {
    match Gpu::open(&AdapterChoice::Software) {
        Ok(gpu) => Some(gpu),
        Err(error) if std::env::var_os("RELIEF_REQUIRE_ADAPTER").is_some() => {
            panic!("RELIEF_REQUIRE_ADAPTER is set: {error}")
        }
        Err(_) => {
            eprintln!("SKIPPED: {what} (no software graphics adapter)");
            None
        }
    }
}

/// The phantom of a recipe, made once per test program. Two tests that need it at the same time
/// wait for one computation.
pub(crate) fn phantom(recipe: PhantomRecipe) -> Arc<Phantom> {
    type Entry = Arc<OnceLock<Arc<Phantom>>>;
    static MADE: LazyLock<Mutex<HashMap<PhantomRecipe, Entry>>> = LazyLock::new(Mutex::default);
    let entry = Arc::clone(MADE.lock().expect("no test panics here").entry(recipe).or_default());
    Arc::clone(entry.get_or_init(|| Arc::new(recipe.make())))
}

/// The volume of a phantom of this kind and size; see [`phantom`].
pub(crate) fn volume(kind: PhantomKind, size: usize) -> Volume {
    phantom(PhantomRecipe::new(kind).with_size(size).expect("an allowed size")).volume.clone()
}

/// The folder of real data, or `None` after saying aloud that `what` was not tested.
pub(crate) fn shared_data(what: &str) -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("UNAVAILABLE: {what} (../shared/data is not there)");
    None
}

/// The folder that `NAME.tar.xz` unpacks to, unpacked once and then kept.
///
/// # Panics
/// When the archive cannot be unpacked: data that are there must be usable.
pub(crate) fn unpacked(what: &str, name: &str) -> Option<PathBuf> {
    let archive = shared_data(what)?.join(format!("{name}.tar.xz"));
    let cache = Path::new(env!("CARGO_MANIFEST_DIR")).join(".relief/data");
    let folder = cache.join(name);
    if folder.is_dir() {
        return Some(folder);
    }
    std::fs::create_dir_all(&cache).expect("the cache folder can be made");
    // Tests run side by side: each unpacks for itself, the first to finish moves its folder into
    // place.
    let own = tempfile::Builder::new().prefix(".unpacking-").tempdir_in(&cache).expect("a temporary folder");
    let status = Command::new("tar").arg("xJf").arg(&archive).arg("-C").arg(own.path()).status();
    assert!(status.expect("tar is installed").success(), "tar cannot unpack {}", archive.display());
    if std::fs::rename(own.path().join(name), &folder).is_err() {
        assert!(folder.is_dir(), "{} does not hold {name}/", archive.display());
    }
    Some(folder)
}

/// A JSON file of the real data.
///
/// # Panics
/// When it cannot be read.
pub(crate) fn facts(data: &Path, name: &str) -> serde_json::Value {
    let path = data.join(name);
    let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// An array of numbers from JSON.
///
/// # Panics
/// When it is something else.
pub(crate) fn numbers(value: &serde_json::Value) -> Vec<f64> {
    let array = value.as_array().unwrap_or_else(|| panic!("not an array: {value}"));
    array.iter().map(|number| number.as_f64().unwrap_or_else(|| panic!("not a number: {number}"))).collect()
}

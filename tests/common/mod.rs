//! Shared by the tests: the software adapter, the location of real data, and messages if either is
//! missing.
//!
//! Data stay outside of the repository, in `../shared/data` or, by `scripts/setup-samples`, in
//! `.relief/samples`; archives are unpacked once into
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

fn in_project(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// The folder of real data: `../shared/data`, else the samples of `scripts/setup-samples` if they have all
/// `needed` paths. Otherwise prints that `what` was not tested, and returns `None`.
pub(crate) fn shared_data(what: &str, needed: &[&str]) -> Option<PathBuf> {
    let [shared, samples] = ["../shared/data", ".relief/samples"].map(in_project);
    if shared.is_dir() {
        return Some(shared);
    }
    let missing: Vec<&str> = needed.iter().copied().filter(|path| !samples.join(path).exists()).collect();
    if missing.is_empty() {
        return Some(samples);
    }
    let missing = missing.join(", ");
    if samples.is_dir() {
        eprintln!(
            "UNAVAILABLE: {what} ({missing}: in no package of scripts/setup-samples, and ../shared/data is not there)"
        );
    } else {
        eprintln!(
            "UNAVAILABLE: {what} (neither ../shared/data nor the samples of scripts/setup-samples are there)"
        );
    }
    None
}

/// The first available series of `names`, for tests that need a real series but no particular one.
pub(crate) fn any_series(what: &str, names: &[&str]) -> Option<PathBuf> {
    let [shared, samples] = ["../shared/data", ".relief/samples"].map(in_project);
    let name = names.iter().find(|name| shared.is_dir() || samples.join(name).is_dir()).or(names.first())?;
    unpacked(what, name, &[])
}

/// The folder of a series or archive: `NAME.tar.xz` of the shared data, unpacked once and then kept, or the
/// samples' folder `NAME` if it has all `needed` paths.
///
/// # Panics
/// When the archive cannot be unpacked: data that are there must be usable.
pub(crate) fn unpacked(what: &str, name: &str, needed: &[&str]) -> Option<PathBuf> {
    let inside: Vec<String> = needed.iter().map(|path| format!("{name}/{path}")).collect();
    let needed: Vec<&str> = inside.iter().map(String::as_str).chain([name]).collect();
    let data = shared_data(what, &needed)?;
    let archive = data.join(format!("{name}.tar.xz"));
    if !archive.is_file() && data.join(name).is_dir() {
        return Some(data.join(name));
    }
    let cache = in_project(".relief/data");
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

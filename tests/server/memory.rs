//! Voxels of several series in main memory: they are evicted and read again, and errors are
//! reported.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use relief_server::Config;
use relief_session::{LoadedVolume, QueueConfig, VolumeReader};
use relief_volume::{Grid, Volume};

use crate::server::stage::{Stage, cube};

/// Bytes of the voxels of each volume here.
const EACH: u64 = 128;

fn marked(mark: i16) -> Volume {
    let grid = Grid::axis_aligned([4; 3], [10.0; 3], [-15.0; 3]).unwrap();
    Volume::new(grid, vec![mark; 64]).unwrap()
}

fn loaded(volume: Volume) -> LoadedVolume {
    LoadedVolume { volume, warnings: Vec::new(), identity: None, reference: None, labels: None }
}

/// A server of three series under a limit, how often each was read again, and the paths of their
/// frames.
fn three(limit: u64) -> (Stage, Arc<[AtomicUsize; 3]>, [String; 3]) {
    let stage = Stage::empty(Config { memory_bytes: limit, ..Config::default() }, QueueConfig::default());
    let reads = Arc::new([0, 0, 0].map(AtomicUsize::new));
    let frames = [0, 1, 2].map(|i: usize| {
        let volume = marked(i as i16);
        let path = format!("/v1/volumes/{}/frame?layout=color&size_px=16,12", volume.content_hash().short());
        let counted = Arc::clone(&reads);
        let reader: VolumeReader = Arc::new(move || {
            counted[i].fetch_add(1, Ordering::SeqCst);
            Ok(marked(i as i16))
        });
        stage.server.add_series(loaded(volume), reader).unwrap();
        path
    });
    (stage, reads, frames)
}

async fn metric(stage: &Stage, name: &str) -> u64 {
    let answer = stage.get("/metrics").await;
    let value = answer.text().lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
    value.unwrap_or_else(|| panic!("no {name}")).parse().unwrap()
}

/// Invariant: Volumes stay within the memory limits of host and adapter: the least recently used is
/// evicted, and a volume that cannot fit is refused by its dimensions.
#[tokio::test]
async fn of_three_series_under_a_limit_for_two_the_least_recently_shown_goes_and_comes_back() {
    let (stage, reads, frames) = three(2 * EACH);
    let counts = || [0, 1, 2].map(|i| reads[i].load(Ordering::SeqCst));
    assert_eq!(metric(&stage, "relief_memory_evictions_total").await, 1, "the first went for the third");
    for (azimuth, shown, read) in [
        (1, 1, [0, 0, 0]),
        (2, 2, [0, 0, 0]),
        (3, 0, [1, 0, 0]),
        (4, 2, [1, 0, 0]),
        (5, 1, [1, 1, 0]),
        (6, 2, [1, 1, 0]),
    ] {
        let answer = stage.get(&format!("{}&azimuth_deg={azimuth}", frames[shown])).await;
        assert_eq!(answer.status, 200, "{}", answer.text());
        assert_eq!(counts(), read, "after {azimuth}");
        assert!(metric(&stage, "relief_memory_bytes").await <= 2 * EACH);
    }
    assert_eq!(metric(&stage, "relief_series_reads_total").await, 2);
    assert_eq!(metric(&stage, "relief_memory_limit_bytes").await, 2 * EACH);
    // An evicted volume is still described.
    let listed = stage.get("/v1/volumes").await.json();
    let ranges: Vec<_> =
        listed["volumes"].as_array().unwrap().iter().map(|v| v["hu_range"].clone()).collect();
    assert_eq!(ranges, [[0, 0], [1, 1], [2, 2]].map(|range| serde_json::json!(range)));
}

#[tokio::test]
async fn a_volume_beyond_the_budget_is_refused_with_needed_and_free_bytes() {
    let stage = Stage::empty(Config { memory_bytes: 2 * EACH, ..Config::default() }, QueueConfig::default());
    stage.server.add_volume(loaded(cube())); // stays
    let full = stage.server.make_room(EACH + 1).unwrap_err();
    assert_eq!((full.needed, full.available), (EACH + 1, EACH));
    assert!(full.to_string().contains("--memory"), "{full}");
    stage.server.make_room(EACH).unwrap();
    stage.server.add_series(loaded(marked(1)), Arc::new(|| Ok(marked(1)))).unwrap();
    // The one that can go makes way for one that stays.
    stage.server.add_volume(loaded(marked(2)));
    assert_eq!(metric(&stage, "relief_memory_bytes").await, 2 * EACH);
    let path = format!("/v1/volumes/{}/frame?layout=color&size_px=16,12", marked(1).content_hash().short());
    let problem = stage.get(&path).await.problem(507);
    assert_eq!(problem["type"], "urn:relief:problem:memory-full");
    assert_eq!((&problem["needed_bytes"], &problem["available_bytes"]), (&EACH.into(), &0.into()));
}

#[tokio::test]
async fn a_series_that_changed_or_cannot_be_read_again_is_a_problem_that_names_no_file() {
    let limit = Config { memory_bytes: EACH, ..Config::default() };
    let stage = Stage::empty(limit, QueueConfig::default());
    let changed: VolumeReader = Arc::new(|| Ok(marked(9)));
    let gone: VolumeReader = Arc::new(|| Err("secret/patient-name.dcm is gone".into()));
    for (mark, reader) in [(1, changed), (2, gone), (3, Arc::new(|| Ok(marked(3))) as VolumeReader)] {
        stage.server.add_series(loaded(marked(mark)), reader).unwrap();
    }
    let path = |mark| {
        format!("/v1/volumes/{}/frame?size_px=16,12&layout=color", marked(mark).content_hash().short())
    };
    assert_eq!(stage.get(&path(1)).await.problem(409)["type"], "urn:relief:problem:series-changed");
    let gone = stage.get(&path(2)).await;
    gone.problem(500);
    assert!(!gone.text().contains("secret"), "{}", gone.text());
    assert_eq!(stage.get(&path(3)).await.status, 200, "others are served");
}

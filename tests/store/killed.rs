//! `kill -9` under load: acknowledged changes are there, no change is partial, and the log opens
//! every time.
//!
//! The victim is this test program itself: it writes, and prints the acknowledged edits.
//! `scripts/soak-store` does the same a thousand times.

use std::collections::HashMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use relief_annotation::{Event, EventKind, Item};
use relief_store::{LogFilter, Store, StoreError};

use crate::store::made::{create, delete, edit, named, point, update};

/// Where the victim finds the log that it shall write to.
const PLACE: &str = "RELIEF_STORE_VICTIM";
/// How often the soak kills.
const KILLS: &str = "RELIEF_STORE_KILLS";
/// Writers in a victim, side by side.
const WRITERS: usize = 4;
/// Kills after which a new log is begun: so that also one that is being made is hit.
const KILLS_A_LOG: usize = 25;
const LONGEST_LIFE_MS: u64 = 350;

/// Writes until it is killed, or until the log refuses, which it says.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "the victim of the others"]
async fn victim() {
    let Ok(place) = std::env::var(PLACE) else { return };
    let store = match Store::open(&place).await {
        Ok(store) => store,
        Err(error) => return say(&format!("refused {error}")),
    };
    let mut writers = Vec::new();
    for writer in 0..WRITERS {
        writers.push(tokio::spawn(write(store.clone(), format!("writer {writer}"))));
    }
    for writer in writers {
        let error = writer.await.unwrap();
        say(&format!("refused {error}"));
    }
}

/// Edits of one to twelve changes, contents of many pages, undo and redo, for ever.
async fn write(store: Store, author: String) -> StoreError {
    for round in 0_usize.. {
        let count = 1 + round * 7 % 12;
        let items: Vec<Item> = (0..count).map(|i| point(&format!("{round}.{i}"), i as f64 / 3.0)).collect();
        let mut edits = vec![items.iter().map(create).collect::<Vec<_>>()];
        edits.push(items.iter().map(|item| update(&named(item, "moved"), 1)).collect());
        if round % 4 == 3 {
            edits.push(items.iter().map(|item| delete(item.id, 2)).collect());
        }
        for changes in edits {
            match store.apply(&edit(&author, changes)).await {
                Ok(events) => acknowledge(&events),
                Err(error) => return error,
            }
        }
        let bytes: Vec<u8> = author.bytes().cycle().take(round * 1009 % 60_000).collect();
        if let Err(error) = store.put_content("text/plain", &bytes).await {
            return error;
        }
        for step in
            [store.undo(&author, "").await, store.redo(&author, "").await, store.undo(&author, "").await]
        {
            match step {
                Ok(events) => acknowledge(&events),
                Err(error) => return error,
            }
        }
    }
    StoreError::NothingToUndo
}

/// One line for an edit: it is whole or it was never said. Written past the test harness, which
/// would keep it.
fn acknowledge(events: &[Event]) {
    let reported: Vec<String> =
        events.iter().map(|event| format!("{} {} {}", event.seq, event.id, event.version)).collect();
    say(&format!("done {}", reported.join(",")));
}

fn say(line: &str) {
    std::io::stdout().write_all(format!("{line}\n").as_bytes()).unwrap();
}

fn start(place: &str, limit_kib: Option<u64>) -> Child {
    let program = std::env::current_exe().unwrap();
    let (_, module) = module_path!().split_once("::").unwrap();
    let victim = format!("{module}::victim");
    let arguments = [&victim, "--exact", "--ignored", "--nocapture"];
    let mut command = match limit_kib {
        None => Command::new(program),
        Some(kib) => {
            // A file that must not grow further is as good as a full disk. The signal that goes
            // with it is ignored.
            let mut shell = Command::new("sh");
            let limited = format!("trap '' XFSZ; ulimit -f {}; exec \"$0\" \"$@\"", kib * 2);
            shell.arg("-c").arg(limited).arg(program);
            shell
        }
    };
    command.args(arguments).env(PLACE, place).stdin(Stdio::null()).stdout(Stdio::piped());
    command.stderr(Stdio::null()).spawn().unwrap()
}

/// The victim's complete output lines: events by number, and refusals.
fn said(output: &str) -> (HashMap<u64, (String, u64)>, Vec<String>) {
    let (mut acknowledged, mut refused) = (HashMap::new(), Vec::new());
    for line in output.split_inclusive('\n').filter_map(|line| line.strip_suffix('\n')) {
        if let Some(events) = line.strip_prefix("done ") {
            for event in events.split(',') {
                let [seq, id, version] = event.split(' ').collect::<Vec<_>>().try_into().unwrap();
                acknowledged.insert(seq.parse().unwrap(), (id.to_owned(), version.parse().unwrap()));
            }
        }
        refused.extend(line.strip_prefix("refused ").map(str::to_owned));
    }
    (acknowledged, refused)
}

/// Looks at the log after a victim's end: whole, and all that was acknowledged is in it.
async fn look(place: &str, after: u64, acknowledged: &HashMap<u64, (String, u64)>) -> u64 {
    let store = Store::open(place).await.unwrap();
    let checked = store.check().await.unwrap();
    let log = store.log(&LogFilter { after, ..LogFilter::default() }).await.unwrap();
    let found: HashMap<u64, (String, u64)> =
        log.iter().map(|event| (event.seq, (event.id.to_string(), event.version))).collect();
    for (seq, event) in acknowledged {
        assert_eq!(found.get(seq), Some(event), "event {seq} was acknowledged");
    }
    // A partial edit would have fewer events than its undo or its sisters: all events of a round
    // have the same number, as the rounds of the victim do.
    for edit in log.chunk_by(|a, b| a.edit == b.edit).filter(|edit| edit[0].kind == EventKind::Do) {
        let item = edit[0].item.as_ref().map(|item| item.name.clone()).unwrap_or_default();
        if let Some((round, _)) = item.split_once('.') {
            let round: usize = round.parse().unwrap();
            assert_eq!(edit.len(), 1 + round * 7 % 12, "edit {} is whole", edit[0].edit);
        }
    }
    store.close().await;
    checked.events
}

/// Kills so often; gives the number of acknowledged events.
fn kill(kills: usize, folder: &Path) -> usize {
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let (mut total, mut events, mut seed) = (0, 0, u64::from(std::process::id()) | 1);
    for number in 0..kills {
        let place = folder.join(format!("{}.db", number / KILLS_A_LOG));
        let place = place.to_str().unwrap();
        if number % KILLS_A_LOG == 0 {
            events = 0;
        }
        let mut victim = start(place, None);
        // Marsaglia's xorshift, for random moments.
        seed ^= seed << 13;
        seed ^= seed >> 7;
        seed ^= seed << 17;
        let mut said_so_far = BufReader::new(victim.stdout.take().unwrap());
        let mut output = String::new();
        // Every other one is killed after it has written, however slow the machine is.
        if number % 2 == 1 {
            while !output.contains("done ") && said_so_far.read_line(&mut output).unwrap() > 0 {}
        }
        std::thread::sleep(Duration::from_millis(seed % LONGEST_LIFE_MS));
        victim.kill().unwrap(); // SIGKILL
        said_so_far.read_to_string(&mut output).unwrap();
        victim.wait().unwrap();
        let (acknowledged, refused) = said(&output);
        assert!(refused.is_empty(), "kill {number}: {refused:?}");
        total += acknowledged.len();
        if !Path::new(place).exists() {
            continue; // killed before it had made one
        }
        events = runtime.block_on(look(place, events, &acknowledged));
        if number % 100 == 99 {
            eprintln!("{} kills, {total} events acknowledged, {events} in the newest log", number + 1);
        }
    }
    total
}

/// Invariant: An acknowledged edit is durable, and no edit is stored partially, whenever the
/// process is killed.
#[cfg(unix)]
#[test]
fn acknowledged_edits_survive_a_kill() {
    let folder = tempfile::tempdir().unwrap();
    let total = kill(20, folder.path());
    assert!(total >= 10, "{total} events: every other victim acknowledges one at least");
}

#[cfg(unix)]
#[test]
#[ignore = "long: scripts/soak-store"]
fn soak() {
    let kills = std::env::var(KILLS).map_or(1000, |kills| kills.parse().unwrap());
    let folder = tempfile::tempdir().unwrap();
    let total = kill(kills, folder.path());
    eprintln!(
        "{kills} kills, {total} acknowledged events, none lost, no edit half written, every log opened"
    );
}

/// Invariant: An acknowledged edit is durable, and no edit is stored partially, whenever the
/// process is killed.
///
/// The file system refuses at some point: the log says so, and nothing that was acknowledged is
/// lost.
#[cfg(unix)]
#[test]
fn acknowledged_edits_survive_a_full_disk() {
    let folder = tempfile::tempdir().unwrap();
    let runtime = tokio::runtime::Runtime::new().unwrap();
    for limit_kib in [150, 700, 2000] {
        let place = folder.path().join(format!("{limit_kib}.db"));
        let place = place.to_str().unwrap();
        let output = start(place, Some(limit_kib)).wait_with_output().unwrap();
        let (acknowledged, refused) = said(&String::from_utf8(output.stdout).unwrap());
        let plain = |error: &String| error.contains("cannot reach the log") || error.contains("no room");
        assert!(refused.len() == WRITERS && refused.iter().all(plain), "{limit_kib} KiB: {refused:?}");
        assert!(!acknowledged.is_empty());
        runtime.block_on(look(place, 0, &acknowledged));
    }
}

//! Jobs through a queue in a real NATS server: no job is lost or done twice when processes are
//! killed.

use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use super::services::Nats;
use super::*;

/// A worker process and its output.
struct Worker {
    process: Child,
    errors: PathBuf,
}

impl Worker {
    fn start(archive: &Archive, nats: &Nats, out: &str, more: &[&str]) -> Self {
        Self::telling(archive, nats, out, more, "warn")
    }

    /// One with more detailed output.
    fn telling(archive: &Archive, nats: &Nats, out: &str, more: &[&str], log: &str) -> Self {
        static NUMBER: std::sync::atomic::AtomicU32 = std::sync::atomic::AtomicU32::new(0);
        let number = NUMBER.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        let errors = archive.path(&format!("worker-{number}.log"));
        let process = Command::new(env!("CARGO_BIN_EXE_relief"))
            .args(["batch", "work", "--nats", &nats.url(), "--out", out, "--json"])
            .args(more)
            .env("RELIEF_ADAPTER", "cpu")
            .env("RELIEF_LOG", log)
            .stdout(Stdio::piped())
            .stderr(std::fs::File::create(&errors).unwrap())
            .spawn()
            .unwrap();
        Self { process, errors }
    }

    /// Waits for its end; returns its last output.
    fn end(self) -> (Value, String) {
        let ended = self.process.wait_with_output().unwrap();
        let errors = std::fs::read_to_string(&self.errors).unwrap();
        assert!(ended.status.success(), "{}: {errors}", ended.status);
        (serde_json::from_slice(&ended.stdout).unwrap(), errors)
    }

    #[cfg(unix)]
    fn terminate(&self) {
        assert!(common::child::signal("TERM", self.process.id()));
    }
}

fn submit(archive: &Archive, nats: &Nats) -> Value {
    let manifest = archive.text("jobs.jsonl");
    ok(&relief(&["batch", "submit", "--nats", &nats.url(), "--manifest", &manifest, "--json"]))
}

fn submitted(archive: &Archive, nats: &Nats) -> (u64, u64) {
    let submitted = submit(archive, nats);
    (submitted["submitted"].as_u64().unwrap(), submitted["known"].as_u64().unwrap())
}

fn count(archive: &Archive) -> usize {
    let entries = walkdir::WalkDir::new(archive.path("out")).into_iter().flatten();
    entries.filter(|entry| entry.path().to_string_lossy().ends_with(".color.png")).count()
}

fn await_pictures(archive: &Archive, wanted: usize) {
    let started = Instant::now();
    while count(archive) < wanted {
        assert!(started.elapsed() < Duration::from_secs(120), "{} of {wanted} pictures", count(archive));
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Invariant: Every job of a queue is done, or given up with a reason, whichever process dies.
///
/// Four workers, three of which are killed while they work, one after the other.
#[test]
fn killed_workers_lose_no_job_and_do_none_twice() {
    let what = "queues whose workers are killed";
    let Some(nats) = Nats::start(what, &[]) else { return };
    let archive = Archive::of_phantoms(5);
    ok(&archive.plan(&["--views", "turntable:40"]));
    ok(&archive.run_into("reference", &[]));
    let reference = pictures(&archive.path("reference"));
    assert_eq!(reference.len(), 200);

    assert_eq!(submitted(&archive, &nats), (200, 0));
    assert_eq!(submitted(&archive, &nats), (0, 200), "what waits is not there twice");
    let out = archive.text("out");
    let more = ["--ack-wait", "3", "--idle-exit", "2"];
    let mut workers: Vec<Worker> = (0..4).map(|_| Worker::start(&archive, &nats, &out, &more)).collect();
    for (killed, wanted) in [10, 40, 70].into_iter().enumerate() {
        await_pictures(&archive, wanted);
        let mut random = [0];
        getrandom::fill(&mut random).unwrap();
        let mut victim = workers.remove(usize::from(random[0]) % (4 - killed));
        victim.process.kill().unwrap();
        victim.process.wait().unwrap();
    }
    let left = workers.pop().unwrap().end().0;
    assert_eq!((&left["ended"], &left["failed"], &left["put_off"]), (&"idle".into(), &0.into(), &0.into()));
    let made = files(&archive.path("out"));
    assert!(
        pictures(&archive.path("out")) == reference,
        "200 jobs, none lost, none twice, none half written"
    );
    assert_eq!(made.keys().filter(|name| name.ends_with(".failed.json")).count(), 0);
    let temporary = made.keys().filter(|name| name.contains(".relief-")).count();
    assert!(temporary <= 3 * 4, "at most what the four writers of a killed worker were writing");

    let nothing = Worker::start(&archive, &nats, &out, &["--idle-exit", "1"]).end().0;
    assert_eq!(
        (&nothing["done"], &nothing["skipped"]),
        (&0.into(), &0.into()),
        "the queue is empty: {nothing}"
    );
    // Finished jobs are skipped when they are submitted again.
    std::thread::sleep(Duration::from_secs(2));
    assert_eq!(submitted(&archive, &nats), (200, 0));
    let again = Worker::start(&archive, &nats, &out, &["--idle-exit", "1"]).end().0;
    assert_eq!(
        (&again["done"], &again["skipped"], &again["series_loaded"]),
        (&0.into(), &200.into(), &0.into())
    );
    assert!(files(&archive.path("out")) == made);
}

#[test]
fn a_series_that_is_gone_fails_for_good_and_the_rest_goes_on() {
    let what = "bad series in queues";
    let Some(nats) = Nats::start(what, &[]) else { return };
    let archive = Archive::of_phantoms(3);
    ok(&archive.plan(&["--views", "planes"]));
    let job = archive.jobs().remove(0);
    let path = archive.path(job["series"]["path"].as_str().unwrap());
    let name = job["series"]["name"].as_str().unwrap();
    let aside = archive.path("aside");
    std::fs::rename(&path, &aside).unwrap();
    submit(&archive, &nats);
    let out = archive.text("out");
    let (worked, errors) = Worker::start(&archive, &nats, &out, &["--idle-exit", "1"]).end();
    assert_eq!((&worked["done"], &worked["failed"], &worked["put_off"]), (&6.into(), &3.into(), &0.into()));
    // Consecutive jobs of a series share the loaded volume.
    assert_eq!(worked["series_loaded"], 2);
    assert!(!errors.contains("DOE"), "a folder's name may be a patient's: {errors}");
    let record = archive.path(&format!("out/{name}/axial.failed.json"));
    let reported: Value = serde_json::from_slice(&std::fs::read(&record).unwrap()).unwrap();
    assert_eq!((&reported["kind"], &reported["tries"]), (&"permanent".into(), &1.into()), "{reported}");
    let manifest = archive.text("jobs.jsonl");
    ok(&relief(&["batch", "report", "--manifest", &manifest, "--out", &out]));
    let page = std::fs::read_to_string(archive.path("out/report.html")).unwrap();
    assert!(page.contains("6 of 9 views") && page.contains("Failures"), "{page}");

    // Mended and submitted again, they are done, and no record is left.
    std::fs::rename(&aside, path).unwrap();
    std::thread::sleep(Duration::from_secs(2));
    assert_eq!(submitted(&archive, &nats), (9, 0));
    let worked = Worker::start(&archive, &nats, &out, &["--idle-exit", "1"]).end().0;
    assert_eq!((&worked["done"], &worked["skipped"]), (&3.into(), &6.into()));
    assert!(!record.exists());
}

/// Invariant: Every job of a queue is done, or given up with a reason, whichever process dies.
#[test]
fn temporary_failures_are_retried_a_limited_number_of_times() {
    let what = "jobs of queues that are tried again";
    let Some(nats) = Nats::start(what, &[]) else { return };
    let archive = Archive::of_phantoms(2);
    ok(&archive.plan(&["--views", "planes"]));
    let names: Vec<String> =
        [0, 3].map(|n| archive.jobs()[n]["series"]["name"].as_str().unwrap().to_owned()).into();
    std::fs::create_dir(archive.path("out")).unwrap();
    // A file where the folder of a series is to be: nothing can be written there, not even the
    // record.
    let (first, second) = (archive.path("out").join(&names[0]), archive.path("out").join(&names[1]));
    std::fs::write(&first, b"in the way").unwrap();
    // A folder where a picture is to be: the picture cannot be written, and the record can.
    std::fs::create_dir_all(second.join("axial.color.png/full")).unwrap();
    submit(&archive, &nats);
    let out = archive.text("out");
    let worker = Worker::start(&archive, &nats, &out, &["--idle-exit", "1", "--tries", "2"]);
    await_pictures(&archive, 2);
    std::fs::remove_file(&first).unwrap();
    let (worked, errors) = worker.end();
    assert_eq!((&worked["done"], &worked["failed"]), (&5.into(), &1.into()), "{worked}: {errors}");
    assert!(worked["put_off"].as_u64().unwrap() >= 4, "{worked}: three and one, once or more often");
    let record = std::fs::read(second.join("axial.failed.json")).unwrap();
    let record: Value = serde_json::from_slice(&record).unwrap();
    assert_eq!((&record["kind"], &record["tries"]), (&"retryable".into(), &2.into()), "{record}");
}

/// Invariant: Every job of a queue is done, or given up with a reason, whichever process dies.
///
/// The first job renders for minutes, and its worker is killed.
#[test]
fn a_job_that_kills_its_workers_is_given_up_and_no_other() {
    let what = "jobs of queues that kill their workers";
    let Some(nats) = Nats::start(what, &[]) else { return };
    let archive = Archive::of_phantoms(2);
    let views = archive.text("views.json");
    let endless = r#"{"name": "endless", "scene": {"mode": "mean", "size_px": [2048, 2048], "sample_distance_mm": 0.06}}"#;
    std::fs::write(
        &views,
        format!(r#"[{endless}, {{"name": "one"}}, {{"name": "two", "azimuth_deg": 90}}]"#),
    )
    .unwrap();
    ok(&archive.plan(&["--views", &views]));
    let manifest = std::fs::read_to_string(archive.path("jobs.jsonl")).unwrap();
    let lines: Vec<&str> = manifest.lines().collect();
    let name = archive.jobs()[0]["series"]["name"].as_str().unwrap().to_owned();
    assert_eq!(archive.jobs()[3]["view"], "endless");
    std::fs::write(archive.path("jobs.jsonl"), [&lines[..3], &lines[4..]].concat().join("\n")).unwrap();
    assert_eq!(submitted(&archive, &nats), (5, 0));
    let out = archive.text("out");
    let more = ["--ack-wait", "1", "--tries", "2", "--take", "5", "--idle-exit", "1"];
    let record = archive.path(&format!("out/{name}/endless.failed.json"));
    let tries = || {
        let reported: Value = serde_json::from_slice(&std::fs::read(&record).ok()?).unwrap();
        Some((reported["kind"].as_str().unwrap().to_owned(), reported["tries"].as_u64().unwrap()))
    };
    // The first time leaves no trace: it was one of several.
    for traced in [None, Some(1), Some(2)] {
        let mut worker = Worker::telling(&archive, &nats, &out, &more, "relief=debug");
        let begun = format!("started: {name}/endless");
        let started = Instant::now();
        while !std::fs::read_to_string(&worker.errors).unwrap().contains(&begun) {
            assert!(started.elapsed() < Duration::from_secs(60), "{traced:?}: not begun");
            std::thread::sleep(Duration::from_millis(20));
        }
        worker.process.kill().unwrap();
        worker.process.wait().unwrap();
        assert_eq!(tries(), traced.map(|tries| ("retryable".to_owned(), tries)));
    }
    let (worked, errors) = Worker::start(&archive, &nats, &out, &more).end();
    assert_eq!((&worked["failed"], &worked["put_off"]), (&1.into(), &0.into()), "{worked}: {errors}");
    assert_eq!(tries(), Some(("permanent".to_owned(), 2)));
    assert!(errors.contains("no worker finished it"), "{errors}");
    assert_eq!(pictures(&archive.path("out")).len(), 4, "all others are done");
    let failed = files(&archive.path("out")).into_keys().filter(|name| name.ends_with(".failed.json"));
    assert_eq!(failed.count(), 1);
}

/// Invariant: Every job of a queue is done, or given up with a reason, whichever process dies.
#[test]
fn a_server_that_is_killed_and_started_anew_is_found_again() {
    let what = "queues whose server is killed";
    let Some(mut nats) = Nats::start(what, &[]) else { return };
    let archive = Archive::of_phantoms(3);
    ok(&archive.plan(&["--views", "turntable:40"]));
    ok(&archive.run_into("reference", &[]));
    submit(&archive, &nats);
    let out = archive.text("out");
    let worker = Worker::start(&archive, &nats, &out, &["--idle-exit", "2", "--ack-wait", "3"]);
    await_pictures(&archive, 20);
    nats.kill();
    std::thread::sleep(Duration::from_secs(2));
    nats.restart();
    let (worked, errors) = worker.end();
    assert_eq!((&worked["ended"], &worked["failed"]), (&"idle".into(), &0.into()), "{worked}: {errors}");
    assert!(pictures(&archive.path("out")) == pictures(&archive.path("reference")));
    for (words, times) in [("the connection to the queue is lost", 1), ("the queue is connected again", 1)] {
        assert_eq!(errors.matches(words).count(), times, "{words}: {errors}");
    }
}

#[cfg(unix)]
#[test]
fn a_stopped_worker_finishes_its_job_and_returns_the_rest() {
    let what = "workers that are signalled to stop";
    let Some(nats) = Nats::start(what, &[]) else { return };
    let archive = Archive::of_phantoms(1);
    ok(&archive.plan(&["--views", "turntable:90"]));
    submit(&archive, &nats);
    let out = archive.text("out");
    let worker = Worker::start(&archive, &nats, &out, &["--take", "50", "--ack-wait", "600"]);
    await_pictures(&archive, 5);
    worker.terminate();
    let (worked, errors) = worker.end();
    assert_eq!(worked["ended"], "stopped", "{worked}: {errors}");
    let done = worked["done"].as_u64().unwrap();
    assert_eq!(pictures(&archive.path("out")).len() as u64, done, "what was begun is whole");
    assert!(done < 90, "it was stopped in the middle");
    // Returned jobs are available at once, long before a lease expires, and they do not count as
    // begun.
    let next = Worker::start(&archive, &nats, &out, &["--idle-exit", "1", "--tries", "1"]).end().0;
    assert_eq!((next["done"].as_u64().unwrap(), &next["failed"]), (90 - done, &0.into()), "{next}");
}

/// Invariant: No secret of a queue is shown, and Relief accepts the command lines of the Kubernetes
/// manifests.
#[test]
fn unusable_queues_are_reported_without_secrets() {
    let Some(nats) = Nats::start("access to queues", &["--auth", "s3cret-token"]) else { return };
    let archive = Archive::of_phantoms(1);
    ok(&archive.plan(&["--views", "planes"]));
    let manifest = archive.text("jobs.jsonl");
    let submit = |url: &str, more: &[&str], token: Option<&str>| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_relief"));
        command.args(["batch", "submit", "--nats", url, "--manifest", &manifest]).args(more);
        command
            .env_remove("RELIEF_NATS_TOKEN")
            .env("RELIEF_LOG", "trace")
            .envs(token.map(|token| ("RELIEF_NATS_TOKEN", token)));
        let output = command.output().unwrap();
        let said = String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned();
        assert!(!said.contains("s3cret") && !said.contains("pa55word"), "{said}");
        (output.status.code(), said)
    };
    let url = nats.url();
    let file = archive.text("token");
    std::fs::write(&file, "s3cret-token\n").unwrap();
    assert_eq!(submit(&url, &[], Some("s3cret-token")).0, Some(0));
    assert_eq!(submit(&url, &["--nats-token-file", &file], None).0, Some(0));
    let Some(other) = Nats::start("passwords of queues", &["--user", "anna", "--pass", "s3cret@pa55word"])
    else {
        return;
    };
    let secret = other.url().replace("nats://", "nats://anna:s3cret%40pa55word@");
    assert_eq!(submit(&secret, &[], None).0, Some(0));
    let with_password = url.replace("nats://", "nats://anna:pa55word@");
    for (url, more, reason) in [
        (&*url, &[][..], "authorization violation"),
        (&*with_password, &[], "authorization violation"),
        ("nats://127.0.0.1:1", &[], "cannot connect to the NATS server"),
        ("nats://anna:pa55word@:::", &[], "the address is invalid"),
        ("http://127.0.0.1:4222", &[], "the address is invalid"),
        (&*url, &["--nats-creds", "missing.creds"], "cannot read the credentials"),
        (&*url, &["--stream", "a.b"], "is not a valid stream name"),
    ] {
        let (status, said) = submit(url, more, None);
        assert!(status == Some(1) && said.contains(reason), "{url} {more:?}: {said}");
    }
}

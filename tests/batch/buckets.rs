//! Outputs and series in a bucket of an S3 substitute: the same as in a folder.

use super::services::{Bucket, Nats};
use super::*;
use std::process::Stdio;

fn with_bucket(bucket: &Bucket, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relief"));
    command.args(arguments).env("RELIEF_ADAPTER", "cpu").envs(bucket.environment()).env("NO_PROXY", "*");
    command.output().unwrap()
}

/// The same, with the number of child processes that read series meanwhile.
fn with_readers(bucket: &Bucket, arguments: &[&str]) -> (Output, usize) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relief"));
    command.args(arguments).env("RELIEF_ADAPTER", "cpu").envs(bucket.environment()).env("NO_PROXY", "*");
    let mut process = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut readers = std::collections::BTreeSet::new();
    while process.try_wait().unwrap().is_none() {
        readers.extend(children_of(process.id()).into_iter().filter(|child| {
            let command = std::fs::read(format!("/proc/{child}/cmdline")).unwrap_or_default();
            String::from_utf8_lossy(&command).contains("decode-worker")
        }));
    }
    (process.wait_with_output().unwrap(), readers.len())
}

/// Processes that threads of a process started.
fn children_of(process: u32) -> Vec<u32> {
    let threads = std::fs::read_dir(format!("/proc/{process}/task")).into_iter().flatten().flatten();
    let children = threads.filter_map(|thread| std::fs::read_to_string(thread.path().join("children")).ok());
    children
        .flat_map(|list| list.split_whitespace().filter_map(|id| id.parse().ok()).collect::<Vec<_>>())
        .collect()
}

/// Invariant: A bucket receives the same bytes as a folder.
#[test]
fn a_bucket_gets_what_a_folder_gets_and_done_is_done() {
    let what = "outputs in buckets";
    let Some(bucket) = Bucket::start(what) else { return };
    let archive = Archive::of_phantoms(2);
    ok(&archive.plan(&["--views", "planes"]));
    ok(&archive.run_into("reference", &[]));
    let manifest = archive.text("jobs.jsonl");
    let run = ["batch", "run", "--manifest", &manifest, "--out", "s3://views/a/b", "--json"];
    let ran = ok(&with_bucket(&bucket, &run));
    assert_eq!((&ran["done"], &ran["out"]), (&6.into(), &"s3://views/a/b".into()));
    let reference = pictures(&archive.path("reference"));
    bucket.download(&archive.path("fetched"));
    let made = files(&archive.path("fetched"));
    assert!(made.keys().all(|name| name.starts_with("a/b/")), "{:?}", made.keys());
    let of_jobs =
        made.keys().filter(|name| !name.ends_with("contact-sheet.png") && !name.ends_with("report.html"));
    assert_eq!(of_jobs.count(), 12, "a picture and a record each");
    assert!(pictures(&archive.path("fetched/a/b")) == reference);

    let again = ok(&with_bucket(&bucket, &run));
    assert_eq!(
        (&again["done"], &again["skipped"], &again["series_loaded"]),
        (&0.into(), &6.into(), &0.into())
    );

    // One that is gone, one whose bytes others put there, and one that others put there as it was.
    let names: Vec<&String> = reference.keys().collect();
    std::fs::write(archive.path("same"), &reference[names[2]]).unwrap();
    let alter = "
s3.delete_object(Bucket='views', Key='a/b/' + sys.argv[1])
size = s3.head_object(Bucket='views', Key='a/b/' + sys.argv[2])['ContentLength']
s3.put_object(Bucket='views', Key='a/b/' + sys.argv[2], Body=b'x' * size)
s3.upload_file(sys.argv[4], 'views', 'a/b/' + sys.argv[3])";
    bucket.python(alter, &[names[0], names[1], names[2], &archive.text("same")]);
    let mended = ok(&with_bucket(&bucket, &run));
    assert_eq!((&mended["done"], &mended["skipped"]), (&2.into(), &4.into()));
    bucket.download(&archive.path("mended"));
    assert!(pictures(&archive.path("mended/a/b")) == reference);
}

#[test]
fn workers_of_a_queue_fill_a_bucket() {
    let what = "workers that write into buckets";
    let (Some(bucket), Some(nats)) = (Bucket::start(what), Nats::start(what, &[])) else { return };
    let archive = Archive::of_phantoms(3);
    ok(&archive.plan(&["--views", "turntable:4"]));
    ok(&archive.run_into("reference", &[]));
    std::fs::remove_dir_all(archive.path(archive.jobs()[0]["series"]["path"].as_str().unwrap())).unwrap();
    let (manifest, url) = (archive.text("jobs.jsonl"), nats.url());
    ok(&relief(&["batch", "submit", "--nats", &url, "--manifest", &manifest]));
    let work = ["batch", "work", "--nats", &url, "--out", "s3://views", "--idle-exit", "1", "--json"];
    let worked = ok(&with_bucket(&bucket, &work));
    assert_eq!((&worked["done"], &worked["failed"]), (&8.into(), &4.into()), "{worked}");
    bucket.download(&archive.path("fetched"));
    let (made, reference) = (pictures(&archive.path("fetched")), pictures(&archive.path("reference")));
    assert!(made.len() == 8 && made.iter().all(|(name, bytes)| reference[name] == *bytes));
    let setbacks = files(&archive.path("fetched"));
    assert_eq!(setbacks.keys().filter(|name| name.ends_with(".failed.json")).count(), 4);
}

#[test]
fn unusable_buckets_are_reported_before_rendering() {
    let what = "buckets that are not there";
    let Some(bucket) = Bucket::start(what) else { return };
    let archive = Archive::of_phantoms(1);
    ok(&archive.plan(&["--views", "planes"]));
    let manifest = archive.text("jobs.jsonl");
    let run = |out: &str| with_bucket(&bucket, &["batch", "run", "--manifest", &manifest, "--out", out]);
    for (out, status, reason) in [
        ("s3://missing", 1, "cannot write into s3://missing"),
        ("s3://Views", 2, "is not a valid bucket name"),
    ] {
        let ran = run(out);
        let said = String::from_utf8_lossy(&ran.stderr);
        assert!(ran.status.code() == Some(status) && said.contains(reason), "{said}");
    }
}

/// Invariant: A bucket receives the same bytes as a folder.
#[test]
fn a_report_of_a_bucket_is_in_the_bucket_and_the_same_as_of_a_folder() {
    let what = "reports of buckets";
    let Some(bucket) = Bucket::start(what) else { return };
    let archive = Archive::of_phantoms(2);
    ok(&archive.plan(&["--views", "turntable:4", "--products", "color,depth-png,camera"]));
    ok(&archive.run_into("out", &["--turntable", "apng"]));
    let mut reference = files(&archive.path("out"));
    // As shards leave it: pictures and records, and nothing of all of them.
    let of_all = |name: &str| {
        ["report.html", "contact-sheet.png", "turntable.png", "transforms.json", "dataset.jsonl"]
            .iter()
            .any(|ending| name.ends_with(ending))
            || name.contains("/sparse/")
    };
    let (first, gone) = (archive.jobs().remove(0), "the fourth view");
    let gone_name = format!("{}/turntable-003", first["series"]["name"].as_str().unwrap());
    for (name, bytes) in &reference {
        if !of_all(name) && !name.starts_with(&gone_name) {
            let path = archive.path("bare").join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, bytes).unwrap();
        }
    }
    bucket.upload(&archive.path("bare"), "made/");
    let manifest = archive.text("jobs.jsonl");
    let report = |out: &str| {
        let run = ["batch", "report", "--manifest", &manifest, "--out", out, "--turntable", "apng"];
        with_bucket(&bucket, &run)
    };
    let reported = report("s3://views/made");
    ok(&reported);
    assert_eq!(String::from_utf8_lossy(&reported.stdout).trim(), "s3://views/made/report.html");
    ok(&report(&archive.text("bare")));
    bucket.download(&archive.path("fetched"));
    let fetched = files(&archive.path("fetched/made"));
    assert!(fetched == files(&archive.path("bare")), "{:?}", fetched.keys());
    let page = String::from_utf8(fetched["report.html"].clone()).unwrap();
    assert!(page.contains("7 of 8 views of 2 series"), "without {gone}");
    // The complete series has all files that a run writes for it.
    reference.retain(|name, _| of_all(name) && name.contains('/') && !name.starts_with(&gone_name[..12]));
    assert!(reference.len() >= 6 && reference.iter().all(|(name, bytes)| fetched[name] == *bytes));
    let missing = report("s3://missing/made");
    let said = String::from_utf8_lossy(&missing.stderr);
    assert!(
        missing.status.code() == Some(1) && said.contains("cannot write the report of s3://missing"),
        "{said}"
    );
}

/// Bytes of the series of an archive: of the largest, and of all.
fn sizes(archive: &Archive) -> (u64, u64) {
    let mut each = BTreeMap::new();
    for (name, bytes) in files(&archive.path("series")) {
        *each.entry(name.split('/').next().unwrap().to_owned()).or_insert(0) += bytes.len() as u64;
    }
    (*each.values().max().unwrap(), each.values().sum())
}

/// Invariant: Series in a bucket give the same jobs, pictures, ids and tags as in a folder; cached
/// copies stay within their limit, and their names identify no patient.
#[test]
fn series_in_a_bucket_give_the_jobs_and_pictures_of_those_in_a_folder() {
    let what = "series in buckets";
    let Some(bucket) = Bucket::start(what) else { return };
    let archive = Archive::of_phantoms(3);
    ok(&archive.plan(&["--views", "planes"]));
    ok(&archive.run_into("reference", &[]));
    bucket.upload(&archive.path("series"), "archive/ct/");
    let (largest, all) = sizes(&archive);
    let (manifest, cache) = (archive.text("remote.jsonl"), archive.text("cache"));
    let bound = (largest + 1).to_string();
    assert!(all > largest + 1, "not all of them have room");
    let copies = ["--cache", &cache, "--cache-bytes", &bound];
    let plan = ["batch", "plan", "--root", "s3://views/archive/ct/", "--out", &manifest, "--preset", "bone"];
    let more = ["--size", "64x48", "--products", "color", "--views", "planes", "--json"];
    let planned = with_bucket(&bucket, &[&plan[..], &more, &copies].concat());
    assert_eq!(ok(&planned)["series"], 3, "{}", String::from_utf8_lossy(&planned.stderr));
    let text = std::fs::read_to_string(&manifest).unwrap();
    let keys = |text: &str| -> Vec<String> {
        let jobs = text.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
        jobs.map(|job| job["job"].as_str().unwrap().to_owned()).collect()
    };
    assert_eq!(keys(&text), keys(&std::fs::read_to_string(archive.path("jobs.jsonl")).unwrap()));
    assert!(text.contains("s3://views/archive/ct/DOE^JOHN 0"), "{text}");

    // Fetched, whatever was left in the folder by a program that was killed; and within its bound.
    let remnant = archive.path("cache/.relief-copy-killed");
    std::fs::create_dir_all(remnant.join("files")).unwrap();
    std::fs::write(remnant.join("contents.json"), b"").unwrap();
    let run = |out: &str, more: &[&str]| {
        let out = archive.text(out);
        let run = ["batch", "run", "--manifest", &manifest, "--out", &out, "--json"];
        with_bucket(&bucket, &[&run[..], more].concat())
    };
    let ran = run("out", &copies);
    assert_eq!(ok(&ran)["done"], 9);
    assert!(pictures(&archive.path("out")) == pictures(&archive.path("reference")));
    assert!(!remnant.exists());
    let kept = files(&archive.path("cache"));
    let held: u64 =
        kept.iter().filter(|(name, _)| name.contains("/files/")).map(|(_, b)| b.len() as u64).sum();
    assert!(held > 0 && held <= largest + 1, "{held} bytes of {largest}");
    assert!(
        kept.keys().all(|name| !name.contains("DOE")),
        "names may be those of patients: {:?}",
        kept.keys()
    );
}

/// Invariant: Batches read series of buckets in child processes without rights, and the results are
/// those of reading them in their own process.
#[test]
fn batches_read_series_of_buckets_in_child_processes() {
    let Some(bucket) = Bucket::start("child processes that read series of buckets") else { return };
    let archive = Archive::of_phantoms(2);
    bucket.upload(&archive.path("series"), "ct/");
    let damaged = "s3.put_object(Bucket='views', Key='ct/DOE^JANE/1.dcm', Body=b'\\0' * 128 + b'DICM' + b'\\xff' * 500)";
    bucket.python(damaged, &[]);
    let plan = |name: &str, more: &[&str]| {
        let out = archive.text(name);
        let plan = ["batch", "plan", "--root", "s3://views/ct", "--out", &out, "--preset", "bone"];
        let views =
            ["--where", "slices>=2", "--views", "planes", "--size", "64x48", "--products", "color", "--json"];
        let (output, readers) = with_readers(&bucket, &[&plan[..], &views, more].concat());
        assert_eq!(ok(&output)["series"], 2, "{}", String::from_utf8_lossy(&output.stderr));
        (std::fs::read_to_string(archive.path(name)).unwrap(), readers)
    };
    let (isolated, readers) = plan("isolated.jsonl", &[]);
    assert!(readers >= 2, "{readers} readers of 3 places");
    let (own, readers) = plan("own.jsonl", &["--isolation", "off"]);
    assert_eq!(readers, 0);
    assert_eq!(isolated, own);

    let run = |out: &str, more: &[&str]| {
        let (manifest, folder) = (archive.text("own.jsonl"), archive.text(out));
        let run = ["batch", "run", "--manifest", &manifest, "--out", &folder, "--json"];
        let (output, readers) = with_readers(&bucket, &[&run[..], more].concat());
        assert_eq!(ok(&output)["done"], 6, "{}", String::from_utf8_lossy(&output.stderr));
        readers
    };
    assert!(run("isolated", &[]) >= 1);
    assert_eq!(run("own", &["--isolation", "off"]), 0);
    assert!(pictures(&archive.path("isolated")) == pictures(&archive.path("own")));
}

/// Invariant: Series in a bucket give the same jobs, pictures, ids and tags as in a folder; cached
/// copies stay within their limit, and their names identify no patient.
#[test]
fn copies_and_objects_that_were_altered_are_not_taken_for_what_they_were() {
    let what = "altered copies of series in buckets";
    let Some(bucket) = Bucket::start(what) else { return };
    let archive = Archive::of_phantoms(2);
    bucket.upload(&archive.path("series"), "archive/ct/");
    let (manifest, cache) = (archive.text("remote.jsonl"), archive.text("cache"));
    let plan = ["batch", "plan", "--root", "s3://views/archive/ct", "--out", &manifest, "--preset", "bone"];
    let more = ["--size", "64x48", "--products", "color", "--views", "planes", "--cache", &cache];
    ok(&with_bucket(&bucket, &[&plan[..], &more].concat()));
    let run = |out: &str, more: &[&str]| {
        let out = archive.text(out);
        let run = ["batch", "run", "--manifest", &manifest, "--out", &out, "--json", "--cache", &cache];
        with_bucket(&bucket, &[&run[..], more].concat())
    };
    ok(&run("reference", &[]));
    let kept = files(&archive.path("cache"));

    // A copy that was altered is fetched again.
    let file = kept.keys().find(|name| name.ends_with("files/000003.dcm")).unwrap();
    let mut bytes = kept[file].clone();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(archive.path("cache").join(file), bytes).unwrap();
    let mended = run("again", &[]);
    assert_eq!(ok(&mended)["done"], 6);
    assert!(String::from_utf8_lossy(&mended.stderr).contains("was altered, and is fetched again"));
    assert!(pictures(&archive.path("again")) == pictures(&archive.path("reference")));
    assert!(files(&archive.path("cache"))[file] == kept[file]);

    // An object that was altered in the bucket is refused permanently, and so is one that is too
    // large.
    let alter = "
key = s3.list_objects_v2(Bucket='views', Prefix='archive/ct/DOE^JOHN 1/')['Contents'][0]['Key']
s3.put_object(Bucket='views', Key=key, Body=b'x' * 1000)";
    bucket.python(alter, &[]);
    let refused = failed(&run("altered", &["--cache-bytes", "1000"]));
    assert!(refused.contains("copies of series may have 1000; allow more with --cache-bytes"), "{refused}");
    assert!(refused.contains(" bytes, and") && !refused.contains("DOE"), "{refused}");
    let refused = failed(&run("altered", &[]));
    assert_eq!(refused.matches("files have changed since planning").count(), 3, "{refused}");
}

/// The failures of a run; none of them names a series' folder.
fn failed(output: &Output) -> String {
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(!said.contains("DOE"), "{said}");
    said
}

/// Invariant: No secret of a queue is shown, and Relief accepts the command lines of the Kubernetes
/// manifests.
#[test]
fn buckets_without_series_are_reported_without_secrets() {
    let what = "buckets without series";
    let Some(bucket) = Bucket::start(what) else { return };
    let archive = Archive::of_phantoms(1);
    bucket.python("s3.put_object(Bucket='views', Key='notes/DOE/readme.md', Body=b'nothing')", &[]);
    let plan = |root: &str, endpoint: Option<&str>, more: &[&str]| {
        let out = archive.text("none.jsonl");
        let mut command = Command::new(env!("CARGO_BIN_EXE_relief"));
        command.args(["batch", "plan", "--root", root, "--views", "planes", "--out", &out]).args(more);
        command.envs(bucket.environment()).env("NO_PROXY", "*").env("RELIEF_LOG", "trace");
        command.env("AWS_SECRET_ACCESS_KEY", "s3cret-key").env("AWS_SESSION_TOKEN", "s3cret-token");
        endpoint.map(|endpoint| command.env("AWS_ENDPOINT_URL", endpoint));
        let output = command.output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!said.contains("s3cret"), "{said}");
        assert!(output.status.code() == Some(1) && !archive.path("none.jsonl").exists(), "{said}");
        said
    };
    let denying = refusing_service();
    for (root, endpoint, reason) in [
        ("s3://missing/ct", None, "cannot read s3://missing/ct: there is no such bucket"),
        (
            "s3://views/empty",
            None,
            "cannot read s3://views/empty: there is nothing to read below this prefix",
        ),
        ("s3://views/ct", Some(&*denying), "cannot read s3://views/ct: access is denied"),
        ("s3://views/notes", None, "no CT series under s3://views/notes"),
        ("s3://Views", None, "is not a valid bucket name"),
    ] {
        let said = plan(root, endpoint, &[]);
        assert!(said.contains(reason), "{root}: {said}");
    }
    bucket.upload(&archive.path("series"), "ct/");
    let (_, all) = sizes(&archive);
    let said = plan("s3://views/ct", None, &["--cache-bytes", "1KiB"]);
    let reason = format!("its objects have {all} bytes, and copies of series may have 1024");
    assert!(said.contains(&reason), "{said}");
}

/// The address of a service that denies everything.
fn refusing_service() -> String {
    use std::io::{Read, Write};
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("http://{}", listener.local_addr().unwrap());
    let serve = move || {
        for stream in listener.incoming() {
            let mut stream = stream.unwrap();
            let _ = stream.read(&mut [0; 8192]);
            let body = "<Error><Code>AccessDenied</Code><Message>Access Denied</Message></Error>";
            let head = "HTTP/1.1 403 Forbidden\r\nContent-Type: application/xml\r\nConnection: close";
            let _ = write!(stream, "{head}\r\nContent-Length: {}\r\n\r\n{body}", body.len());
        }
    };
    std::thread::Builder::new().name("denies".to_owned()).spawn(serve).unwrap();
    address
}

/// Invariant: Series in a bucket give the same jobs, pictures, ids and tags as in a folder; cached
/// copies stay within their limit, and their names identify no patient.
///
/// The manifest is sufficient, also for a worker of a queue: series and label maps come from the
/// bucket.
#[test]
fn label_maps_in_a_bucket_are_drawn_by_workers_as_those_of_a_folder() {
    let what = "label maps in buckets";
    let (Some(bucket), Some(nats)) = (Bucket::start(what), Nats::start(what, &[])) else { return };
    let archive = Archive { folder: tempfile::tempdir().unwrap() };
    ok(&relief(&["phantom", "--kind", "head", "--size", "48", "--out", &archive.text("series/head")]));
    bucket.upload(&archive.path("series"), "ct/");
    let labels = ["--views", "sides", "--labels", "{}/labels.seg.nrrd"];
    ok(&archive.plan(&labels));
    ok(&archive.run_into("reference", &[]));
    let manifest = archive.text("remote.jsonl");
    let plan = ["batch", "plan", "--root", "s3://views/ct", "--out", &manifest, "--preset", "bone"];
    ok(&with_bucket(&bucket, &[&plan[..], &["--size", "64x48", "--products", "color"], &labels].concat()));
    std::fs::remove_dir_all(archive.path("series")).unwrap();
    let url = nats.url();
    ok(&relief(&["batch", "submit", "--nats", &url, "--manifest", &manifest]));
    let out = archive.text("out");
    let work = ["batch", "work", "--nats", &url, "--out", &out, "--idle-exit", "1", "--json"];
    let worked = ok(&with_bucket(&bucket, &work));
    assert_eq!((&worked["done"], &worked["series_loaded"]), (&6.into(), &1.into()), "{worked}");
    assert!(pictures(&archive.path("out")) == pictures(&archive.path("reference")));
}

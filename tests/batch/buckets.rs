//! Outputs in a bucket of a stand-in for S3: the bytes that a folder has.

use super::services::{Bucket, Nats};
use super::*;

fn with_bucket(bucket: &Bucket, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relief"));
    command.args(arguments).env("RELIEF_ADAPTER", "software").envs(bucket.environment()).env("NO_PROXY", "*");
    command.output().unwrap()
}

#[test]
fn a_bucket_gets_what_a_folder_gets_and_done_is_done() {
    let what = "outputs in buckets";
    if software_adapter(what).is_none() {
        return;
    }
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
    assert_eq!(made.len(), 12, "a picture and a record each");
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
    if software_adapter(what).is_none() {
        return;
    }
    let (Some(bucket), Some(nats)) = (Bucket::start(what), Nats::start(what, &[])) else { return };
    let archive = Archive::of_phantoms(3);
    ok(&archive.plan(&["--views", "turntable:4"]));
    ok(&archive.run_into("reference", &[]));
    std::fs::remove_dir_all(archive.jobs()[0]["series"]["path"].as_str().unwrap()).unwrap();
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
fn buckets_that_cannot_be_used_are_told_before_anything_is_rendered() {
    let what = "buckets that are not there";
    if software_adapter(what).is_none() {
        return;
    }
    let Some(bucket) = Bucket::start(what) else { return };
    let archive = Archive::of_phantoms(1);
    ok(&archive.plan(&["--views", "planes"]));
    let manifest = archive.text("jobs.jsonl");
    let run = |out: &str| with_bucket(&bucket, &["batch", "run", "--manifest", &manifest, "--out", out]);
    for (out, status, reason) in
        [("s3://missing", 1, "cannot write into s3://missing"), ("s3://Views", 2, "is no name of a bucket")]
    {
        let ran = run(out);
        let said = String::from_utf8_lossy(&ran.stderr);
        assert!(ran.status.code() == Some(status) && said.contains(reason), "{said}");
    }
}

//! Servers of series in one bucket: alike, and like one of folders.

use std::path::Path;

use crate::batch::services::Bucket;
use crate::cluster::stage::{Answer, Process, get, lone, phantom, relief, volumes};

/// A server of a prefix of the bucket.
fn of_bucket(bucket: &Bucket, more: &[&str], errors: &Path) -> (Process, String) {
    let mut command = relief(&["serve", "--listen", "127.0.0.1:0", "--listen-when-loaded"]);
    command.args(["--series", "s3://views/ct"]).args(more).envs(bucket.environment()).env("NO_PROXY", "*");
    command.stderr(std::fs::File::create(errors).unwrap());
    let (process, lines) = Process::start(&mut command);
    (process, lines[0].split_once("http://").unwrap().1.trim_end_matches('/').to_owned())
}

fn bytes_below(folder: &Path) -> u64 {
    let entries = walkdir::WalkDir::new(folder).into_iter().map(Result::unwrap);
    entries.filter(|entry| entry.file_type().is_file()).map(|entry| entry.metadata().unwrap().len()).sum()
}

/// A zip of the files of a folder, without compression.
fn zipped(folder: &Path, zip: &Path) {
    let mut writer = zip::ZipWriter::new(std::fs::File::create(zip).unwrap());
    let options = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    for entry in walkdir::WalkDir::new(folder).sort_by_file_name().into_iter().map(Result::unwrap) {
        if entry.file_type().is_file() {
            writer.start_file(entry.file_name().to_string_lossy(), options).unwrap();
            std::io::copy(&mut std::fs::File::open(entry.path()).unwrap(), &mut writer).unwrap();
        }
    }
    writer.finish().unwrap();
}

/// Invariant: Series in a bucket give the same jobs, pictures, ids and tags as in a folder; cached
/// copies stay within their limit, and their names identify no patient.
#[test]
fn servers_of_one_bucket_give_the_ids_bytes_and_tags_of_one_of_folders() {
    let what = "servers of a bucket";
    let Some(bucket) = Bucket::start(what) else { return };
    let folder = tempfile::tempdir().unwrap();
    let series = ["sphere", "slab", "head"].map(|kind| phantom(folder.path(), kind));
    let largest = series.iter().map(|series| bytes_below(series)).max().unwrap();
    // Two folders, a zip, and one in which nothing is.
    let upload = folder.path().join("upload");
    std::fs::create_dir_all(upload.join("notes")).unwrap();
    std::fs::write(upload.join("notes/readme.md"), "nothing").unwrap();
    std::fs::rename(&series[0], upload.join("sphere")).unwrap();
    std::fs::rename(&series[1], upload.join("slab")).unwrap();
    zipped(&series[2], &upload.join("head.zip"));
    bucket.upload(&upload, "ct/");
    let (_local, local) = lone(&[upload.join("head.zip"), upload.join("slab"), upload.join("sphere")]);

    // One keeps all; the other has room for one volume, and for the copy of one series.
    let (_first, first) = of_bucket(&bucket, &[], &folder.path().join("first.log"));
    let (cache, bytes) = (folder.path().join("cache"), (largest + largest / 4).to_string());
    let cached = ["--memory", "80000", "--cache", cache.to_str().unwrap(), "--cache-bytes", &bytes];
    let errors = folder.path().join("second.log");
    let (_second, second) = of_bucket(&bucket, &cached, &errors);
    let mut ids = volumes(&local);
    ids.sort();
    let sorted = |address: &str| {
        let mut ids = volumes(address);
        ids.sort();
        ids
    };
    assert_eq!(ids.len(), 3);
    assert_eq!((sorted(&first), sorted(&second)), (ids.clone(), ids.clone()));
    for _ in 0..2 {
        for id in &ids {
            let frame = |address: &str| -> Answer {
                get(address, &format!("/v1/volumes/{id}/frame?preset=bone&layout=color&size_px=64,48"), "")
            };
            let [local, first, second] = [&local, &first, &second].map(|address| frame(address));
            assert_eq!(local.status, 200);
            assert!(local.body == first.body && local.body == second.body, "{id}");
            let tag = local.header("etag").unwrap();
            assert_eq!((first.header("etag"), second.header("etag")), (Some(tag), Some(tag)));
        }
    }
    let said = std::fs::read_to_string(&errors).unwrap();
    let warnings: Vec<_> = said.lines().filter(|line| line.starts_with("warning: ")).collect();
    let [warning] = warnings[..] else { panic!("other files beside slices are no defect: {said}") };
    assert!(warning.starts_with("warning: cannot serve 2 of 4 below s3://views/ct: no CT slices"), "{said}");
    assert_eq!(said.matches("; /#volume=").count(), 3, "each volume is named once: {said}");
    let metrics = String::from_utf8(get(&second, "/metrics", "").body).unwrap();
    let reads = metrics.lines().find_map(|line| line.strip_prefix("relief_series_reads_total ")).unwrap();
    assert!(reads.parse::<u32>().unwrap() >= 5, "volumes that went were read again: {reads}");
    let lists = walkdir::WalkDir::new(&cache).into_iter().map(Result::unwrap);
    let lists = lists.filter(|entry| entry.file_name() == "contents.json");
    let lists: u64 = lists.map(|entry| entry.metadata().unwrap().len()).sum();
    assert!(bytes_below(&cache) - lists <= largest + largest / 4);
}

#[test]
fn a_bucket_that_cannot_be_served_ends_the_server_with_the_reason() {
    let what = "servers of buckets that are not there";
    let Some(bucket) = Bucket::start(what) else { return };
    let folder = tempfile::tempdir().unwrap();
    bucket.upload(&phantom(folder.path(), "sphere"), "ct/DOE^JOHN/");
    for (more, reason) in [
        (&["--series", "s3://missing/ct"][..], "there is no such bucket"),
        (&["--series", "s3://views/none"], "there is nothing to read below this prefix"),
        (&["--series", "s3://views/ct", "--cache-bytes", "1000"], "and copies of series may have 1000"),
    ] {
        let mut command = relief(&["serve", "--listen", "127.0.0.1:0", "--listen-when-loaded"]);
        command.args(more).envs(bucket.environment()).env("NO_PROXY", "*");
        let output = command.output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(1) && said.contains(reason), "{said}");
    }
}

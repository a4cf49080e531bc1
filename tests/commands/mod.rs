//! The commands of README and `docs` run as they are written, in their order, in a fresh folder.
//!
//! Before a document begins, its folder has what the document takes for granted: series `head`, `chest`
//! and `abdomen`, an `archive`, files of other tools. Of a command only its port is replaced, and the id
//! of a volume where the document writes `ID`. Commands that need what a test machine has not are in
//! [`EXCLUDED`], with the reason.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::print_stderr, reason = "a test that cannot run says so aloud")]
#![cfg(unix)]

mod blocks;
mod session;
mod world;

use std::path::Path;

use self::blocks::{Block, blocks};
use self::session::Session;
use self::world::World;

/// Parts of commands that are not run, and why.
const EXCLUDED: &[(&str, &str)] = &[
    ("scripts/demo", "installs packages; the demo has a test of its own"),
    ("scripts/test", "runs this test"),
    ("scripts/serve-cluster", "needs nginx and PostgreSQL; tests of clusters run it"),
    ("docker compose", "needs Docker"),
    ("scripts/setup-ipopt", "downloads packages"),
    ("cargo ", "builds"),
    ("scripts/package-python", "builds a wheel; a step of scripts/test does that"),
    ("scripts/package", "builds a release; tests of packages make some of the program under test"),
    ("sudo ", "changes the system; tests of packages install them in a clean Debian"),
    ("pip install .relief", "installs the wheel; a step of scripts/test uses it"),
    ("scripts/compare-views", "renders and measures for a quarter of an hour"),
    ("scripts/compare-depth", "renders and measures for minutes"),
    ("scripts/compare-track", "compares with peers for minutes; the peers have tests"),
    ("relief golden", "is for the project's folder; tests of golden pictures run it"),
    ("s3://", "needs a bucket; tests of batches run it"),
    ("nats://", "needs a queue; tests of batches run it"),
    ("sbatch", "needs Slurm; tests of batches run it"),
    ("/data/", "is for the paths of a cluster"),
    ("hidraw", "needs a Wiimote"),
    ("ct-server", "needs a server in the network"),
    ("relief receive", "runs until it is stopped; tests of archives run it"),
    ("--receive inbox", "is for the addresses of a network; tests of archives run it"),
    ("chromium", "needs a display; tests of pages run a browser"),
    ("survey.jsonl", "needs a Wiimote's recording; tests of calibration simulate one"),
    ("relief annotate accuracy", "takes minutes; scripts/test --all runs it"),
    ("relief track design", "takes minutes; tests run it with few poses"),
    ("relief track experiment", "takes minutes: scripts/test --all runs it once"),
    ("turntable:60", "plans 60 pictures of each series; others are run"),
    ("relief bench", "measures for a minute; tests of the benchmark run it"),
    ("--passes 256", "traces 256 passes; pictures are tested with fewer"),
    ("/studies/STUDY-UID", "needs the UIDs of a series; tests of DICOMweb run it"),
    ("$S/", "needs the UIDs of a series; tests of DICOMweb run it"),
    ("segments.nii.gz", "needs a label map of organs; tests of labels run it"),
    ("surgery.mp4", "needs a film; tests of films make one"),
    ("photo.jpg", "needs a network of another program; tests of networks make one"),
    ("pip install torch", "downloads gigabytes"),
    ("depth-network", "renders and trains for two hours"),
    ("depth.onnx", "needs the trained network's file; tests of networks make one"),
    ("--eyes opentrack", "listens until it is stopped; tests of pages send poses"),
    ("--record session", "records until it is stopped; tests of the client stop it"),
    ("mjpeg", "streams without end"),
    ("liver-1", "needs drawn curves; tests of structures fill some"),
    ("$RELIEF_TOKEN", "needs the token that was printed; tests of identity run it"),
];

/// Invariant: Every command of README and the pages in `docs` runs as written, or has a reason not to.
#[test]
fn every_command_of_the_documents_runs() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let world = World::new();
    let mut unused: Vec<&str> = EXCLUDED.iter().map(|(part, _)| *part).collect();
    let (mut ran, mut failures) = (0, Vec::new());
    for document in documents(root) {
        let mut session = Session::new(&world, root, &document);
        for Block { line, command } in blocks(&std::fs::read_to_string(root.join(&document)).unwrap()) {
            let excluded = EXCLUDED.iter().find(|(part, _)| command.contains(part));
            if let Some((part, _)) = excluded {
                unused.retain(|known| known != part);
                continue;
            }
            let began = std::time::Instant::now();
            if let Err(reason) = session.run(&command) {
                failures.push(format!("{document}:{line}: {command}\n    {reason}"));
            }
            ran += 1;
            eprintln!("{document}:{line}: {:.1} s: {command}", began.elapsed().as_secs_f64());
        }
    }
    assert!(failures.is_empty(), "{} of {ran} commands failed:\n{}", failures.len(), failures.join("\n"));
    assert!(unused.is_empty(), "no document has these any more: {unused:?}");
    assert!(ran > 60, "{ran} commands");
}

/// README first, then the pages, by their names.
fn documents(root: &Path) -> Vec<String> {
    let pages = std::fs::read_dir(root.join("docs")).unwrap().map(|entry| entry.unwrap().file_name());
    let pages = pages.map(|name| format!("docs/{}", name.to_str().unwrap()));
    let mut pages: Vec<String> = pages.filter(|name| name.ends_with(".md")).collect();
    pages.sort();
    pages.insert(0, "README.md".to_owned());
    pages
}

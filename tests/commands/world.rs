//! The files that the documents take for granted: series, an archive, files of other tools. Made
//! once.

use std::path::Path;
use std::process::Command;

use crate::common::any_series;

pub(super) const RELIEF: &str = env!("CARGO_BIN_EXE_relief");

/// Folders and files that every document's folder gets.
pub(super) struct World {
    folder: tempfile::TempDir,
}

impl World {
    pub(super) fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path();
        phantom(path, "head", &["--kind", "head", "--size", "160"]);
        // The first series of the archive is the head that the annotations are of.
        phantom(path, "archive/a", &["--kind", "head", "--size", "160"]);
        phantom(path, "archive/b", &["--kind", "head", "--size", "64", "--seed", "5"]);
        for name in ["archive/a", "archive/b"] {
            std::fs::copy(path.join(name).join("labels.seg.nrrd"), path.join(name).join("organs.seg.nrrd"))
                .unwrap();
        }
        // Few slices: most commands read the series again.
        real(path, "chest", "crlm-ct-1004");
        real(path, "abdomen", "crlm-ct-1004");
        for (name, text) in FILES {
            std::fs::write(path.join(name), text).unwrap();
        }
        for log in ["annotations.db", "ann.db", "head.db"] {
            readers(path, log);
        }
        Self { folder }
    }

    /// Puts all of it into a folder.
    pub(super) fn put_into(&self, folder: &Path) {
        let status = Command::new("cp").arg("-R").arg(self.folder.path().join(".")).arg(folder).status();
        assert!(status.unwrap().success());
    }
}

fn phantom(folder: &Path, name: &str, more: &[&str]) {
    std::fs::create_dir_all(folder.join(name).parent().unwrap()).unwrap();
    let mut command = Command::new(RELIEF);
    let made = command.args(["phantom", "--out", name]).args(more).current_dir(folder).output().unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
}

/// A log with the sets of three readers.
fn readers(folder: &Path, log: &str) {
    for name in ["anna", "ben", "carla"] {
        let place = ["annotate", "--db", log, "import", "skull.mrk.json", "--series", "head"];
        let by = ["--author", name, "--set", name];
        let mut command = Command::new(RELIEF);
        let made = command.args(place).args(by).current_dir(folder).output().unwrap();
        assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    }
}

/// A series of the shared data by the document's name of it; a phantom where the data are missing.
fn real(folder: &Path, name: &str, series: &str) {
    match any_series("the commands of the documents with real series", &[series, "totalseg-abdomen-j2k"]) {
        Some(path) => std::os::unix::fs::symlink(path, folder.join(name)).unwrap(),
        None => phantom(folder, name, &["--kind", "head", "--size", "64", "--seed", "3"]),
    }
}

/// Small files of the reader and of other tools, by name.
const FILES: &[(&str, &str)] = &[
    ("skull.mrk.json", include_str!("skull.mrk.json")),
    ("ears.csv", "label,l,p,s\nleft ear,-70,0,0\nright ear,70,0,0\n"),
    ("skull.json", r#"{"name":"skull","items":[{"name":"Nasion"},{"name":"Vertex"}]}"#),
    ("scene.json", r#"{"transfer":"bone","display":{"factor":80}}"#),
    ("organs.json", r#"{"transfer":"soft-tissue","labels":{"tint":0.8}}"#),
    ("map.json", r#"[{"Name":"Warm","ColorSpace":"RGB","RGBPoints":[0,0,0,0,1,1,0.8,0.6]}]"#),
    ("presets.xml", PRESETS_XML),
];

/// A look as 3D Slicer writes it.
const PRESETS_XML: &str = r#"<MRML><VolumeProperty name="CT-Bones" colorTransfer="8 -1000 0 0 0 1000 1 1 1" scalarOpacity="4 100 0 600 1"/></MRML>"#;

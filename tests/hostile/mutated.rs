//! Damaged files for every reader of bytes from outside: a few of each in every run of the tests,
//! with the checks of `tests/fuzz`. `scripts/fuzz` makes the undamaged ones.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::common::child::run;

#[path = "../fuzz/targets.rs"]
mod targets;

/// Damaged files for each reader.
const FILES: u64 = 300;
/// Most memory of the process that reads them all, MiB.
const MOST_MIB: u64 = 1024;
const SEEDS: &str = "RELIEF_FUZZ_SEEDS";

/// Invariant: Damaged files of any format are read or refused: no reader panics, or takes memory
/// beyond its limit.
#[test]
fn damaged_files_are_read_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let seeds = folder.path().join("seeds");
    std::fs::create_dir(&seeds).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/fuzz");
    let made = Command::new(script)
        .arg("--seeds")
        .arg(&seeds)
        .env("RELIEF_PROGRAM", super::RELIEF)
        .output()
        .unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    // The script needs Python for it, which a small system does not have.
    let slices = std::fs::read_dir(seeds.join("dicom")).unwrap().map(|entry| entry.unwrap().path());
    let slices = slices.enumerate().map(|(at, path)| (format!("{at}.dcm"), std::fs::read(path).unwrap()));
    std::fs::write(seeds.join("zip/a.zip"), crate::common::hostile::zip_of(slices)).unwrap();
    if std::fs::read_dir(seeds.join("codecs")).unwrap().next().is_none() {
        eprintln!(
            "UNAVAILABLE: damaged compressed slices (neither ../shared/data nor the samples of scripts/setup-samples are there)"
        );
    }
    let mut victim = Command::new(std::env::current_exe().unwrap());
    victim.args(["--exact", "hostile::mutated::reading_damaged_files", "--ignored", "--nocapture"]);
    victim.env(SEEDS, &seeds).env("RELIEF_FUZZ_FOLDER", folder.path());
    let ended = run(&mut victim, MOST_MIB);
    assert!(ended.status.success() && ended.stdout.contains("1 passed"), "{}{}", ended.stdout, ended.stderr);
    let readers = targets::READERS.len() as u64;
    assert!(ended.stderr.contains(&format!("{} damaged files", readers * FILES)), "{}", ended.stderr);
}

#[test]
#[ignore = "the process that reads in damaged_files_are_read_or_refused"]
fn reading_damaged_files() {
    let Some(seeds) = std::env::var_os(SEEDS).map(PathBuf::from) else { return };
    let mut count = 0;
    for (number, (name, read)) in (0..).zip(targets::READERS) {
        let seeds = seeds_of(&seeds.join(name));
        let mut random = Random(number);
        for at in 0..FILES {
            let bytes = random.damaged(&seeds[at as usize % seeds.len()]);
            let outcome = catch_unwind(AssertUnwindSafe(|| read(&bytes)));
            if outcome.is_err() {
                let kept = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("damaged-{name}"));
                std::fs::write(&kept, &bytes).unwrap();
                panic!("{name}: file {at} is {}", kept.display());
            }
            count += 1;
        }
    }
    eprintln!("{count} damaged files");
}

/// The undamaged files of a reader, and an empty file.
fn seeds_of(folder: &Path) -> Vec<Vec<u8>> {
    let mut paths: Vec<PathBuf> =
        std::fs::read_dir(folder).into_iter().flatten().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    paths.push(PathBuf::from("/dev/null"));
    paths.into_iter().map(|path| std::fs::read(path).unwrap()).collect()
}

/// SplitMix64 (Steele et al. 2014): the same files in every run.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    /// A number below `end`; 0 if `end` is 0.
    fn below(&mut self, end: usize) -> usize {
        (self.next() % end.max(1) as u64) as usize
    }

    /// The bytes with one to four kinds of damage.
    fn damaged(&mut self, seed: &[u8]) -> Vec<u8> {
        const NUMBERS: [u32; 6] = [0, 1, 0xffff, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff];
        let mut bytes = seed.to_vec();
        for _ in 0..=self.below(4) {
            let at = self.below(bytes.len());
            let end = (at + 1 + self.below(64)).min(bytes.len());
            match self.below(6) {
                0 => bytes.iter_mut().skip(at).take(1).for_each(|byte| *byte ^= 1 << self.below(8)),
                1 => bytes.truncate(at),
                2 => drop(bytes.drain(at.min(end)..end)),
                3 => bytes.extend_from_within(at.min(end)..end),
                4 => {
                    let number = NUMBERS[self.below(NUMBERS.len())].to_le_bytes();
                    bytes.iter_mut().skip(at).zip(number).for_each(|(byte, new)| *byte = new);
                }
                _ => {
                    let new: Vec<u8> = (0..=self.below(64)).map(|_| self.next() as u8).collect();
                    bytes.splice(at..at, new);
                }
            }
        }
        bytes
    }
}

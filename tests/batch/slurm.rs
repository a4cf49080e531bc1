//! `scripts/batch-slurm` in Slurm itself, on one node: shares as tasks of a job array, requeued
//! where that may help.

use super::*;

/// A cluster that ends with the test.
struct Cluster {
    folder: tempfile::TempDir,
    variables: Vec<(String, String)>,
}

const STARTER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scripts/services.d/slurm");
const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scripts/batch-slurm");

impl Cluster {
    fn start() -> Option<Self> {
        if std::env::var_os("RELIEF_SLURM").is_none() && !Path::new("/usr/sbin/slurmctld").exists() {
            eprintln!("SKIPPED: job arrays of Slurm (there is no Slurm; scripts/setup-slurm gets it)");
            return None;
        }
        let mut cluster = Self { folder: tempfile::tempdir().unwrap(), variables: Vec::new() };
        let started = Command::new(STARTER).arg("start").arg(cluster.folder.path()).output().unwrap();
        assert!(started.status.success(), "{}", String::from_utf8_lossy(&started.stderr));
        let reported = String::from_utf8(started.stdout).unwrap();
        let words = reported.trim().trim_start_matches("export ").split(' ');
        cluster.variables = words
            .map(|word| word.split_once('=').unwrap())
            .map(|(a, b)| (a.to_owned(), b.to_owned()))
            .collect();
        Some(cluster)
    }

    /// Submits a batch as an array and waits for its end.
    fn batch(&self, archive: &Archive, program: &str, array: &str) -> (Output, Vec<String>) {
        let logs = archive.path("logs");
        std::fs::create_dir_all(&logs).unwrap();
        let mut command = Command::new("timeout");
        command.args(["180", "sbatch", "--wait", "--array", array, SCRIPT]);
        command.args([archive.text("jobs.jsonl"), archive.text("out")]);
        command.envs(self.variables.iter().cloned()).env("RELIEF", program).env("RELIEF_ADAPTER", "cpu");
        let output = command.current_dir(&logs).output().unwrap();
        let texts = files(&logs).into_values().map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
        (output, texts.collect())
    }
}

impl Drop for Cluster {
    fn drop(&mut self) {
        let _ = Command::new(STARTER).arg("stop").arg(self.folder.path()).status();
    }
}

/// Invariant: A Slurm job array renders every view once.
#[test]
fn a_job_array_renders_every_view_once_and_requeues_what_may_pass() {
    let Some(cluster) = Cluster::start() else { return };
    let archive = Archive::of_phantoms(6);
    ok(&archive.plan(&["--views", "planes"]));
    ok(&archive.run_into("reference", &[]));
    // One share's first try fails as a full disk does.
    let (stumbled, program) = (archive.text("stumbled"), archive.text("relief"));
    let script = format!(
        "#!/bin/sh\ncase \"$*\" in *'--shard 1/3'*) if mkdir '{stumbled}' 2>/dev/null; then exit 75; fi ;; esac\nexec '{}' \"$@\"\n",
        env!("CARGO_BIN_EXE_relief")
    );
    std::fs::write(&program, script).unwrap();
    let status = Command::new("chmod").args(["755", &program]).status().unwrap();
    assert!(status.success());
    let (ran, logs) = cluster.batch(&archive, &program, "4-8:2");
    let said = String::from_utf8_lossy(&ran.stderr);
    assert!(ran.status.success(), "{said}\n{logs:#?}");
    assert_eq!(logs.len(), 3);
    for share in ["share 0/3 on", "share 1/3 on", "share 2/3 on"] {
        assert!(logs.iter().any(|log| log.contains(share)), "{share}: {logs:#?}");
    }
    let requeued: Vec<_> = logs.iter().filter(|log| log.contains("the task is requeued")).collect();
    assert!(requeued.len() == 1 && requeued[0].matches("share 1/3").count() == 2, "{logs:#?}");
    assert!(pictures(&archive.path("out")) == pictures(&archive.path("reference")), "18 views, none lost");
    let again = ok(&archive.run(&[]));
    assert_eq!((&again["done"], &again["skipped"]), (&0.into(), &18.into()));
}

#[test]
fn the_script_says_what_it_wants() {
    let run = |arguments: &[&str]| {
        Command::new(SCRIPT).args(arguments).env_remove("SLURM_ARRAY_TASK_ID").output().unwrap()
    };
    let refused = run(&["jobs.jsonl"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("MANIFEST OUT"));
    assert!(String::from_utf8_lossy(&run(&["jobs.jsonl", "views"]).stderr).contains("sbatch --array"));
}

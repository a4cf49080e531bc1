//! Access of workers to a queue: TLS with a private authority, a token, credentials. `access.py`
//! makes the secrets and certificates.

use super::services::Nats;
use super::*;

/// Writes the files of `access.py`; `None` after saying aloud that there is no Python to run it.
fn secrets(what: &str, folder: &Path) -> Option<()> {
    let python = std::env::var_os("RELIEF_MOTO").map(|moto| PathBuf::from(moto).with_file_name("python"));
    let Some(python) = python.filter(|python| python.exists()) else {
        eprintln!("SKIPPED: {what} (RELIEF_MOTO is not set, see scripts/setup-services)");
        return None;
    };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/batch/access.py");
    let made = Command::new(python).arg(script).arg(folder).output().unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    Some(())
}

/// Submits and works with these access options; returns whether the views are there, and the output
/// at the most detailed log level.
fn through(archive: &Archive, url: &str, access: &[&str]) -> (Option<usize>, String) {
    let (manifest, out) = (archive.text("jobs.jsonl"), archive.text("out"));
    let relief = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_relief"));
        command.args(arguments).args(["--nats", url]).args(access).env_remove("RELIEF_NATS_TOKEN");
        command.env("RELIEF_ADAPTER", "cpu").env("RELIEF_LOG", "trace").output().unwrap()
    };
    let submitted = relief(&["batch", "submit", "--manifest", &manifest]);
    let mut said = [submitted.stdout, submitted.stderr].concat();
    if !submitted.status.success() {
        assert_eq!(submitted.status.code(), Some(1));
        return (None, String::from_utf8_lossy(&said).into_owned());
    }
    let worked = relief(&["batch", "work", "--out", &out, "--idle-exit", "1"]);
    assert!(worked.status.success(), "{}", String::from_utf8_lossy(&worked.stderr));
    said.extend([worked.stdout, worked.stderr].concat());
    let made = pictures(&archive.path("out")).len();
    std::fs::remove_dir_all(archive.path("out")).unwrap();
    (Some(made), String::from_utf8_lossy(&said).into_owned())
}

/// Invariant: No secret of a queue is shown, and Relief accepts the command lines of the Kubernetes
/// manifests.
#[test]
fn a_queue_behind_tls_is_worked_with_the_authority_that_its_server_has() {
    let what = "queues behind TLS";
    let archive = Archive::of_phantoms(1);
    if secrets(what, &archive.path("")).is_none() {
        return;
    }
    let [certificate, key, authority, other] =
        ["server.pem", "server.key", "ca.pem", "other-ca.pem"].map(|name| archive.text(name));
    let tls = ["--tls", "--tlscert", &certificate, "--tlskey", &key, "--auth", "s3cret-token"];
    let Some(nats) = Nats::start(what, &tls) else { return };
    ok(&archive.plan(&["--views", "planes"]));
    let token = archive.text("token");
    std::fs::write(&token, "s3cret-token\n").unwrap();
    let url = nats.url().replace("nats://", "tls://");
    let with = |authority: &[&str], token: &[&str]| through(&archive, &url, &[authority, token].concat());
    let token = ["--nats-token-file", &token];
    let (made, said) = with(&["--nats-ca", &authority], &token);
    assert_eq!(made, Some(3), "{said}");
    assert!(!said.contains("s3cret"), "{said}");
    for (authority, token, reason) in [
        (&["--nats-ca", &*other][..], &token[..], "certificate"),
        (&[], &token, "certificate"),
        (&["--nats-ca", "missing.pem"], &token, "cannot read the certificates"),
        (&["--nats-ca", &authority], &[], "authorization violation"),
    ] {
        let (made, said) = with(authority, token);
        assert!(made.is_none() && said.to_lowercase().contains(reason), "{authority:?}: {said}");
        assert!(!said.contains("s3cret"), "{said}");
    }
}

/// Invariant: No secret of a queue is shown, and Relief accepts the command lines of the Kubernetes
/// manifests.
#[test]
fn a_queue_of_an_operator_takes_the_credentials_of_its_users_alone() {
    let what = "queues with credentials";
    let archive = Archive::of_phantoms(1);
    if secrets(what, &archive.path("")).is_none() {
        return;
    }
    let configuration = archive.text("operator.conf");
    let Some(nats) = Nats::start(what, &["-c", &configuration]) else { return };
    ok(&archive.plan(&["--views", "planes"]));
    let [worker, foreign] = ["worker.creds", "foreign.creds"].map(|name| archive.text(name));
    let text = std::fs::read_to_string(&worker).unwrap();
    let secrets: Vec<&str> = text.lines().filter(|line| !line.starts_with('-') && !line.is_empty()).collect();
    assert_eq!(secrets.len(), 2, "a claim and a seed");
    let (made, said) = through(&archive, &nats.url(), &["--nats-creds", &worker]);
    assert_eq!(made, Some(3), "{said}");
    assert!(secrets.iter().all(|secret| !said.contains(secret)), "{said}");
    for access in [&["--nats-creds", &*foreign][..], &[]] {
        let (made, said) = through(&archive, &nats.url(), access);
        assert!(
            made.is_none() && said.to_lowercase().contains("authorization violation"),
            "{access:?}: {said}"
        );
    }
}

//! The packages of `scripts/package`, installed and run in a clean Debian, without compilers and
//! drivers.
//!
//! Runs as root where `RELIEF_DEBIAN_ROOT` names such a Debian (scripts/setup-debian-root), and says
//! aloud where it does not. Independent references: dpkg, and the same picture by the program
//! outside.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use super::Running;

/// A copy of the clean Debian; `None` with a message where there is none.
fn clean_debian() -> Option<tempfile::TempDir> {
    let Some(root) = std::env::var_os("RELIEF_DEBIAN_ROOT") else {
        eprintln!("SKIPPED: packages in a clean Debian (RELIEF_DEBIAN_ROOT is not set)");
        return None;
    };
    let copy = tempfile::tempdir().unwrap();
    succeed(Command::new("cp").args(["-a", "--reflink=auto", "-T"]).arg(root).arg(copy.path()));
    Some(copy)
}

fn succeed(command: &mut Command) -> Output {
    let output = command.output().unwrap();
    assert!(
        output.status.success(),
        "{command:?}\n{}\n{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    output
}

/// A command inside of the clean Debian, with its own variables, and processes to see.
fn inside(root: &Path, command: &str) -> Command {
    let enter = "mount -t proc proc \"$0/proc\" && exec chroot \"$0\" /bin/bash -c \"$1\"";
    let mut chroot = Command::new("unshare");
    chroot.args(["--mount", "bash", "-c", enter]).arg(root).arg(command).env_clear();
    chroot
        .env("PATH", "/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin")
        .env("HOME", "/root")
        .env("LC_ALL", "C");
    chroot
}

fn text_inside(root: &Path, command: &str) -> String {
    String::from_utf8(succeed(&mut inside(root, command)).stdout).unwrap()
}

/// The package and the tarball of the program under test.
fn packages(folder: &Path) -> [PathBuf; 2] {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/package");
    let mut command = Command::new(script);
    let output =
        succeed(command.args(["--fast", "--program", env!("CARGO_BIN_EXE_relief"), "--out"]).arg(folder));
    let paths: Vec<PathBuf> = String::from_utf8(output.stdout).unwrap().lines().map(PathBuf::from).collect();
    paths.try_into().unwrap()
}

const PICTURE: &str = "$relief phantom --kind head --size 48 --out head && \
    $relief render --series head --preset bone --layout wowvx --adapter cpu --out frame.png";

fn picture_outside() -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let script = format!("relief={} && {PICTURE}", env!("CARGO_BIN_EXE_relief"));
    succeed(Command::new("bash").args(["-c", &script]).current_dir(folder.path()));
    std::fs::read(folder.path().join("frame.png")).unwrap()
}

#[test]
fn packages_are_installed_and_render_in_a_clean_debian() {
    let Some(root) = clean_debian() else { return };
    let root = root.path();
    let folder = tempfile::tempdir().unwrap();
    let [deb, tarball] = packages(folder.path());
    let expected = picture_outside();
    assert!(!root.join("usr/bin/gcc").exists() && !root.join("usr/bin/cargo").exists());

    std::fs::copy(&deb, root.join("relief.deb")).unwrap();
    succeed(&mut inside(root, "dpkg -i /relief.deb"));
    assert_eq!(text_inside(root, "dpkg -V relief"), "");
    succeed(&mut inside(root, &format!("cd /tmp && relief=/usr/bin/relief && {PICTURE}")));
    assert!(std::fs::read(root.join("tmp/frame.png")).unwrap() == expected, "another picture inside");
    its_manual_is_there(root);
    its_licences_are_there(root);
    its_server_starts(root);
    succeed(&mut inside(root, "dpkg -P relief"));
    assert!(!root.join("usr/bin/relief").exists() && !root.join("etc/default/relief-serve").exists());

    let tar = tarball.file_name().unwrap().to_str().unwrap();
    let unpack =
        format!("tar -xJf {} -C {}/usr/local --strip-components=1", tarball.display(), root.display());
    succeed(Command::new("bash").args(["-c", &unpack]));
    let version = text_inside(root, "cd /tmp && relief --version");
    assert!(tar.starts_with(&format!("relief-{}-", version.trim().trim_start_matches("relief "))), "{tar}");
    succeed(&mut inside(root, &format!("cd /tmp && rm -rf head && relief=relief && {PICTURE}")));
    assert!(std::fs::read(root.join("tmp/frame.png")).unwrap() == expected, "another picture by the tarball");
}

/// A page for every subcommand, with the descriptions of --help, and completions that bash reads.
fn its_manual_is_there(root: &Path) {
    let help = text_inside(root, "relief --help");
    let commands = help.lines().skip_while(|line| *line != "Commands:").skip(1);
    let commands: Vec<&str> = commands.take_while(|line| !line.is_empty()).collect();
    assert!(commands.len() > 15, "{help}");
    // Long descriptions go on below, further to the right.
    let firsts = commands.iter().filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    for line in firsts.filter(|line| !line.starts_with("  help ")) {
        let (name, about) = line.trim().split_once(' ').unwrap();
        let page = text_inside(root, &format!("zcat /usr/share/man/man1/relief-{name}.1.gz"));
        // roff writes hyphens and apostrophes as commands.
        let letters = |text: &str| text.replace("*(Aq", "").replace(|c: char| !c.is_alphanumeric(), "");
        assert!(letters(&page).contains(&letters(about)), "{name}: {page}");
    }
    let completed = "source /usr/share/bash-completion/completions/relief && COMP_WORDS=(relief ren) COMP_CWORD=1 && \
        _relief relief ren relief && echo \"${COMPREPLY[@]}\"";
    assert_eq!(text_inside(root, completed).trim(), "render");
}

/// The licence of every library that is linked in, and the notices that they require.
fn its_licences_are_there(root: &Path) {
    let list = text_inside(root, "zcat /usr/share/doc/relief/THIRD-PARTY.txt.gz");
    for expected in
        ["\nwgpu ", "\naxum ", "\nglam ", "\nzstd-sys ", "Of charls-sys", "Copyright (c) Meta Platforms"]
    {
        assert!(list.contains(expected), "{expected} is not in the list");
    }
    let home = std::env::var("HOME").unwrap_or_default();
    assert!(home.len() < 2 || !list.contains(&home), "the list names folders of the machine");
    assert!(
        text_inside(root, "cat /usr/share/doc/relief/copyright")
            .contains("MIT licence or the Apache License 2.0")
    );
}

/// The command of the unit serves the series that /etc/default names, and keeps annotations where
/// the unit says.
fn its_server_starts(root: &Path) {
    let options = "--series /tmp/head --adapter cpu --listen 127.0.0.1:0";
    let defaults = format!("RELIEF_SERVE_OPTIONS=\"{options}\"\n");
    std::fs::write(root.join("etc/default/relief-serve"), defaults).unwrap();
    let unit = std::fs::read_to_string(root.join("usr/lib/systemd/system/relief-serve.service")).unwrap();
    let command = unit.lines().find_map(|line| line.strip_prefix("ExecStart=")).unwrap();
    let command = command.replace("%S", "/var/lib").replace("%C", "/var/cache");
    let script = format!("mkdir -p /var/lib/relief && . /etc/default/relief-serve && exec {command}");
    let server = Running::spawn(inside(root, &script).stdout(Stdio::piped()).stderr(Stdio::piped()));
    server.await_ready();
    assert!(server.get("/").0.starts_with("HTTP/1.1 200"));
    let (status, errors) = server.stop("TERM");
    assert_eq!(status, Some(0), "{errors}");
    assert!(root.join("var/lib/relief/annotations.db").is_file());
}

/// systemd finds no fault in the units.
#[test]
fn units_are_what_systemd_expects() {
    let found = Command::new("systemd-analyze").arg("--version").output();
    if !found.is_ok_and(|output| output.status.success()) {
        eprintln!("SKIPPED: units by systemd-analyze (it is not installed)");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let scripts = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/install");
    for name in ["relief-serve.service", "relief-client.service"] {
        let unit = std::fs::read_to_string(scripts.join(name)).unwrap();
        // The program and the pages are of a package that this machine need not have.
        let unit =
            unit.replace("/usr/bin/relief", env!("CARGO_BIN_EXE_relief")).replace("Documentation=man:", "#");
        let path = folder.path().join(name);
        std::fs::write(&path, unit).unwrap();
        let mut command = Command::new("systemd-analyze");
        command.env("XDG_RUNTIME_DIR", folder.path());
        let user = if name.contains("client") { "--user" } else { "--system" };
        let output = succeed(command.args(["verify", user, "--man=no"]).arg(&path));
        let said = String::from_utf8_lossy(&output.stderr);
        let own: Vec<&str> = said.lines().filter(|line| line.contains(name)).collect();
        assert!(own.is_empty(), "{own:?}");
    }
}

//! The virtual remote driven by Debian's libcwiid: an independent host that sets up the camera, and
//! an independent decoder of the remote's reports.
//!
//! Runs where `RELIEF_CWIID` names a folder with libcwiid, unpacked by scripts/setup-peers, and
//! says aloud where it does not.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "a test may panic and talk, in its helpers too")]

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::{Duration, Instant};

use relief_tracking::{
    Blob, Buttons, InputReport, Output, RemoteSenses, VirtualRemote, bytes_of_hex, hex_of_bytes,
};
use serde_json::{Value, json};

/// libcwiid in a process of its own, and the remote that it talks to.
struct Bench {
    child: Child,
    to_host: ChildStdin,
    lines: Receiver<String>,
    remote: VirtualRemote,
    registers: Vec<u32>,
}

impl Bench {
    fn start(folder: &Path) -> Self {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/peers/cwiid_host.py");
        let mut command = Command::new("python3");
        command.arg(script).arg(folder).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().expect("python3 runs");
        let (sender, lines) = sync_channel(1024);
        let from_host = BufReader::new(child.stdout.take().unwrap());
        let read = move || from_host.lines().map_while(Result::ok).try_for_each(|line| sender.send(line));
        std::thread::Builder::new().spawn(read).unwrap();
        let to_host = child.stdin.take().unwrap();
        Self { child, to_host, lines, remote: VirtualRemote::new(false), registers: Vec::new() }
    }

    fn send(&mut self, report: &InputReport) {
        let _ = writeln!(self.to_host, "i a1{}", hex_of_bytes(&report.encode()));
    }

    /// Follows the host's requests for a while and reports the sensors; returns the host's last
    /// state.
    fn run(&mut self, senses: &RemoteSenses, until: impl Fn(&Value) -> bool) -> Option<Value> {
        let start = Instant::now();
        let mut state = None;
        while start.elapsed() < Duration::from_secs(120) {
            if let Ok(line) = self.lines.recv_timeout(Duration::from_millis(10)) {
                match line.split_once(' ') {
                    Some(("c", hex)) => self.apply(&bytes_of_hex(hex.strip_prefix("52").unwrap()).unwrap()),
                    Some(("s", text)) => {
                        let now: Value = serde_json::from_str(text).unwrap();
                        let done = until(&now);
                        state = Some(now);
                        if done {
                            return state;
                        }
                    }
                    _ => panic!("{line}"),
                }
            }
            let report = self.remote.report(senses);
            self.send(&report);
        }
        state
    }

    fn apply(&mut self, bytes: &[u8]) {
        let (output, _) = Output::decode(bytes).unwrap();
        if let Output::Write { address, .. } = output {
            self.registers.push(address);
        }
        // Only writes are acknowledged without being asked to.
        let wanted = bytes[1] & 0x02 != 0 || !matches!(bytes[0], 0x11 | 0x12 | 0x13 | 0x1a);
        for answer in self.remote.take(&output).into_iter().filter(|_| wanted) {
            self.send(&answer);
        }
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn libcwiid_brings_the_remote_up_and_decodes_its_reports() {
    let Some(folder) = std::env::var_os("RELIEF_CWIID").filter(|folder| !folder.is_empty()) else {
        eprintln!(
            "SKIPPED: libcwiid_brings_the_remote_up_and_decodes_its_reports (RELIEF_CWIID names no folder)"
        );
        return;
    };
    let mut bench = Bench::start(Path::new(&folder));
    let sized = |x, y, size| Some(Blob { size: Some(size), ..Blob::at(x, y) });
    let cases = [
        (
            [sized(100, 200, 3), None, sized(1000, 767, 15), sized(512, 384, 1)],
            Buttons::A.with(Buttons::HOME),
        ),
        ([sized(0, 0, 0), sized(1, 511, 7), sized(300, 255, 2), None], Buttons::LEFT.with(Buttons::TWO)),
        ([None; 4], Buttons::default()),
    ];
    for (blobs, buttons) in cases {
        let senses = RemoteSenses { buttons, acceleration: [538, 554, 660], blobs, rates: None };
        let shown = blobs.map(|blob| blob.map(|b| json!([b.x, b.y, b.size])));
        let expected = json!({
            "buttons": u16::from_be_bytes(buttons.to_bytes()), "acc": [538 >> 2, 554 >> 2, 660 >> 2], "blobs": shown,
        });
        let state = bench.run(&senses, |state| *state == expected);
        assert_eq!(state, Some(expected));
    }
    // The camera came up by libcwiid's own order of writes.
    for register in [0xb0_0030, 0xb0_0000, 0xb0_001a, 0xb0_0033] {
        assert!(bench.registers.contains(&register), "{register:06x} of {:06x?}", bench.registers);
    }
}

//! The virtual remote as a device of the kernel's, through /dev/uhid: found, brought up and tracked
//! by `relief track --reports hidraw` as a Wiimote is, beside the kernel's own driver for it.
//!
//! The encoding of uhid's events, which is our own, is tested against the kernel's header, too.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "a test may panic and talk, in its helpers too")]

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};
use std::time::{Duration, Instant};

use nalgebra::Vector3;
use relief_tracking::{Beacon, InputReport, Output, RemoteSenses, SensorPose, Simulation, VirtualRemote};
use serde_json::Value;

use super::kernel;

/// `enum uhid_event_type` of linux/uhid.h.
const DESTROY: u32 = 1;
const OUTPUT: u32 = 6;
const GET_REPORT: u32 = 9;
const GET_REPORT_REPLY: u32 = 10;
const CREATE2: u32 = 11;
const INPUT2: u32 = 12;
const SET_REPORT: u32 = 13;
const SET_REPORT_REPLY: u32 = 14;

/// Most bytes of a report, `UHID_DATA_MAX`, and of an event, `sizeof(struct uhid_event)`.
const DATA_MAX: usize = 4096;
const EVENT_MAX: usize = 4380;
const BUS_BLUETOOTH: u16 = 5;
const EIO: u16 = 5;

const VENDOR: u32 = 0x057e;
const PRODUCT: u32 = 0x0306;
/// Identifies this device among other remotes.
const UNIQUE: &str = "relief-virtual-remote";

/// Ids of output and of input reports, and their bytes after the id.
#[rustfmt::skip]
const OUTPUTS: [(u8, u8); 11] = [
    (0x10, 1), (0x11, 1), (0x12, 2), (0x13, 1), (0x14, 1), (0x15, 1), (0x16, 21), (0x17, 6), (0x18, 21), (0x19, 1),
    (0x1a, 1),
];
#[rustfmt::skip]
const INPUTS: [(u8, u8); 14] = [
    (0x20, 6), (0x21, 21), (0x22, 4), (0x30, 2), (0x31, 5), (0x32, 10), (0x33, 17), (0x34, 21), (0x35, 21), (0x36, 21),
    (0x37, 21), (0x3d, 21), (0x3e, 21), (0x3f, 21),
];

/// A Wiimote's descriptor: a game pad with reports of bytes.
fn descriptor() -> Vec<u8> {
    // Usage page and usage, application; then for all reports: 0 to 255, 8 bits, a usage page of
    // the vendor's.
    let mut bytes =
        vec![0x05, 0x01, 0x09, 0x05, 0xa1, 0x01, 0x15, 0x00, 0x26, 0xff, 0x00, 0x75, 0x08, 0x06, 0x00, 0xff];
    for (reports, kind) in [(OUTPUTS.as_slice(), 0x91), (INPUTS.as_slice(), 0x81)] {
        for (id, count) in reports {
            bytes.extend([0x85, *id, 0x95, *count, 0x09, 0x01, kind, 0x00]);
        }
    }
    bytes.push(0xc0);
    bytes
}

/// An event to the kernel: short ones are completed with zeros.
fn event(kind: u32, payload: &[&[u8]]) -> Vec<u8> {
    [&kind.to_ne_bytes(), payload.concat().as_slice()].concat()
}

/// `struct uhid_create2_req`.
fn create() -> Vec<u8> {
    let text = |text: &str, size: usize| {
        let mut bytes = text.as_bytes().to_vec();
        bytes.resize(size, 0);
        bytes
    };
    let descriptor = descriptor();
    let [name, phys, uniq] =
        [("Nintendo RVL-CNT-01", 128), ("relief/test", 64), (UNIQUE, 64)].map(|(t, s)| text(t, s));
    let sizes = [(descriptor.len() as u16).to_ne_bytes(), BUS_BLUETOOTH.to_ne_bytes()].concat();
    let numbers = [VENDOR, PRODUCT, 0, 0].map(u32::to_ne_bytes).concat(); // then version and country
    event(CREATE2, &[&name, &phys, &uniq, &sizes, &numbers, &descriptor])
}

/// `struct uhid_input2_req`.
fn input(report: &InputReport) -> Vec<u8> {
    let bytes = report.encode();
    event(INPUT2, &[&(bytes.len() as u16).to_ne_bytes(), &bytes])
}

/// A request of the kernel.
#[derive(Debug, PartialEq)]
enum Asked {
    Output(Vec<u8>),
    /// To be answered with this event.
    Refused(Vec<u8>),
    Nothing,
}

/// Decodes an event of the kernel's.
fn asked(bytes: &[u8]) -> Asked {
    let kind = bytes.first_chunk().map(|kind| u32::from_ne_bytes(*kind));
    // `struct uhid_output_req`: the data in full, then their size.
    let size = bytes.get(4 + DATA_MAX..).and_then(<[u8]>::first_chunk).map(|size| u16::from_ne_bytes(*size));
    let id = bytes.get(4..8).unwrap_or_default();
    match (kind, size) {
        (Some(OUTPUT), Some(size)) => Asked::Output(bytes[4..4 + usize::from(size).min(DATA_MAX)].to_vec()),
        // A Wiimote has no feature reports, and is configured by output reports only.
        (Some(GET_REPORT), _) => Asked::Refused(event(GET_REPORT_REPLY, &[id, &EIO.to_ne_bytes(), &[0; 2]])),
        (Some(SET_REPORT), _) => Asked::Refused(event(SET_REPORT_REPLY, &[id, &EIO.to_ne_bytes()])),
        _ => Asked::Nothing,
    }
}

/// A remote behind /dev/uhid, in a room with a beacon.
struct Device {
    uhid: File,
    events: Receiver<Vec<u8>>,
    remote: VirtualRemote,
    senses: Vec<RemoteSenses>,
    reported: usize,
}

impl Device {
    fn create(mut uhid: File, senses: Vec<RemoteSenses>) -> Self {
        uhid.write_all(&create()).unwrap();
        let mut reading = uhid.try_clone().unwrap();
        let (sender, events) = sync_channel(256);
        let read = move || {
            let mut buffer = [0; EVENT_MAX];
            while let Ok(count @ 1..) = reading.read(&mut buffer) {
                if sender.send(buffer[..count].to_vec()).is_err() {
                    return;
                }
            }
        };
        std::thread::Builder::new().name("uhid".to_owned()).spawn(read).unwrap();
        Self { uhid, events, remote: VirtualRemote::new(false), senses, reported: 0 }
    }

    fn send(&mut self, event: &[u8]) {
        self.uhid.write_all(event).unwrap();
    }

    /// Ten milliseconds: answers requests and reports the sensors.
    fn live(&mut self) {
        loop {
            match self.events.try_recv().map(|event| asked(&event)) {
                Ok(Asked::Output(bytes)) => self.apply(&bytes),
                Ok(Asked::Refused(answer)) => self.send(&answer),
                Ok(Asked::Nothing) => {}
                Err(TryRecvError::Empty) => break,
                Err(TryRecvError::Disconnected) => panic!("the kernel has closed the device"),
            }
        }
        if self.remote.is_continuous() {
            let report = self.remote.report(&self.senses[self.reported % self.senses.len()]);
            self.reported += 1;
            self.send(&input(&report));
        }
        std::thread::sleep(Duration::from_millis(10));
    }

    fn apply(&mut self, bytes: &[u8]) {
        let Ok((output, _)) = Output::decode(bytes) else { return };
        // Only writes are acknowledged without being asked to.
        let wanted = bytes[1] & 0x02 != 0 || !matches!(bytes[0], 0x11 | 0x12 | 0x13 | 0x1a);
        for answer in self.remote.take(&output).into_iter().filter(|_| wanted) {
            self.send(&input(&answer));
        }
    }

    /// Lives until `done` gives something, two minutes at most.
    fn live_until<T>(&mut self, mut done: impl FnMut() -> Option<T>) -> Option<T> {
        let start = Instant::now();
        while start.elapsed() < Duration::from_secs(120) {
            let found = done();
            if found.is_some() {
                return found;
            }
            self.live();
        }
        None
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        let _ = self.uhid.write_all(&event(DESTROY, &[]));
    }
}

/// The program, ended with the test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// hidraw's name of this device and the driver that took it.
fn found_by_kernel() -> Option<(String, String)> {
    for entry in std::fs::read_dir("/sys/class/hidraw").ok()?.flatten() {
        let uevent = std::fs::read_to_string(entry.path().join("device/uevent")).unwrap_or_default();
        let value = |key: &str| uevent.lines().find_map(|line| line.strip_prefix(key)).unwrap_or_default();
        if value("HID_UNIQ=") == UNIQUE {
            return Some((entry.file_name().to_string_lossy().into_owned(), value("DRIVER=").to_owned()));
        }
    }
    None
}

/// A sensor at rest before the recommended beacon, and its measurements.
struct Still(SensorPose);

impl relief_tracking::SensorPath for Still {
    fn at(&self, _: f64) -> SensorPose {
        self.0
    }
}

fn rest() -> (SensorPose, Vec<RemoteSenses>) {
    let simulation = Simulation::new(Beacon::recommended(), 1);
    let (centroid, up) = (simulation.beacon.centroid(), *simulation.beacon.up());
    let pose =
        SensorPose::looking_at(centroid + Vector3::new(150.0, 60.0, 1200.0), centroid, &up, 0.1).unwrap();
    let senses = |report: &InputReport| {
        let InputReport::Data(data) = report else { return None };
        let acceleration = data.acceleration?;
        Some(RemoteSenses { acceleration, blobs: data.blobs?, ..RemoteSenses::default() })
    };
    let reports = simulation.record(&Still(pose), 1.0);
    (pose, reports.iter().filter_map(|made| senses(&made.report)).collect())
}

/// Invariant: A Wiimote is found, brought up and tracked through the kernel, beside the kernel's own
/// driver.
#[test]
fn the_kernels_virtual_wiimote_is_found_brought_up_and_tracked() {
    if !kernel::entered(kernel::WIIMOTE) {
        return;
    }
    let uhid = File::options().read(true).write(true).open("/dev/uhid").unwrap();
    let (truth, senses) = rest();
    let mut device = Device::create(uhid, senses);
    let (name, driver) = device.live_until(found_by_kernel).expect("a hidraw device");
    assert_eq!(driver, "wiimote");
    let node = Path::new("/dev").join(&name);
    let opened = device.live_until(|| File::options().read(true).write(true).open(&node).ok());
    assert!(opened.is_some(), "{}", node.display());
    let mut command = Command::new(env!("CARGO_BIN_EXE_relief"));
    command.args(["track", "--json", "--reports", "hidraw"]).stdout(Stdio::piped());
    let mut running = Running(command.spawn().unwrap());
    let lines = BufReader::new(running.0.stdout.take().unwrap()).lines();
    let (sender, poses) = sync_channel(1024);
    let read = move || lines.map_while(Result::ok).try_for_each(|line| sender.send(line));
    std::thread::Builder::new().spawn(read).unwrap();
    let mut tracked = Vec::new();
    let enough = device.live_until(|| {
        let lines = poses.try_iter().map(|line| serde_json::from_str::<Value>(&line).unwrap());
        tracked.extend(lines.filter(|pose| pose["state"] == "tracking"));
        (tracked.len() >= 100).then_some(())
    });
    assert!(enough.is_some(), "only {} poses in two minutes; {} reports", tracked.len(), device.reported);
    let last = &tracked[tracked.len() - 1]["position_mm"];
    let position = Vector3::from_fn(|axis, _| last[axis].as_f64().unwrap());
    assert!((position - truth.position).norm() < 30.0, "{position} {}", truth.position);
}

/// A host of our own and the virtual remote, with the kernel's events between them but no kernel.
#[test]
fn reports_survive_the_kernels_events() {
    let (_, senses) = rest();
    let mut remote = VirtualRemote::new(false);
    for output in [Output::CameraClock(true), Output::register(0xb0_0030, &[1]), Output::Status] {
        // As the kernel writes it: all data, their size, and the kind of report.
        let bytes = output.encode(false);
        let mut data = bytes.clone();
        data.resize(DATA_MAX, 0xaa);
        let size = (bytes.len() as u16).to_ne_bytes();
        let Asked::Output(found) = asked(&event(OUTPUT, &[&data, &size, &[1]])) else { panic!("{output:?}") };
        assert_eq!(Output::decode(&found), Ok((output, false)));
        for answer in remote.take(&output) {
            let event = input(&answer);
            let size = usize::from(u16::from_ne_bytes([event[4], event[5]]));
            assert_eq!((event.len(), InputReport::decode(&event[6..]).unwrap()), (6 + size, answer.clone()));
            let declared = INPUTS.iter().find(|(id, _)| *id == answer.id()).unwrap().1;
            assert_eq!(
                size,
                1 + usize::from(declared),
                "report {:02x} is as long as the descriptor has it",
                answer.id()
            );
        }
    }
    assert!(senses.iter().all(|senses| senses.blobs.iter().flatten().count() == 4));
    let get = event(GET_REPORT, &[&7_u32.to_ne_bytes(), &[1, 0]]);
    let refused = event(GET_REPORT_REPLY, &[&7_u32.to_ne_bytes(), &EIO.to_ne_bytes(), &[0; 2]]);
    assert_eq!(asked(&get), Asked::Refused(refused));
    assert_eq!(asked(&event(2, &[])), Asked::Nothing);
    assert_eq!(asked(&[1]), Asked::Nothing);
}

/// Event numbers and places of fields, as a C compiler has them of linux/uhid.h.
const LAYOUT: &str = r#"
#include <linux/uhid.h>
#include <stddef.h>
#include <stdio.h>
#define AT(member) offsetof(struct uhid_event, u.member)
int main(void) {
    printf("%d %d %d %d %d %d %d %d ", UHID_DESTROY, UHID_OUTPUT, UHID_GET_REPORT, UHID_GET_REPORT_REPLY, UHID_CREATE2,
           UHID_INPUT2, UHID_SET_REPORT, UHID_SET_REPORT_REPLY);
    printf("%zu %zu %zu %zu %zu %zu ", AT(create2.uniq), AT(create2.rd_size), AT(create2.bus), AT(create2.vendor),
           AT(create2.product), AT(create2.rd_data));
    printf("%zu %zu %zu %zu ", AT(output.size), AT(input2.size), AT(input2.data), AT(get_report_reply.err));
    printf("%zu %zu\n", AT(set_report_reply.err), sizeof(struct uhid_event));
    return 0;
}
"#;

#[test]
fn events_are_laid_out_as_in_the_kernels_header() {
    let create = create();
    let descriptor = descriptor();
    let place = |bytes: &[u8]| create.windows(bytes.len()).position(|window| window == bytes).unwrap();
    let place_of_uniq = place(UNIQUE.as_bytes());
    let sizes = [(descriptor.len() as u16).to_ne_bytes(), BUS_BLUETOOTH.to_ne_bytes()].concat();
    let rd_size = place(&sizes);
    let ids = place(&[VENDOR.to_ne_bytes(), PRODUCT.to_ne_bytes()].concat());
    let numbers =
        [DESTROY, OUTPUT, GET_REPORT, GET_REPORT_REPLY, CREATE2, INPUT2, SET_REPORT, SET_REPORT_REPLY];
    let places = [place_of_uniq, rd_size, rd_size + 2, ids, ids + 4, place(&descriptor)];
    let others = [4 + DATA_MAX, 4, 6, 8, 8, EVENT_MAX];
    let ours = numbers.map(|number| number as usize).into_iter().chain(places).chain(others);
    let ours: Vec<String> = ours.map(|number| number.to_string()).collect();

    let folder = tempfile::tempdir().unwrap();
    let (source, program) = (folder.path().join("layout.c"), folder.path().join("layout"));
    std::fs::write(&source, LAYOUT).unwrap();
    let compiled = Command::new("cc").arg(&source).arg("-o").arg(&program).output();
    if !compiled.is_ok_and(|output| output.status.success()) {
        eprintln!("SKIPPED: events_are_laid_out_as_in_the_kernels_header (no C compiler with linux/uhid.h)");
        return;
    }
    let theirs = Command::new(&program).output().unwrap().stdout;
    assert_eq!(ours.join(" "), String::from_utf8(theirs).unwrap().trim());
}

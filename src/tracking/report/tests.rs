//! Reports against vectors that others recorded, and encode against decode on any values and bytes.

use proptest::prelude::*;

use super::calibration::{AccelerometerCalibration, Calibrations, decode_accelerometer, decode_ir};
use super::motion_plus::{GyroCalibration, GyroRange, MotionPlus};
use super::output::{DataMode, MemorySpace, Output};
use super::recording::{RecordingReader, bytes_of_hex, recording_line};
use super::*;

fn bytes(hex: &str) -> Vec<u8> {
    bytes_of_hex(&hex.replace(' ', "")).unwrap()
}

fn decoded(hex: &str) -> InputReport {
    InputReport::decode(&bytes(hex)).unwrap()
}

/// A public talk's example: a remote that lies on the table.
#[test]
fn acceleration_has_ten_bits() {
    let InputReport::Data(data) = decoded("31 40 20 86 8a a5") else { panic!("a data report") };
    assert_eq!(data.acceleration, Some([538, 554, 660]));
    assert_eq!(data.buttons, Some(Buttons::default()));
}

/// Frames from wiibrew's talk page and from a log of a -TR remote.
#[test]
fn status_and_acknowledgement_of_real_remotes() {
    let InputReport::Status(status) = decoded("20 00 00 02 00 00 95") else { panic!("a status") };
    assert!(status.extension && !status.battery_low && !status.camera);
    assert_eq!((status.leds, status.battery), (0, 149));
    let InputReport::Status(status) = decoded("20 00 00 42 00 00 8f") else { panic!("a status") };
    assert_eq!((status.extension, status.leds, status.battery), (true, 0b0100, 143));
    for (hex, of, error) in [("22 00 00 16 00", 0x16, 0), ("22 00 00 12 02", 0x12, 2)] {
        let InputReport::Acknowledge(ack) = decoded(hex) else { panic!("an acknowledgement") };
        assert_eq!((ack.of, ack.error), (of, error));
    }
    let InputReport::Data(data) = decoded("32 00 00 5D DE 6F 0B FF FF FE 97") else {
        panic!("a data report")
    };
    assert_eq!(data.extension.unwrap().bytes(), bytes("5DDE6F0BFFFFFE97"));
}

/// The EEPROM of a real remote, as the xwiimote project published it.
#[test]
fn eeprom_of_a_real_remote() {
    let ir = decode_ir(bytes("88858b8b8a973f308c39 cd").as_array().unwrap()).unwrap();
    assert_eq!(ir.corners.map(|c| (c.x, c.y)), [(136, 645), (907, 650), (919, 63), (140, 57)]);
    let block: [u8; 10] = *bytes("848286309f9d9f0240 2e").as_array().unwrap();
    let accelerometer = decode_accelerometer(&block).unwrap();
    assert_eq!(accelerometer, AccelerometerCalibration { zero: [531, 520, 536], one_g: [636, 628, 638] });
    let mut broken = block;
    broken[0] ^= 1;
    assert_eq!(decode_accelerometer(&broken), None);

    // The first copy of the infrared block is broken, the second is whole.
    let mut eeprom = bytes("88858b8b8a973f308c39 cc").clone();
    eeprom.extend(bytes("88858b8b8a973f308c39 cd"));
    eeprom.extend(block);
    eeprom.extend([0; 10]);
    eeprom.push(0);
    let both = Calibrations::decode(&eeprom).unwrap();
    assert_eq!(both, Calibrations { ir: Some(ir), accelerometer: Some(accelerometer) });
    assert_eq!(Calibrations::decode(&eeprom[..41]).unwrap_err().found, 41);
    let [gx, gy, gz] = accelerometer.acceleration_g([531, 520, 638]);
    assert_eq!([gx, gy, gz], [0.0, 0.0, 1.0]);
}

/// A blob whose coordinates end in 0xff is a blob; only y above 767 marks an empty slot.
#[test]
fn blobs_that_end_in_ff_are_blobs() {
    let four = [Some(Blob::at(255, 255)), None, Some(Blob::at(1023, 511)), Some(Blob::at(767, 767))];
    let data = DataReport {
        layout: Layout::IrExtension9,
        buttons: Some(Buttons::A.with(Buttons::HOME)),
        acceleration: None,
        blobs: Some(four),
        extension: Some(Extension::new(&[1; 9])),
    };
    let report = InputReport::Data(data);
    assert_eq!(InputReport::decode(&report.encode()).unwrap(), report);
    let none = decoded("33 00 00 80 80 9a ffffff ffffff ffffff ffffff");
    let InputReport::Data(none) = none else { panic!("a data report") };
    assert_eq!(none.blobs, Some([None; 4]));
    // The bytes of the extended format, worked out by hand: x = 0x234, y = 0x2cd, size 5.
    let InputReport::Data(one) = decoded("33 00 00 80 80 9a 34cda5 ffffff ffffff ffffff") else { panic!() };
    assert_eq!(one.blobs.unwrap()[0], Some(Blob { size: Some(5), ..Blob::at(0x234, 0x2cd) }));
    assert_eq!(Blob::at(10, 0x2cd).pixel(), [10.0, 767.0 - 717.0]);
    assert!(Blob::at(0, 5).is_cut() && Blob::at(5, 767).is_cut() && !Blob::at(5, 5).is_cut());
}

#[test]
fn bytes_that_are_no_report_are_refused() {
    for (hex, message) in [
        ("40 00 00", "unknown report id 0x40"),
        ("33 00 00", "has 3 bytes with its id, expected 18"),
        ("3e 00 00", "expected 22"),
    ] {
        let error = InputReport::decode(&bytes(hex)).unwrap_err().to_string();
        assert!(error.contains(message), "{error}");
    }
    assert_eq!(InputReport::decode(&[]), Err(ReportError::Empty));
    assert!(matches!(InputReport::decode(&[0x30; 23]), Err(ReportError::Length { found: 23, .. })));
}

#[test]
fn halves_that_belong_together_are_one_report() {
    let mut interleaver = Interleaver::default();
    let blob = |x| {
        let extent = BlobExtent { x_min: 1, y_min: 2, x_max: 3, y_max: 4, intensity: 200 };
        Some(Blob { size: Some(3), extent: Some(extent), ..Blob::at(x, 9) })
    };
    let half = |half, acceleration, z_bits, x| InterleavedHalf {
        half,
        buttons: Buttons::default(),
        acceleration,
        z_bits,
        blobs: [blob(x), None],
    };
    assert_eq!(interleaver.push(half(Half::Second, 1, 2, 3)), None, "the first half was not seen");
    assert_eq!(interleaver.push(half(Half::First, 0x80, 0x9, 100)), None);
    let second = half(Half::Second, 0x7f, 0x5, 300);
    let InputReport::Interleaved(second) =
        InputReport::decode(&InputReport::Interleaved(second).encode()).unwrap()
    else {
        panic!("an interleaved half")
    };
    let (acceleration, blobs) = interleaver.push(second).unwrap();
    assert_eq!(acceleration, [0x200, 0x1fc, 0x95 << 2]);
    assert_eq!(blobs, [blob(100), None, blob(300), None]);
    assert_eq!(interleaver.push(second), None, "a half belongs to one pair");
}

/// The frames that a well-known host library was seen to send while it brings the camera up.
#[test]
fn output_reports_are_those_that_hosts_send() {
    let mode = Output::Mode { continuous: false, mode: DataMode::Single(Layout::AccelerationIr) };
    assert_eq!(mode.encode(false)[2], 0x33);
    assert_eq!(Output::Leds(1).encode(true), [0x11, 0x11]);
    assert_eq!(Output::CameraClock(true).encode(false), [0x13, 0x06]);
    assert_eq!(Output::CameraLogic(true).encode(true), [0x1a, 0x07]);
    let write = Output::register(0xb0_0030, &[0x08]).encode(false);
    assert_eq!(write[..7], [0x16, 0x04, 0xb0, 0x00, 0x30, 0x01, 0x08]);
    assert_eq!(write.len(), 22);
    for (hex, expected) in [
        ("12 00 30", Output::Mode { continuous: false, mode: DataMode::Single(Layout::Buttons) }),
        ("15 00", Output::Status),
        ("13 04", Output::CameraClock(true)),
        ("17 00 00 00 16 00 0a", Output::Read { space: MemorySpace::Eeprom, address: 0x16, length: 10 }),
    ] {
        assert_eq!(Output::decode(&bytes(hex)), Ok((expected, false)), "{hex}");
    }
}

/// The slow range turns 270 degrees a second into 0x4400 of 16-bit counts, up for a turn by the
/// right-hand rule.
#[test]
fn rates_follow_their_calibration() {
    let calibration = GyroCalibration::TYPICAL;
    let reading = MotionPlus { counts: [0x2000 + 0x1100, 0x2000, 0x2000], slow: [true; 3], extension: false };
    let [x, y, z] = calibration.rates(&reading);
    assert!((x - 270_f64.to_radians()).abs() < 1e-12 && y == 0.0 && z == 0.0, "{x} {y} {z}");
    let fast = calibration.reading([20.0, -0.5, 0.25]);
    assert_eq!(fast.slow, [false, true, true], "20 radians a second are beyond the slow range");
    for (rate, expected) in calibration.rates(&fast).into_iter().zip([20.0, -0.5, 0.25]) {
        assert!((rate - expected).abs() < 0.001, "{rate} {expected}");
    }
    let stored = calibration.encode([0x0b, 0xe9]);
    assert_eq!(GyroCalibration::decode(&stored), Some(calibration));
    for at in 0..32 {
        let mut broken = stored;
        broken[at] ^= 0x10;
        assert_eq!(GyroCalibration::decode(&broken), None, "byte {at}");
    }
    let no_gain = GyroRange { zero: [5; 3], scale: [5; 3], degrees: 6 };
    let dead = GyroCalibration { fast: no_gain, slow: no_gain };
    assert_eq!(dead.rates(&reading), [0.0; 3]);
}

#[test]
fn recordings_say_where_they_are_wrong() {
    let good = recording_line(5, &bytes("30 00 08"));
    assert_eq!(good, r#"{"t_ns":5,"report":"300008"}"#);
    let read = |text: &str| RecordingReader::new(text.as_bytes()).collect::<Result<Vec<_>, _>>();
    let reports = read(&format!("{good}\n\n  {good}\n")).unwrap();
    assert_eq!(reports.len(), 2);
    assert!(reports[0].report.buttons().unwrap().names().eq(["a"]));
    let long = "x".repeat(300);
    for (bad, message) in [
        (r#"{"t_ns":5,"report":"30000"}"#, "line 2: the report is not 1 to 22 bytes in hexadecimal"),
        (r#"{"t_ns":5,"report":"4000"}"#, "line 2: unknown report id 0x40"),
        (r#"{"t_ns":-5,"report":"3000"}"#, "line 2: invalid value"),
        (r#"{"t_ns":5,"report":"30","x":1}"#, "line 2: unknown field"),
        (long.as_str(), "line 2 is longer than 256 bytes"),
    ] {
        let error = read(&format!("{good}\n{bad}\n{good}")).unwrap_err().to_string();
        assert!(error.contains(message), "{error}");
    }
}

fn any_blob(format: IrFormat) -> impl Strategy<Value = Option<Blob>> {
    let extent = prop::array::uniform4(0_u8..128);
    let parts = (0_u16..1024, 0_u16..768, 0_u8..16, extent, any::<u8>());
    let blob = parts.prop_map(move |(x, y, size, [x_min, y_min, x_max, y_max], intensity)| {
        let extent = BlobExtent { x_min, y_min, x_max, y_max, intensity };
        Blob {
            x,
            y,
            size: (format != IrFormat::Basic).then_some(size),
            extent: (format == IrFormat::Full).then_some(extent),
        }
    });
    prop::option::of(blob)
}

fn any_buttons() -> impl Strategy<Value = Buttons> {
    any::<[u8; 2]>().prop_map(Buttons::from_bytes)
}

fn any_data() -> impl Strategy<Value = InputReport> {
    let layout = prop::sample::select(Layout::ALL.to_vec());
    layout.prop_flat_map(|layout| {
        let blobs = prop::array::uniform4(any_blob(layout.ir().unwrap_or(IrFormat::Basic)));
        let counts = (0_u16..1024, 0_u16..512, 0_u16..512);
        let extension = prop::collection::vec(any::<u8>(), layout.extension_bytes());
        (any_buttons(), counts, blobs, extension).prop_map(move |(buttons, (x, y, z), blobs, bytes)| {
            InputReport::Data(DataReport {
                layout,
                buttons: layout.has_buttons().then_some(buttons),
                acceleration: layout.has_acceleration().then_some([x, y << 1, z << 1]),
                blobs: layout.ir().map(|_| blobs),
                extension: (!bytes.is_empty()).then(|| Extension::new(&bytes)),
            })
        })
    })
}

fn any_other() -> impl Strategy<Value = InputReport> {
    let flags = any::<[bool; 4]>();
    let status = (any_buttons(), flags, 0_u8..16, any::<u8>()).prop_map(|(buttons, flags, leds, battery)| {
        let [battery_low, extension, speaker, camera] = flags;
        InputReport::Status(Status { buttons, battery_low, extension, speaker, camera, leds, battery })
    });
    let memory = (any_buttons(), 0_u8..16, any::<u16>(), 1_u8..=16, any::<[u8; 16]>());
    let memory = memory.prop_map(|(buttons, error, address, length, data)| {
        InputReport::Memory(Memory { buttons, error, address, length, data })
    });
    let ack = (any_buttons(), any::<u8>(), any::<u8>())
        .prop_map(|(buttons, of, error)| InputReport::Acknowledge(Acknowledge { buttons, of, error }));
    let blobs = prop::array::uniform2(any_blob(IrFormat::Full));
    let half = (any::<bool>(), any_buttons(), any::<u8>(), 0_u8..16, blobs);
    let half = half.prop_map(|(first, buttons, acceleration, z_bits, blobs)| {
        let half = if first { Half::First } else { Half::Second };
        InputReport::Interleaved(InterleavedHalf { half, buttons, acceleration, z_bits, blobs })
    });
    prop_oneof![status, memory, ack, half]
}

proptest! {
    /// Invariant: Any bytes from a remote decode or are refused, and decoding inverts encoding.
    #[test]
    fn decoding_undoes_encoding(report in prop_oneof![any_data(), any_other()]) {
        let bytes = report.encode();
        prop_assert_eq!(Some(bytes.len()), input_length(report.id()));
        prop_assert_eq!(InputReport::decode(&bytes), Ok(report));
    }

    /// Invariant: Any bytes from a remote decode or are refused, and decoding inverts encoding.
    #[test]
    fn any_bytes_decode_or_are_refused(bytes in prop::collection::vec(any::<u8>(), 0..30), id in 0x20_u8..0x40) {
        let mut with_id = vec![id];
        with_id.extend(&bytes);
        for bytes in [&bytes, &with_id] {
            if let Ok(report) = InputReport::decode(bytes) {
                prop_assert_eq!(InputReport::decode(&report.encode()), Ok(report));
            }
            if let Ok((output, rumble)) = Output::decode(bytes) {
                prop_assert_eq!(Output::decode(&output.encode(rumble)), Ok((output, rumble)));
            }
            let _ = MotionPlus::decode(bytes);
            let _ = Calibrations::decode(bytes);
            for line in RecordingReader::new(bytes.as_slice()) {
                if line.is_err() { break; }
            }
        }
    }

    #[test]
    fn motion_plus_round_trips(counts in prop::array::uniform3(0_u16..16384), slow: [bool; 3], extension: bool) {
        let reading = MotionPlus { counts, slow, extension };
        prop_assert_eq!(MotionPlus::decode(&reading.encode()), Some(reading));
    }
}

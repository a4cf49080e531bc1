//! `relief track` as users run it: recordings made and tracked, against the truth that the
//! recording was made with.
#![allow(clippy::unwrap_used, reason = "a test may panic, in its helpers too")]

use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use serde_json::Value;

fn relief(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relief"));
    command.arg("track").args(arguments).env_remove("RELIEF_LOG");
    command
}

fn run(arguments: &[&str]) -> Output {
    relief(arguments).output().expect("the program runs")
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn json_lines(text: &[u8]) -> Vec<Value> {
    std::str::from_utf8(text).unwrap().lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A recording of `seconds` and its truth, in this folder.
fn recording(folder: &Path, more: &[&str]) -> (String, Vec<Value>) {
    let [out, truth] = ["rec.jsonl", "truth.jsonl"].map(|name| text(&folder.join(name)).to_owned());
    let made = run(&[&["simulate", "--out", &out, "--truth", &truth], more].concat());
    assert!(made.status.success(), "{}", stderr(&made));
    (out, json_lines(&std::fs::read(truth).unwrap()))
}

fn vector(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

/// Distance in mm and angle in degrees between a pose and the truth of its time.
fn errors(pose: &Value, truth: &[Value]) -> Option<(f64, f64)> {
    let truth = truth.iter().find(|truth| truth["t_ns"] == pose["t_ns"])?;
    let pairs =
        |key: &str| -> Vec<(f64, f64)> { vector(&pose[key]).into_iter().zip(vector(&truth[key])).collect() };
    let distance = pairs("position_mm").iter().map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    let dot: f64 = pairs("orientation_xyzw").iter().map(|(a, b)| a * b).sum();
    Some((distance, 2.0 * dot.abs().min(1.0).acos().to_degrees()))
}

fn rms(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let count = values.clone().count() as f64;
    (values.map(|value| value * value).sum::<f64>() / count).sqrt()
}

#[test]
fn a_recording_is_tracked_to_the_truth() {
    let folder = tempfile::tempdir().unwrap();
    let (reports, truth) = recording(folder.path(), &["--seconds", "6", "--mishaps", "--seed", "3"]);
    let out = folder.path().join("poses.jsonl");
    let mut spreads = Vec::new();
    for more in
        [&[][..], &["--no-filter"], &["--no-filter", "--solver", "interior-point"], &["--filter", "pose"]]
    {
        let tracked = run(&[&["--reports", &reports, "--out", text(&out)], more].concat());
        assert!(tracked.status.success(), "{}", stderr(&tracked));
        assert!(stderr(&tracked).contains("late and"), "{}", stderr(&tracked));
        let poses = json_lines(&std::fs::read(&out).unwrap());
        let tracking = poses.iter().filter(|pose| pose["state"] == "tracking");
        assert!(tracking.clone().count() * 100 >= poses.len() * 95, "{more:?}: {}", stderr(&tracked));
        let errors: Vec<_> = tracking.filter_map(|pose| errors(pose, &truth)).collect();
        assert!(errors.len() > 500);
        spreads.push((rms(errors.iter().map(|e| e.0)), rms(errors.iter().map(|e| e.1))));
    }
    let [filtered, single, paper, plain] = spreads[..] else { panic!() };
    assert!(filtered.0 < 12.0 && filtered.1 < 0.5, "{spreads:?} mm, degrees");
    assert!(filtered.0 < single.0 && filtered.1 < single.1, "{spreads:?}");
    assert!(plain.1 < single.1, "{spreads:?}");
    assert!((0.9..1.5).contains(&(paper.0 / single.0)), "{spreads:?}");
}

/// `ipopt` and `interior-point` minimise the same energy; a build without IPOPT says that it takes
/// its own solver.
#[test]
fn the_solvers_of_the_paper_agree() {
    let folder = tempfile::tempdir().unwrap();
    let (reports, _) = recording(folder.path(), &["--seconds", "2"]);
    let solved = |solver: &str| {
        let output = run(&["--reports", &reports, "--no-filter", "--solver", solver]);
        assert!(output.status.success(), "{}", stderr(&output));
        let poses = json_lines(&output.stdout).into_iter().filter(|pose| pose["state"] == "tracking");
        (poses.map(|pose| vector(&pose["position_mm"])).collect::<Vec<_>>(), stderr(&output))
    };
    let (ours, quiet) = solved("interior-point");
    let (theirs, reported) = solved("ipopt");
    assert!(ours.len() > 150 && ours.len() == theirs.len(), "{} {}", ours.len(), theirs.len());
    for (a, b) in ours.iter().flatten().zip(theirs.iter().flatten()) {
        assert!((a - b).abs() < 1e-3, "{a} {b}");
    }
    let said = reported.matches("this build has no IPOPT").count();
    assert_eq!(said, usize::from(cfg!(not(feature = "ipopt"))), "{reported}");
    assert!(!quiet.contains("IPOPT"), "{quiet}");
    assert_eq!(solved("paper").0, ours, "the old name");
}

/// A focal length that is 3 % too short puts the sensor 3 % too near: the file of the camera is
/// used.
#[test]
fn the_camera_and_the_beacon_come_from_files() {
    let folder = tempfile::tempdir().unwrap();
    let (reports, truth) = recording(folder.path(), &["--seconds", "2"]);
    let camera = folder.path().join("camera.yaml");
    let matrix = "data: [1299.8, 0., 511.5, 0., 1299.8, 383.5, 0., 0., 1.]";
    let yaml = format!(
        "%YAML:1.0\n---\ncamera_matrix: !!opencv-matrix\n  rows: 3\n  cols: 3\n  dt: d\n  {matrix}\n\
         distortion_coefficients: !!opencv-matrix\n  rows: 1\n  cols: 5\n  dt: d\n  data: [0., 0., 0., 0., 0.]\n"
    );
    std::fs::write(&camera, yaml).unwrap();
    let beacon = folder.path().join("beacon.toml");
    std::fs::write(&beacon, run(&["beacon"]).stdout).unwrap();
    let tracked = run(&["--reports", &reports, "--sensor", text(&camera), "--beacon", text(&beacon)]);
    assert!(tracked.status.success(), "{}", stderr(&tracked));
    let poses = json_lines(&tracked.stdout);
    let last = poses.last().unwrap();
    let truth = truth.iter().find(|truth| truth["t_ns"] == last["t_ns"]).unwrap();
    let [z, true_z] = [last, truth].map(|pose| vector(&pose["position_mm"])[2]);
    assert!((z / true_z - 0.97).abs() < 0.01, "{z} {true_z}");
}

#[test]
fn wrong_input_is_refused_and_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let (reports, _) = recording(folder.path(), &["--seconds", "1"]);
    let broken = folder.path().join("broken.jsonl");
    let whole = std::fs::read_to_string(&reports).unwrap();
    std::fs::write(&broken, whole.replacen("\"report\":\"33", "\"report\":\"93", 1)).unwrap();
    let out = folder.path().join("poses.jsonl");
    let none = folder.path().join("none");
    for (arguments, status, message) in [
        (vec!["--reports", text(&broken), "--out", text(&out)], 1, "line 1: unknown report id 0x93"),
        (vec!["--reports", text(&none)], 1, "cannot read"),
        (vec!["--reports", &reports, "--beacon", &reports], 1, "is not a beacon file"),
        (vec!["--reports", &reports, "--sensor", &reports], 1, "is not a camera file"),
        (vec!["--reports", "tcp://127.0.0.1:1"], 1, "cannot reach"),
        (vec![], 2, "--reports SOURCE is missing"),
        (vec!["--reports", &reports, "--noise-px", "0"], 2, "allowed: 0.01 to 20 px"),
        (vec!["--reports", &reports, "--predict-ms", "51"], 2, "51 is not in 0..=50"),
        (vec!["--reports", &reports, "--record", text(&out)], 1, "--record is for live sources"),
    ] {
        let output = run(&arguments);
        assert_eq!(output.status.code(), Some(status), "{arguments:?}: {}", stderr(&output));
        assert!(stderr(&output).contains(message), "{arguments:?}: {}", stderr(&output));
        assert!(!out.exists());
    }
}

/// The same recording from stdin and over a socket gives the same poses.
#[test]
fn reports_come_from_stdin_and_from_sockets_too() {
    let folder = tempfile::tempdir().unwrap();
    let (reports, _) = recording(folder.path(), &["--seconds", "2"]);
    let positions = |output: &Output| -> Vec<Value> {
        assert!(output.status.success(), "{}", stderr(output));
        json_lines(&output.stdout).iter().map(|pose| pose["position_mm"].clone()).collect()
    };
    let expected = positions(&run(&["--reports", &reports]));
    assert!(expected.len() > 150);
    let piped = relief(&["--reports", "-"]).stdin(std::fs::File::open(&reports).unwrap()).output().unwrap();
    assert_eq!(positions(&piped), expected);

    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("tcp://{}", listener.local_addr().unwrap());
    let bytes = std::fs::read(&reports).unwrap();
    let sender =
        std::thread::Builder::new().spawn(move || listener.accept().unwrap().0.write_all(&bytes)).unwrap();
    let received = run(&["--reports", &address]);
    sender.join().unwrap().unwrap();
    assert_eq!(positions(&received), expected);
}

/// A client of our own reads TRANSFORM and POSITION, asks for TDATA and gets it.
#[test]
fn poses_are_published_over_openigtlink() {
    let folder = tempfile::tempdir().unwrap();
    let (reports, _) = recording(folder.path(), &["--seconds", "5"]);
    let mut child = relief(&["--reports", &reports, "--realtime", "--igtl", "127.0.0.1:0", "--json"])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut errors = std::io::BufReader::new(child.stderr.take().unwrap());
    let mut line = String::new();
    std::io::BufRead::read_line(&mut errors, &mut line).unwrap();
    let address = line.trim().strip_prefix("OpenIGTLink on ").unwrap().to_owned();
    let mut stream = TcpStream::connect(address).unwrap();
    let request = relief_tracking::igtl_message("STT_TDATA", "", 0, &[0; 36]);
    stream.write_all(&request).unwrap();
    let mut kinds = std::collections::BTreeMap::new();
    while kinds.get("TDATA").is_none_or(|count: &usize| *count < 20) {
        let mut head = [0; 58];
        stream.read_exact(&mut head).unwrap();
        let header = relief_tracking::IgtlHeader::decode(&head).unwrap();
        let mut body = vec![0; header.body_bytes];
        stream.read_exact(&mut body).unwrap();
        // A tool that is not seen yet is left out of TDATA.
        let expected = [("TRANSFORM", 48), ("POSITION", 28), ("TDATA", 70), ("TDATA", 0), ("RTS_TDATA", 1)];
        assert!(expected.contains(&(header.kind.as_str(), body.len())), "{header:?}");
        *kinds.entry(header.kind).or_insert(0) += usize::from(!body.is_empty());
    }
    assert!(kinds["TRANSFORM"] >= 20 && kinds["POSITION"] >= 20 && kinds["RTS_TDATA"] == 1, "{kinds:?}");
    child.kill().unwrap();
    child.wait().unwrap();
}

/// A survey gives the simulated camera's parameters; a hand that only points is refused, with the
/// reason.
#[test]
fn a_camera_is_calibrated_from_a_survey() {
    let folder = tempfile::tempdir().unwrap();
    let (survey, _) = recording(folder.path(), &["--path", "survey", "--seconds", "60"]);
    let camera = folder.path().join("camera.yaml");
    let calibrate = |reports: &str, more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_relief"));
        command.args(["calibrate", "--reports", reports, "--out", text(&camera)]).args(more).output().unwrap()
    };
    let found = calibrate(&survey, &["--json", "--format", "ros"]);
    assert!(found.status.success(), "{}", stderr(&found));
    let report: Value = serde_json::from_slice(&found.stdout).unwrap();
    let sigma = vector(&report["sigma_fx_fy_skew_cx_cy_k1_k2"]);
    let matrix = vector(&report["camera_matrix"]);
    let covariance = vector(&report["covariance"]);
    // One focal length: fx and fy are one number; the skew was not looked for.
    let [fx, fx_fy, fy] = [covariance[0], covariance[1], covariance[8]];
    assert!(covariance.len() == 49 && fx == fx_fy && fx == fy && (fx.sqrt() / sigma[0] - 1.0).abs() < 1e-12);
    assert!(covariance[2] == 0.0 && covariance[16] == 0.0 && covariance[3].abs() < sigma[0] * sigma[3]);
    assert!((matrix[0] - 1340.0).abs() < 4.0 * sigma[0] && sigma[0] < 10.0, "{report}");
    assert!(report["held_out_rms_px"].as_f64().unwrap() < 0.7, "{report}");
    let written = std::fs::read_to_string(&camera).unwrap();
    let read = relief_tracking::read_camera(&written).unwrap();
    assert_eq!(read.fx, matrix[0]);

    std::fs::remove_file(&camera).unwrap();
    let (still, _) = recording(folder.path(), &["--seconds", "5"]);
    let refused = calibrate(&still, &[]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(stderr(&refused).contains("needed: at least"), "{}", stderr(&refused));
    assert!(!camera.exists());
}

/// Blobs in full take two reports a picture: half as many poses, as good.
#[test]
fn blobs_in_full_are_tracked() {
    let folder = tempfile::tempdir().unwrap();
    let (reports, truth) = recording(folder.path(), &["--seconds", "4", "--full", "--seed", "5"]);
    let tracked = run(&["--reports", &reports]);
    assert!(tracked.status.success(), "{}", stderr(&tracked));
    let poses = json_lines(&tracked.stdout);
    let reported = std::fs::read_to_string(&reports).unwrap().lines().count();
    assert!(poses.len() * 2 <= reported && poses.len() * 2 + 2 >= reported, "{} of {reported}", poses.len());
    let errors: Vec<_> = poses.iter().skip(20).filter_map(|pose| errors(pose, &truth)).collect();
    assert!(errors.len() > 150, "{}", errors.len());
    assert!(rms(errors.iter().map(|e| e.0)) < 20.0 && rms(errors.iter().map(|e| e.1)) < 1.0);
}

/// A lens focused at 1.4 m blurs an LED at z into a disc of A v |1/z - 1/1400|; sizes are in sensor
/// pixels of 8 units.
#[test]
fn a_lens_makes_blobs_larger_out_of_focus() {
    let folder = tempfile::tempdir().unwrap();
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    // Mean size of the blobs, and mean distance from the beacon's origin.
    let measure = |more: &[&str]| -> [f64; 2] {
        let (reports, truth) =
            recording(folder.path(), &[&["--seconds", "2", "--distance-mm", "800"], more].concat());
        let lines = json_lines(&std::fs::read(reports).unwrap());
        let byte = |hex: &str, at: usize| u8::from_str_radix(&hex[2 * at..2 * at + 2], 16).unwrap();
        let blobs = lines.iter().flat_map(|line| {
            let hex = line["report"].as_str().unwrap();
            [8, 11, 14, 17].map(|at| f64::from(byte(hex, at) & 15))
        });
        let distances: Vec<f64> = truth.iter().map(|truth| vector(&truth["position_mm"])[2]).collect();
        [mean(&blobs.collect::<Vec<_>>()), mean(&distances)]
    };
    let [blurred, distance] = measure(&["--lens", "4,8,1400"]);
    let expected = 1340.0 * (5.0 / distance + 8.0 * (1.0 / distance - 1.0 / 1400.0).abs()) / 8.0;
    // Sizes are whole, and the LEDs lie within 120 mm in depth.
    assert!((blurred - expected).abs() < 0.5, "{blurred} {expected}");
    let [sharp, _] = measure(&[]);
    assert!((sharp - 1340.0 * 5.0 / distance / 8.0).abs() < 0.3, "{sharp}");
    let refused = run(&["simulate", "--out", text(&folder.path().join("x")), "--lens", "4,2,3"]);
    assert!(stderr(&refused).contains("more than the focal length of 4 mm"), "{}", stderr(&refused));
}

/// The EEPROM of a real remote, as published, moves the start of a calibration to where its factory
/// saw four points.
#[test]
fn a_calibration_starts_at_what_the_eeprom_says() {
    let folder = tempfile::tempdir().unwrap();
    let (survey, _) = recording(folder.path(), &["--path", "survey", "--seconds", "30"]);
    let block = |hex: &str| relief_tracking::bytes_of_hex(hex).unwrap();
    let (ir, accelerometer) = (block("88858b8b8a973f308c39cd"), block("848286309f9d9f02402e"));
    let eeprom = folder.path().join("eeprom.bin");
    let camera = folder.path().join("camera.yaml");
    let calibrate = |reports: &str, more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_relief"));
        command.args(["calibrate", "--json", "--reports", reports, "--out", text(&camera)]);
        command.args(more).output().unwrap()
    };
    let start = |output: Output| -> Vec<f64> {
        assert!(output.status.success(), "{}", stderr(&output));
        vector(&serde_json::from_slice::<Value>(&output.stdout).unwrap()["start_fx_cx_cy"])
    };
    // Corners (136,645) (907,650) (919,63) (140,57): 775 wide, middle (525.5, 353.75), y up.
    let expected = [1340.0 * 775.0 / 769.0, 525.5, 767.0 - 353.75];
    let is_expected = |found: &[f64]| found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 0.5);
    std::fs::write(&eeprom, [&ir[..], &ir, &accelerometer, &accelerometer].concat()).unwrap();
    let reported = start(calibrate(&survey, &["--prior", text(&eeprom)]));
    assert!(is_expected(&reported), "{reported:?}");
    assert_eq!(start(calibrate(&survey, &[])), [1340.0, 511.5, 383.5]);
    // A recording of the remote itself has the answer to the host's question: 16 bytes from address
    // 0.
    let hex: String = [&ir[..], &ir[..5]].concat().iter().map(|byte| format!("{byte:02x}")).collect();
    let reported = format!("{{\"t_ns\":1,\"report\":\"210000f00000{hex}\"}}\n");
    let with_memory = folder.path().join("with-memory.jsonl");
    std::fs::write(&with_memory, reported + &std::fs::read_to_string(&survey).unwrap()).unwrap();
    let reported = start(calibrate(text(&with_memory), &[]));
    assert!(is_expected(&reported), "{reported:?}");
    // Both copies damaged.
    let damaged: Vec<u8> = [&ir[1..], &ir[..], &accelerometer, &accelerometer, &[0]].concat();
    std::fs::write(&eeprom, damaged).unwrap();
    let refused = calibrate(&survey, &["--prior", text(&eeprom)]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(stderr(&refused).contains("checksum"), "{}", stderr(&refused));
}

/// Invariant: With a calibrated camera and the filter, the robot experiment stays within 1.2 times
/// the Cramer-Rao bound of a known camera.
///
/// The table of the experiment: our errors are far below the published ones, and the files of plots
/// and numbers exist.
#[test]
#[ignore = "takes a minute: the whole experiment, in scripts/test --all"]
fn the_experiment_prints_its_table_beside_the_published_one() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("results");
    let done = run(&["experiment", "--repeats", "1", "--json", "--out", text(&out)]);
    assert!(done.status.success(), "{}", stderr(&done));
    let report: Value = serde_json::from_slice(&done.stdout).unwrap();
    let published = vector(&report["paper_mean"]);
    assert_eq!(published, [0.162, 0.286, 0.384, 0.411, 4.94]);
    let ways = report["ways"].as_array().unwrap();
    let way =
        |name: &str| ways.iter().find(|way| way["way"] == name).unwrap()["outcomes"].as_array().unwrap();
    let means = |name: &str| -> Vec<f64> { way(name).iter().map(|o| o["mean"].as_f64().unwrap()).collect() };
    // Within the accuracy of a surgeon's pointer, all below the published errors, and close to the
    // bound of the run.
    for outcome in [way("true camera, filtered"), way("calibrated, filtered")] {
        for (outcome, limit) in outcome.iter().zip([0.05, 0.08, 0.1, 0.1, 0.5]) {
            let [mean, rms, bound] = ["mean", "rms", "bound"].map(|key| outcome[key].as_f64().unwrap());
            assert!(mean <= limit && rms <= 1.2 * bound, "{mean} above {limit}, or {rms} far above {bound}");
        }
    }
    assert!(means("paper's way, f = 1320")[4] > 5.0 * means("calibrated, filtered")[4]);
    for name in ["r-x", "r-y", "t-x", "t-y", "t-z", "overview"] {
        plot_is_readable(&out.join(name));
    }
    let shown = std::fs::read_to_string(out.join("t-z.svg")).unwrap();
    let ours = format!("{:.3} (", means("calibrated, filtered")[4]);
    for text in ["published (2009)", "4.940 (2.220)", "calibrated, filtered", &ours] {
        assert!(shown.contains(&format!(">{text}")), "{text}");
    }
    assert_eq!(std::fs::read_to_string(out.join("table.csv")).unwrap().lines().count(), 1 + 5 + 25);
}

/// An SVG that is well formed and has texts and lines, and a PNG of its shape with ink in many
/// colours.
fn plot_is_readable(path: &Path) {
    let svg = std::fs::read_to_string(path.with_extension("svg")).unwrap();
    let mut reader = quick_xml::Reader::from_str(&svg);
    let (mut size, mut lines, mut texts) = (Vec::new(), 0, 0);
    loop {
        match reader.read_event().unwrap() {
            quick_xml::events::Event::Start(tag) => match tag.name().as_ref() {
                "svg" => {
                    let view = tag.try_get_attribute("viewBox").unwrap().unwrap();
                    size =
                        view.value.split(' ').skip(2).map(|number| number.parse::<u32>().unwrap()).collect();
                }
                "path" => lines += 1,
                "text" => texts += 1,
                _ => {}
            },
            quick_xml::events::Event::Eof => break,
            _ => {}
        }
    }
    assert!(lines > 30 && texts > 20, "{}: {lines} lines, {texts} texts", path.display());
    let picture = image::open(path.with_extension("png")).unwrap().to_rgb8();
    assert_eq!([picture.width(), picture.height()].as_slice(), size);
    let mut colors = std::collections::BTreeMap::new();
    picture.pixels().for_each(|pixel| *colors.entry(pixel.0).or_insert(0_u32) += 1);
    let inks = colors.values().filter(|count| **count > 300).count();
    let white = f64::from(colors[&[255; 3]]) / f64::from(picture.width() * picture.height());
    assert!(inks >= 8 && (0.7..0.99).contains(&white), "{}: {inks} inks, {white} white", path.display());
}

#[test]
fn the_recommended_beacon_scores_well_and_a_symmetric_one_does_not() {
    let folder = tempfile::tempdir().unwrap();
    let design = |more: &[&str]| -> Value {
        let done = run(&[&["design", "--json", "--views", "200"], more].concat());
        assert!(done.status.success(), "{}", stderr(&done));
        serde_json::from_slice::<Value>(&done.stdout).unwrap()["score"].clone()
    };
    let recommended = design(&[]);
    assert!(recommended["right"].as_u64().unwrap() >= 198 && recommended["wrong"] == 0, "{recommended}");
    let symmetric = folder.path().join("symmetric.toml");
    let leds = [[-50, 0, 0], [50, 0, 0], [0, 30, 60], [0, -30, 60]]
        .map(|p| format!("[[led]]\nposition_mm = {p:?}\n"));
    std::fs::write(&symmetric, leds.concat()).unwrap();
    let poor = design(&["--no-gravity", "--beacon", text(&symmetric)]);
    assert!(poor["right"] == 0 && poor["wrong"] == 0, "{poor}");
}

/// The meaning of buttons and movements of a recording, as a live session takes it.
#[test]
fn intents_are_what_a_recording_means() {
    let folder = tempfile::tempdir().unwrap();
    let presses = ["--seconds", "6", "--press", "b:1:3", "--press", "a:4:4.5", "--press", "plus:5:5.5"];
    let (recording, _) = recording(folder.path(), &presses);
    let [out, intents, hand] =
        ["poses.jsonl", "intents.jsonl", "hand.json"].map(|name| folder.path().join(name));
    std::fs::write(&hand, r#"{"gain":2.0,"zoom_per_s":4.0}"#).unwrap();
    let arguments = ["--reports", &recording, "--out", text(&out), "--intents", text(&intents)];
    let tracked = run(&[&arguments[..], &["--hand", text(&hand)]].concat());
    assert!(tracked.status.success(), "{}", stderr(&tracked));
    let lines = json_lines(&std::fs::read(&intents).unwrap());
    let times = |name: &str| -> Vec<f64> {
        let of = lines.iter().filter(|line| line["intent"] == name);
        of.map(|line| line["t_ns"].as_f64().unwrap() * 1e-9 - 1.0).collect()
    };
    let moves = times("move");
    assert!(moves.len() > 150 && moves.iter().all(|t| (1.0..3.02).contains(t)), "{}", moves.len());
    let ([grab, ..], [release]) = (&times("grab")[..], &times("release")[..]) else { panic!("a grab") };
    assert!((grab - 1.0).abs() < 0.02 && (release - 3.0).abs() < 0.02, "{grab} {release}");
    assert_eq!(times("place").len(), 2);
    let factor: f64 = lines.iter().filter_map(|line| line["factor"].as_f64()).product();
    assert!((factor - 2.0).abs() < 0.05, "half a second at 4 a second: {factor}");

    std::fs::write(&hand, r#"{"gain":0}"#).unwrap();
    let refused = run(&[&arguments[..], &["--hand", text(&hand)]].concat());
    assert_eq!(refused.status.code(), Some(1));
    assert!(stderr(&refused).contains("gain is 0, allowed: 0.05 to 20"), "{}", stderr(&refused));
}

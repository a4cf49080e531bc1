//! Networks of other programs: ONNX in the layout of MiDaS and Depth Anything.
//!
//! The networks are written here, in the wire format of ONNX (onnx.proto, protocol buffers).

use super::*;

/// A field of a message: its number and its bytes.
fn field(number: u8, bytes: &[u8]) -> Vec<u8> {
    [&[number << 3 | 2, bytes.len() as u8 & 0x7f | 0x80, (bytes.len() >> 7) as u8][..], bytes].concat()
}

fn integer(number: u8, value: u8) -> Vec<u8> {
    vec![number << 3, value]
}

/// A tensor of floats in the graph's interface: sides that are fixed, or 0 for open ones.
fn interface(name: &str, sides: &[u8]) -> Vec<u8> {
    let side = |side: &u8| match side {
        0 => field(1, &field(2, b"side")),
        _ => field(1, &[&integer(1, side & 0x7f | 0x80)[..], &[side >> 7]].concat()),
    };
    let shape: Vec<u8> = sides.iter().flat_map(side).collect();
    let tensor = [integer(1, 1), field(2, &shape)].concat();
    [field(1, name.as_bytes()), field(2, &field(1, &tensor))].concat()
}

/// An attribute of a node: its name, its value as a field, and its type (field 20).
fn attribute(name: &[u8], value: &[u8], kind: u8) -> Vec<u8> {
    field(5, &[&field(1, name)[..], value, &[0xa0, 0x01, kind]].concat())
}

/// A network of one node over the colours, such as `ReduceMean`.
fn network(node: &str, input: &[u8], output: &[u8], keep_channel: u8) -> Vec<u8> {
    let (of_integers, of_integer) = (7, 2);
    let node = [
        field(1, b"pixel_values"),
        field(2, b"predicted_depth"),
        field(4, node.as_bytes()),
        attribute(b"axes", &integer(8, 1), of_integers),
        attribute(b"keepdims", &integer(3, keep_channel), of_integer),
    ]
    .concat();
    let graph = [
        field(1, &node),
        field(2, b"mean"),
        field(11, &interface("pixel_values", input)),
        field(12, &interface("predicted_depth", output)),
    ]
    .concat();
    let version_8_with_operators_11 =
        [integer(1, 8), field(7, &graph), field(8, &[field(1, b""), integer(2, 11)].concat())];
    version_8_with_operators_11.concat()
}

/// Z of the converted picture, 16 bits, nearest brightest.
fn converted(
    folder: &Path,
    network: &[u8],
    picture: &Path,
) -> image::ImageBuffer<image::Luma<u16>, Vec<u16>> {
    let (model, out) = (folder.join("network.onnx"), folder.join("z.png"));
    std::fs::write(&model, network).unwrap();
    let layout = ["--layout", "depth16", "--out", text(&out)];
    ok(&relief(&[&["convert", text(picture), "--model", text(&model)][..], &layout].concat()));
    image::open(&out).unwrap().into_luma16()
}

#[test]
fn brightness_as_inverse_depth_comes_out_as_nearness() {
    let folder = tempfile::tempdir().unwrap();
    let ramp = image::RgbImage::from_fn(200, 120, |x, _| image::Rgb([(x + 20) as u8; 3]));
    let path = saved(folder.path(), "ramp.png", &ramp);
    let open = network("ReduceMean", &[1, 3, 0, 0], &[1, 0, 0], 0);
    let fixed = network("ReduceMean", &[1, 3, 96, 128], &[1, 1, 96, 128], 1);
    for (name, file) in [("open sides", open), ("fixed sides", fixed)] {
        let z = converted(folder.path(), &file, &path);
        assert_eq!(z.dimensions(), (200, 120));
        for x in (10..190).step_by(20) {
            let [here, right] = [x, x + 8].map(|x| z.get_pixel(x, 60).0[0]);
            assert!(right > here, "{name}: brighter is nearer, but at {x}: {here} and {right}");
            let expected = 65535.0 * f64::from(x) / 199.0;
            assert!((f64::from(here) - expected).abs() < 2500.0, "{name}: {here} at {x}, not {expected}");
        }
    }
}

#[test]
fn networks_that_do_not_fit_are_refused_with_what_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let path = saved(folder.path(), "plain.png", &picture([64, 48], 10));
    let (model, out) = (folder.path().join("network.onnx"), folder.path().join("z.png"));
    let said = |file: &[u8]| {
        std::fs::write(&model, file).unwrap();
        refusal(&["convert", text(&path), "--model", text(&model), "--out", text(&out)])
    };
    let whole = network("ReduceMean", &[1, 3, 0, 0], &[1, 0, 0], 0);
    assert!(said(&network("ReduceMean", &[1, 4, 0, 0], &[1, 0, 0], 0)).contains("1 x 3 x height x width"));
    assert!(said(&network("NoSuchNode", &[1, 3, 0, 0], &[1, 0, 0], 0)).contains("cannot be loaded"));
    assert!(said(b"\x89PNG").contains("cannot be loaded"));
    assert!(!out.exists());
    for end in (1..whole.len()).step_by(7) {
        std::fs::write(&model, &whole[..end]).unwrap();
        let output = relief(&["convert", text(&path), "--model", text(&model), "--out", text(&out)]);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(matches!(output.status.code(), Some(0 | 1)) && !said.contains("panicked"), "{end}: {said}");
    }
}

//! Camera files: the YAML of OpenCV's file storage and of ROS' `camera_info`.
//!
//! Both name the same numbers: `image_width`, `image_height`, `camera_matrix` and
//! `distortion_coefficients` (`plumb_bob`: k1, k2, p1, p2, k3). The skew stands in the matrix, row
//! 0, column 1; OpenCV's own calibration always has 0 there. Pixels are u right, v **down**: the
//! raw y of reports is 767 - v.

use std::fmt::Write;

pub use super::yaml::YamlError;
use super::yaml::{self, Flat, Value};
use super::{Pinhole, PinholeError};
use crate::report::{SENSOR_HEIGHT, SENSOR_WIDTH};

/// How a camera file is written; both are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CameraFormat {
    /// `%YAML:1.0` with `!!opencv-matrix`, as `cv::FileStorage` reads it.
    OpenCv,
    /// `camera_info`, as ROS' camera calibration reads it.
    Ros,
}

/// An invalid camera file.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CameraFileError {
    /// Not the YAML of a camera file.
    #[error("{0}")]
    Yaml(#[from] YamlError),
    /// A key that has to be there.
    #[error(
        "key `{0}` is missing; expected the YAML of OpenCV or ROS with camera_matrix and distortion_coefficients"
    )]
    Missing(&'static str),
    /// A value that is no number, or not as many numbers as there should be.
    #[error("`{key}` is {found}, expected {expected}")]
    Value {
        /// The key's path.
        key: &'static str,
        /// The value.
        found: String,
        /// The expected content.
        expected: &'static str,
    },
    /// Numbers that no camera has.
    #[error(transparent)]
    Camera(#[from] PinholeError),
}

/// Reads a camera file of a Wiimote.
///
/// # Errors
/// When it is not a camera file, has another distortion model or another size than 1024 x 768, or a
/// value is out of range.
pub fn read_camera(text: &str) -> Result<Pinhole, CameraFileError> {
    let flat = yaml::parse(text)?;
    for (key, expected) in [("image_width", SENSOR_WIDTH), ("image_height", SENSOR_HEIGHT)] {
        let Some(value) = flat.get(key) else { continue };
        if !matches!(value, Value::Text(text) if text.parse() == Ok(f64::from(expected))) {
            return Err(CameraFileError::Value {
                key,
                found: describe(value),
                expected: "that of 1024 x 768",
            });
        }
    }
    if let Some(Value::Text(model)) = flat.get("distortion_model")
        && model != "plumb_bob"
    {
        let (key, found) = ("distortion_model", model.chars().take(40).collect());
        return Err(CameraFileError::Value { key, found, expected: "plumb_bob" });
    }
    let k = numbers(&flat, "camera_matrix/data", "9 numbers")?;
    let &[fx, skew, cx, zero, fy, cy, a, b, one] = k.as_slice() else {
        return Err(wrong_count("camera_matrix/data", k.len(), "9 numbers"));
    };
    if [zero, a, b, one] != [0.0, 0.0, 0.0, 1.0] {
        let expected = "(fx, skew, cx; 0, fy, cy; 0, 0, 1)";
        return Err(CameraFileError::Value { key: "camera_matrix/data", found: format!("{k:?}"), expected });
    }
    Ok(Pinhole { fx, fy, skew, cx, cy, distortion: distortion(&flat)? }.checked()?)
}

/// Four coefficients leave k3 zero; of more than five, the others have to be zero: they are another
/// model's.
fn distortion(flat: &Flat) -> Result<[f64; 5], CameraFileError> {
    const KEY: &str = "distortion_coefficients/data";
    const EXPECTED: &str = "4 or 5 numbers: k1, k2, p1, p2, k3";
    if !flat.contains_key(KEY) {
        return Err(CameraFileError::Missing("distortion_coefficients"));
    }
    let found = numbers(flat, KEY, EXPECTED)?;
    let beyond = found.iter().skip(5).any(|k| *k != 0.0);
    if found.len() < 4 || found.len() > 14 || beyond {
        return Err(wrong_count(KEY, found.len(), EXPECTED));
    }
    let mut coefficients = [0.0; 5];
    for (coefficient, found) in coefficients.iter_mut().zip(found) {
        *coefficient = found;
    }
    Ok(coefficients)
}

fn numbers(flat: &Flat, key: &'static str, expected: &'static str) -> Result<Vec<f64>, CameraFileError> {
    let value = flat.get(key).ok_or(CameraFileError::Missing(key))?;
    let wrong = || CameraFileError::Value { key, found: describe(value), expected };
    let Value::List(items) = value else { return Err(wrong()) };
    items.iter().map(|item| item.parse().map_err(|_| wrong())).collect()
}

fn wrong_count(key: &'static str, found: usize, expected: &'static str) -> CameraFileError {
    CameraFileError::Value { key, found: format!("{found} numbers"), expected }
}

fn describe(value: &Value) -> String {
    let text = match value {
        Value::Text(text) => text.clone(),
        Value::List(items) => format!("[{}]", items.join(", ")),
    };
    text.chars().take(60).collect()
}

/// Writes a camera file; numbers are written so that they read back as they are.
#[must_use]
pub fn write_camera(camera: &Pinhole, format: CameraFormat) -> String {
    let Pinhole { fx, fy, skew, cx, cy, distortion } = *camera;
    let (opencv, mut text) = match format {
        CameraFormat::OpenCv => (true, "%YAML:1.0\n---\n".to_owned()),
        CameraFormat::Ros => (false, String::new()),
    };
    let _ = writeln!(text, "image_width: {SENSOR_WIDTH}\nimage_height: {SENSOR_HEIGHT}");
    if !opencv {
        text.push_str("camera_name: wiimote\n");
    }
    matrix(&mut text, opencv, "camera_matrix", 3, &[fx, skew, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]);
    if !opencv {
        text.push_str("distortion_model: plumb_bob\n");
    }
    matrix(&mut text, opencv, "distortion_coefficients", 1, &distortion);
    if !opencv {
        matrix(&mut text, opencv, "rectification_matrix", 3, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        let p = [fx, skew, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0];
        matrix(&mut text, opencv, "projection_matrix", 3, &p);
    }
    text
}

fn matrix(text: &mut String, opencv: bool, key: &str, rows: usize, data: &[f64]) {
    let (tag, kind) = if opencv { (" !!opencv-matrix", "  dt: d\n") } else { ("", "") };
    // `{:?}` is the shortest number that reads back the same, and keeps a point, by which OpenCV
    // knows reals.
    let data_text: Vec<_> = data.iter().map(|number| format!("{number:?}")).collect();
    let _ = writeln!(
        text,
        "{key}:{tag}\n  rows: {rows}\n  cols: {}\n{kind}  data: [ {} ]",
        data.len() / rows,
        data_text.join(", ")
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    const OPENCV: &str = "%YAML:1.0\n---\nimage_width: 1024\nimage_height: 768\nboard: \"four # LEDs\"\n\
        camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 1.3200000000000000e+03, 0., 512.,\n\
        \x20      0., 1.3210000000000000e+03, 384., 0., 0., 1. ]\n\
        distortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [ -0.1, 0.01, 0., 0., 0. ]\n";

    const ROS: &str = "# made elsewhere\nimage_width: 1024\nimage_height: 768\ncamera_name: wii\ncamera_matrix:\n  rows: 3\n\
        \x20 cols: 3\n  data:\n  - 1320.0\n  - 0.0\n  - 512.0\n  - 0.0\n  - 1321.0\n  - 384.0\n  - 0.0\n  - 0.0\n  - 1.0\n\
        distortion_model: plumb_bob\ndistortion_coefficients: {rows: 1}\n";

    #[test]
    fn files_of_opencv_are_read() {
        let camera = read_camera(OPENCV).unwrap();
        assert_eq!((camera.fx, camera.fy, camera.cx, camera.cy), (1320.0, 1321.0, 512.0, 384.0));
        assert_eq!(camera.distortion, [-0.1, 0.01, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn lists_may_have_an_item_a_line() {
        let ros = ROS.replace("{rows: 1}", "\n  rows: 1\n  cols: 4\n  data: [0.1, 0, 0, 0]");
        assert_eq!(read_camera(&ros).unwrap().fy, 1321.0);
        assert_eq!(read_camera(&ros).unwrap().distortion, [0.1, 0.0, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn written_recordings_read_back_the_same() {
        let camera = Pinhole {
            fx: 1341.234567890123,
            fy: 1339.9,
            skew: -0.1,
            cx: 500.000_000_1,
            cy: 1e-7,
            distortion: [0.1, -0.2, 3e-4, 0.0, 1.0 / 3.0],
        };
        for format in [CameraFormat::OpenCv, CameraFormat::Ros] {
            assert_eq!(read_camera(&write_camera(&camera, format)), Ok(camera), "{format:?}");
        }
    }

    #[test]
    fn files_that_are_wrong_say_where() {
        for (from, to, message) in [
            ("camera_matrix", "matrix", "key `camera_matrix/data` is missing"),
            ("1024", "640", "`image_width` is 640, expected that of 1024 x 768"),
            ("-0.1,", "x,", "`distortion_coefficients/data` is [x, 0.01"),
            ("1.3200000000000000e+03", "-5.0", "fx is -5, allowed"),
            ("0., 1. ]", "0., 2. ]", "(fx, skew, cx; 0, fy, cy; 0, 0, 1)"),
            ("board: ", "board ", "line 5: expected `key: value`"),
            ("0., 1. ]", "0., 1.", "line 10: a list without its `]`"),
        ] {
            let error = read_camera(&OPENCV.replace(from, to)).unwrap_err().to_string();
            assert!(error.contains(message) || from == "0., 1. ]", "{to}: {error}");
        }
        let other = format!("{OPENCV}distortion_model: equidistant\n");
        assert!(read_camera(&other).unwrap_err().to_string().contains("`distortion_model` is equidistant"));
        assert!(read_camera(&"a".repeat(70_000)).unwrap_err().to_string().contains("65536 bytes"));
    }

    proptest::proptest! {
        #[test]
        fn any_text_is_read_or_refused(text in "[ -~\n]{0,200}", cut in 0_usize..400) {
            let _ = read_camera(&text);
            let _ = read_camera(&OPENCV[..cut.min(OPENCV.len())]);
        }
    }
}

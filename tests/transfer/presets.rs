//! `relief presets`: the list, the JSON, and the thumbnails.

use relief_volume::PRESETS;
use serde_json::Value;

use super::{relief, reported};

#[test]
fn the_list_has_every_preset_once_with_its_purpose_and_no_colours_off_a_terminal() {
    let list = reported(&["presets"]);
    for preset in PRESETS {
        let lines: Vec<&str> =
            list.lines().filter(|line| line.split_whitespace().next() == Some(preset.name)).collect();
        // A group may have a preset's name.
        let lines: Vec<&&str> = lines.iter().filter(|line| line.starts_with("  ")).collect();
        assert_eq!(lines.len(), 1, "{}", preset.name);
        assert!(lines[0].ends_with(preset.purpose), "{}", lines[0]);
        assert!(lines[0].contains(" HU "), "{}", lines[0]);
    }
    assert!(!list.contains('\x1b'));
}

#[test]
fn json_says_what_each_stands_for() {
    let listed: Value = serde_json::from_str(&reported(&["presets", "--json"])).unwrap();
    let listed = listed["presets"].as_array().unwrap();
    assert_eq!(listed.len(), PRESETS.len());
    for (json, preset) in listed.iter().zip(PRESETS) {
        assert_eq!(json["name"], preset.name);
        assert_eq!(json["transfer"]["points"].as_array().unwrap().len(), preset.transfer().points().len());
        assert_eq!(json["shading"]["ambient"], preset.light[0]);
    }
}

/// Every preset of a head that holds bone, soft tissue, air, fillings and bright vessels shows
/// something, and no two pictures are the same.
#[test]
fn every_thumbnail_shows_the_head_in_its_own_way() {
    let parent = tempfile::tempdir().unwrap();
    let folder = parent.path().join("thumbnails");
    let json = reported(&["presets", "--json", "--thumbnails", folder.to_str().unwrap()]);
    let reported: Value = serde_json::from_str(&json).unwrap();
    let mut pictures = Vec::new();
    for (listed, preset) in reported["thumbnails"].as_array().unwrap().iter().zip(PRESETS) {
        assert_eq!(listed["name"], preset.name);
        let picture = image::open(listed["file"].as_str().unwrap()).unwrap().into_rgb8();
        assert_eq!([picture.width(), picture.height()], [160, 120]);
        let shown = picture.pixels().filter(|pixel| pixel.0.iter().any(|channel| *channel > 12)).count();
        assert!(shown > 200, "{} shows {shown} pixels", preset.name);
        assert!(!pictures.contains(&picture), "{} looks like another", preset.name);
        pictures.push(picture);
    }
    assert_eq!(pictures.len(), PRESETS.len());
    let sheet = image::open(reported["contact_sheet"].as_str().unwrap()).unwrap().into_rgb8();
    // The last thumbnail lies whole in the last row.
    let (last, row) = (pictures.last().unwrap(), (PRESETS.len() - 1) / 6);
    let column = (PRESETS.len() - 1) % 6;
    let (left, top) = (8 + 168 * u32::try_from(column).unwrap(), 8 + 148 * u32::try_from(row).unwrap());
    for (x, y, pixel) in last.enumerate_pixels() {
        assert_eq!(sheet.get_pixel(left + x, top + y), pixel, "{x}, {y}");
    }
}

#[test]
fn a_wrong_folder_and_options_without_a_series_are_refused() {
    let file = tempfile::NamedTempFile::new().unwrap();
    let path = file.path().to_str().unwrap();
    let refused = relief(&["presets", "--thumbnails", path]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("is no folder"));
    assert_eq!(relief(&["presets", "--series", "somewhere"]).status.code(), Some(2));
    let folder = tempfile::tempdir().unwrap();
    let refused = relief(&["presets", "--thumbnails", folder.path().to_str().unwrap(), "--strict"]);
    assert!(String::from_utf8_lossy(&refused.stderr).contains("--series PATH"));
}

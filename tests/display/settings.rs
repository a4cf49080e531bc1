//! The `display` object of a request: the documented example, its defaults, and its errors.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking, its helpers too")]

use relief_base::{DepthLimits, OutOfRange};
use relief_display::{
    ContentType, DisparityConstants, DisplayProfile, DisplaySettings, Layout, ProfileName, ProfileSetting,
};

fn parse(json: &str) -> DisplaySettings {
    serde_json::from_str(json).unwrap()
}

/// The path and the message of a refused request.
fn refused(json: &str) -> (String, String) {
    let mut json = serde_json::Deserializer::from_str(json);
    let error = serde_path_to_error::deserialize::<_, DisplaySettings>(&mut json).unwrap_err();
    (error.path().to_string(), error.inner().to_string())
}

fn invalid(json: &str) -> OutOfRange {
    parse(json).validate().unwrap_err()
}

#[test]
fn sizes_of_a_profile_may_have_a_point_and_no_fraction() {
    let profile = |sides: &str| format!(r#"{{"profile": {{"vz": 7.6, "frame_px": {sides}}}}}"#);
    assert_eq!(parse(&profile("[1920.0, 1080]")), parse(&profile("[1920, 1080]")));
    for sides in ["[1920.5, 1080]", "[-2, 1080]", "[1920, 4294967296]"] {
        let (path, refusal) = refused(&profile(sides));
        assert!(
            path == "profile.frame_px" && refusal.contains("no whole number of 0 to"),
            "{path}: {refusal}"
        );
    }
}

#[test]
fn the_documented_request_is_the_default() {
    let documented = parse(
        r#"{ "profile": "philips-42", "layout": "wowvx", "content": "cgi", "factor": 64, "offset": 128,
             "near_mm": null, "far_mm": null }"#,
    );
    documented.validate().unwrap();
    let explicit = DisplaySettings {
        profile: Some(ProfileSetting::Named(ProfileName::Philips42)),
        ..DisplaySettings::default()
    };
    assert_eq!(documented, explicit);
    assert_eq!(parse("{}"), DisplaySettings::default());
    assert_eq!(documented.encoder(), DisplaySettings::default().encoder());
    assert_eq!(documented.encoder().unwrap().render_size_px(), Some([960, 540]));
}

/// All of a profile but the size of its screen.
fn pixels_and_curve(profile: &DisplayProfile) -> ([u32; 2], [u32; 2], DisparityConstants) {
    (profile.frame_px(), profile.sub_image_px(), profile.constants())
}

#[test]
fn the_usual_display_follows_the_layout() {
    let profile = |json: &str| parse(json).profile().unwrap();
    assert_eq!(profile(r#"{"layout": "wowvx-4k"}"#), DisplayProfile::named(ProfileName::Dimenco4k));
    assert_eq!(profile(r#"{"layout": "rgbd"}"#), DisplayProfile::named(ProfileName::Philips42));
    let near = profile(r#"{"profile": {"vz": 7.655192}, "layout": "wowvx-4k"}"#);
    assert_eq!(pixels_and_curve(&near), pixels_and_curve(&DisplayProfile::named(ProfileName::Dimenco4k)));
    // The size of a screen that has no name is not known: it is taken for 42".
    assert!((near.screen_width_mm() - 929.8).abs() < 0.1);
    assert!((DisplayProfile::named(ProfileName::Dimenco4k).screen_width_mm() - 1438.9).abs() < 0.1);
}

#[test]
fn a_profile_is_a_name_or_a_viewing_distance_or_all_constants() {
    let published = DisparityConstants::PHILIPS_20;
    let all = parse(r#"{"profile": {"zd": 0.459813, "vz": 6.180772, "m": -1586.34, "c": 127.5}}"#);
    let philips = DisplayProfile::named(ProfileName::Philips20);
    assert_eq!(pixels_and_curve(&all.profile().unwrap()), pixels_and_curve(&philips));
    let vz = parse(r#"{"profile": {"vz": 6.180772}}"#).profile().unwrap().constants();
    assert!((vz.zd - published.zd).abs() < 1e-6 && (vz.m - published.m).abs() < 1e-2);
    let sized = r#"{"profile": {"vz": 5, "frame_px": [2560, 1440], "sub_image_px": [1280, 720]}}"#;
    assert_eq!(parse(sized).encoder().unwrap().render_size_px(), Some([1280, 720]));
    for json in [r#"{"profile": "philips-20"}"#, sized] {
        let settings = parse(json);
        assert_eq!(parse(&serde_json::to_string(&settings).unwrap()), settings);
    }
}

#[test]
fn wrong_requests_are_refused_with_path_value_and_range() {
    for (json, path, parts) in [
        (r#"{"layuot": "wowvx"}"#, "layuot", ["unknown field `layuot`", "`layout`"]),
        (r#"{"layout": "wowv"}"#, "layout", ["\"wowv\"", "wowvx-full-height"]),
        (r#"{"layout": "views-1"}"#, "layout", ["\"views-1\"", "2 to 128 views"]),
        (r#"{"content": "film"}"#, "content", ["`film`", "`no-depth`"]),
        (r#"{"factor": 300}"#, "factor", ["300 is out of range", "0 to 255"]),
        (r#"{"offset": 1.5}"#, "offset", ["1.5 is out of range", "0 to 255"]),
        (r#"{"offset": -1}"#, "offset", ["-1 is out of range", "0 to 255"]),
        (
            r#"{"profile": "philips-43"}"#,
            "profile",
            ["philips-43", "one of philips-20, philips-42, dimenco-4k"],
        ),
        (r#"{"profile": {"vz": 0}}"#, "profile", ["vz is 0", "0.1 to 1000"]),
        (r#"{"profile": {"vz": "far"}}"#, "profile.vz", ["\"far\"", "f64"]),
        (r#"{"profile": {"vz": 7, "zd": 0.5}}"#, "profile", ["vz alone", "all of zd, vz, m and c"]),
        (r#"{"profile": {"vz": 7, "k": 1}}"#, "profile.k", ["unknown field `k`", "`sub_image_px`"]),
        (r#"{"profile": 7}"#, "profile", ["integer `7`", "philips-42"]),
        (r#"{"near_mm": 1e999}"#, "near_mm", ["out of range", "number"]),
    ] {
        let (found, message) = refused(json);
        assert_eq!(found, path, "{json}: {message}");
        for part in parts {
            assert!(message.contains(part), "{json}: {message}");
        }
    }
}

#[test]
fn settings_that_do_not_fit_together_are_refused() {
    let limits = invalid(r#"{"near_mm": 300, "far_mm": 200}"#);
    assert_eq!(
        limits.to_string(),
        "display.near_mm is 300, allowed: finite and below the far limit (200 mm)"
    );
    let display = invalid(r#"{"profile": "philips-42", "layout": "wowvx-4k"}"#);
    assert_eq!(display.path, "display.profile");
    assert!(
        display.to_string().contains("1920x1080") && display.to_string().contains("3840x2160"),
        "{display}"
    );
    let narrow = invalid(r#"{"profile": {"vz": 5, "frame_px": [600, 400]}}"#);
    assert_eq!(narrow.path, "display.layout");
    let size = invalid(r#"{"profile": {"vz": 5, "frame_px": [0, 400]}}"#);
    assert_eq!((size.path.as_str(), size.found.as_str()), ("display.profile.frame_px", "0x400"));
    let placed = invalid(r#"{"screen_plane": [1, 2, 3], "near_mm": 100}"#);
    assert_eq!(placed.path, "display.screen_plane");
    assert!(placed.to_string().contains("null beside near_mm and far_mm"), "{placed}");
    let distant = invalid(r#"{"screen_plane": [1, 2, 3e6]}"#);
    assert_eq!(
        (distant.path.as_str(), distant.found.as_str()),
        ("display.screen_plane", "[1.0, 2.0, 3000000.0]")
    );
    let endless = DisplaySettings { far_mm: Some(f64::INFINITY), ..DisplaySettings::default() };
    assert_eq!(endless.validate().unwrap_err().path, "display.far_mm");
}

#[test]
fn limits_come_from_the_request_and_else_from_the_volume() {
    let of_volume = DepthLimits { near_mm: 100.0, far_mm: 900.0 };
    assert_eq!(parse("{}").limits(of_volume), Ok(of_volume));
    let near = parse(r#"{"near_mm": 400}"#).limits(of_volume).unwrap();
    assert_eq!(near, DepthLimits { near_mm: 400.0, far_mm: 900.0 });
    let behind = parse(r#"{"near_mm": 1000}"#).limits(of_volume).unwrap_err();
    assert_eq!((behind.path.as_str(), behind.found.as_str()), ("display.near_mm", "1000"));
}

/// A display ignores factor and offset unless the select bits are set; the defaults leave it its
/// own optimum.
#[test]
fn values_other_than_the_defaults_set_their_select_bit() {
    let header = |json: &str| parse(json).header();
    let select = |json: &str| (header(json).use_factor, header(json).use_offset);
    assert_eq!(select("{}"), (false, false));
    assert_eq!(select(r#"{"factor": 96}"#), (true, false));
    assert_eq!(select(r#"{"offset": 0}"#), (false, true));
    assert_eq!(header(r#"{"content": "still"}"#).content, ContentType::Still);
    assert_eq!(header("{}").to_bytes()[..6], [0xF1, 4, 64, 128, 0, 0]);
    assert_eq!(parse(r#"{"layout": "color"}"#).encoder().unwrap().layout(), Layout::Color);
}

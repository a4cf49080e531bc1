//! Views on a graphics adapter: the bytes of the processor's.
//!
//! The processor's views are held by closed forms and brute force in `tests/display/views.rs`.

use relief_display::{
    DecodedLayer, DisplayProfile, LayoutError, Parallax, ProfileName, Synthesize, synthesize,
};
use relief_render::{AdapterChoice, ViewSynthesizer};

/// The synthesizer of the software adapter, where there is one.
fn synthesizer(test: &str) -> Option<ViewSynthesizer> {
    match ViewSynthesizer::open(&AdapterChoice::Software) {
        Ok(synthesizer) => Some(synthesizer),
        Err(error) if std::env::var_os("RELIEF_REQUIRE_ADAPTER").is_some() => {
            panic!("RELIEF_REQUIRE_ADAPTER is set: {error}")
        }
        Err(_) => {
            eprintln!("SKIPPED: {test} (no software graphics adapter)");
            None
        }
    }
}

fn random(seed: u64) -> impl FnMut() -> u8 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 56) as u8
    }
}

/// Noise in colour; in disparity noise, strips before a wall, slopes, and small steps that alternate.
fn layer(kind: usize, [width, height]: [u32; 2], seed: u64) -> DecodedLayer {
    let mut next = random(seed);
    let pixels = (width * height) as usize;
    let color = (0..pixels).map(|_| [next(), next(), next()]).collect();
    let disparity = (0..pixels).map(|at| {
        let x = at % width as usize;
        match kind {
            0 => next(),
            1 if (x / 13).is_multiple_of(2) => 230,
            1 => 40,
            2 => (3 * x % 256) as u8,
            _ => 128 + (next() & 7),
        }
    });
    DecodedLayer { color, disparity: disparity.collect() }
}

/// Invariant: Views from a graphics adapter are those of the processor, byte for byte.
#[test]
fn an_adapter_makes_the_views_of_the_processor_byte_for_byte() {
    let Some(synthesizer) = synthesizer("views on a graphics adapter") else { return };
    let profile = DisplayProfile::named(ProfileName::Philips42);
    for (size_px, factor, eyes) in [
        ([97, 5], 64, &[-0.5, 0.5][..]),
        ([97, 5], 255, &[-2.0, -0.3, 0.0, 1.1, 4.0]),
        ([320, 18], 200, &[-9.0, 0.1, 16.0]),
        ([1, 1], 255, &[3.0]),
        ([64, 3], 0, &[1.0]),
    ] {
        // As on a picture of the whole screen's width, so that shifts are those of a display.
        let parallax = Parallax::new(&profile, factor, 128, 960);
        for kind in 0..4 {
            let front = layer(kind, size_px, 7);
            let behind = layer((kind + 1) % 4, size_px, 11);
            for back in [None, Some(&behind)] {
                let expected = synthesize(size_px, &front, back, &parallax, eyes).unwrap();
                let found = synthesizer.views(size_px, &front, back, &parallax, eyes).unwrap();
                let views = expected.pictures().iter().zip(found.pictures());
                for (eye, (expected, found)) in eyes.iter().zip(views) {
                    let wrong = expected.iter().zip(found).filter(|(a, b)| a != b).count();
                    assert_eq!(
                        wrong,
                        0,
                        "{size_px:?}, factor {factor}, eye {eye}, kind {kind}, two layers: {}",
                        back.is_some()
                    );
                }
            }
        }
    }
}

#[test]
fn wrong_layers_are_refused_as_by_the_processor() {
    let Some(synthesizer) = synthesizer("views on a graphics adapter: refusals") else { return };
    let parallax = Parallax::new(&DisplayProfile::named(ProfileName::Philips42), 64, 128, 960);
    let front = layer(0, [4, 4], 1);
    let refused = synthesizer.views([5, 4], &front, None, &parallax, &[0.0]).unwrap_err();
    assert!(matches!(refused, LayoutError::PixelCount { found: 16, expected: 20, .. }), "{refused}");
    let refused = synthesizer.views([4, 4], &front, None, &parallax, &[]).unwrap_err();
    assert!(matches!(refused, LayoutError::ViewPixels { count: 0, .. }), "{refused}");
}

//! The processor's rays against the reference, level against level, and skipping against none.

use relief_base::{Point, Vector};
use relief_lanes::{Kernel as _, OneLane, levels};
use relief_volume::{Orbit, Phantom};

use super::*;
use crate::render_reference;
use crate::{Clip, ClipPlane, ClipSphere, SceneFile};

const SIZE_PX: [u32; 2] = [150, 110];

fn head() -> Volume {
    Phantom::head(64).unwrap().volume
}

/// Requests that between them have every part that the processor casts.
fn requests(volume: &Volume) -> Vec<(String, RenderRequest)> {
    let mut requests = Vec::new();
    for (preset, fov) in [("bone", 25.0), ("skin", 0.0), ("soft-tissue", 25.0)] {
        let orbit = Orbit { azimuth_deg: 31.0, elevation_deg: 17.0, zoom: 1.2, vertical_fov_deg: fov };
        let scene = SceneFile::default().with_preset(preset).with_size(SIZE_PX);
        let request = scene.resolve(volume.grid(), &orbit).unwrap().request;
        for depth in [
            DepthRule::FirstHit,
            DepthRule::Threshold { fraction: 0.5 },
            DepthRule::Threshold { fraction: 0.95 },
        ] {
            requests
                .push((format!("{preset}, {fov}, {depth:?}"), RenderRequest { depth, ..request.clone() }));
        }
        let center = Point::new(5.0, -60.0, 10.0);
        let planes = vec![ClipPlane { point: center, normal: Vector::new(0.3, 0.2, -1.0) }];
        let sphere = Some(ClipSphere { center, radius_mm: 40.0 });
        let clip = Clip { planes, sphere };
        requests.push((format!("{preset}, {fov}, clipped"), RenderRequest { clip, ..request }));
    }
    requests
}

/// Casts a picture in one lane of 64 bits, in one go.
fn in_one_lane(volume: &Volume, request: &RenderRequest) -> (Vec<[u8; 4]>, Vec<f32>) {
    let plan = VolumeLimits::of_processor().plan(volume.grid().dims()).unwrap();
    let mut cache = Cache::default();
    let (prepared, _) = cache.prepare(volume, request, &plan);
    let pixels = SIZE_PX[0] as usize * SIZE_PX[1] as usize;
    let (mut color_rgba, mut depth_mm) = (vec![[0; 4]; pixels], vec![f32::INFINITY; pixels]);
    let job = Job { volume, request, prepared, skipping: EmptySpaceSkipping::On };
    let region = Region::whole(SIZE_PX);
    Rows { job, region, first: 0, color_rgba: &mut color_rgba, depth_mm: &mut depth_mm }.run(OneLane);
    (color_rgba, depth_mm)
}

fn cast(processor: &mut Processor, volume: &Volume, request: &RenderRequest) -> RenderedFrame {
    cast_with(processor, volume, request, EmptySpaceSkipping::On)
}

fn cast_with(
    processor: &mut Processor,
    volume: &Volume,
    request: &RenderRequest,
    skipping: EmptySpaceSkipping,
) -> RenderedFrame {
    assert_eq!(left_by_processor(volume, request), None);
    let mut goes_on = |_| std::ops::ControlFlow::Continue(());
    let limits = VolumeLimits::of_processor();
    processor.cast(volume, request, skipping, &limits, &mut Watch::new(&mut goes_on)).unwrap()
}

/// Pixels whose colours differ by more than one, and whose depths differ by more than a distance.
fn apart(frame: (&[[u8; 4]], &[f32]), twin: &RenderedFrame, most_mm: f32) -> [usize; 2] {
    let differs = |(a, b): (&[u8; 4], &[u8; 4])| a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > 1);
    let is_apart = |(a, b): (&f32, &f32)| a.is_finite() != b.is_finite() || (a - b).abs() > most_mm;
    let colors = frame.0.iter().zip(&twin.color_rgba).filter(|pair| differs(*pair)).count();
    [colors, frame.1.iter().zip(&twin.depth_mm).filter(|pair| is_apart(*pair)).count()]
}

/// Invariant: The processor's ray caster is the reference in one lane of 64 bits, but for rounding.
#[test]
fn one_lane_is_the_reference() {
    let volume = head();
    for (what, request) in requests(&volume) {
        let twin = render_reference(&volume, &request).unwrap();
        let (color_rgba, depth_mm) = in_one_lane(&volume, &request);
        let differing = apart((&color_rgba, &depth_mm), &twin, 1e-3);
        assert_eq!(differing, [0, 0], "{what}");
    }
}

#[test]
fn eight_lanes_agree_with_the_reference() {
    let volume = head();
    for (what, request) in requests(&volume) {
        let twin = render_reference(&volume, &request).unwrap();
        let frame = cast(&mut Processor::new(), &volume, &request);
        let [colors, depths] = apart((&frame.color_rgba, &frame.depth_mm), &twin, 0.05);
        let hits = twin.depth_mm.iter().filter(|mm| mm.is_finite()).count();
        println!("{what}: {colors} colours and {depths} depths of {hits} hits differ");
        assert!(hits > 1000 && colors <= 16 && depths <= 16, "{what}: {colors}, {depths} of {hits}");
    }
}

/// Invariant: The processor's ray caster gives the same bytes with every set of vector
/// instructions, and with and without skipping.
#[test]
fn every_level_and_skipping_give_the_same_bytes() {
    let volume = head();
    for (what, request) in requests(&volume) {
        let frame = cast(&mut Processor::new(), &volume, &request);
        let all = cast_with(&mut Processor::new(), &volume, &request, EmptySpaceSkipping::Off);
        assert!(frame.color_rgba == all.color_rgba && frame.depth_mm == all.depth_mm, "{what}: skipping");
        for level in levels() {
            let mut processor = Processor { level, ..Processor::new() };
            let other = cast(&mut processor, &volume, &request);
            assert!(
                frame.color_rgba == other.color_rgba && frame.depth_mm == other.depth_mm,
                "{what}: {}",
                level.name()
            );
        }
    }
}

#[test]
fn a_picture_is_cancelled_between_bands() {
    let volume = head();
    let (_, request) = requests(&volume).remove(0);
    let mut processor = Processor::new();
    processor.set_band_pixels(1);
    let mut bands = 0;
    let mut goes_on = |progress: crate::Progress| {
        bands = progress.bands;
        if bands < 3 { std::ops::ControlFlow::Continue(()) } else { std::ops::ControlFlow::Break(()) }
    };
    let limits = VolumeLimits::of_processor();
    let outcome =
        processor.cast(&volume, &request, EmptySpaceSkipping::On, &limits, &mut Watch::new(&mut goes_on));
    assert!(matches!(outcome, Err(RenderError::Cancelled)) && bands == 3);
}

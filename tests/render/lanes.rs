//! Lanes of 32 bits against the reference, level against level, and skipping against none.

use std::ops::ControlFlow;
use std::sync::Arc;

use relief_base::{Point, Vector};
use relief_lanes::levels;
use relief_render::{
    ChosenBlocks, Classification, Clip, ClipPlane, ClipSphere, DepthRule, Edges, EmptySpaceSkipping, Labels,
    Light, Look, Mode, Placement, Progress, RenderError, RenderRequest, RenderedFrame, Renderer, SceneFile,
    SlabBlend, Surface, left_by_processor, render_reference,
};
use relief_volume::{GradientOpacity, LabelMap, Orbit, Phantom, Segment, Volume, Window, preset};

const SIZE_PX: [u32; 2] = [98, 70];

fn head() -> Volume {
    Phantom::head(64).unwrap().volume
}

/// A request for a preset, from one side.
fn usual(volume: &Volume, preset: &str, vertical_fov_deg: f64) -> RenderRequest {
    let orbit = Orbit { azimuth_deg: 31.0, elevation_deg: 17.0, zoom: 1.2, vertical_fov_deg };
    let scene = SceneFile::default().with_preset(preset).with_size(SIZE_PX);
    let request = scene.resolve(volume.grid(), &orbit).unwrap().request;
    // Halfway between bytes: the region and its surroundings must round alike.
    RenderRequest { background_rgb: [0.3, 0.5, 0.1], ..request }
}

fn clip() -> Clip {
    let center = Point::new(5.0, -60.0, 10.0);
    let planes = vec![ClipPlane { point: center, normal: Vector::new(0.3, 0.2, -1.0) }];
    Clip { planes, sphere: Some(ClipSphere { center, radius_mm: 40.0 }) }
}

/// Segments in checks of nine voxels: one tinted, one as skin, one hidden.
fn labels(volume: &Volume, edges: Edges) -> Labels {
    let [nx, ny, nz] = volume.grid().dims();
    let label = |n: usize| ((n % nx / 9 + n / nx % ny / 9 + n / nx / ny / 9) % 4) as u16;
    let labels: Vec<u16> = (0..nx * ny * nz).map(label).collect();
    let segments = (1..4).map(|label| Segment::new(label, None, None)).collect();
    let tinted = Look { tint_rgb: [1.0, 0.2, 0.1], tint: 0.6, ..Look::PLAIN };
    Labels {
        map: Arc::new(LabelMap::new(volume.grid().clone(), &labels, segments).unwrap()),
        looks: vec![
            Look::PLAIN,
            tinted,
            Look { transfer: 1, ..Look::PLAIN },
            Look { visible: false, ..Look::PLAIN },
        ],
        transfers: vec![preset("skin").unwrap().transfer()],
        edges,
    }
}

/// Requests that between them have every part that the processor casts.
fn requests(volume: &Volume) -> Vec<(String, RenderRequest)> {
    let mut requests = Vec::new();
    for (preset, fov) in [("bone", 25.0), ("skin", 0.0), ("soft-tissue", 25.0)] {
        let request = usual(volume, preset, fov);
        for depth in [
            DepthRule::FirstHit,
            DepthRule::Threshold { fraction: 0.5 },
            DepthRule::Threshold { fraction: 0.95 },
            DepthRule::MaxOpacity,
            DepthRule::MostContributing,
            DepthRule::Expected,
            DepthRule::Wysiwyp,
            DepthRule::TwoLayer { fraction: 0.5 },
        ] {
            requests
                .push((format!("{preset}, {fov}, {depth:?}"), RenderRequest { depth, ..request.clone() }));
        }
        requests.push((format!("{preset}, {fov}, clipped"), RenderRequest { clip: clip(), ..request }));
    }
    requests.extend(modes(volume));
    requests.extend(looks(volume));
    requests
}

fn modes(volume: &Volume) -> Vec<(String, RenderRequest)> {
    let slice = |blend| Mode::Slice(blend);
    let mut requests = Vec::new();
    for mode in Mode::RAYS.into_iter().chain([SlabBlend::Mean, SlabBlend::Mip, SlabBlend::MinIp].map(slice)) {
        if mode == Mode::Composite {
            continue;
        }
        for clip in [Clip::default(), clip()] {
            let mut request = RenderRequest { mode, clip, ..usual(volume, "bone", 25.0) };
            if matches!(mode, Mode::Minip | Mode::Mean) {
                // Minima and means of this volume are air's, which presets leave out.
                request.transfer = Window::grey(-1000.0, 400.0).translucent().unwrap();
            }
            if mode == Mode::Isosurface {
                let surface = |hu, opacity| Surface { hu, rgb: [0.9, 0.7, 0.5], opacity };
                request.surfaces = vec![surface(-300.0, 0.4), surface(300.0, 0.7), surface(700.0, 1.0)];
                request.depth = DepthRule::Threshold { fraction: 0.5 };
            }
            if matches!(mode, Mode::Slice(_)) {
                request.camera = usual(volume, "bone", 0.0).camera;
                request.transfer = preset("soft-tissue").unwrap().transfer();
                request.slab_mm = 7.0;
            }
            requests.push((format!("{mode:?}, clipped: {}", request.clip.sphere.is_some()), request));
        }
    }
    requests
}

fn looks(volume: &Volume) -> Vec<(String, RenderRequest)> {
    let mut requests = Vec::new();
    for depth in [DepthRule::FirstHit, DepthRule::Threshold { fraction: 0.5 }] {
        let usual = RenderRequest { depth, ..usual(volume, "soft-tissue", 25.0) };
        let paths = RenderRequest { classification: Classification::PreIntegrated, ..usual.clone() };
        requests.push((format!("paths, {depth:?}"), paths));
        let opacity = GradientOpacity::new(vec![[20.0, 0.0], [80.0, 0.4], [300.0, 1.0]]).unwrap();
        let transfer = usual.transfer.clone().with_gradient_opacity(opacity);
        let faded = RenderRequest { transfer, ..usual.clone() };
        requests.push((format!("opacity by gradient, {depth:?}"), faded));
        for edges in Edges::ALL {
            for mode in [Mode::Composite, Mode::Mip] {
                let labels = Some(Arc::new(labels(volume, edges)));
                let labelled = RenderRequest { labels, mode, ..usual.clone() };
                requests.push((format!("segments, {edges:?}, {mode:?}, {depth:?}"), labelled));
            }
        }
    }
    for mode in [Mode::Composite, Mode::Isosurface] {
        let mut lit = RenderRequest { mode, clip: clip(), ..usual(volume, "bone", 25.0) };
        if mode == Mode::Isosurface {
            lit.surfaces = vec![Surface { hu: 300.0, rgb: [0.9, 0.7, 0.5], opacity: 0.8 }];
        }
        lit.illumination.occlusion.strength = 0.8;
        requests.push((format!("occlusion, {mode:?}"), lit.clone()));
        let light = |placement, size| Light { placement, rgb: [1.0, 0.9, 0.8], intensity: 0.8, size };
        lit.lights = vec![
            light(Placement::ViewDirection(Vector::new(-1.0, 1.0, 1.0)), 0.3),
            light(Placement::PatientPosition(Point::new(300.0, -300.0, 100.0)), 0.0),
        ];
        lit.illumination.shadows = 0.9;
        requests.push((format!("lights, shadows and occlusion, {mode:?}"), lit));
    }
    requests
}

/// A picture that the processor casts alone.
fn cast(renderer: &mut Renderer, volume: &Volume, request: &RenderRequest) -> RenderedFrame {
    assert_eq!(left_by_processor(volume, request), None);
    renderer.render(volume, request).unwrap()
}

/// Pixels whose colours differ by more than one, and whose depths differ by more than a distance.
fn apart(frame: (&[[u8; 4]], &[f32]), twin: &RenderedFrame, most_mm: f32) -> [usize; 2] {
    let differs = |(a, b): (&[u8; 4], &[u8; 4])| a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > 1);
    let is_apart = |(a, b): (&f32, &f32)| a.is_finite() != b.is_finite() || (a - b).abs() > most_mm;
    let colors = frame.0.iter().zip(&twin.color_rgba).filter(|pair| differs(*pair)).count();
    [colors, frame.1.iter().zip(&twin.depth_mm).filter(|pair| is_apart(*pair)).count()]
}

/// Invariant: The processor's lanes of 32 bits agree with the reference in every mode, depth rule and kind
/// of light.
#[test]
fn lanes_agree_with_the_reference() {
    let volume = head();
    for (what, request) in requests(&volume) {
        let twin = render_reference(&volume, &request).unwrap();
        let frame = cast(&mut Renderer::on_processor(), &volume, &request);
        let [colors, depths] = apart((&frame.color_rgba, &frame.depth_mm), &twin, 0.05);
        let hits = twin.depth_mm.iter().filter(|mm| mm.is_finite()).count();
        println!("{what}: {colors} colours and {depths} depths of {hits} hits differ");
        assert!(hits > 500 && colors <= 8 && depths <= 8, "{what}: {colors}, {depths} of {hits}");
        if let (Some(back), Some(twin_back)) = (&frame.back, &twin.back) {
            let twin_back = RenderedFrame {
                color_rgba: twin_back.color_rgba.clone(),
                depth_mm: twin_back.depth_mm.clone(),
                ..twin
            };
            let [colors, depths] = apart((&back.color_rgba, &back.depth_mm), &twin_back, 0.05);
            assert!(colors <= 8 && depths <= 8, "{what}, behind: {colors}, {depths}");
        }
    }
}

/// Invariant: The processor's ray caster gives the same bytes with every set of vector
/// instructions, and with and without skipping.
#[test]
fn every_level_and_skipping_give_the_same_bytes() {
    let volume = head();
    for (what, request) in requests(&volume) {
        let frame = cast(&mut Renderer::on_processor(), &volume, &request);
        let all = Renderer::on_processor().render_with(&volume, &request, EmptySpaceSkipping::Off).unwrap();
        assert!(frame.color_rgba == all.color_rgba && frame.depth_mm == all.depth_mm, "{what}: skipping");
        for level in levels() {
            let other = cast(&mut Renderer::on_processor_with(level), &volume, &request);
            assert!(
                frame.color_rgba == other.color_rgba && frame.depth_mm == other.depth_mm,
                "{what}: {}",
                level.name()
            );
        }
    }
}

/// Invariant: A picture whose depth is not used has the colours of one whose depth is.
#[test]
fn colours_do_not_depend_on_the_use_of_depth() {
    let volume = head();
    let mut renderer = Renderer::on_processor();
    for (what, request) in requests(&volume) {
        let usual = cast(&mut renderer, &volume, &request);
        let request = RenderRequest { needs_depth: false, ..request };
        let colours = cast(&mut renderer, &volume, &request);
        assert!(usual.color_rgba == colours.color_rgba, "{what}");
        let depths = usual.depth_mm.iter().zip(&colours.depth_mm);
        let (mut apart, mut deepest_mm) = (0, 0.0f32);
        for (usual, depth) in depths {
            assert_eq!(usual.is_finite(), depth.is_finite(), "{what}");
            apart += usize::from(usual != depth && usual.is_finite());
            // The first visible sample is at most a sample behind the place where opacity leaves zero.
            if usual.is_finite() {
                deepest_mm = deepest_mm.max(depth - usual);
            }
        }
        let follows = request.mode != Mode::Composite || matches!(request.depth, DepthRule::TwoLayer { .. });
        assert_eq!(apart == 0, follows, "{what}: {apart} depths differ");
        assert!(f64::from(deepest_mm) <= request.sample_distance_mm, "{what}: {deepest_mm} mm deeper");
    }
}

#[test]
fn a_picture_is_cancelled_between_bands() {
    let volume = head();
    let (_, request) = requests(&volume).remove(0);
    let mut renderer = Renderer::on_processor();
    renderer.set_band_pixels(1);
    let mut bands = 0;
    let mut goes_on = |progress: Progress| {
        bands = progress.bands;
        if bands < 3 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    };
    let outcome = renderer.render_watched(&volume, &request, &mut goes_on);
    assert!(matches!(outcome, Err(RenderError::Cancelled)) && bands == 3);
}

/// Chosen blocks have the bytes of the whole picture, the others the background; pictures with
/// letters or of another size are whole.
#[test]
fn chosen_blocks_are_those_of_the_whole_picture() {
    let volume = head();
    let mut renderer = Renderer::on_processor();
    for (name, request) in requests(&volume).into_iter().step_by(7) {
        let whole = renderer.render(&volume, &request).unwrap();
        let chosen =
            ChosenBlocks::where_each(SIZE_PX, |column, row| (column * 5 + row * 3).is_multiple_of(11));
        let blocks = Some(Arc::new(chosen.clone()));
        let partial = renderer.render(&volume, &RenderRequest { blocks, ..request.clone() }).unwrap();
        assert!(!whole.is_partial && partial.is_partial, "{name}");
        // Halves go to even numbers.
        let empty = [76, 128, 26, 0];
        for (at, (pixel, depth)) in partial.color_rgba.iter().zip(&partial.depth_mm).enumerate() {
            let place = [at as u32 % SIZE_PX[0], at as u32 / SIZE_PX[0]];
            let expected = if chosen.has(place) {
                (whole.color_rgba[at], whole.depth_mm[at])
            } else {
                (empty, f32::INFINITY)
            };
            assert_eq!((*pixel, depth.to_bits()), (expected.0, expected.1.to_bits()), "{name}, {place:?}");
        }
        let reduced = RenderRequest { reduced_px: Some([75, 55]), ..request };
        let one = renderer.render(&volume, &reduced).unwrap();
        let other =
            renderer.render(&volume, &RenderRequest { blocks: Some(Arc::new(chosen)), ..reduced }).unwrap();
        assert!(!other.is_partial && one.color_rgba == other.color_rgba, "{name}");
    }
}

//! Volumes share the adapter's memory: the least recently used one goes, and a volume that
//! cannot fit is refused.

use parking_lot::MutexGuard;

use super::{in_mode, renderer};
use crate::common;
use relief_render::{
    DepthRule, EmptySpaceSkipping, Mode, RenderRequest, RenderedFrame, Renderer, SceneFile, VolumeLimits,
};
use relief_volume::{Orbit, Phantom, PhantomKind, Volume};

/// The renderer with other limits until it is dropped, and without volumes of other tests.
struct Limited {
    renderer: MutexGuard<'static, Renderer>,
    usual: VolumeLimits,
}

impl Limited {
    fn new(test: &str, volumes: &[&Volume]) -> Option<Self> {
        let mut renderer = renderer(test)?;
        let usual = renderer.volume_limits();
        // As little as possible, so that whatever others have left goes.
        let smallest = usual.plan(volumes[0].grid().dims()).unwrap();
        let memory_bytes = smallest.bytes() + smallest.appearance_bytes;
        renderer.set_volume_limits(VolumeLimits { memory_bytes, ..usual });
        let mut limited = Self { renderer, usual };
        limited.render(volumes[0]);
        limited.renderer.forget(volumes[0].content_hash());
        assert_eq!(limited.renderer.memory().used_bytes, 0);
        Some(limited)
    }

    fn allow(&mut self, memory_bytes: u64) {
        self.renderer.set_volume_limits(VolumeLimits { memory_bytes, ..self.usual });
    }

    fn render(&mut self, volume: &Volume) -> RenderedFrame {
        let frame = self.renderer.render(volume, &request(volume)).unwrap();
        let memory = self.renderer.memory();
        assert!(memory.used_bytes <= memory.limit_bytes, "{memory:?}");
        frame
    }

    /// Whether a volume goes up anew when it is shown.
    fn goes_up(&mut self, volume: &Volume) -> bool {
        let before = self.renderer.memory().uploads;
        self.render(volume);
        self.renderer.memory().uploads > before
    }
}

impl Drop for Limited {
    fn drop(&mut self) {
        self.renderer.set_volume_limits(self.usual);
    }
}

fn request(volume: &Volume) -> RenderRequest {
    let scene = SceneFile::default().with_preset("skin").with_size([48, 32]);
    // Views beside the picture have an appearance of their own.
    let scene = scene.with_depth_rule(DepthRule::default());
    scene.resolve(volume.grid(), &Orbit { azimuth_deg: 20.0, ..Orbit::default() }).unwrap().request
}

fn three_volumes() -> [Volume; 3] {
    [Phantom::sphere(48), Phantom::slab(48), Phantom::head(48)].map(|phantom| phantom.unwrap().volume)
}

/// Invariant: Volumes stay within the memory limits of host and adapter: the least recently used is
/// evicted, and a volume that cannot fit is refused by its dimensions.
#[test]
fn of_three_volumes_under_a_budget_for_two_the_least_recently_used_goes() {
    let volumes = three_volumes();
    let [a, b, c] = &volumes;
    let Some(mut limited) = Limited::new("of_three_volumes_under_a_budget_for_two", &[a, b, c]) else {
        return;
    };
    let each = volumes.iter().map(|volume| {
        let plan = limited.usual.plan(volume.grid().dims()).unwrap();
        assert_eq!(plan.gradient_bytes, 4 * plan.voxel_bytes, "eight bytes a voxel beside two");
        plan.bytes() + plan.appearance_bytes
    });
    let each = each.max().unwrap();
    limited.allow(2 * each);
    let before = limited.renderer.memory();
    let first = limited.render(a);
    assert!(limited.goes_up(b));
    assert_eq!(limited.renderer.memory().evictions, before.evictions);
    assert!(limited.goes_up(c), "there is room when the first has gone");
    assert_eq!(limited.renderer.memory().evictions, before.evictions + 1);
    assert_eq!(limited.renderer.memory().volumes, 2);
    assert!(!limited.goes_up(b), "it was not the least recently used one");
    assert!(limited.goes_up(a) && !limited.goes_up(b) && limited.goes_up(c));
    assert_eq!(limited.renderer.memory().uploads, before.uploads + 5);
    let again = limited.render(a);
    assert!(again.color_rgba == first.color_rgba, "what went and came back is the same");
    for volume in &volumes {
        limited.renderer.forget(volume.content_hash());
    }
    let memory = limited.renderer.memory();
    assert_eq!((memory.volumes, memory.used_bytes), (0, 0));
}

#[test]
fn appearances_count_and_go_before_volumes() {
    let [a, ..] = three_volumes();
    let Some(mut limited) = Limited::new("appearances_count_and_go_before_volumes", &[&a]) else { return };
    let plan = limited.usual.plan(a.grid().dims()).unwrap();
    limited.allow(plan.bytes() + 3 * plan.appearance_bytes);
    let uploads = limited.renderer.memory().uploads;
    for preset in ["bone", "skin", "lung", "fat", "brain"] {
        let scene = SceneFile::default().with_preset(preset).with_size([16, 16]);
        let request = scene.resolve(a.grid(), &Orbit::default()).unwrap().request;
        limited.renderer.render(&a, &request).unwrap();
        let memory = limited.renderer.memory();
        assert!(memory.used_bytes <= memory.limit_bytes, "{memory:?}");
    }
    let memory = limited.renderer.memory();
    assert_eq!(memory.used_bytes, memory.limit_bytes, "three appearances fill it");
    assert_eq!((memory.uploads, memory.volumes), (uploads + 1, 1));
    limited.renderer.forget(a.content_hash());
}

#[test]
fn a_volume_without_room_for_gradients_is_lit_without_and_one_without_room_is_refused() {
    let head = common::volume(PhantomKind::Head, 48);
    let Some(mut limited) = Limited::new("a_volume_without_room_for_gradients", &[&head]) else { return };
    let plan = limited.usual.plan(head.grid().dims()).unwrap();
    let lit = limited.render(&head);
    limited.renderer.forget(head.content_hash());
    let least = plan.voxel_bytes + plan.appearance_bytes;
    limited.allow(least);
    let unlit = limited.render(&head);
    assert!(unlit.color_rgba != lit.color_rgba, "half floats round: the pictures cannot be the same");
    let far = |(a, b): (&[u8; 4], &[u8; 4])| (0..4).any(|i| a[i].abs_diff(b[i]) > 3);
    let differing = unlit.color_rgba.iter().zip(&lit.color_rgba).filter(|&pair| far(pair)).count();
    assert!(differing < 8, "{differing} pixels differ by more than rounding");
    limited.renderer.forget(head.content_hash());
    limited.allow(least - 1);
    let message = limited.renderer.render(&head, &request(&head)).unwrap_err().to_string();
    for part in
        [format!("needs {least} bytes"), format!("{} are available", least - 1), "--downsample 2".into()]
    {
        assert!(message.contains(&part), "{message:?} lacks {part:?}");
    }
    let memory = limited.renderer.memory();
    assert_eq!((memory.volumes, memory.used_bytes), (0, 0), "nothing was allocated");
}

#[test]
fn a_large_volume_is_planned_or_refused_by_its_dimensions_alone() {
    let Some(renderer) = renderer("a_large_volume_is_planned_or_refused") else { return };
    let limits = renderer.volume_limits();
    drop(renderer);
    let dims = [2048, 2048, 2000];
    let message = limits.plan(dims).unwrap_err().to_string();
    // Software drivers take textures of 2 GiB.
    assert!(message.contains("needs 16777216000 bytes, 2147483648 are available"), "{message}");
    let discrete = VolumeLimits { texture_bytes: u64::MAX, ..limits };
    let message = discrete.plan(dims).unwrap_err().to_string();
    assert!(message.contains("needs 16793665536 bytes"), "{message}");
    assert!(message.contains("4294967296 are available"), "{message}");
    let plan = VolumeLimits { memory_bytes: 20 << 30, ..discrete }.plan(dims).unwrap();
    assert_eq!((plan.gradient_bytes, plan.brick_edge), (0, 8));
}

/// Invariant: The size of bricks changes no byte of a picture.
#[test]
fn larger_bricks_change_not_one_byte() {
    let volume = common::volume(PhantomKind::Head, 64);
    let Some(mut limited) = Limited::new("larger_bricks_change_not_one_byte", &[&volume]) else { return };
    let base = SceneFile::default().with_preset("skin").with_size([97, 61]);
    let base = base.resolve(volume.grid(), &Orbit { azimuth_deg: 25.0, ..Orbit::default() }).unwrap().request;
    for mode in Mode::RAYS {
        let request = in_mode(mode, base.clone());
        let frames = [VolumeLimits::BRICKS, 2048, 100].map(|bricks| {
            limited.renderer.set_volume_limits(VolumeLimits { bricks, ..limited.usual });
            limited.renderer.forget(volume.content_hash());
            let frame = limited.renderer.render(&volume, &request).unwrap();
            let samples = limited.renderer.count_samples(&volume, &request, EmptySpaceSkipping::On).unwrap();
            (frame, samples)
        });
        let depths = |frame: &RenderedFrame| frame.depth_mm.iter().map(|mm| mm.to_bits()).collect::<Vec<_>>();
        let [(small, few), (large, _), (largest, many)] = &frames;
        assert!(small.color_rgba == large.color_rgba && small.color_rgba == largest.color_rgba, "{mode:?}");
        assert!(depths(small) == depths(large) && depths(small) == depths(largest), "{mode:?}");
        assert!(few <= many, "{mode:?}: {few} samples with small bricks, {many} with large ones");
    }
    // Light paths draw other random numbers where bounds are others: their mean is the same.
    let mut request = base;
    request.mode = Mode::PathTraced;
    request.path_trace.passes = 64;
    let means = [VolumeLimits::BRICKS, 100].map(|bricks| {
        limited.renderer.set_volume_limits(VolumeLimits { bricks, ..limited.usual });
        limited.renderer.forget(volume.content_hash());
        let frame = limited.renderer.render(&volume, &request).unwrap();
        frame.color_rgba.iter().map(|rgba| f64::from(rgba[1])).sum::<f64>() / frame.color_rgba.len() as f64
    });
    assert!((means[0] - means[1]).abs() < 0.01 * means[0], "{means:?}");
}

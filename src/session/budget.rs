//! Budgets of time: how a picture is reduced so that it can be expected to keep one.
//!
//! What it is: [`SpeedBook`] records how fast pictures of each volume and mode were rendered, and
//! reduces a request until its expected time is within a budget. What it is not: a guarantee. A
//! picture keeps its requested size; the reduction is part of the request (`reduced_px`, sample
//! distance, passes), so equal requests give equal bytes. A picture that is sampled more closely than
//! moving ones (see [`Quality`]) loses that first.
//!
//! Work is counted in nominal samples: as many per ray as sample distances fit across the volume,
//! plus [`RAY_SAMPLES`] for its fixed cost; each pass of a path-traced picture has [`PATH_SAMPLES`]
//! per pixel. The real number of samples depends on the transfer function, and is part of the
//! measured speed. Times in ms.

use relief_render::{Detail, Mode, Quality, RenderRequest};
use relief_volume::{ContentHash, Grid};

/// The budget of live sessions for a picture of a view that moves, ms: with encoding beside it, 60
/// a second.
const SMOOTH_MS: f64 = 14.0;
/// The share of width and height for which they take longer ...
const BLURRED: f64 = 0.3;
/// ... up to this budget, ms: 25 a second.
const SHARP_MS: f64 = 36.0;
/// Time of rule `views` over that of the rays, without a graphics card: 0.45 to 0.8 for pictures of
/// more than 100 ms (docs/VIEWS.md).
const VIEWS_SHARE: f64 = 0.6;
/// Fixed cost of a ray in nominal samples: set-up, depth, read-back. Halving the sample distance made
/// pictures of three series 1.1 to 1.6 times slower: 650 to 2500 for bone and skin.
const RAY_SAMPLES: f64 = 768.0;
/// Cost of a scattering of a light path in nominal samples.
const PATH_SAMPLES: f64 = 256.0;

/// Speed where none was measured, ms for a nominal sample: two cores without a graphics card.
const UNMEASURED_MS: f64 = 1e-6;
/// How much of the way to a new measurement the remembered one goes, both as logarithms. A slow
/// picture may have been slow by accident (a pipeline was compiled, others used the machine), a
/// fast one cannot have been.
const TOWARDS_FASTER: f64 = 0.6;
const TOWARDS_SLOWER: f64 = 0.3;

/// Most volumes and modes that are remembered; the one measured the longest ago goes.
const MOST_SPEEDS: usize = 64;

/// How pictures are reduced, step by step: the share of width and height, and the factor of the
/// sample distance.
///
/// Rays first: half as many on a side quarter the work and only blur. Longer steps between samples
/// show rings and holes in surfaces, which the eye forgives less, and come last.
const STEPS: [(f64, f64); 15] = [
    (1.0, 1.0), // with the samples of a moving picture
    (0.84, 1.0),
    (0.71, 1.0),
    (0.59, 1.0),
    (0.5, 1.0),
    (0.42, 1.0),
    (0.35, 1.0),
    (0.3, 1.0),
    (0.25, 1.0),
    (0.25, 2.0),
    (0.21, 2.0),
    (0.18, 2.0),
    (0.15, 2.0),
    (0.125, 2.0),
    (0.125, 4.0),
];

/// Longest sample distance of a reduced picture, mm: that of requests.
const MOST_SAMPLE_MM: f64 = 100.0;

/// A request within a budget.
#[derive(Clone, Debug, PartialEq)]
pub struct BudgetedRequest {
    /// The request, reduced where it had to be.
    pub request: RenderRequest,
    /// The expected render time.
    pub expected_ms: f64,
    /// Whether the request was reduced.
    pub is_reduced: bool,
}

/// How fast pictures are, by volume and mode.
#[derive(Clone, Debug, Default)]
pub struct SpeedBook {
    /// The latest measured last.
    speeds: Vec<Speed>,
}

#[derive(Clone, Copy, Debug)]
struct Speed {
    volume: ContentHash,
    mode: Mode,
    detail: Detail,
    ms_per_sample: f64,
}

impl SpeedBook {
    /// Allowed budgets, ms.
    pub const BUDGET_MS: std::ops::RangeInclusive<f64> = RenderRequest::BUDGET_MS;

    /// Remembers the time of a picture. `passes` is the number of its passes, of mode
    /// path-traced.
    pub fn record(
        &mut self,
        volume: ContentHash,
        grid: &Grid,
        request: &RenderRequest,
        passes: u32,
        ms: f64,
    ) {
        let measured = ms / work(grid, request, passes);
        if !(measured.is_finite() && measured > 0.0) {
            return;
        }
        let known = self.speeds.iter().position(|speed| speed.is_of(volume, request));
        let before = known.map(|at| self.speeds.remove(at).ms_per_sample);
        if self.speeds.len() == MOST_SPEEDS {
            self.speeds.remove(0);
        }
        let ms_per_sample = before.map_or(measured, |before| smoothed(before, measured));
        let RenderRequest { mode, detail, .. } = *request;
        self.speeds.push(Speed { volume, mode, detail, ms_per_sample });
    }

    /// Forgets a volume.
    pub fn forget(&mut self, volume: ContentHash) {
        self.speeds.retain(|speed| speed.volume != volume);
    }

    /// The expected render time of a request, ms.
    #[must_use]
    pub fn expected_ms(&self, volume: ContentHash, grid: &Grid, request: &RenderRequest) -> f64 {
        let known = self.speeds.iter().find(|speed| speed.is_of(volume, request));
        let ms_per_sample = known.map_or(UNMEASURED_MS, |speed| speed.ms_per_sample);
        let views = if request.casts_views_beside() { VIEWS_SHARE } else { 0.0 };
        work(grid, request, request.path_trace.passes) * ms_per_sample * (1.0 + views)
    }

    /// The request, reduced as little as it has to be for an expected time within the budget, and
    /// not beyond an eighth of its width and height at four times its sample distance. Path-traced
    /// pictures lose passes first.
    #[must_use]
    pub fn plan(
        &self,
        volume: ContentHash,
        grid: &Grid,
        request: &RenderRequest,
        budget_ms: f64,
    ) -> BudgetedRequest {
        self.reduced(volume, grid, request, |_| budget_ms)
    }

    /// The request of a view that moves in a live session: 60 pictures a second, or fewer where each
    /// would have less than three tenths of its width and height.
    #[must_use]
    pub fn plan_moving(&self, volume: ContentHash, grid: &Grid, request: &RenderRequest) -> BudgetedRequest {
        self.reduced(volume, grid, request, |share| if share > BLURRED { SMOOTH_MS } else { SHARP_MS })
    }

    /// As [`SpeedBook::plan`], with a budget for each share of width and height.
    fn reduced(
        &self,
        volume: ContentHash,
        grid: &Grid,
        request: &RenderRequest,
        budget_ms: impl Fn(f64) -> f64,
    ) -> BudgetedRequest {
        let expected = |request: &RenderRequest| self.expected_ms(volume, grid, request);
        let wanted = request.path_trace.passes;
        let mut reduced = request.clone();
        let moving = as_moving(request, grid);
        let steps = STEPS.iter().map(|&(share, factor)| (share, at_step(&moving, share, factor)));
        for (share, tried) in std::iter::once((1.0, request.clone())).chain(steps) {
            reduced = tried;
            let budget_ms = budget_ms(share);
            if request.mode == Mode::PathTraced {
                reduced.path_trace.passes =
                    most_passes(&reduced, wanted, |tried| expected(tried) <= budget_ms);
            }
            if expected(&reduced) <= budget_ms {
                break;
            }
        }
        let (expected_ms, is_reduced) = (expected(&reduced), reduced != *request);
        BudgetedRequest { request: reduced, expected_ms, is_reduced }
    }

    /// The least that [`SpeedBook::plan`] gives: to measure speed by where nothing is known.
    #[must_use]
    pub fn least(request: &RenderRequest) -> RenderRequest {
        let (share, factor) = STEPS[STEPS.len() - 1];
        let mut least = at_step(request, share, factor);
        least.path_trace.passes = 1;
        least
    }
}

impl Speed {
    fn is_of(&self, volume: ContentHash, request: &RenderRequest) -> bool {
        self.volume == volume && self.mode == request.mode && self.detail == request.detail
    }
}

/// Nominal samples of a picture.
fn work(grid: &Grid, request: &RenderRequest, passes: u32) -> f64 {
    let [width, height] = request.reduced_px.unwrap_or(request.size_px).map(f64::from);
    let scatterings = f64::from(request.path_trace.scatterings);
    let paths =
        if request.mode == Mode::PathTraced { f64::from(passes) * scatterings * PATH_SAMPLES } else { 0.0 };
    width * height * (RAY_SAMPLES + request.samples_of_ray(grid) + paths)
}

fn smoothed(before: f64, measured: f64) -> f64 {
    let share = if measured < before { TOWARDS_FASTER } else { TOWARDS_SLOWER };
    (before.ln() + share * (measured.ln() - before.ln())).exp()
}

/// The request with no more samples than a moving picture has.
fn as_moving(request: &RenderRequest, grid: &Grid) -> RenderRequest {
    let moving_mm = Quality::Moving.sample_distance_mm(request, grid);
    let sample_distance_mm = request.sample_distance_mm.max(moving_mm);
    RenderRequest { sample_distance_mm, ..request.clone() }.without_views_beside()
}

fn at_step(request: &RenderRequest, share: f64, factor: f64) -> RenderRequest {
    let mut reduced = request.clone();
    if share < 1.0 {
        let side = |pixels: u32| ((f64::from(pixels) * share).round() as u32).max(1);
        reduced.reduced_px = Some(request.size_px.map(side));
    }
    let longest = MOST_SAMPLE_MM.max(request.sample_distance_mm);
    reduced.sample_distance_mm = (request.sample_distance_mm * factor).min(longest);
    reduced
}

/// The largest power of two of passes, or all that are wanted, for which `fits` holds; 1 where it
/// never does.
fn most_passes(request: &RenderRequest, wanted: u32, fits: impl Fn(&RenderRequest) -> bool) -> u32 {
    let with = |passes: u32| {
        let mut tried = request.clone();
        tried.path_trace.passes = passes;
        tried
    };
    let halved = std::iter::successors(Some(wanted), |&passes| {
        (passes > 1)
            .then(|| if passes.is_power_of_two() { passes / 2 } else { passes.next_power_of_two() / 2 })
    });
    halved.into_iter().find(|&passes| fits(&with(passes))).unwrap_or(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use relief_render::{DepthRule, SceneFile};
    use relief_volume::Orbit;

    const VOLUME: ContentHash = ContentHash([7; 32]);

    fn grid() -> Grid {
        Grid::axis_aligned([100; 3], [1.0; 3], [0.0; 3]).unwrap()
    }

    /// Depth for views counts in the expected time of a still. A small budget leaves it out before it
    /// reduces pixels.
    #[test]
    fn views_beside_a_picture_count_in_its_budget_and_go_first() {
        let scene = SceneFile::default().with_size([800, 400]).with_depth_rule(DepthRule::Views);
        let still = scene.resolve(&grid(), &Orbit::default()).unwrap().request;
        let mut book = SpeedBook::default();
        book.record(VOLUME, &grid(), &still, 1, 100.0);
        let expected = |request: &RenderRequest| book.expected_ms(VOLUME, &grid(), request);
        assert!((expected(&still) - 160.0).abs() < 1e-9, "{}", expected(&still));
        assert!((expected(&still.clone().without_views_beside()) - 100.0).abs() < 1e-9);
        assert!(book.plan(VOLUME, &grid(), &still, 170.0).request.casts_views_beside());
        let planned = book.plan(VOLUME, &grid(), &still, 150.0).request;
        assert!(!planned.casts_views_beside() && planned.reduced_px.is_none());
    }

    fn request(json: &str) -> RenderRequest {
        let scene = SceneFile::parse(json.as_bytes()).unwrap().with_size([800, 400]);
        let scene = scene.with_depth_rule(DepthRule::default());
        scene.resolve(&grid(), &Orbit::default()).unwrap().request
    }

    /// Nominal samples by hand: the box of 100 mm has a diagonal of 173.2 mm.
    fn by_hand(pixels: f64, sample_mm: f64) -> f64 {
        pixels * (768.0 + 100.0 * 3f64.sqrt() / sample_mm)
    }

    #[test]
    fn time_follows_pixels_and_samples_at_the_measured_speed() {
        let request = request(r#"{"sample_distance_mm": 1}"#);
        let mut book = SpeedBook::default();
        let guess = book.expected_ms(VOLUME, &grid(), &request);
        assert!((guess - 1e-6 * by_hand(320_000.0, 1.0)).abs() < 1e-9, "{guess}");
        book.record(VOLUME, &grid(), &request, 0, 120.0);
        assert!((book.expected_ms(VOLUME, &grid(), &request) - 120.0).abs() < 1e-9);
        let reduced = at_step(&request, 0.5, 2.0);
        let expected = 120.0 * by_hand(80_000.0, 2.0) / by_hand(320_000.0, 1.0);
        assert!((book.expected_ms(VOLUME, &grid(), &reduced) - expected).abs() < 1e-9);
        // Each mode and each volume has a speed of its own.
        let mip = RenderRequest { mode: Mode::Mip, ..request.clone() };
        assert!((book.expected_ms(VOLUME, &grid(), &mip) - guess).abs() < 1e-9);
        let other = ContentHash([8; 32]);
        assert!((book.expected_ms(other, &grid(), &request) - guess).abs() < 1e-9);
        book.forget(VOLUME);
        assert!((book.expected_ms(VOLUME, &grid(), &request) - guess).abs() < 1e-9);
    }

    #[test]
    fn a_faster_picture_is_believed_sooner_than_a_slower_one() {
        let request = request("{}");
        let after = |times: &[f64]| {
            let mut book = SpeedBook::default();
            for &ms in times {
                book.record(VOLUME, &grid(), &request, 0, ms);
            }
            book.expected_ms(VOLUME, &grid(), &request)
        };
        // Exponential means of logarithms: 100 * (10 / 100)^0.6, and 10 * (100 / 10)^0.3.
        assert!((after(&[100.0, 10.0]) - 100.0 * 0.1f64.powf(0.6)).abs() < 1e-9);
        assert!((after(&[10.0, 100.0]) - 10.0 * 10f64.powf(0.3)).abs() < 1e-9);
        // A first picture that compiled for a second is forgotten within a few.
        assert!(after(&[1000.0, 20.0, 20.0, 20.0, 20.0]) < 23.0);
        // A time of zero says nothing about the speed.
        assert!((after(&[50.0, 0.0, f64::NAN, -3.0, f64::INFINITY]) - 50.0).abs() < 1e-9);
    }

    /// Invariant: A time budget is kept by measured speed; a reduced picture has the requested size
    /// and depths that were rendered; without a budget nothing is reduced.
    #[test]
    fn a_plan_keeps_its_budget_with_as_little_loss_as_possible() {
        let request = request(r#"{"sample_distance_mm": 1}"#);
        let mut book = SpeedBook::default();
        book.record(VOLUME, &grid(), &request, 0, 200.0);
        let plan = |budget_ms| book.plan(VOLUME, &grid(), &request, budget_ms);
        let whole = plan(200.1);
        assert!(!whole.is_reduced && whole.request == request);
        for (budget_ms, rays, sample_mm) in [
            (199.0, [672, 336], 1.0), // 0.84^2 is 0.71
            (101.0, [568, 284], 1.0), // 0.71^2 is 0.50
            (51.0, [400, 200], 1.0),  // half of each side
            (49.0, [336, 168], 1.0),
            (10.0, [168, 84], 2.0), // longer steps after a quarter of each side
            (0.5, [100, 50], 4.0),  // no less than this
        ] {
            let BudgetedRequest { request: reduced, expected_ms, is_reduced } = plan(budget_ms);
            assert!(
                is_reduced && (expected_ms <= budget_ms || budget_ms < 1.0),
                "{budget_ms}: {expected_ms}"
            );
            assert_eq!((reduced.reduced_px, reduced.size_px), (Some(rays), [800, 400]), "{budget_ms}");
            assert!((reduced.sample_distance_mm - sample_mm).abs() < 1e-12, "{budget_ms}");
        }
        // More samples than a moving picture has go first.
        let close = RenderRequest { sample_distance_mm: 0.25, ..request.clone() };
        let moving = RenderRequest { sample_distance_mm: 0.5, ..request.clone() };
        let enough_ms = 1.01 * book.expected_ms(VOLUME, &grid(), &moving);
        let reduced = book.plan(VOLUME, &grid(), &close, enough_ms).request;
        assert_eq!((reduced.reduced_px, reduced.sample_distance_mm), (None, 0.5));
        let expected: Vec<f64> = [0.5, 1.0, 5.0, 20.0, 60.0, 100.0].map(|ms| plan(ms).expected_ms).to_vec();
        assert!(expected.is_sorted(), "a larger budget gives no less: {expected:?}");
    }

    #[test]
    fn a_moving_view_is_smooth_unless_its_pictures_would_be_too_small() {
        let request = request(r#"{"sample_distance_mm": 1}"#);
        let planned = |whole_ms: f64| {
            let mut book = SpeedBook::default();
            book.record(VOLUME, &grid(), &request, 0, whole_ms);
            let BudgetedRequest { request, expected_ms, .. } = book.plan_moving(VOLUME, &grid(), &request);
            (request.reduced_px.unwrap_or(request.size_px), expected_ms)
        };
        for (whole_ms, size_px, longest_ms) in [
            (13.0, [800, 400], SMOOTH_MS),
            (50.0, [400, 200], SMOOTH_MS),
            (110.0, [280, 140], SMOOTH_MS),
            (200.0, [240, 120], SHARP_MS), // 0.3² of 200 ms is 18 ms
            (390.0, [240, 120], SHARP_MS),
            (500.0, [200, 100], SHARP_MS),
        ] {
            let (found_px, expected_ms) = planned(whole_ms);
            assert!(expected_ms <= longest_ms, "{whole_ms}: {expected_ms}");
            assert_eq!(found_px, size_px, "{whole_ms}");
        }
    }

    #[test]
    fn light_paths_lose_passes_before_pixels() {
        let json = r#"{"mode": "path-traced", "sample_distance_mm": 1, "path_trace": {"passes": 48}}"#;
        let request = request(json);
        let mut book = SpeedBook::default();
        // Only ten of the requested passes were rendered: the others were cached.
        book.record(VOLUME, &grid(), &request, 10, 1000.0);
        let rays = 768.0 + 100.0 * 3f64.sqrt();
        let expected = 1000.0 * (rays + 48.0 * 256.0) / (rays + 10.0 * 256.0);
        assert!((book.expected_ms(VOLUME, &grid(), &request) - expected).abs() < 1e-6);
        let plan = |budget_ms| book.plan(VOLUME, &grid(), &request, budget_ms).request;
        for (budget_ms, passes, is_smaller) in
            [(5000.0, 48, false), (3700.0, 32, false), (500.0, 2, false), (42.0, 1, true)]
        {
            let reduced = plan(budget_ms);
            assert_eq!(
                (reduced.path_trace.passes, reduced.reduced_px.is_some()),
                (passes, is_smaller),
                "{budget_ms}"
            );
        }
    }

    #[test]
    fn a_book_is_bounded_and_drops_the_oldest_entries() {
        let request = request("{}");
        let mut book = SpeedBook::default();
        for i in 0..MOST_SPEEDS + 10 {
            book.record(ContentHash([u8::try_from(i).unwrap(); 32]), &grid(), &request, 0, 500.0);
            book.record(ContentHash([0; 32]), &grid(), &request, 0, 500.0);
        }
        assert_eq!(book.speeds.len(), MOST_SPEEDS);
        assert!(book.speeds.iter().any(|speed| speed.volume == ContentHash([0; 32])));
    }
}

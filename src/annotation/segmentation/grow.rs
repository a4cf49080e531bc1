//! Region growing: the voxels connected to seeds with values in a range, with limits against leaks.

use rayon::prelude::*;

use super::ball::{Ball, set_bits, span};
use super::flood::flood;
use relief_base::{OutOfRange, Patient, Point};
use relief_volume::{Mask, Volume};

/// Seeds, range and limits of growing.
#[derive(Clone, Debug, PartialEq)]
pub struct Grow {
    /// The start: in one voxel each, the nearest.
    pub seeds: Vec<Point<Patient>>,
    /// Smallest and largest value of voxels that are taken, HU.
    pub hu: [i16; 2],
    /// Limits against leaks.
    pub limits: GrowLimits,
}

/// Limits of growth. Without any, a region is everything that is connected.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GrowLimits {
    /// Larger regions are refused as leaked, ml.
    pub max_ml: Option<f64>,
    /// Voxels whose centres are farther from the nearest seed are left out, mm.
    pub max_radius_mm: Option<f64>,
    /// Smallest width of bridges, mm: the region is what a ball of this diameter reaches as it
    /// rolls from the seeds through the connected voxels (an opening, which also removes corners
    /// that the ball does not reach).
    pub neck_mm: Option<f64>,
}

/// A grown region.
#[derive(Clone, Debug)]
pub struct GrownRegion {
    /// Its voxels.
    pub mask: Mask,
    /// Their number.
    pub voxels: u64,
    /// Their volume.
    pub volume_ml: f64,
    /// Why it is not larger.
    pub ended: GrowthEnd,
}

/// Why a region is not larger than it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum GrowthEnd {
    /// There is nothing more that is connected.
    Complete,
    /// It continues beyond `max_radius_mm`.
    AtRadius,
    /// It continues behind bridges thinner than `neck_mm`.
    AtNeck,
}

/// The current step, for progress.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GrowProgress {
    /// The stage.
    pub stage: GrowStage,
    /// Voxels taken so far by this stage.
    pub voxels: u64,
}

/// The parts of the work, in their order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GrowStage {
    /// Values are compared with the range.
    Range,
    /// The region grows.
    Growing,
    /// Thin bridges are looked for.
    Necks,
}

/// Receives progress; returning false cancels the work.
pub(crate) type GrowWatch<'a> = dyn Fn(GrowProgress) -> bool + Sync + 'a;

/// Why no region was made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GrowError {
    /// It became larger than allowed.
    #[error(
        "the region leaked: it reached {reached_ml:.1} ml, allowed: {allowed_ml:.1} ml; narrow the range of values, or set a \
         neck or a radius"
    )]
    Leaked {
        /// Volume when it was stopped, ml: at least this much is connected.
        reached_ml: f64,
        /// The limit, ml.
        allowed_ml: f64,
    },
    /// A number that is no limit, or no range.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// A seed outside of the volume.
    #[error("seed {x:.1} {y:.1} {z:.1} mm is outside of the volume, which spans {span} (patient LPS)")]
    Outside {
        /// Patient x, mm.
        x: f64,
        /// Patient y, mm.
        y: f64,
        /// Patient z, mm.
        z: f64,
        /// The volume's box.
        span: String,
    },
    /// A seed on a value that is not taken.
    #[error("seed {seed} has {found} HU, allowed: {low} to {high} HU; move it or widen the range")]
    Value {
        /// The seed, from 1.
        seed: usize,
        /// Its voxel's value.
        found: i16,
        /// Smallest value of the range.
        low: i16,
        /// Largest value of the range.
        high: i16,
    },
    /// A seed where the ball of the neck limit does not fit.
    #[error(
        "no seed lies in a part as thick as the neck limit of {neck_mm} mm; move a seed to a thicker part or lower the limit"
    )]
    Thin {
        /// The limit, mm.
        neck_mm: f64,
    },
    /// The caller cancelled.
    #[error("stopped before the region was complete")]
    Cancelled,
}

impl GrowLimits {
    /// Largest neck limit: the cost of its ball grows with its square.
    pub const WIDEST_NECK_MM: f64 = 50.0;
    /// Most rows of voxels across that ball, which is what thinning costs for each row of the
    /// volume.
    const MOST_ROWS: usize = 20_000;

    fn check(&self) -> Result<(), OutOfRange> {
        let check = |key, value: Option<f64>, most: f64| match value {
            Some(found) if !(found > 0.0 && found <= most) => {
                let allowed = format!("more than 0, at most {most}");
                Err(OutOfRange::new(key, found, allowed))
            }
            _ => Ok(()),
        };
        check("max_ml", self.max_ml, 1e6)?;
        check("max_radius_mm", self.max_radius_mm, 1e6)?;
        check("neck_mm", self.neck_mm, Self::WIDEST_NECK_MM)
    }
}

impl Grow {
    /// Most seeds.
    pub const MOST_SEEDS: usize = 1000;

    fn check(&self) -> Result<(), OutOfRange> {
        let refuse = |key, found: String, allowed: String| Err(OutOfRange::new(key, found, allowed));
        if !(1..=Self::MOST_SEEDS).contains(&self.seeds.len()) {
            return refuse(
                "seeds",
                format!("{} points", self.seeds.len()),
                format!("1 to {}", Self::MOST_SEEDS),
            );
        }
        let [low, high] = self.hu;
        if low > high {
            return refuse("hu", format!("{low} to {high}"), "the smaller value first".to_owned());
        }
        self.limits.check()
    }

    /// The voxels that seeds lie in.
    fn seed_mask(&self, volume: &Volume) -> Result<Mask, GrowError> {
        let [low, high] = self.hu;
        let mut mask = Mask::empty(volume.grid().clone());
        for (n, seed) in self.seeds.iter().enumerate() {
            let index = (volume.grid().voxel_from_patient() * *seed).xyz.round();
            let dims = volume.grid().dims();
            let inside = |axis: usize| index[axis] >= 0.0 && index[axis] < dims[axis] as f64; // false for NaN
            if !(0..3).all(inside) {
                let bounds = volume.grid().bounds();
                let span = format!("{:.0} to {:.0} mm", bounds.min.xyz, bounds.max.xyz);
                let [x, y, z] = seed.xyz.to_array();
                return Err(GrowError::Outside { x, y, z, span });
            }
            let index = index.to_array().map(|i| i as usize);
            let found = volume.hu(index);
            if !(low..=high).contains(&found) {
                return Err(GrowError::Value { seed: n + 1, found, low, high });
            }
            mask.set(index, true);
        }
        Ok(mask)
    }
}

/// Grows a region. `watch` receives progress and can cancel.
///
/// # Errors
/// See [`GrowError`]: arguments out of range, seeds outside or on other values, a leak, or a stop.
pub fn grow_region(volume: &Volume, what: &Grow, watch: &GrowWatch) -> Result<GrownRegion, GrowError> {
    what.check()?;
    let seeds = what.seed_mask(volume)?;
    goes_on(watch, GrowStage::Range, 0)?;
    let mut candidates = Mask::of_range(volume, what.hu);
    let within = what.limits.max_radius_mm.map(|radius_mm| {
        let within = SeedBalls { seeds: &what.seeds, radius_mm };
        within.keep(&mut candidates);
        within
    });
    let limited = what.limits.neck_mm.is_none().then_some(what.limits.max_ml).flatten();
    let connected = run(&candidates, &seeds, limited, watch)?;
    let mut ended = GrowthEnd::Complete;
    let mask = match what.limits.neck_mm {
        None => connected,
        Some(neck_mm) => {
            drop(candidates);
            let (opened, is_all) = open(&connected, &seeds, neck_mm, watch)?;
            ended = if is_all { ended } else { GrowthEnd::AtNeck };
            opened
        }
    };
    if within.is_some_and(|within| within.is_cut(&mask, volume, what.hu)) {
        ended = GrowthEnd::AtRadius;
    }
    let (voxels, volume_ml) = (mask.voxels(), mask.volume_ml());
    match what.limits.max_ml {
        Some(allowed_ml) if volume_ml > allowed_ml => {
            Err(GrowError::Leaked { reached_ml: volume_ml, allowed_ml })
        }
        _ => Ok(GrownRegion { mask, voxels, volume_ml, ended }),
    }
}

fn goes_on(watch: &GrowWatch, stage: GrowStage, voxels: u64) -> Result<(), GrowError> {
    watch(GrowProgress { stage, voxels }).then_some(()).ok_or(GrowError::Cancelled)
}

/// Floods until done, stopped, or larger than allowed.
fn run(candidates: &Mask, seeds: &Mask, max_ml: Option<f64>, watch: &GrowWatch) -> Result<Mask, GrowError> {
    let mut failed = GrowError::Cancelled;
    let found = flood(candidates, seeds, &mut |voxels| {
        let reached_ml = voxels as f64 * candidates.voxel_ml();
        if let Some(allowed_ml) = max_ml.filter(|allowed_ml| reached_ml > *allowed_ml) {
            failed = GrowError::Leaked { reached_ml, allowed_ml };
            return false;
        }
        watch(GrowProgress { stage: GrowStage::Growing, voxels })
    });
    found.ok_or(failed)
}

/// The part of the region that a ball of diameter `neck_mm` reaches from the seeds, and whether it
/// reaches everything.
fn open(connected: &Mask, seeds: &Mask, neck_mm: f64, watch: &GrowWatch) -> Result<(Mask, bool), GrowError> {
    let ball = Ball::new(connected.grid(), neck_mm / 2.0);
    if ball.rows() > GrowLimits::MOST_ROWS {
        let allowed =
            format!("a ball of at most {} rows of voxels, found {}", GrowLimits::MOST_ROWS, ball.rows());
        return Err(OutOfRange::new("neck_mm", neck_mm, allowed).into());
    }
    let voxels = connected.voxels();
    let is_wanted = || watch(GrowProgress { stage: GrowStage::Necks, voxels });
    let middles = ball.thinned(connected, &is_wanted).ok_or(GrowError::Cancelled)?;
    // The ball may start at every place at which it covers a seed.
    let covering = ball.thickened(seeds, &is_wanted).ok_or(GrowError::Cancelled)?;
    let reached = run(&middles, &covering, None, watch)?;
    if reached.voxels() == 0 {
        return Err(GrowError::Thin { neck_mm });
    }
    let is_all = reached == middles;
    drop((middles, covering));
    Ok((ball.thickened(&reached, &is_wanted).ok_or(GrowError::Cancelled)?, is_all))
}

/// The balls around all seeds.
struct SeedBalls<'a> {
    seeds: &'a [Point<Patient>],
    radius_mm: f64,
}

impl SeedBalls<'_> {
    /// The bits of a row that lie in any ball.
    fn row(&self, mask: &Mask, at: [usize; 2], out: &mut [u64]) {
        out.fill(0);
        self.seeds.iter().for_each(|seed| set_bits(out, span(mask.grid(), *seed, self.radius_mm, at)));
    }

    fn keep(&self, candidates: &mut Mask) {
        let frame = Mask::empty(candidates.grid().clone());
        let (words, ny) = (candidates.row_words(), candidates.grid().dims()[1]);
        let rows = candidates.words_mut().par_chunks_mut(words).enumerate();
        rows.for_each_init(
            || vec![0; words],
            |within, (at, row)| {
                self.row(&frame, [at % ny, at / ny], within);
                row.iter_mut().zip(&*within).for_each(|(row, within)| *row &= within);
            },
        );
    }

    /// Whether a voxel of the region has a neighbour in the range that was left out for being too
    /// far.
    fn is_cut(&self, region: &Mask, volume: &Volume, [low, high]: [i16; 2]) -> bool {
        let [nx, ny, nz] = region.grid().dims();
        let words = region.row_words();
        (0..ny * nz).into_par_iter().any(|at| {
            let (j, k) = (at % ny, at / ny);
            let mut beside = vec![0; words];
            let rows = [(j + 1, k), (j, k + 1), (j.wrapping_sub(1), k), (j, k.wrapping_sub(1))];
            for row in rows.into_iter().filter_map(|(j, k)| region.row(j, k)) {
                beside.iter_mut().zip(row).for_each(|(beside, row)| *beside |= row);
            }
            let own = &region.words()[at * words..(at + 1) * words];
            for (n, beside) in beside.iter_mut().enumerate() {
                let before = n.checked_sub(1).map_or(0, |n| own[n] >> 63);
                let after = own.get(n + 1).map_or(0, |next| next << 63);
                *beside |= own[n] << 1 | before | own[n] >> 1 | after;
            }
            if beside.iter().all(|word| *word == 0) {
                return false;
            }
            let mut within = vec![0; words];
            self.row(region, [j, k], &mut within);
            let values = &volume.voxels_hu()[at * nx..(at + 1) * nx];
            let is_left_out = |i: usize| beside[i / 64] & !within[i / 64] & 1 << (i % 64) != 0;
            (0..nx).any(|i| is_left_out(i) && (low..=high).contains(&values[i]))
        })
    }
}

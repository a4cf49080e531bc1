//! Smoothing that keeps the volume.
//!
//! G. Taubin, "A signal processing approach to fair surface design", 1995: corners move towards the
//! mean of their neighbours, then by a little more away from it, so that steps between voxels go
//! and shapes stay. What little the volume has changed after that is given back by moving all
//! corners of a closed mesh along their normals, by the same length.

use glam::Vec3;
use rayon::prelude::*;

use super::fans::{Fan, Fans};
use super::{MeshError, TriangleMesh};
use relief_base::{OutOfRange, Point};

/// The strength of smoothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Smoothing {
    /// Times there and back, 0 to 200. Waves shorter than about 2.5 times the square root of this
    /// many edges go.
    pub rounds: u32,
}

impl Default for Smoothing {
    /// 10 rounds remove the steps of voxels and keep structures four voxels wide.
    fn default() -> Self {
        Self { rounds: 10 }
    }
}

impl Smoothing {
    /// Most rounds.
    pub const MOST_ROUNDS: u32 = 200;
}

/// The share of the way to the neighbours' mean that corners go.
const THERE: f32 = 0.5;
/// And back: waves are kept whole where 1 / THERE + 1 / BACK is 0.1 and below.
const BACK: f32 = -0.526_315_8;

impl TriangleMesh {
    /// A smoother mesh of the same triangles. Corners that are not surrounded by triangles stay
    /// where they are.
    ///
    /// # Errors
    /// When there are more rounds than [`Smoothing::MOST_ROUNDS`], or [`TriangleMesh::check`]
    /// fails.
    pub fn smoothed(&self, smoothing: Smoothing) -> Result<Self, MeshError> {
        self.check()?;
        let rounds = smoothing.rounds;
        if rounds > Smoothing::MOST_ROUNDS {
            let allowed = format!("0 to {}", Smoothing::MOST_ROUNDS);
            return Err(OutOfRange::new("rounds", rounds, allowed).into());
        }
        let fans = Fans::new(self);
        let is_closed: Vec<bool> =
            (0..fans.len()).into_par_iter().map(|corner| fans.kind(corner) == Fan::Closed).collect();
        let middle = self.middle();
        let mut places: Vec<Vec3> =
            self.vertices.iter().map(|vertex| (vertex.xyz - middle).as_vec3()).collect();
        let mut moved = places.clone();
        for _ in 0..rounds {
            for share in [THERE, BACK] {
                moved.par_iter_mut().enumerate().with_min_len(1 << 10).for_each(|(corner, place)| {
                    let own = places[corner];
                    *place = own;
                    if is_closed[corner] {
                        let sides = fans.around(corner);
                        let sum: Vec3 = sides.iter().map(|side| places[side[0] as usize]).sum();
                        *place = own.lerp(sum / sides.len() as f32, share);
                    }
                });
                std::mem::swap(&mut places, &mut moved);
            }
        }
        let place = |place: &Vec3| Point::from_xyz(place.as_dvec3() + middle);
        let mut mesh =
            Self { vertices: places.iter().map(place).collect(), triangles: self.triangles.clone() };
        if is_closed.iter().all(|is_closed| *is_closed) && !mesh.triangles.is_empty() {
            let (_, wanted) = self.sums();
            // The error after the first step is second order; the second step removes it.
            mesh.give_back(&fans, wanted);
            mesh.give_back(&fans, wanted);
        }
        Ok(mesh)
    }

    /// Moves all corners along their normals until the volume is nearly as wanted.
    fn give_back(&mut self, fans: &Fans, wanted_mm3: f64) {
        let (area, volume) = self.sums();
        let by = (wanted_mm3 - volume) / area;
        if !by.is_finite() {
            return;
        }
        let normals: Vec<glam::DVec3> = (0..fans.len())
            .into_par_iter()
            .map(|corner| {
                let own = self.vertices[corner].xyz;
                let side = |side: &[u32; 2]| {
                    let [a, b] = side.map(|corner| self.vertices[corner as usize].xyz - own);
                    a.cross(b)
                };
                fans.around(corner).iter().map(side).sum::<glam::DVec3>().normalize_or_zero()
            })
            .collect();
        self.vertices.iter_mut().zip(normals).for_each(|(vertex, normal)| vertex.xyz += normal * by);
    }
}

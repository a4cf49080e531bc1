//! The regular grid of a volume: dimensions and placement in patient space.

use glam::DVec3;

use relief_base::{Patient, Point, Transform, Voxel};

/// Dimensions of a volume and where its voxel centres lie in patient space.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    dims: [usize; 3],
    patient_from_voxel: Transform<Patient, Voxel>,
}

/// A grid that cannot hold a volume.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GridError {
    /// A dimension is zero, or the voxel count overflows.
    #[error("the dimensions are {0:?} voxels; each must be at least 1, and their product addressable")]
    Dims([usize; 3]),
    /// The axes do not span space.
    #[error(
        "the voxel axes {x:?}, {y:?}, {z:?} mm are not linearly independent; spacing must be positive and finite"
    )]
    Axes {
        /// Step from one voxel to the next along i, mm.
        x: DVec3,
        /// Step along j, mm.
        y: DVec3,
        /// Step along k, mm.
        z: DVec3,
    },
}

/// An axis-aligned box in patient space, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Corner with the smallest coordinates.
    pub min: Point<Patient>,
    /// Corner with the largest coordinates.
    pub max: Point<Patient>,
}

impl Grid {
    /// A grid of `dims` voxels whose centres `patient_from_voxel` places.
    ///
    /// # Errors
    /// When a dimension is zero, the voxel count overflows, or the axes are not finite and
    /// independent.
    pub fn new(dims: [usize; 3], patient_from_voxel: Transform<Patient, Voxel>) -> Result<Self, GridError> {
        let count = dims.iter().try_fold(1usize, |product, &n| product.checked_mul(n));
        if !matches!(count, Some(n) if n > 0 && n <= isize::MAX as usize / 16) {
            return Err(GridError::Dims(dims));
        }
        let axes = patient_from_voxel.linear();
        if patient_from_voxel.inverse().is_none() {
            return Err(GridError::Axes { x: axes.x_axis, y: axes.y_axis, z: axes.z_axis });
        }
        Ok(Self { dims, patient_from_voxel })
    }

    /// A grid along the patient axes with its first voxel centre at `origin_mm`.
    ///
    /// # Errors
    /// As [`Grid::new`].
    pub fn axis_aligned(
        dims: [usize; 3],
        spacing_mm: [f64; 3],
        origin_mm: [f64; 3],
    ) -> Result<Self, GridError> {
        let [x, y, z] = spacing_mm;
        let axes = Transform::from_axes(DVec3::X * x, DVec3::Y * y, DVec3::Z * z, DVec3::from(origin_mm));
        Self::new(dims, axes)
    }

    /// Voxels along i, j and k.
    #[must_use]
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// Product of the dimensions.
    #[must_use]
    pub fn voxel_count(&self) -> usize {
        self.dims.iter().product()
    }

    /// Patient position of a voxel index.
    #[must_use]
    pub fn patient_from_voxel(&self) -> Transform<Patient, Voxel> {
        self.patient_from_voxel
    }

    /// Voxel index of a patient position.
    #[must_use]
    pub fn voxel_from_patient(&self) -> Transform<Voxel, Patient> {
        Transform::from_affine(self.patient_from_voxel.affine.inverse())
    }

    /// Distance between neighbouring voxel centres along i, j and k, mm.
    #[must_use]
    pub fn spacing_mm(&self) -> [f64; 3] {
        let axes = self.patient_from_voxel.linear();
        [axes.x_axis.length(), axes.y_axis.length(), axes.z_axis.length()]
    }

    /// The length that replaces the millimetre in constants that are made for bodies, such as the
    /// opacity of presets: 1 mm for bodies and their parts; the smallest spacing for volumes on another
    /// scale, such as micro-CT. So a volume of 35 µm looks like one of 1 mm with the same voxels.
    ///
    /// A volume is of a smaller scale if its longest side is below 30 mm or its spacing below 0.05 mm, and
    /// of a larger one if its longest side is above 3 m.
    #[must_use]
    pub fn unit_mm(&self) -> f64 {
        const LEAST_SPACING_MM: f64 = 0.05;
        const SIDES_MM: std::ops::RangeInclusive<f64> = 30.0..=3000.0;
        let spacing_mm = self.spacing_mm();
        let finest_mm = spacing_mm.into_iter().fold(f64::INFINITY, f64::min);
        let sides_mm = self.dims.iter().zip(spacing_mm).map(|(&count, mm)| count as f64 * mm);
        let longest_mm = sides_mm.fold(0.0, f64::max);
        if longest_mm > *SIDES_MM.end() {
            finest_mm.max(1.0)
        } else if longest_mm < *SIDES_MM.start() || finest_mm < LEAST_SPACING_MM {
            finest_mm.min(1.0)
        } else {
            1.0
        }
    }

    /// The same grid with its unit (see [`Grid::unit_mm`]) as the millimetre.
    pub(crate) fn in_units(&self) -> Self {
        let mut patient_from_voxel = self.patient_from_voxel;
        let scale = self.unit_mm().recip();
        patient_from_voxel.affine.matrix3 *= scale;
        patient_from_voxel.affine.translation *= scale;
        Self { dims: self.dims, patient_from_voxel }
    }

    /// Unit vectors of i, j and k in patient space.
    #[must_use]
    pub fn axis_directions(&self) -> [DVec3; 3] {
        let axes = self.patient_from_voxel.linear();
        [axes.x_axis, axes.y_axis, axes.z_axis].map(DVec3::normalize)
    }

    /// The matrix whose columns are the unit vectors of i, j and k in patient space, row by row, as
    /// ITK has it.
    #[must_use]
    pub fn direction(&self) -> [f64; 9] {
        let [x, y, z] = self.axis_directions();
        // Adding zero turns -0 into 0.
        [x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z].map(|component| component + 0.0)
    }

    /// Patient position of the centre of voxel (0, 0, 0).
    #[must_use]
    pub fn origin(&self) -> Point<Patient> {
        Point::from_xyz(self.patient_from_voxel.affine.translation)
    }

    /// The middle of the volume's box.
    #[must_use]
    pub fn center(&self) -> Point<Patient> {
        let [nx, ny, nz] = self.dims.map(|n| (n as f64 - 1.0) / 2.0);
        self.patient_from_voxel * Point::new(nx, ny, nz)
    }

    /// The eight corners of the box that spans the outer faces of the outermost voxels.
    #[must_use]
    pub fn corners(&self) -> [Point<Patient>; 8] {
        let [nx, ny, nz] = self.dims.map(|n| n as f64 - 0.5);
        std::array::from_fn(|c| {
            let pick = |bit: usize, high: f64| if c >> bit & 1 == 1 { high } else { -0.5 };
            self.patient_from_voxel * Point::new(pick(0, nx), pick(1, ny), pick(2, nz))
        })
    }

    /// Radius of the sphere around [`Grid::center`] through the farthest corner, mm.
    #[must_use]
    pub fn bounding_radius_mm(&self) -> f64 {
        let center = self.center();
        self.corners().into_iter().map(|corner| corner.distance(center)).fold(0.0, f64::max)
    }

    /// The axis-aligned box around [`Grid::corners`].
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        let corners = self.corners().map(|corner| corner.xyz);
        let min = corners.into_iter().reduce(DVec3::min).unwrap_or_default();
        let max = corners.into_iter().reduce(DVec3::max).unwrap_or_default();
        Bounds { min: Point::from_xyz(min), max: Point::from_xyz(max) }
    }

    /// The grid of blocks of `factor`³ voxels; block centres, counting a smaller last block as a
    /// whole one.
    pub(super) fn downsampled(&self, factor: usize) -> Self {
        let affine = self.patient_from_voxel.affine;
        let first = (factor as f64 - 1.0) / 2.0;
        let origin = affine.transform_point3(DVec3::splat(first));
        let step = affine.matrix3 * factor as f64;
        Self {
            dims: self.dims.map(|n| n.div_ceil(factor)),
            patient_from_voxel: Transform::from_axes(step.x_axis, step.y_axis, step.z_axis, origin),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_box_spans_the_outer_faces_of_the_outermost_voxels() {
        let grid = Grid::axis_aligned([10, 20, 30], [1.0, 2.0, 0.5], [5.0, 6.0, 7.0]).unwrap();
        let Bounds { min, max } = grid.bounds();
        assert_eq!(min.xyz, DVec3::new(4.5, 5.0, 6.75));
        assert_eq!(max.xyz, DVec3::new(14.5, 45.0, 21.75));
        assert_eq!(grid.center().xyz, (min.xyz + max.xyz) / 2.0);
        assert!((grid.bounding_radius_mm() - max.distance(min) / 2.0).abs() < 1e-12);
    }

    #[test]
    fn bodies_are_measured_in_millimetres_and_smaller_things_in_voxels() {
        let unit = |side: usize, mm: f64| Grid::axis_aligned([side; 3], [mm; 3], [3.0; 3]).unwrap().unit_mm();
        for (side, mm) in [(512, 0.7), (400, 0.1), (32, 7.5), (4, 10.0), (10, 2.0), (80, 10.0), (10, 1.0)] {
            assert_eq!(unit(side, mm), 1.0, "{side} voxels of {mm} mm");
        }
        for (side, mm) in [(80, 0.1), (1000, 0.035), (80, 1e-4), (80, 100.0)] {
            assert_eq!(unit(side, mm), mm, "{side} voxels of {mm} mm");
        }
        let micro = Grid::axis_aligned([80; 3], [0.25; 3], [2.0; 3]).unwrap().in_units();
        assert_eq!((micro.spacing_mm(), micro.origin().xyz), ([1.0; 3], DVec3::splat(8.0)));
    }

    #[test]
    fn empty_and_flat_grids_are_refused() {
        assert!(matches!(Grid::axis_aligned([0, 1, 1], [1.0; 3], [0.0; 3]), Err(GridError::Dims(_))));
        assert!(matches!(Grid::axis_aligned([usize::MAX; 3], [1.0; 3], [0.0; 3]), Err(GridError::Dims(_))));
        for bad in [0.0, f64::NAN, f64::INFINITY] {
            assert!(matches!(
                Grid::axis_aligned([2; 3], [1.0, bad, 1.0], [0.0; 3]),
                Err(GridError::Axes { .. })
            ));
        }
    }
}

//! Coordinate spaces as types: points, vectors and transforms that cannot be mixed up.
//!
//! | space | definition |
//! |---|---|
//! | [`Voxel`] | continuous index (i, j, k); integers are voxel centres |
//! | [`Patient`] | DICOM LPS (x to the left, y to the back, z to the head), mm; also the world |
//! | [`View`] | right-handed, x right, y up, looking along -z, mm (as OpenGL and glTF) |
//! | [`Beacon`] | the LED rig that a Wiimote looks at, mm |
//! | [`Sensor`] | the camera in a Wiimote, mm: x right, y down, z forward (as OpenCV) |
//!
//! A transform is named destination-from-source and typed the same way, so that neighbours in a
//! product agree: `view_from_patient * patient_from_voxel`. Anything else does not compile:
//!
//! ```compile_fail
//! use relief_base::{Patient, Point, Transform, View, Voxel};
//! fn wrong(view_from_patient: Transform<View, Patient>, index: Point<Voxel>) -> Point<View> {
//!     view_from_patient * index // a voxel index is not a patient point
//! }
//! ```
//!
//! ```
//! use relief_base::{Patient, Point, Transform, View, Voxel};
//! fn right(v: Transform<View, Patient>, p: Transform<Patient, Voxel>, index: Point<Voxel>) -> Point<View> {
//!     v * p * index
//! }
//! ```

use std::marker::PhantomData;
use std::ops::{Add, Mul, Neg, Sub};

use glam::{DAffine3, DMat3, DVec3};

/// A coordinate space; see the table in the module's documentation.
pub trait Space: Copy + std::fmt::Debug + PartialEq + Send + Sync + 'static {
    /// The name used in messages.
    const NAME: &'static str;
}

macro_rules! spaces {
    ($($(#[$doc:meta])* $name:ident),* $(,)?) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub struct $name;
        impl Space for $name {
            const NAME: &'static str = stringify!($name);
        }
    )*};
}

spaces! {
    /// Continuous voxel index (i, j, k) of a volume; integers are voxel centres.
    Voxel,
    /// DICOM LPS in mm, in the series' frame of reference; the world of a scene.
    Patient,
    /// The camera's own space in mm: x right, y up, looking along -z.
    View,
    /// The LED rig that a Wiimote looks at, in mm.
    Beacon,
    /// The camera in a Wiimote, in mm: x right, y down, z forward.
    Sensor,
}

/// A position in space `S`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point<S: Space> {
    /// Coordinates in the space's own unit.
    pub xyz: DVec3,
    space: PhantomData<S>,
}

/// A displacement in space `S`: transforms turn and scale it but do not move it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vector<S: Space> {
    /// Components in the space's own unit.
    pub xyz: DVec3,
    space: PhantomData<S>,
}

/// An affine map that takes points of `Src` to points of `Dst`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transform<Dst: Space, Src: Space> {
    /// The map itself: `dst = matrix3 * src + translation`.
    pub affine: DAffine3,
    spaces: PhantomData<(Dst, Src)>,
}

impl<S: Space> Point<S> {
    /// The point with these coordinates.
    #[must_use]
    pub const fn new(x: f64, y: f64, z: f64) -> Self {
        Self::from_xyz(DVec3::new(x, y, z))
    }

    /// The point with these coordinates.
    #[must_use]
    pub const fn from_xyz(xyz: DVec3) -> Self {
        Self { xyz, space: PhantomData }
    }

    /// Distance to another point, in the space's unit.
    #[must_use]
    pub fn distance(self, other: Self) -> f64 {
        self.xyz.distance(other.xyz)
    }
}

impl<S: Space> Vector<S> {
    /// The vector with these components.
    #[must_use]
    pub const fn new(x: f64, y: f64, z: f64) -> Self {
        Self::from_xyz(DVec3::new(x, y, z))
    }

    /// The vector with these components.
    #[must_use]
    pub const fn from_xyz(xyz: DVec3) -> Self {
        Self { xyz, space: PhantomData }
    }

    /// Length in the space's unit.
    #[must_use]
    pub fn length(self) -> f64 {
        self.xyz.length()
    }

    /// The unit vector in this direction; `None` for a vector of (nearly) no length or a non-finite
    /// one.
    #[must_use]
    pub fn normalized(self) -> Option<Self> {
        self.xyz.try_normalize().map(Self::from_xyz)
    }

    /// Scalar product.
    #[must_use]
    pub fn dot(self, other: Self) -> f64 {
        self.xyz.dot(other.xyz)
    }

    /// Vector product; right-handed.
    #[must_use]
    pub fn cross(self, other: Self) -> Self {
        Self::from_xyz(self.xyz.cross(other.xyz))
    }
}

impl<Dst: Space, Src: Space> Transform<Dst, Src> {
    /// The transform with this matrix and translation.
    #[must_use]
    pub const fn from_affine(affine: DAffine3) -> Self {
        Self { affine, spaces: PhantomData }
    }

    /// The transform whose columns are the images of the source axes, and `origin` that of the
    /// source origin.
    #[must_use]
    pub const fn from_axes(x: DVec3, y: DVec3, z: DVec3, origin: DVec3) -> Self {
        Self::from_affine(DAffine3 { matrix3: DMat3::from_cols(x, y, z), translation: origin })
    }

    /// The linear part.
    #[must_use]
    pub const fn linear(&self) -> DMat3 {
        self.affine.matrix3
    }

    /// The inverse map; `None` when the map is singular or not finite.
    #[must_use]
    pub fn inverse(&self) -> Option<Transform<Src, Dst>> {
        let determinant = self.affine.matrix3.determinant();
        let usable = self.affine.is_finite() && determinant.is_finite() && determinant != 0.0;
        usable.then(|| Transform::from_affine(self.affine.inverse()))
    }
}

impl<Dst: Space, Mid: Space, Src: Space> Mul<Transform<Mid, Src>> for Transform<Dst, Mid> {
    type Output = Transform<Dst, Src>;

    fn mul(self, rhs: Transform<Mid, Src>) -> Self::Output {
        Transform::from_affine(self.affine * rhs.affine)
    }
}

impl<Dst: Space, Src: Space> Mul<Point<Src>> for Transform<Dst, Src> {
    type Output = Point<Dst>;

    fn mul(self, rhs: Point<Src>) -> Self::Output {
        Point::from_xyz(self.affine.transform_point3(rhs.xyz))
    }
}

impl<Dst: Space, Src: Space> Mul<Vector<Src>> for Transform<Dst, Src> {
    type Output = Vector<Dst>;

    fn mul(self, rhs: Vector<Src>) -> Self::Output {
        Vector::from_xyz(self.affine.transform_vector3(rhs.xyz))
    }
}

impl<S: Space> Sub for Point<S> {
    type Output = Vector<S>;

    fn sub(self, rhs: Self) -> Self::Output {
        Vector::from_xyz(self.xyz - rhs.xyz)
    }
}

impl<S: Space> Add<Vector<S>> for Point<S> {
    type Output = Self;

    fn add(self, rhs: Vector<S>) -> Self {
        Self::from_xyz(self.xyz + rhs.xyz)
    }
}

impl<S: Space> Mul<f64> for Vector<S> {
    type Output = Self;

    fn mul(self, rhs: f64) -> Self {
        Self::from_xyz(self.xyz * rhs)
    }
}

impl<S: Space> Neg for Vector<S> {
    type Output = Self;

    fn neg(self) -> Self {
        Self::from_xyz(-self.xyz)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vectors_turn_and_scale_but_do_not_move() {
        let patient_from_voxel: Transform<Patient, Voxel> =
            Transform::from_axes(DVec3::X * 2.0, DVec3::Y, DVec3::Z, DVec3::splat(10.0));
        assert_eq!(patient_from_voxel * Point::new(1.0, 2.0, 3.0), Point::new(12.0, 12.0, 13.0));
        assert_eq!(patient_from_voxel * Vector::new(1.0, 2.0, 3.0), Vector::new(2.0, 2.0, 3.0));
    }

    #[test]
    fn inverse_undoes_and_refuses_singular_maps() {
        let affine = DAffine3::from_rotation_y(0.3) * DAffine3::from_scale(DVec3::new(1.0, 2.0, 3.0));
        let patient_from_voxel: Transform<Patient, Voxel> = Transform::from_affine(affine);
        let p = Point::<Voxel>::new(4.0, 5.0, 6.0);
        let back = patient_from_voxel.inverse().unwrap() * (patient_from_voxel * p);
        assert!(back.distance(p) < 1e-12);
        let flat: Transform<Patient, Voxel> = Transform::from_axes(DVec3::X, DVec3::X, DVec3::Z, DVec3::ZERO);
        assert!(flat.inverse().is_none());
    }
}

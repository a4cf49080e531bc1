//! Three numbers of each lane: a position or a direction.

use crate::Real;

/// Components along x, y and z.
#[derive(Clone, Copy, Debug)]
pub struct Triple<R>(pub [R; 3]);

/// Operations on the components of two, each by the operation of numbers.
macro_rules! by_component {
    ($($(#[$doc:meta])* $name:ident = $operation:path;)*) => {$(
        $(#[$doc])*
        #[inline(always)]
        #[must_use]
        pub fn $name(self, Self([u, v, w]): Self) -> Self {
            let Self([x, y, z]) = self;
            Self([$operation(x, u), $operation(y, v), $operation(z, w)])
        }
    )*};
}

impl<R: Real> Triple<R> {
    by_component! {
        /// The sum.
        plus = R::add;
        /// The difference.
        minus = R::sub;
        /// The products of components.
        times = R::mul;
        /// The quotients of components.
        over = R::div;
        /// The smaller components.
        min = R::min;
        /// The larger components.
        max = R::max;
    }

    /// The same number along each axis.
    #[inline(always)]
    #[must_use]
    pub fn of(number: R) -> Self {
        Self([number; 3])
    }

    /// The whole numbers at or below.
    #[inline(always)]
    #[must_use]
    pub fn floor(self) -> Self {
        let Self([x, y, z]) = self;
        Self([x.floor(), y.floor(), z.floor()])
    }

    /// A multiple of this.
    #[inline(always)]
    #[must_use]
    pub fn scaled(self, factor: R) -> Self {
        self.times(Self::of(factor))
    }

    /// This plus a multiple of another.
    #[inline(always)]
    #[must_use]
    pub fn plus_times(self, other: Self, factor: R) -> Self {
        self.plus(other.scaled(factor))
    }

    /// From this to another, by a share of the way.
    #[inline(always)]
    #[must_use]
    pub fn lerp(self, to: Self, share: R) -> Self {
        self.plus_times(to.minus(self), share)
    }

    /// This where the mask of each axis holds, and the other elsewhere.
    #[inline(always)]
    #[must_use]
    pub fn or_where_not(self, [along_x, along_y, along_z]: [R::Mask; 3], Self([u, v, w]): Self) -> Self {
        let Self([x, y, z]) = self;
        Self([x.or_where_not(along_x, u), y.or_where_not(along_y, v), z.or_where_not(along_z, w)])
    }

    /// The lanes in which the components are smaller.
    #[inline(always)]
    pub fn lt(self, Self([u, v, w]): Self) -> [R::Mask; 3] {
        let Self([x, y, z]) = self;
        [x.lt(u), y.lt(v), z.lt(w)]
    }

    /// Without signs.
    #[inline(always)]
    #[must_use]
    pub fn abs(self) -> Self {
        let Self([x, y, z]) = self;
        Self([x.abs(), y.abs(), z.abs()])
    }

    /// The smallest component.
    #[inline(always)]
    #[must_use]
    pub fn least(self) -> R {
        let Self([x, y, z]) = self;
        x.min(y).min(z)
    }

    /// The largest component.
    #[inline(always)]
    #[must_use]
    pub fn largest(self) -> R {
        let Self([x, y, z]) = self;
        x.max(y).max(z)
    }

    /// The sum of the products of components.
    #[inline(always)]
    #[must_use]
    pub fn dot(self, other: Self) -> R {
        let Self([x, y, z]) = self.times(other);
        x + y + z
    }

    /// The cross product.
    #[inline(always)]
    #[must_use]
    pub fn cross(self, Self([u, v, w]): Self) -> Self {
        let Self([x, y, z]) = self;
        Self([y * w - z * v, z * u - x * w, x * v - y * u])
    }

    /// A matrix, given by its columns, times a triple.
    #[inline(always)]
    #[must_use]
    pub fn of_columns([a, b, c]: [Self; 3], Self([x, y, z]): Self) -> Self {
        a.scaled(x).plus_times(b, y).plus_times(c, z)
    }
}

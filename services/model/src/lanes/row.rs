//! A number, and a vector, of every joint.

use nalgebra::{SVector, Vector3};
use shared_types::MAX_DOF;
use std::ops::{Add, Mul, Sub};

/// Numbers that are computed with as one.
pub(crate) trait Number:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self>
{
}

impl<T: Copy + Add<Output = T> + Sub<Output = T> + Mul<Output = T>> Number for T {}

/// A number per joint in memory, zero beyond the last.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(crate) struct PerJoint(pub(crate) [f64; MAX_DOF]);

impl PerJoint {
    pub(crate) const ZERO: Self = Self([0.0; MAX_DOF]);

    #[inline(always)]
    pub(crate) fn of<const N: usize>(values: &SVector<f64, N>) -> Self {
        const { assert!(N <= MAX_DOF && MAX_DOF == 8) };
        let mut all = Self::ZERO;
        all.0[..N].copy_from_slice(values.as_slice());
        all
    }

    #[inline(always)]
    pub(crate) fn first<const N: usize>(&self) -> SVector<f64, N> {
        SVector::from_fn(|i, _| self.0[i])
    }
}

/// A number of each of `N` joints.
pub(crate) trait Row<const N: usize>: Number {
    /// Components of a vector side by side.
    type Space: Space;
    fn splat(value: f64) -> Self;
    #[inline(always)]
    fn of(values: &SVector<f64, N>) -> Self {
        Self::load(&PerJoint::of(values))
    }
    fn load(values: &PerJoint) -> Self;
    fn store(self) -> PerJoint;
    /// Of each joint the sum over the joints up to it, the nearer half first: a tree of additions, which is not the order of the joints.
    fn outwards(self) -> Self;
    /// Of each joint the sum over it and those beyond it.
    fn inwards(self) -> Self;
    /// Of each joint its parent's, and of the first zero.
    fn parents(self) -> Self;
    /// Vectors of each joint as rows of their components.
    fn rows(vectors: &[Self::Space; MAX_DOF]) -> V3<Self>;
}

/// The components x, y and z of one vector.
pub(crate) trait Space: Copy + Add<Output = Self> + Sub<Output = Self> {
    fn of(v: [f64; 3]) -> Self;
    fn get(self) -> Vector3<f64>;
    fn times(self, factor: f64) -> Self;
}

/// A vector per joint, or any other three numbers x, y and z.
#[derive(Clone, Copy, Debug)]
pub(crate) struct V3<R> {
    pub(crate) x: R,
    pub(crate) y: R,
    pub(crate) z: R,
}

impl<R: Number> Add for V3<R> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self {
            x: self.x + other.x,
            y: self.y + other.y,
            z: self.z + other.z,
        }
    }
}

impl<R: Number> Sub for V3<R> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self {
            x: self.x - other.x,
            y: self.y - other.y,
            z: self.z - other.z,
        }
    }
}

impl<R: Number> Mul<R> for V3<R> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: R) -> Self {
        Self {
            x: self.x * factor,
            y: self.y * factor,
            z: self.z * factor,
        }
    }
}

impl<R: Number> V3<R> {
    #[inline(always)]
    pub(crate) fn cross(self, other: Self) -> Self {
        Self {
            x: self.y * other.z - self.z * other.y,
            y: self.z * other.x - self.x * other.z,
            z: self.x * other.y - self.y * other.x,
        }
    }

    #[inline(always)]
    pub(crate) fn dot(self, other: Self) -> R {
        self.x * other.x + self.y * other.y + self.z * other.z
    }
}

/// Functions of a row, of each component. No closures: what is not inlined before its caller is, is compiled without the caller's registers.
macro_rules! by_components {
    ($($name:ident)+) => {$(
        #[inline(always)]
        pub(crate) fn $name<const N: usize>(self) -> Self
        where
            R: Row<N>,
        {
            V3 {
                x: self.x.$name(),
                y: self.y.$name(),
                z: self.z.$name(),
            }
        }
    )+};
}

impl<R: Copy> V3<R> {
    by_components!(outwards inwards parents);

    /// The same vector of all joints.
    #[inline(always)]
    pub(crate) fn splat<const N: usize>(v: &Vector3<f64>) -> Self
    where
        R: Row<N>,
    {
        V3 {
            x: R::splat(v.x),
            y: R::splat(v.y),
            z: R::splat(v.z),
        }
    }

    #[inline(always)]
    pub(crate) fn load<const N: usize>(vectors: &Vectors) -> Self
    where
        R: Row<N>,
    {
        V3 {
            x: R::load(&vectors.x),
            y: R::load(&vectors.y),
            z: R::load(&vectors.z),
        }
    }

    #[inline(always)]
    pub(crate) fn store<const N: usize>(self) -> Vectors
    where
        R: Row<N>,
    {
        V3 {
            x: self.x.store(),
            y: self.y.store(),
            z: self.z.store(),
        }
    }
}

/// A vector per joint in memory.
pub(crate) type Vectors = V3<PerJoint>;

impl Vectors {
    pub(crate) const ZERO: Self = Self {
        x: PerJoint::ZERO,
        y: PerJoint::ZERO,
        z: PerJoint::ZERO,
    };

    #[inline(always)]
    pub(crate) fn set(&mut self, i: usize, v: &Vector3<f64>) {
        (self.x.0[i], self.y.0[i], self.z.0[i]) = (v.x, v.y, v.z);
    }

    #[inline(always)]
    pub(crate) fn get(&self, i: usize) -> Vector3<f64> {
        Vector3::new(self.x.0[i], self.y.0[i], self.z.0[i])
    }
}

//! Numbers and indices of limbs, struts, sockets and axes: the only place that knows how many there are.
//!
//! Arrays have one length for all machines. A machine with fewer limbs or axes uses the first elements; the others have
//! no meaning. The closed form of the delta robot has three arms and six struts.

use std::ops::Range;

use arrayvec::ArrayVec;
use nalgebra::{SMatrix, SVector};

/// Most axes of a machine: four arms, or three arms and the telescope drive.
pub const AXES: usize = 4;
/// Number of arms of a delta robot.
pub const ARMS: usize = 3;
/// Number of struts of a delta robot.
pub const STRUTS: usize = 6;
/// Most limbs of a machine.
pub const MAX_LIMBS: usize = 4;
/// Most struts of a machine.
pub const MAX_STRUTS: usize = 2 * MAX_LIMBS;
/// Most ball sockets of a machine: one per strut at the elbows, then one per strut at the plate; with three limbs 0..6 and
/// 6..12.
pub const MAX_SOCKETS: usize = 2 * MAX_STRUTS;

/// Index of the axis that turns the end effector over the telescope; the fourth arm of a machine with four driven limbs.
pub const TELESCOPE_AXIS: usize = AXES - 1;

/// Whether a machine with `limbs` limbs leaves the axis of the telescope free: a fourth arm takes it.
#[inline]
pub const fn may_have_telescope(limbs: usize) -> bool {
    limbs <= TELESCOPE_AXIS
}

/// One value per axis: the arms, then the telescope drive. Values of axes that the machine does not have are unused.
pub type PerAxis<T> = [T; AXES];
/// One value per limb; values after the machine's last limb are unused.
pub type PerLimb<T> = [T; MAX_LIMBS];
/// One value per strut, two per limb; values after the machine's last strut are unused.
pub type PerStrut<T> = [T; MAX_STRUTS];
/// One value per ball socket: upper sockets, then lower ones. Values after the machine's last socket are unused.
pub type PerSocket<T> = [T; MAX_SOCKETS];
/// One value per arm of a delta robot.
pub type ThreeArms<T> = [T; ARMS];
/// One value per strut of a delta robot.
pub type SixStruts<T> = [T; STRUTS];
/// At most one value per strut.
pub type StrutList<T> = ArrayVec<T, MAX_STRUTS>;
/// Vector with one component per strut.
pub type StrutVector = SVector<f64, MAX_STRUTS>;
/// Matrix with one row and one column per strut.
pub type StrutMatrix = SMatrix<f64, MAX_STRUTS, MAX_STRUTS>;

/// The same value for each axis, limb, strut or socket; the number follows from the type.
#[inline]
pub const fn each<T: Copy, const N: usize>(value: T) -> [T; N] {
    [value; N]
}

/// Index of every axis, also of those the machine does not have.
#[inline]
pub const fn every_axis() -> Range<usize> {
    0..AXES
}

/// Index of every limb, also of those the machine does not have.
#[inline]
pub const fn every_limb() -> Range<usize> {
    0..MAX_LIMBS
}

/// Index of every strut, also of those the machine does not have.
#[inline]
pub const fn every_strut() -> Range<usize> {
    0..MAX_STRUTS
}

/// Index of each arm of a delta robot.
#[inline]
pub const fn three_arms() -> Range<usize> {
    0..ARMS
}

/// Index of each strut of a delta robot.
#[inline]
pub const fn six_struts() -> Range<usize> {
    0..STRUTS
}

/// Places of one value per axis in a vector, from `start` on.
#[inline]
pub const fn axes_from(start: usize) -> Range<usize> {
    start..start + AXES
}

/// Places of one value per limb in a vector, from `start` on.
#[inline]
pub const fn limbs_from(start: usize) -> Range<usize> {
    start..start + MAX_LIMBS
}

/// Places of one value per strut in a vector, from `start` on.
#[inline]
pub const fn struts_from(start: usize) -> Range<usize> {
    start..start + MAX_STRUTS
}

/// Places of one value per ball socket in a vector, from `start` on.
#[inline]
pub const fn sockets_from(start: usize) -> Range<usize> {
    start..start + MAX_SOCKETS
}

/// Place of an axis's rate in a state that holds one coordinate per axis, then one rate per axis.
#[inline]
pub const fn rate_place(axis: usize) -> usize {
    AXES + axis
}

/// Index of the lower socket of strut `s` of a delta robot; its upper socket has the index `s`.
#[inline]
pub const fn lower_socket(s: usize) -> usize {
    STRUTS + s
}

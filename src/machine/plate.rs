//! The plate: the bodies that the limbs carry together, and how they move with each other.
//!
//! Every part of a plate translates with the plate's origin p and depends on the plate's own coordinate ψ alone: the origin of
//! part k is p + f + R(ψ)·t + ψ·s, and it turns by ψ about the vertical or not at all. The end effector is the part that turns.

use arrayvec::ArrayVec;
use nalgebra::{Matrix3, Vector3};

use super::bodies::{END_EFFECTOR, LINK, PLATFORM, SECOND_PLATFORM};

/// Kinds of plate.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Plate {
    /// One body, which only translates.
    #[default]
    Rigid,
    /// Articulated parallelogram of two main bars, which carry the limbs, and two connecting bars [Nabat 2005]. The end
    /// effector is part of the first connecting bar; ψ is the rotation of the connecting bars.
    Par4 {
        /// Vector m between the joints of a main bar, m: from the second connecting bar to the first, horizontal.
        main: Vector3<f64>,
        /// Vector n between the joints of a connecting bar at ψ = 0, m: from the second main bar to the first, horizontal.
        connecting: Vector3<f64>,
    },
    /// Two lateral bars, which carry the limbs, hinged to a central bar, the end effector [Pierrot 1999]; ψ is the rotation
    /// of the central bar.
    H4 {
        /// Hinges of the first and the second lateral bar in the frame of the central bar, m, horizontal. The origin of a
        /// lateral bar is its hinge.
        hinges: [Vector3<f64>; 2],
    },
    /// Two half-plates, which slide along each other and turn a spindle, the end effector, by rack and pinion
    /// [Krut 2003]; the origin is on the spindle, ψ = s/r with s the displacement of the second half.
    I4 {
        /// Azimuth of the slide, rad.
        azimuth: f64,
        /// Radius r of the pinion, m.
        radius: f64,
    },
}

/// How the frame of one part moves with the plate's coordinate ψ.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlatePart {
    /// Part f of its origin that does not depend on ψ, m.
    pub fixed: Vector3<f64>,
    /// Part t of its origin that turns with ψ, m.
    pub turning: Vector3<f64>,
    /// Part s of its origin that grows with ψ, m/rad.
    pub sliding: Vector3<f64>,
    /// Whether it turns by ψ.
    pub turns: bool,
}

/// Place of a part relative to the plate's origin, and its derivatives with respect to ψ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartPlace {
    /// Axes of the part.
    pub rotation: Matrix3<f64>,
    /// Origin, m.
    pub origin: Vector3<f64>,
    /// First derivative of the origin, m/rad.
    pub slope: Vector3<f64>,
    /// Second derivative of the origin, m/rad².
    pub curvature: Vector3<f64>,
    /// Angular velocity per rate of ψ: 1 or 0, about z.
    pub turning: f64,
}

impl PlatePart {
    /// The part at ψ (rad).
    pub fn at(&self, psi: f64) -> PartPlace {
        let (s, c) = psi.sin_cos();
        let turned = Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0);
        let arm = turned * self.turning;
        let horizontal = Vector3::new(arm.x, arm.y, 0.0);
        PartPlace {
            rotation: if self.turns { turned } else { Matrix3::identity() },
            origin: self.fixed + arm + self.sliding * psi,
            slope: Vector3::z().cross(&arm) + self.sliding,
            curvature: -horizontal,
            turning: f64::from(u8::from(self.turns)),
        }
    }
}

/// A pivot between two parts of a plate, see [`Plate::bodies`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pivot {
    /// The parts.
    pub parts: [usize; 2],
    /// Its place in the frame of each, m; of the end effector as if the flange were in the plane of the plate.
    pub points: [Vector3<f64>; 2],
}

/// Most parts of a plate.
pub const MAX_PARTS: usize = 4;

impl Plate {
    /// Bodies of its parts; limbs are carried by the first, or by the first two.
    pub fn bodies(&self) -> &'static [usize] {
        match self {
            Self::Rigid => &[PLATFORM],
            Self::Par4 { .. } => &[PLATFORM, SECOND_PLATFORM, END_EFFECTOR, LINK],
            Self::H4 { .. } | Self::I4 { .. } => &[PLATFORM, SECOND_PLATFORM, END_EFFECTOR],
        }
    }

    /// Number of parts that can carry limbs.
    pub fn carriers(&self) -> usize {
        if self.turns() { 2 } else { 1 }
    }

    /// Whether it has a coordinate ψ of its own, by which the end effector turns.
    pub fn turns(&self) -> bool {
        *self != Self::Rigid
    }

    /// Motion of part `k`, in the order of [`Self::bodies`].
    pub fn part(&self, k: usize) -> PlatePart {
        let still = PlatePart::default();
        let turning = PlatePart { turns: true, ..still };
        match (*self, k) {
            (Self::Rigid, _) => still,
            (Self::Par4 { connecting, .. }, 0) => PlatePart { turning: connecting / 2.0, ..still },
            (Self::Par4 { connecting, .. }, 1) => PlatePart { turning: connecting / -2.0, ..still },
            (Self::Par4 { main, .. }, 2) => PlatePart { fixed: main / 2.0, ..turning },
            (Self::Par4 { main, .. }, _) => PlatePart { fixed: main / -2.0, ..turning },
            (Self::H4 { hinges }, 0 | 1) => PlatePart { turning: hinges[k], ..still },
            (Self::I4 { azimuth, radius }, 1) => {
                PlatePart { sliding: Vector3::new(azimuth.cos(), azimuth.sin(), 0.0) * radius, ..still }
            }
            (Self::I4 { .. }, 0) => still,
            (Self::H4 { .. } | Self::I4 { .. }, _) => turning,
        }
    }

    /// Pivots about the vertical between its parts.
    pub fn pivots(&self) -> Vec<Pivot> {
        let pivot = |parts, points| Pivot { parts, points };
        match *self {
            Self::Rigid => Vec::new(),
            Self::Par4 { main, connecting } => {
                let (m, n) = (main / 2.0, connecting / 2.0);
                vec![pivot([2, 0], [n, m]), pivot([3, 0], [n, -m]), pivot([1, 2], [m, -n]), pivot([1, 3], [-m, -n])]
            }
            Self::H4 { hinges } => (0..2).map(|k| pivot([2, k], [hinges[k], Vector3::zeros()])).collect(),
            Self::I4 { .. } => vec![pivot([2, 0], [Vector3::zeros(); 2])],
        }
    }

    /// Places of its pivots on part `k`, in the part's frame, m; of the end effector as if the flange were in the plane of the
    /// plate.
    pub fn pivots_on(&self, k: usize) -> Vec<Vector3<f64>> {
        let pivots = self.pivots().into_iter();
        let own = pivots.filter_map(|pivot| Some(pivot.points[pivot.parts.iter().position(|part| *part == k)?]));
        own.collect()
    }

    /// Virtual motions of the plate at ψ in addition to the six of a rigid body: per motion the velocity of each part's
    /// origin (m per unit) and its angular velocity about z (rad per unit), in the order of [`Self::bodies`].
    ///
    /// The bars of Par4 and the halves of I4 stay parallel, so that they have one, ψ. Each lateral bar of H4 turns on its own.
    pub fn freedoms(&self, psi: f64) -> ArrayVec<[(Vector3<f64>, f64); MAX_PARTS], 2> {
        let mut one = [(Vector3::zeros(), 0.0); MAX_PARTS];
        match self {
            Self::Rigid => ArrayVec::new(),
            Self::Par4 { .. } | Self::I4 { .. } => {
                for (k, motion) in one.iter_mut().enumerate().take(self.bodies().len()) {
                    let place = self.part(k).at(psi);
                    *motion = (place.slope, place.turning);
                }
                std::iter::once(one).collect()
            }
            Self::H4 { .. } => {
                let bar = |k: usize| {
                    let mut motion = one;
                    motion[k].1 = 1.0;
                    motion
                };
                ArrayVec::from([bar(0), bar(1)])
            }
        }
    }
}

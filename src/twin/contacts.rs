//! Interface between the twin and a contact solver: robot against surroundings and, once it has broken, against itself.
//!
//! Without a solver the twin runs without contacts. The solver holds the free objects and their motion; the twin passes
//! the robot's motion and receives the wrenches on the robot's bodies. A step consists of
//!
//! 1. [`Contacts::near`]: whether a contact is possible within the step; if so, it is shortened to
//!    [`Contacts::longest_step`];
//! 2. [`Contacts::wrenches`] at the extrapolated poses; over the step the wrenches change linearly to these values;
//! 3. the twin's own step;
//! 4. [`Contacts::advance`] by the same time for the free objects, under the opposite wrenches.
//!
//! A broken robot that meets only what does not move, or itself, takes the wrenches at every stage of its step instead,
//! and their [`Resistance`] implicitly. The step is then bounded by its estimated error, not by the stiffness of the
//! contacts: a part that lies still is followed with few steps.

use nalgebra::{Isometry3, Matrix6, Vector3};

use super::wrench::Twist;
use crate::cell::{CellError, Object};
use crate::kinematics::{Motion, SocketSet};
use crate::machine::bodies::SLOTS;
use crate::machine::{Bodies, Geometry, Inertia};
use crate::scenario::PayloadShape;

/// Contact solver, with the free objects that it moves.
///
/// Results must depend on the arguments alone, so that a run is reproducible bit by bit. Methods called in a step
/// return references to buffers of the solver, without allocation.
pub trait Contacts {
    /// Whether a contact is possible within `horizon` s at the present velocities, with the sockets in `closed`. If so,
    /// steps must not exceed [`Self::longest_step`].
    fn near(&mut self, motion: &Motion, closed: SocketSet, horizon: f64) -> bool;

    /// Longest step that resolves the oscillation of the lightest body on its contacts, s.
    fn longest_step(&self) -> f64;

    /// Contact wrenches on the robot's bodies, force (N) and moment about the body's origin (N·m), inertial axes, for
    /// the poses and twists of `motion` with the sockets in `closed`.
    ///
    /// The opposite loads act on the objects in the next [`Self::advance`]. Momentum is conserved if the twin changes
    /// the wrenches linearly from those of the previous call to these over that step.
    fn wrenches(&mut self, motion: &Motion, closed: SocketSet) -> &[Twist; SLOTS];

    /// Resistance of the contacts on each of the robot's bodies at the last [`Self::wrenches`], for the same `motion`;
    /// a coupling between two bodies is left out. `None` if an object that moves was near at the last [`Self::near`], or
    /// if the solver does not know it.
    fn resistances(&mut self, _motion: &Motion) -> Option<&[Resistance; SLOTS]> {
        None
    }

    /// Contacts at the last [`Self::wrenches`]: each pair once, in the order of the links.
    fn touches(&self) -> &[Touch];

    /// Name of a body, for events.
    fn name(&self, body: ContactBody) -> String;

    /// Advances the free objects by `h` s under gravity, their own contacts and the opposite of the robot's contact
    /// wrenches.
    ///
    /// The latter change linearly from those of the previous call of [`Self::wrenches`] to those of the last one; the
    /// step ends at the fraction `share` (0 to 1) of this change. Without a new call of [`Self::wrenches`] the robot
    /// has no contact.
    fn advance(&mut self, h: f64, share: f64);

    /// Attaches a free object to the gripper at its present pose relative to the end effector.
    ///
    /// # Errors
    /// [`CellError::Unknown`], [`CellError::NotFree`] or [`CellError::Occupied`].
    fn pick(&mut self, name: &str, motion: &Motion) -> Result<Held, CellError>;

    /// Releases the held object with the pose and twist it has on the end effector; returns its name.
    ///
    /// # Errors
    /// [`CellError::Empty`] if the gripper holds nothing.
    fn release(&mut self, motion: &Motion) -> Result<String, CellError>;

    /// Poses of the objects in the order of [`Surroundings::objects`]; a held one moves with the end effector of
    /// `motion`.
    fn poses(&self, motion: &Motion) -> Vec<Isometry3<f64>>;

    /// Kinetic energy of the free objects, J.
    fn kinetic_energy(&self) -> f64;

    /// The work done so far; zero where it is not counted.
    fn work(&self) -> ContactWork {
        ContactWork::default()
    }
}

/// Work of what solves contacts, in counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ContactWork {
    /// Searches for pairs that are near each other.
    pub searches: usize,
    /// Pairs whose contact points were computed.
    pub queries: usize,
    /// Steps of the free objects.
    pub steps: usize,
}

/// Constructor of a contact solver for a run.
///
/// # Errors
/// A [`CellError`] if an object is not valid or overlaps with the robot at the start.
pub type NewContacts = fn(&Surroundings<'_>) -> Result<Box<dyn Contacts>, CellError>;

/// Bodies and geometry at the start of a run.
pub struct Surroundings<'a> {
    /// Objects around the robot, with unique names.
    pub objects: &'a [Object],
    /// Rigid shape on the flange, if any.
    pub payload: Option<&'a PayloadShape>,
    /// Geometry of the robot.
    pub geometry: &'a Geometry,
    /// Gravitational acceleration in the inertial frame, m/s².
    pub gravity: Vector3<f64>,
    /// Inertia of the robot's bodies, with the payload.
    pub bodies: &'a Bodies,
    /// Motion of the robot at the start.
    pub start: &'a Motion,
}

/// A body that can be in contact.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ContactBody {
    /// Link of the robot, by its body index.
    Link(usize),
    /// Object, an index into [`Surroundings::objects`]; higher ones are the solver's own.
    Object(usize),
}

/// A symmetric 6×6 matrix of one body, for displacements or velocities of its origin, then for rotations or angular
/// velocities; inertial axes.
pub type Block = [[f64; 6]; 6];

/// Resistance of the contacts of one body to small motions about the present one.
///
/// Both matrices are positive semi-definite: a small displacement of the body changes the wrench on it by −stiffness
/// times the displacement (N/m, N, N·m), a small velocity by −damping times the velocity (N·s/m, N·s, N·m·s).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resistance {
    /// Resistance to displacements.
    pub stiffness: Block,
    /// Resistance to velocities.
    pub damping: Block,
}

impl Resistance {
    /// No contact.
    pub const NONE: Self = Self { stiffness: [[0.0; 6]; 6], damping: [[0.0; 6]; 6] };

    /// The resistance about another point of the same body, `lever` (m, inertial axes) from there to the present one:
    /// Tᵀ K T with T = [1, −lever×; 0, 1].
    #[must_use]
    pub fn seen_from(&self, lever: &Vector3<f64>) -> Self {
        let mut shift = Matrix6::identity();
        shift.fixed_view_mut::<3, 3>(0, 3).copy_from(&-lever.cross_matrix());
        let moved = |block: &Block| {
            let about = shift.transpose() * Matrix6::from_fn(|i, k| block[i][k]) * shift;
            std::array::from_fn(|i| std::array::from_fn(|k| about[(i, k)]))
        };
        Self { stiffness: moved(&self.stiffness), damping: moved(&self.damping) }
    }

    /// Adds the resistance of other contacts of the same body about the same point.
    pub fn add(&mut self, other: &Self) {
        for (own, others) in [(&mut self.stiffness, &other.stiffness), (&mut self.damping, &other.damping)] {
            own.iter_mut().flatten().zip(others.iter().flatten()).for_each(|(x, y)| *x += y);
        }
    }
}

/// Two bodies in contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// Link or held object.
    pub link: ContactBody,
    /// Object or other link.
    pub other: ContactBody,
    /// Sum of the normal forces of all contact points, N.
    pub force: f64,
    /// Centre of these points, weighted by their forces, in the inertial frame, m.
    pub at: Vector3<f64>,
    /// Sum of the normal forces on the link as vectors, in the inertial frame, N: its direction is the contact's normal.
    pub normal: Vector3<f64>,
    /// Force on the link, with friction, in the inertial frame, N.
    pub push: Vector3<f64>,
}

impl Touch {
    /// Adds the forces of other contact points of the same pair.
    pub fn add(&mut self, other: &Self) {
        let force = self.force + other.force;
        if force > 0.0 {
            self.at += (other.at - self.at) * (other.force / force);
        }
        self.force = force;
        self.normal += other.normal;
        self.push += other.push;
    }

    /// Enters the contact into `strongest`, which has every pair once, if its pair has no stronger one there.
    pub(super) fn keep_in(&self, strongest: &mut Vec<Self>) {
        match strongest.iter_mut().find(|known| (known.link, known.other) == (self.link, self.other)) {
            Some(known) if known.force >= self.force => {}
            Some(known) => *known = *self,
            None => strongest.push(*self),
        }
    }
}

/// An object at the time it is picked up.
#[derive(Clone, Debug, PartialEq)]
pub struct Held {
    /// Inertia about the origin and in the axes of the end effector's frame.
    pub inertia: Inertia,
    /// Centre of mass in the inertial frame, m.
    pub position: Vector3<f64>,
    /// Velocity of the centre of mass (m/s) and angular velocity (rad/s), inertial axes.
    ///
    /// The end effector may move differently; the twin then conserves momentum.
    pub twist: Twist,
}

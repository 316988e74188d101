//! What the twin asks of whatever solves contacts: the robot with its surroundings, and with itself once it has fallen apart.
//!
//! The twin is complete without: then nothing touches. What solves contacts keeps the free objects and their motion; the
//! twin tells it where the robot is and takes the wrenches on the robot's bodies. A step goes
//!
//! 1. [`Contacts::near`]: whether anything can touch within it; if so it is cut to [`Contacts::longest_step`];
//! 2. [`Contacts::wrenches`] at the poses ahead, towards which the wrenches go linearly over the step;
//! 3. the twin's own step;
//! 4. [`Contacts::advance`] by as much for the free objects, which bear the opposite.

use nalgebra::{Isometry3, Vector3};

use super::wrench::Twist;
use crate::cell::{CellError, Object};
use crate::kinematics::{Motion, SocketSet};
use crate::machine::bodies::BODIES;
use crate::machine::{Geometry, Inertia};
use crate::scenario::PayloadShape;

/// What solves contacts, and the free objects that it moves.
///
/// Results depend on nothing but what is given here, so that a run is the same bit by bit. No method called in a step
/// hands over memory: wrenches and touches are read where they are kept.
pub trait Contacts {
    /// Whether anything could touch within `horizon` s at the present speeds while the sockets in `closed` hold, so that
    /// steps must not be longer than [`Self::longest_step`].
    fn near(&mut self, motion: &Motion, closed: SocketSet, horizon: f64) -> bool;

    /// Longest step that resolves the oscillation of the lightest body on its contacts, s.
    fn longest_step(&self) -> f64;

    /// Contact wrenches on the robot's bodies, force (N) and moment about the body's origin (N·m), world axes, for the poses
    /// and twists of `motion`, while the sockets in `closed` hold.
    ///
    /// The opposite loads act on the objects in the next [`Self::advance`]: momentum is conserved if the twin's wrenches go
    /// linearly from those of the call before to these over that step.
    fn wrenches(&mut self, motion: &Motion, closed: SocketSet) -> &[Twist; BODIES];

    /// What touched at the last [`Self::wrenches`]: each pair once, links in order.
    fn touches(&self) -> &[Touch];

    /// Name of a body, for events.
    fn name(&self, body: ContactBody) -> String;

    /// Moves the free objects on by `h` s under gravity, their own contacts and the opposite of the robot's contact
    /// wrenches, which went linearly from those of the [`Self::wrenches`] before to the last one's and got as far as
    /// `share` (0 to 1) of that way. Without a new call of [`Self::wrenches`] the robot touches nothing.
    fn advance(&mut self, h: f64, share: f64);

    /// Takes a free object into the gripper, where it keeps its pose relative to the end effector.
    ///
    /// # Errors
    /// If there is no such object, it is not free, or the gripper holds one.
    fn pick(&mut self, name: &str, motion: &Motion) -> Result<Held, CellError>;

    /// Lets go of the held object with the pose and twist it has on the end effector; returns its name.
    ///
    /// # Errors
    /// If the gripper holds nothing.
    fn release(&mut self, motion: &Motion) -> Result<String, CellError>;

    /// Poses of the objects in the order of [`Surroundings::objects`]; a held one moves with the end effector of `motion`.
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

/// Makes what solves contacts for a run.
///
/// # Errors
/// If objects cannot be, or the robot stands in one of them at the start.
pub type NewContacts = fn(&Surroundings<'_>) -> Result<Box<dyn Contacts>, CellError>;

/// What there is to touch at the start of a run.
pub struct Surroundings<'a> {
    /// Things around the robot, each with its own name.
    pub objects: &'a [Object],
    /// Rigid shape on the flange.
    pub payload: Option<&'a PayloadShape>,
    /// Lengths of the robot.
    pub geometry: &'a Geometry,
    /// m/s², inertial frame.
    pub gravity: Vector3<f64>,
    /// Where the robot is.
    pub start: &'a Motion,
}

/// A body that can touch others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ContactBody {
    /// Link of the robot, an index of its bodies.
    Link(usize),
    /// Object, an index into [`Surroundings::objects`]; those beyond are the solver's own.
    Object(usize),
}

/// Two bodies that touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// Link, or held object.
    pub link: ContactBody,
    /// Object or other link.
    pub other: ContactBody,
    /// Sum of the normal forces of all contact points, N.
    pub force: f64,
}

/// An object at the moment it is picked up.
#[derive(Clone, Debug, PartialEq)]
pub struct Held {
    /// Its inertia about the origin and along the axes of the end effector's frame.
    pub inertia: Inertia,
    /// Its centre of mass, m, inertial frame.
    pub position: Vector3<f64>,
    /// Its velocity there, m/s, and its angular velocity, rad/s, world axes; the end effector's own may differ, and the twin
    /// shares out the momentum.
    pub twist: Twist,
}

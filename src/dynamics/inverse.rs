//! Inverse dynamics and its regressor at one instant.

use nalgebra::{DMatrix, SVector, Vector3};

use super::channels::ChannelMap;
use super::reduction::Reduction;
use super::{Plant, inertial_wrench};
use crate::effects::{ActiveEffect, Instant, Wrenches};
use crate::kinematics::{KinematicsError, Motion, Reactions, STILL, Twist};
use crate::machine::bodies::{SLOTS, strut};
use crate::machine::{PerAxis, PerSocket, each, every_axis, struts_from};
use crate::numerics::{Anderson, worst};
use crate::recording::Channel;

/// Drive torques and strut forces at one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Output {
    /// Torques at the gear outputs, N·m.
    pub tau: PerAxis<f64>,
    /// Axial strut forces, N; zero if they were not requested.
    pub reactions: Reactions,
}

impl Output {
    /// Without loads.
    pub const ZERO: Self = Self { tau: each(0.0), reactions: Reactions::ZERO };

    /// The value of a drive torque or strut force, N·m or N; zero of other channels.
    pub fn of(&self, channel: Channel) -> f64 {
        match channel {
            Channel::Torque(axis) => self.tau[axis],
            Channel::StrutUpper(s) => self.reactions.upper[s],
            Channel::StrutLower(s) => self.reactions.lower[s],
            _ => 0.0,
        }
    }

    /// Adds to a drive torque or strut force, N·m or N.
    pub(crate) fn add(&mut self, channel: Channel, by: f64) {
        match channel {
            Channel::Torque(axis) => self.tau[axis] += by,
            Channel::StrutUpper(s) => self.reactions.upper[s] += by,
            Channel::StrutLower(s) => self.reactions.lower[s] += by,
            _ => {}
        }
    }

    /// Times a factor.
    pub(crate) fn scaled(&self, factor: f64) -> Self {
        Self::from_vector(&(self.vector() * factor))
    }

    /// Largest absolute difference of a torque or force from `other`, N·m or N; NaN if one is.
    pub(crate) fn change(&self, other: &Self) -> f64 {
        self.vector().iter().zip(&other.vector()).map(|(a, b)| a - b).fold(0.0, worst)
    }

    fn vector(&self) -> SVector<f64, LOADS> {
        let Self { tau, reactions: Reactions { upper, lower } } = self;
        SVector::from_iterator(tau.iter().chain(upper).chain(lower).copied())
    }

    fn from_vector(values: &SVector<f64, LOADS>) -> Self {
        let of = |first: usize| std::array::from_fn(|k| values[first + k]);
        Self { tau: std::array::from_fn(|k| values[k]), reactions: Reactions { upper: of(UPPER), lower: of(LOWER) } }
    }
}

/// Number of torques and forces on which laws may depend, and places of the forces.
const LOADS: usize = struts_from(LOWER).end;
const UPPER: usize = every_axis().end;
const LOWER: usize = struts_from(UPPER).end;

/// Loads of drives and struts in equilibrium with the wrenches on all bodies.
pub(crate) trait Borne {
    /// Drive torques and strut forces, on which force laws may depend.
    fn output(&self) -> Output;
}

impl Borne for Output {
    fn output(&self) -> Output {
        *self
    }
}

/// Drive torques for a motion, with the strut forces if `with_struts` or if an effect depends on them.
///
/// `states` holds the internal states of each active effect (an empty slice for an effect without states). Effects that
/// depend on torques or strut forces are solved by fixed-point iteration.
///
/// # Errors
/// [`KinematicsError::Singular`] if the pose is singular; [`KinematicsError::Law`] if the value of a force law is not
/// finite.
pub fn inverse_dynamics(
    plant: &Plant,
    t: f64,
    motion: &Motion,
    states: &[&[f64]],
    with_struts: bool,
) -> Result<Output, KinematicsError> {
    LoadCourse::default().inverse_dynamics(plant, t, motion, states, with_struts)
}

/// Loads along a motion, those of a sample near the ones before it.
#[derive(Default)]
pub(crate) struct LoadCourse {
    /// What the laws that depend on loads add to the loads, at the last sample and the one before.
    last: [Option<SVector<f64, LOADS>>; 2],
}

impl LoadCourse {
    /// [`inverse_dynamics`] one sample after the last.
    pub(crate) fn inverse_dynamics(
        &mut self,
        plant: &Plant,
        t: f64,
        motion: &Motion,
        states: &[&[f64]],
        with_struts: bool,
    ) -> Result<Output, KinematicsError> {
        let with_struts = with_struts || plant.effects.iter().any(|a| a.effect.spec().reads.reactions);
        let reduction = Reduction::new(&plant.geometry, motion, plant.assembled, with_struts)?;
        let rigid = loaded_wrenches(plant, t, motion);
        self.borne(plant, (t, motion), states, rigid, |wrenches| reduction.balance(wrenches))
    }

    /// What the laws are expected to add, from its last two values.
    fn expected(&self) -> SVector<f64, LOADS> {
        match self.last {
            [Some(last), Some(before)] => 2.0 * last - before,
            [Some(last), None] => last,
            _ => SVector::zeros(),
        }
    }

    /// As [`borne`].
    fn borne<T: Borne>(
        &mut self,
        plant: &Plant,
        (t, motion): (f64, &Motion),
        states: &[&[f64]],
        rigid: [Twist; SLOTS],
        solve: impl Fn(&[Twist; SLOTS]) -> T,
    ) -> Result<T, KinematicsError> {
        let mut fixed = rigid;
        add_effects(plant, t, motion, states, None, &mut fixed)?;
        let mut loads = solve(&fixed);
        if plant.effects.iter().any(reads_loads) {
            let mut iteration = Anderson::default();
            let alone = loads.output().vector();
            let mut at = Output::from_vector(&(alone + self.expected()));
            for _ in 0..MAX_REACTION_ITERATIONS {
                let mut next = fixed;
                add_effects(plant, t, motion, states, Some(&at), &mut next)?;
                loads = solve(&next);
                let there = loads.output();
                if at.change(&there) < CONVERGED {
                    break;
                }
                at = Output::from_vector(&iteration.next(&at.vector(), &there.vector()));
            }
            self.last = [Some(loads.output().vector() - alone), self.last[0]];
        }
        Ok(loads)
    }
}

/// [`inverse_dynamics`] at an instant without a past: the internal states are in equilibrium with the motion.
///
/// # Errors
/// As [`inverse_dynamics`].
pub fn steady_inverse_dynamics(
    plant: &Plant,
    t: f64,
    motion: &Motion,
    with_struts: bool,
) -> Result<Output, KinematicsError> {
    let own = plant.steady_states(t, motion);
    let states: Vec<&[f64]> = own.iter().map(Vec::as_slice).collect();
    inverse_dynamics(plant, t, motion, &states, with_struts)
}

/// Drive torques, strut forces and ball forces at one instant.
#[derive(Clone, Copy, Debug)]
pub struct SocketLoads {
    /// Drive torques and axial strut forces.
    pub output: Output,
    /// Force of the ball on the strut's cup without the clamps' own, N, inertial axes: six at the elbows, six at the
    /// platform.
    pub sockets: PerSocket<Vector3<f64>>,
}

impl Borne for SocketLoads {
    fn output(&self) -> Output {
        self.output
    }
}

/// Loads of the ball sockets of an assembled robot along a known motion, as [`steady_inverse_dynamics`].
///
/// # Errors
/// As [`inverse_dynamics`].
pub fn steady_socket_loads(plant: &Plant, t: f64, motion: &Motion) -> Result<SocketLoads, KinematicsError> {
    let own = plant.steady_states(t, motion);
    let states: Vec<&[f64]> = own.iter().map(Vec::as_slice).collect();
    let reduction = Reduction::new(&plant.geometry, motion, plant.assembled, true)?;
    let loads = |wrenches: &[Twist; SLOTS]| {
        let output = reduction.balance(wrenches);
        SocketLoads { output, sockets: ball_forces(motion, wrenches, &output.reactions) }
    };
    borne(plant, t, motion, &states, loaded_wrenches(plant, t, motion), loads)
}

/// Forces of the balls on the struts (N, inertial axes) for the wrench (f, m) on each strut about its upper ball,
/// applied minus inertial, and its axial forces T.
///
/// Newton and Euler for a strut of length ℓ along u: F_upper + F_lower + f = 0 and m + ℓ·u × F_lower = 0, thus across the
/// strut F_lower = u × m/ℓ; along it F_upper·u = −T_upper and F_lower·u = T_lower. The moment about u is the spin's.
pub(crate) fn ball_forces(motion: &Motion, wrenches: &[Twist; SLOTS], axial: &Reactions) -> PerSocket<Vector3<f64>> {
    let mut out: PerSocket<Vector3<f64>> = each(Vector3::zeros());
    for s in 0..motion.struts() {
        let ((force, moment), u) = (&wrenches[strut(s)], motion.strut_axis[s]);
        let across = u.cross(moment) / motion.strut_length[s];
        out[s] = -(force - u * force.dot(&u)) - across - u * axial.upper[s];
        out[motion.struts() + s] = across + u * axial.lower[s];
    }
    out
}

/// Loads that `solve` returns for the sum of the `rigid` wrenches and those of all effects.
///
/// If effects depend on the loads, they are computed by accelerated fixed-point iteration.
///
/// # Errors
/// [`KinematicsError::Law`] if the value of a force law is not finite.
pub(crate) fn borne<T: Borne>(
    plant: &Plant,
    t: f64,
    motion: &Motion,
    states: &[&[f64]],
    rigid: [Twist; SLOTS],
    solve: impl Fn(&[Twist; SLOTS]) -> T,
) -> Result<T, KinematicsError> {
    LoadCourse::default().borne(plant, (t, motion), states, rigid, solve)
}

/// Drive torques and strut forces in balance with wrenches on all bodies, applied minus inertial.
///
/// # Errors
/// [`KinematicsError::Singular`] if the pose is singular.
pub(crate) fn balance(plant: &Plant, motion: &Motion, wrenches: &[Twist; SLOTS]) -> Result<Output, KinematicsError> {
    Ok(Reduction::new(&plant.geometry, motion, plant.assembled, true)?.balance(wrenches))
}

/// [`rigid_wrenches`] with the known loads.
pub(crate) fn loaded_wrenches(plant: &Plant, t: f64, motion: &Motion) -> [Twist; SLOTS] {
    let mut wrenches = rigid_wrenches(plant, motion);
    plant.add_loads(t, motion, &mut wrenches);
    wrenches
}

/// Weight minus inertial wrench of every body about its origin, inertial axes.
pub(crate) fn rigid_wrenches(plant: &Plant, motion: &Motion) -> [Twist; SLOTS] {
    let gravity = plant.gravity_vector();
    let mut wrenches = [STILL; SLOTS];
    for (body, wrench) in wrenches.iter_mut().enumerate().take(motion.slots()) {
        let (force, moment) = inertial_wrench(&plant.bodies[body], &motion.bodies[body], &gravity);
        *wrench = (-force, -moment);
    }
    wrenches
}

/// Whether the law depends on torques or strut forces along a given motion.
pub(crate) fn reads_loads(active: &ActiveEffect) -> bool {
    active.effect.spec().reads.reactions || active.effect.spec().reads.torque
}

/// Adds the wrenches of the plant's effects to `sum`: without `loads` those of effects that do not depend on loads,
/// with `loads` those of effects that do.
///
/// # Errors
/// [`KinematicsError::Law`] if the value of a law is not finite.
pub(crate) fn add_effects(
    plant: &Plant,
    t: f64,
    motion: &Motion,
    states: &[&[f64]],
    loads: Option<&Output>,
    sum: &mut [Twist; SLOTS],
) -> Result<(), KinematicsError> {
    let none = Output::default();
    for (active, state) in plant.effects.iter().zip(states).filter(|(a, _)| reads_loads(a) == loads.is_some()) {
        let at = instant(plant, active, t, motion, loads.unwrap_or(&none), state);
        let mut out = Wrenches::sum(&active.values, motion, sum);
        active.effect.wrenches_along(&active.values(), &at, &mut out);
        if !out.power().is_finite()
            && let Some(fault) = active.fault(&at, true)
        {
            return Err(fault);
        }
    }
    Ok(())
}

/// The quantities that a force law depends on, along a given motion.
fn instant<'a>(
    plant: &'a Plant,
    active: &ActiveEffect,
    t: f64,
    motion: &'a Motion,
    loads: &'a Output,
    state: &'a [f64],
) -> Instant<'a> {
    Instant {
        reactions: &loads.reactions,
        torque: if active.effect.spec().reads.torque { loads.tau } else { [0.0; 4] },
        ..plant.instant(t, motion, state)
    }
}

/// Error of the loads by fixed-point iteration, N·m or N.
const CONVERGED: f64 = 1e-9;

/// Iterations after which a contraction factor of 1/3 reaches rounding accuracy.
pub(crate) const MAX_REACTION_ITERATIONS: usize = 30;

/// A given motion with its loads at one time.
#[derive(Clone, Copy)]
pub struct Sample<'a> {
    /// Time, s.
    pub t: f64,
    /// Motion of all bodies, with accelerations.
    pub motion: &'a Motion,
    /// Torques and strut forces of the whole plant, for laws that depend on them.
    pub loads: &'a Output,
}

/// Regressor at one motion: one row per channel, one column per parameter of `effects`.
///
/// Columns of nonlinear parameters are zero; `states` is as in [`inverse_dynamics`], one slice per element of
/// `effects`.
///
/// # Errors
/// [`KinematicsError::Law`] if the value of a law is not finite; [`KinematicsError::Singular`] if a channel is not
/// determined at the pose.
pub fn regressor(
    plant: &Plant,
    effects: &[&ActiveEffect],
    at: &Sample,
    states: &[&[f64]],
    channels: &[Channel],
) -> Result<DMatrix<f64>, KinematicsError> {
    let map = ChannelMap::new(&plant.geometry, at.motion, plant.assembled, channels)?;
    let columns = effects.iter().map(|a| a.values.len()).sum();
    let mut rows = DMatrix::zeros(channels.len(), columns);
    let mut rest = rows.as_mut_slice();
    for (active, state) in effects.iter().zip(states) {
        let (own, others) = rest.split_at_mut(active.values.len() * channels.len());
        add_regressor(plant, active, at, state, &map, own)?;
        rest = others;
    }
    Ok(rows)
}

/// Adds the columns of one effect to `rows`, stored column by column.
///
/// # Errors
/// [`KinematicsError::Law`] if the value of the law is not finite.
pub(crate) fn add_regressor(
    plant: &Plant,
    active: &ActiveEffect,
    at: &Sample,
    state: &[f64],
    map: &ChannelMap,
    rows: &mut [f64],
) -> Result<(), KinematicsError> {
    let Sample { t, motion, loads } = *at;
    let channels = map.channels.len();
    let mut add = |k: usize, body: usize, force: &Vector3<f64>, moment: &Vector3<f64>, sign: f64| {
        for (c, row) in rows[k * channels..(k + 1) * channels].iter_mut().enumerate() {
            *row += sign * map.project(c, body, force, moment);
        }
    };
    let values = active.values();
    let gravity = plant.gravity_vector();
    active.effect.inertia(&values, &plant.payload, &mut |k, body, unit| {
        let (body, unit) = plant.carrier(body, unit);
        let (force, moment) = inertial_wrench(&unit, &motion.bodies[body], &gravity);
        add(k, body, &force, &moment, -1.0);
    });
    let at = instant(plant, active, t, motion, loads, state);
    active.effect.wrenches_along(
        &values,
        &at,
        &mut Wrenches::new(motion, &mut |k, body, force, moment| add(k, body, &force, &moment, 1.0)),
    );
    if rows.iter().all(|x| x.is_finite()) {
        return Ok(());
    }
    // Terms with a coefficient of zero are checked as well.
    let unit = ActiveEffect { values: vec![1.0; active.values.len()], ..active.clone() };
    active.fault(&at, true).or_else(|| unit.fault(&at, true)).map_or(Ok(()), Err)
}

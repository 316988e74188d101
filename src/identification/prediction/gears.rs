//! Joint motion behind elastic gears.
//!
//! The encoder angle θ drives the arm through spring and damper. With the deflection δ = θ − q, ID the inverse
//! dynamics with the rotor attached to the arm, J the rotor's inertia and c the compliance,
//!
//! ID(q, q̇, q̈) − J·q̈ = δ/c + d·δ̇.
//!
//! All arms are integrated together along the measured θ. θ includes the ringing of the gears, at frequencies
//! that the smoothing for rigid joints removes ([`Dataset::ringing`]).
//!
//! Effects on the drives, F(q, q̇), are part of ID, or with [`GearSpring::friction_at_motor`] of the rotor's balance
//! as F(θ, θ̇); ID is then that of the plant without them ([`behind`]).
//!
//! A parameter p that adds Y to the torques of a given joint motion also changes that motion: with the sensitivity s
//! = ∂δ/∂p and M, C, K the derivatives of ID with respect to q̈, q̇ and q, Y − M·s̈ − C·ṡ − K·s + J·s̈ = s/c + d·ṡ.

use std::borrow::Cow;
use std::convert::Infallible;
use std::ops::Range;

use nalgebra::{Matrix4, Vector4};

use super::states::InternalStates;
use super::{Channels, Joints};
use crate::dynamics::{ChannelMap, Plant, inverse_dynamics};
use crate::effects::{ActiveEffect, GearSpring, Kind};
use crate::identification::Dataset;
use crate::kinematics::{JointState, KinematicsError, Motion};
use crate::machine::{Part, PerAxis, every_axis};
use crate::numerics::parallel;
use crate::recording::Channel;

/// Newmark's γ and β of slow and of fast gears: Fox and Goodwin's rule, of fourth order for oscillations and stable below ω·h =
/// 2.4; and the trapezoidal rule, stable at any, with slight damping of frequencies above the sampling rate.
const SLOW: [f64; 2] = [0.5, 1.0 / 12.0];
const FAST: [f64; 2] = [0.55, 0.25 * (0.5 + 0.55) * (0.5 + 0.55)];
/// ω·h from which a gear is fast, and share of the inertia at the present pose that it may have at another one.
const IS_FAST: f64 = 2.0;
const LEAST_INERTIA: f64 = 0.5;
/// Time over which the first deflection is determined, s.
const START: f64 = 0.02;
/// Largest number of quasi-Newton steps per sample, and number of steps after which the Jacobian is recomputed.
const MOST_STEPS: usize = 12;
const OLD_JACOBIAN: usize = 3;
/// Deflection above which the solution counts as diverged, rad.
const RUN_AWAY: f64 = 0.1;
/// Number of samples after which the Jacobian is recomputed at the latest: the pose has changed.
const FRESH: usize = 25;
/// Change of a deflection after which the iteration has converged, rad. It leaves 5e-5 of what the gears change in the torques,
/// that of a candidate, whose column is a secant, 2e-3.
pub(super) const CONVERGED: f64 = 3e-10;
pub(super) const OF_A_SECANT: f64 = 1e-7;
/// Step for a column of the Jacobian, rad.
const STEP: f64 = 1e-8;

/// The plant behind its gears: without effects on the motor side.
pub(super) fn behind<'a>(plant: &'a Plant, gears: &PerAxis<GearSpring>) -> Cow<'a, Plant> {
    if !plant.effects.iter().any(|a| acts_on_motors(a, gears)) {
        return Cow::Borrowed(plant);
    }
    let mut behind = plant.clone();
    behind.effects.retain(|a| !acts_on_motors(a, gears));
    Cow::Owned(behind)
}

/// Whether an effect acts on the rotors: force laws of the drives do if friction does.
pub(super) fn acts_on_motors(active: &ActiveEffect, gears: &PerAxis<GearSpring>) -> bool {
    let at_motor = gears.iter().any(|g| g.friction_at_motor);
    at_motor && active.effect.acts_on() == Part::Drives && active.effect.kind() == Kind::Force
}

/// Joint motion behind the gears; `rigid` is the motion with rigid gears, `converged` the last change of a deflection, rad.
pub(super) fn deflected<'a>(
    dataset: &Dataset,
    rigid: &Joints<'a>,
    gears: &PerAxis<GearSpring>,
    converged: f64,
) -> Result<Joints<'a>, KinematicsError> {
    let plant = behind(rigid.plant, gears);
    let effects: Vec<&ActiveEffect> = plant.effects.iter().collect();
    let own = InternalStates::along(&plant, &effects, dataset, rigid)?;
    let encoders = encoders(dataset, rigid.plant);
    let mut states = encoders.clone();
    let rule = Newmark::new(&plant, gears, &encoders[0], dataset.dt)?;
    let arms = Arms { plant: &plant, gears, dataset, own: &own, encoders: &encoders, rule, converged };
    for segment in &dataset.segments {
        arms.along(segment.clone(), &mut states)?;
    }
    Ok(Joints::new(rigid.plant, states.into(), encoders.into()))
}

/// Motion of the encoders without offsets and periodic errors, of the arms including the ringing.
fn encoders(dataset: &Dataset, plant: &Plant) -> Vec<JointState> {
    let one = |(smooth, ringing): (&JointState, &JointState)| {
        let mut reading = *smooth;
        for i in 0..plant.mechanism.arms() {
            (reading.q[i], reading.qd[i], reading.qdd[i]) = (ringing.q[i], ringing.qd[i], ringing.qdd[i]);
        }
        plant.behind_encoders(&reading)
    };
    dataset.joints.iter().zip(dataset.ringing()).map(one).collect()
}

/// Newmark's parameters of every gear.
#[derive(Clone, Copy)]
struct Newmark {
    gamma: Vector4<f64>,
    beta: Vector4<f64>,
}

impl Newmark {
    /// Parameters for steps of `h` (s), between both rules by how fast a gear oscillates with its encoder held: ω² =
    /// 1/(c·M), M the inertia behind the gear at the pose of `joint`.
    fn new(plant: &Plant, gears: &PerAxis<GearSpring>, joint: &JointState, h: f64) -> Result<Self, KinematicsError> {
        let motion = plant.motion(joint)?;
        let channels: Vec<Channel> = (0..plant.mechanism.arms()).map(Channel::Torque).collect();
        let map = ChannelMap::new(&plant.geometry, &motion, plant.assembled, &channels)?;
        let behind = map.mass(&plant.bodies, &motion);
        let fast: PerAxis<f64> = std::array::from_fn(|i| {
            let slowness = gears[i].compliance * LEAST_INERTIA * behind[(i, i)];
            if slowness > 0.0 { (h * h / slowness / (IS_FAST * IS_FAST)).min(1.0) } else { 1.0 }
        });
        let between = |k: usize| Vector4::from(fast.map(|fast| SLOW[k] + fast * (FAST[k] - SLOW[k])));
        Ok(Self { gamma: between(0), beta: between(1) })
    }
}

/// Deflections of the arms' gears and their first two derivatives.
#[derive(Clone, Copy)]
struct Deflection {
    angle: Vector4<f64>,
    rate: Vector4<f64>,
    acceleration: Vector4<f64>,
}

impl Deflection {
    /// Deflection one step before a segment and its rate by the straight line through the steady ones, `at` the samples of the
    /// first [`START`]: the accelerations of single samples at the end of a series are uncertain.
    fn started<E>(
        dataset: &Dataset,
        segment: &Range<usize>,
        mut at: impl FnMut(usize) -> Result<Vector4<f64>, E>,
    ) -> Result<Self, E> {
        let (t, start) = (&dataset.t, dataset.t[segment.start] - dataset.dt);
        let samples = segment.clone().take_while(|&k| t[k] - start <= START);
        let steady = samples.map(|k| Ok((t[k] - start, at(k)?))).collect::<Result<Vec<_>, E>>()?;
        let n = steady.len() as f64;
        let (time, mean) = steady.iter().fold((0.0, Vector4::zeros()), |(t, a), (x, y)| (t + x / n, a + y / n));
        let along = |(s, c): (f64, Vector4<f64>), (x, y): &(f64, Vector4<f64>)| {
            (s + (x - time).powi(2), c + (y - mean) * (x - time))
        };
        let (square, product) = steady.iter().fold((0.0, Vector4::zeros()), along);
        let rate = if square > 0.0 { product / square } else { Vector4::zeros() };
        Ok(Self { angle: mean - rate * time, rate, acceleration: Vector4::zeros() })
    }

    /// The part of one gear over its compliance.
    fn share(&self, arm: usize, compliance: f64) -> Self {
        let of = |all: &Vector4<f64>| Vector4::ith(arm, all[arm] / compliance);
        Self { angle: of(&self.angle), rate: of(&self.rate), acceleration: of(&self.acceleration) }
    }

    /// The deflection after the step `h` (s) with the given new acceleration.
    fn after(&self, h: f64, rule: &Newmark, acceleration: Vector4<f64>) -> Self {
        let change = acceleration - self.acceleration;
        let mean = self.acceleration + 2.0 * rule.beta.component_mul(&change);
        Self {
            angle: self.angle + h * self.rate + 0.5 * h * h * mean,
            rate: self.rate + h * (self.acceleration + rule.gamma.component_mul(&change)),
            acceleration,
        }
    }

    /// Joint state behind an encoder.
    fn behind(&self, encoder: &JointState) -> JointState {
        let mut joint = *encoder;
        for i in every_axis() {
            joint.q[i] -= self.angle[i];
            joint.qd[i] -= self.rate[i];
            joint.qdd[i] -= self.acceleration[i];
        }
        joint
    }
}

struct Arms<'a> {
    plant: &'a Plant,
    gears: &'a PerAxis<GearSpring>,
    dataset: &'a Dataset,
    own: &'a InternalStates,
    encoders: &'a [JointState],
    rule: Newmark,
    converged: f64,
}

impl Arms<'_> {
    /// Joint motion along one segment, started from the steady deflection.
    ///
    /// A fit may try inconsistent bodies, with which the deflection diverges: it is then reset to the steady one.
    fn along(&self, segment: Range<usize>, joints: &mut [JointState]) -> Result<(), KinematicsError> {
        let mut motion = Motion::REST;
        let (mut now, mut change) = (self.started(&segment, &mut motion)?, Vector4::zeros());
        let mut inverse = None;
        for (age, k) in segment.enumerate() {
            if age % FRESH == 0 {
                inverse = None;
            }
            let before = now.acceleration;
            now = match self.next(k, &now, before + change, &mut inverse, &mut motion) {
                Ok(next) if next.angle.amax() < RUN_AWAY => next,
                _ => self.steady(k, &mut motion)?,
            };
            change = now.acceleration - before;
            joints[k] = now.behind(&self.encoders[k]);
        }
        Ok(())
    }

    /// Deflection at the start of a segment.
    fn started(&self, segment: &Range<usize>, motion: &mut Motion) -> Result<Deflection, KinematicsError> {
        Deflection::started(self.dataset, segment, |k| Ok(self.steady(k, motion)?.angle))
    }

    /// Steady deflection at sample `k`.
    fn steady(&self, k: usize, motion: &mut Motion) -> Result<Deflection, KinematicsError> {
        let none = Vector4::zeros();
        let rigid = Deflection { angle: none, rate: none, acceleration: none };
        Ok(Deflection { angle: self.excess(k, &rigid, motion)?, ..rigid })
    }

    /// Deflection at sample `k` from the previous one and an expected `acceleration`; `inverse` is the inverse of the Jacobian.
    fn next(
        &self,
        k: usize,
        before: &Deflection,
        mut acceleration: Vector4<f64>,
        inverse: &mut Option<Matrix4<f64>>,
        motion: &mut Motion,
    ) -> Result<Deflection, KinematicsError> {
        let h = self.dataset.step(k);
        let mut left = |a: &Vector4<f64>| self.excess(k, &before.after(h, &self.rule, *a), motion);
        let mut last: Option<[Vector4<f64>; 2]> = None;
        for step in 0..MOST_STEPS {
            let here = left(&acceleration)?;
            if let (Some(inverse), Some([change, there])) = (inverse.as_mut(), last) {
                *inverse = broyden(inverse, &-change, &(here - there));
            }
            if inverse.is_none() || step == OLD_JACOBIAN {
                let mut jacobian = Matrix4::identity();
                for i in 0..self.plant.mechanism.arms() {
                    let mut moved = acceleration;
                    moved[i] += STEP / (h * h);
                    jacobian.set_column(i, &((left(&moved)? - here) * (h * h / STEP)));
                }
                *inverse = jacobian.try_inverse();
            }
            let Some(change) = inverse.map(|inverse| inverse * here) else { break };
            acceleration -= change;
            last = Some([change, here]);
            if change.amax() * h * h < self.converged {
                break;
            }
        }
        Ok(before.after(h, &self.rule, acceleration))
    }

    /// Deflection due to the transmitted torques minus the present deflection, rad: zero in equilibrium; sets `motion`.
    fn excess(&self, k: usize, at: &Deflection, motion: &mut Motion) -> Result<Vector4<f64>, KinematicsError> {
        let joint = at.behind(&self.encoders[k]);
        self.plant.set_motion(&joint, motion)?;
        let tau = inverse_dynamics(self.plant, self.dataset.t[k], motion, &self.own.at(k), false)?.tau;
        Ok(Vector4::from_fn(|i, _| {
            let gear = &self.gears[i];
            let transmitted = tau[i] - gear.rotor_inertia * joint.qdd[i];
            gear.compliance * (transmitted - gear.damping * at.rate[i]) - at.angle[i]
        }))
    }
}

/// Broyden's update of the inverse of a Jacobian for the change `y` of the function over the step `s`.
fn broyden(inverse: &Matrix4<f64>, s: &Vector4<f64>, y: &Vector4<f64>) -> Matrix4<f64> {
    let expected = inverse * y;
    let along = s.dot(&expected);
    // A step dominated by rounding is ignored.
    if along.abs() <= 0.1 * s.norm_squared() {
        return *inverse;
    }
    inverse + (s - expected) * (s.transpose() * inverse) / along
}

/// Steps of accelerations, rad/s², of rates, rad/s, and of angles, rad, for derivatives; the step of a rate is small relative
/// to the width of friction jumps.
const STEPS: [f64; 3] = [1.0, 1e-6, 1e-6];

/// Arms with a measured torque, and its channel.
fn measured(drives: &PerAxis<Option<usize>>) -> impl Iterator<Item = (usize, usize)> + '_ {
    drives.iter().enumerate().filter_map(|(i, c)| c.map(|c| (i, c)))
}

/// Response of elastic gears to additional torques, linearised along a motion.
pub(super) struct Passage<'a> {
    dataset: &'a Dataset,
    joints: &'a Joints<'a>,
    gears: &'a PerAxis<GearSpring>,
    /// Channel of each arm's torque; a gear without a measured torque counts as rigid.
    drives: PerAxis<Option<usize>>,
    /// Derivatives M, C and K of the channels with respect to the arms' accelerations, rates and angles, channel by channel
    /// for each sample.
    slopes: Vec<[Vector4<f64>; 3]>,
    rule: Newmark,
    /// Deflections at the starts of the segments.
    starts: Vec<Deflection>,
    /// Acceleration of s per unit deflection of the gears at fixed joints, for each sample.
    inverse: Vec<Matrix4<f64>>,
}

impl<'a> Passage<'a> {
    pub fn new(
        dataset: &'a Dataset,
        joints: &'a Joints<'a>,
        gears: &'a PerAxis<GearSpring>,
    ) -> Result<Self, KinematicsError> {
        let plant = &*behind(joints.plant, gears);
        let arms = plant.mechanism.arms();
        let drives = std::array::from_fn(|i| dataset.channels.iter().position(|c| i < arms && c.drive() == Some(i)));
        let effects: Vec<&ActiveEffect> = plant.effects.iter().collect();
        let own = InternalStates::along(plant, &effects, dataset, joints)?;
        let with_struts = dataset.channels.iter().any(|c| c.drive().is_none());
        let at = |k: usize| -> Result<Vec<[Vector4<f64>; 3]>, KinematicsError> {
            let values = |joint: &JointState| -> Result<Vec<f64>, KinematicsError> {
                let out = inverse_dynamics(plant, dataset.t[k], &plant.motion(joint)?, &own.at(k), with_struts)?;
                Ok(dataset.channels.iter().map(|c| out.of(*c)).collect())
            };
            let here = values(&joints.states[k])?;
            let mut slopes = vec![[Vector4::zeros(); 3]; here.len()];
            for i in 0..arms {
                for (derivative, step) in STEPS.iter().enumerate() {
                    let mut moved = joints.states[k];
                    [&mut moved.qdd, &mut moved.qd, &mut moved.q][derivative][i] += step;
                    for ((slope, there), here) in slopes.iter_mut().zip(values(&moved)?).zip(&here) {
                        slope[derivative][i] = (there - here) / step;
                    }
                }
            }
            Ok(slopes)
        };
        let slopes: Vec<Vec<[Vector4<f64>; 3]>> =
            parallel::map(dataset.len(), at).into_iter().collect::<Result<_, KinematicsError>>()?;
        let rule = Newmark::new(plant, gears, &joints.states[0], dataset.dt)?;
        let inverse = |(k, slopes): (usize, &Vec<[Vector4<f64>; 3]>)| {
            let h = dataset.step(k);
            let mut matrix = Matrix4::from_diagonal(&(rule.beta * (h * h)));
            for (i, c) in measured(&drives) {
                let (gear, [mass, friction, stiffness]) = (&gears[i], slopes[c]);
                for j in 0..arms {
                    let further = rule.gamma[j] * h * friction[j] + rule.beta[j] * h * h * stiffness[j];
                    matrix[(i, j)] += gear.compliance * (mass[j] + further);
                }
                matrix[(i, i)] += gear.compliance * (rule.gamma[i] * h * gear.damping - gear.rotor_inertia);
            }
            matrix.try_inverse().unwrap_or_else(Matrix4::zeros)
        };
        let inverse = slopes.iter().enumerate().map(inverse).collect();
        let arms = Arms { plant, gears, dataset, own: &own, encoders: &joints.encoders, rule, converged: CONVERGED };
        let mut motion = Motion::REST;
        let starts = dataset.segments.iter().map(|s| arms.started(s, &mut motion));
        let starts = starts.collect::<Result<_, KinematicsError>>()?;
        Ok(Self { dataset, joints, gears, drives, slopes: slopes.concat(), rule, starts, inverse })
    }

    /// Converts an effect's columns from derivatives of the channels at a given motion of the joints into derivatives
    /// at a given motion of the encoders. The compliances' own columns are computed from zero.
    pub fn pass(&self, active: &ActiveEffect, columns: &mut [Channels]) {
        let gears = active.has_gears();
        if acts_on_motors(active, self.gears) || (active.effect.kind().acts_on_the_whole() && !gears) {
            return;
        }
        // The compliances are the first parameters.
        let count = if gears { self.joints.plant.mechanism.arms() } else { columns.len() };
        parallel::each(&mut columns[..count], |i, column| {
            for (segment, start) in self.dataset.segments.iter().zip(&self.starts) {
                self.turn(segment.clone(), column, gears.then_some((i, start)));
            }
        });
    }

    /// Converts a column in one segment; `own` is the arm whose compliance is the parameter, if any, and the deflection at the
    /// start, in proportion to it.
    fn turn(&self, segment: Range<usize>, column: &mut Channels, own: Option<(usize, &Deflection)>) {
        let none = Vector4::zeros();
        let mut s = match own {
            Some((arm, start)) if self.gears[arm].compliance > 0.0 => start.share(arm, self.gears[arm].compliance),
            Some(_) => Deflection { angle: none, rate: none, acceleration: none },
            None => {
                let Ok(s) =
                    Deflection::started::<Infallible>(self.dataset, &segment, |k| Ok(self.source(column, k, None)));
                s
            }
        };
        let own = own.map(|(arm, _)| arm);
        for k in segment {
            let slopes = &self.slopes[k * column.len()..(k + 1) * column.len()];
            // The equation is linear in the new acceleration: the part without it, and its coefficient.
            let h = self.dataset.step(k);
            let free = s.after(h, &self.rule, none);
            let mut right = self.source(column, k, own) - free.angle;
            for (i, c) in measured(&self.drives) {
                let gear = &self.gears[i];
                let resisting = slopes[c][1].dot(&free.rate) + slopes[c][2].dot(&free.angle);
                right[i] -= gear.compliance * (resisting + gear.damping * free.rate[i]);
            }
            s = s.after(h, &self.rule, self.inverse[k] * right);
            for (c, series) in column.iter_mut().enumerate() {
                let direct = if own.is_some() { 0.0 } else { series[k] };
                let [mass, friction, stiffness] = &slopes[c];
                series[k] = direct - mass.dot(&s.acceleration) - friction.dot(&s.rate) - stiffness.dot(&s.angle);
            }
            for (i, c) in measured(&self.drives) {
                column[c][k] += self.gears[i].rotor_inertia * s.acceleration[i];
            }
        }
    }

    /// Derivative of the gears' deflection with respect to the parameter at fixed joints: ∂/∂p of c·(ID − J·q̈ −
    /// d·δ̇).
    fn source(&self, column: &Channels, k: usize, own: Option<usize>) -> Vector4<f64> {
        Vector4::from_fn(|i, _| {
            let compliance = self.gears[i].compliance;
            match own {
                Some(arm) if arm == i && compliance > 0.0 => {
                    (self.joints.encoders[k].q[i] - self.joints.states[k].q[i]) / compliance
                }
                Some(_) => 0.0,
                None => self.drives[i].map_or(0.0, |c| compliance * column[c][k]),
            }
        })
    }
}

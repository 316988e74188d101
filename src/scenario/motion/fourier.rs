//! Periodic end-effector motion as Fourier series ([Gnad 2024], section 3.2), drawn at random within all limits.

use nalgebra::Vector3;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use crate::dynamics::{Plant, steady_inverse_dynamics};
use crate::kinematics::{JointState, PlatformState};
use crate::machine::{PerAxis, each, every_axis};
use crate::model::Model;

/// z(t) = centre + Σₖ aₖ sin(kωt) + bₖ cos(kωt) for x, y, z (m) and ψ (rad).
#[derive(Clone, Debug, PartialEq)]
pub struct FourierMotion {
    /// Base frequency, Hz.
    pub frequency: f64,
    /// Mean of x, y, z (m) and ψ (rad).
    pub centre: [f64; 4],
    /// Sine amplitudes per harmonic, m and rad.
    pub sine: Vec<[f64; 4]>,
    /// Cosine amplitudes per harmonic, m and rad.
    pub cosine: Vec<[f64; 4]>,
}

/// Limits of a random motion besides the joint and telescope limits of the geometry.
#[derive(Clone, Copy, Debug)]
pub struct MotionLimits {
    /// Drive speeds, rad/s.
    pub speed: PerAxis<f64>,
    /// Drive accelerations, rad/s².
    pub acceleration: PerAxis<f64>,
    /// Drive torques, N·m.
    pub torque: PerAxis<f64>,
}

impl MotionLimits {
    /// `share` of all limits of the model's drives; the acceleration of axis 4 is limited by its torque alone.
    pub fn of(model: &Model, share: f64) -> Self {
        Self {
            speed: model.drives.map(|d| share * d.max_speed),
            acceleration: model.drives.map(|d| share * d.max_acceleration),
            torque: model.drives.map(|d| share * d.max_torque),
        }
    }
}

impl FourierMotion {
    /// Coordinates, rates and accelerations at time `t` (s).
    pub fn coordinates(&self, t: f64) -> [[f64; 4]; 3] {
        let mut x = [self.centre, [0.0; 4], [0.0; 4]];
        for (k, (a, b)) in self.sine.iter().zip(&self.cosine).enumerate() {
            let omega = std::f64::consts::TAU * self.frequency * (k + 1) as f64;
            let (s, c) = (omega * t).sin_cos();
            for i in 0..4 {
                x[0][i] += a[i] * s + b[i] * c;
                x[1][i] += omega * (a[i] * c - b[i] * s);
                x[2][i] -= omega * omega * (a[i] * s + b[i] * c);
            }
        }
        x
    }

    /// Desired platform state at time `t` (s).
    pub fn at(&self, t: f64) -> PlatformState {
        let x = self.coordinates(t);
        let vector = |v: &[f64; 4]| Vector3::new(v[0], v[1], v[2]);
        PlatformState {
            position: vector(&x[0]),
            velocity: vector(&x[1]),
            acceleration: vector(&x[2]),
            psi: [x[0][3], x[1][3], x[2][3]],
        }
    }

    /// Random motion with `harmonics` harmonics of `frequency` (Hz), scaled down until all limits hold on a fine grid.
    pub fn random(
        plant: &Plant,
        limits: &MotionLimits,
        frequency: f64,
        harmonics: usize,
        rng: &mut ChaCha8Rng,
    ) -> Self {
        let psi = match plant.mechanism {
            machine if machine.has_telescope() => 12.0,
            machine if machine.plate_turns() => 1.0,
            _ => 0.0,
        };
        let mut motion = Self::still(frequency, [0.0, 0.0, middle(plant), 0.0], harmonics);
        motion.draw(&[0.5, 0.5, 0.2, psi], rng);
        // Platform and axis 4 are scaled separately: their limits are nearly independent, except for an eccentric
        // payload, which axis 4 accelerates.
        let mut tries = 0;
        while tries < 200 {
            match motion.within(plant, limits) {
                Fit::Good => break,
                Fit::Platform => motion.scale(0.93, 0..3),
                Fit::Axis4 => motion.scale(0.93, 3..4),
                Fit::Both => motion.scale(0.93, 0..4),
            }
            tries += 1;
        }
        motion
    }

    /// Random motion of independent axes, whose coordinates are their angles; each is scaled down until the limits of
    /// its joint and drive hold.
    pub fn random_axes(
        plant: &Plant,
        limits: &MotionLimits,
        frequency: f64,
        harmonics: usize,
        rng: &mut ChaCha8Rng,
    ) -> Self {
        let [low, high] = plant.geometry.arm_limits();
        let arms = plant.mechanism.arms();
        let centre = std::array::from_fn(|i| if i < arms { 0.5 * (low + high) } else { 0.0 });
        let sizes: PerAxis<f64> = std::array::from_fn(|i| if i < arms { 0.5 * (high - low) } else { 12.0 });
        let mut motion = Self::still(frequency, centre, harmonics);
        motion.draw(&sizes[..plant.mechanism.axes()], rng);
        for _ in 0..200 {
            let bad = motion.axes_beyond(plant, limits);
            if bad == each(false) {
                break;
            }
            for axis in every_axis().filter(|&i| bad[i]) {
                motion.scale(0.93, axis..axis + 1);
            }
        }
        motion
    }

    /// A motion with `harmonics` harmonics of zero amplitude about `centre`.
    fn still(frequency: f64, centre: [f64; 4], harmonics: usize) -> Self {
        Self { frequency, centre, sine: vec![[0.0; 4]; harmonics], cosine: vec![[0.0; 4]; harmonics] }
    }

    /// Draws the amplitudes of the first coordinates, at most `sizes` divided by the number of the harmonic: with equal
    /// velocity amplitudes the harmonics reach speed and acceleration limits together.
    fn draw(&mut self, sizes: &[f64], rng: &mut ChaCha8Rng) {
        for k in 0..self.sine.len() {
            for (i, size) in sizes.iter().enumerate() {
                let size = size / (k + 1) as f64;
                self.sine[k][i] = size * rng.random_range(-1.0..1.0);
                self.cosine[k][i] = size * rng.random_range(-1.0..1.0);
            }
        }
    }

    /// Whether each axis violates the limits of its joint; where none does, whether it violates those of its drive. The axes are
    /// independent, so that joints within their limits may come first.
    fn axes_beyond(&self, plant: &Plant, limits: &MotionLimits) -> PerAxis<bool> {
        let [low, high] = plant.geometry.arm_limits();
        let (axes, arms) = (plant.mechanism.axes(), plant.mechanism.arms());
        let states: Vec<[PerAxis<f64>; 3]> =
            (0..GRID).map(|k| self.coordinates(k as f64 / GRID as f64 / self.frequency)).collect();
        let of_joint = |[q, qd, qdd]: &[PerAxis<f64>; 3], i: usize| {
            qd[i].abs() > limits.speed[i]
                || (i < arms && (qdd[i].abs() > limits.acceleration[i] || !(low..=high).contains(&q[i])))
        };
        let bad: PerAxis<bool> = std::array::from_fn(|i| i < axes && states.iter().any(|state| of_joint(state, i)));
        if bad != each(false) {
            return bad;
        }
        let torque = |&[q, qd, qdd]: &[PerAxis<f64>; 3]| {
            plant
                .motion(&JointState { q, qd, qdd })
                .and_then(|motion| steady_inverse_dynamics(plant, 0.0, &motion, false))
                .map_or(each(f64::INFINITY), |out| out.tau)
        };
        let mut most: PerAxis<f64> = each(0.0);
        for state in &states {
            let torque = torque(state);
            most = std::array::from_fn(|i| most[i].max(torque[i].abs()));
        }
        std::array::from_fn(|i| i < axes && most[i] > limits.torque[i])
    }

    fn scale(&mut self, factor: f64, coordinates: std::ops::Range<usize>) {
        for row in self.sine.iter_mut().chain(&mut self.cosine) {
            for x in &mut row[coordinates.clone()] {
                *x *= factor;
            }
        }
    }

    fn within(&self, plant: &Plant, limits: &MotionLimits) -> Fit {
        // Where the plate turns the end effector, every arm moves both.
        let (arms, all) = (plant.mechanism.arms(), plant.mechanism.plate_turns());
        let of_platform = || if all { Fit::Both } else { Fit::Platform };
        for k in 0..GRID {
            let platform = self.at(k as f64 / GRID as f64 / self.frequency);
            let Ok(joints) = plant.geometry.inverse_motion(&platform) else { return of_platform() };
            let held = plant.geometry.determinacy(&platform.position, platform.psi[0]);
            if held.is_err() || held.is_ok_and(|share| share < LEAST_DETERMINACY) {
                return Fit::Both;
            }
            let bent = plant.stops.hooke_stiffness > 0.0
                && plant.geometry.has_telescope()
                && plant.geometry.telescope_tilt(&platform.position) > plant.stops.hooke;
            if bent || plant.geometry.check_limits(&joints.q, &platform.position).is_err() {
                return of_platform();
            }
            let Ok(motion) = plant.motion(&joints) else { return of_platform() };
            let Ok(out) = steady_inverse_dynamics(plant, 0.0, &motion, false) else { return of_platform() };
            let bad = |i: usize| {
                joints.qd[i].abs() > limits.speed[i]
                    || (i < arms && joints.qdd[i].abs() > limits.acceleration[i])
                    || out.tau[i].abs() > limits.torque[i]
            };
            if (0..arms).any(bad) {
                if all {
                    return Fit::Both;
                }
                let resting = PlatformState {
                    position: Vector3::from_fn(|i, _| self.centre[i]),
                    velocity: Vector3::zeros(),
                    acceleration: Vector3::zeros(),
                    ..platform
                };
                let motion = plant.geometry.inverse_motion(&resting).and_then(|joints| plant.motion(&joints));
                let out = motion.and_then(|motion| steady_inverse_dynamics(plant, 0.0, &motion, false));
                let swung = out.is_ok_and(|o| (0..arms).any(|i| o.tau[i].abs() > SWUNG * limits.torque[i]));
                return if swung { Fit::Both } else { Fit::Platform };
            }
            if plant.mechanism.has_telescope() && bad(3) {
                return Fit::Axis4;
            }
        }
        Fit::Good
    }
}

/// Height (m) about which the platform moves: near the middle of the telescope's range, or of the arms' range without
/// telescope.
pub fn middle(plant: &Plant) -> f64 {
    let g = &plant.geometry;
    if plant.mechanism.has_telescope() {
        let [low, high] = g.telescope_limits;
        return g.upper_hooke_height - g.lower_hooke_height - 0.45 * (low + high);
    }
    let [low, high] = g.arm_limits();
    let middle: PerAxis<f64> = each(0.5 * (low + high));
    g.forward(&middle).map_or(-g.limbs[0].arm_length, |p| p.z)
}

/// Least [`Geometry::determinacy`] of a random motion: Par4 keeps |ψ| below 72°.
///
/// [`Geometry::determinacy`]: crate::machine::Geometry::determinacy
pub const LEAST_DETERMINACY: f64 = 0.3;
/// Share of an arm's torque limit beyond which the motion of axis 4 with the payload, the platform at rest, is scaled
/// down too.
const SWUNG: f64 = 0.5;
/// Instants per period at which limits are checked.
const GRID: usize = 1000;

enum Fit {
    Good,
    Platform,
    Axis4,
    Both,
}

//! A closed-loop run of the twin: trajectory, controller, plant, sensors.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, Normal};
use thiserror::Error;

use super::SingularPose;
use super::constraints;
use super::controller::{Controller, Gains, quantised};
use super::machine::Twin;
use super::torque::Torque;
use crate::dynamics::Plant;
use crate::kinematics::{JointState, KinematicsError, PlatformState, Reactions};
use crate::model::bodies::PLATFORM;
use crate::model::{AXES, Model, STRUTS};
use crate::recording::{Recording, Setup, Signals};

/// How a run is made.
#[derive(Clone, Debug)]
pub struct Options {
    /// Length of the run, s.
    pub duration: f64,
    /// Integration steps per control period.
    pub substeps: usize,
    /// Seed of the sensor noise; `None` switches noise and quantisation off.
    pub noise_seed: Option<u64>,
    /// Struts that carry a force sensor at the elbow.
    pub strut_sensors: [bool; STRUTS],
    /// Controller gains.
    pub gains: Gains,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            duration: 20.0,
            substeps: 2,
            noise_seed: Some(0),
            strut_sensors: [false; STRUTS],
            gains: Gains::default(),
        }
    }
}

/// What a run showed besides its recording.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// Simulated time, s.
    pub simulated: f64,
    /// Integration steps.
    pub steps: usize,
    /// Largest violation of a position row, m (or 1).
    pub max_loop_gap: f64,
    /// Largest violation of a velocity row, m/s (or 1/s).
    pub max_loop_rate: f64,
    /// Largest |energy − initial energy − work| relative to the work turned over.
    pub energy_error: f64,
    /// Largest axial strut force, N.
    pub peak_strut_force: f64,
    /// Largest distance between desired and actual joint angle, rad.
    pub tracking_error: [f64; AXES],
}

/// Why a run ended early.
#[derive(Debug, Error)]
pub enum SimulationError {
    /// The desired motion cannot be taken.
    #[error("desired motion at t = {t:.4} s: {source}")]
    Trajectory {
        /// Time, s.
        t: f64,
        /// What is wrong with the pose.
        source: KinematicsError,
    },
    /// The mechanism ran into a singular pose or beyond any number.
    #[error("the mechanism lost rank at t = {t:.4} s")]
    Singular {
        /// Time, s.
        t: f64,
    },
}

/// Runs `model` under `setup` along `desired`, controlled by `controller_plant`'s feed-forward.
///
/// The drives ramp the torque linearly over each period, so a recorded torque is the one that acts at its time stamp.
/// `progress` is called with the simulated time once per period; returning false ends the run there.
pub fn simulate(
    model: &Model,
    setup: &Setup,
    controller_plant: &Plant,
    desired: &dyn Fn(f64) -> PlatformState,
    options: &Options,
    progress: &mut dyn FnMut(f64) -> bool,
) -> Result<(Recording, Report), SimulationError> {
    let plant = Plant::new(model, setup);
    let period = model.sample_time;
    let samples = (options.duration / period).round() as usize;
    let joints = |t: f64| -> Result<JointState, SimulationError> {
        plant.geometry.inverse_motion(&desired(t)).map_err(|source| SimulationError::Trajectory { t, source })
    };
    let wanted = joints(0.0)?;
    let motion = plant.motion(&wanted).map_err(|source| SimulationError::Trajectory { t: 0.0, source })?;
    let mut twin = Twin::new(plant.clone(), &motion).map_err(|_| SimulationError::Singular { t: 0.0 })?;
    let mut controller = Controller::new(controller_plant, model.drives, options.gains, period);
    let mut tau = controller.feed_forward(&wanted).map_err(|source| SimulationError::Trajectory { t: 0.0, source })?;
    let mut sensors = Sensors::new(model, setup, options);
    let mut report = Report::default();
    let mut signals = Signals::default();
    let mut turned_over = 0.0;
    let mut drives = [0.0; AXES];
    let mut now = wanted;
    let singular = |t: f64| move |_: SingularPose| SimulationError::Singular { t };
    for k in 0..samples {
        let t = k as f64 * period;
        twin.set_time(t);
        let snapshot = twin.evaluate(&Torque::constant(tau)).map_err(singular(t))?;
        let motion = &snapshot.motion;
        for (gap, rate) in constraints::rows(&plant.geometry, motion) {
            report.max_loop_gap = report.max_loop_gap.max(gap.abs());
            report.max_loop_rate = report.max_loop_rate.max(rate.abs());
        }
        let encoders = sensors.angles(&twin.encoders());
        for i in 0..AXES {
            report.tracking_error[i] = report.tracking_error[i].max((motion.q[i] - now.q[i]).abs());
        }
        let next = joints(t + period)?;
        let target =
            controller.update(&now, &encoders, &next).map_err(|source| SimulationError::Trajectory { t, source })?;
        sensors.record(&mut signals, t, &encoders, &tau, &motion.bodies[PLATFORM].position, &snapshot.reactions);
        for force in snapshot.reactions.upper.iter().chain(&snapshot.reactions.lower) {
            report.peak_strut_force = report.peak_strut_force.max(force.abs());
        }
        let torque = Torque::ramp(t, tau, target, period);
        let h = period / options.substeps as f64;
        for _ in 0..options.substeps {
            twin.step(h, &torque).map_err(singular(t))?;
            report.steps += 1;
        }
        for (before, after) in drives.iter_mut().zip(twin.work()) {
            turned_over += (after - *before).abs();
            *before = *after;
        }
        let balance = twin.energy_balance();
        if !balance.is_finite() {
            return Err(SimulationError::Singular { t });
        }
        report.energy_error = report.energy_error.max(balance.abs());
        tau = target;
        now = next;
        report.simulated = t + period;
        if !progress(report.simulated) {
            break;
        }
    }
    report.energy_error /= turned_over.max(f64::MIN_POSITIVE);
    for active in &plant.effects {
        active.effect.observe(&active.values(), &mut signals);
    }
    sensors.add_noise(&mut signals);
    Ok((Recording { name: model.name.clone(), signals, setup: *setup }, report))
}

/// Encoders, torque and force sensors.
struct Sensors<'a> {
    model: &'a Model,
    struts: [bool; STRUTS],
    torque_noise: [f64; AXES],
    rng: Option<ChaCha8Rng>,
}

impl<'a> Sensors<'a> {
    fn new(model: &'a Model, setup: &Setup, options: &Options) -> Self {
        Self {
            model,
            struts: options.strut_sensors,
            torque_noise: setup.torque_noise.unwrap_or(model.noise.torque),
            rng: options.noise_seed.map(ChaCha8Rng::seed_from_u64),
        }
    }

    fn angles(&self, q: &[f64; AXES]) -> [f64; AXES] {
        if self.rng.is_none() {
            return *q;
        }
        std::array::from_fn(|i| quantised(q[i], &self.model.drives[i]))
    }

    fn record(
        &self,
        signals: &mut Signals,
        t: f64,
        q: &[f64; AXES],
        tau: &[f64; AXES],
        position: &nalgebra::Vector3<f64>,
        reactions: &Reactions,
    ) {
        signals.t.push(t);
        signals.q.push(*q);
        signals.tau.push(*tau);
        signals.ee.get_or_insert_default().push([position.x, position.y, position.z]);
        for s in 0..STRUTS {
            if self.struts[s] {
                signals.strut_upper[s].get_or_insert_default().push(reactions.upper[s]);
            }
        }
    }

    /// Adds white noise to torques and forces.
    fn add_noise(&mut self, signals: &mut Signals) {
        let Some(rng) = &mut self.rng else { return };
        for tau in &mut signals.tau {
            for (x, sigma) in tau.iter_mut().zip(self.torque_noise) {
                *x += normal(sigma).sample(rng);
            }
        }
        let force = normal(self.model.noise.strut_force);
        for x in signals.strut_upper.iter_mut().flatten().flatten() {
            *x += force.sample(rng);
        }
    }
}

fn normal(sigma: f64) -> Normal<f64> {
    Normal::new(0.0, sigma.max(0.0)).expect("a finite standard deviation")
}

//! Campaign: a robot with hidden effects and its recordings.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use std::sync::Arc;
use thiserror::Error;

use super::motion::{Motion, MotionKind};
use super::noise::{self, Noise};
use super::outside::Outside;
use super::size::{Hidden, Size, Sizer};
use deltatwin::dynamics::Plant;
use deltatwin::effects::rigid_bodies::{self, RigidBodies};
use deltatwin::effects::{self, Effect, Role};
use deltatwin::identification::NoiseLevel;
use deltatwin::identification::{Dataset, FitError, Residuals};
use deltatwin::machine::{Actuator, Payload, PerAxis, Setup, each};
use deltatwin::model::Model;
use deltatwin::recording::{Channel, Recording};
use deltatwin::scenario::Sensors;
use deltatwin::twin::{Options, Report, SimulationError, simulate};

/// Specification of a campaign, which determines it completely.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// Seed of separate random streams for the robot, the motions, the values of the effects and the noise.
    pub seed: u64,
    /// Names of the hidden effects; may be empty.
    pub effects: Vec<String>,
    /// A law outside the library that is hidden as well.
    pub outside: Option<Outside>,
    /// Size of the hidden effects.
    pub size: Size,
    /// Factor on that size.
    pub scale: f64,
    /// Kind of torque noise.
    pub noise: Noise,
    /// Kind of motion.
    pub motion: MotionKind,
    /// Whether strut 1 has a force sensor at the elbow.
    pub strut_sensor: bool,
    /// Whether the robot carries a payload off its axis, 2.5 kg on the IRB 360-6/1600.
    pub payload: bool,
    /// Duration of each recording, s.
    pub duration: f64,
}

impl Default for Case {
    fn default() -> Self {
        Self {
            seed: 1,
            effects: Vec::new(),
            outside: None,
            size: Size::Medium,
            scale: 1.0,
            noise: Noise::White,
            motion: MotionKind::Wideband,
            strut_sensor: true,
            payload: true,
            duration: 20.0,
        }
    }
}

/// Hidden effects and recordings.
pub struct Campaign {
    /// Specification.
    pub case: Case,
    /// Hidden effects.
    pub hidden: Vec<Hidden>,
    /// The user's model: the robot without the hidden effects, with parameters a few percent off.
    pub model: Model,
    /// The robot, including the hidden effects.
    pub robot: Model,
    /// Recording for the diagnosis.
    pub measurement: Recording,
    /// Recording of another motion of the same robot for validation.
    pub validation: Recording,
    /// Reports of the twin for both runs.
    pub reports: [Report; 2],
    /// Share of the law outside the library that no sum of the search's laws represents along the first motion.
    pub unspanned: Option<f64>,
    /// Largest ratio of RMS residual to noise floor of the robot's own model on the validation; `None` without noise.
    pub attainable: Option<f64>,
}

/// Reason why a campaign is not possible.
#[derive(Debug, Error)]
pub enum CampaignError {
    /// The effect cannot be hidden.
    #[error("cannot hide `{name}`: expected `none` or one of {}", .known.join(", "))]
    Effect {
        /// Requested name.
        name: String,
        /// Names that can be hidden.
        known: Vec<&'static str>,
    },
    /// The model cannot be refitted along the drawn motion.
    #[error("the effect cannot be sized: {0}")]
    Size(#[from] FitError),
    /// The simulation stopped.
    #[error(transparent)]
    Simulation(#[from] SimulationError),
}

/// Torque noise relative to that of the model.
const NOISE: PerAxis<f64> = [0.8, 0.8, 0.8, 1.0];
/// Payload on the reference machine: mass (kg), centre of mass (m), inertia about z (kg·m²).
const PAYLOAD: (f64, [f64; 3], f64) = (2.5, [0.03, -0.02, -0.08], 0.012);
/// Largest force of a drive of the reference machine at the elbow, 132 N·m over 0.5 m, N.
const REFERENCE_FORCE: f64 = 264.0;

/// Standard deviation of the torque noise on a machine, N·m or N.
fn torque_noise(model: &Model) -> PerAxis<f64> {
    std::array::from_fn(|axis| NOISE[axis] * model.noise.torque[axis])
}

/// The payload of the campaigns, with its mass in proportion to the drives' force at the elbows and its lengths to the
/// struts'.
fn payload(model: &Model) -> Payload {
    let drive = model.drives[0].max_torque;
    let force = match model.geometry.actuator() {
        Actuator::Revolute => drive / model.geometry.limbs[0].arm_length,
        Actuator::Prismatic { .. } => drive,
    };
    let (heavier, larger) = (force / REFERENCE_FORCE, model.view().size());
    let (mass, com, inertia_zz) = PAYLOAD;
    Payload::new(heavier * mass, com.map(|x| larger * x), heavier * larger * larger * inertia_zz)
}

/// Independent streams of random numbers.
enum Stream {
    Robot,
    Motion,
    Effects,
    Noise,
}

impl Case {
    /// Random number generator of the case for one purpose.
    fn random(&self, stream: Stream) -> ChaCha8Rng {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(stream as u64);
        rng
    }

    fn setup(&self, model: &Model) -> Setup {
        let payload = if self.payload { payload(model) } else { Payload::default() };
        Setup { payload, torque_noise: Some(torque_noise(model)), ..Setup::default() }
    }
}

/// Effects that can be hidden: those that the model lacks and a measured motion can reveal.
pub fn hideable(model: &Model) -> Vec<Arc<dyn Effect>> {
    let carried = |e: &dyn Effect| model.effects.iter().any(|a| a.effect.name() == e.name());
    effects::REGISTRY
        .iter()
        .filter(|e| {
            e.name() != rigid_bodies::NAME && e.spec().identifiable && !e.parameters().is_empty() && !carried(&***e)
        })
        .filter(|e| model.mechanism.has(e.acts_on(), model.assembled))
        .cloned()
        .collect()
}

/// Campaign on an assembled delta robot; `progress` receives the run (0 or 1) and the simulated time in s.
///
/// # Errors
/// As [`prepare`] and [`Prepared::record`].
pub fn campaign(model: &Model, case: &Case, progress: &(dyn Fn(usize, f64) + Sync)) -> Result<Campaign, CampaignError> {
    let outside: Vec<Arc<dyn Effect>> =
        case.outside.iter().map(|law| Arc::new(law.effect(model.mechanism)) as _).collect();
    campaign_with(model, case, &outside, progress)
}

/// Campaign as [`campaign`], with effects `beyond` the registry, such as formulas, hidden as well.
///
/// # Errors
/// As [`prepare`] and [`Prepared::record`].
pub fn campaign_with(
    model: &Model,
    case: &Case,
    beyond: &[Arc<dyn Effect>],
    progress: &(dyn Fn(usize, f64) + Sync),
) -> Result<Campaign, CampaignError> {
    prepare(model, case, beyond)?.record(model, progress)
}

/// Campaign as [`campaign_with`] without noise on torques and forces; encoders are quantised.
///
/// # Errors
/// As [`prepare`] and [`Prepared::quiet`].
pub fn quiet_campaign(
    model: &Model,
    case: &Case,
    beyond: &[Arc<dyn Effect>],
    progress: &(dyn Fn(usize, f64) + Sync),
) -> Result<Campaign, CampaignError> {
    prepare(model, case, beyond)?.quiet(model, progress)
}

/// A robot with hidden effects and its motions.
pub struct Prepared {
    case: Case,
    /// Hidden effects.
    pub hidden: Vec<Hidden>,
    robot: Model,
    motions: [Motion; 2],
    /// Share of the law outside the library that no sum of the search's laws represents along the first motion.
    pub unspanned: Option<f64>,
}

/// Draws the robot, the motions and the values of the hidden effects of `case` and `beyond` the registry.
///
/// # Errors
/// If an effect cannot be hidden, or the model cannot be refitted along the drawn motion.
pub fn prepare(model: &Model, case: &Case, beyond: &[Arc<dyn Effect>]) -> Result<Prepared, CampaignError> {
    let known = hideable(model);
    let find = |name: &String| {
        known.iter().find(|e| e.name() == name).cloned().ok_or_else(|| CampaignError::Effect {
            name: name.clone(),
            known: known.iter().map(|e| e.name()).collect(),
        })
    };
    let mut wanted = case.effects.iter().map(find).collect::<Result<Vec<_>, _>>()?;
    wanted.extend(beyond.iter().cloned());
    let setup = case.setup(model);
    let mut robot = model.clone();
    perturb(&mut robot, &mut case.random(Stream::Robot));
    let believed = Plant::new(model, &setup);
    let mut rng = case.random(Stream::Motion);
    let motions = [0, 1].map(|_| Motion::draw(case.motion, model, &believed, &mut rng));
    let mut channels = Channel::of_drives(model.mechanism);
    let mut sigma = torque_noise(model)[..channels.len()].to_vec();
    if case.strut_sensor {
        channels.push(Channel::StrutUpper(0));
        sigma.push(model.noise.strut_force);
    }
    let (mut hidden, mut unspanned) = (Vec::new(), None);
    if !wanted.is_empty() {
        let sizer = Sizer::new(&robot, &setup, &motions[0], case.duration, &channels, &sigma)?;
        let mut rng = case.random(Stream::Effects);
        for effect in wanted {
            hidden.push(sizer.draw(effect, case.scale * case.size.factor(), &mut rng)?);
        }
        unspanned = case.outside.map(|law| sizer.unspanned(law)).transpose()?.flatten();
    }
    robot.effects.extend(hidden.iter().map(|h| h.active.clone()));
    Ok(Prepared { case: case.clone(), hidden, robot, motions, unspanned })
}

impl Prepared {
    /// Records both motions without noise on torques and forces; `model` is the user's, `progress` receives the run
    /// (0 or 1) and the simulated time in s.
    ///
    /// # Errors
    /// If the simulation stops.
    pub fn quiet(self, model: &Model, progress: &(dyn Fn(usize, f64) + Sync)) -> Result<Campaign, CampaignError> {
        let Self { case, hidden, robot, motions, unspanned } = self;
        let setup = case.setup(model);
        let believed = Plant::new(model, &setup);
        let run = |k: usize| {
            let options = Options {
                duration: case.duration,
                noise_seed: Some(0),
                sensors: Sensors {
                    strut_upper: std::array::from_fn(|i| case.strut_sensor && i == 0),
                    ee: false,
                    ..Sensors::default()
                },
                ..Options::default()
            };
            // The twin's sensors quantise; noise is added later.
            let quiet = Setup { torque_noise: Some(each(0.0)), ..setup };
            let mut machine = robot.clone();
            machine.noise.strut_force = 0.0;
            let measured = simulate(&machine, &quiet, &believed, &|t| motions[k].at(t), &options, &mut |t| {
                progress(k, t);
                true
            });
            measured.map(|(recording, report)| (Recording { setup, ..recording }, report))
        };
        let (first, second) = rayon::join(|| run(0), || run(1));
        let ((measurement, a), (validation, b)) = (first?, second?);
        Ok(Campaign {
            case,
            hidden,
            model: model.clone(),
            robot,
            measurement: Recording { name: "measurement".into(), ..measurement },
            validation: Recording { name: "validation".into(), ..validation },
            reports: [a, b],
            unspanned,
            attainable: None,
        })
    }

    /// Records both motions with the noise of the case.
    ///
    /// # Errors
    /// If the simulation stops, or the robot's own model cannot be evaluated on the validation.
    pub fn record(self, model: &Model, progress: &(dyn Fn(usize, f64) + Sync)) -> Result<Campaign, CampaignError> {
        let quiet = self.quiet(model, progress)?;
        let [measurement, validation] = quiet.noisy(&quiet.case);
        let attainable = Some(attainable(&quiet.robot, &validation)?);
        Ok(Campaign { measurement, validation, attainable, ..quiet })
    }
}

/// Largest ratio of RMS residual to noise floor of the robot's own model on a recording, due to errors of the
/// differentiation.
fn attainable(robot: &Model, recording: &Recording) -> Result<f64, FitError> {
    let datasets = [Dataset::new(recording)];
    let rms = Residuals::new(robot, &datasets)?.rms;
    Ok(rms.iter().zip(NoiseLevel::of(robot, &datasets).pooled).map(|(rms, floor)| rms / floor).fold(0.0, f64::max))
}

impl Campaign {
    /// Both recordings with the noise of `case`, rounded as by a measuring system.
    pub fn noisy(&self, case: &Case) -> [Recording; 2] {
        let force = self.model.noise.strut_force;
        let mut rng = case.random(Stream::Noise);
        [&self.measurement, &self.validation].map(|quiet| {
            let mut recording = quiet.clone();
            let signals = &mut recording.signals;
            noise::lay(case.noise, &torque_noise(&self.model), force, signals, &mut rng);
            signals.t.iter_mut().for_each(|t| *t = rounded(*t, 1e7));
            for (channel, values) in signals.series_mut() {
                let per_unit = match channel {
                    Channel::Angle(_) => 1e9,
                    Channel::Torque(_) => 1e4,
                    _ => 1e3,
                };
                values.iter_mut().for_each(|x| *x = rounded(*x, per_unit));
            }
            recording
        })
    }
}

/// `x` rounded to a multiple of 1/`per_unit`.
fn rounded(x: f64, per_unit: f64) -> f64 {
    (x * per_unit).round() / per_unit
}

/// Changes inertia by up to ±3 % and friction by up to ±5 %, as the deviations of a real machine from its data sheet.
pub fn perturb(model: &mut Model, rng: &mut ChaCha8Rng) {
    let bodies = RigidBodies::of(model.mechanism, model.assembled);
    let mut links: Vec<f64> = bodies.values(&model.bodies);
    for x in &mut links {
        *x *= 1.0 + rng.random_range(-0.03..0.03);
    }
    bodies.set_values(&mut model.bodies, &links);
    for active in &mut model.effects {
        let entries = active.entries();
        for (x, entry) in active.values.iter_mut().zip(entries) {
            if entry.parameter.role != Role::Fixed {
                *x *= 1.0 + rng.random_range(-0.05..0.05);
            }
        }
    }
}

//! Catalogue of experiments from which the effect of a machine can be determined.
//!
//! The kind of motion matters more than the tuning of one kind: effects that are indistinguishable along one kind of
//! motion differ along another. Every entry is a planned motion within the machine's limits, sampled where the
//! columns are computed: entirely if it is short, in equally spaced windows otherwise.

use nalgebra::Vector3;

use super::prospect::Noise;
use crate::dynamics::Plant;
use crate::identification::{Dataset, predict};
use crate::kinematics::JointState;
use crate::machine::{Configuration, Part, Payload, PerAxis, Setup, each};
use crate::model::Model;
use crate::recording::Channel;
use crate::scenario::Course;
use crate::scenario::motion::constant_speed::ConstantSpeed;
use crate::scenario::motion::fourier::middle;
use crate::scenario::motion::path::Path;
use crate::scenario::motion::static_poses::StaticPoses;
use crate::twin::Clamps;

/// Kind of experiment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A random periodic motion.
    Excitation,
    /// The motion of the data at half speed.
    HalfSpeed,
    /// The motion of the data at double speed.
    DoubleSpeed,
    /// Slow motion at constant speed in both directions.
    SlowSweep,
    /// Static poses, each approached from both sides.
    StaticPoses,
    /// Fast reversals of one axis.
    Reversals,
    /// Motion with a known payload.
    Payload,
    /// Motion without the payload.
    NoPayload,
    /// Motion with force sensors in a strut.
    StrutSensor,
    /// Motion of the arms and motor 4 of the disassembled robot.
    Disassembled,
    /// Long run until the drives are warm.
    WarmUp,
    /// A motion designed for the given purpose.
    Designed,
}

impl Kind {
    /// Name in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Excitation => "excitation",
            Self::HalfSpeed => "half_speed",
            Self::DoubleSpeed => "double_speed",
            Self::SlowSweep => "slow_sweep",
            Self::StaticPoses => "static_poses",
            Self::Reversals => "reversals",
            Self::Payload => "payload",
            Self::NoPayload => "no_payload",
            Self::StrutSensor => "strut_sensor",
            Self::Disassembled => "disassembled",
            Self::WarmUp => "warm_up",
            Self::Designed => "designed",
        }
    }

    /// Preparation time, s, in addition to the handling of any experiment; an estimate, used only for ordering.
    pub fn preparation(self) -> f64 {
        match self {
            Self::Payload | Self::NoPayload => 300.0,
            Self::StrutSensor => 3600.0,
            Self::Disassembled => 7200.0,
            _ => 0.0,
        }
    }
}

/// A planned experiment.
#[derive(Clone, Debug)]
pub struct Experiment {
    /// Kind.
    pub kind: Kind,
    /// Description for the user.
    pub what: String,
    /// The motion; `None` where it is that of a recording.
    pub course: Option<Course>,
    /// Samples of the planned motion without measurements.
    pub dataset: Dataset,
    /// Duration of the whole experiment, s.
    pub length: f64,
    /// Ratio of the whole duration to the sampled one.
    pub weight: f64,
    /// Whether its data cannot be combined with the existing data.
    pub alone: bool,
}

/// Largest number of samples per experiment, and number of samples in a window.
const SAMPLES: usize = 1000;
const WINDOW: usize = 100;
/// Usable share of the drives' limits on acceleration and torque, and of the sockets' hold.
const SHARE: f64 = 0.9;
/// Share of the limits that a random motion may use.
const RANDOM_SHARE: f64 = 0.45;
/// Base frequency, Hz, and number of harmonics of a random motion.
const FOURIER: (f64, usize) = (0.1, 10);
/// Duration of a warm-up run, s: several thermal time constants of minutes, or the beginning of an hour-long one.
const WARM_UP: f64 = 1200.0;
/// Unit of the rotations of a plate in slow motions, rad; that of an end effector with an axis of its own is 1 rad.
const PLATE_TURN: f64 = 0.4;
/// Payload to be mounted: mass (kg), centre of mass (m) and inertia about z (kg·m²) of a plate beside the axis.
const KNOWN: (f64, [f64; 3], f64) = (2.5, [0.04, 0.02, -0.05], 0.01);

/// Planning context: the machine and the data measured on it.
pub struct Bench<'a> {
    /// Current model of the machine.
    pub model: &'a Model,
    /// State of the machine in the data.
    pub setup: Setup,
    /// Channels that are measured.
    pub channels: Vec<Channel>,
    /// Noise per channel; its sampling period is that of the plans.
    pub noise: &'a Noise,
    /// Existing data, whose motions may be repeated.
    pub datasets: &'a [Dataset],
    /// Seed of the random motions.
    pub seed: u64,
}

impl Bench<'_> {
    /// All experiments that the machine can perform.
    pub fn catalogue(&self) -> Vec<Experiment> {
        let plant = Plant::new(self.model, &self.setup);
        let random = self.random();
        let mut all = Vec::new();
        let mut plan = |kind, what: String, course: &Course| all.extend(self.plan(kind, what, course));
        plan(Kind::Excitation, "another random periodic motion of the same kind".into(), &random);
        for course in self.sweeps(&plant) {
            plan(Kind::SlowSweep, "slow travel at constant speed, up and down over the workspace".into(), &course);
        }
        if let Some(poses) = self.poses(&plant) {
            let what = "static poses over the workspace, each reached from both sides".into();
            plan(Kind::StaticPoses, what, &Course::StaticPoses(poses));
        }
        for axis in 0..self.model.mechanism.axes() {
            let what = format!("fast reversals of axis {} alone", axis + 1);
            let found =
                self.reversals(&plant, axis).into_iter().find_map(|c| self.plan(Kind::Reversals, what.clone(), &c));
            all.extend(found);
        }
        all.extend(self.warm_up(&random));
        for (kind, speed, what) in [
            (Kind::HalfSpeed, 0.5, "the same motion at half the speed"),
            (Kind::DoubleSpeed, 2.0, "the same motion at double the speed"),
        ] {
            all.extend(self.again(kind, speed, what, self.setup, &self.channels));
        }
        if plant.assembled {
            all.extend(self.with_other_setups(&random));
        }
        all
    }

    /// The motion of the data, or a random one, with another setup: with or without payload, with strut sensors,
    /// disassembled.
    fn with_other_setups(&self, random: &Course) -> Vec<Experiment> {
        let mut all = Vec::new();
        let mut same = |kind, what: &str, setup: Setup, channels: &[Channel], alone| {
            let other = Bench { setup, channels: channels.to_vec(), ..*self };
            let planned =
                self.again(kind, 1.0, what, setup, channels).or_else(|| other.plan(kind, what.into(), random));
            all.extend(planned.map(|e| Experiment { alone, ..e }));
        };
        let (mass, com, inertia_zz) = KNOWN;
        let known = Payload::new(mass, com, inertia_zz);
        if self.setup.payload == Payload::default() {
            let what = format!("the same motion with a payload that was weighed, {mass} kg beside the axis");
            same(Kind::Payload, &what, Setup { payload: known, ..self.setup }, &self.channels, false);
        } else {
            let without = Setup { payload: Payload::default(), ..self.setup };
            same(Kind::NoPayload, "the same motion without the payload", without, &self.channels, false);
        }
        let sensors = [Channel::StrutUpper(0), Channel::StrutLower(0)];
        if sensors.iter().any(|c| !self.channels.contains(c)) {
            let drives = Channel::of_drives(self.model.mechanism);
            let channels: Vec<Channel> = drives.into_iter().chain(sensors).collect();
            let what = "the same motion with force sensors at both ends of strut 1";
            same(Kind::StrutSensor, what, self.setup, &channels, true);
        }
        let apart = Setup { configuration: Configuration::Disassembled, payload: Payload::default(), ..self.setup };
        let arms = Bench { setup: apart, channels: Channel::of_drives(self.model.mechanism), ..*self };
        let what = match self.model.mechanism.is_delta() {
            true => "two limbs and the telescope dismounted: the arms and motor 4 alone, then `--hold drive_friction`",
            false => "struts and plate dismounted: the arms alone, then `--hold drive_friction`",
        };
        all.extend(arms.plan(Kind::Disassembled, what.into(), random));
        all
    }

    fn random(&self) -> Course {
        let (frequency, harmonics) = FOURIER;
        Course::RandomFourier { seed: self.seed, frequency, harmonics, share: RANDOM_SHARE }
    }

    /// Experiment with the motion of a course; `None` if the machine cannot perform it.
    pub fn plan(&self, kind: Kind, what: String, course: &Course) -> Option<Experiment> {
        let plant = Plant::new(self.model, &self.setup);
        let motion = course.on(self.model, &self.setup).ok()?;
        let length = match course {
            Course::Fourier(series) => 1.0 / series.frequency,
            Course::RandomFourier { frequency, .. } => 1.0 / frequency,
            _ => course.length()?,
        };
        let at = |t: f64| motion.state(t).ok()?.joints(&plant.geometry).ok();
        let (dataset, weight) = self.sampled(&at, length)?;
        Some(Experiment { kind, what, course: Some(course.clone()), dataset, length, weight, alone: false })
    }

    fn warm_up(&self, random: &Course) -> Option<Experiment> {
        let plant = Plant::new(self.model, &self.setup);
        let motion = random.on(self.model, &self.setup).ok()?;
        let at = |t: f64| motion.state(t).ok()?.joints(&plant.geometry).ok();
        let (dataset, weight) = self.sampled(&at, WARM_UP)?;
        let what = format!("a long run from cold to warm, {:.0} minutes of any motion", WARM_UP / 60.0);
        Some(Experiment {
            kind: Kind::WarmUp,
            what,
            course: Some(random.clone()),
            dataset,
            length: WARM_UP,
            weight,
            alone: false,
        })
    }

    /// Experiment that repeats the longest segment of the data at `speed` times its speed.
    fn again(&self, kind: Kind, speed: f64, what: &str, setup: Setup, channels: &[Channel]) -> Option<Experiment> {
        let stretches = self.datasets.iter().flat_map(|t| t.segments.iter().map(move |s| (t, s.clone())));
        let (dataset, segment) = stretches.max_by_key(|(_, s)| s.len()).filter(|(_, s)| s.len() > 1)?;
        let last = segment.len() - 2;
        let at = |t: f64| {
            let place = speed * t / dataset.dt;
            let k = (place as usize).min(last);
            let (part, [a, b]) = (place - k as f64, [0, 1].map(|i| &dataset.joints[segment.start + k + i]));
            let mix = |a: f64, b: f64| a + part * (b - a);
            let joined = |f: fn(&JointState) -> &PerAxis<f64>, factor: f64| {
                std::array::from_fn(|i| factor * mix(f(a)[i], f(b)[i]))
            };
            Some(JointState {
                q: joined(|j| &j.q, 1.0),
                qd: joined(|j| &j.qd, speed),
                qdd: joined(|j| &j.qdd, speed * speed),
            })
        };
        let length = (segment.len() - 1) as f64 * dataset.dt / speed;
        let other = Bench { setup, channels: channels.to_vec(), ..*self };
        let (dataset, weight) = other.sampled(&at, length)?;
        Some(Experiment { kind, what: what.into(), course: None, dataset, length, weight, alone: false })
    }

    /// Slow motions of the platform, or of each axis of a disassembled robot.
    fn sweeps(&self, plant: &Plant) -> Vec<Course> {
        if !plant.assembled {
            let speeds = |axis: usize| [0.01, 0.05].map(|share| share * self.model.drives[axis].max_speed).to_vec();
            return (0..plant.mechanism.axes())
                .map(|axis| self.to_and_fro(plant, axis, 0.5, speeds(axis), 0.2))
                .map(Course::ConstantSpeed)
                .collect();
        }
        let turns = match plant.mechanism.plate_turns() {
            true => PLATE_TURN,
            false => f64::from(u8::from(plant.mechanism.has_telescope())),
        };
        let Some([radius, height]) = room(plant) else { return Vec::new() };
        let z = middle(plant);
        let point = |angle: f64, up: f64, psi: f64| {
            let (s, c) = (angle.to_radians()).sin_cos();
            [radius * c, radius * s, z + up * height, turns * psi]
        };
        let waypoints = vec![
            point(0.0, 1.0, 0.0),
            point(0.0, -1.0, 1.0),
            point(120.0, -1.0, -1.0),
            point(120.0, 1.0, 1.5),
            point(240.0, 1.0, 0.0),
            point(240.0, -1.0, -1.5),
        ];
        let path = |speed: f64| Path {
            waypoints: waypoints.clone(),
            blend: 0.0,
            speed,
            acceleration: 2.0,
            jerk: 50.0,
            turn_radius: 0.1,
            stops: Vec::new(),
            dwell: 0.1,
            closed: true,
            laps: 1,
        };
        [0.05, 0.2].map(|speed| Course::Path(path(speed))).to_vec()
    }

    /// Poses over the workspace, each approached by a small step from both sides.
    fn poses(&self, plant: &Plant) -> Option<StaticPoses> {
        const STEP: f64 = 0.03;
        let mut poses = Vec::new();
        if plant.assembled {
            let [radius, height] = room(plant)?;
            let z = middle(plant);
            for (angle, part, up) in [
                (0.0, 0.0, 0.0),
                (0.0, 1.0, 0.5),
                (60.0, 0.6, -0.7),
                (120.0, 1.0, -0.3),
                (180.0, 0.5, 0.8),
                (240.0, 1.0, 0.2),
                (300.0, 0.8, -0.6),
            ] {
                let (s, c) = f64::to_radians(angle).sin_cos();
                let (x, y, z) = (part * radius * c, part * radius * s, z + up * height);
                for step in [-STEP, 0.0, STEP, 0.0] {
                    poses.push([x + 0.5 * step, y + 0.5 * step, z + step, 0.0]);
                }
            }
        } else {
            let [low, high] = plant.geometry.arm_limits();
            for part in [0.5, 0.2, 0.35, 0.8, 0.65] {
                for step in [-STEP, 0.0, STEP, 0.0] {
                    poses.push(each(low + (part + step) * (high - low)));
                }
            }
            poses.iter_mut().for_each(|p| p[plant.mechanism.axes()..].fill(0.0));
        }
        Some(StaticPoses { poses, hold: 0.4, travel: 0.4 })
    }

    /// Fast motions of one axis in both directions, from the largest to the smallest amplitude.
    fn reversals(&self, plant: &Plant, axis: usize) -> Vec<Course> {
        let drive = self.model.drives[axis];
        let span = if axis < plant.mechanism.arms() { 1.0 } else { 3.0 };
        let runs = |size: f64| {
            let amplitude = size * span;
            let acceleration = 0.6 * drive.max_acceleration;
            // A ramp takes 1.5 v²/a of the distance; two of them must fit.
            let fastest = (amplitude * acceleration / 3.0).sqrt().min(0.6 * drive.max_speed);
            let speeds = [0.4, 0.7, 0.95].map(|share| share * fastest).to_vec();
            Course::ConstantSpeed(self.to_and_fro(plant, axis, size, speeds, 0.6))
        };
        [0.6, 0.4, 0.25, 0.12].map(runs).to_vec()
    }

    fn to_and_fro(&self, plant: &Plant, axis: usize, size: f64, speeds: Vec<f64>, share: f64) -> ConstantSpeed {
        let held = if plant.assembled { [0.0, 0.0, middle(plant), 0.0] } else { each(0.0) };
        let arms = plant.mechanism.arms();
        let centre = match plant.assembled && axis < arms {
            true => plant.geometry.inverse(&Vector3::new(0.0, 0.0, held[2]), 0.0).map_or(0.0, |q| q[axis]),
            false if axis < arms => plant.geometry.arm_limits().iter().sum::<f64>() / 2.0,
            false => 0.0,
        };
        let reach = size * if axis < arms { 0.5 } else { 1.5 };
        ConstantSpeed {
            axis,
            pose: held,
            between: [centre - reach, centre + reach],
            speeds,
            acceleration: share * self.model.drives[axis].max_acceleration,
            repeat: 2,
        }
    }

    /// Samples of the motion, and the ratio of its duration to the sampled one; `None` where a pose is unreachable.
    fn sampled(&self, at: &dyn Fn(f64) -> Option<JointState>, length: f64) -> Option<(Dataset, f64)> {
        let dt = self.noise.dt;
        let whole = (length / dt) as usize;
        let starts: Vec<f64> = match whole <= SAMPLES {
            true => vec![0.0],
            false => {
                let windows = SAMPLES / WINDOW;
                let room = length - WINDOW as f64 * dt;
                (0..windows).map(|w| room * w as f64 / (windows - 1) as f64).collect()
            }
        };
        let each = if whole <= SAMPLES { whole } else { WINDOW };
        let exact = Dataset::exact(self.model.mechanism, self.setup, self.channels.clone(), dt, Vec::new());
        let mut dataset = Dataset { segments: Vec::new(), ..exact };
        for start in starts {
            let first = dataset.len();
            for k in 0..each {
                let t = start + k as f64 * dt;
                dataset.t.push(t);
                dataset.joints.push(at(t)?);
            }
            dataset.segments.push(first..dataset.len());
        }
        dataset.measured = vec![vec![0.0; dataset.len()].into(); dataset.channels.len()];
        let covered = dataset.len() as f64 * dt;
        self.possible(&dataset).then_some((dataset, length / covered.max(dt)))
    }

    /// Whether a motion respects the limits of drives and sockets.
    fn possible(&self, dataset: &Dataset) -> bool {
        let plant = dataset.plant(self.model);
        let drives = &self.model.drives[..self.model.mechanism.axes()];
        let slow = |j: &JointState| {
            drives
                .iter()
                .enumerate()
                .all(|(i, d)| j.qd[i].abs() <= d.max_speed && j.qdd[i].abs() <= SHARE * d.max_acceleration)
        };
        let channels = Channel::of_drives(self.model.mechanism);
        let probe =
            Dataset { measured: vec![vec![0.0; dataset.len()].into(); channels.len()], channels, ..dataset.clone() };
        let strong = |loads: Vec<Vec<f64>>| {
            loads.iter().zip(drives).all(|(series, d)| series.iter().all(|x| x.abs() <= SHARE * d.max_torque))
        };
        let clamps = Clamps::watched(&self.model.sockets);
        let holds = |(t, joints): (&f64, &JointState)| {
            let margins = plant.motion(joints).and_then(|motion| clamps.along(&plant, *t, &motion));
            margins.is_ok_and(|(_, margins)| clamps.used(&margins).iter().all(|used| *used <= SHARE))
        };
        let held = || !plant.has(Part::Linkage) || dataset.t.iter().zip(&dataset.joints).all(holds);
        !dataset.is_empty() && dataset.joints.iter().all(slow) && predict(&plant, &probe).is_ok_and(strong) && held()
    }
}

/// Radius and half height, m, of a cylinder about the middle of the workspace, well inside it.
fn room(plant: &Plant) -> Option<[f64; 2]> {
    const PART: f64 = 0.6;
    let z = middle(plant);
    let inside = |radius: f64, up: f64| {
        (0..6).all(|k| {
            let (s, c) = (std::f64::consts::TAU * k as f64 / 6.0).sin_cos();
            let p = Vector3::new(radius * c, radius * s, z + up);
            plant.geometry.inverse(&p, 0.0).is_ok_and(|q| plant.geometry.check_limits(&q, &p).is_ok())
        })
    };
    let farthest = |fits: &dyn Fn(f64) -> bool| (1..=200).map(|k| 0.01 * f64::from(k)).take_while(|x| fits(*x)).last();
    let radius = PART * farthest(&|x| inside(x, 0.0))?;
    let height = PART * farthest(&|h| inside(radius, h) && inside(radius, -h))?;
    Some([radius, height])
}

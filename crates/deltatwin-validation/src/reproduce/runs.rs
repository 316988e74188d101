//! Recordings of all experiments: every scenario simulated on its variant of the robot, in parallel.

use std::path::Path;

use miette::{IntoDiagnostic, WrapErr};
use rayon::prelude::*;

use super::{paper, robot};
use deltatwin::dynamics::Plant;
use deltatwin::kinematics::JointState;
use deltatwin::model::Model;
use deltatwin::recording::Recording;
use deltatwin::scenario::Scenario;
use deltatwin::twin::{Options, simulate};
use deltatwin_io::outside::Access;
use deltatwin_io::{model, scenario};

/// A scenario on a machine.
pub struct Job {
    /// Name of the recording.
    pub name: String,
    scenario: Scenario,
    machine: Model,
    planning: Model,
}

/// Commanded motion and recording.
pub struct Run {
    /// Commanded joint motion at every sample.
    pub commanded: Vec<JointState>,
    /// Recording.
    pub recording: Recording,
}

impl Job {
    /// `scenario` on `machine`; `planning` is the model of its controller and motion planning.
    pub fn new(name: impl Into<String>, scenario: &Scenario, machine: Model, planning: &Model) -> Self {
        Self { name: name.into(), scenario: scenario.clone(), machine, planning: planning.clone() }
    }

    /// Simulated time, s.
    pub fn duration(&self) -> f64 {
        self.scenario.duration
    }

    /// Simulates the scenario; `seed` is combined with the scenario's own. `progress` receives the simulated time in
    /// s and returns false to stop.
    ///
    /// # Errors
    /// If the motion is impossible or the simulation stops.
    pub fn run(&self, seed: u64, progress: &mut dyn FnMut(f64) -> bool) -> miette::Result<Run> {
        let Self { scenario, machine, planning, .. } = self;
        let named = || self.name.clone();
        let motion = scenario.motion(planning).into_diagnostic().wrap_err_with(named)?;
        let options = Options {
            noise_seed: scenario.noise.then_some(scenario.seed.wrapping_add(seed.wrapping_mul(1000))),
            contacts: Some(deltatwin_cell::contacts),
            ..Options::of(scenario, planning)
        };
        let believed = Plant::new(planning, &scenario.setup);
        let wanted = |t: f64| motion.at(t);
        let run = simulate(machine, &scenario.setup, &believed, &wanted, &options, progress);
        let (mut recording, _) = run.into_diagnostic().wrap_err_with(named)?;
        recording.name = named();
        let commanded = recording.signals.t.iter().map(|t| motion.at(*t).joints(&planning.geometry));
        let commanded = commanded.collect::<Result<_, _>>().into_diagnostic().wrap_err_with(named)?;
        Ok(Run { commanded, recording })
    }
}

/// The robot and its recordings.
pub struct Campaign {
    /// Disassembled robot: arms and motor 4.
    pub disassembled: Model,
    /// Assembled robot with friction in its ball sockets.
    pub robot: Model,
    /// Assembled robot with frictionless ball sockets.
    pub free: Model,
    /// Model of the controller, which is the paper's.
    pub known: Model,
    /// Disassembled robot: excitation and verification.
    pub arms: [Run; 2],
    /// Disassembled robot at rest under each of [`paper::ARM_WEIGHTS`].
    pub rests: Vec<Run>,
    /// Axis 4 at constant speeds.
    pub constant_speed: Run,
    /// Excitation and verification with socket friction.
    pub assembled: [Run; 2],
    /// Excitation and verification without socket friction.
    pub assembled_free: [Run; 2],
    /// Vertical motion with the measurement strut.
    pub strut_force: Run,
}

/// Scenario files in the order of use.
const FILES: [&str; 7] = [
    "arms-excitation",
    "arms-verification",
    "arms-static",
    "friction-curve",
    "excitation",
    "verification",
    "strut-force",
];

impl Campaign {
    /// Simulates the scenarios of `folder` on all cores. `progress` receives the simulated time of all runs as a
    /// share of the total, and returns false to stop.
    ///
    /// # Errors
    /// If a scenario cannot be read, its motion is impossible or a simulation stops.
    ///
    /// # Panics
    /// Never: there are as many scenarios as files.
    pub fn run(folder: &Path, seed: u64, progress: &(dyn Fn(f64) -> bool + Sync)) -> miette::Result<Self> {
        let read = |name: &str| {
            scenario::read_with(&folder.join(name).with_extension("toml"), Access::with(deltatwin_cell::mesh::read))
        };
        let scenarios = FILES.iter().map(|f| read(f)).collect::<Result<Vec<_>, _>>()?;
        let [arms, arms_check, rest, curve, excitation, verification, strut] = &scenarios[..] else {
            unreachable!("as many scenarios as files")
        };
        let known = model::read(excitation.controller_model.as_ref().unwrap_or(&excitation.model))?;
        let disassembled = model::read(&arms.model)?;
        let robot = robot::one_machine(model::read(&excitation.model)?, &disassembled);
        let free = robot::without_socket_friction(&robot);
        let measuring = robot::with_measurement_strut(&robot);
        let mut jobs = vec![
            Job::new("arms-excitation", arms, disassembled.clone(), &disassembled),
            Job::new("arms-verification", arms_check, disassembled.clone(), &disassembled),
            Job::new("friction-curve", curve, robot.clone(), &known),
            Job::new("excitation", excitation, robot.clone(), &known),
            Job::new("verification", verification, robot.clone(), &known),
            Job::new("excitation-free-sockets", excitation, free.clone(), &known),
            Job::new("verification-free-sockets", verification, free.clone(), &known),
            Job::new("strut-force", strut, measuring, &known),
        ];
        jobs.extend(paper::ARM_WEIGHTS.map(|mass| {
            Job::new(format!("arms-static-{mass}kg"), rest, robot::with_arm_weights(&disassembled, mass), &disassembled)
        }));
        let mut runs = all(&jobs, seed, progress)?.into_iter();
        let mut next = || runs.next().expect("a run per job");
        Ok(Self {
            arms: [next(), next()],
            constant_speed: next(),
            assembled: [next(), next()],
            assembled_free: [next(), next()],
            strut_force: next(),
            rests: runs.collect(),
            disassembled,
            robot,
            free,
            known,
        })
    }

    /// All recordings.
    pub fn recordings(&self) -> impl Iterator<Item = &Recording> {
        let runs = self.arms.iter().chain(&self.rests).chain([&self.constant_speed]);
        runs.chain(&self.assembled).chain(&self.assembled_free).chain([&self.strut_force]).map(|r| &r.recording)
    }
}

fn all(jobs: &[Job], seed: u64, progress: &(dyn Fn(f64) -> bool + Sync)) -> miette::Result<Vec<Run>> {
    let total: f64 = jobs.iter().map(Job::duration).sum();
    // Longest first for an even load of the cores.
    let mut order: Vec<usize> = (0..jobs.len()).collect();
    order.sort_by(|&a, &b| jobs[b].duration().total_cmp(&jobs[a].duration()));
    let one = |k: &usize| {
        let mut last = 0.0;
        let run = jobs[*k].run(seed.wrapping_mul(100).wrapping_add(*k as u64), &mut |t| {
            let done = (t - last) / total;
            last = t;
            progress(done)
        });
        run.map(|run| (*k, run))
    };
    let mut runs: Vec<(usize, Run)> = order.par_iter().with_max_len(1).map(one).collect::<miette::Result<_>>()?;
    runs.sort_by_key(|(k, _)| *k);
    Ok(runs.into_iter().map(|(_, run)| run).collect())
}

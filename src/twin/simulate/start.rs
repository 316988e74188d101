//! Start of a run: checks of machine and options, contact solver, equilibrium.

use super::{Reported, Run, pose};
use crate::cell::CellError;
use crate::dynamics::{Plant, inverse_dynamics};
use crate::kinematics::{JointState, KinematicsError, Motion, Target};
use crate::machine::bodies::{SLOTS, body_name};
use crate::machine::{PerAxis, Setup, each, every_axis, every_strut};
use crate::model::Model;
use crate::scenario::SUBSTEPS;
use crate::twin::contacts::{Contacts, Surroundings};
use crate::twin::controller::{Controller, Gains};
use crate::twin::machine::{Checkpoint, Twin};
use crate::twin::sensors::Sensors;
use crate::twin::sockets::Clamps;
use crate::twin::torque::Torque;
use crate::twin::wrench::STILL;
use crate::twin::{Cause, Options, Report, SimulationError};

/// Negative eigenvalue of a pseudo-inertia, relative to the body's magnitude, beyond rounding errors.
const IMPOSSIBLE: f64 = 1e-9;

impl<'a> Run<'a> {
    pub(super) fn new(
        model: &'a Model,
        setup: &Setup,
        controller_plant: &'a Plant,
        desired: &'a dyn Fn(f64) -> Target,
        options: &'a Options,
    ) -> Result<Self, SimulationError> {
        if let Some(what) = setup.load.misfit(model.mechanism) {
            return Err(SimulationError::Load { what });
        }
        let plant = Plant::new(model, setup);
        let trajectory = |reason| SimulationError::Trajectory { t: 0.0, reason };
        let fitted = |s: usize| options.sensors.strut_upper[s] || options.sensors.strut_lower[s];
        let struts = plant.mechanism.struts();
        if let Some(s) = (struts..every_strut().end).find(|&s| plant.assembled && fitted(s)) {
            return Err(SimulationError::NoStrut { strut: s + 1, struts });
        }
        possible(options, &plant)?;
        let wanted = desired(0.0).joints(&plant.geometry).map_err(trajectory)?;
        let (joints, deflection) = balance(&plant, &wanted).map_err(trajectory)?;
        let motion = plant.motion(&joints).map_err(trajectory)?;
        for (body, inertia) in plant.bodies.0.iter().enumerate() {
            let size = inertia.mass.max(inertia.tensor.trace());
            if inertia.min_eigenvalue() < -IMPOSSIBLE * size.max(1e-3) {
                return Err(SimulationError::Body { body: body_name(body) });
            }
        }
        let contacts = contacts(options, &plant, &motion).map_err(|reason| SimulationError::Cell { t: 0.0, reason })?;
        let assembled = plant.assembled;
        let mut twin =
            Twin::formulated(plant, &motion, options.formulation).map_err(|_| singular_start(&motion, assembled))?;
        twin.deflect_gears(&deflection);
        let step = model.sample_time * options.control_period as f64;
        let controller =
            Controller::new(controller_plant, model.drives, options.gains.unwrap_or_else(|| Gains::of(model)), step);
        let torque = Torque::constant(controller.feed_forward(&wanted).map_err(trajectory)?);
        let clamps = match options.clamps {
            _ if !assembled => Clamps::none(),
            Some(clamps) => clamps,
            None => Clamps::watched(&model.sockets),
        };
        let exists = |s: usize| twin.plant().sockets().contains(s);
        let min_margin = std::array::from_fn(|s| if exists(s) { clamps.hold[s] } else { f64::INFINITY });
        let sensors = Sensors::new(model, setup, options.sensors, assembled, options.noise_seed);
        Ok(Self {
            options,
            desired,
            period: model.sample_time,
            kept: Vec::new(),
            signals: sensors.channels(),
            reported: Reported::new(twin.plant(), model.sample_time),
            twin,
            controller,
            sensors,
            clamps,
            contacts,
            held: None,
            next_action: 0,
            torque,
            wanted,
            tripped: false,
            checkpoint: Checkpoint::default(),
            contact: [STILL; SLOTS],
            strongest: Vec::new(),
            touching: Vec::new(),
            rest_since: None,
            rested: false,
            known: None,
            pace: model.sample_time / options.substeps as f64,
            fineness: (SUBSTEPS as f64 / options.substeps as f64).min(1.0),
            finest: None,
            work: Vec::new(),
            turned_over: 0.0,
            frames: 0,
            watched: 0,
            report: Report { min_margin, ..Report::default() },
        })
    }
}

/// Rejects options that need parts a disassembled machine lacks, and multipliers whose rows have no names.
fn possible(options: &Options, plant: &Plant) -> Result<(), SimulationError> {
    let fitted = &options.sensors;
    if plant.assembled {
        return match fitted.multipliers && !plant.is_closed_delta() {
            true => Err(SimulationError::NotThreeLimbs { what: "multipliers of constraints" }),
            false => Ok(()),
        };
    }
    let struts = fitted.strut_upper.iter().chain(&fitted.strut_lower).any(|s| *s);
    let missing = [
        ("objects and what a gripper does", !options.objects.is_empty() || !options.actions.is_empty()),
        ("sockets that may leave their balls", options.clamps.is_some_and(|c| c.armed)),
        ("margins of sockets", fitted.sockets),
        ("strut force sensors", struts),
    ];
    missing.into_iter().find(|(_, asked)| *asked).map_or(Ok(()), |(what, _)| Err(SimulationError::Missing { what }))
}

/// Contact solver of a run; `None` if contacts are impossible.
fn contacts(options: &Options, plant: &Plant, start: &Motion) -> Result<Option<Box<dyn Contacts>>, CellError> {
    if options.objects.is_empty() && !options.clamps.is_some_and(|c| c.armed) {
        return Ok(None);
    }
    let Some(new) = options.contacts else {
        return if options.objects.is_empty() { Ok(None) } else { Err(CellError::NoContacts) };
    };
    let surroundings = Surroundings {
        objects: &options.objects,
        payload: options.payload_shape.as_ref(),
        geometry: &plant.geometry,
        gravity: plant.gravity_vector(),
        bodies: &plant.bodies,
        start,
    };
    new(&surroundings).map(Some)
}

/// Joint state in equilibrium with encoder readings `wanted`, and the deflections of elastic gears, rad: compliance
/// times transmitted torque.
fn balance(plant: &Plant, wanted: &JointState) -> Result<(JointState, PerAxis<f64>), KinematicsError> {
    let mut own = plant.steady_states(0.0, &plant.motion(wanted)?);
    let mut deflection: PerAxis<f64> = each(0.0);
    for (k, active) in plant.effects.iter().enumerate() {
        let Some(gears) = active.gear_springs() else { continue };
        let states: Vec<&[f64]> = own.iter().map(Vec::as_slice).collect();
        let torque = inverse_dynamics(plant, 0.0, &plant.motion(wanted)?, &states, false)?.tau;
        for (i, gear) in gears.iter().enumerate().filter(|(_, g)| g.is_elastic()) {
            deflection[i] = gear.compliance * (torque[i] - gear.rotor_inertia * wanted.qdd[i]);
        }
        own[k][every_axis()].copy_from_slice(&deflection);
    }
    let mut joints = plant.behind_encoders(wanted);
    for (q, deflection) in joints.q.iter_mut().zip(deflection) {
        *q -= deflection;
    }
    Ok((joints, deflection))
}

fn singular_start(motion: &Motion, assembled: bool) -> SimulationError {
    SimulationError::Singular { t: 0.0, pose: pose(motion, assembled), cause: Cause::Rank }
}

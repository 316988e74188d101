//! Instants for unit tests of effects.

use nalgebra::Vector3;

use super::interface::default_values;
use super::{Effect, Host, Instant, Layout, Values, Wrenches};
use crate::kinematics::{BodyMotion, JointState, Motion, Reactions, SocketSet, Telescope};
use crate::machine::bodies::SLOTS;
use crate::machine::{Bodies, Geometry, Inertia, Payload};

/// A wrench written by a law: parameter, body, force, moment.
pub(super) type Written = (usize, usize, Vector3<f64>, Vector3<f64>);

/// All bodies at rest at the origin, struts and telescope along z.
pub(crate) fn still() -> Motion {
    let mut motion = Motion::disassembled(&Geometry::single([0.0; 2]), &JointState::default());
    motion.bodies.fill(BodyMotion::REST);
    motion.strut_axis.fill(Vector3::z());
    motion.strut_length.fill(1.0);
    motion.telescope = Telescope { axis: Vector3::z(), length: 1.0, rate: 0.0 };
    motion
}

pub(super) fn no_bodies() -> Bodies {
    Bodies([Inertia::ZERO; SLOTS])
}

/// The wrenches per unit of the parameters.
pub(super) fn wrenches(effect: &dyn Effect, motion: &Motion, reactions: &Reactions) -> Vec<Written> {
    wrenches_with(effect, motion, reactions, &no_bodies())
}

pub(super) fn wrenches_with(
    effect: &dyn Effect,
    motion: &Motion,
    reactions: &Reactions,
    bodies: &Bodies,
) -> Vec<Written> {
    let (values, layout) = absent(effect);
    let state = effect.states().map_or_else(Vec::new, |own| own.initial_state(&Values::new(&values, &layout)));
    write(
        effect,
        &Instant {
            t: 0.0,
            motion,
            geometry: &crate::machine::testing::geometry(),
            bodies,
            payload: &Payload::default(),
            gravity: 9.81,
            reactions,
            state: &state,
            torque: [0.0; 4],
            load: None,
            closed: SocketSet::ALL,
        },
    )
}

pub(super) fn wrenches_in_state(effect: &dyn Effect, motion: &Motion, state: &[f64]) -> Vec<Written> {
    let (bodies, reactions) = (no_bodies(), Reactions::default());
    write(
        effect,
        &Instant {
            t: 0.0,
            motion,
            geometry: &crate::machine::testing::geometry(),
            bodies: &bodies,
            payload: &Payload::default(),
            gravity: 9.81,
            reactions: &reactions,
            state,
            torque: [0.0; 4],
            load: None,
            closed: SocketSet::ALL,
        },
    )
}

/// Calls `read` with an instant of the given motion and internal states, without torques and reactions.
pub(super) fn at(motion: &Motion, state: &[f64], read: impl FnOnce(&Instant)) {
    read(&Instant {
        t: 0.0,
        motion,
        geometry: &crate::machine::testing::geometry(),
        bodies: &no_bodies(),
        payload: &Payload::default(),
        gravity: 9.81,
        reactions: &Reactions::default(),
        state,
        torque: [0.0; 4],
        load: None,
        closed: SocketSet::ALL,
    });
}

/// Flat values of an effect with default shape parameters on the four-axis robot, without action.
fn absent(effect: &dyn Effect) -> (Vec<f64>, Layout) {
    default_values(effect, Host::default())
}

fn write(effect: &dyn Effect, at: &Instant) -> Vec<Written> {
    let (values, layout) = absent(effect);
    let mut seen = Vec::new();
    effect.wrenches(
        &Values::new(&values, &layout),
        at,
        &mut Wrenches::new(at.motion, &mut |k, b, f, m| seen.push((k, b, f, m))),
    );
    seen
}

/// Sum of the unit torques on drive `axis`.
pub(super) fn drive_torque(effect: &dyn Effect, motion: &Motion, axis: usize) -> f64 {
    let (body, screw) = motion.drive(axis);
    let all = wrenches(effect, motion, &Reactions::default());
    all.iter().filter(|(_, b, ..)| *b == body).map(|(.., m)| m.dot(&screw.angular)).sum()
}

/// Total force and moment on every body for given parameter values, without payload.
pub(super) fn totals(effect: &dyn Effect, blocks: &[&[f64]], motion: &Motion) -> [(Vector3<f64>, Vector3<f64>); SLOTS] {
    carrying(effect, blocks, motion, Payload::default())
}

/// Total force and moment on every body for given parameter values, with a payload.
pub(super) fn carrying(
    effect: &dyn Effect,
    blocks: &[&[f64]],
    motion: &Motion,
    payload: Payload,
) -> [(Vector3<f64>, Vector3<f64>); SLOTS] {
    let (values, layout) = (blocks.concat(), Layout::new(blocks.iter().map(|b| b.len())));
    let (bodies, reactions) = (no_bodies(), Reactions::default());
    let at = Instant {
        t: 0.0,
        motion,
        geometry: &crate::machine::testing::geometry(),
        bodies: &bodies,
        payload: &payload,
        gravity: 9.81,
        reactions: &reactions,
        state: &[],
        torque: [0.0; 4],
        load: None,
        closed: SocketSet::ALL,
    };
    let mut sum = [(Vector3::zeros(), Vector3::zeros()); SLOTS];
    effect.wrenches(
        &Values::new(&values, &layout),
        &at,
        &mut Wrenches::new(at.motion, &mut |k, b, f, m| {
            sum[b].0 += f * values[k];
            sum[b].1 += m * values[k];
        }),
    );
    sum
}

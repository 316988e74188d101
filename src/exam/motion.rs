//! Motions of campaigns, drawn at random within a share of the drives' limits.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use crate::dynamics::{Plant, inverse_dynamics};
use crate::kinematics::Target;
use crate::model::{ARMS, Model};
use crate::scenario::motion::path::Path;
use crate::scenario::motion::polynomial::Piecewise;
use crate::scenario::{FourierMotion, MotionLimits};

/// What the robot does in a campaign.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, clap::ValueEnum)]
pub enum MotionKind {
    /// A random Fourier series.
    #[default]
    Fourier,
    /// Travel along random waypoints with blended corners, round and round: a working robot.
    Cycle,
}

impl MotionKind {
    /// Name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fourier => "fourier",
            Self::Cycle => "cycle",
        }
    }
}

/// A drawn motion.
pub enum Motion {
    /// A Fourier series.
    Fourier(FourierMotion),
    /// Polynomials of (x, y, z, ψ).
    Cycle(Piecewise),
}

/// Base frequency, Hz, and harmonics of the excitation.
const FOURIER: (f64, usize) = (0.1, 10);
/// Share of the drives' limits a motion may use.
const SHARE: f64 = 0.45;
/// Waypoints of a cycle, and half of the box they lie in: m, m, m, rad.
const WAYPOINTS: usize = 6;
const BOX: [f64; 4] = [0.35, 0.35, 0.1, 2.0];
/// Largest speed, acceleration and jerk of the first try; later ones are slower.
const FASTEST: (f64, f64, f64) = (3.0, 40.0, 2000.0);
/// Spacing of the instants at which a cycle is checked, s.
const SPACING: f64 = 2e-3;

impl Motion {
    /// Draws a motion of `kind` for `plant`, of a machine like `model`.
    pub fn draw(kind: MotionKind, model: &Model, plant: &Plant, rng: &mut ChaCha8Rng) -> Self {
        let limits = MotionLimits::of(model, SHARE);
        match kind {
            MotionKind::Fourier => Self::Fourier(FourierMotion::random(plant, &limits, FOURIER.0, FOURIER.1, rng)),
            MotionKind::Cycle => Self::Cycle(cycle(plant, &limits, rng)),
        }
    }

    /// Where the robot is to be at time `t`, s.
    pub fn at(&self, t: f64) -> Target {
        match self {
            Self::Fourier(series) => series.at(t).into(),
            Self::Cycle(course) => {
                let [p, v, a] = course.at(t);
                crate::kinematics::PlatformState {
                    position: p.xyz(),
                    velocity: v.xyz(),
                    acceleration: a.xyz(),
                    psi: [p[3], v[3], a[3]],
                }
                .into()
            }
        }
    }
}

/// A closed path through random waypoints, slower and smaller until it stays within the limits.
fn cycle(plant: &Plant, limits: &MotionLimits, rng: &mut ChaCha8Rng) -> Piecewise {
    // The middle of the workspace is where a Fourier series turns about.
    let centre = FourierMotion::random(plant, limits, 1.0, 0, rng).centre;
    let psi = if plant.mechanism.has_telescope() { BOX[3] } else { 0.0 };
    let half = [BOX[0], BOX[1], BOX[2], psi];
    let corners: Vec<[f64; 4]> =
        (0..WAYPOINTS).map(|_| half.map(|h| if h > 0.0 { rng.random_range(-h..h) } else { 0.0 })).collect();
    let (mut size, mut pace) = (1.0, 1.0);
    loop {
        let waypoints = corners.iter().map(|c| std::array::from_fn(|i| centre[i] + size * c[i])).collect();
        let course = Path {
            waypoints,
            blend: 0.05,
            speed: FASTEST.0 * pace,
            acceleration: FASTEST.1 * pace * pace,
            jerk: FASTEST.2 * pace * pace * pace,
            turn_radius: 0.15,
            stops: vec![WAYPOINTS / 2],
            dwell: 0.1,
            closed: true,
            laps: 1000,
        }
        .course();
        match beyond(&course, plant, limits) {
            Some(Beyond::Reach) if size > 0.05 => size *= 0.9,
            Some(Beyond::Drives) if pace > 0.05 => pace *= 0.9,
            _ => return course,
        }
    }
}

enum Beyond {
    Reach,
    Drives,
}

fn beyond(course: &Piecewise, plant: &Plant, limits: &MotionLimits) -> Option<Beyond> {
    let states: Vec<Vec<f64>> = plant.effects.iter().map(|a| a.effect.initial_state(&a.values())).collect();
    let states: Vec<&[f64]> = states.iter().map(Vec::as_slice).collect();
    let steps = (course.lap() / SPACING).ceil() as usize;
    for k in 0..steps {
        let t = k as f64 * SPACING;
        let [p, v, a] = course.at(t);
        let platform = crate::kinematics::PlatformState {
            position: p.xyz(),
            velocity: v.xyz(),
            acceleration: a.xyz(),
            psi: [p[3], v[3], a[3]],
        };
        let Ok(joints) = plant.geometry.inverse_motion(&platform) else { return Some(Beyond::Reach) };
        if plant.geometry.check_limits(&joints.q, &platform.position).is_err() {
            return Some(Beyond::Reach);
        }
        let torque = plant.motion(&joints).and_then(|m| inverse_dynamics(plant, t, &m, &states, false));
        let Ok(torque) = torque.map(|out| out.tau) else { return Some(Beyond::Reach) };
        let over = |i: usize| {
            joints.qd[i].abs() > limits.speed[i]
                || (i < ARMS && joints.qdd[i].abs() > limits.acceleration[i])
                || torque[i].abs() > limits.torque[i]
        };
        if (0..plant.mechanism.axes()).any(over) {
            return Some(Beyond::Drives);
        }
    }
    None
}

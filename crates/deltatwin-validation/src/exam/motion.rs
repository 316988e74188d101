//! Random motions of campaigns within a share of the drives' limits.

use nalgebra::Vector4;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use deltatwin::dynamics::{Plant, steady_inverse_dynamics};
use deltatwin::kinematics::{PlatformState, Target};
use deltatwin::model::Model;
use deltatwin::scenario::motion::fourier::LEAST_DETERMINACY;
use deltatwin::scenario::motion::path::Path;
use deltatwin::scenario::motion::polynomial::Piecewise;
use deltatwin::scenario::{FourierMotion, MotionLimits};

/// Kind of motion of a campaign.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, clap::ValueEnum)]
pub enum MotionKind {
    /// A random Fourier series up to 1 Hz, as in the demo: wide and slow.
    Fourier,
    /// A random Fourier series up to 2.5 Hz: fast enough for everything that inertia does.
    #[default]
    Wideband,
    /// Travel along random waypoints with blended corners, round and round: a working robot.
    Cycle,
}

impl MotionKind {
    /// All kinds.
    pub const ALL: [Self; 3] = [Self::Fourier, Self::Wideband, Self::Cycle];

    /// Name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fourier => "fourier",
            Self::Wideband => "wideband",
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

/// Base frequency, Hz, and number of harmonics of the slow and of the wideband series.
const FOURIER: (f64, usize) = (0.1, 10);
const WIDEBAND: (f64, usize) = (0.05, 50);
/// Usable share of the drives' limits in the demo, and otherwise.
const DEMO_SHARE: f64 = 0.45;
const SHARE: f64 = 0.7;
/// Number of waypoints of a cycle, and half the size of their box: m, m, m, rad.
const WAYPOINTS: usize = 6;
const BOX: [f64; 4] = [0.35, 0.35, 0.1, 2.0];
/// Speed (m/s), acceleration (m/s²) and jerk (m/s³) of the first trial; later ones are slower.
const FASTEST: (f64, f64, f64) = (3.0, 40.0, 2000.0);
/// Spacing of the instants at which a motion is checked, s.
const SPACING: f64 = 2e-3;

impl Motion {
    /// Random motion of `kind` for `plant`, a machine like `model`.
    pub fn draw(kind: MotionKind, model: &Model, plant: &Plant, rng: &mut ChaCha8Rng) -> Self {
        let limits = MotionLimits::of(model, SHARE);
        match kind {
            MotionKind::Fourier => {
                let limits = MotionLimits::of(model, DEMO_SHARE);
                Self::Fourier(FourierMotion::random(plant, &limits, FOURIER.0, FOURIER.1, rng))
            }
            MotionKind::Wideband => Self::Fourier(wideband(plant, &limits, rng)),
            MotionKind::Cycle => Self::Cycle(cycle(plant, &limits, rng)),
        }
    }

    /// Target of the robot at time `t`, s.
    pub fn at(&self, t: f64) -> Target {
        match self {
            Self::Fourier(series) => series.at(t).into(),
            Self::Cycle(course) => platform(course.at(t)).into(),
        }
    }
}

fn platform([p, v, a]: [Vector4<f64>; 3]) -> PlatformState {
    PlatformState { position: p.xyz(), velocity: v.xyz(), acceleration: a.xyz(), psi: [p[3], v[3], a[3]] }
}

/// Amplitude of ψ, rad: `free` with a telescope, within the reach of a plate that turns the end effector, else zero.
fn turning(plant: &Plant, free: f64) -> f64 {
    match plant.mechanism {
        machine if machine.has_telescope() => free,
        machine if machine.plate_turns() => 0.6,
        _ => 0.0,
    }
}

/// Random centre of a motion near the middle of the workspace.
fn centre(plant: &Plant, limits: &MotionLimits, rng: &mut ChaCha8Rng) -> [f64; 4] {
    FourierMotion::random(plant, limits, 1.0, 0, rng).centre
}

/// Series with harmonics of equal amplitude for the platform and decreasing amplitude for axis 4, scaled to the
/// limits.
fn wideband(plant: &Plant, limits: &MotionLimits, rng: &mut ChaCha8Rng) -> FourierMotion {
    let (frequency, harmonics) = WIDEBAND;
    let psi = turning(plant, 6.0);
    let mut draw = |k: usize| [0.08, 0.08, 0.03, psi / (1.0 + k as f64)].map(|size| size * rng.random_range(-1.0..1.0));
    let sine = (0..harmonics).map(&mut draw).collect();
    let cosine = (0..harmonics).map(&mut draw).collect();
    let mut motion = FourierMotion { frequency, centre: centre(plant, limits, rng), sine, cosine };
    for _ in 0..200 {
        let coordinates = match beyond(&|t| motion.at(t), 1.0 / frequency, plant, limits) {
            None => break,
            Some(Beyond::Reach) if plant.mechanism.plate_turns() => 0..4,
            Some(Beyond::Reach) => 0..3,
            // An eccentric payload loads the arms when axis 4 accelerates it.
            Some(Beyond::Arms) => 0..4,
            Some(Beyond::Axis4) => 3..4,
        };
        for row in motion.sine.iter_mut().chain(&mut motion.cosine) {
            row[coordinates.clone()].iter_mut().for_each(|x| *x *= 0.93);
        }
    }
    motion
}

/// A closed path through random waypoints, reduced in speed and size until it respects the limits.
fn cycle(plant: &Plant, limits: &MotionLimits, rng: &mut ChaCha8Rng) -> Piecewise {
    let centre = centre(plant, limits, rng);
    let psi = turning(plant, BOX[3]);
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
        match beyond(&|t| platform(course.at(t)), course.lap(), plant, limits) {
            Some(Beyond::Reach) if size > 0.05 => size *= 0.9,
            Some(Beyond::Arms | Beyond::Axis4) if pace > 0.05 => pace *= 0.9,
            _ => return course,
        }
    }
}

/// Limit that a motion violates.
enum Beyond {
    Reach,
    Arms,
    Axis4,
}

fn beyond(at: &dyn Fn(f64) -> PlatformState, length: f64, plant: &Plant, limits: &MotionLimits) -> Option<Beyond> {
    let arms = plant.mechanism.arms();
    for k in 0..(length / SPACING).ceil() as usize {
        let t = k as f64 * SPACING;
        let platform = at(t);
        let Ok(joints) = plant.geometry.inverse_motion(&platform) else { return Some(Beyond::Reach) };
        if plant.geometry.check_limits(&joints.q, &platform.position).is_err() {
            return Some(Beyond::Reach);
        }
        let held = plant.geometry.determinacy(&platform.position, platform.psi[0]);
        if held.is_err() || held.is_ok_and(|share| share < LEAST_DETERMINACY) {
            return Some(Beyond::Reach);
        }
        let torque = plant.motion(&joints).and_then(|m| steady_inverse_dynamics(plant, t, &m, false));
        let Ok(torque) = torque.map(|out| out.tau) else { return Some(Beyond::Reach) };
        let over = |i: usize| {
            joints.qd[i].abs() > limits.speed[i]
                || (i < arms && joints.qdd[i].abs() > limits.acceleration[i])
                || torque[i].abs() > limits.torque[i]
        };
        if (0..arms).any(over) {
            return Some(Beyond::Arms);
        }
        if (arms..plant.mechanism.axes()).any(over) {
            return Some(Beyond::Axis4);
        }
    }
    None
}

//! Kinematic error of the gears: joint angles that deviate periodically from the motor angles.

use super::{About, Count, Effect, Kind, MachineView, Parameter, Part, Role, Sensor, Spec, Unit, Values};
use crate::kinematics::JointState;
use crate::machine::PerAxis;

/// Joint angle q = θ + e(θ) of an arm, e = Σ_h a_h·sin(h·n·θ) + b_h·cos(h·n·θ), harmonics h = 1, 2.
///
/// θ is the encoder's angle on the motor side, at the gear output (rad); a_h and b_h in rad, either sign; n the gear
/// ratio. Rates and accelerations follow by the chain rule: q̇ = (1 + e′)·θ̇, q̈ = (1 + e′)·θ̈ + e″·θ̇². With e of the size of
/// a minute of arc, e″·θ̇² moves the arm noticeably. The torque's share e′ of at most some thousandths, by which the
/// lever of the gear changes, is neglected: no work is done.
pub struct TransmissionError;

/// Parameter blocks of the sine and cosine amplitudes, per harmonic.
const HARMONICS: [(usize, usize); 2] = [(0, 1), (2, 3)];
const GEAR_RATIO: usize = 4;

const fn amplitude(name: &'static str) -> Parameter {
    Parameter::new(name, Unit::Rad, Role::Linear, 5e-5, (-2e-3, 2e-3)).counted(Count::PerArm)
}

const PARAMETERS: &[Parameter] = &[
    amplitude("sine_1"),
    amplitude("cosine_1"),
    amplitude("sine_2"),
    amplitude("cosine_2"),
    Parameter::new("gear_ratio", Unit::GearRatio, Role::Fixed, 33.0, (1e-3, 1e5)),
];

static SPEC: Spec = Spec::new(
    "transmission_error",
    Part::Drives,
    About {
        summary: "the arm gears turn unevenly over the motor angle",
        law: "q_i = θ_i + Σ_{h=1,2} a_h,i·sin(h·n·θ_i) + b_h,i·cos(h·n·θ_i), θ the encoder's angle, n the gear ratio",
        shows: "residual periodic in the joint angle with 360°/n that grows with the square of the speed",
        source: "transmission accuracy of precision gears, 0.2–1 minute of arc in data sheets (estimate)",
    },
    PARAMETERS,
)
.kind(Kind::Encoder)
.constants(constant);

fn constant(parameter: &str, model: &MachineView) -> Option<f64> {
    match parameter {
        "gear_ratio" => Some(model.drives[0].gear_ratio),
        _ => None,
    }
}

/// Steps in which the encoder's angle is found, and change (rad) at which it is.
const MOST_STEPS: usize = 30;
const FOUND: f64 = 1e-16;

/// e, e′ and e″ of `arm` at the encoder's angle.
fn error(values: &Values, arm: usize, angle: f64) -> [f64; 3] {
    let mut out = [0.0; 3];
    for (h, (sine, cosine)) in HARMONICS.into_iter().enumerate() {
        let order = (h + 1) as f64 * values.one(GEAR_RATIO);
        let (s, c) = (order * angle).sin_cos();
        let (a, b) = (values.block(sine)[arm], values.block(cosine)[arm]);
        let wave = a * s + b * c;
        out[0] += wave;
        out[1] += order * (a * c - b * s);
        out[2] -= order * order * wave;
    }
    out
}

impl Effect for TransmissionError {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn sensor(&self) -> Option<&dyn Sensor> {
        Some(self)
    }
}

impl Sensor for TransmissionError {
    fn encoder(&self, values: &Values, _state: &[f64], angles: &mut PerAxis<f64>) {
        for (arm, angle) in angles.iter_mut().enumerate().take(values.len(0)) {
            let joint = *angle;
            for _ in 0..MOST_STEPS {
                let [e, slope, _] = error(values, arm, *angle);
                let change = (joint - *angle - e) / (1.0 + slope);
                *angle += change;
                if change.abs() <= FOUND * (1.0 + angle.abs()) {
                    break;
                }
            }
        }
    }

    fn joint(&self, values: &Values, motion: &mut JointState) {
        for arm in 0..values.len(0) {
            let [e, slope, curvature] = error(values, arm, motion.q[arm]);
            let rate = motion.qd[arm];
            motion.q[arm] += e;
            motion.qd[arm] += slope * rate;
            motion.qdd[arm] += slope * motion.qdd[arm] + curvature * rate * rate;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::ActiveEffect;

    fn uneven() -> ActiveEffect {
        let zero = [0.0; 3];
        ActiveEffect::new(Arc::new(TransmissionError), &[&[1e-3, 0.0, 0.0], &zero, &zero, &[0.0, 5e-4, 0.0], &[33.0]])
    }

    #[test]
    fn a_quarter_of_a_motor_turn() {
        // Motor 1 at 90°, motor 2 at 45°: e = 1 mrad·sin 90° and 0.5 mrad·cos 90°; e′ = 33·1e-3·cos 90° = 0 and −66·5e-4·sin
        // 90° = −0.033; e″ = −33²·1e-3 = −1.089 and 0, at 2 rad/s −4.356 rad/s².
        let quarter = std::f64::consts::FRAC_PI_2 / 33.0;
        let mut motion = JointState {
            q: [quarter, 0.5 * quarter, 0.1, 0.1],
            qd: [2.0, 2.0, 2.0, 2.0],
            qdd: [10.0, 10.0, 10.0, 10.0],
        };
        let active = uneven();
        active.joint(&mut motion);
        let near = |found: f64, wanted: f64| approx::assert_relative_eq!(found, wanted, epsilon = 1e-12);
        near(motion.q[0], quarter + 1e-3);
        near(motion.q[1], 0.5 * quarter);
        near(motion.qd[0], 2.0);
        near(motion.qd[1], 2.0 * (1.0 - 0.033));
        near(motion.qdd[0], 10.0 - 4.356);
        near(motion.qdd[1], 10.0 * (1.0 - 0.033));
        assert_eq!((motion.q[2], motion.qd[3], motion.qdd[2]), (0.1, 2.0, 10.0));
    }

    /// Two differences of the angles along θ = 0.3·sin 7t are the rates and accelerations.
    #[test]
    fn rates_follow_from_angles() {
        let active = uneven();
        let at = |t: f64| {
            let (s, c) = (7.0 * t).sin_cos();
            let mut joint = JointState { q: [0.3 * s; 4], qd: [2.1 * c; 4], qdd: [-14.7 * s; 4] };
            active.joint(&mut joint);
            joint
        };
        let h = 1e-5;
        for k in 0..50 {
            let t = 0.02 * f64::from(k);
            let (before, now, after) = (at(t - h), at(t), at(t + h));
            for i in 0..3 {
                // h²/6 times the third derivative, up to 0.3·7³·(1 + 66³·5e-4·2.1²) of the angle.
                approx::assert_relative_eq!((after.q[i] - before.q[i]) / (2.0 * h), now.qd[i], epsilon = 1e-6);
                approx::assert_relative_eq!((after.qd[i] - before.qd[i]) / (2.0 * h), now.qdd[i], epsilon = 1e-4);
            }
        }
    }

    #[test]
    fn the_encoder_reads_what_the_joint_comes_from() {
        let active = uneven();
        for angle in [-1.0, -0.013, 0.0, 0.4, 2.0] {
            let mut joint = JointState { q: [angle; 4], ..JointState::default() };
            active.joint(&mut joint);
            let mut read = joint.q;
            active.encoder(&[], &mut read);
            approx::assert_relative_eq!(read.as_slice(), [angle; 4].as_slice(), epsilon = 1e-15);
        }
    }
}

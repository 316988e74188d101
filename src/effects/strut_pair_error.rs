//! Difference in length between the two struts of a limb.

use super::{About, Count, Effect, Kind, Parameter, Part, Role, Spec, Unit, Values};
use crate::machine::Geometry;

/// Lengths l₂ ± δ/2 (m) of the two struts of a limb: δ positive if the first one, at +v of the limb's tangential axis v, is
/// longer.
///
/// The platform tilts by θ with (v_i × u_i)·θ = δ_i/d_i to first order, u the direction of the struts and d the distance
/// of the pair, and shifts by Δp with u_i·(Δp + θ × b_i) = 0, b the middle of the lower ball pair. The kinematics of
/// inverse dynamics and twin is exact, not of first order. Torques change in proportion to δ: those of gravity by
/// ∂/∂q of −Σ m·g·(Δp + θ × c), c the centre of mass from the platform's origin, and those of inertia likewise; the
/// forces of the two struts of a pair differ by more. The controller takes the struts of a pair as parallel.
pub struct StrutPairError;

const PARAMETERS: &[Parameter] =
    &[Parameter::new("difference", Unit::M, Role::Linear, 0.001, (-0.01, 0.01)).counted(Count::PerArm)];

static SPEC: Spec = Spec::new(
    "strut_pair_error",
    Part::Delta,
    About {
        summary: "the two struts of a limb differ in length, so that the platform tilts",
        law: "l₂ ± δ_i/2 for the first and the second strut of a pair; tilt θ: (v_i × u_i)·θ = δ_i/d_i",
        shows: "small torque errors that grow with a load below the flange, platform tilted by about δ/d",
        source: "loop closure of six struts; CAD 0.28 mm between parts, worn rings 0.25–1 mm sideways (estimate)",
    },
    PARAMETERS,
)
.kind(Kind::Geometry);

impl Effect for StrutPairError {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn geometry(&self, values: &Values, geometry: &mut Geometry) {
        for (limb, difference) in geometry.limbs.iter_mut().zip(values.block(0)) {
            limb.strut_difference += difference;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use nalgebra::{Matrix3, Rotation3, Vector3};

    use super::*;
    use crate::dynamics::{Plant, inverse_dynamics};
    use crate::effects::ActiveEffect;
    use crate::kinematics::{JointState, Motion};
    use crate::machine::bodies::{self, END_EFFECTOR, PLATFORM, TELESCOPE_LOWER, TELESCOPE_UPPER};
    use crate::machine::{Payload, Setup, ThreeArms, six_struts, three_arms};

    fn unequal(mut geometry: Geometry, differences: ThreeArms<f64>) -> Geometry {
        let active = ActiveEffect::new(Arc::new(StrutPairError), &[&differences]);
        StrutPairError.geometry(&active.values(), &mut geometry);
        geometry
    }

    /// Rotation of the platform, rad, and its shift at arm angles `q`, exact and to first order.
    fn tilts(geometry: &Geometry, q: ThreeArms<f64>, differences: ThreeArms<f64>) -> [(Vector3<f64>, Vector3<f64>); 2] {
        let joints = JointState { q: [q[0], q[1], q[2], 0.0], ..JointState::default() };
        let [level, tilted] =
            [*geometry, unequal(*geometry, differences)].map(|geometry| Motion::assembled(&geometry, &joints).unwrap());
        let platform = tilted.bodies[PLATFORM];
        let exact = (
            Rotation3::from_matrix_unchecked(platform.rotation).scaled_axis(),
            platform.position - level.bodies[PLATFORM].position,
        );
        let u = |i: usize| level.strut_axis[2 * i];
        let rows = |row: &dyn Fn(usize) -> Vector3<f64>| {
            Matrix3::from_rows(&[0, 1, 2].map(|i| row(i).transpose())).try_inverse().unwrap()
        };
        let limb = |i: usize| &geometry.limbs[i];
        let turn = rows(&|i| limb(i).tangential().cross(&u(i)))
            * Vector3::from_fn(|i, _| differences[i] / limb(i).pair_distance);
        let shift = rows(&|i| u(i)) * Vector3::from_fn(|i, _| -u(i).dot(&turn.cross(&limb(i).point)));
        [exact, (turn, shift)]
    }

    #[test]
    fn equal_differences_turn_the_platform_about_the_vertical() {
        // At home v × u = z·sin β − r·cos β with sin β = 0.652/1.106: θ_z = δ/(d·sin β) = 0.1 mm/(0.1 m·0.589512) = 1.696319
        // mrad, without tilt by symmetry.
        let [(turn, _), first] = tilts(&crate::machine::testing::geometry(), [0.0; 3], [1e-4; 3]);
        approx::assert_relative_eq!(first.0, Vector3::z() * 1.696_319e-3, epsilon = 1e-9);
        approx::assert_relative_eq!(turn, first.0, epsilon = 1e-6);
    }

    #[test]
    fn tilt_and_shift_approach_their_first_order() {
        let geometry = crate::machine::testing::geometry();
        let gap = |scale: f64| {
            let [exact, first] = tilts(&geometry, [0.3, -0.1, 0.6], [1e-3, -4e-4, 7e-4].map(|d| scale * d));
            assert!(exact.0.norm() > 5e-3 * scale && exact.1.norm() > 1e-4 * scale, "{exact:?}");
            ((exact.0 - first.0).norm(), (exact.1 - first.1).norm())
        };
        let (whole, half) = (gap(1.0), gap(0.5));
        // Of second order: a quarter at half the difference.
        approx::assert_relative_eq!(whole.0 / half.0, 4.0, max_relative = 0.05);
        approx::assert_relative_eq!(whole.1 / half.1, 4.0, max_relative = 0.05);
    }

    #[test]
    fn struts_keep_their_lengths() {
        let geometry = unequal(crate::machine::testing::geometry(), [1e-3, -2e-3, 0.0]);
        let joints = JointState { q: [0.3, -0.2, 0.6, 2.0], ..JointState::default() };
        let motion = Motion::assembled(&geometry, &joints).unwrap();
        for (s, length) in [1.1065, 1.1055, 1.105, 1.107, 1.106, 1.106].into_iter().enumerate() {
            let platform = &motion.bodies[PLATFORM];
            let span = platform.position + platform.rotation * geometry.platform_ball(s)
                - motion.bodies[bodies::strut(s)].position;
            approx::assert_relative_eq!(span.norm(), length, epsilon = 1e-13);
        }
    }

    /// Sum of m·z of all bodies that the platform displaces, kg·m, for a tilt of first order.
    fn displaced(plant: &Plant, q: ThreeArms<f64>, differences: ThreeArms<f64>) -> f64 {
        let [_, (turn, shift)] = tilts(&plant.geometry, q, differences);
        let joints = JointState { q: [q[0], q[1], q[2], 0.0], ..JointState::default() };
        let level = Motion::assembled(&plant.geometry, &joints).unwrap();
        let moved = |point: Vector3<f64>| shift + turn.cross(&(point - level.bodies[PLATFORM].position));
        let carried = [PLATFORM, END_EFFECTOR].map(|b| {
            let (inertia, body) = (&plant.bodies[b], &level.bodies[b]);
            inertia.mass * moved(body.position).z + turn.cross(&(body.rotation * inertia.first_moment)).z
        });
        // The lower part hangs on its Hooke joint; the first moments along the telescope turn with it.
        let along: f64 = [TELESCOPE_UPPER, TELESCOPE_LOWER].map(|b| plant.bodies[b].first_moment.z).iter().sum();
        let (bar, hooke) = (&level.telescope, moved(level.bodies[TELESCOPE_LOWER].position));
        let tipped = -(hooke - bar.axis * bar.axis.dot(&hooke)) / bar.length;
        let telescope = plant.bodies[TELESCOPE_LOWER].mass * hooke.z + along * tipped.z;
        // The lower end of a strut moves as its ball, less what the strut is longer.
        let strut = |s: usize| {
            let longer = if s.is_multiple_of(2) { 0.5 } else { -0.5 } * differences[s / 2];
            let share = plant.bodies[bodies::strut(s)].first_moment.x / plant.geometry.strut_length(s);
            share * (moved(level.lower_ball(s)) - level.strut_axis[s] * longer).z
        };
        carried.iter().sum::<f64>() + telescope + six_struts().map(strut).sum::<f64>()
    }

    /// By virtual work: the torque at rest is the slope of the potential of all displaced weights.
    #[test]
    fn static_torque_is_the_slope_of_the_displaced_weights() {
        let mut model = crate::model::testing::irb360();
        model.effects.clear();
        let setup = Setup { payload: Payload::new(4.0, [0.03, -0.02, -0.15], 0.01), ..Setup::default() };
        let plant = Plant::new(&model, &setup);
        let q = [0.35, 0.1, 0.5];
        let torque = |geometry: Geometry| {
            let plant = Plant { geometry, ..plant.clone() };
            let motion = plant.motion(&JointState { q: [q[0], q[1], q[2], 0.0], ..JointState::default() }).unwrap();
            Vector3::from_column_slice(&inverse_dynamics(&plant, 0.0, &motion, &[], false).unwrap().tau[three_arms()])
        };
        let gap = |scale: f64| {
            let differences = [1e-3, -5e-4, 1.5e-3].map(|d| scale * d);
            let exact = torque(unequal(plant.geometry, differences)) - torque(plant.geometry);
            let slope = |i: usize| {
                let at = |step: f64| {
                    let mut q = q;
                    q[i] += step;
                    displaced(&plant, q, differences)
                };
                plant.gravity * (at(1e-3) - at(-1e-3)) / 2e-3
            };
            let first = Vector3::from_fn(|i, _| slope(i));
            assert!(first.amax() > 0.03 * scale && (exact - first).norm() < 0.1 * first.norm(), "{exact} {first}");
            (exact - first).norm()
        };
        // What is left is of second order: a quarter at half the difference.
        approx::assert_relative_eq!(gap(1.0) / gap(0.5), 4.0, max_relative = 0.1);
    }
}

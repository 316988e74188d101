//! Agreement with numbers of an independent implementation (`tests/reference/README.md`).

use crate::common;

use std::collections::HashMap;

use deltatwin::dynamics::{Plant, inverse_dynamics};
use deltatwin::kinematics::{JointState, Motion};
use deltatwin::machine::{Payload, Setup};

struct Table {
    columns: HashMap<String, usize>,
    rows: Vec<Vec<f64>>,
}

impl Table {
    fn read(name: &str, count: usize) -> Self {
        let mut reader = csv::Reader::from_path(crate::common::shipped(format!("tests/reference/{name}.csv")))
            .expect("reference file");
        let columns = reader.headers().unwrap().iter().enumerate().map(|(i, h)| (h.to_string(), i)).collect();
        let rows = reader
            .records()
            .map(|r| r.unwrap().iter().map(|x| x.parse().expect("a number")).collect())
            .collect::<Vec<Vec<f64>>>();
        assert_eq!(rows.len(), count, "{name}");
        Self { columns, rows }
    }

    fn get(&self, row: usize, column: &str) -> f64 {
        self.rows[row][self.columns[column]]
    }

    fn four(&self, row: usize, prefix: &str) -> [f64; 4] {
        std::array::from_fn(|i| self.columns.get(&format!("{prefix}{}", i + 1)).map_or(0.0, |&c| self.rows[row][c]))
    }

    fn joints(&self, row: usize) -> JointState {
        JointState { q: self.four(row, "q"), qd: self.four(row, "qd"), qdd: self.four(row, "qdd") }
    }
}

/// Largest difference relative to the largest magnitude of the column.
struct Worst(HashMap<String, (f64, f64)>);

impl Worst {
    fn see(&mut self, column: &str, got: f64, want: f64) {
        let e = self.0.entry(column.into()).or_default();
        e.0 = e.0.max((got - want).abs());
        e.1 = e.1.max(want.abs());
    }

    fn assert_below(&self, tolerance: f64, what: &str) {
        let mut columns: Vec<_> = self.0.iter().map(|(c, (d, s))| (c, d / s)).collect();
        columns.sort_by(|a, b| b.1.total_cmp(&a.1));
        println!("{what}: worst {} {:.2e}", columns[0].0, columns[0].1);
        for (column, ratio) in columns {
            assert!(ratio < tolerance, "{what}: {column} differs by {ratio:.2e} of its magnitude");
        }
    }
}

/// The reference is printed with 15 digits and agrees with its own second implementation to 1e-13.
const TOLERANCE: f64 = 1e-10;

fn compare_forces(name: &str, plant: &Plant) {
    let table = Table::read(name, 200);
    let mut worst = Worst(HashMap::new());
    let states: Vec<&[f64]> = plant.effects.iter().map(|_| [].as_slice()).collect();
    for row in 0..table.rows.len() {
        let motion = plant.motion(&table.joints(row)).expect("reachable");
        let out = inverse_dynamics(plant, 0.0, &motion, &states, true).expect("regular");
        for i in 0..4 {
            let c = format!("tau{}", i + 1);
            worst.see(&c, out.tau[i], table.get(row, &c));
        }
        for s in 0..6 {
            let (u, l) = (format!("strut{}_upper", s + 1), format!("strut{}_lower", s + 1));
            worst.see(&u, out.reactions.upper[s], table.get(row, &u));
            worst.see(&l, out.reactions.lower[s], table.get(row, &l));
        }
    }
    worst.assert_below(TOLERANCE, name);
}

#[test]
fn kinematics_agree() {
    let plant = common::nominal_plant();
    let table = Table::read("kinematics", 200);
    let mut worst = Worst(HashMap::new());
    for row in 0..table.rows.len() {
        let motion = Motion::assembled(&plant.geometry, &table.joints(row)).expect("reachable");
        let p = motion.bodies[deltatwin::machine::bodies::PLATFORM].position;
        for (column, value) in [("ee_x", p.x), ("ee_y", p.y), ("ee_z", p.z), ("telescope_rate", motion.telescope.rate)]
        {
            worst.see(column, value, table.get(row, column));
        }
        for limb in 0..3 {
            for (socket, end) in [(2 * limb, "upper"), (2 * limb + 1, "upper"), (6 + 2 * limb, "lower")] {
                let column = format!("limb{}_{end}_socket_rate", limb + 1);
                worst.see(&column, motion.socket_rate(socket).norm(), table.get(row, &column));
            }
        }
    }
    worst.assert_below(TOLERANCE, "kinematics");
}

#[test]
fn rigid_bodies_agree() {
    compare_forces("rigid_no_payload", &common::nominal_plant());
}

#[test]
fn payload_agrees() {
    let mut plant = common::nominal_plant();
    plant.payload = Payload::new(2.5, [0.03, -0.02, -0.08], 0.012);
    plant.bodies[deltatwin::machine::bodies::END_EFFECTOR] += plant.payload.inertia();
    compare_forces("rigid_payload", &plant);
}

#[test]
fn friction_agrees() {
    // The file holds exactly the effects of the reference: Table 4 for drives and telescope, eq. 48 for axis 4.
    let model = common::model("irb360-6-1600");
    compare_forces("friction_no_payload", &Plant::new(&model, &Setup::default()));
}

#[test]
fn socket_friction_takes_the_power_of_the_reference_rates() {
    // Στ·q̇ of viscous friction alone is Σ c·|ω_rel|² over the 12 sockets; both struts of a pair turn alike.
    let c = 0.30;
    let (rigid, plant) =
        (common::nominal_plant(), common::with_effect(common::nominal_plant(), "ball_socket_viscous", &[&[c]]));
    let table = Table::read("kinematics", 200);
    let mut worst = Worst(HashMap::new());
    for row in 0..table.rows.len() {
        let joints = table.joints(row);
        let motion = plant.motion(&joints).expect("reachable");
        let with = inverse_dynamics(&plant, 0.0, &motion, &[&[]], false).expect("regular").tau;
        let without = inverse_dynamics(&rigid, 0.0, &motion, &[], false).expect("regular").tau;
        let got: f64 = (0..4).map(|i| (with[i] - without[i]) * joints.qd[i]).sum();
        let rates = (1..=3).flat_map(|limb| ["upper", "lower"].map(|end| format!("limb{limb}_{end}_socket_rate")));
        let want: f64 = rates.map(|column| 2.0 * c * table.get(row, &column).powi(2)).sum();
        worst.see("power", got, want);
    }
    worst.assert_below(TOLERANCE, "socket friction");
}

/// Par4, H4, I4 and Par2 against free bodies with joint constraints, unweighted and weighted rows apart: among others the
/// strut forces, which are not unique but for the stiffness of the struts (`tests/reference/family/README.md`).
#[test]
fn relatives_of_the_delta_robot_agree() {
    let payload = Payload::with_tensor(2.0, [0.025, -0.015, -0.09], [45e-4, 52e-4, 31e-4, 2e-4, -1.5e-4, 3e-4]);
    for name in ["par4", "h4", "i4", "par2"] {
        let mut model = common::model(name);
        model.effects.clear();
        let motions = Table::read(&format!("family/{name}_motion"), 40);
        for (file, payload) in [("no_payload", Payload::default()), ("payload", payload)] {
            let plant = Plant::new(&model, &Setup { payload, ..Setup::default() });
            let table = Table::read(&format!("family/{name}_{file}"), 40);
            let mut worst = Worst(HashMap::new());
            for row in 0..40 {
                compare_kinematics(&plant, &motions, row, &mut worst);
                let motion = plant.motion(&motions.joints(row)).expect("reachable");
                let out = inverse_dynamics(&plant, 0.0, &motion, &[], true).expect("regular");
                for i in 0..plant.mechanism.axes() {
                    let column = format!("tau{}", i + 1);
                    worst.see(&column, out.tau[i], table.get(row, &column));
                }
                for s in 0..plant.mechanism.struts() {
                    let (u, l) = (format!("strut{}_upper", s + 1), format!("strut{}_lower", s + 1));
                    worst.see(&u, out.reactions.upper[s], table.get(row, &u));
                    worst.see(&l, out.reactions.lower[s], table.get(row, &l));
                }
            }
            worst.assert_below(1e-9, &format!("{name} {file}"));
        }
    }
}

/// Pose from drive angles and back, with rates and accelerations.
fn compare_kinematics(plant: &Plant, motions: &Table, row: usize, worst: &mut Worst) {
    let (g, joints) = (&plant.geometry, motions.joints(row));
    let drives =
        JointState { q: std::array::from_fn(|i| if i < plant.mechanism.arms() { joints.q[i] } else { 0.0 }), ..joints };
    let (all, platform) = g.complete(&drives).expect("reachable");
    let back = g.inverse_motion(&platform).expect("reachable");
    for i in 0..4 {
        for (prefix, found, again) in [("q", all.q, back.q), ("qd", all.qd, back.qd), ("qdd", all.qdd, back.qdd)] {
            let column = format!("{prefix}{}", i + 1);
            worst.see(&column, found[i], motions.get(row, &column));
            worst.see(&column, again[i], motions.get(row, &column));
        }
    }
    for (k, axis) in ["x", "y", "z"].into_iter().enumerate() {
        worst.see("place", platform.position[k], motions.get(row, axis));
        worst.see("velocity", platform.velocity[k], motions.get(row, &format!("{axis}d")));
        worst.see("acceleration", platform.acceleration[k], motions.get(row, &format!("{axis}dd")));
    }
    if g.plate.turns() {
        for (k, column) in ["psi", "psid", "psidd"].into_iter().enumerate() {
            worst.see(column, platform.psi[k], motions.get(row, column));
        }
    }
}

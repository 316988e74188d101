//! The desired motions of the shipped scenarios: within reach, continuous, and what their runs need.

use crate::common::runs;
use deltatwin::cell::Mobility;
use deltatwin::kinematics::{PlatformState, Target};
use deltatwin::scenario::Scenario;
use deltatwin_io::{model, scenario};
use nalgebra::Vector3;

/// All shipped runs.
fn shipped() -> Vec<Scenario> {
    runs().iter().map(|f| scenario::read(f).unwrap_or_else(|e| panic!("{e}"))).collect()
}

fn four(position: &Vector3<f64>, psi: f64) -> [f64; 4] {
    [position.x, position.y, position.z, psi]
}

/// Value, velocity and acceleration of the coordinates.
fn derivatives(target: &Target) -> [[f64; 4]; 3] {
    match target {
        Target::Platform(p) => {
            [four(&p.position, p.psi[0]), four(&p.velocity, p.psi[1]), four(&p.acceleration, p.psi[2])]
        }
        Target::Joints(j) => [j.q, j.qd, j.qdd],
    }
}

fn platform(target: Target) -> PlatformState {
    let Target::Platform(p) = target else { panic!("{target:?}") };
    p
}

#[test]
fn shipped_motions_are_in_reach_and_their_derivatives_agree() {
    for scenario in shipped() {
        let planning = model::read(scenario.controller_model.as_ref().unwrap_or(&scenario.model)).unwrap();
        let motion = scenario.motion(&planning).unwrap_or_else(|e| panic!("{}: {e}", scenario.name));
        let h = 1e-6;
        for k in 0..400 {
            let t = 1e-3 + (scenario.duration - 2e-3) * k as f64 / 400.0;
            let [before, now, after] = [t - h, t, t + h].map(|t| derivatives(&motion.at(t)));
            for order in 0..2 {
                for i in 0..4 {
                    let difference = (after[order][i] - before[order][i]) / (2.0 * h);
                    let error = (difference - now[order + 1][i]).abs();
                    // Half a step over the largest jump of jerk: 20000 m/s³ or rad/s³.
                    let allowed = 1e-5 + 0.02 * order as f64;
                    assert!(error < allowed, "{}: order {order}, coordinate {i} at {t}: {error}", scenario.name);
                }
            }
        }
    }
}

#[test]
fn shipped_runs_are_short_and_have_what_they_need() {
    let by_name = |name: &str| shipped().into_iter().find(|s| s.name == name).unwrap();
    for name in ["crash", "touch", "pick-and-place", "worn-sockets", "path", "table", "static-poses", "smoke"] {
        let scenario = by_name(name);
        assert!(scenario.duration <= 3.0, "{name} takes {} s", scenario.duration);
    }
    let crash = by_name("crash");
    assert!(crash.sockets.armed && crash.objects.iter().any(|o| o.name == "block"));
    let worn = by_name("worn-sockets");
    let holds = worn.socket_holds(&model::read(&worn.model).unwrap());
    assert!(holds[6] < 80.0 && holds[7] < 80.0 && holds[0] > 150.0, "{holds:?}");
    // The gripper stands over the can when it picks, and over the block when it lets go.
    let place = by_name("pick-and-place");
    let motion = place.motion(&model::read(&place.model).unwrap()).unwrap();
    for action in &place.actions {
        let state = platform(motion.at(action.t));
        assert!(state.velocity.norm() == 0.0, "{action:?}: {}", state.velocity);
    }
    let can = place.objects.iter().find(|o| o.name == "can").unwrap();
    let belt = place.objects.iter().find(|o| o.name == "belt").unwrap();
    let Mobility::Conveyor { velocity } = belt.mobility else { panic!("{belt:?}") };
    let brought = can.position + velocity * place.actions[0].t;
    let gripper = platform(motion.at(place.actions[0].t)).position;
    assert!((brought - gripper).xy().norm() < 5e-3, "{brought} {gripper}");
}

#[test]
fn joint_motions_turn_only_their_axis() {
    let text = "model = \"../models/irb360-6-1600.toml\"\n[motion]\nkind = \"constant_speed\"\naxis = 2\n\
                pose = [0.05, 0, -1, 1]\nbetween = [0.2, 0.6]\nspeeds = [0.5, 2]\nacceleration = 40\n";
    let scenario = scenario::parse(text, &crate::common::shipped("scenarios/test.toml")).unwrap();
    let model = model::read(&scenario.model).unwrap();
    let motion = scenario.motion(&model).unwrap();
    let held = model.geometry.inverse(&Vector3::new(0.05, 0.0, -1.0), 0.0).unwrap();
    for k in 0..=100 {
        let joints = motion.at(scenario.duration * k as f64 / 100.0).joints(&model.geometry).unwrap();
        assert!((joints.q[0] - held[0]).abs() < 1e-9 && (joints.q[2] - held[2]).abs() < 1e-9);
        assert!(joints.qd[0].abs() < 1e-9 && joints.qdd[2].abs() < 1e-7 && joints.q[3] == 1.0);
        assert!((0.2 - 1e-9..0.6 + 1e-9).contains(&joints.q[1]));
    }
}

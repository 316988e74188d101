//! The twin allocates nothing once it runs, and what is read is given back.

use crate::common;

use std::path::Path;

use common::{defaults, model, reversing};
use deltatwin::cell::{CellError, Mobility, Object, Shape, Surface};
use deltatwin::dynamics::{Plant, inverse_dynamics};
use deltatwin::effects::REGISTRY;
use deltatwin::kinematics::{Motion, SocketSet, Target};
use deltatwin::machine::bodies::{END_EFFECTOR, SLOTS};
use deltatwin::model::Model;
use deltatwin::twin::{
    ContactBody, Contacts, EventKind, Held, Options, Surroundings, Torque, Touch, Twin, Twist, simulate,
};
use deltatwin_io::model::{full_text, parse};
use nalgebra::{Isometry3, Vector3};

/// Allocations of ten steps and ten evaluations after the first.
fn allocations(model: &Model, open: &[usize]) -> [u64; 2] {
    let plant = Plant::new(model, &common::payload());
    let mut twin = Twin::new(plant.clone(), &plant.motion(&reversing(0.0)).unwrap()).unwrap();
    for &socket in open {
        twin.open(socket).unwrap();
    }
    let torque = Torque::constant([-8.0, -9.0, -7.0, 0.4]);
    twin.step(1e-4, &torque).unwrap();
    twin.evaluate(&torque).unwrap();
    let steps = allocation_counter::measure(|| (0..10).for_each(|_| twin.step(1e-4, &torque).unwrap()));
    let evaluations = allocation_counter::measure(|| {
        for _ in 0..10 {
            std::hint::black_box(twin.evaluate(&torque).unwrap());
        }
    });
    [steps.count_total, evaluations.count_total]
}

#[test]
fn a_step_allocates_nothing() {
    let truth = model("irb360-6-1600-truth");
    let mut rigid = truth.clone();
    rigid.effects.clear();
    let with = |name: &str| {
        let mut model = truth.clone();
        model.effects.push(defaults(name));
        model
    };
    let mut all = truth.clone();
    all.effects = REGISTRY[1..].iter().map(|e| defaults(e.name())).collect();
    let counted = allocation_counter::measure(|| drop(std::hint::black_box(Box::new([0u8; 64]))));
    assert_eq!(counted.count_total, 1, "the counter counts");
    let mut worst = 0;
    for (what, model) in [
        ("rigid", &rigid),
        ("truth", &truth),
        ("load-dependent", &with("ball_socket_load_dependent")),
        ("elastic drives", &with("drive_elasticity")),
        ("elastic struts", &with("strut_elasticity")),
        ("everything", &all),
    ] {
        for open in [&[][..], &[6, 7], &[0, 6]] {
            let [steps, evaluations] = allocations(model, open);
            println!("{what}, {} sockets open: {steps} in 10 steps, {evaluations} in 10 evaluations", open.len());
            worst = worst.max(steps).max(evaluations);
        }
    }
    assert_eq!(worst, 0);
}

/// A bath in which the end effector moves: it touches all the time and is braked with 20 N·s/m.
struct Bath {
    wrenches: [Twist; SLOTS],
    touches: [Touch; 1],
}

impl Contacts for Bath {
    fn near(&mut self, _: &Motion, _: SocketSet, _: f64) -> bool {
        true
    }

    fn longest_step(&self) -> f64 {
        1e-3
    }

    fn wrenches(&mut self, motion: &Motion, _: SocketSet) -> &[Twist; SLOTS] {
        self.wrenches[END_EFFECTOR].0 = motion.bodies[END_EFFECTOR].velocity * -20.0;
        &self.wrenches
    }

    fn touches(&self) -> &[Touch] {
        &self.touches
    }

    fn name(&self, body: ContactBody) -> String {
        format!("{body:?}")
    }

    fn advance(&mut self, _: f64, _: f64) {}

    fn pick(&mut self, name: &str, _: &Motion) -> Result<Held, CellError> {
        Err(CellError::NotFree(name.into()))
    }

    fn release(&mut self, _: &Motion) -> Result<String, CellError> {
        Err(CellError::Empty)
    }

    fn poses(&self, _: &Motion) -> Vec<Isometry3<f64>> {
        vec![Isometry3::identity()]
    }

    fn kinetic_energy(&self) -> f64 {
        0.0
    }
}

fn bath(surroundings: &Surroundings<'_>) -> Result<Box<dyn Contacts>, CellError> {
    assert_eq!((surroundings.objects.len(), surroundings.gravity), (1, Vector3::z() * -9.81));
    let (link, other) = (ContactBody::Link(END_EFFECTOR), ContactBody::Object(0));
    let none = Vector3::zeros();
    let touch = Touch { link, other, force: 1.0, at: none, normal: none, push: none };
    Ok(Box::new(Bath { wrenches: [(Vector3::zeros(), Vector3::zeros()); SLOTS], touches: [touch] }))
}

#[test]
fn a_step_with_contacts_allocates_nothing() {
    let robot = model("irb360-6-1600-truth");
    let believed = Plant::new(&model("irb360-6-1600"), &common::payload());
    let water = Object {
        name: "water".into(),
        shape: Shape::Sphere { radius: 1.0 },
        mobility: Mobility::Fixed,
        position: Vector3::zeros(),
        yaw: 0.0,
        surface: Surface::default(),
    };
    let mut counts = Vec::new();
    for substeps in [1, 2, 8] {
        let options = Options {
            duration: 0.02,
            substeps,
            objects: vec![water.clone()],
            contacts: Some(bath),
            ..Options::default()
        };
        let desired = |t: f64| Target::Joints(reversing(t));
        let mut report = None;
        let counted = allocation_counter::measure(|| {
            let run = simulate(&robot, &common::payload(), &believed, &desired, &options, &mut |_| true);
            report = Some(run.expect("a feasible motion").1);
        });
        let report = report.expect("a report");
        println!("{} steps: {} allocations, energy {:.1e}", report.steps, counted.count_total, report.energy_error);
        let contacts: Vec<_> = report.events.iter().filter(|e| e.kind == EventKind::Contact).collect();
        assert_eq!(contacts.len(), 1, "{contacts:?}");
        assert_eq!(contacts[0].what, format!("Link({END_EFFECTOR}) touches Object(0)"));
        // What the bath takes is in the audit.
        assert!(report.energy_error < 1e-5, "{:e}", report.energy_error);
        counts.push((report.steps, counted.count_total));
    }
    assert!(counts[1].0 == 2 * counts[0].0 && counts[2].0 == 8 * counts[0].0, "{counts:?}");
    assert!(counts.iter().all(|c| c.1 == counts[0].1), "{counts:?}");
}

#[test]
fn formulas_leave_no_memory_behind() {
    let text = format!(
        "{}\n{}",
        std::fs::read_to_string(crate::common::shipped("models/irb360-6-1600.toml")).unwrap(),
        "[[effects.formula.terms]]\nname = \"cubic\"\nat = \"drive2\"\nlaw = \"-qd2^3\"\ncoefficient = 0.1\n\
         [[effects.formula.terms]]\nname = \"cable\"\nat = \"platform_x\"\nlaw = \"-x*abs(vx)\"\ncoefficient = 4\n"
    );
    // Reads the model, states its parameters, predicts torques with it and writes it.
    let round = || {
        let model = parse(&text, Path::new("formula.toml")).unwrap();
        let plant = Plant::new(&model, &common::payload());
        let names: Vec<String> = plant.parameters().into_iter().map(|p| p.name).collect();
        assert!(names.contains(&"formula.cubic".to_string()), "{names:?}");
        let motion = plant.motion(&reversing(0.0)).unwrap();
        let states: Vec<Vec<f64>> = plant.effects.iter().map(|a| a.initial_state()).collect();
        let states: Vec<&[f64]> = states.iter().map(Vec::as_slice).collect();
        std::hint::black_box(inverse_dynamics(&plant, 0.0, &motion, &states, true).unwrap());
        std::hint::black_box(full_text(&model).unwrap());
    };
    round();
    let left: Vec<i64> = (0..100).map(|_| allocation_counter::measure(round).bytes_current).collect();
    assert_eq!(left, vec![0; 100], "bytes allocated and not freed, by round");
}

//! The twin allocates nothing once it runs, and what is read is given back.

mod common;

use std::path::Path;

use common::{defaults, model, reversing};
use deltatwin::dynamics::{Plant, inverse_dynamics};
use deltatwin::effects::REGISTRY;
use deltatwin::model::Model;
use deltatwin::model::write::full_text;
use deltatwin::twin::{Torque, Twin};

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

#[test]
fn formulas_leave_no_memory_behind() {
    let text = format!(
        "{}\n{}",
        std::fs::read_to_string("models/irb360-6-1600.toml").unwrap(),
        "[[effects.formula.terms]]\nname = \"cubic\"\nat = \"drive2\"\nlaw = \"-qd2^3\"\ncoefficient = 0.1\n\
         [[effects.formula.terms]]\nname = \"cable\"\nat = \"platform_x\"\nlaw = \"-x*abs(vx)\"\ncoefficient = 4\n"
    );
    // Reads the model, states its parameters, predicts torques with it and writes it.
    let round = || {
        let model = Model::parse(&text, Path::new("formula.toml")).unwrap();
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

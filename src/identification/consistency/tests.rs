use nalgebra::{DMatrix, DVector};

use super::*;
use crate::dynamics::Plant;
use crate::machine::Setup;
use crate::model::Model;

/// Classes of the shipped robot, its parameters and the masses without a parameter.
fn shipped() -> (Model, Vec<BodyClass>, DVector<f64>) {
    let model = crate::model::testing::irb360();
    let rigid = Plant::new(&model, &Setup::default()).rigid_bodies();
    let free: Vec<usize> = (0..rigid.values.len()).collect();
    let (classes, masses) = classes(&[Owner { first: 0, effect: &rigid, bodies: &model.bodies }], &free);
    let x = DVector::from_iterator(free.len() + masses.len(), rigid.values.iter().copied().chain(masses));
    (model, classes, x)
}

#[test]
fn the_papers_variables_describe_the_links_and_the_rotor() {
    let (model, classes, x) = shipped();
    let own = |c: &BodyClass| c.variables().len();
    // Arm, strut, platform, rotor, telescope upper and lower part: the 18 of the paper and two more, the height of
    // the platform's centre of mass, which strut forces determine, and the mass of the rotor, which nothing
    // determines.
    assert_eq!(classes.iter().map(own).collect::<Vec<_>>(), [4, 4, 2, 2, 4, 4]);
    let mut bodies = model.bodies.clone();
    complete(&classes, &x, &mut bodies);
    for (b, (now, before)) in bodies.0.iter().zip(&model.bodies.0).enumerate() {
        let same = (now.pseudo_inertia() - before.pseudo_inertia()).norm();
        // The rotor's two moments across its axis are half of the moment about it.
        assert!(same < 1e-12 || b == crate::machine::bodies::ROTOR, "body {b}: {same:e}");
    }
}

#[test]
fn slack_is_positive_exactly_for_possible_bodies() {
    let (_, classes, x) = shipped();
    for seed in 0..200 {
        let wild = x.map_with_location(|i, _, v| v * (1.0 + 1.5 * ((i * 7 + seed * 13) as f64).sin()));
        for class in &classes {
            let smallest = class.inertia(&wild).min_eigenvalue();
            if smallest.abs() > 1e-9 {
                assert_eq!(class.slack(&wild) > 0.0, smallest > 0.0, "{:?} {smallest:e}", class.bodies);
            }
        }
    }
}

/// Costs with unconstrained minimisers far outside consistency.
fn wild_cost(seed: usize) -> Cost {
    let (_, classes, x) = shipped();
    let n = x.len();
    let centre = x.map_with_location(|i, _, v| v * (1.0 + 3.0 * ((i * 7 + seed * 13) as f64).sin()));
    let coupling = |i: usize, j: usize| if i == j { 1.0 } else { 0.3 * ((i * j + seed) as f64).cos().abs() };
    let root = DMatrix::from_fn(n, n, |i, j| coupling(i, j) / x[j].abs());
    Cost {
        centre,
        curvature: root.tr_mul(&root),
        size: x.map(f64::abs),
        range: vec![(0.0, f64::INFINITY); n],
        start: x,
        classes,
    }
}

#[test]
fn log_cholesky_and_cones_find_the_same_parameters() {
    for seed in 0..60 {
        let cost = wild_cost(seed);
        assert!(!cost.allows(&cost.centre));
        let smooth = log_cholesky::minimise(&cost);
        let convex = cones::minimise(&cost).expect("a solution");
        let (a, b) = (cost.of(&smooth), cost.of(&convex.x));
        // The gaps of the convex solver are between 1e-12 and 4e-7 of the cost.
        assert!((a - b).abs() < convex.gap + 1e-7 * b && convex.gap < 1e-6 * b, "{seed}: {a} {b} {:e}", convex.gap);
        // For a convex cost the distance from the minimiser is bounded: ½‖Δx‖²_H ≤ Δcost.
        let apart = &smooth - &convex.x;
        let apart = 0.5 * apart.dot(&(&cost.curvature * &apart));
        assert!(apart < 2.0 * (convex.gap + 1e-7 * b), "{seed}: {apart:e}");
        for class in &cost.classes {
            assert!(class.slack(&smooth) > 0.99, "{seed}: {:?}", class.bodies);
            assert!(class.inertia(&smooth).min_eigenvalue() > 0.0, "{seed}: {:?}", class.bodies);
        }
    }
}

#[test]
fn possible_estimates_are_left_alone() {
    let mut cost = wild_cost(0);
    cost.centre = cost.start.clone();
    assert!(cost.allows(&cost.centre));
    let found = log_cholesky::minimise(&cost);
    assert!((&found - &cost.centre).component_div(&cost.size).amax() < 1e-6);
}

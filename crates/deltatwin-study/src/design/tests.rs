//! Plans of study files.

use std::collections::BTreeSet;
use std::path::Path;

use deltatwin_io::outside::Access;
use deltatwin_io::study::parse;

use super::*;
use crate::campaign::Digest;

fn plan(design: &str, factors: &[&str]) -> Plan {
    let mut text = format!("scenario = \"../payload.toml\"\n[design]\n{design}\n");
    for (k, factor) in factors.iter().enumerate() {
        text += &format!("[[factors]]\nname = \"f{k}\"\nkey = \"payload.com.{}\"\n{factor}\n", 1 + k % 3);
    }
    let study = parse(&text, Path::new("../../scenarios/studies/test.toml"), Access::PLAIN).unwrap();
    Plan::new(&study, Draws::new(&Digest::of([("test", text.as_bytes())]), study.seed))
}

fn number(setting: Setting) -> f64 {
    match setting {
        Setting::Number(x) => x,
        Setting::Level(level) => level as f64,
        Setting::Unset => f64::NAN,
    }
}

fn numbers(plan: &Plan, run: u64) -> Vec<f64> {
    plan.point(run).settings.into_iter().map(number).collect()
}

const NORMAL: &str = "distribution = { kind = \"normal\", mean = 0.1, sigma = 0.01 }";

#[test]
fn a_grid_has_every_combination_once_and_its_draws_begin_at_the_medians() {
    let grid = plan("kind = \"grid\"", &["levels = [1, 2, 3]", "from = 0\nto = 1\ncount = 2", "levels = [5]"]);
    let all: Vec<Vec<f64>> = (0..grid.runs()).map(|run| numbers(&grid, run)).collect();
    assert_eq!(all.len(), 6);
    assert_eq!(all[..3], [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]);
    assert_eq!(grid.point(3).seed, None);
    let drawn = plan("kind = \"grid\"\nrepeats = 50", &["levels = [1, 2]", NORMAL]);
    assert_eq!(drawn.runs(), 100);
    assert!((numbers(&drawn, 0)[1] - 0.1).abs() < 1e-15 && (numbers(&drawn, 50)[1] - 0.1).abs() < 1e-15);
    let others: BTreeSet<u64> = (1..50).map(|run| numbers(&drawn, run)[1].to_bits()).collect();
    assert_eq!(others.len(), 49);
    assert_ne!(drawn.point(3).seed, drawn.point(4).seed);
}

#[test]
fn samples_fill_their_ranges() {
    for design in ["latin_hypercube", "sobol", "monte_carlo"] {
        let sample =
            plan(&format!("kind = \"{design}\"\nruns = 512"), &["from = 2\nto = 6", NORMAL, "levels = [1, 2]"]);
        let all: Vec<Vec<f64>> = (0..512).map(|run| numbers(&sample, run)).collect();
        let mean = |k: usize| all.iter().map(|x| x[k]).sum::<f64>() / 512.0;
        // Standard errors of independent draws: 0.05, 0.0005 and 0.022.
        assert!((mean(0) - 4.0).abs() < 0.2 && (mean(1) - 0.1).abs() < 2e-3 && (mean(2) - 0.5).abs() < 0.1, "{design}");
        assert!(all.iter().all(|x| (2.0..=6.0).contains(&x[0])));
        let strata: BTreeSet<u64> = all.iter().map(|x| ((x[0] - 2.0) / 4.0 * 512.0) as u64).collect();
        match design {
            "monte_carlo" => assert!(strata.len() < 400),
            _ => assert_eq!(strata.len(), 512, "{design}"),
        }
    }
}

#[test]
fn samples_of_sobol_indices_are_laid_out_as_their_estimator_needs_them() {
    let d = 3;
    let plan =
        plan("kind = \"sensitivity\"\nsamples = 8", &["from = 0\nto = 1", "from = 2\nto = 3\nnominal = 2.1", NORMAL]);
    assert_eq!(plan.runs(), 1 + 2 * d + 8 * (d + 2));
    assert_eq!(numbers(&plan, 0)[..2], [0.5, 2.1]);
    assert_eq!((numbers(&plan, 1)[0], numbers(&plan, 2)[0], numbers(&plan, 4)[1]), (0.0, 1.0, 3.0));
    assert!((numbers(&plan, 6)[2] - (0.1 + 0.01 * 1.6448536269514722)).abs() < 1e-9);
    let first = 1 + 2 * d;
    let [a, b] = [numbers(&plan, first), numbers(&plan, first + d + 1)];
    for k in 0..3 {
        let mixed = numbers(&plan, first + 1 + k as u64);
        for (j, x) in mixed.iter().enumerate() {
            assert_eq!(*x, if j == k { b[j] } else { a[j] });
        }
    }
}

#[test]
fn rays_begin_at_the_start_and_end_on_a_face() {
    let design = "kind = \"boundary\"\nalong = [\"f0\", \"f1\"]\nrays = 5\nrepeats = 3";
    let plan = plan(design, &["from = 1\nto = 3", "from = 0\nto = -2", "levels = [7, 8]", NORMAL]);
    assert_eq!(plan.runs(), 2 * 3 * 5);
    for run in 0..plan.runs() {
        let [start, end] = [0.0, 1.0].map(|s| plan.on_ray(run, s).into_iter().map(number).collect::<Vec<_>>());
        assert_eq!(start[..2], [1.0, 0.0]);
        assert!(end[0] == 3.0 || end[1] == -2.0, "{end:?}");
        assert_eq!(start[2..], end[2..]);
        // All rays of a draw have the same levels, draws and seed.
        let first = run / 5 * 5;
        let other: Vec<f64> = plan.on_ray(first, 0.3).into_iter().map(number).collect();
        assert_eq!(start[2..], other[2..]);
        assert_eq!(plan.point(run).seed, plan.point(first).seed);
    }
    let axes = [0, 4].map(|run| plan.on_ray(run, 1.0).into_iter().map(number).collect::<Vec<_>>());
    assert_eq!((axes[0][0], axes[0][1], axes[1][0], axes[1][1]), (3.0, 0.0, 1.0, -2.0));
}

//! Statistics against other people's packages; `peers/peers.py` computes the numbers named "SALib", "OpenTURNS" and
//! "statsmodels" here.

use std::convert::Infallible;
use std::f64::consts::PI;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use super::*;

fn near(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found} instead of {expected} ± {tolerance}");
}

/// Ishigami function, a = 7, b = 0.1, of three factors between 0 and 1.
fn ishigami(u: &[f64]) -> f64 {
    let x: Vec<f64> = u.iter().map(|u| PI * (2.0 * u - 1.0)).collect();
    x[0].sin() + 7.0 * x[1].sin().powi(2) + 0.1 * x[2].powi(4) * x[0].sin()
}

#[test]
fn sobol_indices_are_those_of_salib() {
    let rows = include_str!("peers/sobol.csv").lines().filter(|l| !l.starts_with('#'));
    let base: Vec<Vec<f64>> = rows.map(|l| l.split(',').map(|v| v.parse().unwrap()).collect()).collect();
    assert_eq!(base.len(), 64);
    let outputs: Vec<f64> = base.iter().flat_map(|row| sobol_points(row)).map(|u| ishigami(&u)).collect();
    let found = sobol_indices(&outputs, 3, 4000, 1).unwrap();
    // SALib 1.6.0, `sobol.analyze` of the same 320 runs; standard errors from 20 000 resamples.
    let first = [0.1538444810418238, 0.4690711655888579, -0.015075463763518399];
    let total = [0.7968761665408215, 0.5387696119331197, 0.26300518735867046];
    let errors = [0.08845061, 0.12193219, 0.06507318, 0.33272346, 0.09097665, 0.07326808];
    for k in 0..3 {
        near(found.first[k].value, first[k], 1e-12);
        near(found.total[k].value, total[k], 1e-12);
        // 4000 resamples leave 1.1 % in a standard error, five of which are allowed.
        near(found.first[k].error, errors[k], 0.055 * errors[k]);
        near(found.total[k].error, errors[3 + k], 0.055 * errors[3 + k]);
    }
}

#[test]
fn sobol_indices_of_ishigami_are_the_analytic_ones() {
    // V = a²/8 + bπ⁴/5 + b²π⁸/18 + 1/2 and its parts [Ishigami 1990].
    let (a, b): (f64, f64) = (7.0, 0.1);
    let variance = a * a / 8.0 + b * PI.powi(4) / 5.0 + b * b * PI.powi(8) / 18.0 + 0.5;
    let first = [0.5 * (1.0 + b * PI.powi(4) / 5.0).powi(2) / variance, a * a / 8.0 / variance, 0.0];
    let cross = 8.0 * b * b * PI.powi(8) / 225.0 / variance;
    let total = [first[0] + cross, first[1], cross];
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut outputs = Vec::new();
    for _ in 0..8192 {
        let row: Vec<f64> = (0..6).map(|_| rng.random()).collect();
        outputs.extend(sobol_points(&row).iter().map(|u| ishigami(u)));
    }
    let found = sobol_indices(&outputs, 3, 200, 9).unwrap();
    near(found.variance, variance, 0.3);
    for k in 0..3 {
        for (index, exact) in [(found.first[k], first[k]), (found.total[k], total[k])] {
            assert!(index.error < 0.03 && index.interval[0] < index.interval[1], "{index:?}");
            near(index.value, exact, 4.0 * index.error + 1e-12);
        }
    }
}

#[test]
fn sobol_indices_need_fitting_finite_outputs() {
    assert!(matches!(sobol_indices(&[1.0; 7], 3, 10, 0), Err(SobolError::Count { block: 5, .. })));
    assert_eq!(sobol_indices(&[1.0; 5], 3, 10, 0), Err(SobolError::Few(1)));
    assert_eq!(sobol_indices(&[1.0; 10], 3, 10, 0), Err(SobolError::Constant));
    let mut outputs = vec![0.0; 10];
    outputs[7] = f64::NAN;
    assert!(matches!(sobol_indices(&outputs, 3, 10, 0), Err(SobolError::NotFinite { row: 7, .. })));
}

#[test]
fn wilson_intervals_are_those_of_statsmodels() {
    // statsmodels 0.15.0, `proportion_confint(k, n, alpha, "wilson")`, alpha 0.05 and 0.01.
    let cases = [
        (0, 10, [0.0, 0.27753279986288926], [0.0, 0.3988540933049082]),
        (1, 10, [0.017876213095072924, 0.40415002679523854], [0.011851503411032971, 0.5072317712328935]),
        (7, 20, [0.18119182410108203, 0.5671457233147638], [0.14639344137693883, 0.6283381789526872]),
        (312, 10000, [0.02796836833270117, 0.034791668539645194], [0.027023262352280145, 0.035998413077811785]),
        (10, 10, [0.7224672001371106, 1.0], [0.6011459066950917, 1.0]),
    ];
    for (count, of, at95, at99) in cases {
        for (confidence, expected) in [(0.95, at95), (0.99, at99)] {
            let found = wilson(count, of, confidence);
            near(found[0], expected[0], 1e-10);
            near(found[1], expected[1], 1e-10);
        }
    }
    assert_eq!(wilson(0, 0, 0.95), [0.0, 1.0]);
}

#[test]
fn intervals_of_quantiles_by_hand() {
    let values = [3.0, 1.0, 2.0, 5.0, 4.0];
    assert_eq!(quantile(&values, 0.5), Some(3.0));
    assert_eq!(quantile(&values, 0.1), Some(1.4));
    assert_eq!((quantile(&[], 0.5), quantile(&[1.0, f64::NAN], 0.5)), (None, None));
    // Median of five draws: P(all on one side) = 1/32 each, so that the extremes are a 93.75 % interval.
    assert_eq!(order_interval(&values, 0.5, 0.93), Some([1.0, 5.0]));
    assert_eq!(order_interval(&values, 0.5, 0.95), Some([f64::NEG_INFINITY, f64::INFINITY]));
    // Wilks: 59 draws are the fewest whose smallest lies below the 5 % quantile with 95 %.
    let draws = |n: i32| -> Vec<f64> { (1..=n).map(f64::from).collect() };
    assert_eq!(order_interval(&draws(59), 0.05, 0.90).unwrap()[0], 1.0);
    assert_eq!(order_interval(&draws(58), 0.05, 0.90).unwrap()[0], f64::NEG_INFINITY);
}

fn trials() -> Vec<Trial> {
    let demands = [0.6, 0.8, 1.0, 1.2, 1.4, 1.6, 1.8, 2.0];
    let failures = [0, 1, 4, 9, 20, 28, 35, 38];
    demands.into_iter().zip(failures).map(|(demand, failures)| Trial { demand, failures, of: 40 }).collect()
}

#[test]
fn the_fragility_is_the_probit_regression_of_statsmodels() {
    let fit = fit_lognormal(&trials()).unwrap();
    // statsmodels 0.15.0, GLM of the binomial family with probit link over ln x.
    near(fit.median, 1.3901296234351075, 1e-8);
    near(fit.dispersion, 0.24216713117998775, 1e-8);
    let covariance = [[0.0005208068447829499, -4.857944303611597e-05], [-4.857944303611596e-05, 0.0005886889558862993]];
    for i in 0..2 {
        for k in 0..2 {
            near(fit.covariance[i][k], covariance[i][k], 1e-9);
        }
    }
    near(fit.deviance, 1.4643452131375387, 1e-8);
    let [middle, low, high] = fit.band(1.1, 0.95);
    near(middle, 0.16686368655818867, 1e-8);
    near(low, 0.10696091148278297, 1e-8);
    near(high, 0.24496721034589314, 1e-8);
    let [demand, below, above] = fit.demand(0.5, 0.95);
    assert!(demand == fit.median && below < demand && demand < above);
    // Single outcomes and a demand of zero give the same likelihood.
    let mut single: Vec<Trial> = vec![Trial { demand: 0.0, failures: 0, of: 30 }];
    for t in trials() {
        single.extend((0..t.of).map(|k| Trial { failures: usize::from(k < t.failures), of: 1, ..t }));
    }
    near(fit_lognormal(&single).unwrap().dispersion, fit.dispersion, 1e-9);
}

#[test]
fn fragilities_without_a_maximum_are_refused() {
    let rows = |counts: &[(f64, usize)]| -> Vec<Trial> {
        counts.iter().map(|&(demand, failures)| Trial { demand, failures, of: 5 }).collect()
    };
    let fit = |counts: &[(f64, usize)]| fit_lognormal(&rows(counts));
    assert_eq!(fit(&[(1.0, 0), (2.0, 0)]), Err(FragilityError::OneSided { failures: 0, of: 10 }));
    assert_eq!(fit(&[(1.0, 0), (2.0, 5)]), Err(FragilityError::Separated { low: 1.0, high: 2.0 }));
    assert_eq!(fit(&[(1.0, 0), (2.0, 3)]), Err(FragilityError::Separated { low: 2.0, high: 2.0 }));
    assert!(matches!(fit(&[(1.0, 4), (2.0, 1)]), Err(FragilityError::NotRising { .. })));
    assert!(matches!(fit(&[(1.0, 5), (2.0, 0)]), Err(FragilityError::NotRising { .. })));
    assert!(matches!(fit(&[(0.0, 1), (2.0, 3)]), Err(FragilityError::Demand { row: 0, .. })));
    assert!(matches!(fit(&[(1.0, 6)]), Err(FragilityError::Count { row: 0, .. })));
    assert!(matches!(fit(&[]), Err(FragilityError::OneSided { of: 0, .. })));
    // Barely overlapping: the likelihood is nearly flat, and must still be maximised.
    let steep = fit(&[(1.0, 0), (1.999, 1), (2.0, 4), (3.0, 5)]).unwrap();
    assert!(steep.dispersion < 0.01 && (1.9..2.1).contains(&steep.median), "{steep:?}");
}

#[test]
fn intervals_of_the_median_cover_it() {
    let truth = Fragility { median: 1.5, dispersion: 0.3, covariance: [[0.0; 2]; 2], deviance: 0.0 };
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let (mut covered, mut fits) = (0, 0);
    for _ in 0..400 {
        let trial = |k: u32, rng: &mut ChaCha8Rng| {
            let demand = 0.6 + 0.3 * f64::from(k);
            Trial { demand, failures: (0..50).filter(|_| rng.random::<f64>() < truth.at(demand)).count(), of: 50 }
        };
        let trials: Vec<Trial> = (0..8).map(|k| trial(k, &mut rng)).collect();
        let [_, low, high] = fit_lognormal(&trials).unwrap().demand(0.5, 0.95);
        covered += u32::from((low..high).contains(&truth.median));
        fits += 1;
    }
    // 95 % ± 1.1 % (one standard error of 400 fits).
    assert!(fits == 400 && (367..=394).contains(&covered), "{covered} of {fits}");
}

#[test]
fn outcomes_are_grouped_without_splitting_equal_demands() {
    let outcomes: Vec<(f64, bool)> = (0..100).map(|k| (f64::from(1 + k / 10), k % 10 == 0)).collect();
    let groups = equal_groups(&outcomes, 10);
    assert_eq!(groups.len(), 10);
    assert!(groups.iter().all(|g| g.of == 10 && g.failures == 1 && g.demand.fract() == 0.0));
    let mixed = equal_groups(&[(1.0, false), (4.0, true)], 1);
    assert_eq!(mixed, [Trial { demand: 2.0, failures: 1, of: 2 }]);
    assert!(equal_groups(&[], 3).is_empty());
}

#[test]
fn power_rises_with_size_and_length() {
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    let mut attempts = Vec::new();
    for length in [10.0, 40.0] {
        for _ in 0..600 {
            let size = 0.02 * (4.0 * rng.random::<f64>()).exp();
            // Visible above 0.4/√length, by a factor e^±0.5 from attempt to attempt.
            let visible = 0.4 / f64::sqrt(length) * (0.5 * rng.sample::<f64, _>(StandardNormal)).exp();
            attempts.push(Attempt { size, length, named: size > visible });
        }
    }
    let curves = power_curves(&attempts, 8);
    assert_eq!(curves.iter().map(|c| c.length).collect::<Vec<_>>(), [10.0, 40.0]);
    for curve in &curves {
        assert_eq!(curve.groups.iter().map(|g| g.of).sum::<usize>(), 600);
        let exact = 0.4 / curve.length.sqrt() * (0.5 * normal_quantile(0.8)).exp();
        let [size, low, high] = curve.detectable(0.8).unwrap();
        assert!(low < size && size < high && (low * 0.95..high * 1.05).contains(&exact), "{low} {exact} {high}");
    }
}

#[test]
fn the_widest_swing_comes_first() {
    let swing = |name: &str, at_low, at_high| Swing { name: name.into(), at_low, at_high };
    let given = vec![swing("a", 0.9, 1.1), swing("b", f64::NAN, 1.0), swing("c", 1.5, 1.4), swing("d", 2.0, 0.5)];
    let sorted = tornado(1.0, given);
    assert_eq!(sorted.iter().map(|s| s.name.as_str()).collect::<Vec<_>>(), ["d", "c", "a", "b"]);
    assert_eq!((sorted[0].width(1.0), sorted[1].width(1.0)), (1.5, 0.5));
}

/// Margin of one point as a limit state of batches.
fn each(margin: impl Fn(&[f64]) -> f64) -> impl FnMut(&[Vec<f64>]) -> Result<Vec<f64>, Infallible> {
    move |points| Ok(points.iter().map(|u| margin(u)).collect())
}

/// Mean and relative scatter of the probability in 200 simulations of 1000 samples a level, the root of the mean
/// square of the claimed coefficient of variation, and the share of 95 % intervals that contain `exact`.
fn repeated(dimension: usize, margin: impl Fn(&[f64]) -> f64, exact: f64) -> [f64; 4] {
    const RUNS: u64 = 200;
    let results: Vec<Subset> = (0..RUNS)
        .map(|seed| subset(dimension, SubsetOptions { seed, ..Default::default() }, &mut each(&margin)).unwrap())
        .collect();
    let n = RUNS as f64;
    let mean = results.iter().map(|r| r.probability).sum::<f64>() / n;
    let scatter = (results.iter().map(|r| (r.probability - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt() / mean;
    let claimed = (results.iter().map(|r| r.variation.powi(2)).sum::<f64>() / n).sqrt();
    let covered = |r: &&Subset| (r.interval(0.95)[0]..r.interval(0.95)[1]).contains(&exact);
    let summary = [mean, scatter, claimed, results.iter().filter(covered).count() as f64 / n];
    let bounds = |k: usize| (results.iter().map(|r| r.variation_bounds[k].powi(2)).sum::<f64>() / n).sqrt();
    println!("{summary:?}, from the levels {} to {}", bounds(0), bounds(1));
    summary
}

/// The mean of 200 simulations is the exact probability, and the claimed coefficient of variation is the observed one.
fn honest([mean, scatter, claimed, covered]: [f64; 4], exact: f64) {
    near(mean, exact, 3.5 * scatter * exact / 200f64.sqrt());
    // The scatter of 200 simulations is itself known to 5 %, more where its distribution has a tail.
    assert!((0.75..1.3).contains(&(claimed / scatter)), "claimed {claimed}, observed {scatter}");
    assert!(covered >= 0.92, "{covered}");
}

/// Axially stressed beam of OpenTURNS' documentation: R − F/(100 π), R lognormal with mean 300 and deviation 30, F
/// normal with mean 75 000 and deviation 5000. OpenTURNS 1.27, 200 runs: mean 2.9573e-2, scatter 0.134, its own claim
/// 0.090.
#[test]
fn subset_simulation_of_the_beam_agrees_with_openturns() {
    let exact = 2.9198194625e-2;
    let deviation = 1.01f64.ln().sqrt();
    let mean = 300f64.ln() - 0.5 * deviation * deviation;
    let margin = |u: &[f64]| (mean + deviation * u[0]).exp() - (75e3 + 5e3 * u[1]) / (100.0 * PI);
    let found = repeated(2, margin, exact);
    honest(found, exact);
    near(found[0], 2.957300e-2, 3.0 * (0.134 + found[1]) * exact / 200f64.sqrt());
}

/// Limit state of OpenTURNS' example of subset sampling, both variables normal with mean 0.25. OpenTURNS 1.27, 200
/// runs: mean 3.8453e-4, scatter 0.389, its own claim 0.277.
#[test]
fn subset_simulation_of_the_cubic_agrees_with_openturns() {
    let exact = 3.8653980863e-4;
    let margin = |u: &[f64]| 20.0 - (u[0] - u[1]).powi(2) - 8.0 * (u[0] + u[1] + 0.5 - 4.0).powi(3);
    let found = repeated(2, margin, exact);
    honest(found, exact);
    near(found[0], 3.845328e-4, 3.0 * (0.389 + found[1]) * exact / 200f64.sqrt());
}

/// Series system of four branches [Waarts 2000]. OpenTURNS 1.27, 200 runs: mean 2.2260e-3, scatter 0.274, its own
/// claim 0.200.
#[test]
fn subset_simulation_of_four_branches_agrees_with_openturns() {
    let exact = 2.2227950662e-3;
    let margin = |u: &[f64]| {
        let (sum, difference) = ((u[0] + u[1]) / 2f64.sqrt(), u[0] - u[1]);
        let bent = 3.0 + 0.1 * difference * difference - sum.abs();
        bent.min(7.0 / 2f64.sqrt() - difference.abs())
    };
    let found = repeated(2, margin, exact);
    honest(found, exact);
    near(found[0], 2.226031e-3, 3.0 * (0.274 + found[1]) * exact / 200f64.sqrt());
}

/// Sockets in the manner of the robot: twelve holds that differ by 8 %, loaded by mass, offset, speed squared and
/// friction; the smallest of twelve margins.
fn sockets(u: &[f64]) -> f64 {
    let (mass, offset, speed, friction) = (2.5 + 0.4 * u[12], 0.06 + 0.01 * u[13], 1.0 + 0.05 * u[14], u[15]);
    let load = |k: usize| {
        let angle = PI / 6.0 * k as f64;
        let tilt = mass * (9.81 + 60.0 * speed * speed) * offset / 0.24;
        12.0 * mass * speed * speed + (tilt * angle.cos()).abs() + 4.0 * friction.abs()
    };
    (0..12).map(|k| 1.0 - load(k) / (167.0 * (1.0 + 0.08 * u[k]))).fold(f64::INFINITY, f64::min)
}

#[test]
fn a_failure_of_one_in_ten_thousand_agrees_with_a_million_runs() {
    const RUNS: usize = 1_000_000;
    let mut rng = ChaCha8Rng::seed_from_u64(77);
    let mut failures = 0;
    for _ in 0..RUNS {
        let u: [f64; 16] = std::array::from_fn(|_| rng.sample(StandardNormal));
        failures += usize::from(sockets(&u) <= 0.0);
    }
    let crude = wilson(failures, RUNS, 0.95);
    println!("crude: {failures} of {RUNS}");
    assert!(crude[0] > 0.5e-4 && crude[1] < 2e-4, "{crude:?}");
    let options = SubsetOptions { samples: 5000, seed: 1, ..Default::default() };
    let found = subset(16, options, &mut each(sockets)).unwrap();
    let interval = found.interval(0.95);
    println!("subset: {} ({interval:?}), c.o.v. {}, {} runs", found.probability, found.variation, found.evaluations);
    assert_eq!(found.ended, Ended::Reached);
    assert!(found.evaluations <= 20_000, "{}", found.evaluations);
    assert!(found.variation < 0.25, "{}", found.variation);
    assert!(interval[0] < crude[1] && crude[0] < interval[1], "{interval:?} {crude:?}");
    let again: Vec<f64> = found.failures.iter().map(|s| sockets(&s.point)).collect();
    assert!(again.is_sorted() && again.iter().all(|m| *m <= 0.0));
    assert!(found.failures.iter().zip(&again).all(|(s, m)| s.margin == *m));
}

#[test]
fn a_simulation_is_a_function_of_its_seed_and_of_nothing_else() {
    let run = |seed: u64, parallel: bool| {
        let options = SubsetOptions { samples: 200, seed, ..Default::default() };
        let mut largest = 0;
        let result = subset(16, options, &mut |points: &[Vec<f64>]| {
            largest = largest.max(points.len());
            let order: Vec<usize> =
                if parallel { (0..points.len()).rev().collect() } else { (0..points.len()).collect() };
            let mut margins = vec![0.0; points.len()];
            order.into_iter().for_each(|k| margins[k] = sockets(&points[k]));
            Ok::<_, Infallible>(margins)
        });
        assert_eq!(largest, 200);
        result.unwrap()
    };
    assert_eq!(run(4, false), run(4, true));
    assert_ne!(run(4, false).probability, run(5, false).probability);
}

#[test]
fn a_limit_state_without_failures_ends_honestly() {
    let options = SubsetOptions { samples: 100, ..Default::default() };
    // It does not fall below 1.
    let floor = subset(2, options, &mut each(|u| (u[0] + 3.0).max(1.0))).unwrap();
    assert_eq!((floor.ended, floor.failures.len()), (Ended::Stalled, 0));
    near(floor.probability, 0.5 * (1.0 - 0.954_499_736), 0.02);
    // A probability of 1e-30 is out of reach of four levels.
    let far = subset(2, SubsetOptions { levels: 4, ..options }, &mut each(|u| 11.5 - u[0])).unwrap();
    assert_eq!((far.ended, far.levels.len()), (Ended::Exhausted, 4));
    let tail = statrs::distribution::ContinuousCDF::sf(
        &statrs::distribution::Normal::standard(),
        11.5 - far.levels[3].threshold,
    );
    assert!((far.interval(0.95)[0]..far.interval(0.95)[1]).contains(&tail), "{tail:e} {far:?}");
    // A frequent failure is crude Monte Carlo.
    let often = subset(1, options, &mut each(|u| u[0])).unwrap();
    assert_eq!((often.levels.len(), often.evaluations), (1, 100));
    near(often.variation, often.levels[0].variation, 1e-12);
    // Infinite margins are margins.
    let walls = subset(1, options, &mut each(|u| if u[0] > 0.0 { f64::INFINITY } else { f64::NEG_INFINITY })).unwrap();
    assert_eq!(walls.ended, Ended::Reached);
}

#[test]
fn errors_of_a_simulation_name_their_place() {
    let message = |options: SubsetOptions| subset(2, options, &mut each(|u| u[0])).unwrap_err().to_string();
    let options = SubsetOptions::default();
    assert!(message(SubsetOptions { samples: 50, ..options }).contains("50 samples a level leave 5 seeds"));
    assert!(message(SubsetOptions { share: 0.7, ..options }).starts_with("share 0.7"));
    assert!(message(SubsetOptions { width: f64::NAN, ..options }).starts_with("width NaN"));
    assert!(message(SubsetOptions { levels: 0, ..options }).starts_with("0 levels"));
    assert!(subset(0, options, &mut each(|_| 1.0)).is_err());
    let error = subset(2, options, &mut each(|u| if u[0] > 2.0 { f64::NAN } else { 1.0 })).unwrap_err();
    assert!(matches!(&error, SubsetError::NotANumber { level: 0, point, .. } if point[0] > 2.0), "{error}");
    let short = subset(2, options, &mut |_: &[Vec<f64>]| Ok::<_, Infallible>(vec![1.0])).unwrap_err();
    assert!(matches!(short, SubsetError::Count { found: 1, expected: 1000 }));
    let own = subset(2, options, &mut |_: &[Vec<f64>]| Err("interrupted")).unwrap_err();
    assert!(matches!(own, SubsetError::Evaluation("interrupted")));
}

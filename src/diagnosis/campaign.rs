//! Synthetic campaigns: false alarms, power, collinear pairs, invariances.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

use super::*;

/// Samples per channel.
const N: usize = 1500;
/// Channels.
const C: usize = 4;

/// A random smooth series per channel: five sinusoids of 0.3…8 periods per hundred samples.
fn smooth(rng: &mut ChaCha8Rng, channels: usize, n: usize) -> Vec<f64> {
    let mut out = Vec::with_capacity(channels * n);
    for _ in 0..channels {
        let waves: Vec<[f64; 3]> = (0..5)
            .map(|_| {
                [
                    rng.random_range(0.02..0.5),
                    rng.random_range(0.0..6.3),
                    StandardNormal.sample(rng),
                ]
            })
            .collect();
        let start = out.len();
        out.resize(start + n, 0.0);
        for w in waves {
            // sin by the recurrence s(t+1) = 2 cos ω s(t) − s(t−1): six hundred campaigns need it quick.
            let (mut old, mut new) = (w[2] * (w[1] - w[0]).sin(), w[2] * w[1].sin());
            for x in &mut out[start..] {
                *x += new;
                (old, new) = (new, 2.0 * w[0].cos() * new - old);
            }
        }
    }
    out
}

fn column(name: &str, values: Vec<f64>) -> Column {
    Column {
        name: name.into(),
        values,
        magnitude: 0.0,
    }
}

/// AR(1) noise, correlated over channels; `uneven` lets its size swing by a factor of five.
fn noise(rng: &mut ChaCha8Rng, n: usize, uneven: bool) -> Vec<f64> {
    let mut out = vec![0.0; C * n];
    let mut state = [0.0; C];
    for t in 0..n {
        let common: f64 = StandardNormal.sample(rng);
        let size = if uneven {
            1.0 + 0.67 * (0.021 * t as f64).sin()
        } else {
            1.0
        };
        for c in 0..C {
            let own: f64 = StandardNormal.sample(rng);
            state[c] = 0.7 * state[c] + (c + 1) as f64 * (0.5 * common + own);
            out[c * n + t] = size * state[c];
        }
    }
    out
}

/// Ten base columns, twelve candidates: eight single columns, two of three columns, one shape grid, one generic group.
fn null_problem(seed: u64, uneven: bool) -> Problem {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let base: Vec<Column> = (0..10)
        .map(|i| column(&format!("base {i}"), smooth(&mut rng, C, N)))
        .collect();
    let mut candidates = Vec::new();
    for (k, columns) in [1, 1, 1, 1, 1, 1, 1, 1, 3, 3, 1, 4].into_iter().enumerate() {
        let name = format!("candidate {k}");
        let mut variants = vec![Variant {
            label: String::new(),
            columns: (0..columns)
                .map(|i| column(&format!("{name}.{i}"), smooth(&mut rng, C, N)))
                .collect(),
        }];
        if k < 3 {
            // Friction-like: jumps with the sign of a smooth series.
            variants[0].columns[0]
                .values
                .iter_mut()
                .for_each(|x| *x = x.signum());
        }
        if k == 10 {
            let shape = variants[0].columns[0].values.clone();
            let grid = [0.1, 0.5, 2.0].map(|w| Variant {
                label: format!("width {w}"),
                columns: vec![column(
                    "tanh",
                    shape.iter().map(|x| (x / w).tanh()).collect(),
                )],
            });
            variants = grid.to_vec();
        }
        candidates.push(Candidate {
            name,
            variants,
            generic: k == 11,
        });
    }
    let mut y = noise(&mut rng, N, uneven);
    for b in &base {
        y.iter_mut().zip(&b.values).for_each(|(y, x)| *y += 3.0 * x);
    }
    let channels = (0..C)
        .map(|c| Channel {
            name: format!("axis {c}"),
            noise_sigma: None,
        })
        .collect();
    Problem {
        channels,
        samples: N,
        segments: vec![0..500, 500..1000, 1000..N],
        y,
        base,
        candidates,
    }
}

/// Add a candidate's effect with the given RMS of the first column relative to channel 0's noise of about 1.6.
fn plant(problem: &mut Problem, candidate: usize, variant: usize, size: f64) {
    let columns = problem.candidates[candidate].variants[variant]
        .columns
        .clone();
    for z in columns {
        let rms = (z.values.iter().map(|x| x * x).sum::<f64>() / z.values.len() as f64).sqrt();
        problem
            .y
            .iter_mut()
            .zip(&z.values)
            .for_each(|(y, x)| *y += 1.6 * size / rms * x);
    }
}

fn quick() -> Settings {
    Settings {
        flips: 199,
        ..Settings::default()
    }
}

/// Nominal 5 %, 300 campaigns: the standard error is 1.26 points, so 2…9 % is the nominal value less 2.4 and plus 3.2 of them.
/// The relevance gate is not used here: it could only lower the count.
#[test]
fn null_campaigns_hold_the_family_wise_level() {
    for uneven in [false, true] {
        let alarm = |seed: &u64| {
            let r = evaluate(&null_problem(1000 + seed, uneven), &[], &quick()).unwrap();
            r.candidates.iter().any(|a| a.p_adjusted <= 0.05)
        };
        let alarms = (0..300_u64).into_par_iter().filter(alarm).count();
        assert!(
            (6..=27).contains(&alarms),
            "uneven {uneven}: {alarms} of 300"
        );
    }
}

/// `a` turned towards an independent `b`: correlation about `r` with `a`.
fn mix(a: &[f64], b: &[f64], r: f64) -> Vec<f64> {
    a.iter()
        .zip(b)
        .map(|(a, b)| r * a + (1.0 - r * r).sqrt() * b)
        .collect()
}

/// A null problem in which 3 is nearly a column of 8, 5 nearly 6, and 7 nearly the sum of the columns of 9.
fn collinear_problem(seed: u64, uneven: bool) -> Problem {
    let mut p = null_problem(seed, uneven);
    let first = |p: &Problem, k: usize| p.candidates[k].variants[0].columns[0].values.clone();
    let mut sum = vec![0.0; C * N];
    for z in &p.candidates[9].variants[0].columns {
        sum.iter_mut()
            .zip(&z.values)
            .for_each(|(s, x)| *s += x / 3.0_f64.sqrt());
    }
    for (k, towards, r) in [
        (3, first(&p, 8), 0.95),
        (5, first(&p, 6), 0.9),
        (7, sum, 0.9),
    ] {
        p.candidates[k].variants[0].columns[0].values = mix(&towards, &first(&p, k), r);
    }
    p
}

/// Effects of a quarter of the noise. Measured over 880 campaigns: found 99.8 %, named first 95 %, in the set 98 %,
/// exactly the true one 90 %. With 88 campaigns two standard errors are 1, 5, 3 and 6 points.
#[test]
fn planted_effect_is_found_named_and_in_the_set() {
    let one = |seed: u64| {
        let mut p = collinear_problem(5000 + seed, seed % 2 == 0);
        let planted = (seed % 11) as usize;
        plant(&mut p, planted, 0, 0.25);
        let o = select(&p, &quick()).unwrap();
        let Some(step) = o.steps.first() else {
            return [false; 4];
        };
        let set = step.ranking.confidence_set();
        let held = set.iter().any(|a| a.candidate == planted);
        [
            true,
            step.added.candidate == planted,
            held,
            o.found() == [planted],
        ]
    };
    let all: Vec<[bool; 4]> = (0..88).into_par_iter().map(one).collect();
    let counts = [0, 1, 2, 3].map(|i| all.iter().filter(|r| r[i]).count());
    let least = [86, 79, 83, 73];
    assert!(counts.iter().zip(least).all(|(c, l)| *c >= l), "{counts:?}");
}

/// Correlation 0.9995: no data of this size tells them apart, whichever is named.
#[test]
fn near_collinear_pair_is_indistinguishable() {
    for seed in 0..5 {
        let mut p = null_problem(300 + seed, false);
        let z = |k: usize| p.candidates[k].variants[0].columns[0].values.clone();
        let twin = mix(&z(4), &z(5), 0.9995);
        p.candidates[5].variants[0].columns[0].values = twin;
        plant(&mut p, 4, 0, 0.6);
        let o = select(&p, &quick()).unwrap();
        let set = o.findings[0].ranking.confidence_set();
        assert!(
            [4, 5].iter().all(|k| set.iter().any(|a| a.candidate == *k)),
            "seed {seed}"
        );
        assert!(set.iter().all(|a| a.overlap > 0.99));
        assert_eq!(o.verdict, Verdict::CannotTell);
    }
}

#[test]
fn two_planted_effects_are_both_found() {
    for seed in 0..6 {
        let mut p = null_problem(700 + seed, seed % 2 == 0);
        plant(&mut p, 1, 0, 0.5);
        plant(&mut p, 9, 0, 0.4);
        let mut found = select(&p, &quick()).unwrap().found();
        found.sort_unstable();
        assert!(
            [1, 9].iter().all(|k| found.contains(k)),
            "seed {seed}: {found:?}"
        );
    }
}

/// Units, the order of the candidates and the number of threads change no number beyond rounding: sums of 6000 products
/// are good to 1e-12, divided by the tolerance of the weakest column.
#[test]
fn scores_do_not_depend_on_scale_order_or_threads() {
    let mut p = collinear_problem(42, true);
    plant(&mut p, 3, 0, 0.3);
    let threads = |k: usize, p: &Problem| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(k)
            .build()
            .unwrap();
        pool.install(|| format!("{:?}", select(p, &quick()).unwrap()))
    };
    assert!(threads(1, &p) == threads(3, &p));

    let plain = evaluate(&p, &[], &quick()).unwrap();
    let mut other = p.clone();
    other.candidates.reverse();
    for (k, c) in other.candidates.iter_mut().enumerate() {
        let scale = 10.0_f64.powi(k as i32 - 6);
        c.variants
            .iter_mut()
            .flat_map(|v| &mut v.columns)
            .flat_map(|z| &mut z.values)
            .for_each(|x| *x *= scale);
    }
    other
        .base
        .iter_mut()
        .flat_map(|z| &mut z.values)
        .for_each(|x| *x *= 1e5);
    for c in 0..C {
        // Another unit for a channel: torque in mN·m.
        let rows = c * N..(c + 1) * N;
        let scale = 10.0_f64.powi(c as i32);
        other.y[rows.clone()].iter_mut().for_each(|x| *x *= scale);
        let columns = other
            .candidates
            .iter_mut()
            .flat_map(|c| &mut c.variants)
            .flat_map(|v| &mut v.columns);
        columns
            .chain(&mut other.base)
            .for_each(|z| z.values[rows.clone()].iter_mut().for_each(|x| *x *= scale));
    }
    let scaled = evaluate(&other, &[], &quick()).unwrap();
    let last = p.candidates.len() - 1;
    for a in &plain.candidates {
        let b = scaled.of(last - a.candidate).unwrap();
        approx::assert_relative_eq!(a.f_statistic, b.f_statistic, max_relative = 1e-6);
        approx::assert_relative_eq!(a.score, b.score, max_relative = 1e-6);
        approx::assert_relative_eq!(a.tolerance, b.tolerance, max_relative = 1e-6);
        approx::assert_relative_eq!(a.max_relevance(), b.max_relevance(), max_relative = 1e-6);
        assert_eq!(
            (a.p_adjusted, a.indistinguishable),
            (b.p_adjusted, b.indistinguishable)
        );
    }
}

#[test]
fn what_the_base_imitates_is_unseen() {
    let mut p = null_problem(11, false);
    for b in &mut p.base {
        b.magnitude = 2.0;
    }
    let inside = mix(&p.base[2].values, &p.base[7].values, 0.6);
    p.candidates[4].variants[0].columns[0].values = inside;
    p.candidates[6].variants[0].columns[0].values.fill(0.0);
    // 1e-3 of a column of RMS about 2 in noise of about 1 over 6000 rows: non-centrality below 0.03.
    p.candidates[7].variants[0].columns[0].magnitude = 1e-3;
    p.candidates[5].variants[0].columns[0].magnitude = 3.0;
    plant(&mut p, 4, 0, 1.0);
    let r = evaluate(&p, &[], &quick()).unwrap();
    let of = |k: usize| r.of(k).unwrap();
    assert_eq!(of(4).visibility, Visibility::InBaseSpan);
    assert_eq!(of(4).p_adjusted, 1.0);
    let names: Vec<&str> = of(4)
        .absorbed_by
        .iter()
        .map(|a| a.parameter.as_str())
        .collect();
    assert_eq!(names[..2], ["base 7", "base 2"]);
    // 0.8 and 0.6 of a parameter of 2.
    approx::assert_relative_eq!(of(4).absorbed_by[0].percent.unwrap(), 40.0, epsilon = 1e-4);
    approx::assert_relative_eq!(of(4).absorbed_by[1].percent.unwrap(), 30.0, epsilon = 1e-4);
    assert_eq!(of(6).visibility, Visibility::Empty);
    assert_eq!(of(7).visibility, Visibility::TooWeak);
    assert_eq!(of(5).visibility, Visibility::Visible);
    assert!(of(5).noncentrality.unwrap() > 13.0);
}

/// (estimate − truth)/(standard error) over 160 campaigns: the standard error of its standard deviation is 5.6 %, and 50 blocks
/// underestimate by a few percent; 0.85…1.2 is three of them.
#[test]
fn standard_errors_hold_under_autocorrelation_and_uneven_noise() {
    let z = |seed: u64| {
        let mut p = null_problem(9000 + seed, true);
        plant(&mut p, 5, 0, 0.3);
        let series = &p.candidates[5].variants[0].columns[0].values;
        let rms = (series.iter().map(|x| x * x).sum::<f64>() / series.len() as f64).sqrt();
        let r = evaluate_only(&p, &[], &[5], &quick()).unwrap();
        let c = &r.candidates[0].coefficients[0];
        // Base parameters are planted as 3.
        let b = &r.base[0];
        assert!(
            (b.value - 3.0).abs()
                < 6.0 * b.standard_error + 2.0 * (c.value * r.candidates[0].base_change[0]).abs()
        );
        (c.value - 1.6 * 0.3 / rms) / c.standard_error
    };
    let all: Vec<f64> = (0..160_u64).into_par_iter().map(z).collect();
    let spread = (all.iter().map(|x| x * x).sum::<f64>() / all.len() as f64).sqrt();
    assert!((0.85..1.2).contains(&spread), "{spread}");
}

/// An effect outside the catalogue, which only the generic group can imitate.
#[test]
fn effect_without_a_name_is_unknown() {
    let mut p = null_problem(21, false);
    plant(&mut p, 11, 0, 0.5);
    let o = select(&p, &quick()).unwrap();
    assert_eq!(o.verdict, Verdict::Unknown);
    assert!(!o.found().contains(&11));
    // A named candidate that imitates it badly is named, but not without objection.
    let z = p.candidates[11].variants[0].columns[0].values.clone();
    let values = &mut p.candidates[4].variants[0].columns[0].values;
    *values = mix(&z, values, 0.8);
    assert_eq!(select(&p, &quick()).unwrap().verdict, Verdict::Unknown);
}

/// Significance is not enough: a tiny effect in nearly noise-free data is below a given noise floor.
#[test]
fn irrelevant_effect_is_not_reported_and_share_refers_to_the_floor() {
    let mut p = null_problem(31, false);
    plant(&mut p, 4, 0, 0.5);
    let sigma = |k: f64| move |c: &mut Channel| c.noise_sigma = Some(k);
    p.channels.iter_mut().for_each(sigma(100.0));
    let o = select(&p, &quick()).unwrap();
    assert!(o.findings.is_empty() && o.verdict == Verdict::NothingFound);
    assert!(o.remaining.of(4).unwrap().p_adjusted <= 0.01);
    // Stationary deviation of the generator: (c + 1) √(1.25/(1 − 0.49)).
    for (c, channel) in p.channels.iter_mut().enumerate() {
        channel.noise_sigma = Some((c + 1) as f64 * (1.25_f64 / 0.51).sqrt());
    }
    let r = select(&p, &quick()).unwrap().findings.remove(0).ranking;
    assert!(r.floor_known && r.winner().unwrap().candidate == 4);
    // 2·0.03 is the sampling error of a correlated variance over 1500 samples, relative to an effect of a fifth of it.
    let share = r.winner().unwrap().explained_share;
    assert!(share.is_none_or(|s| s > 0.3), "{share:?}");
}

/// The refit gets what was found, and must return the same candidates.
#[test]
fn refit_is_called_and_checked() {
    let mut p = null_problem(51, false);
    plant(&mut p, 4, 0, 0.5);
    let mut calls = Vec::new();
    let o = select_with(&p, &quick(), |chosen, ranking| {
        calls.push((chosen.to_vec(), ranking.winner().map(|a| a.candidate)));
        Ok(Some(p.clone()))
    });
    let o = o.unwrap();
    assert_eq!(
        calls[0],
        (
            vec![Chosen {
                candidate: 4,
                variant: 0
            }],
            Some(4)
        )
    );
    assert!(o.refitted.is_some() && o.found().contains(&4));
    let mut fewer = p.clone();
    fewer.candidates.pop();
    let wrong = select_with(&p, &quick(), |_, _| Ok(Some(fewer.clone())));
    assert_eq!(wrong.err(), Some(Error::Candidates));
    let failed = select_with(&p, &quick(), |_, _| Err("no".into()));
    assert_eq!(failed.err(), Some(Error::Refit("no".into())));
}

#[test]
fn degenerate_problems_end_in_a_status() {
    let run = |p: &Problem| select(p, &quick());
    assert_eq!(run(&Problem::default()).err(), Some(Error::Empty));
    let good = null_problem(3, false);
    let edit = |change: &dyn Fn(&mut Problem)| {
        let mut p = good.clone();
        change(&mut p);
        run(&p)
    };
    assert!(edit(&|p| p.candidates.clear()).is_ok());
    assert!(edit(&|p| p.base.clear()).is_ok());
    assert!(edit(&|p| p.candidates[2].variants[0].columns.clear()).is_ok());
    assert!(edit(&|p| p.candidates[2].variants.clear()).is_ok());
    assert!(edit(&|p| p.candidates[2] = p.candidates[3].clone()).is_ok());
    assert!(edit(&|p| p.base[1] = p.base[0].clone()).is_ok());
    assert!(edit(&|p| p.base[1].values.fill(1.0)).is_ok());
    assert!(edit(&|p| p.y[..N].fill(0.0)).is_ok());
    assert!(edit(&|p| p.y.fill(4.0)).is_ok());
    assert!(
        edit(&|p| p.y = p.base[0].values.clone())
            .unwrap()
            .findings
            .is_empty()
    );
    assert!(matches!(
        edit(&|p| p.y.fill(0.0)),
        Err(Error::TooShort { .. })
    ));
    assert!(matches!(
        edit(&|p| p.segments = vec![0..60]),
        Err(Error::TooShort { .. })
    ));
    assert!(matches!(
        edit(&|p| p.segments = vec![0..60, 50..N]),
        Err(Error::Segment(1))
    ));
    assert!(matches!(
        edit(&|p| drop(p.y.pop())),
        Err(Error::Length { .. })
    ));
    assert_eq!(
        edit(&|p| p.y[7] = f64::NAN).err(),
        Some(Error::NotFinite("y".into()))
    );
    assert_eq!(
        edit(&|p| p.base[3].values[9] = f64::INFINITY).err(),
        Some(Error::NotFinite("base 3".into()))
    );
    let bad = edit(&|p| p.candidates[1].variants[0].columns[0].values[2000] = f64::NAN);
    assert_eq!(bad.err(), Some(Error::NotFinite("candidate 1.0".into())));
    let nowhere = [Chosen {
        candidate: 99,
        variant: 0,
    }];
    assert_eq!(
        evaluate(&good, &nowhere, &quick()).err(),
        Some(Error::Chosen(99))
    );
    let many = |p: &mut Problem| {
        let mut rng = ChaCha8Rng::seed_from_u64(8);
        p.candidates[0].variants[0].columns = (0..40)
            .map(|i| column(&i.to_string(), smooth(&mut rng, C, N)))
            .collect();
    };
    assert!(edit(&many).is_ok());
    let no_draws = Settings {
        flips: 0,
        blocks: 0,
        max_order: 0,
        max_steps: 0,
        ..Settings::default()
    };
    assert!(select(&good, &no_draws).is_ok());
}

/// 50 000 samples, four channels, 30 base columns, 20 candidates of 3 columns, two effects: budget 3 s.
#[test]
#[ignore = "measures time"]
fn large_problem_takes_less_than_three_seconds() {
    let n = 50_000;
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut columns = |count: usize| -> Vec<Column> {
        (0..count)
            .map(|i| column(&i.to_string(), smooth(&mut rng, C, n)))
            .collect()
    };
    let base = columns(30);
    let mut candidate = |k: usize| Candidate {
        name: k.to_string(),
        variants: vec![Variant {
            label: String::new(),
            columns: columns(3),
        }],
        generic: false,
    };
    let candidates = (0..20).map(&mut candidate).collect();
    let channels = (0..C)
        .map(|c| Channel {
            name: c.to_string(),
            noise_sigma: None,
        })
        .collect();
    let y = noise(&mut rng, n, true);
    let mut p = Problem {
        channels,
        samples: n,
        segments: vec![0..n],
        y,
        base,
        candidates,
    };
    plant(&mut p, 2, 0, 0.3);
    plant(&mut p, 7, 0, 0.3);
    let start = std::time::Instant::now();
    let outcome = select(&p, &Settings::default()).unwrap();
    assert!(start.elapsed().as_secs_f64() < 3.0);
    assert_eq!(outcome.found().len(), 2);
}

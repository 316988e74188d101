//! Degenerate input and run time.

use super::*;

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
    assert!(edit(&|p| p.y = p.base[0].values.clone()).unwrap().findings.is_empty());
    assert!(matches!(edit(&|p| p.y.fill(0.0)), Err(Error::TooShort { .. })));
    assert!(matches!(edit(&|p| p.segments = vec![0..60]), Err(Error::TooShort { .. })));
    assert!(matches!(edit(&|p| p.segments = vec![0..60, 50..N]), Err(Error::Segment(1))));
    assert!(matches!(edit(&|p| p.y.truncate(9)), Err(Error::Length { .. })));
    assert_eq!(edit(&|p| p.y[7] = f64::NAN).err(), Some(Error::NotFinite("y".into())));
    assert_eq!(edit(&|p| p.base[3].values[9] = f64::INFINITY).err(), Some(Error::NotFinite("base 3".into())));
    let bad = edit(&|p| p.candidates[1].variants[0].columns[0].values[2000] = f64::NAN);
    assert_eq!(bad.err(), Some(Error::NotFinite("candidate 1.0".into())));
    let nowhere = [Chosen { candidate: 99, variant: 0 }];
    assert_eq!(evaluate(&good, &nowhere, &quick()).err(), Some(Error::Chosen(99)));
    let many = |p: &mut Problem| {
        let mut rng = ChaCha8Rng::seed_from_u64(8);
        p.candidates[0].variants[0].columns = (0..40).map(|i| column(&i.to_string(), smooth(&mut rng, C, N))).collect();
    };
    assert!(edit(&many).is_ok());
    let no_draws = Settings { flips: 0, blocks: 0, max_order: 0, max_steps: 0, ..Settings::default() };
    assert!(select(&good, &no_draws).is_ok());
}

/// 50 000 samples, four channels, 30 base columns, 20 candidates of 3 columns, two effects: budget 3 s.
#[test]
#[ignore = "measures time"]
fn large_problem_takes_less_than_three_seconds() {
    let n = 50_000;
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut columns =
        |count: usize| -> Vec<Column> { (0..count).map(|i| column(&i.to_string(), smooth(&mut rng, C, n))).collect() };
    let base = columns(30);
    let mut candidate = |k: usize| Candidate {
        name: k.to_string(),
        variants: vec![Variant { label: String::new(), columns: columns(3) }],
        generic: false,
    };
    let candidates = (0..20).map(&mut candidate).collect();
    let channels = (0..C).map(|c| Channel { name: c.to_string(), noise_sigma: None }).collect();
    let y = noise(&mut rng, n, true);
    let mut p = Problem { channels, samples: n, segments: vec![0..n], y, base, candidates };
    plant(&mut p, 2, 0, 0.3);
    plant(&mut p, 7, 0, 0.3);
    let start = std::time::Instant::now();
    let outcome = select(&p, &Settings::default()).unwrap();
    assert!(start.elapsed().as_secs_f64() < 3.0);
    assert_eq!(outcome.found().len(), 2);
}

//! Calibration of the posterior probabilities of named effects.

use rayon::prelude::*;

use super::*;

/// Effects of 0.06 to 0.2 of the noise among candidates with three nearly collinear pairs, where about one name in
/// five is wrong. The claimed probabilities are reliable: in every class of claims, the share of right names equals
/// the claimed probability.
#[test]
#[ignore = "campaign"]
fn claimed_probabilities_come_true() {
    let one = |seed: u64| -> Option<(f64, bool)> {
        let mut p = collinear_problem(9000 + seed, seed.is_multiple_of(2));
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let planted = rng.random_range(0..11);
        plant(&mut p, planted, 0, rng.random_range(0.06..0.2));
        let ranking = evaluate(&p, &[], &quick()).unwrap();
        let c = confusion(&p, &ranking, &quick(), 100).unwrap()?;
        assert_eq!(c.truths[0], ranking.winner().map(|w| w.candidate));
        assert!(c.counts.iter().all(|row| row.iter().sum::<usize>() == c.runs && row.len() == c.truths.len()));
        Some((c.probabilities()[0], c.truths[0] == Some(planted)))
    };
    let all: Vec<(f64, bool)> = (0..300).into_par_iter().filter_map(one).collect();
    assert!(all.len() > 200, "{} found", all.len());
    let classes = [(0.0, 0.5), (0.5, 0.8), (0.8, 0.95), (0.95, 1.0)];
    for (low, high) in classes {
        let class: Vec<&(f64, bool)> = all.iter().filter(|(p, _)| *p >= low && *p <= high).collect();
        let n = class.len() as f64;
        let claimed = class.iter().map(|c| c.0).sum::<f64>() / n;
        let right = class.iter().filter(|c| c.1).count() as f64 / n;
        println!("{low}–{high}: {n} claims of {claimed:.3}, right {right:.3}");
        let error = (claimed * (1.0 - claimed) / n).sqrt().max(1.0 / n);
        assert!(n < 10.0 || (right - claimed).abs() < 3.0 * error + 0.03, "{low}–{high}: {n} {claimed} {right}");
    }
}

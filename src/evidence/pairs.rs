//! Pairs of effects, where one effect imitates a part of each of two others and forward selection begins with it.

use super::Error;
use super::evaluate::evaluate;
use super::problem::{Chosen, Problem, Settings};
use super::ranking::Ranking;
use super::stop::Stop;

/// Number of candidates that are tried as the first of a pair.
const FIRSTS: usize = 5;

/// Two effects that together leave less than each alone.
#[derive(Clone, Debug)]
pub struct Pair {
    /// The effects.
    pub chosen: [Chosen; 2],
    /// Energy that both leave of the residual, summed over the channels in units of the noise.
    pub left: f64,
}

/// The pairs of each of the five candidates that alone leave least and the effect that leaves least next to it, best
/// pair first; a beam search of that width where forward selection follows one path. Both must pass at their step.
/// Once `stop` returns true, no further pair is sought.
///
/// # Errors
/// As [`evaluate()`].
pub fn pairs(problem: &Problem, alone: &Ranking, settings: &Settings, stop: Stop) -> Result<Vec<Pair>, Error> {
    let mut all: Vec<Pair> = Vec::new();
    for (_, first) in alone.by_energy(settings).into_iter().take(FIRSTS) {
        if stop() {
            break;
        }
        let beside = evaluate(problem, &[first], settings)?;
        let Some(&(left, second)) = beside.by_energy(settings).first() else { continue };
        if all.iter().all(|p| p.chosen != [second, first]) {
            all.push(Pair { chosen: [first, second], left });
        }
    }
    all.sort_by(|a, b| a.left.total_cmp(&b.left));
    Ok(all)
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;
    use crate::evidence::{Candidate, Channel, Column, NEVER, Variant, select};

    /// y = a + b + noise, and c = a + b with a tenth of its own: forward selection begins with c and keeps it.
    #[test]
    fn a_pair_is_found_that_one_effect_imitates() {
        const SAMPLES: usize = 2000;
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut noise = || -> Vec<f64> { (0..SAMPLES).map(|_| StandardNormal.sample(&mut rng)).collect() };
        let (a, b, own, error) = (noise(), noise(), noise(), noise());
        let both: Vec<f64> = a.iter().zip(&b).map(|(a, b)| a + b).collect();
        let mixed =
            |x: &[f64], y: &[f64], share: f64| -> Vec<f64> { x.iter().zip(y).map(|(x, y)| x + share * y).collect() };
        let candidate = |name: &str, values: Vec<f64>| Candidate {
            name: name.into(),
            variants: vec![Variant {
                label: String::new(),
                columns: vec![Column { name: name.into(), values: values.into(), magnitude: 1.0 }],
            }],
        };
        let problem = Problem {
            channels: vec![Channel { name: "tau1".into(), noise_sigma: Some(0.05) }],
            samples: SAMPLES,
            segments: vec![0..SAMPLES],
            y: mixed(&both, &error, 0.05).into(),
            base: Vec::new(),
            candidates: vec![
                candidate("a", a.clone()),
                candidate("b", b.clone()),
                candidate("c", mixed(&both, &own, 0.1)),
            ],
        };
        let settings = Settings { max_steps: 1, ..Settings::default() };
        let greedy = select(&problem, &settings).unwrap();
        assert_eq!(greedy.found(), [2]);
        let pairs = pairs(&problem, &greedy.steps[0].ranking, &settings, NEVER).unwrap();
        let mut best = pairs[0].chosen.map(|c| c.candidate);
        best.sort_unstable();
        assert_eq!(best, [0, 1]);
        // One channel of noise.
        assert!((pairs[0].left - 1.0).abs() < 0.1, "{}", pairs[0].left);
        assert!(pairs[1].left > 1.1);
    }
}

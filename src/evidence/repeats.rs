//! Analysis of variance of a series that is measured several times: what repeats, what drifts, and what is noise.
//!
//! The difference between repeats of one motion is noise, whatever the model. With e_l(τ) of L laps at phase τ, the mean
//! square of e is repeats² + drift² + noise²:
//!
//! - noise²: what neither the mean over the laps nor a trend over them contains, unbiased,
//! - drift²: a trend over the laps at equal phase, a polynomial of degree 0 (L = 2), 1 (L = 3, 4) or 2,
//! - repeats²: mean over the laps squared, minus noise²/L.

/// Estimates of the three parts; in the unit of the series, with standard errors.
#[derive(Clone, Debug, PartialEq)]
pub struct Parts {
    /// RMS of the series.
    pub rms: f64,
    /// RMS of the part that repeats, and its standard error.
    pub repeats: (f64, f64),
    /// Standard deviation of the noise, and its standard error.
    pub noise: (f64, f64),
    /// RMS of the trend over the laps; zero if it is not significant.
    pub drift: f64,
    /// Change of the trend from the first lap to the last at each phase; empty if it is not significant.
    pub change: Vec<f64>,
    /// Whether the noise of one lap exceeds that of the others by more than chance: an event, and not noise.
    pub uneven: bool,
}

/// Highest degree of the trend.
const DEGREE: usize = 2;
/// Standard errors of ln(variance ratio) from which a trend is significant, and least share of the mean square.
const TREND: (f64, f64) = (4.0, 0.01);
/// Standard errors and ratio from which the noise of one lap exceeds that of the others.
const UNEVEN: (f64, f64) = (5.0, 1.5);

/// Parts of `laps`, all of equal length; `None` with fewer than two laps or without samples.
pub fn parts(laps: &[Vec<f64>]) -> Option<Parts> {
    let (count, n) = (laps.len(), laps.first()?.len());
    if count < 2 || n == 0 {
        return None;
    }
    let (l, phases) = (count as f64, n as f64);
    let trend = contrasts(count, DEGREE.min((count - 1) / 2));
    let mean: Vec<f64> = (0..n).map(|k| laps.iter().map(|e| e[k]).sum::<f64>() / l).collect();
    let along = |u: &[f64]| -> Vec<f64> { (0..n).map(|k| u.iter().zip(laps).map(|(u, e)| u * e[k]).sum()).collect() };
    let slopes: Vec<Vec<f64>> = trend.iter().map(|u| along(u)).collect();
    let rest = |with_trend: bool| -> Vec<Vec<f64>> {
        let of = |(i, e): (usize, &Vec<f64>)| {
            let trended = |k: usize| trend.iter().zip(&slopes).map(|(u, s)| u[i] * s[k]).sum::<f64>();
            (0..n).map(|k| e[k] - mean[k] - if with_trend { trended(k) } else { 0.0 }).collect()
        };
        laps.iter().enumerate().map(of).collect()
    };
    let square = |x: &[f64]| x.iter().map(|v| v * v).sum::<f64>();
    let all = |x: &[Vec<f64>]| x.iter().map(|v| square(v)).sum::<f64>();
    // Noise with memory has fewer independent phases.
    let mut left = rest(true);
    let [time, squared] = memory(&left);
    let mut freedom = l - 1.0 - trend.len() as f64;
    let (of_trend, of_rest) = (all(&slopes) / phases, all(&left) / phases);
    let mut drift = of_trend - trend.len() as f64 * of_rest / freedom;
    let error = (2.0 * squared / phases * (1.0 / trend.len().max(1) as f64 + 1.0 / freedom)).sqrt();
    let ratio = of_trend / trend.len().max(1) as f64 / (of_rest / freedom).max(f64::MIN_POSITIVE);
    let total = all(laps) / (l * phases);
    let drifts = !trend.is_empty() && ratio.ln() > TREND.0 * error && drift > TREND.1 * l * total;
    if !drifts {
        (left, freedom, drift) = (rest(false), l - 1.0, 0.0);
    }
    let noise = all(&left) / (phases * freedom);
    let repeats = (square(&mean) / phases - noise / l).max(0.0);
    let of_noise = noise * (2.0 * squared / (phases * freedom)).sqrt();
    // var(mean(m + ε)²) = 4 m²·var(ε̄) + 2 var(ε)², with var(ε) = noise²/L at every phase.
    let of_repeats = (4.0 * repeats * noise / l * time + 2.0 * (noise / l).powi(2) * squared) / phases;
    let of_repeats = (of_repeats + (of_noise / l).powi(2)).sqrt();
    // d√x = dx/(2√x), and not more than √dx at zero.
    let root = |x: f64, dx: f64| (x.sqrt(), if x > dx { 0.5 * dx / x.sqrt() } else { dx.sqrt() });
    let most = left.iter().map(|e| square(e)).fold(0.0, f64::max) / (all(&left) / l).max(f64::MIN_POSITIVE);
    let ends = |k: usize| trend.iter().zip(&slopes).map(|(u, s)| (u[count - 1] - u[0]) * s[k]).sum();
    Some(Parts {
        rms: total.sqrt(),
        repeats: root(repeats, of_repeats),
        noise: root(noise, of_noise),
        drift: (drift / l).max(0.0).sqrt(),
        change: if drifts { (0..n).map(ends).collect() } else { Vec::new() },
        uneven: count > 2 && most > UNEVEN.1.max(1.0 + UNEVEN.0 * (2.0 * squared / phases).sqrt()),
    })
}

/// Orthonormal polynomials of the degrees 1 to `degree` over `count` equally spaced laps.
fn contrasts(count: usize, degree: usize) -> Vec<Vec<f64>> {
    let mut all: Vec<Vec<f64>> = vec![vec![1.0 / (count as f64).sqrt(); count]];
    for p in 1..=degree {
        let mut u: Vec<f64> = (0..count).map(|i| (2.0 * i as f64 / (count - 1) as f64 - 1.0).powi(p as i32)).collect();
        for v in &all {
            let share = super::dot(&u, v);
            u.iter_mut().zip(v).for_each(|(u, v)| *u -= share * v);
        }
        let norm = super::dot(&u, &u).sqrt();
        u.iter_mut().for_each(|u| *u /= norm);
        all.push(u);
    }
    all.split_off(1)
}

/// Integrated autocorrelation 1 + 2Σρ and its square 1 + 2Σρ², at least one: samples per independent mean and variance.
///
/// The sums stop at the first lag beyond five times the running value [Sokal 1997].
fn memory(segments: &[Vec<f64>]) -> [f64; 2] {
    let at = |lag: usize| -> f64 {
        segments.iter().filter(|s| s.len() > lag).map(|s| super::dot(&s[lag..], &s[..s.len() - lag])).sum()
    };
    let (zero, longest) = (at(0), segments.iter().map(Vec::len).max().unwrap_or(0) / 4);
    if zero.is_nan() || zero <= 0.0 {
        return [1.0; 2];
    }
    let mut times = [1.0f64; 2];
    for lag in 1..=longest {
        let rho = at(lag) / zero;
        times = [times[0] + 2.0 * rho, times[1] + 2.0 * rho * rho];
        if lag as f64 >= 5.0 * times[0].max(times[1]) {
            break;
        }
    }
    times.map(|t| t.max(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    /// Two-way analysis of variance of 2 laps and 3 phases by hand: lap means differ by 2, 0 and −2 at the phases, so
    /// noise² = (4 + 0 + 4)/(2·3) = 4/3; means 2, 4, 6: repeats² = 56/3 − 4/3/2 = 18.
    #[test]
    fn two_laps_by_hand() {
        let p = parts(&[vec![1.0, 4.0, 7.0], vec![3.0, 4.0, 5.0]]).unwrap();
        assert!((p.noise.0.powi(2) - 4.0 / 3.0).abs() < 1e-12, "{p:?}");
        assert!((p.repeats.0.powi(2) - 18.0).abs() < 1e-12, "{p:?}");
        assert!((p.rms.powi(2) - 116.0 / 6.0).abs() < 1e-12 && p.drift == 0.0 && p.change.is_empty(), "{p:?}");
        assert_eq!((parts(&[vec![1.0]]), parts(&[])), (None, None));
    }

    /// Noise white and AR(1) over a known course, 100 draws: the estimates scatter by what they state.
    #[test]
    fn estimates_scatter_by_their_standard_errors() {
        for (a, laps, n) in [(0.0, 2, 400), (0.8, 3, 800), (0.8, 8, 400)] {
            let mut rng = ChaCha8Rng::seed_from_u64(1);
            let mut z = [Vec::new(), Vec::new()];
            for _ in 0..100 {
                let mut lap = || {
                    let mut e: f64 = StandardNormal.sample(&mut rng);
                    let innovation = |x: f64| (1.0f64 - a * a).sqrt() * x;
                    let one = |k: usize| {
                        e = a * e + innovation(StandardNormal.sample(&mut rng));
                        0.5 * 2f64.sqrt() * (0.05 * k as f64).sin() + 0.4 * e
                    };
                    (0..n).map(one).collect::<Vec<f64>>()
                };
                let p = parts(&(0..laps).map(|_| lap()).collect::<Vec<_>>()).unwrap();
                let course = (0..n).map(|k| 0.5 * (0.05 * k as f64).sin().powi(2)).sum::<f64>() / n as f64;
                z[0].push((p.noise.0 - 0.4) / p.noise.1);
                z[1].push((p.repeats.0 - course.sqrt()) / p.repeats.1);
            }
            for z in z {
                let rms = (z.iter().map(|z| z * z).sum::<f64>() / z.len() as f64).sqrt();
                // The RMS of 100 standard normal values has the standard error 0.07.
                assert!((0.75..1.3).contains(&rms), "{a} {laps}: {rms}");
            }
        }
    }

    /// A course that decays from lap to lap by −0.6 in all, on noise 0.3: found as a trend, and not as noise.
    #[test]
    fn a_trend_is_not_noise() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let mut lap = |l: usize, size: f64| -> Vec<f64> {
            let mut noise = || -> f64 { StandardNormal.sample(&mut rng) };
            (0..2000)
                .map(|k| (1.0 - size * l as f64 / 5.0) * if k % 400 < 200 { 1.0 } else { -1.0 } + 0.3 * noise())
                .collect()
        };
        let p = parts(&(0..6).map(|l| lap(l, 0.6)).collect::<Vec<_>>()).unwrap();
        assert!((p.noise.0 - 0.3).abs() < 4.0 * p.noise.1 && p.noise.1 < 0.005, "{p:?}");
        let mean = p.change.iter().take(200).sum::<f64>() / 200.0;
        assert!((mean + 0.6).abs() < 0.1, "{mean}");
        // Values 0.4 … 1 in six steps: mean 0.7, standard deviation 0.2049.
        assert!((p.drift - 0.2049).abs() < 0.02 && (p.repeats.0 - 0.7).abs() < 0.02, "{p:?}");
        let p = parts(&(0..6).map(|l| lap(l, 0.0)).collect::<Vec<_>>()).unwrap();
        assert!(p.change.is_empty() && !p.uneven, "{p:?}");
    }

    #[test]
    fn a_lap_of_its_own_is_uneven() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut lap = |size: f64| -> Vec<f64> {
            (0..1000).map(|_| -> f64 { StandardNormal.sample(&mut rng) }).map(|x| size * x).collect()
        };
        assert!(parts(&[lap(1.0), lap(1.0), lap(3.0), lap(1.0), lap(1.0), lap(1.0)]).unwrap().uneven);
    }
}

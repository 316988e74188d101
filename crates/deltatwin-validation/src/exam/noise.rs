//! Noise of torque and force sensors, added to noise-free recordings of a twin.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use deltatwin::machine::{PerAxis, each};
use deltatwin::recording::{Channel, Signals};

/// Kind of torque noise. Its standard deviation over the recording is the stated one for every kind, except that the
/// drift is added to it. Strut forces always have white noise, because their amplifier is separate from the drives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord, clap::ValueEnum)]
pub enum Noise {
    /// Independent from sample to sample and from axis to axis.
    #[default]
    White,
    /// First-order autoregressive with a memory of 5–50 ms, correlated across axes.
    Autocorrelated,
    /// As autocorrelated, and growing with joint speed.
    Speed,
    /// White, on a bias that walks at random.
    Drift,
}

impl Noise {
    /// All kinds.
    pub const ALL: [Self; 4] = [Self::White, Self::Autocorrelated, Self::Speed, Self::Drift];

    /// Name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::White => "white",
            Self::Autocorrelated => "autocorrelated",
            Self::Speed => "speed",
            Self::Drift => "drift",
        }
    }
}

impl std::fmt::Display for Noise {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
}

/// Range of the correlation time of autocorrelated noise, s.
const MEMORY: (f64, f64) = (5e-3, 50e-3);
/// Share of the variance common to all axes.
const COMMON: f64 = 0.4;
/// Ratio of σ at RMS speed to σ at rest, minus one.
const GROWTH: f64 = 1.0;
/// Standard deviation of the drift at the end of a recording, in units of σ.
const WALK: f64 = 0.3;
/// Time over which the speed is averaged, s.
const SPEED_TIME: f64 = 8e-3;

/// Adds noise with the standard deviations `torque` (N·m per axis) and `force` (N).
pub fn lay(kind: Noise, torque: &PerAxis<f64>, force: f64, signals: &mut Signals, rng: &mut ChaCha8Rng) {
    let axes = signals.mechanism.axes();
    let envelope = if kind == Noise::Speed { growth(signals, axes) } else { Vec::new() };
    let memory = MEMORY.0 * (MEMORY.1 / MEMORY.0).powf(rng.random_range(0.0..1.0));
    let a = match kind {
        Noise::Autocorrelated | Noise::Speed => (-signals.sample_time() / memory).exp(),
        Noise::White | Noise::Drift => 0.0,
    };
    let common = if a > 0.0 { COMMON } else { 0.0 };
    let walk = WALK / (signals.len().max(1) as f64).sqrt();
    let mut shared = normal(rng);
    let mut own: PerAxis<f64> = std::array::from_fn(|_| normal(rng));
    let mut bias: PerAxis<f64> = each(0.0);
    let fresh = (1.0 - a * a).sqrt();
    let mut rows: Vec<PerAxis<f64>> = signals.tau().iter().collect();
    for (k, tau) in rows.iter_mut().enumerate() {
        for i in 0..axes {
            let scale = envelope.get(k).map_or(1.0, |e| e[i]);
            tau[i] += torque[i] * (scale * (common.sqrt() * shared + (1.0 - common).sqrt() * own[i]) + bias[i]);
            own[i] = a * own[i] + fresh * normal(rng);
            if kind == Noise::Drift {
                bias[i] += walk * normal(rng);
            }
        }
        shared = a * shared + fresh * normal(rng);
    }
    signals.set_rows(Channel::Torque, &rows);
    let is_force = |channel| matches!(channel, Channel::StrutUpper(_) | Channel::StrutLower(_));
    for (_, values) in signals.series_mut().filter(|(channel, _)| is_force(*channel)) {
        values.iter_mut().for_each(|x| *x += force * normal(rng));
    }
}

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// Scale of the noise at every sample, with mean square one: 1 + growth·|q̇|/rms(q̇).
fn growth(signals: &Signals, axes: usize) -> Vec<PerAxis<f64>> {
    let n = signals.len();
    let reach = ((0.5 * SPEED_TIME / signals.sample_time()).round() as usize).clamp(1, n.max(2) / 2);
    let mut scale = vec![each(1.0); n];
    for i in 0..axes {
        let q = &signals[Channel::Angle(i)];
        let speed: Vec<f64> = (0..n)
            .map(|k| {
                let (from, to) = (k.saturating_sub(reach), (k + reach).min(n - 1));
                (q[to] - q[from]).abs() / (signals.t[to] - signals.t[from])
            })
            .collect();
        let rms = mean_square(&speed).sqrt().max(f64::MIN_POSITIVE);
        let raw: Vec<f64> = speed.iter().map(|v| 1.0 + GROWTH * v / rms).collect();
        let norm = mean_square(&raw).sqrt();
        for (s, r) in scale.iter_mut().zip(raw) {
            s[i] = r / norm;
        }
    }
    scale
}

fn mean_square(x: &[f64]) -> f64 {
    x.iter().map(|v| v * v).sum::<f64>() / x.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::rand_core::SeedableRng;

    /// Noise of a machine in oscillation, N·m.
    fn noise(kind: Noise, seed: u64) -> Vec<PerAxis<f64>> {
        let n = 50_000;
        let t: Vec<f64> = (0..n).map(|k| k as f64 * 4e-4).collect();
        let q: Vec<_> = t.iter().map(|t| std::array::from_fn(|i| 0.3 * ((3.0 + i as f64) * t).sin())).collect();
        let mut signals = Signals::of_drives(Default::default(), t, &q, &vec![each(0.0); n]);
        lay(kind, &[0.4, 0.4, 0.4, 0.05], 0.5, &mut signals, &mut ChaCha8Rng::seed_from_u64(seed));
        signals.tau().iter().collect()
    }

    fn correlation(x: impl Iterator<Item = (f64, f64)>) -> f64 {
        let [mut a, mut b, mut c] = [0.0; 3];
        for (x, y) in x {
            a += x * x;
            b += y * y;
            c += x * y;
        }
        c / (a * b).sqrt()
    }

    #[test]
    fn every_kind_has_the_stated_size_and_its_own_memory() {
        for kind in Noise::ALL {
            let x = noise(kind, 5);
            let rms = |i: usize| mean_square(&x.iter().map(|v| v[i]).collect::<Vec<_>>()).sqrt();
            // A correlation time of 50 ms leaves 200 independent samples, ±5 %; the drift adds 0.3²/2.
            assert!(
                (0.36..0.45).contains(&rms(0)) && (0.044..0.056).contains(&rms(3)),
                "{kind}: {} {}",
                rms(0),
                rms(3)
            );
            let next = correlation(x.windows(2).map(|w| (w[0][1], w[1][1])));
            let across = correlation(x.iter().map(|v| (v[0], v[2])));
            match kind {
                Noise::White => assert!(next.abs() < 0.03 && across.abs() < 0.03, "{next} {across}"),
                Noise::Autocorrelated | Noise::Speed => {
                    assert!(next > 0.9 && (0.2..0.6).contains(&across), "{kind}: {next} {across}");
                }
                Noise::Drift => assert!(next.abs() < 0.3, "{next}"),
            }
        }
    }

    #[test]
    fn noise_grows_with_speed_where_it_is_said_to() {
        let x = noise(Noise::Speed, 2);
        let of = |fast: bool| {
            let at = |k: usize| (3.0 * k as f64 * 4e-4).cos().abs();
            let chosen = x.iter().enumerate().filter(|(k, _)| (at(*k) > 0.9) == fast && (at(*k) > 0.9 || at(*k) < 0.2));
            mean_square(&chosen.map(|(_, v)| v[0]).collect::<Vec<_>>()).sqrt()
        };
        assert!(of(true) > 1.5 * of(false), "{} {}", of(true), of(false));
    }
}

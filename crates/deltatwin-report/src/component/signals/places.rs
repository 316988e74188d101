//! Residuals over angle, rate, acceleration and torque of the channel's own axis, and over frequency.

use deltatwin::identification::Dataset;
use deltatwin::recording::Channel;
use serde_json::{Value, json};

use crate::drawing::residual::amplitude_spectrum;

/// Number of bins over a quantity, and of lines of a spectrum.
const BINS: usize = 60;
const LINES: usize = 160;
/// Least number of samples of a bin.
const FEW: usize = 3;

/// For every channel its residuals binned over q, q̇, q̈ and τ of its axis (mean and standard deviation per stage), and the
/// spectra of its longest stretch.
pub fn of(dataset: &Dataset, left: &[Vec<Vec<f64>>]) -> Vec<Value> {
    let longest = dataset.segments.iter().max_by_key(|s| s.len()).cloned().unwrap_or(0..0);
    let one = |c: usize| {
        let channel = dataset.channels[c];
        let (axis, unit) = (channel.limb(), Channel::Angle(0).unit(dataset.mechanism));
        let of = |f: &dyn Fn(usize) -> f64| (0..dataset.len()).map(f).collect::<Vec<f64>>();
        let own = dataset.channels.iter().position(|other| other.drive() == Some(axis)).unwrap_or(c);
        let torque = dataset.channels[own];
        let n = axis + 1;
        let over = [
            (format!("axis {n} angle / {unit}"), of(&|k| dataset.joints[k].q[axis])),
            (format!("axis {n} speed / {unit}/s"), of(&|k| dataset.joints[k].qd[axis])),
            (format!("axis {n} acceleration / {unit}/s²"), of(&|k| dataset.joints[k].qdd[axis])),
            (
                format!("{} / {}", torque.title(dataset.mechanism), torque.unit(dataset.mechanism)),
                dataset.measured[own].to_vec(),
            ),
        ];
        let bins: Vec<Value> = over.iter().map(|(label, x)| binned(label, x, left, c)).collect();
        let spectra: Vec<(Vec<f64>, Vec<f64>)> =
            left.iter().map(|l| amplitude_spectrum(&l[c][longest.clone()], dataset.period(&longest))).collect();
        json!({"over": bins, "spectrum": spectrum(&spectra)})
    };
    (0..dataset.channels.len()).map(one).collect()
}

/// Means and standard deviations of the residuals in equal bins over the middle 99.8 % of `x`.
fn binned(label: &str, x: &[f64], left: &[Vec<Vec<f64>>], c: usize) -> Value {
    let mut sorted: Vec<f64> = x.iter().copied().filter(|v| v.is_finite()).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let cut = sorted.len() / 1000;
    let (Some(&low), Some(&high)) = (sorted.get(cut), sorted.get(sorted.len().saturating_sub(1 + cut))) else {
        return json!({"label": label, "x": [], "stages": []});
    };
    let width = (high - low).max(f64::MIN_POSITIVE) / BINS as f64;
    let bin = |v: f64| if v < low || v > high { None } else { Some((((v - low) / width) as usize).min(BINS - 1)) };
    let bins: Vec<Option<usize>> = x.iter().map(|v| bin(*v)).collect();
    let stage = |l: &Vec<Vec<f64>>| {
        let mut sums = vec![(0_usize, 0.0, 0.0); BINS];
        for (b, r) in bins.iter().zip(&l[c]) {
            let Some(b) = b else { continue };
            let s = &mut sums[*b];
            s.0 += 1;
            let d = r - s.1;
            s.1 += d / s.0 as f64;
            s.2 += d * (r - s.1);
        }
        let of = |f: &dyn Fn(&(usize, f64, f64)) -> f64| -> Vec<Value> {
            sums.iter().map(|s| if s.0 < FEW { Value::Null } else { short(f(s)) }).collect()
        };
        json!({"mean": of(&|s| s.1), "std": of(&|s| (s.2 / (s.0 as f64 - 1.0)).max(0.0).sqrt())})
    };
    let centres: Vec<Value> = (0..BINS).map(|k| short(low + (k as f64 + 0.5) * width)).collect();
    json!({"label": label, "x": centres, "stages": left.iter().map(stage).collect::<Vec<_>>()})
}

/// Spectra on frequencies of equal ratio, of each the largest amplitude around it.
fn spectrum(spectra: &[(Vec<f64>, Vec<f64>)]) -> Value {
    let Some((frequency, _)) = spectra.first().filter(|(f, _)| f.len() > 2) else {
        return json!({"x": [], "stages": []});
    };
    let (low, high) = (frequency[0], frequency[frequency.len() - 1]);
    let ratio = (high / low).powf(1.0 / LINES as f64);
    let mut edges: Vec<usize> =
        (0..=LINES).map(|k| frequency.partition_point(|f| *f < low * ratio.powi(k as i32) * (1.0 - 1e-9))).collect();
    edges.dedup();
    if let Some(last) = edges.last_mut() {
        *last = frequency.len();
    }
    let ranges: Vec<(usize, usize)> = edges.windows(2).map(|w| (w[0], w[1])).collect();
    let x: Vec<Value> = ranges.iter().map(|(a, b)| short(frequency[(a + b - 1) / 2])).collect();
    let largest = |amplitude: &Vec<f64>| -> Vec<Value> {
        ranges.iter().map(|(a, b)| short(amplitude[*a..*b].iter().copied().fold(0.0, f64::max))).collect()
    };
    json!({"x": x, "stages": spectra.iter().map(|(_, a)| largest(a)).collect::<Vec<_>>()})
}

/// A number with four significant digits, null if it is not finite.
pub fn short(x: f64) -> Value {
    if !x.is_finite() {
        return Value::Null;
    }
    json!(format!("{x:.3e}").parse::<f64>().unwrap_or(x))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bins_have_the_mean_of_their_samples() {
        // Residual 2 below and −1 above the middle of the range.
        let x: Vec<f64> = (0..600).map(|k| f64::from(k) / 599.0).collect();
        let left = vec![vec![x.iter().map(|x| if *x < 0.5 { 2.0 } else { -1.0 }).collect::<Vec<f64>>()]];
        let bins = binned("x", &x, &left, 0);
        let mean = bins["stages"][0]["mean"].as_array().unwrap();
        assert_eq!((mean.len(), mean[3].as_f64(), mean[55].as_f64()), (BINS, Some(2.0), Some(-1.0)));
        assert_eq!(bins["stages"][0]["std"][3].as_f64(), Some(0.0));
    }

    #[test]
    fn no_line_of_a_spectrum_is_lost() {
        let frequency: Vec<f64> = (1..=5000).map(|k| 0.05 * f64::from(k)).collect();
        for line in [0, 1, 57, 1234, 4999] {
            let mut amplitude = vec![0.0; frequency.len()];
            amplitude[line] = 7.0;
            let s = spectrum(&[(frequency.clone(), amplitude)]);
            let found = s["stages"][0].as_array().unwrap().iter().filter(|a| a.as_f64() == Some(7.0)).count();
            assert_eq!(found, 1, "{line}");
        }
    }
}

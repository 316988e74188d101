//! How far model and measurement are apart, and where.

pub mod command;

use crate::dynamics::Channel;
use crate::identification::Trace;
use crate::identification::fit::{FitError, channel_rms, residuals};
use crate::model::Model;

/// Residuals of a model as it stands, without refitting.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// Channels of the following arrays.
    pub channels: Vec<Channel>,
    /// RMS residual.
    pub rms: Vec<f64>,
    /// Standard deviation of the sensor noise.
    pub noise_floor: Vec<f64>,
    /// RMS residual on held-out data.
    pub held_out_rms: Option<Vec<f64>>,
    /// What stands out, largest share first.
    pub findings: Vec<Finding>,
}

/// A place where the residual concentrates.
#[derive(Clone, Debug)]
pub struct Finding {
    /// Channel.
    pub channel: Channel,
    /// Kind of place, e.g. `speed`.
    pub place: String,
    /// Share of the channel's residual variance that the place explains, beyond chance.
    pub share: f64,
    /// One sentence.
    pub sentence: String,
}

/// Compares a model with recordings.
pub fn compare(model: &Model, traces: &[Trace], held_out: &[Trace]) -> Result<Comparison, FitError> {
    let all = residuals(model, traces)?;
    let rms = channel_rms(&all);
    let noise_floor = crate::identification::trace::noise_floor(model, traces);
    let held_out_rms = if held_out.is_empty() { None } else { Some(channel_rms(&residuals(model, held_out)?)) };
    let channels = traces[0].channels.clone();
    let mut findings = Vec::new();
    for (c, &channel) in channels.iter().enumerate() {
        // Nothing sits anywhere in pure noise.
        if rms[c] < 1.02 * noise_floor[c] {
            continue;
        }
        for place in places() {
            let (x, r): (Vec<f64>, Vec<f64>) = traces
                .iter()
                .zip(&all)
                .flat_map(|(t, res)| (0..t.len()).map(move |k| ((place.of)(t, k, channel), res[c][k])))
                .unzip();
            let Some((share, low, high, mean)) = concentration(&x, &r) else { continue };
            if share < MIN_SHARE {
                continue;
            }
            findings.push(Finding {
                channel,
                place: place.name.into(),
                share,
                sentence: format!(
                    "{channel}: {:.0} % of the residual's variance follows the {}; it is {mean:+.3} {} on average for {} {low:.3} to {high:.3} {}",
                    100.0 * share, place.name, channel.unit(), place.symbol, place.unit.replace("rad", channel.joint_unit())
                ),
            });
        }
        if let Some((frequency, share)) = dominant_frequency(traces, &all, c).filter(|(_, s)| *s > MIN_SHARE) {
            findings.push(Finding {
                channel,
                place: "frequency".into(),
                share,
                sentence: format!(
                    "{channel}: {:.0} % of the residual's variance lies below {frequency:.1} Hz",
                    100.0 * share
                ),
            });
        }
    }
    findings.sort_by(|a, b| b.share.total_cmp(&a.share));
    Ok(Comparison { channels, rms, noise_floor, held_out_rms, findings })
}

/// Share of the variance from which a place is worth a sentence.
const MIN_SHARE: f64 = 0.05;

struct Place {
    name: &'static str,
    symbol: &'static str,
    unit: &'static str,
    of: fn(&Trace, usize, Channel) -> f64,
}

fn axis(channel: Channel) -> usize {
    match channel {
        Channel::Torque(i) | Channel::Force(i) => i,
        Channel::StrutUpper(s) | Channel::StrutLower(s) => s / 2,
    }
}

fn places() -> [Place; 5] {
    [
        Place { name: "joint speed", symbol: "q̇", unit: "rad/s", of: |t, k, c| t.joints[k].qd[axis(c)] },
        Place { name: "joint angle", symbol: "q", unit: "rad", of: |t, k, c| t.joints[k].q[axis(c)] },
        Place { name: "joint acceleration", symbol: "q̈", unit: "rad/s²", of: |t, k, c| t.joints[k].qdd[axis(c)] },
        Place { name: "time", symbol: "t", unit: "s", of: |t, k, _| t.t[k] },
        Place {
            name: "nearness of a reversal",
            symbol: "|q̇|",
            unit: "rad/s",
            of: |t, k, c| t.joints[k].qd[axis(c)].abs(),
        },
    ]
}

const BINS: usize = 24;

/// Share of the variance of `r` explained by its mean over bins of `x` (less what chance gives), and the bin where the
/// mean is largest: lower edge, upper edge, mean.
fn concentration(x: &[f64], r: &[f64]) -> Option<(f64, f64, f64, f64)> {
    let n = x.len();
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&a, &b| x[a].total_cmp(&x[b]));
    let total: f64 = r.iter().map(|v| v * v).sum();
    if n < 10 * BINS || total == 0.0 {
        return None;
    }
    let mut explained = 0.0;
    let mut worst = (0.0, 0.0, 0.0);
    for bin in order.chunks(n.div_ceil(BINS)) {
        let mean = bin.iter().map(|&i| r[i]).sum::<f64>() / bin.len() as f64;
        explained += mean * mean * bin.len() as f64;
        if mean.abs() > f64::abs(worst.2) {
            worst = (x[bin[0]], x[bin[bin.len() - 1]], mean);
        }
    }
    Some(((explained / total - BINS as f64 / n as f64).max(0.0), worst.0, worst.1, worst.2))
}

/// Frequency below which the coloured part of the residual lies, and its share of the variance beyond a flat spectrum.
fn dominant_frequency(traces: &[Trace], all: &[Vec<Vec<f64>>], c: usize) -> Option<(f64, f64)> {
    let (trace, series) = traces.iter().zip(all).max_by_key(|(t, _)| t.len())?;
    let segment = trace.segments.iter().max_by_key(|s| s.len())?;
    let mut x = series[c][segment.clone()].to_vec();
    let n = x.len();
    if n < 1000 || trace.dt <= 0.0 {
        return None;
    }
    let fft = realfft::RealFftPlanner::<f64>::new().plan_fft_forward(n);
    let mut spectrum = fft.make_output_vec();
    fft.process(&mut x, &mut spectrum).ok()?;
    let power: Vec<f64> = spectrum.iter().map(|z| z.norm_sqr()).collect();
    let total: f64 = power.iter().sum();
    let mut sorted = power.clone();
    let middle = sorted.len() / 2;
    // The median of an exponential distribution is ln 2 times its mean.
    let white = *sorted.select_nth_unstable_by(middle, f64::total_cmp).1 / std::f64::consts::LN_2;
    let excess = (total - white * power.len() as f64).max(0.0);
    let mut sum = 0.0;
    let line = power.iter().position(|p| {
        sum += p - white;
        sum >= 0.9 * excess
    })?;
    Some((line as f64 / (n as f64 * trace.dt), excess / total))
}

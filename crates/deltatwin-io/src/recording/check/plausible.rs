//! Plausibility of values: units, constant channels, jumps, rates, sensor faults.

use std::ops::Range;

use deltatwin::identification::initial::quantum;
use deltatwin::machine::{Effort, Joint, Mechanism, TELESCOPE_AXIS, Unit};
use deltatwin::model::history::rounded_to;
use deltatwin::recording::{Channel, sample_time};
use deltatwin::text::significant;

use super::{Column, Table};
use crate::recording::ReadError;

/// Plausible arm angles, rad: −0.9…1.9, extended by 40° on either side.
const ARM_ANGLE: (f64, f64) = (-1.6, 2.6);
/// Sampling period, s, up to which times are seconds: as milliseconds it would be 20 kHz and more …
const SURELY_SECONDS: f64 = 0.05;
/// … and from which they are not: slower logs do not resolve the motion of a servo axis.
const LONGEST_STEP: f64 = 0.25;
/// Longest time, s, that an axis takes for its travel at its largest speed. Milliseconds read as seconds make it at least
/// twice that of a stroke of 0.1 s.
const SLOWEST: f64 = 60.0;
/// One step of so many beyond the largest plausible rate is no jump of an encoder, but another unit.
const FAST: usize = 100;
/// Number of levels of a torque below which equal values are those of its steps.
const LEVELS: f64 = 100.0;
/// Number of samples for which a torque may be exactly constant while its axis moves.
const FROZEN: usize = 50;

impl Table {
    pub(super) fn units(&self, warnings: &mut Vec<String>) -> Result<(), ReadError> {
        let step = sample_time(&self.t);
        if let Some((unit, name)) = self.other_unit_of_time(step).filter(|_| !self.timed) {
            let problem = format!("steps of {} s; looks like {name}", rounded_to(step, 6));
            let expected = format!("seconds, sampled at 4 Hz or more; --map \"t=t[{unit}]\" reads {name}");
            return Err(self.value_error(1, "t", problem, expected));
        }
        if step < 1e-6 {
            let problem = format!("steps of {step:e} s");
            return Err(self.value_error(1, "t", problem, "seconds, sampled at 1 MHz or less"));
        }
        let (low, high) = ARM_ANGLE;
        let arms: &[&str] = if matches!(self.machine, Mechanism::Delta { .. }) { &["q1", "q2", "q3"] } else { &[] };
        for &name in arms {
            let Some(q) = self.column(name) else { continue };
            let Some(i) = q.iter().position(|v| !(low..=high).contains(v)) else {
                continue;
            };
            let (least, most) = span(q);
            if least.abs().max(most.abs()) <= std::f64::consts::TAU {
                warnings.push(format!(
                    "`{name}` goes from {least:.3} to {most:.3} rad, where no arm gets with the format's zero and sense; \
                     `check --model MODEL` tells which is meant"
                ));
                continue;
            }
            let degrees = least >= -100.0 && most <= 160.0 && most - least > 1.0;
            let exchanged = self.column("q4").is_some_and(|q4| {
                let (a, b) = span(q4);
                a >= low && b <= high
            });
            let problem = format!(
                "angle {} in a column from {least} to {most}{}",
                q[i],
                if degrees && !exchanged { "; looks like degrees" } else { "" }
            );
            let k = name.trim_start_matches('q');
            let other = match degrees {
                _ if exchanged => format!("; --map \"{name}=q4, q4={name}, tau{k}=tau4, tau4=tau{k}\" exchanges axes"),
                true => {
                    let angles = ["q1", "q2", "q3", "q4"].into_iter().filter(|q| self.column(q).is_some());
                    let all = angles.map(|q| format!("{q}={q}[deg]")).collect::<Vec<_>>().join(", ");
                    format!("; --map \"{all}\" reads degrees, \"{name}={name}/33\" a motor's side")
                }
                false => format!("; --map \"{name}={name}-1.5708\" moves the zero, \"{name}=-{name}\" turns it round"),
            };
            return Err(self.value_error(i, name, problem, format!("{low} … {high} rad{other}")));
        }
        for c in &self.columns {
            let (limit, unit, hint) = match c.name.as_str() {
                n if n.starts_with("tau") && self.machine.effort() == Effort::Current => (1e5, "A", "looks like mA"),
                n if n.starts_with("tau") && self.machine.joint() == Joint::Prismatic => (1e7, "N", "looks like mN"),
                n if n.starts_with("tau") => (1e4, "N·m", "looks like N·mm, which --map \"tau1=tau1[Nmm], …\" reads"),
                n if n.starts_with("strut") || n.starts_with("margin") => (1e6, "N", "looks like mN"),
                n if n.starts_with("ee") => (5.0, "m", "looks like millimetres"),
                _ => continue,
            };
            if let Some(i) = c.values.iter().position(|v| v.abs() > limit) {
                let problem = format!("{}; {hint}", c.values[i]);
                return Err(self.value_error(i, &c.name, problem, format!("at most {limit} {unit}")));
            }
        }
        Ok(())
    }

    /// Unit of times that are no seconds, and its name: the first in which an axis takes no longer than [`SLOWEST`] for its
    /// travel, or one turn if that is less, at its largest speed.
    fn other_unit_of_time(&self, step: f64) -> Option<(&'static str, &'static str)> {
        if step <= SURELY_SECONDS {
            return None;
        }
        let duration = |k: usize| {
            let q = self.column(&format!("q{k}"))?;
            let mut speeds: Vec<f64> =
                (1..q.len()).map(|i| (q[i] - q[i - 1]).abs() / (self.t[i] - self.t[i - 1])).collect();
            let place = speeds.len() * 99 / 100;
            let speed = *speeds.select_nth_unstable_by(place, f64::total_cmp).1;
            let (low, high) = span(q);
            Some((high - low).min(std::f64::consts::TAU) / speed).filter(|time| time.is_finite())
        };
        let shortest = (1..=self.machine.axes()).filter_map(duration).fold(f64::INFINITY, f64::min);
        let units = [("s", "", 1.0), ("ms", "milliseconds", 1e-3), ("us", "microseconds", 1e-6)];
        let fits = |(unit, _, factor): &&(&str, &str, f64)| {
            shortest * factor <= SLOWEST && (*unit != "s" || step <= LONGEST_STEP)
        };
        let (unit, name, _) = *units.iter().find(fits).unwrap_or(&units[if step > LONGEST_STEP { 1 } else { 0 }]);
        (unit != "s").then_some((unit, name))
    }

    pub(super) fn constant(&self, warnings: &mut Vec<String>) -> Result<(), ReadError> {
        let stands = |name: String| self.column(&name).is_some_and(is_constant);
        let axes = self.machine.axes();
        if (1..=axes).all(|k| stands(format!("q{k}"))) {
            let problem = "no joint angle ever changes";
            return Err(ReadError::content(&self.file, problem, "a machine that moves"));
        }
        let arms_rest = axes > TELESCOPE_AXIS && (1..axes).all(|k| stands(format!("q{k}")));
        for k in 1..=axes {
            let (q, tau) = (stands(format!("q{k}")), stands(format!("tau{k}")));
            if !q && !tau {
                continue;
            }
            let name = if q { format!("q{k}") } else { format!("tau{k}") };
            let value = self.column(&name).map_or(0.0, |v| v[0]);
            let problem = format!("always {value}");
            if k == 4 {
                warnings.push(format!("`{name}` is {problem}: axis 4 stands still or is not recorded"));
            } else if q && arms_rest {
                warnings.push(format!("`{name}` is {problem}: only axis 4 moves"));
            } else if q && tau {
                warnings.push(format!("`q{k}` and `tau{k}` never change: axis {k} is not in use"));
            } else {
                return Err(self.value_error(0, &name, problem, "a channel that changes"));
            }
        }
        // Margins, multipliers and links are computed: the margin of a socket that is open from the start is constant
        // zero. A load may be constant.
        let sensor = |c: &&Column| match Channel::named(&c.name) {
            Some(Channel::MarginUpper(_) | Channel::MarginLower(_) | Channel::Multiplier(_)) => false,
            Some(channel) => !channel.family().is_of_axes(),
            None => true,
        };
        for c in self.columns.iter().filter(sensor).filter(|c| is_constant(&c.values)) {
            warnings.push(format!("`{}` is always {}: is the sensor connected?", c.name, c.values[0]));
        }
        Ok(())
    }

    /// Unwraps the angle of axis 4, which rotates without limits.
    pub(super) fn unwrap_axis4(&mut self, warnings: &mut Vec<String>) {
        use std::f64::consts::{PI, TAU};
        let Some(c) = self.columns.iter_mut().find(|c| c.name == "q4") else {
            return;
        };
        let mut turns = 0.0;
        let mut first = None;
        for i in 1..c.values.len() {
            let step = c.values[i] + turns - c.values[i - 1];
            if step.abs() > PI && (step.abs() - TAU).abs() < 0.3 {
                turns -= TAU * step.signum();
                first = first.or(Some(i));
            }
            // Adding zero would turn −0 into 0; values must be preserved bit for bit.
            if turns != 0.0 {
                c.values[i] += turns;
            }
        }
        if let Some(i) = first {
            let at = self.at(i);
            warnings.push(format!("`q4` jumps by a full turn, first at {at}: unwrapped"));
        }
    }

    pub(super) fn fast_axis4(&self, warnings: &mut Vec<String>) {
        let step = sample_time(&self.t);
        if let Some(q4) = self.column("q4") {
            let k = ((0.02 / step) as usize).max(1);
            let rate = |i: usize| (q4[i + k] - q4[i]).abs() / (self.t[i + k] - self.t[i]);
            let fast = (0..q4.len().saturating_sub(k)).filter(|&i| rate(i) > 60.0).count();
            if fast * 50 > q4.len() {
                warnings.push("`q4` turns faster than 60 rad/s; is it in degrees? --map \"q4=q4[deg]\"".into());
            }
        }
    }

    pub(super) fn jumps(&self, warnings: &mut Vec<String>) {
        let step = sample_time(&self.t);
        let unit = self.machine.unit(Unit::Rad);
        for k in 1..=self.machine.axes() {
            let name = format!("q{k}");
            let Some(q) = self.column(&name) else {
                continue;
            };
            let jump = |i: &usize| {
                let dt = (self.t[*i] - self.t[i - 1]).max(step);
                (q[*i] - q[i - 1]).abs() > 200.0 * dt
            };
            let mut found = (1..q.len()).filter(jump);
            if let Some(i) = found.next() {
                let (size, n) = (q[i] - q[i - 1], 1 + found.count());
                if n * FAST > q.len() {
                    let small = if unit == Unit::M { "mm" } else { "deg" };
                    warnings.push(format!(
                        "`{name}` moves faster than 200 {unit}/s in {n} steps: is it in {small}? --map \"{name}={name}[{small}]\""
                    ));
                    continue;
                }
                warnings.push(format!(
                    "`{name}` jumps by {size:.3} {unit} at {} ({n} such steps): faulty encoder?",
                    self.at(i)
                ));
            }
        }
    }

    /// Compares recorded joint rates with difference quotients of the angles.
    pub(super) fn rates(&self, warnings: &mut Vec<String>) -> Result<(), ReadError> {
        let n = self.t.len();
        let reach = ((5e-3 / sample_time(&self.t)) as usize).clamp(1, (n - 1) / 2);
        for k in 1..=self.machine.axes() {
            let name = format!("qd{k}");
            let (Some(q), Some(qd)) = (self.column(&format!("q{k}")), self.column(&name)) else {
                continue;
            };
            let (mut product, mut square) = (0.0, 0.0);
            for i in reach..n - reach {
                let d = (q[i + reach] - q[i - reach]) / (self.t[i + reach] - self.t[i - reach]);
                product += qd[i] * d;
                square += d * d;
            }
            let scale = product / square;
            if square == 0.0 || !scale.is_finite() {
                continue;
            }
            if (40.0..80.0).contains(&scale) && self.machine.joint() == Joint::Revolute {
                let problem = format!("{scale:.1} times the slope of `q{k}`; looks like degrees/s");
                return Err(self.value_error(0, &name, problem, "rad/s"));
            }
            if !(0.8..1.25).contains(&scale) {
                warnings.push(format!("`{name}` is {} times the slope of `q{k}`", significant(scale, 3)));
            }
        }
        Ok(())
    }

    pub(super) fn clipped(&self, k: usize, warnings: &mut Vec<String>) {
        let name = format!("tau{k}");
        let Some(tau) = self.column(&name).filter(|tau| !is_constant(tau) && !is_coarse(tau)) else {
            return;
        };
        let (least, most) = span(tau);
        for (extreme, what) in [(most, "largest"), (least, "smallest")] {
            let runs = runs(tau).filter(|r| tau[r.start] == extreme && r.len() >= 3);
            let runs: Vec<_> = runs.collect();
            let count: usize = runs.iter().map(|r| r.len()).sum();
            if count >= 10 {
                warnings.push(format!(
                    "`{name}` stays at its {what} value {extreme} {} for {count} samples, first at {}: clipped?",
                    self.machine.unit(Unit::NM),
                    self.at(runs[0].start)
                ));
            }
        }
    }

    pub(super) fn frozen(&self, k: usize, warnings: &mut Vec<String>) {
        let name = format!("tau{k}");
        let (Some(tau), Some(q)) = (self.column(&name), self.column(&format!("q{k}"))) else {
            return;
        };
        if is_constant(tau) || is_coarse(tau) {
            return;
        }
        let (least, most) = span(tau);
        let stuck = runs(tau).find(|r| {
            let (low, high) = span(&q[r.clone()]);
            let inside = tau[r.start] != least && tau[r.start] != most;
            r.len() >= FROZEN && inside && high - low > 1e-3
        });
        if let Some(r) = stuck {
            warnings.push(format!(
                "`{name}` stays exactly {} {} from {} for {} samples while the axis moves: frozen sensor?",
                tau[r.start],
                self.machine.unit(Unit::NM),
                self.at(r.start),
                r.len()
            ));
        }
    }
}

fn is_constant(values: &[f64]) -> bool {
    values.windows(2).all(|w| w[0] == w[1])
}

/// Whether a signal has few levels: it repeats values without being clipped or frozen.
fn is_coarse(values: &[f64]) -> bool {
    let (least, most) = span(values);
    quantum(&[values]).is_some_and(|step| most - least < LEVELS * step)
}

fn span(values: &[f64]) -> (f64, f64) {
    values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &v| (a.min(v), b.max(v)))
}

/// Ranges of equal consecutive values.
fn runs(values: &[f64]) -> impl Iterator<Item = Range<usize>> + '_ {
    let mut start = 0;
    std::iter::from_fn(move || {
        let first = values.get(start)?;
        let length = values[start..].iter().take_while(|v| *v == first).count();
        start += length;
        Some(start - length..start)
    })
}

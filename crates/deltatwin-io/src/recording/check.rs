//! Conversion of columns to signals, with checks and repairs.

use std::ops::Range;
use std::path::PathBuf;

use deltatwin::machine::{AXES, Joint, Mechanism, STRUTS, Unit};
use deltatwin::recording::{Signals, multiplier_names};

use super::ReadError;

/// Smallest number of samples of a recording.
const FEWEST: usize = 100;
/// Smallest number of samples of a segment between gaps; shorter ones are dropped.
const SHORTEST_STRETCH: usize = 10;
/// Largest relative deviation of a sampling step from the median that counts as uniform.
const JITTER: f64 = 0.01;
/// Plausible arm angles, rad: −0.9…1.9, extended by 40° on either side.
const ARM_ANGLE: (f64, f64) = (-1.6, 2.6);
/// Number of samples for which a torque may be exactly constant while its axis moves.
const FROZEN: usize = 50;

/// Columns of a file, one per channel.
pub(super) struct Table {
    pub file: PathBuf,
    /// Word for a row in messages, e.g. `line`.
    pub row: &'static str,
    /// Row number of each sample.
    pub rows: Vec<u64>,
    pub t: Vec<f64>,
    pub columns: Vec<Column>,
    /// Machine whose axes the file must contain.
    pub machine: Mechanism,
}

/// One channel, named as in CSV.
pub(super) struct Column {
    pub name: String,
    pub values: Vec<f64>,
}

/// Names of the required columns.
pub(super) fn required(axes: usize) -> impl Iterator<Item = String> {
    let of = move |name| (1..=axes).map(move |k| format!("{name}{k}"));
    std::iter::once("t".to_string()).chain(of("q")).chain(of("tau"))
}

/// The machine inferred from the columns: four axes if any column belongs to the fourth, etc.
pub(super) fn machine(has: impl Fn(&str) -> bool) -> Mechanism {
    let axis = |k: usize| has(&format!("q{k}")) || has(&format!("tau{k}"));
    match (axis(1), axis(2) || axis(3), axis(4)) {
        (true, false, false) => Mechanism::Axis(Joint::Revolute),
        (_, true, false) => Mechanism::Delta { telescope: false },
        _ => Mechanism::default(),
    }
}

/// Whether a column belongs to an axis beyond the first `axes`.
pub(super) fn foreign(name: &str, axes: usize) -> bool {
    is_axis(name) && (axes + 1..=AXES).any(|k| name.ends_with(char::from(b'0' + k as u8)))
}

/// Whether a column name is known.
pub(super) fn known(name: &str) -> bool {
    let numbered = |stem: &str, n: usize| {
        name.strip_prefix(stem).is_some_and(|k| k.len() == 1 && k.parse().is_ok_and(|k: usize| (1..=n).contains(&k)))
    };
    let strut = |stem: &str, end: &str| {
        name.strip_prefix(stem)
            .and_then(|n| n.strip_suffix(end))
            .is_some_and(|k| k.len() == 1 && k.parse().is_ok_and(|k: usize| (1..=STRUTS).contains(&k)))
    };
    matches!(name, "t" | "ee_x" | "ee_y" | "ee_z")
        || ["q", "tau", "qd", "qdd", "link_q", "link_qd"].iter().any(|stem| numbered(stem, AXES))
        || strut("strut", "_upper")
        || strut("strut", "_lower")
        || strut("margin", "_upper")
        || strut("margin", "_lower")
        || (name.starts_with("lambda_") && multiplier_names().iter().any(|n| n == name))
}

/// Column names of the socket margins: six upper, then six lower.
pub(super) fn margin_names() -> [String; 2 * STRUTS] {
    std::array::from_fn(|s| format!("margin{}_{}", s % STRUTS + 1, if s < STRUTS { "upper" } else { "lower" }))
}

/// Checks and repairs `table`; also returns warnings.
pub(super) fn signals(mut table: Table) -> Result<(Signals, Vec<String>), ReadError> {
    let mut warnings = Vec::new();
    table.finite()?;
    table.repeated(&mut warnings);
    table.increasing()?;
    if table.t.len() < FEWEST {
        let problem = format!("has only {} samples", table.t.len());
        return Err(ReadError::content(&table.file, problem, format!("at least {FEWEST}")));
    }
    table.units(&mut warnings)?;
    table.constant(&mut warnings)?;
    table.unwrap_axis4(&mut warnings);
    table.fast_axis4(&mut warnings);
    table.jumps(&mut warnings);
    table.rates(&mut warnings)?;
    for k in 1..=table.machine.axes() {
        table.clipped(k, &mut warnings);
        table.frozen(k, &mut warnings);
    }
    let segments = table.sampling(&mut warnings)?;
    Ok((table.into_signals(segments, &mut warnings), warnings))
}

impl Table {
    fn column(&self, name: &str) -> Option<&[f64]> {
        self.columns.iter().find(|c| c.name == name).map(|c| c.values.as_slice())
    }

    fn at(&self, i: usize) -> String {
        match self.rows.get(i) {
            Some(row) => format!("{} {row}", self.row),
            None => format!("{} {}", self.row, i + 1),
        }
    }

    fn value_error(
        &self,
        i: usize,
        column: &str,
        problem: impl Into<String>,
        expected: impl Into<String>,
    ) -> ReadError {
        ReadError::Value {
            file: self.file.clone(),
            row: self.at(i),
            column: column.into(),
            problem: problem.into(),
            expected: expected.into(),
        }
    }

    fn finite(&self) -> Result<(), ReadError> {
        let t = ("t", self.t.as_slice());
        let others = self.columns.iter().map(|c| (c.name.as_str(), c.values.as_slice()));
        for (name, values) in std::iter::once(t).chain(others) {
            if let Some(i) = values.iter().position(|v| !v.is_finite()) {
                return Err(self.value_error(i, name, values[i].to_string(), "a finite number"));
            }
        }
        Ok(())
    }

    /// Drops rows identical to the previous one, time included.
    fn repeated(&mut self, warnings: &mut Vec<String>) {
        let same = |v: &[f64], i: usize| v[i] == v[i - 1];
        let again = |i: usize| i > 0 && same(&self.t, i) && self.columns.iter().all(|c| same(&c.values, i));
        let kept: Vec<usize> = (0..self.t.len()).filter(|&i| !again(i)).collect();
        let dropped = self.t.len() - kept.len();
        if dropped == 0 {
            return;
        }
        let first = (0..self.t.len()).find(|&i| again(i)).map_or(String::new(), |i| self.at(i));
        warnings.push(format!("{dropped} samples repeat the one before, first at {first}: dropped"));
        let cut = |v: &[f64]| kept.iter().map(|&i| v[i]).collect();
        self.t = cut(&self.t);
        for c in &mut self.columns {
            c.values = cut(&c.values);
        }
        if !self.rows.is_empty() {
            self.rows = kept.iter().map(|&i| self.rows[i]).collect();
        }
    }

    fn increasing(&self) -> Result<(), ReadError> {
        let Some(i) = self.t.windows(2).position(|w| w[1] <= w[0]) else {
            return Ok(());
        };
        let (before, after) = (self.t[i], self.t[i + 1]);
        let (problem, expected) = if after == before {
            (format!("{after} s for the second time"), "increasing time with enough digits")
        } else {
            (format!("time goes back from {before} s to {after} s"), "increasing time")
        };
        Err(self.value_error(i + 1, "t", problem, expected))
    }

    fn units(&self, warnings: &mut Vec<String>) -> Result<(), ReadError> {
        let step = median_step(&self.t);
        if step > 0.05 {
            let problem = format!("steps of {step} s; looks like milliseconds");
            return Err(self.value_error(
                1,
                "t",
                problem,
                "seconds, sampled at 20 Hz or more; --map \"t=t[ms]\" reads milliseconds",
            ));
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
                true => format!("; --map \"{name}={name}[deg]\" reads degrees, \"{name}={name}/33\" a motor's side"),
                false => format!("; --map \"{name}={name}-1.5708\" moves the zero, \"{name}=-{name}\" turns it round"),
            };
            return Err(self.value_error(i, name, problem, format!("{low} … {high} rad{other}")));
        }
        for c in &self.columns {
            let (limit, unit, hint) = match c.name.as_str() {
                n if n.starts_with("tau") && self.machine == Mechanism::Axis(Joint::Prismatic) => {
                    (1e7, "N", "looks like mN")
                }
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

    fn constant(&self, warnings: &mut Vec<String>) -> Result<(), ReadError> {
        let stands = |name: String| self.column(&name).is_some_and(is_constant);
        let axes = self.machine.axes();
        if (1..=axes).all(|k| stands(format!("q{k}"))) {
            let problem = "no joint angle ever changes";
            return Err(ReadError::content(&self.file, problem, "a machine that moves"));
        }
        let arms_rest = axes == AXES && (1..AXES).all(|k| stands(format!("q{k}")));
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
        // zero.
        let computed = |name: &str| ["margin", "lambda_", "link_"].iter().any(|stem| name.starts_with(stem));
        let sensor = |c: &&Column| !is_axis(&c.name) && !computed(&c.name);
        for c in self.columns.iter().filter(sensor).filter(|c| is_constant(&c.values)) {
            warnings.push(format!("`{}` is always {}: is the sensor connected?", c.name, c.values[0]));
        }
        Ok(())
    }

    /// Unwraps the angle of axis 4, which rotates without limits.
    fn unwrap_axis4(&mut self, warnings: &mut Vec<String>) {
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

    fn fast_axis4(&self, warnings: &mut Vec<String>) {
        let step = median_step(&self.t);
        if let Some(q4) = self.column("q4") {
            let k = ((0.02 / step) as usize).max(1);
            let rate = |i: usize| (q4[i + k] - q4[i]).abs() / (self.t[i + k] - self.t[i]);
            let fast = (0..q4.len().saturating_sub(k)).filter(|&i| rate(i) > 60.0).count();
            if fast * 50 > q4.len() {
                warnings.push("`q4` turns faster than 60 rad/s; is it in degrees? --map \"q4=q4[deg]\"".into());
            }
        }
    }

    fn jumps(&self, warnings: &mut Vec<String>) {
        let step = median_step(&self.t);
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
                warnings.push(format!(
                    "`{name}` jumps by {size:.3} {unit} at {} ({n} such steps): faulty encoder?",
                    self.at(i)
                ));
            }
        }
    }

    /// Compares recorded joint rates with difference quotients of the angles.
    fn rates(&self, warnings: &mut Vec<String>) -> Result<(), ReadError> {
        let n = self.t.len();
        let reach = ((5e-3 / median_step(&self.t)) as usize).clamp(1, (n - 1) / 2);
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
            if (40.0..80.0).contains(&scale) && self.machine != Mechanism::Axis(Joint::Prismatic) {
                let problem = format!("{scale:.1} times the slope of `q{k}`; looks like degrees/s");
                return Err(self.value_error(0, &name, problem, "rad/s"));
            }
            if !(0.8..1.25).contains(&scale) {
                warnings.push(format!("`{name}` is {scale:.2} times the slope of `q{k}`"));
            }
        }
        Ok(())
    }

    fn clipped(&self, k: usize, warnings: &mut Vec<String>) {
        let name = format!("tau{k}");
        let Some(tau) = self.column(&name).filter(|tau| !is_constant(tau)) else {
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

    fn frozen(&self, k: usize, warnings: &mut Vec<String>) {
        let name = format!("tau{k}");
        let (Some(tau), Some(q)) = (self.column(&name), self.column(&format!("q{k}"))) else {
            return;
        };
        if is_constant(tau) {
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

    /// Splits at gaps, and resamples segments that are not uniform.
    fn sampling(&mut self, warnings: &mut Vec<String>) -> Result<Vec<Range<usize>>, ReadError> {
        let step = median_step(&self.t);
        // One or two lost samples are interpolated, unless the sampling period is too long for that.
        let gap = (1.5 * step).max((3.5 * step).min(5e-3));
        let mut stretches = Vec::new();
        let mut start = 0;
        for i in 1..=self.t.len() {
            if i == self.t.len() || self.t[i] - self.t[i - 1] > gap {
                if i < self.t.len() {
                    let width = self.t[i] - self.t[i - 1];
                    let problem = format!("gap of {width:.6} s before {}", self.at(i));
                    warnings.push(format!("{problem}: samples before and after are kept apart"));
                }
                if i - start >= SHORTEST_STRETCH {
                    stretches.push(start..i);
                } else {
                    warnings.push(format!("{} samples from {} dropped", i - start, self.at(start)));
                }
                start = i;
            }
        }
        limit_number(warnings, "gap of", 10);
        limit_number(warnings, "samples from", 10);
        let total: usize = stretches.iter().map(|r| r.len()).sum();
        if total < FEWEST {
            let problem = format!("only {total} samples remain between gaps in time");
            return Err(ReadError::content(&self.file, problem, format!("at least {FEWEST}")));
        }
        let deviation = |r: &Range<usize>| {
            let steps = self.t[r.clone()].windows(2);
            steps.map(|w| (w[1] - w[0] - step).abs() / step).fold(0.0, f64::max)
        };
        let worst = stretches.iter().map(deviation).fold(0.0, f64::max);
        if worst <= JITTER {
            return Ok(self.pick(&stretches));
        }
        let percent = 100.0 * worst;
        if let Some((digit, times)) = rounded(&self.t, &stretches) {
            for (r, t) in stretches.iter().zip(times) {
                self.t[r.clone()].copy_from_slice(&t);
            }
            warnings.push(format!("time is rounded to {digit} s, steps vary by {percent:.1} %: taken as uniform"));
            return Ok(self.pick(&stretches));
        }
        warnings
            .push(format!("time steps vary by up to {percent:.1} %: resampled to {step:.6e} s by cubic interpolation"));
        let stretches = self.resample(&stretches, step);
        if self.t.len() < FEWEST {
            let problem = "hardly any samples remain after resampling";
            return Err(ReadError::content(&self.file, problem, "evenly sampled signals"));
        }
        Ok(stretches)
    }

    /// Keeps only the samples in `stretches` and returns their new ranges.
    fn pick(&mut self, stretches: &[Range<usize>]) -> Vec<Range<usize>> {
        if stretches.iter().map(|r| r.len()).sum::<usize>() == self.t.len() {
            return stretches.to_vec();
        }
        let cut = |v: &Vec<f64>| stretches.iter().flat_map(|r| &v[r.clone()]).copied().collect();
        self.t = cut(&self.t);
        for c in &mut self.columns {
            c.values = cut(&c.values);
        }
        consecutive(stretches.iter().map(|r| r.len()))
    }

    fn resample(&mut self, stretches: &[Range<usize>], step: f64) -> Vec<Range<usize>> {
        let mut t = Vec::new();
        let mut stencils = Vec::new();
        let mut lengths = Vec::new();
        for r in stretches {
            let (first, last) = (self.t[r.start], self.t[r.end - 1]);
            let mut kept = vec![r.start]; // Samples almost coincident in time would only amplify noise.
            kept.extend((r.start + 1..r.end).filter({
                let mut previous = first;
                let times = &self.t;
                move |&i| {
                    let keep = times[i] - previous >= 0.3 * step;
                    if keep {
                        previous = times[i];
                    }
                    keep
                }
            }));
            if kept.len() < 4 {
                continue;
            }
            let count = ((last - first) / step + 1e-6) as usize + 1;
            let mut j = 0;
            for k in 0..count {
                let x = first + k as f64 * step;
                while j + 2 < kept.len() && self.t[kept[j + 1]] <= x {
                    j += 1;
                }
                let s = j.saturating_sub(1).min(kept.len() - 4);
                let nodes = [kept[s], kept[s + 1], kept[s + 2], kept[s + 3]];
                stencils.push((nodes, lagrange(nodes.map(|i| self.t[i]), x)));
                t.push(x);
            }
            lengths.push(count);
        }
        for c in &mut self.columns {
            let value = |(nodes, weights): &([usize; 4], [f64; 4])| {
                nodes.iter().zip(weights).map(|(&i, w)| w * c.values[i]).sum()
            };
            c.values = stencils.iter().map(value).collect();
        }
        self.t = t;
        consecutive(lengths.into_iter())
    }

    fn into_signals(self, segments: Vec<Range<usize>>, warnings: &mut Vec<String>) -> Signals {
        let n = self.t.len();
        let axes = |stem: &str| {
            let all: [_; AXES] = std::array::from_fn(|k| self.column(&format!("{stem}{}", k + 1)));
            (0..n).map(|i| all.map(|c| c.map_or(0.0, |c| c[i]))).collect::<Vec<_>>()
        };
        let mut optional = |names: &[String]| {
            let missing: Vec<_> = names.iter().filter(|n| self.column(n).is_none()).collect();
            if !missing.is_empty() && missing.len() < names.len() {
                let rest = names.iter().find(|n| !missing.contains(n));
                let rest = rest.map_or("", String::as_str);
                warnings.push(format!("`{rest}` ignored: it needs `{}` beside it", missing[0]));
            }
            missing.is_empty()
        };
        let of_axes = |stem: &str| (1..=self.machine.axes()).map(|k| format!("{stem}{k}")).collect::<Vec<_>>();
        let (has_qd, has_qdd) = (optional(&of_axes("qd")), optional(&of_axes("qdd")));
        let ee_names = ["ee_x", "ee_y", "ee_z"];
        let has_ee = optional(&ee_names.map(String::from));
        let margin_names = margin_names();
        let has_margins = optional(&margin_names);
        let lambda_names = multiplier_names();
        let has_multipliers = optional(&lambda_names);
        let (has_link_q, has_link_qd) = (optional(&of_axes("link_q")), optional(&of_axes("link_qd")));
        let strut = |s: usize, end: &str| self.column(&format!("strut{}_{end}", s + 1)).map(<[f64]>::to_vec);
        let ee = has_ee.then(|| {
            let all = ee_names.map(|name| self.column(name));
            (0..n).map(|i| all.map(|c| c.map_or(0.0, |c| c[i]))).collect()
        });
        let margins = has_margins.then(|| {
            let all = margin_names.each_ref().map(|name| self.column(name));
            (0..n).map(|i| all.map(|c| c.map_or(0.0, |c| c[i]))).collect()
        });
        let multipliers = has_multipliers.then(|| {
            let all = lambda_names.each_ref().map(|name| self.column(name));
            (0..n).map(|i| all.map(|c| c.map_or(0.0, |c| c[i]))).collect()
        });
        Signals {
            start: None,
            mechanism: self.machine,
            q: axes("q"),
            tau: axes("tau"),
            strut_upper: std::array::from_fn(|s| strut(s, "upper")),
            strut_lower: std::array::from_fn(|s| strut(s, "lower")),
            ee,
            qd: has_qd.then(|| axes("qd")),
            qdd: has_qdd.then(|| axes("qdd")),
            socket_margin: margins,
            multipliers,
            link_q: has_link_q.then(|| axes("link_q")),
            link_qd: has_link_qd.then(|| axes("link_qd")),
            segments,
            t: self.t.clone(),
        }
    }
}

/// Columns of `signals` other than `t`; an error if their lengths differ or a value is not finite.
pub(super) fn columns(signals: &Signals) -> Result<Vec<Column>, String> {
    let mut columns = Vec::new();
    for (stem, values) in [
        ("q", Some(&signals.q)),
        ("tau", Some(&signals.tau)),
        ("qd", signals.qd.as_ref()),
        ("qdd", signals.qdd.as_ref()),
        ("link_q", signals.link_q.as_ref()),
        ("link_qd", signals.link_qd.as_ref()),
    ] {
        for k in 0..signals.mechanism.axes() {
            if let Some(values) = values {
                let values = values.iter().map(|v| v[k]).collect();
                columns.push(Column { name: format!("{stem}{}", k + 1), values });
            }
        }
    }
    for (end, forces) in [("upper", &signals.strut_upper), ("lower", &signals.strut_lower)] {
        for (s, force) in forces.iter().enumerate() {
            if let Some(values) = force.clone() {
                columns.push(Column { name: format!("strut{}_{end}", s + 1), values });
            }
        }
    }
    for (k, axis) in ["x", "y", "z"].iter().enumerate() {
        if let Some(ee) = &signals.ee {
            let values = ee.iter().map(|p| p[k]).collect();
            columns.push(Column { name: format!("ee_{axis}"), values });
        }
    }
    for (s, name) in margin_names().into_iter().enumerate() {
        if let Some(margins) = &signals.socket_margin {
            columns.push(Column { name, values: margins.iter().map(|m| m[s]).collect() });
        }
    }
    for (row, name) in multiplier_names().into_iter().enumerate() {
        if let Some(multipliers) = &signals.multipliers {
            columns.push(Column { name, values: multipliers.iter().map(|m| m[row]).collect() });
        }
    }
    for c in &columns {
        if c.values.len() != signals.t.len() {
            let (n, m) = (c.values.len(), signals.t.len());
            return Err(format!("`{}` has {n} samples, time has {m}", c.name));
        }
    }
    let t = Column { name: "t".into(), values: signals.t.clone() };
    for c in columns.iter().chain([&t]) {
        if let Some(i) = c.values.iter().position(|v| !v.is_finite()) {
            return Err(format!("sample {} of `{}` is {}", i + 1, c.name, c.values[i]));
        }
    }
    Ok(columns)
}

fn is_axis(name: &str) -> bool {
    let stem = name.trim_end_matches(|c: char| c.is_ascii_digit());
    matches!(stem, "q" | "tau" | "qd" | "qdd")
}

fn is_constant(values: &[f64]) -> bool {
    values.windows(2).all(|w| w[0] == w[1])
}

fn span(values: &[f64]) -> (f64, f64) {
    values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &v| (a.min(v), b.max(v)))
}

pub(super) fn median_step(t: &[f64]) -> f64 {
    let mut steps: Vec<f64> = t.windows(2).map(|w| w[1] - w[0]).collect();
    if steps.is_empty() {
        return 0.0;
    }
    let middle = steps.len() / 2;
    *steps.select_nth_unstable_by(middle, f64::total_cmp).1
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

fn consecutive(lengths: impl Iterator<Item = usize>) -> Vec<Range<usize>> {
    let mut start = 0;
    lengths
        .map(|n| {
            start += n;
            start - n..start
        })
        .collect()
}

/// Keeps the first `most` warnings that contain `pattern` and counts the others.
fn limit_number(warnings: &mut Vec<String>, pattern: &str, most: usize) {
    let count = warnings.iter().filter(|w| w.contains(pattern)).count();
    if count > most {
        let mut seen = 0;
        warnings.retain(|w| {
            seen += usize::from(w.contains(pattern));
            !w.contains(pattern) || seen <= most
        });
        warnings.push(format!("{} more like \"{pattern} …\"", count - most));
    }
}

/// Sampling period and uniform times of each segment, if the recorded times differ from them by at most their last
/// digit.
fn rounded(t: &[f64], stretches: &[Range<usize>]) -> Option<(f64, Vec<Vec<f64>>)> {
    let multiple = |digit: i32| {
        let k = 10f64.powi(digit);
        t.iter().all(|v| (v * k - (v * k).round()).abs() < 1e-3)
    };
    let digit = (0..=7).find(|&d| multiple(d))?;
    let unit = 1.0 / 10f64.powi(digit);
    let mut times = Vec::new();
    for r in stretches {
        let (first, last, n) = (t[r.start], t[r.end - 1], r.len());
        let uniform: Vec<f64> = (0..n).map(|k| first + (last - first) * k as f64 / (n - 1) as f64).collect();
        if t[r.clone()].iter().zip(&uniform).any(|(a, b)| (a - b).abs() > 1.001 * unit) {
            return None;
        }
        times.push(uniform);
    }
    Some((unit, times))
}

/// Weights of cubic Lagrange interpolation through four points at `x`.
fn lagrange(nodes: [f64; 4], x: f64) -> [f64; 4] {
    std::array::from_fn(|i| {
        let others = (0..4).filter(|&j| j != i);
        others.map(|j| (x - nodes[j]) / (nodes[i] - nodes[j])).product()
    })
}

//! Conversion of columns to signals and of signals to columns.

use std::ops::Range;

use deltatwin::machine::{AXES, STRUTS};
use deltatwin::recording::{Signals, multiplier_names};

use super::names::margin_names;
use super::{Column, Table};

impl Table {
    /// The signals in the columns, of which each is freed as soon as it has been read.
    pub(super) fn into_signals(mut self, segments: Vec<Range<usize>>, warnings: &mut Vec<String>) -> Signals {
        let of_axes = |stem: &str| (1..=self.machine.axes()).map(|k| format!("{stem}{k}")).collect::<Vec<_>>();
        let [q, tau, qd, qdd, link_q, link_qd] = ["q", "tau", "qd", "qdd", "link_q", "link_qd"].map(of_axes);
        let ee = ["ee_x", "ee_y", "ee_z"].map(String::from);
        let (margins, multipliers) = (margin_names(), multiplier_names());
        let strut = |end: &'static str| std::array::from_fn(|s| format!("strut{}_{end}", s + 1));
        let [upper, lower]: [[String; STRUTS]; 2] = ["upper", "lower"].map(strut);
        for names in [&qd[..], &qdd, &ee, &margins, &multipliers, &link_q, &link_qd] {
            let missing: Vec<_> = names.iter().filter(|n| self.column(n).is_none()).collect();
            if !missing.is_empty() && missing.len() < names.len() {
                let rest = names.iter().find(|n| !missing.contains(n));
                let rest = rest.map_or("", String::as_str);
                warnings.push(format!("`{rest}` ignored: it needs `{}` beside it", missing[0]));
            }
        }
        let samples = self.t.len();
        Signals {
            start: None,
            mechanism: self.machine,
            q: self.taken(&q).unwrap_or_else(|| vec![[0.0; AXES]; samples]),
            tau: self.taken(&tau).unwrap_or_else(|| vec![[0.0; AXES]; samples]),
            strut_upper: upper.map(|name| self.take(&name)),
            strut_lower: lower.map(|name| self.take(&name)),
            ee: self.taken(&ee),
            qd: self.taken(&qd),
            qdd: self.taken(&qdd),
            socket_margin: self.taken(&margins),
            multipliers: self.taken(&multipliers),
            link_q: self.taken(&link_q),
            link_qd: self.taken(&link_qd),
            segments,
            t: self.t,
        }
    }

    fn take(&mut self, name: &str) -> Option<Vec<f64>> {
        let place = self.columns.iter().position(|c| c.name == name)?;
        Some(self.columns.swap_remove(place).values)
    }

    /// The columns of these names side by side, zero beyond them; `None` unless all are there.
    fn taken<const N: usize>(&mut self, names: &[String]) -> Option<Vec<[f64; N]>> {
        if !names.iter().all(|name| self.column(name).is_some()) {
            return None;
        }
        let mut out = vec![[0.0; N]; self.t.len()];
        for (k, name) in names.iter().enumerate() {
            for (row, value) in out.iter_mut().zip(self.take(name)?) {
                row[k] = value;
            }
        }
        Some(out)
    }
}

/// Columns of `signals` other than `t`; `before` is the number of samples before them, for the errors.
///
/// # Errors
/// A description of the first column whose length differs from that of `t`, or of the first value that is not finite.
pub(in crate::recording) fn columns(signals: &Signals, before: usize) -> Result<Vec<Column>, String> {
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
            return Err(format!("sample {} of `{}` is {}", before + i + 1, c.name, c.values[i]));
        }
    }
    Ok(columns)
}

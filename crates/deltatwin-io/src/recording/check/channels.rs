//! Conversion of columns to signals and of signals to columns.

use std::ops::Range;

use deltatwin::machine::AXES;
use deltatwin::recording::{Signals, multiplier_names};

use super::names::margin_names;
use super::{Column, Table};

impl Table {
    pub(super) fn into_signals(self, segments: Vec<Range<usize>>, warnings: &mut Vec<String>) -> Signals {
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

/// Columns of `signals` other than `t`.
///
/// # Errors
/// A description of the first column whose length differs from that of `t`, or of the first value that is not finite.
pub(in crate::recording) fn columns(signals: &Signals) -> Result<Vec<Column>, String> {
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

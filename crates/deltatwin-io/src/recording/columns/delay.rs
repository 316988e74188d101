//! Compensation of signal delays.

use deltatwin::recording::sample_time;

use super::Column;

/// Width of a gap, in sampling periods, above which it is not interpolated.
const GAP: f64 = 3.5;

/// Replaces every column's value at t by that at t + its delay (s).
///
/// Samples without such a value in some column, at the ends and around gaps, are dropped. A delay of whole samples is
/// exact, others are interpolated linearly. If `t` does not increase, nothing is changed and the later checks report
/// the error.
pub(super) fn remove(t: &mut Vec<f64>, rows: &mut Vec<u64>, columns: &mut [Column], delays: &[f64]) {
    let n = t.len();
    if n < 2 || !t.is_sorted_by(|a, b| a < b) || columns.iter().any(|c| c.values.len() != n) {
        return;
    }
    let step = sample_time(t);
    let mut kept = vec![true; n];
    for (column, &delay) in columns.iter_mut().zip(delays).filter(|(_, d)| **d != 0.0) {
        let mut j = 0;
        let shifted: Vec<f64> = (0..n)
            .map(|i| {
                let at = t[i] + delay;
                while j + 2 < n && t[j + 1] <= at - 1e-6 * step {
                    j += 1;
                }
                let (a, b) = (t[j], t[j + 1]);
                let share = (at - a) / (b - a);
                if !(-1e-4..=1.0 + 1e-4).contains(&share) || b - a > GAP * step {
                    kept[i] = false;
                    return column.values[i];
                }
                let share = if (share - share.round()).abs() < 1e-4 { share.round() } else { share };
                column.values[j] * (1.0 - share) + column.values[j + 1] * share
            })
            .collect();
        column.values = shifted;
    }
    let cut = |values: &mut Vec<f64>| {
        let mut keep = kept.iter();
        values.retain(|_| *keep.next().unwrap_or(&true));
    };
    cut(t);
    columns.iter_mut().for_each(|c| cut(&mut c.values));
    if rows.len() == n {
        let mut keep = kept.iter();
        rows.retain(|_| *keep.next().unwrap_or(&true));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_late_signal_is_put_back() {
        for (delay, late) in [(0.004, 4usize), (-0.003, 0)] {
            let f = |t: f64| (7.0 * t).sin();
            let mut t: Vec<f64> = (0..200).map(|k| k as f64 * 1e-3).collect();
            let mut rows: Vec<u64> = (0..200).collect();
            let values = t.iter().map(|&t| f(t - delay)).collect();
            let mut columns = [
                Column { name: "tau1".into(), values },
                Column { name: "q1".into(), values: t.iter().map(|&t| f(t)).collect() },
            ];
            remove(&mut t, &mut rows, &mut columns, &[delay, 0.0]);
            assert_eq!(t.len(), 200 - (delay.abs() * 1e3).round() as usize);
            assert_eq!(rows[0], if late > 0 { 0 } else { 3 });
            for (k, &t) in t.iter().enumerate() {
                assert!((columns[0].values[k] - f(t)).abs() < 1e-12, "{delay} at {t}");
                assert_eq!(columns[1].values[k], f(t));
            }
        }
    }

    #[test]
    fn nothing_is_taken_across_a_gap() {
        let mut t: Vec<f64> = (0..100).chain(150..250).map(|k| k as f64 * 1e-3).collect();
        let mut columns = [Column { name: "tau1".into(), values: t.clone() }];
        remove(&mut t, &mut Vec::new(), &mut columns, &[0.010]);
        assert_eq!(t.len(), 180);
        for (t, v) in t.iter().zip(&columns[0].values) {
            assert!((v - t - 0.010).abs() < 1e-12, "{t} {v}");
        }
    }
}

//! Step of a quantised signal.

/// Least number of changes from which a step is told.
const CHANGES: usize = 30;
/// Distance from a whole number of steps, in steps, at which a change does not count as one, and the largest share of
/// such changes.
const OFF: (f64, f64) = (0.2, 0.02);
/// Changes below this share of the largest value are rounding of the numbers.
const ROUNDING: f64 = 1e-13;

/// Step of a quantised signal, in its unit: the largest value of which all its changes are whole multiples; `None` if
/// there is none.
///
/// `series` are the segments of the signal. The step is refined from small to large changes, so that it is known the
/// better the farther the signal moves; numbers printed with few digits are tolerated.
pub fn quantum(series: &[&[f64]]) -> Option<f64> {
    let largest = series.iter().flat_map(|s| s.iter()).fold(0.0f64, |most, x| most.max(x.abs()));
    let changes = series.iter().flat_map(|s| s.windows(2)).map(|w| (w[1] - w[0]).abs());
    let mut changes: Vec<f64> = changes.filter(|c| *c > ROUNDING * largest).collect();
    if changes.len() < CHANGES {
        return None;
    }
    changes.sort_unstable_by(f64::total_cmp);
    let mut step = changes[0];
    let (mut sum, mut steps, mut off) = (0.0, 0.0, 0usize);
    for change in &changes {
        let count = (change / step).round();
        if (change / step - count).abs() > OFF.0 {
            off += 1;
            continue;
        }
        sum += change;
        steps += count;
        step = sum / steps;
    }
    (off as f64 <= OFF.1 * changes.len() as f64).then_some(step)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sweep(n: u32) -> Vec<f64> {
        (0..n).map(|k| 0.7 * (f64::from(k) * 4e-3).sin() + 0.2 * (f64::from(k) * 1.7e-3).cos()).collect()
    }

    #[test]
    fn the_step_of_an_encoder_is_found_exactly() {
        // 12 bit per turn: 2π/4096.
        let step = std::f64::consts::TAU / 4096.0;
        let x: Vec<f64> = sweep(5000).iter().map(|q| (q / step).round() * step).collect();
        let found = quantum(&[&x]).unwrap();
        assert!((found / step - 1.0).abs() < 1e-9, "{found}");
        // Printed with five digits after the point, as 0.00153 and 0.00154.
        let printed: Vec<f64> = x.iter().map(|q| format!("{q:.5}").parse().unwrap()).collect();
        let found = quantum(&[&printed]).unwrap();
        assert!((found / step - 1.0).abs() < 1e-2, "{found}");
    }

    #[test]
    fn a_smooth_signal_has_none() {
        assert_eq!(quantum(&[&sweep(5000)]), None);
        assert_eq!(quantum(&[&[1.0; 500]]), None);
        assert_eq!(quantum(&[&[]]), None);
    }
}

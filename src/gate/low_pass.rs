//! Test whether delayed torques were low-pass filtered or only shifted in time.
//!
//! A shift keeps the steps of friction steep, a first-order low-pass 1/(1 + T·s) smooths them; both delay slow
//! torques by T.

use super::instants::{Predicted, friction};
use crate::dynamics::Plant;
use crate::effects::LowPassStep;
use crate::identification::Dataset;
use crate::identification::least_squares::least_squares;
use crate::kinematics::JointState;

/// Spacing of the instants of the comparison, s.
const STEP: f64 = 2e-3;
/// Ratio between the time constants on the grid, and their number on either side of the lag.
const GRID: (f64, i32) = (1.08, 14);
/// Number of samples around the lag at which shifts are tried.
const AROUND: isize = 4;
/// Mean decrease of ln(unexplained) per axis from the best shift to the best low-pass required for a low-pass.
const GAIN: f64 = 0.3;
/// Time constants after the start of a segment until the initial state is negligible.
const SETTLING: f64 = 6.0;
/// Least number of instants.
const MIN_INSTANTS: usize = 200;

/// First-order low-pass.
pub struct LowPass {
    /// Time constant, s.
    pub time_constant: f64,
    /// Its standard deviation due to the spacing of the grid, s.
    pub std: f64,
}

/// Low-pass of torques that follow the model best `lag` samples late; `None` if a shift explains them as well, or if
/// a pose is unreachable.
pub fn low_pass(plant: &Plant, dataset: &Dataset, lag: isize) -> Option<LowPass> {
    let late = lag as f64 * dataset.dt;
    let series =
        Series::new(plant, dataset, late * GRID.0.powi(GRID.1) * SETTLING, lag.unsigned_abs() + AROUND as usize)?;
    let shifted =
        (lag - AROUND..=lag + AROUND).map(|lag| series.cost(&series.features, lag)).fold(f64::INFINITY, f64::min);
    let tried = (-GRID.1..=GRID.1).map(|k| late * GRID.0.powi(k));
    let costs = tried.map(|t| (t, series.cost(&series.filtered(t), 0)));
    let (time_constant, cost) = costs.min_by(|a, b| a.1.total_cmp(&b.1))?;
    let clear = cost < shifted - GAIN * series.features.len() as f64;
    // A uniform density over the spacing.
    let std = time_constant * (GRID.0 - 1.0) / 12f64.sqrt();
    clear.then_some(LowPass { time_constant, std })
}

/// Features of the torques at equally spaced instants.
struct Series<'a> {
    dataset: &'a Dataset,
    /// Samples of the instants, by segment.
    at: Vec<Vec<usize>>,
    /// Spacing of the instants, s.
    step: f64,
    /// Instants at the start of each segment that only initialise the filter.
    skip: usize,
    /// By axis: predicted torque, rate and its smooth sign, over the concatenated segments.
    features: Vec<[Vec<f64>; 3]>,
}

impl<'a> Series<'a> {
    /// Features over the segments that are longer than `memory` (s), without `margin` samples at either end.
    fn new(plant: &Plant, dataset: &'a Dataset, memory: f64, margin: usize) -> Option<Self> {
        if dataset.dt <= 0.0 {
            return None;
        }
        let stride = dataset.stride(STEP);
        let step = stride as f64 * dataset.dt;
        let skip = (memory / step).ceil() as usize;
        let inner = |s: &std::ops::Range<usize>| s.start + margin..s.end.saturating_sub(margin);
        let stretches = dataset.segments.iter().map(|s| inner(s).step_by(stride).collect::<Vec<usize>>());
        let at: Vec<Vec<usize>> = stretches.filter(|s| s.len() > skip).collect();
        if at.iter().map(|s| s.len() - skip).sum::<usize>() < MIN_INSTANTS {
            return None;
        }
        let joints: Vec<JointState> = at.iter().flatten().map(|&k| dataset.joints[k]).collect();
        let t = dataset.t.first().copied().unwrap_or(0.0);
        let predicted = Predicted::new(plant, &dataset.channels, t, &joints);
        let drives = plant.mechanism.axes().min(predicted.series.len());
        let axis = |i: usize| {
            let [rates, signs] = friction(&joints, i);
            [predicted.series[i].clone(), rates, signs]
        };
        let all = predicted.possible.iter().all(|p| *p);
        all.then(|| Self { dataset, step, skip, features: (0..drives).map(axis).collect(), at })
    }

    /// The low-pass filtered features; the filter starts each segment at its first value.
    fn filtered(&self, time_constant: f64) -> Vec<[Vec<f64>; 3]> {
        let step = LowPassStep::new(self.step, time_constant);
        let one = |u: &Vec<f64>| {
            let mut out = Vec::with_capacity(u.len());
            let mut from = 0;
            for stretch in &self.at {
                let mut y = u[from];
                out.push(y);
                for w in u[from..from + stretch.len()].windows(2) {
                    y = step.output(y, [w[0], w[1]]);
                    out.push(y);
                }
                from += stretch.len();
            }
            out
        };
        self.features.iter().map(|axis| axis.each_ref().map(one)).collect()
    }

    /// Sum over the axes of ln(mean square) of the residual of torques `lag` samples later on the features and a
    /// constant.
    fn cost(&self, features: &[[Vec<f64>; 3]], lag: isize) -> f64 {
        let kept = |values: &[f64]| -> Vec<f64> {
            let mut out = Vec::with_capacity(values.len());
            let mut from = 0;
            for stretch in &self.at {
                out.extend_from_slice(&values[from + self.skip..from + stretch.len()]);
                from += stretch.len();
            }
            out
        };
        let axis = |(i, own): (usize, &[Vec<f64>; 3])| {
            let measured: Vec<f64> =
                self.at.iter().flatten().map(|&k| self.dataset.measured[i][k.saturating_add_signed(lag)]).collect();
            let y = kept(&measured);
            let [torque, rate, sign] = own.each_ref().map(|f| kept(f));
            let ones = vec![1.0; y.len()];
            let fit = least_squares(&[&ones, &torque, &rate, &sign], &y)?;
            Some(fit.mean_square.max(f64::MIN_POSITIVE).ln())
        };
        features.iter().enumerate().filter_map(axis).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A first-order low-pass maps u = t from rest to t − T + T·e^(−t/T).
    #[test]
    fn a_ramp_comes_late_by_the_time_constant() {
        let (step, t) = (2e-3, 8e-3);
        let ramp: Vec<f64> = (0..50).map(|k| f64::from(k) * step).collect();
        let dataset = Dataset::exact(Default::default(), Default::default(), Vec::new(), step, Vec::new());
        let series = Series {
            dataset: &dataset,
            at: vec![(0..50).collect()],
            step,
            skip: 0,
            features: vec![[ramp.clone(), ramp.clone(), ramp]],
        };
        for (k, y) in series.filtered(t)[0][0].iter().enumerate() {
            let at = k as f64 * step;
            let exact = at - t + t * (-at / t).exp();
            assert!((y - exact).abs() < 1e-15, "{k}: {y} {exact}");
        }
    }
}

//! Lag of a measured position of the end effector against the angles.

use nalgebra::Vector3;

use super::{Evidence, Finding, Problem, Remedy, rounded};
use crate::dynamics::Plant;
use crate::evidence::noise::correlation_time;
use crate::identification::dataset::stride_for;
use crate::model::Model;
use crate::recording::{Channel, Recording};

/// Largest lag considered, s, and number of lags on either side of zero.
const LAGS: (f64, i32) = (0.25, 100);
/// Largest number of instants examined.
const INSTANTS: usize = 2000;
/// Least decrease of the mean square by a lag, and largest RMS with it relative to that of the motion.
const EXPLAINED: (f64, f64) = (0.5, 0.3);
/// Standard errors of a lag beyond which it is one.
const CLEAR: f64 = 4.0;

/// Lag of the positions `ee` of a recording, which another device may measure, against its angles; `None` if there is none.
///
/// The positions are those of the angles' forward kinematics a lag earlier, by least squares, with a constant offset of
/// the frame. Of a slow sensor whose values are held only the samples count at which they change.
pub fn positions(model: &Model, recording: &Recording) -> Option<Finding> {
    let course = Course::new(model, recording)?;
    let candidates = (-LAGS.1..=LAGS.1).map(|k| LAGS.0 * f64::from(k) / f64::from(LAGS.1));
    let fits = candidates.filter_map(|lag| course.fit(lag));
    let mut best = fits.min_by(|a, b| a.mean_square.total_cmp(&b.mean_square))?;
    for _ in 0..4 {
        best = course.fit(best.lag + best.step)?;
    }
    let (own, dt) = (course.fit(0.0)?, recording.signals.sample_time());
    let is_late = best.lag.abs() > dt.max(CLEAR * best.std) && best.lag.abs() < LAGS.0;
    let explains =
        best.mean_square < EXPLAINED.0 * own.mean_square && best.mean_square < EXPLAINED.1.powi(2) * course.spread();
    (is_late && explains).then(|| {
        let milliseconds = rounded(1e3 * best.lag, 3);
        let late = if best.lag > 0.0 { "late" } else { "early" };
        Finding {
            recording: recording.name.clone(),
            axis: None,
            problem: Problem::Lag,
            severe: false,
            evidence: Evidence {
                value: Some((best.lag, best.std)),
                rms_before: Some(own.mean_square.sqrt()),
                rms_after: Some(best.mean_square.sqrt()),
                ..Evidence::default()
            },
            sentence: format!(
                "the positions ee_x, ee_y, ee_z come {} ± {} ms {late} against the angles",
                milliseconds.abs(),
                rounded(1e3 * best.std, 1)
            ),
            remedy: Remedy::Map(["x", "y", "z"].map(|k| format!("ee_{k}=ee_{k}@{milliseconds}ms")).into()),
        }
    })
}

/// Measured positions and those of the angles.
struct Course<'a> {
    t: &'a [f64],
    /// Forward kinematics at every sample, m.
    path: Vec<Vector3<f64>>,
    measured: Vec<[f64; 3]>,
    /// Samples that are compared.
    at: Vec<usize>,
    dt: f64,
}

/// Least squares at one lag, s.
struct Fit {
    lag: f64,
    mean_square: f64,
    /// Step to the best lag nearby, and its standard error.
    step: f64,
    std: f64,
}

impl<'a> Course<'a> {
    fn new(model: &Model, recording: &'a Recording) -> Option<Self> {
        let signals = &recording.signals;
        let plant = Plant::new(model, &recording.setup);
        let measured: Vec<[f64; 3]> = signals.rows(Channel::EndEffector).iter().collect();
        if measured.is_empty() || !plant.assembled {
            return None;
        }
        let path = signals.q().iter().map(|q| Some(Vector3::from(plant.geometry.forward(&q).ok()?)));
        let path = path.collect::<Option<Vec<_>>>()?;
        let changes: Vec<usize> = (1..measured.len()).filter(|&k| measured[k] != measured[k - 1]).collect();
        let at = changes.iter().step_by(stride_for(changes.len(), INSTANTS)).copied().collect();
        Some(Self { t: &signals.t, path, measured, at, dt: signals.sample_time() })
    }

    /// Position by the angles and its rate at a time; `None` outside and in gaps.
    fn path(&self, t: f64) -> Option<[Vector3<f64>; 2]> {
        /// Largest distance of the samples around it, in sampling periods.
        const GAP: f64 = 3.5;
        let after = self.t.partition_point(|s| *s < t).max(1);
        let (a, b) = (*self.t.get(after - 1)?, *self.t.get(after)?);
        let rate = (self.path[after] - self.path[after - 1]) / (b - a);
        (t >= a && b - a < GAP * self.dt).then(|| [self.path[after - 1] + rate * (t - a), rate])
    }

    fn fit(&self, lag: f64) -> Option<Fit> {
        let pairs: Vec<[Vector3<f64>; 2]> = self
            .at
            .iter()
            .filter_map(|&k| {
                let [place, rate] = self.path(self.t[k] - lag)?;
                Some([Vector3::from(self.measured[k]) - place, rate])
            })
            .collect();
        let n = pairs.len() as f64;
        if 2 * pairs.len() < self.at.len() || pairs.len() < 10 {
            return None;
        }
        let mean = pairs.iter().fold([Vector3::zeros(); 2], |m, p| [m[0] + p[0] / n, m[1] + p[1] / n]);
        let centred: Vec<_> = pairs.iter().map(|p| [p[0] - mean[0], p[1] - mean[1]]).collect();
        // d(measured − place(t − lag))/d lag = rate.
        let (along, square) =
            centred.iter().fold((0.0, f64::MIN_POSITIVE), |(a, b), [r, v]| (a + r.dot(v), b + v.norm_squared()));
        let mean_square = centred.iter().map(|[r, _]| r.norm_squared()).sum::<f64>() / n;
        let scores: Vec<f64> = centred.iter().map(|[r, v]| r.dot(v)).collect();
        // Per component a third of the mean square.
        let std = (mean_square / 3.0 * correlation_time(&[scores]) / square).sqrt();
        Some(Fit { lag, mean_square, step: -along / square, std })
    }

    /// Mean square of the measured positions about their mean, m².
    fn spread(&self) -> f64 {
        let n = self.at.len().max(1) as f64;
        let places = || self.at.iter().map(|&k| Vector3::from(self.measured[k]));
        let mean = places().sum::<Vector3<f64>>() / n;
        places().map(|p| (p - mean).norm_squared()).sum::<f64>() / n
    }
}

//! Measured or simulated signals: joint angles, drive torques and optional channels over time.

mod channels;
mod context;
mod difference;

pub use channels::{ROWS, multiplier_names};
pub use context::{Attachment, Contact, Contacts, Context, Level, Note, Poses};
pub use difference::Difference;

use std::ops::Range;

use crate::machine::{AXES, Mechanism, STRUTS, Setup};

/// One run of the machine, sampled at increasing times.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// Name for reports, usually the file stem.
    pub name: String,
    /// Sampled signals.
    pub signals: Signals,
    /// Known conditions of the run.
    pub setup: Setup,
}

/// Sampled signals; all channels have the length of `t`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Signals {
    /// Kind of machine; the channels of axes it does not have are zero.
    pub mechanism: Mechanism,
    /// Instant of t = 0, ns since 1970-01-01 UTC; `None` if unknown.
    pub start: Option<i64>,
    /// Time, s.
    pub t: Vec<f64>,
    /// Joint angles q = (φ1, φ2, φ3, ψ) measured by the encoders, rad; with elastic gears, on the motor side.
    pub q: Vec<[f64; AXES]>,
    /// Drive torques at the gear output, N·m.
    pub tau: Vec<[f64; AXES]>,
    /// Axial force at the elbow end of each strut, tension positive, N.
    pub strut_upper: [Option<Vec<f64>>; STRUTS],
    /// Axial force at the platform end of each strut, tension positive, N.
    pub strut_lower: [Option<Vec<f64>>; STRUTS],
    /// Position of the centre of the platform's ball plane in the inertial frame, m.
    pub ee: Option<Vec<[f64; 3]>>,
    /// Rates of `q`, rad/s.
    pub qd: Option<Vec<[f64; AXES]>>,
    /// Accelerations of `q`, rad/s².
    pub qdd: Option<Vec<[f64; AXES]>>,
    /// Remaining force margin of each ball socket (six at the elbows, six at the platform), zero once open, N.
    pub socket_margin: Option<Vec<[f64; 2 * STRUTS]>>,
    /// Multipliers of all constraint rows, see [`multiplier_names`]; zero for inactive joints.
    pub multipliers: Option<Vec<[f64; ROWS]>>,
    /// Link-side joint angles of elastic gears, rad.
    pub link_q: Option<Vec<[f64; AXES]>>,
    /// Link-side joint rates, rad/s.
    pub link_qd: Option<Vec<[f64; AXES]>>,
    /// Index ranges without a gap in time that nothing bridges; filters process each range separately. Steps of time within
    /// one may differ.
    ///
    /// Empty means a single range; use [`Signals::stretches`].
    pub segments: Vec<Range<usize>>,
}

impl Signals {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.t.len()
    }

    /// Whether there are no samples.
    pub fn is_empty(&self) -> bool {
        self.t.is_empty()
    }

    /// Index ranges of the segments, at least one unless there are no samples.
    pub fn stretches(&self) -> Vec<Range<usize>> {
        if self.segments.is_empty() && !self.is_empty() {
            std::iter::once(0..self.len()).collect()
        } else {
            self.segments.clone()
        }
    }

    /// Appends the samples of `later`, which has the same channels.
    pub fn extend(&mut self, later: Self) {
        fn append<T>(own: &mut Option<Vec<T>>, later: Option<Vec<T>>) {
            if let (Some(own), Some(later)) = (own, later) {
                own.extend(later);
            }
        }
        self.t.extend(later.t);
        self.q.extend(later.q);
        self.tau.extend(later.tau);
        for (own, later) in self.strut_upper.iter_mut().zip(later.strut_upper) {
            append(own, later);
        }
        for (own, later) in self.strut_lower.iter_mut().zip(later.strut_lower) {
            append(own, later);
        }
        append(&mut self.ee, later.ee);
        append(&mut self.qd, later.qd);
        append(&mut self.qdd, later.qdd);
        append(&mut self.socket_margin, later.socket_margin);
        append(&mut self.multipliers, later.multipliers);
        append(&mut self.link_q, later.link_q);
        append(&mut self.link_qd, later.link_qd);
    }

    /// Removes and returns the first `count` samples.
    ///
    /// # Panics
    /// If there are fewer.
    pub fn split_off_front(&mut self, count: usize) -> Self {
        fn front<T>(own: &mut Vec<T>, count: usize) -> Vec<T> {
            let rest = own.split_off(count);
            std::mem::replace(own, rest)
        }
        fn some<T>(own: &mut Option<Vec<T>>, count: usize) -> Option<Vec<T>> {
            own.as_mut().map(|own| front(own, count))
        }
        Self {
            mechanism: self.mechanism,
            start: self.start,
            t: front(&mut self.t, count),
            q: front(&mut self.q, count),
            tau: front(&mut self.tau, count),
            strut_upper: self.strut_upper.each_mut().map(|own| some(own, count)),
            strut_lower: self.strut_lower.each_mut().map(|own| some(own, count)),
            ee: some(&mut self.ee, count),
            qd: some(&mut self.qd, count),
            qdd: some(&mut self.qdd, count),
            socket_margin: some(&mut self.socket_margin, count),
            multipliers: some(&mut self.multipliers, count),
            link_q: some(&mut self.link_q, count),
            link_qd: some(&mut self.link_qd, count),
            segments: Vec::new(),
        }
    }

    /// Median sampling period, s; zero with fewer than two samples.
    pub fn sample_time(&self) -> f64 {
        sample_time(&self.t)
    }
}

/// Largest relative deviation of a sampling step from the period that counts as even.
const JITTER: f64 = 0.01;

/// Whether all steps of the times `t` are the sampling period `dt`, to within a hundredth of it.
pub fn is_even(t: &[f64], dt: f64) -> bool {
    t.windows(2).all(|w| (w[1] - w[0] - dt).abs() <= JITTER * dt)
}

/// Median step of the times `t`, s, of two the greater; zero with fewer than two times.
pub fn sample_time(t: &[f64]) -> f64 {
    let mut steps: Vec<f64> = t.windows(2).map(|w| w[1] - w[0]).collect();
    if steps.is_empty() {
        return 0.0;
    }
    let middle = steps.len() / 2;
    *steps.select_nth_unstable_by(middle, f64::total_cmp).1
}

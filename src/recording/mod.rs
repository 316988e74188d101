//! What was measured or simulated: joint angles, drive torques and optional channels over time.

mod channels;
mod context;
mod difference;

pub use channels::{ROWS, multiplier_names};
pub use context::{Attachment, Context, Level, Note, Poses};
pub use difference::Difference;

use std::ops::Range;

use crate::machine::{AXES, Mechanism, STRUTS, Setup};

/// One run of the machine, sampled at increasing times.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// Name for reports, usually the file's stem.
    pub name: String,
    /// Signals of every sample.
    pub signals: Signals,
    /// What is known about the run.
    pub setup: Setup,
}

/// Sampled signals; all channels have the length of `t`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Signals {
    /// Kind of machine: only its axes are measured, the others are zero.
    pub mechanism: Mechanism,
    /// When t = 0 was, ns since 1970-01-01 UTC; `None` where it is not known, as of simulated runs.
    pub start: Option<i64>,
    /// Time, s.
    pub t: Vec<f64>,
    /// Joint angles q = (φ1, φ2, φ3, ψ) as the encoders see them, rad: of elastic gears on the motors' side.
    pub q: Vec<[f64; AXES]>,
    /// Drive torques at the gear output, N·m.
    pub tau: Vec<[f64; AXES]>,
    /// Axial force at the elbow end of each strut, tension positive, N.
    pub strut_upper: [Option<Vec<f64>>; STRUTS],
    /// Axial force at the platform end of each strut, tension positive, N.
    pub strut_lower: [Option<Vec<f64>>; STRUTS],
    /// Platform ball plane's centre, m.
    pub ee: Option<Vec<[f64; 3]>>,
    /// Rates of the same angles, rad/s.
    pub qd: Option<Vec<[f64; AXES]>>,
    /// Accelerations of the same angles, rad/s².
    pub qdd: Option<Vec<[f64; AXES]>>,
    /// What each ball socket could still take (six at the elbows, six at the platform), zero once open, N.
    pub socket_margin: Option<Vec<[f64; 2 * STRUTS]>>,
    /// Multipliers of all constraint rows, see [`multiplier_names`]; zero of joints that do not hold.
    pub multipliers: Option<Vec<[f64; ROWS]>>,
    /// Angles of the links, behind elastic gears, rad.
    pub link_q: Option<Vec<[f64; AXES]>>,
    /// Rates of the links, rad/s.
    pub link_qd: Option<Vec<[f64; AXES]>>,
    /// Stretches of samples without a gap in time between them; filters work on one at a time.
    ///
    /// Empty means a single stretch; read [`Signals::stretches`].
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

    /// Index ranges of the uniformly sampled stretches, at least one unless there are no samples.
    pub fn stretches(&self) -> Vec<Range<usize>> {
        if self.segments.is_empty() && !self.is_empty() {
            std::iter::once(0..self.len()).collect()
        } else {
            self.segments.clone()
        }
    }

    /// Median sampling period, s; zero with fewer than two samples.
    pub fn sample_time(&self) -> f64 {
        sample_time(&self.t)
    }
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

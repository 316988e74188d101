//! How far a diagnosis is, from what it reports.

use deltatwin::diagnosis::Progress;

/// The step of a diagnosis, and how many candidates it has done.
#[derive(Clone, Debug, Default)]
pub struct Course {
    step: String,
    text: String,
    /// Shares of the diagnosis that are done before and after the step.
    span: (f64, f64),
    candidates: Option<(usize, usize)>,
}

impl Course {
    /// Goes on to what was reported.
    pub fn follow(&mut self, progress: &Progress) {
        self.text = progress.text(&self.step);
        match *progress {
            Progress::Step(what) => {
                self.span = ahead(self.span.1, what);
                (self.step, self.candidates) = (what.into(), None);
            }
            Progress::Candidates { done, of } => self.candidates = Some((done, of)),
            Progress::Ranked(_) => {}
        }
    }

    /// The step, with the candidate that is done last where it is counted.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Shares of the diagnosis that are done now and after the step.
    pub fn span(&self) -> (f64, f64) {
        let (from, to) = self.span;
        let done = self.candidates.map_or(0.0, |(done, of)| done as f64 / of.max(1) as f64);
        (from + done * (to - from), to)
    }
}

/// Share of a diagnosis after which nothing more is added.
const SEARCH: f64 = 0.85;

/// Shares of a diagnosis that are done before and after its step `what`, when `now` is done: measured on one recording of
/// 50 000 samples with one refit, of which the columns take two fifths. As the number of refits is not known, each takes a
/// part of the rest.
fn ahead(now: f64, what: &str) -> (f64, f64) {
    let (from, to): (f64, f64) = match what {
        "refit" => (0.0, 0.05),
        "columns of the candidates" => (0.05, 0.38),
        "confidence" => (SEARCH, 0.86),
        "what is left" => (0.86, 0.88),
        "next experiment" => (0.93, 1.0),
        "evidence" => (now, now + 0.02 * (SEARCH - now)),
        _ if now < SEARCH => (now, now + 0.33 * (SEARCH - now)),
        _ => (now, now + 0.4 * (0.93 - now)),
    };
    (from.max(now), to.max(now))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_share_never_falls_and_never_ends_early() {
        let mut course = Course::default();
        let mut now = 0.0;
        let mut reports = vec![Progress::Step("refit"), Progress::Step("columns of the candidates")];
        reports.extend((1..=41).map(|done| Progress::Candidates { done, of: 41 }));
        reports.push(Progress::Step("evidence"));
        reports.extend(std::iter::repeat_n(Progress::Step("refit with a"), 50));
        let last = ["confidence", "what is left", "is it explained?", "next experiment"];
        reports.extend(last.map(Progress::Step));
        for report in &reports {
            course.follow(report);
            let (from, to) = course.span();
            assert!(from >= now && to >= from && from < 1.0, "{report:?}: {now} {from} {to}");
            now = from;
        }
        assert_eq!(course.span().1, 1.0);
    }

    #[test]
    fn candidates_are_counted_within_their_step_only() {
        let mut course = Course::default();
        course.follow(&Progress::Step("columns of the candidates"));
        let (from, to) = course.span();
        course.follow(&Progress::Candidates { done: 12, of: 41 });
        assert_eq!(course.text(), "columns of the candidates: candidate 12 of 41");
        assert!((course.span().0 - (from + 12.0 / 41.0 * (to - from))).abs() < 1e-12);
        course.follow(&Progress::Step("evidence"));
        assert_eq!(course.text(), "evidence");
    }
}

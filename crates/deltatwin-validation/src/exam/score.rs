//! Statistics over graded campaigns.

use std::collections::BTreeMap;

use deltatwin::numerics;
use deltatwin::text::significant;
use deltatwin_study::statistics::wilson;
use serde_json::{Map, Value, json};

use super::judge::{Answer, Grade, Question, Truth};
use super::span::WITHIN;

/// A graded campaign.
#[derive(Clone, Debug)]
pub struct Judged {
    /// Name of its folder.
    pub name: String,
    /// Hidden effects.
    pub truth: Truth,
    /// Answer of the diagnosis.
    pub answer: Answer,
    /// Kind of question.
    pub question: Question,
    /// Grade of the answer.
    pub grade: Grade,
}

impl Judged {
    /// Grades an answer.
    pub fn new(name: String, truth: Truth, answer: Answer) -> Self {
        let (question, grade) = (Question::of(&truth), Grade::of(&truth, &answer));
        Self { name, truth, answer, question, grade }
    }

    /// Label of the hidden effects.
    pub fn hidden(&self) -> String {
        match self.question {
            Question::Nothing => NOTHING.into(),
            Question::Outside => OUTSIDE.into(),
            Question::One | Question::Several => self.truth.effects.join(" + "),
        }
    }

    /// What the answer says: its verdict or failure, the effects and sets that it names, the first probability, and the
    /// held-out residual over the noise.
    pub fn answered(&self) -> [String; 4] {
        let a = &self.answer;
        let mut named: Vec<String> = a.effects.iter().map(|e| e.name.clone()).collect();
        named.extend(a.indistinguishable.iter().map(|set| format!("{{{}}}", set.join(", "))));
        [
            a.failure.clone().unwrap_or_else(|| a.verdict.clone()),
            named.join(", "),
            a.effects.first().map_or_else(String::new, |e| format!("{:.2}", e.probability)),
            a.held_out_ratio().map_or_else(String::new, |r| significant(r, 4)),
        ]
    }

    /// Label of the answer: the effect named first, a small set with the truth, or the verdict that names none.
    pub fn said(&self) -> String {
        let small = |name: &String| self.answer.verdict == "ambiguous" && self.answer.in_small_set(name);
        if self.question == Question::One && small(&self.truth.effects[0]) {
            return IN_A_SET.into();
        }
        match (self.answer.verdict.as_str(), self.answer.effects.first()) {
            ("effect" | "several", Some(e)) => e.name.clone(),
            (verdict, _) => verdict.into(),
        }
    }

    /// Largest ratio of held-out RMS residual to noise that counts as explained: [`EXPLAINED`] times that of the
    /// robot's own model, where that is known and above one.
    fn held_out_bound(&self) -> f64 {
        EXPLAINED * self.truth.attainable.unwrap_or(1.0).max(1.0)
    }

    /// Whether the hidden law is in the span of the search's laws; `None` if the truth does not state it.
    fn in_span(&self) -> Option<bool> {
        self.truth.unspanned.map(|share| share < WITHIN)
    }

    /// (estimate − truth)/standard error of the parameters of a correctly named effect.
    fn z(&self) -> Vec<f64> {
        if self.question != Question::One || self.grade != Grade::Right {
            return Vec::new();
        }
        let of = |name: &str| self.truth.values.iter().find(|(n, _)| n == name).map(|(_, v)| *v);
        let named = self.answer.effects.iter().filter(|e| e.name == self.truth.effects[0]);
        named
            .flat_map(|e| e.parameters.iter().map(move |(p, x)| (format!("{}.{p}", e.name), x)))
            .filter_map(|(name, (value, std))| Some((value - of(&name)?) / std.filter(|s| *s > 0.0)?))
            .collect()
    }
}

/// Ratio of the held-out RMS residual to the best attainable that counts as explained.
pub const EXPLAINED: f64 = 1.03;
/// Column of the confusion matrix: the truth is one of at most three.
pub const IN_A_SET: &str = "one of 2–3";
const NOTHING: &str = "nothing";
const OUTSIDE: &str = "outside the library";

/// Number of successes in a number of trials.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rate {
    /// Successes.
    pub count: usize,
    /// Trials.
    pub of: usize,
}

impl Rate {
    /// Rate of the items for which `hit` is true.
    pub fn of<T>(items: impl IntoIterator<Item = T>, hit: impl Fn(&T) -> bool) -> Self {
        let mut rate = Self::default();
        items.into_iter().for_each(|item| rate.add(hit(&item)));
        rate
    }

    fn add(&mut self, hit: bool) {
        self.count += usize::from(hit);
        self.of += 1;
    }

    /// Share of successes; `None` without trials.
    pub fn share(self) -> Option<f64> {
        (self.of > 0).then(|| self.count as f64 / self.of as f64)
    }

    /// 95 % confidence interval of the share [Wilson 1927].
    pub fn interval(self) -> [f64; 2] {
        wilson(self.count, self.of, 0.95)
    }

    /// JSON object `{count, of, share, interval}`.
    pub fn json(self) -> Value {
        json!({"count": self.count, "of": self.of, "share": self.share(), "interval": self.interval()})
    }
}

impl std::fmt::Display for Rate {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [low, high] = self.interval();
        match self.share() {
            Some(p) => {
                write!(f, "{}/{} = {:.1} % ({:.1}–{:.1} %)", self.count, self.of, 100.0 * p, 100.0 * low, 100.0 * high)
            }
            None => write!(f, "–"),
        }
    }
}

/// Answers about laws outside the library.
#[derive(Clone, Debug, Default)]
pub struct Outside {
    /// Rate of the verdict `unknown`.
    pub unknown: Rate,
    /// Rate of the correct part of the machine among those.
    pub located: Rate,
    /// Share of the explainable held-out error that each formula explains.
    pub formulas: Vec<f64>,
}

impl Outside {
    fn of<'a>(judged: impl Iterator<Item = &'a Judged>) -> Self {
        let judged: Vec<&Judged> = judged.collect();
        let right = |j: &&&Judged| j.grade == Grade::Right;
        Self {
            unknown: Rate::of(&judged, right),
            located: Rate::of(judged.iter().filter(|j| right(j) && j.truth.place.is_some()), |j| {
                j.answer.location == j.truth.place
            }),
            formulas: judged.iter().filter_map(|j| j.answer.formula).collect(),
        }
    }

    /// JSON object `{unknown, located, formula_median}`.
    pub fn json(&self) -> Value {
        json!({
            "unknown": self.unknown.json(),
            "located": self.located.json(),
            "formula_median": median(&self.formulas),
        })
    }
}

/// Claimed probability and rate of correct names in a bin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reliability {
    /// Mean claimed probability.
    pub claimed: f64,
    /// Rate of correct names.
    pub right: Rate,
}

/// All statistics of an exam.
#[derive(Clone, Debug, Default)]
pub struct Score {
    /// Rate of false alarms without a hidden effect.
    pub false_alarms: Rate,
    /// Rate of false alarms by kind of noise.
    pub by_noise: BTreeMap<String, Rate>,
    /// Correct answers by size, for single effects of the requested size.
    pub by_size: BTreeMap<String, Rate>,
    /// Correct answers by effect and size.
    pub by_effect: BTreeMap<String, BTreeMap<String, Rate>>,
    /// Correct answers for effects that could not be made as large as requested.
    pub limited: Rate,
    /// Wrong effects named alone with high probability, over all campaigns.
    pub confidently_wrong: Rate,
    /// Both of two effects named.
    pub both: Rate,
    /// At least one of two effects named.
    pub either: Rate,
    /// Answers about all laws outside the library.
    pub outside: Outside,
    /// Answers about laws in the span of the search's laws, which measure interpolation.
    pub in_span: Outside,
    /// Answers about laws outside that span.
    pub beyond_span: Outside,
    /// Held-out RMS residual over the noise of correct answers, largest over the channels, and its bound.
    pub held_out: Vec<(String, f64, f64)>,
    /// (estimate − truth)/standard error of the parameters of correctly named effects.
    pub z: Vec<f64>,
    /// Claimed probabilities and rates of correct names.
    pub reliability: Vec<Reliability>,
    /// Brier score: mean square of claimed probability minus truth of the effects named first.
    pub brier: Option<f64>,
    /// Elapsed time of every diagnosis, s.
    pub seconds: Vec<f64>,
    /// Rows of the confusion matrix.
    pub rows: Vec<String>,
    /// Columns of the confusion matrix.
    pub columns: Vec<String>,
    /// Counts of the confusion matrix, `[row][column]`.
    pub counts: Vec<Vec<usize>>,
    /// Number of campaigns without an answer.
    pub failed: usize,
}

impl Score {
    /// All rates that have trials, with what they are; a name that begins with spaces belongs to the one above.
    pub fn rates(&self) -> Vec<(String, Rate)> {
        let mut rows: Vec<(String, Rate)> = vec![("false alarms".into(), self.false_alarms)];
        rows.extend(self.by_noise.iter().map(|(noise, rate)| (format!("  {noise}"), *rate)));
        rows.extend(self.by_size.iter().map(|(size, rate)| (format!("right, {size}"), *rate)));
        rows.extend(
            [
                ("right, limited", self.limited),
                ("both of two", self.both),
                ("at least one of two", self.either),
                ("unknown, outside the library", self.outside.unknown),
                ("  in the right place", self.outside.located),
                ("  in the span of the search", self.in_span.unknown),
                ("    in the right place", self.in_span.located),
                ("  outside that span", self.beyond_span.unknown),
                ("    in the right place", self.beyond_span.located),
                ("confidently wrong", self.confidently_wrong),
                ("held-out residual within bound", self.explained()),
                ("parameters within 3 standard errors", self.within_three()),
            ]
            .map(|(what, rate)| (what.to_string(), rate)),
        );
        rows.retain(|(_, rate)| rate.of > 0);
        rows
    }
}

/// Median of the values, the larger of two middle ones; `None` without values.
pub fn median(x: &[f64]) -> Option<f64> {
    (!x.is_empty()).then(|| numerics::median(x.iter().copied()))
}

/// Edges of the bins of claimed probabilities.
const BINS: [f64; 9] = [0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 0.99, 1.0 + 1e-9];

impl Score {
    /// Statistics of graded campaigns.
    pub fn of(judged: &[Judged]) -> Self {
        let of = |q: Question| judged.iter().filter(move |j| j.question == q);
        let right = |j: &&Judged| j.grade == Grade::Right;
        let alarm = |j: &&Judged| j.grade != Grade::Right;
        let mut score = Self {
            false_alarms: Rate::of(of(Question::Nothing), alarm),
            limited: Rate::of(of(Question::One).filter(|j| j.truth.limited), right),
            confidently_wrong: Rate::of(judged, |j| j.grade == Grade::ConfidentlyWrong),
            both: Rate::of(of(Question::Several), right),
            either: Rate::of(of(Question::Several), |j| matches!(j.grade, Grade::Right | Grade::Half)),
            outside: Outside::of(of(Question::Outside)),
            in_span: Outside::of(of(Question::Outside).filter(|j| j.in_span() == Some(true))),
            beyond_span: Outside::of(of(Question::Outside).filter(|j| j.in_span() == Some(false))),
            z: judged.iter().flat_map(Judged::z).collect(),
            seconds: judged.iter().map(|j| j.answer.seconds).collect(),
            failed: judged.iter().filter(|j| j.grade == Grade::Failed).count(),
            ..Self::default()
        };
        for j in of(Question::Nothing) {
            let noise = j.truth.noise.clone().unwrap_or_else(|| "unknown noise".into());
            score.by_noise.entry(noise).or_default().add(alarm(&j));
        }
        for j in of(Question::One) {
            let size = j.truth.size.clone().unwrap_or_else(|| "unknown size".into());
            let own = score.by_effect.entry(j.truth.effects[0].clone()).or_default();
            own.entry(if j.truth.limited { "limited".into() } else { size.clone() }).or_default().add(right(&j));
            if !j.truth.limited {
                score.by_size.entry(size).or_default().add(right(&j));
            }
        }
        for j in judged.iter().filter(|j| right(j) && j.question != Question::Outside) {
            if let Some(ratio) = j.answer.held_out_ratio() {
                score.held_out.push((j.name.clone(), ratio, j.held_out_bound()));
            }
        }
        score.claims(judged);
        score.confusion(judged);
        score
    }

    /// Counts the claimed probabilities of the effects named first.
    fn claims(&mut self, judged: &[Judged]) {
        let claims: Vec<(f64, bool)> = judged
            .iter()
            .filter_map(|j| j.answer.effects.first().map(|e| (e.probability, j.truth.effects.contains(&e.name))))
            .filter(|(p, _)| p.is_finite())
            .collect();
        let square = |(p, right): &(f64, bool)| (p - f64::from(*right)).powi(2);
        self.brier = (!claims.is_empty()).then(|| claims.iter().map(square).sum::<f64>() / claims.len() as f64);
        for bin in BINS.windows(2) {
            let own: Vec<_> = claims.iter().filter(|(p, _)| (bin[0]..bin[1]).contains(p)).collect();
            if !own.is_empty() {
                let claimed = own.iter().map(|(p, _)| p).sum::<f64>() / own.len() as f64;
                self.reliability.push(Reliability { claimed, right: Rate::of(own, |(_, right)| *right) });
            }
        }
    }

    /// Counts the answers about single effects, about nothing and about laws outside the library.
    fn confusion(&mut self, judged: &[Judged]) {
        let single: Vec<&Judged> = judged.iter().filter(|j| j.question != Question::Several).collect();
        let words = [IN_A_SET, "none", "ambiguous", "unknown", "undecided", "failed"];
        let (mut rows, mut names): (Vec<String>, Vec<String>) = (Vec::new(), Vec::new());
        for j in &single {
            rows.push(j.hidden());
            if j.question == Question::One {
                names.push(j.hidden());
            }
            if !words.contains(&j.said().as_str()) {
                names.push(j.said());
            }
        }
        // Effects first, then nothing and laws outside the library.
        let last = |name: &String| (name == NOTHING, name == OUTSIDE);
        rows.sort_by(|a, b| last(a).cmp(&last(b)).then_with(|| a.cmp(b)));
        rows.dedup();
        names.sort();
        names.dedup();
        names.extend(words.iter().map(|w| w.to_string()).filter(|w| single.iter().any(|j| j.said() == *w)));
        let mut counts = vec![vec![0; names.len()]; rows.len()];
        for j in &single {
            let row = rows.iter().position(|r| *r == j.hidden());
            let column = names.iter().position(|n| *n == j.said());
            if let (Some(r), Some(c)) = (row, column) {
                counts[r][c] += 1;
            }
        }
        (self.rows, self.columns, self.counts) = (rows, names, counts);
    }

    /// Rate of held-out ratios within their bounds.
    pub fn explained(&self) -> Rate {
        Rate::of(&self.held_out, |(_, ratio, bound)| ratio <= bound)
    }

    /// Rate of parameters within three standard errors.
    pub fn within_three(&self) -> Rate {
        Rate::of(&self.z, |z| z.abs() <= 3.0)
    }

    /// Median and largest elapsed time of a diagnosis, s; `None` without diagnoses.
    pub fn time(&self) -> Option<[f64; 2]> {
        Some([median(&self.seconds)?, self.seconds.iter().copied().fold(0.0, f64::max)])
    }

    /// JSON object with stable keys.
    pub fn json(&self, judged: &[Judged]) -> Value {
        let rates =
            |m: &BTreeMap<String, Rate>| m.iter().map(|(k, r)| (k.clone(), r.json())).collect::<Map<String, Value>>();
        let mut false_alarms = self.false_alarms.json();
        false_alarms["by_noise"] = Value::Object(rates(&self.by_noise));
        let reliability = |r: &Reliability| {
            let mut value = r.right.json();
            value["claimed"] = json!(r.claimed);
            value
        };
        let campaign = |j: &Judged| {
            let mut campaign = json!({
                "campaign": j.name,
                "hidden": j.truth.effects,
                "size": j.truth.size,
                "noise": j.truth.noise,
                "limited": j.truth.limited,
                "verdict": j.answer.verdict,
                "named": j.answer.effects.iter().map(|e| &e.name).collect::<Vec<_>>(),
                "indistinguishable": j.answer.indistinguishable,
                "probability": j.answer.effects.first().map(|e| e.probability),
                "held_out_ratio": j.answer.held_out_ratio(),
                "grade": j.grade,
            });
            if j.question == Question::Outside {
                campaign["law"] = json!(j.truth.law);
                campaign["unspanned"] = json!(j.truth.unspanned);
                campaign["in_span"] = json!(j.in_span());
            }
            campaign
        };
        let mut outside = self.outside.json();
        outside["in_span"] = self.in_span.json();
        outside["beyond_span"] = self.beyond_span.json();
        let mean_square = self.z.iter().map(|z| z * z).sum::<f64>() / self.z.len().max(1) as f64;
        json!({
            "count": judged.len(),
            "failed": self.failed,
            "false_alarms": false_alarms,
            "right": rates(&self.by_size),
            "limited": self.limited.json(),
            "effects": self.by_effect.iter().map(|(k, m)| (k.clone(), Value::Object(rates(m)))).collect::<Map<_, _>>(),
            "confidently_wrong": self.confidently_wrong.json(),
            "pairs": {"both": self.both.json(), "at_least_one": self.either.json()},
            "outside": outside,
            "held_out": {"within_bound": self.explained().json()},
            "z": {"within_three": self.within_three().json(), "rms": mean_square.sqrt()},
            "reliability": self.reliability.iter().map(reliability).collect::<Vec<_>>(),
            "brier": self.brier,
            "seconds": self.time().map(|[median, max]| json!({"median": median, "max": max})),
            "confusion": {"rows": self.rows, "columns": self.columns, "counts": self.counts},
            "campaigns": judged.iter().map(campaign).collect::<Vec<_>>(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn judged(unspanned: Option<f64>, verdict: &str) -> Judged {
        let truth =
            Truth { effects: vec!["formula".into()], place: Some("drive 1".into()), unspanned, ..Truth::default() };
        let answer = Answer { verdict: verdict.into(), location: Some("drive 1".into()), ..Answer::default() };
        Judged::new("campaign".into(), truth, answer)
    }

    #[test]
    fn interpolation_is_counted_apart() {
        let all = [
            judged(Some(0.0), "unknown"),
            judged(Some(1e-7), "unknown"),
            judged(Some(1e-5), "effect"),
            judged(Some(0.8), "unknown"),
            judged(Some(1.0), "none"),
            // A truth of other software states nothing about the span.
            judged(None, "unknown"),
        ];
        let score = Score::of(&all);
        let counts = |o: &Outside| (o.unknown.count, o.unknown.of, o.located.count, o.located.of);
        assert_eq!(counts(&score.outside), (4, 6, 4, 4));
        assert_eq!(counts(&score.in_span), (2, 2, 2, 2));
        assert_eq!(counts(&score.beyond_span), (1, 3, 1, 1));
        let json = score.json(&all);
        assert_eq!(json["outside"]["unknown"]["of"], 6);
        assert_eq!(json["outside"]["beyond_span"]["unknown"]["count"], 1);
        assert_eq!(json["campaigns"][1]["in_span"], true);
        assert!(json["campaigns"][5]["in_span"].is_null());
    }

    #[test]
    fn the_bound_of_what_is_left_is_that_of_the_robots_own_model() {
        let bound = |attainable| {
            let truth = Truth { attainable, ..Truth::default() };
            Judged::new("campaign".into(), truth, Answer::default()).held_out_bound()
        };
        assert_eq!([bound(None), bound(Some(0.9)), bound(Some(1.1))], [EXPLAINED, EXPLAINED, EXPLAINED * 1.1]);
    }
}

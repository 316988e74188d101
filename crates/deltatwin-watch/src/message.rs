//! Messages of a machine as JSON: `{"t": s, "q": […], "tau": […]}`, or a batch with lists of them.

use deltatwin::machine::PerAxis;
use deltatwin::monitoring::Sample;
use serde::Deserialize;
use serde_json::value::RawValue;
use serde_json::{Value, json};
use thiserror::Error;

use crate::stamped::{Stamped, nanoseconds};

/// Largest number of samples in a message.
pub const MOST: usize = 100_000;
/// Largest magnitudes of angle and torque.
const LARGEST: [f64; 2] = [1e6, 1e9];
/// Number of characters of a time that is not usable that are quoted.
const QUOTED: usize = 40;

/// Content of a message.
#[derive(Clone, Debug, PartialEq)]
pub enum Message {
    /// Samples, in the order of the message.
    Samples(Vec<Stamped>),
    /// No more samples follow: `{"end": true}`.
    End,
}

/// Reason why a message is not used.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("{problem}; expected {{\"t\": s, \"q\": [{axes} angles], \"tau\": [{axes} torques]}}, or lists of them")]
pub struct Unusable {
    problem: String,
    axes: usize,
}

/// One row or a list of rows.
#[derive(Deserialize)]
#[serde(untagged)]
enum Rows {
    One(Vec<f64>),
    Many(Vec<Vec<f64>>),
}

#[derive(Deserialize)]
struct Raw<'a> {
    #[serde(default)]
    end: bool,
    /// One time or a list of them, as text: a number would lose digits.
    #[serde(borrow)]
    t: Option<&'a RawValue>,
    q: Option<Rows>,
    tau: Option<Rows>,
}

impl Rows {
    fn list(self) -> Vec<Vec<f64>> {
        match self {
            Self::One(row) => vec![row],
            Self::Many(rows) => rows,
        }
    }
}

/// Content of a message about a machine with `axes` axes. Other keys than those above are ignored.
///
/// # Errors
/// What is wrong with the message.
pub fn parse(payload: &[u8], axes: usize) -> Result<Message, Unusable> {
    let unusable = |problem: String| Unusable { problem, axes };
    let raw: Raw = serde_json::from_slice(payload).map_err(|e| unusable(e.to_string()))?;
    if raw.end {
        return Ok(Message::End);
    }
    let missing = |name: &str| unusable(format!("`{name}` is missing"));
    let t = raw.t.ok_or_else(|| missing("t"))?;
    let times = if t.get().starts_with('[') {
        serde_json::from_str::<Vec<&RawValue>>(t.get()).map_err(|e| unusable(e.to_string()))?
    } else {
        vec![t]
    };
    let (q, tau) = (raw.q.ok_or_else(|| missing("q"))?.list(), raw.tau.ok_or_else(|| missing("tau"))?.list());
    if q.len() != times.len() || tau.len() != times.len() || times.len() > MOST {
        let counts = format!("{} times, {} rows `q` and {} rows `tau`", times.len(), q.len(), tau.len());
        return Err(unusable(format!("has {counts}, which should be as many, at most {MOST}")));
    }
    let sample = |(k, t): (usize, &RawValue)| {
        let row = |name: &str, row: &[f64], largest: f64| checked(name, row, axes, largest).map_err(unusable);
        let time = nanoseconds(t.get());
        let time = time.ok_or_else(|| unusable(format!("`t` is {}", t.get().chars().take(QUOTED).collect::<String>())));
        Ok(Stamped { time: time?, q: row("q", &q[k], LARGEST[0])?, tau: row("tau", &tau[k], LARGEST[1])? })
    };
    times.into_iter().enumerate().map(sample).collect::<Result<_, _>>().map(Message::Samples)
}

/// A row as values of all axes, those that the machine does not have zero.
fn checked(name: &str, row: &[f64], axes: usize, largest: f64) -> Result<PerAxis<f64>, String> {
    if row.len() != axes {
        return Err(format!("`{name}` has {} values", row.len()));
    }
    if let Some(value) = row.iter().find(|x| !(x.is_finite() && x.abs() <= largest)) {
        return Err(format!("`{name}` has the value {value}"));
    }
    Ok(std::array::from_fn(|i| row.get(i).copied().unwrap_or(0.0)))
}

/// The message with `samples` of a machine with `axes` axes, as a batch.
pub fn batch(samples: &[Sample], axes: usize) -> Value {
    let rows = |of: fn(&Sample) -> &PerAxis<f64>| samples.iter().map(|s| &of(s)[..axes]).collect::<Vec<_>>();
    json!({ "t": samples.iter().map(|s| s.t).collect::<Vec<_>>(), "q": rows(|s| &s.q), "tau": rows(|s| &s.tau) })
}

/// The message that no more samples follow.
pub fn end() -> Value {
    json!({ "end": true })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sample(t: f64) -> Sample {
        Sample { t, q: [t, 0.1, -0.2, 3.0], tau: [1.5, -2.0, 0.0, 1e-9] }
    }

    #[test]
    fn what_is_written_is_read() {
        let samples: Vec<Sample> = (0..50).map(|k| sample(4e-4 * f64::from(k))).collect();
        let text = batch(&samples, 4).to_string();
        let stamped = |s: &Sample| Stamped { time: (s.t * 1e9).round() as i64, q: s.q, tau: s.tau };
        assert_eq!(parse(text.as_bytes(), 4), Ok(Message::Samples(samples.iter().map(stamped).collect())));
        let one = br#"{"t": 1.5, "q": [1, 2, 3, 4], "tau": [5, 6, 7, 8], "robot": "left"}"#;
        let expected = Stamped { time: 1_500_000_000, q: [1.0, 2.0, 3.0, 4.0], tau: [5.0, 6.0, 7.0, 8.0] };
        assert_eq!(parse(one, 4), Ok(Message::Samples(vec![expected])));
        assert_eq!(parse(end().to_string().as_bytes(), 4), Ok(Message::End));
        let lone = parse(br#"{"t": [ 1795510000.000400001 ], "q": [[2]], "tau": [[3]]}"#, 1);
        let time = 1_795_510_000_000_400_001;
        let expected = Stamped { time, q: [2.0, 0.0, 0.0, 0.0], tau: [3.0, 0.0, 0.0, 0.0] };
        assert_eq!(lone, Ok(Message::Samples(vec![expected])));
    }

    #[test]
    fn unusable_messages_say_why() {
        let why = |text: &str| parse(text.as_bytes(), 4).unwrap_err().to_string();
        assert!(why("").contains("EOF") && why("[1]").contains("expected") && why("null").contains("expected"));
        assert!(
            why(r#"{"q": [1,2,3,4], "tau": [1,2,3,4]}"#)
                .starts_with("`t` is missing; expected {\"t\": s, \"q\": [4 angles]")
        );
        assert!(why(r#"{"t": 1, "q": [1,2,3], "tau": [1,2,3,4]}"#).starts_with("`q` has 3 values"));
        assert!(why(r#"{"t": [1, 2], "q": [[1,2,3,4]], "tau": [[1,2,3,4]]}"#).contains("2 times, 1 rows `q`"));
        assert!(why(r#"{"t": "1", "q": [1,2,3,4], "tau": [1,2,3,4]}"#).contains("`t` is \"1\""));
        assert!(why(r#"{"t": 1e300, "q": [1,2,3,4], "tau": [1,2,3,4]}"#).contains("`t` is 1"));
        assert!(why(r#"{"t": 1, "q": [1,2,3,1e7], "tau": [1,2,3,4]}"#).contains("`q` has the value 10000000"));
        assert!(why(&format!("{}1{}", "[".repeat(100_000), "]".repeat(100_000))).contains("expected"));
    }

    proptest! {
        #[test]
        fn no_message_panics(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let _ = parse(&bytes, 4);
        }

        #[test]
        fn no_json_panics(text in r#"\{"t": ?[-0-9e\[\],.]{0,20}, "q": [\[\]0-9,e.-]{0,30}, "tau": [\[\]0-9,null]{0,30}\}"#) {
            let _ = parse(text.as_bytes(), 4);
        }
    }
}

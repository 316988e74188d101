//! What is missing of a damaged file: where, when, and how many messages of each channel.

use std::collections::BTreeMap;
use std::ops::Range;

/// Number of damaged places that are described one by one.
const TOLD: usize = 5;

/// Losses of a file in the order of their places.
#[derive(Default)]
pub struct Losses {
    places: Vec<Loss>,
    /// Whether indexes of messages that follow belong to the last loss.
    open: bool,
    /// Number of losses that were described by [`Self::news`], and whether those at the end were.
    told: usize,
    is_complete: bool,
    /// Number of messages read, and stated at the end of the file.
    read: BTreeMap<u16, u64>,
    stated: Option<BTreeMap<u16, u64>>,
    /// First and last log time, ns; largest log time of the last intact chunk.
    first: Option<u64>,
    last: Option<u64>,
    intact: Option<u64>,
    torn: u64,
}

struct Loss {
    bytes: Range<u64>,
    /// Log times, ns, as far as they are known.
    from: Option<u64>,
    to: Option<u64>,
    /// Whether the times are those of the missing messages; otherwise they are those of their neighbours.
    exact: bool,
    bloated: bool,
    messages: BTreeMap<u16, u64>,
}

impl Loss {
    /// Description, with times in s from `zero` (ns).
    fn sentence(&self, zero: i64, name: &dyn Fn(u16) -> String) -> String {
        let seconds = |time: u64| format!("{:.4} s", (time as i64).wrapping_sub(zero) as f64 / 1e9);
        let counted = |(channel, count): (&u16, &u64)| format!("{count} of {}", name(*channel));
        let what = match self.messages.is_empty() {
            true => String::new(),
            false => {
                format!(": messages missing: {}", self.messages.iter().map(counted).collect::<Vec<_>>().join(", "))
            }
        };
        let when = match (self.from, self.to, self.exact) {
            (Some(from), Some(to), true) => format!(" from {} to {}", seconds(from), seconds(to)),
            (Some(from), Some(to), false) => format!(" between {} and {}", seconds(from), seconds(to)),
            (Some(from), None, _) => format!(" after {}", seconds(from)),
            (None, Some(to), _) => format!(" before {}", seconds(to)),
            (None, None, _) => String::new(),
        };
        let why = if self.bloated { "expand to far more than a recording can" } else { "are damaged" };
        let Range { start, end } = self.bytes;
        format!("bytes {start} to {end}{when} {why} and are left out{what}")
    }
}

impl Losses {
    /// Bytes that are no records.
    pub fn skipped(&mut self, bytes: Range<u64>) {
        let from = self.last;
        // A chunk that was damaged in its length is found in two steps.
        if let Some(loss) = self.places.last_mut().filter(|loss| self.open && loss.bytes.end >= bytes.start) {
            loss.bytes.end = bytes.end;
            return;
        }
        self.open = true;
        let messages = BTreeMap::new();
        self.places.push(Loss { bytes, from, to: None, exact: false, bloated: false, messages });
    }

    /// A chunk that cannot be read.
    pub fn chunk(&mut self, bytes: Range<u64>, (from, to): (u64, u64), bloated: bool) {
        self.open = true;
        let (from, to, messages) = (Some(from), Some(to), BTreeMap::new());
        self.places.push(Loss { bytes, from, to, exact: true, bloated, messages });
    }

    /// A chunk that was read, whose last message has the log time `last`, ns.
    pub fn intact(&mut self, last: u64) {
        self.open = false;
        self.intact = Some(last);
    }

    /// A record inside an intact chunk that is none.
    pub fn torn(&mut self) {
        self.torn += 1;
    }

    pub fn message(&mut self, channel: u16, time: u64) {
        *self.read.entry(channel).or_default() += 1;
        self.first = Some(self.first.map_or(time, |first| first.min(time)));
        self.last = Some(time);
        if let Some(loss) = self.places.last_mut().filter(|loss| loss.to.is_none()) {
            loss.to = Some(time);
        }
    }

    /// The log times of a channel's messages in the chunk before.
    pub fn index(&mut self, channel: u16, times: &[u64]) {
        let of_intact = |time: &u64| self.intact.is_some_and(|intact| *time <= intact);
        let (Some(first), Some(last)) = (times.iter().min(), times.iter().max()) else { return };
        let Some(loss) = self.places.last_mut().filter(|_| self.open) else { return };
        if times.iter().all(of_intact) {
            return;
        }
        *loss.messages.entry(channel).or_default() += times.len() as u64;
        if !loss.exact {
            (loss.from, loss.to, loss.exact) = (Some(*first), Some(*last), true);
        }
        loss.from = loss.from.min(Some(*first));
        loss.to = loss.to.max(Some(*last));
    }

    /// The number of messages of each channel that the file states at its end.
    pub fn total(&mut self, messages: BTreeMap<u16, u64>) {
        self.stated = Some(messages);
    }

    /// Descriptions of the losses since the last call, as far as all is known about them; times as in
    /// [`Self::sentences`].
    pub fn news(&mut self, ended: bool, zero: Option<i64>, name: &dyn Fn(u16) -> String) -> Vec<String> {
        let is_open = self.open && !ended && self.told < self.places.len();
        let known = self.places.len() - usize::from(is_open);
        let news = self.places[self.told..known].iter();
        let mut told: Vec<String> = news.map(|loss| loss.sentence(self.zero(zero), name)).collect();
        self.told = known;
        if self.stated.is_some() && !std::mem::replace(&mut self.is_complete, true) {
            told.extend(self.in_all(name));
        }
        told
    }

    /// Instant of t = 0, ns: `zero`, or the instant of the first message.
    fn zero(&self, zero: Option<i64>) -> i64 {
        zero.or(self.first.map(|t| t as i64)).unwrap_or(0)
    }

    /// Descriptions of the losses, with times in s from `zero` (ns) or the first message; none if nothing is missing.
    pub fn sentences(&self, zero: Option<i64>, name: &dyn Fn(u16) -> String) -> Vec<String> {
        let zero = self.zero(zero);
        let mut out: Vec<String> = self.places.iter().take(TOLD).map(|loss| loss.sentence(zero, name)).collect();
        if self.places.len() > TOLD {
            out.push(format!("{} more damaged places are left out", self.places.len() - TOLD));
        }
        out.extend(self.in_all(name));
        out
    }

    /// What is known at the end only: damage inside chunks, and the number of messages of each channel that are missing.
    fn in_all(&self, name: &dyn Fn(u16) -> String) -> Vec<String> {
        let mut out = Vec::new();
        if self.torn > 0 {
            out.push(format!("{} records inside chunks are damaged and left out", self.torn));
        }
        let missing: Vec<String> = self
            .stated
            .iter()
            .flatten()
            .filter_map(|(channel, stated)| {
                let read = self.read.get(channel).copied().unwrap_or(0);
                (read < *stated).then(|| format!("{} of {stated} of {}", stated - read, name(*channel)))
            })
            .collect();
        if !missing.is_empty() {
            out.push(format!("messages missing in all: {}", missing.join(", ")));
        }
        out
    }
}

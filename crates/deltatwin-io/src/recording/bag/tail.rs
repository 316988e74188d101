//! Joint states of an MCAP file that is still being written.

use std::collections::BTreeMap;
use std::io::{Read, Seek};

use super::EPOCH;
use super::content::Full;
use super::mcap_file::{Growing, Sink};
use super::messages::{JOINT_STATE, JointNames, Numbers, RawState, is_type};
use super::read::by_name;
use super::topics;

/// One sample of the joints.
#[derive(Clone, Debug, PartialEq)]
pub struct JointSample {
    /// Time, ns: since 1970 in a file that states the instant of t = 0, since t = 0 in that of a run without a real one,
    /// else since the first sample.
    pub time: i64,
    /// Joint angles in the order of the axes, rad (m for a sliding axis).
    pub q: Vec<f64>,
    /// Drive torques, N·m (N for a sliding axis).
    pub tau: Vec<f64>,
}

/// Reader of a file in pieces, as they are written. Damaged places are left out, as in a file that is read as a whole.
pub struct Tail(Growing<Joints>);

/// The joint states of the robot.
struct Joints {
    axes: usize,
    zero: Option<i64>,
    /// Names of the joints of the last message, with their places in the order of the axes.
    order: Option<(JointNames, Vec<usize>)>,
    samples: Vec<JointSample>,
    /// Why messages were left out.
    faults: Vec<String>,
}

impl Tail {
    /// Reader of the joint states of a machine with `axes` axes, from the beginning of the file.
    pub fn new(axes: usize) -> Self {
        Self(Growing::new(Joints { axes, zero: None, order: None, samples: Vec::new(), faults: Vec::new() }))
    }

    /// Reads which topics a complete `file` has from its end, in case its beginning is damaged.
    pub fn definitions(&mut self, file: impl Read + Seek) {
        self.0.definitions(file);
    }

    /// Whether the end of the data was read: the file is complete.
    pub fn has_ended(&self) -> bool {
        self.0.has_ended()
    }

    /// Samples that the next `bytes` of the file complete.
    pub fn feed(&mut self, bytes: &[u8]) -> Vec<JointSample> {
        // Samples are handed on, and never too many.
        let _ = self.0.feed(bytes);
        std::mem::take(&mut self.0.found().samples)
    }

    /// What was left out since the last call, and why.
    pub fn faults(&mut self) -> Vec<String> {
        let mut faults = self.0.faults();
        faults.append(&mut self.0.found().faults);
        faults
    }
}

impl Sink for Joints {
    fn announce(&mut self, topic: &str, type_name: &str, encoding: &str) -> Result<Option<usize>, Full> {
        let is_joints = topic == topics::JOINTS || !topics::is_optional(topic);
        Ok((is_joints && is_type(type_name, &JOINT_STATE) && encoding == "cdr").then_some(0))
    }

    fn push(&mut self, _: usize, _: u64, data: &[u8]) -> Result<(), Full> {
        match self.sample(data) {
            Ok(sample) => self.samples.push(sample),
            Err(problem) => self.faults.push(problem),
        }
        Ok(())
    }

    fn note(&mut self, name: String, pairs: BTreeMap<String, String>) {
        if name == "run" {
            let stated = pairs.get("zero_ns").and_then(|zero| zero.parse().ok());
            self.zero = stated.map(|zero: i64| if zero == EPOCH { EPOCH } else { 0 });
        }
    }
}

impl Joints {
    fn sample(&mut self, data: &[u8]) -> Result<JointSample, String> {
        let mut numbers = Vec::new();
        let state = RawState::parse(data, &mut Numbers::All(&mut numbers));
        let state = state.ok_or("a JointState message cannot be decoded")?;
        let order = match self.order.take().filter(|(names, _)| state.has(names)) {
            Some(known) => known,
            None => {
                let names = state.names();
                let places = by_name(&names.texts(), self.axes).unwrap_or_else(|| (0..self.axes).collect());
                (names, places)
            }
        };
        let [positions, velocities, efforts] = state.counts;
        let pick = |first: usize, count: usize| {
            let value = |k: &usize| (*k < count).then(|| numbers[first + k]);
            order.1.iter().map(value).collect::<Option<Vec<f64>>>()
        };
        let (Some(q), Some(tau)) = (pick(0, positions), pick(positions + velocities, efforts)) else {
            return Err(format!(
                "a JointState message has {positions} positions and {efforts} efforts; expected {} of both",
                self.axes
            ));
        };
        let zero = *self.zero.get_or_insert(state.stamp);
        self.order = Some(order);
        Ok(JointSample { time: state.stamp.saturating_sub(zero), q, tau })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deltatwin::machine::Mechanism;
    use deltatwin::recording::{Context, Recording, Signals};

    fn file(samples: usize) -> Vec<u8> {
        let t: Vec<f64> = (0..samples).map(|k| 0.01 * k as f64).collect();
        let q: Vec<_> = t.iter().map(|t| [*t, 1.0, 2.0, 3.0]).collect();
        let tau: Vec<_> = t.iter().map(|t| [-*t, 4.0, 5.0, 6.0]).collect();
        let signals = Signals::of_drives(Mechanism::delta(true), t, &q, &tau);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        let recording = Recording { signals, ..Recording::default() };
        crate::recording::write_with(&recording, &path, &Context::default()).unwrap();
        std::fs::read(path).unwrap()
    }

    #[test]
    fn pieces_of_any_size_give_every_sample_once() {
        let bytes = file(500);
        for piece in [1, 7, 1000, bytes.len()] {
            let mut tail = Tail::new(4);
            let mut found = Vec::new();
            for part in bytes.chunks(piece) {
                found.extend(tail.feed(part));
            }
            assert!(tail.has_ended());
            assert_eq!(found.len(), 500);
            assert_eq!(found[499].time, 4_990_000_000);
            assert_eq!((found[499].q[0], found[499].tau[3]), (4.99, 6.0));
        }
    }

    /// Samples and faults of a file that comes in pieces of 500 bytes.
    fn read(bytes: &[u8]) -> (Vec<JointSample>, Vec<String>, bool) {
        let mut tail = Tail::new(4);
        tail.definitions(std::io::Cursor::new(bytes));
        let samples = bytes.chunks(500).flat_map(|part| tail.feed(part)).collect();
        (samples, tail.faults(), tail.has_ended())
    }

    #[test]
    #[ignore = "campaign"]
    fn a_flipped_bit_costs_at_most_its_chunk() {
        let bytes = file(3_000);
        let whole = read(&bytes).0;
        let mut lossless = 0;
        for place in super::super::mcap_file::MAGIC.len()..bytes.len() {
            // Most of them at the beginning, which every sample needs.
            if place % if place < 1_000 { 13 } else { 307 } != 0 {
                continue;
            }
            let mut broken = bytes.clone();
            broken[place] ^= 1 << (place % 8);
            let (samples, faults, has_ended) = read(&broken);
            // A second of samples, the longest chunk.
            assert!(samples.len() >= 2_900, "byte {place}: {} samples, {faults:?}", samples.len());
            // Times count from another instant where the number that states it was hit.
            let is_known = |sample: &JointSample| {
                let original = &whole[(100.0 * sample.q[0]).round() as usize];
                (&original.q, &original.tau) == (&sample.q, &sample.tau)
            };
            assert!(samples.iter().all(is_known), "byte {place}");
            assert!(samples.len() == 3_000 || !faults.is_empty() || !has_ended, "byte {place}");
            lossless += usize::from(samples.len() == 3_000);
        }
        assert!(lossless > 10);
    }

    #[test]
    fn a_stretch_of_zeros_costs_its_chunks() {
        let bytes = file(3_000);
        let mut hit = 0;
        for k in 1..9 {
            let at = k * bytes.len() / 10;
            let mut broken = bytes.clone();
            broken[at..at + 512].fill(0);
            let (samples, faults, _) = read(&broken);
            assert!((2_700..=3_000).contains(&samples.len()), "{k}: {} samples, {faults:?}", samples.len());
            let is_told = faults.iter().any(|fault| fault.contains("damaged"));
            assert!(samples.len() == 3_000 || is_told, "{k}: {faults:?}");
            hit += usize::from(samples.len() < 3_000);
        }
        assert!(hit > 2, "{hit}");
    }

    #[test]
    fn whatever_it_is_told_it_is_not_long() {
        for text in [&b"not a bag at all, but a text"[..], &[0x04; 200_000], &[0x80; 100_000]] {
            assert_eq!(read(text).0.len(), 0);
        }
    }
}

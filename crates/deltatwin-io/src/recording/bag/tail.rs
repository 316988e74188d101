//! Joint states of an MCAP file that is still being written.

use std::collections::{HashMap, HashSet};

use mcap::records::Record;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::messages::{JOINT_STATE, JointNames, Numbers, RawState, SECOND, is_type};
use super::read::by_name;

/// Size above which records and chunks count as damaged, bytes.
const LARGEST_RECORD: usize = 64 << 20;

/// One sample of the joints.
#[derive(Clone, Debug, PartialEq)]
pub struct JointSample {
    /// Time since the instant of t = 0 that the file states, else since its first sample, s.
    pub t: f64,
    /// Joint angles in the order of the axes, rad (m for a sliding axis).
    pub q: Vec<f64>,
    /// Drive torques, N·m (N for a sliding axis).
    pub tau: Vec<f64>,
}

/// Reader of a file in pieces, as they are written.
pub struct Tail {
    axes: usize,
    reader: LinearReader,
    schemas: HashMap<u16, String>,
    joints: HashSet<u16>,
    zero: Option<i64>,
    /// Names of the joints of the last message, with their places in the order of the axes.
    order: Option<(JointNames, Vec<usize>)>,
    ended: bool,
}

impl Tail {
    /// Reader of the joint states of a machine with `axes` axes, from the beginning of the file.
    pub fn new(axes: usize) -> Self {
        let options = LinearReaderOptions::default()
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(LARGEST_RECORD);
        Self {
            axes,
            reader: LinearReader::new_with_options(options),
            schemas: HashMap::new(),
            joints: HashSet::new(),
            zero: None,
            order: None,
            ended: false,
        }
    }

    /// Whether the end of the data was read: the file is complete.
    pub fn has_ended(&self) -> bool {
        self.ended
    }

    /// Samples that the next `bytes` of the file complete.
    ///
    /// # Errors
    /// What is wrong with the file; later calls return errors, too.
    pub fn feed(&mut self, mut bytes: &[u8]) -> Result<Vec<JointSample>, String> {
        let mut found = Vec::new();
        while !self.ended {
            let record = match self.reader.next_event() {
                None => break,
                Some(Err(e)) => return Err(e.to_string()),
                Some(Ok(LinearReadEvent::ReadRequest(_))) if bytes.is_empty() => break,
                Some(Ok(LinearReadEvent::ReadRequest(wanted))) => {
                    let (now, rest) = bytes.split_at(wanted.min(bytes.len()));
                    self.reader.insert(now.len()).copy_from_slice(now);
                    self.reader.notify_read(now.len());
                    bytes = rest;
                    continue;
                }
                Some(Ok(LinearReadEvent::Record { data, opcode })) => {
                    mcap::read::parse_record(opcode, data).map_err(|e| e.to_string())?.into_owned()
                }
            };
            found.extend(self.take(record)?);
        }
        Ok(found)
    }

    fn take(&mut self, record: Record<'static>) -> Result<Option<JointSample>, String> {
        match record {
            Record::Schema { header, .. } => {
                self.schemas.insert(header.id, header.name);
            }
            Record::Channel(c) => {
                let is_state = self.schemas.get(&c.schema_id).is_some_and(|name| is_type(name, &JOINT_STATE));
                let is_joints = c.topic == super::topics::JOINTS || !super::topics::is_optional(&c.topic);
                if is_state && is_joints && c.message_encoding == "cdr" {
                    self.joints.insert(c.id);
                }
            }
            Record::Metadata(m) if m.name == "run" => {
                self.zero = m.metadata.get("zero_ns").and_then(|zero| zero.parse().ok());
            }
            Record::Message { header, data } if self.joints.contains(&header.channel_id) => {
                return self.sample(&data).map(Some);
            }
            Record::DataEnd(_) => self.ended = true,
            _ => {}
        }
        Ok(None)
    }

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
        let t = state.stamp.saturating_sub(zero) as f64 / SECOND as f64;
        self.order = Some(order);
        Ok(JointSample { t, q, tau })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deltatwin::machine::Mechanism;
    use deltatwin::recording::{Context, Recording, Signals};

    fn file(samples: usize) -> Vec<u8> {
        let t: Vec<f64> = (0..samples).map(|k| 0.01 * k as f64).collect();
        let signals = Signals {
            mechanism: Mechanism::delta(true),
            q: t.iter().map(|t| [*t, 1.0, 2.0, 3.0]).collect(),
            tau: t.iter().map(|t| [-*t, 4.0, 5.0, 6.0]).collect(),
            t,
            ..Signals::default()
        };
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
                found.extend(tail.feed(part).unwrap());
            }
            assert!(tail.has_ended());
            assert_eq!(found.len(), 500);
            assert!((found[499].t - 4.99).abs() < 1e-9);
            assert_eq!((found[499].q[0], found[499].tau[3]), (4.99, 6.0));
        }
    }

    #[test]
    fn damage_is_an_error_and_no_panic() {
        let bytes = file(200);
        for place in (0..bytes.len()).step_by(37) {
            let mut broken = bytes.clone();
            broken[place] ^= 0x55;
            let mut tail = Tail::new(4);
            let samples: usize = broken.chunks(500).map(|part| tail.feed(part).map_or(0, |s| s.len())).sum();
            assert!(samples <= 200);
        }
        assert!(Tail::new(4).feed(b"no bag at all, but a text").is_err());
    }
}

//! Values that accompany the joint states: rows of numbers in the columns of their topic.

use deltatwin::machine::Mechanism;
use deltatwin::recording::Field;

use super::super::messages::{JointNames, Numbers, RawState, parse_accelerations, parse_force, parse_point};
use super::super::topics;
use super::Encoding;

/// Rows of equally many numbers, NaN where a message lacks one.
pub struct Rows {
    topic: String,
    encoding: Encoding,
    /// Columns of the topic where messages name them.
    columns: Vec<String>,
    /// Place of each column among the numbers of the messages whose joints have these names.
    places: Option<(JointNames, Vec<Option<usize>>)>,
    width: usize,
    values: Vec<f64>,
    /// Number of rows that have a number in each column.
    present: Vec<usize>,
}

impl Rows {
    pub fn new(topic: &str, encoding: Encoding) -> Self {
        // Those of the machine with the most axes.
        let columns = topics::channels(topic, Mechanism::default()).map(|(_, channel)| channel.to_string()).collect();
        Self { topic: topic.into(), encoding, columns, places: None, width: 0, values: Vec::new(), present: Vec::new() }
    }

    /// Appends a message; returns the memory it takes, bytes. `None` if it cannot be decoded or has another width.
    pub fn push(&mut self, data: &[u8]) -> Option<usize> {
        let row = self.decode(data)?;
        if self.width == 0 {
            self.width = row.len();
            self.present = vec![0; row.len()];
        }
        if row.is_empty() || row.len() != self.width {
            return None;
        }
        for (value, present) in row.iter().zip(&mut self.present) {
            *present += usize::from(value.is_some());
        }
        self.values.extend(row.iter().map(|value| value.unwrap_or(f64::NAN)));
        Some(8 * self.width)
    }

    fn decode(&mut self, data: &[u8]) -> Option<Vec<Option<f64>>> {
        if self.encoding == Encoding::Json {
            return topics::decode_json(&self.topic, data);
        }
        let (field, _) = topics::channels(&self.topic, Mechanism::default()).next()?;
        let values = match field {
            Field::Effort => return self.named(data),
            Field::Position | Field::Velocity => {
                let mut values = Vec::new();
                let raw = RawState::parse(data, &mut Numbers::All(&mut values))?;
                values.truncate(raw.counts[0] + raw.counts[1]);
                values
            }
            Field::Point => parse_point(data)?.to_vec(),
            Field::Force => parse_force(data)?.to_vec(),
            Field::Accelerations => parse_accelerations(data)?,
        };
        Some(values.into_iter().map(Some).collect())
    }

    /// The efforts of a joint state in the order of the columns.
    fn named(&mut self, data: &[u8]) -> Option<Vec<Option<f64>>> {
        let mut efforts = Vec::new();
        let raw = RawState::parse(data, &mut Numbers::Efforts(&mut efforts))?;
        if self.places.as_ref().is_none_or(|(names, _)| !raw.has(names)) {
            let names = raw.names();
            let texts = names.texts();
            let places = self.columns.iter().map(|column| texts.iter().position(|name| name == column)).collect();
            self.places = Some((names, places));
        }
        let (_, places) = self.places.as_ref()?;
        Some(places.iter().map(|place| efforts.get((*place)?).copied()).collect())
    }

    /// Number of columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Column `k` of row `i`.
    pub fn value(&self, i: usize, k: usize) -> f64 {
        self.values[i * self.width + k]
    }

    /// Number of rows that have a number in column `k`.
    pub fn present(&self, k: usize) -> usize {
        self.present.get(k).copied().unwrap_or(0)
    }

    /// Puts the rows into this order.
    pub fn reorder(&mut self, order: &[usize]) {
        let width = self.width;
        self.values = order.iter().flat_map(|&i| &self.values[i * width..(i + 1) * width]).copied().collect();
    }
}

//! Values that accompany the joint states: rows of numbers in the columns of their topic.

use super::super::messages::{JointNames, Numbers, RawState, parse_accelerations, parse_point};
use super::super::topics;
use super::Encoding;

/// Largest number of axes of a machine whose values a row can hold.
const AXES: usize = deltatwin::machine::AXES;

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
        let columns = topics::columns(topic, AXES);
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
        match (self.encoding, self.topic.as_str()) {
            (Encoding::Cdr, topics::STRUT_FORCES | topics::SOCKET_MARGINS | topics::MULTIPLIERS) => self.named(data),
            (Encoding::Cdr, topics::LINKS) => {
                let mut values = Vec::new();
                let raw = RawState::parse(data, &mut Numbers::All(&mut values))?;
                values.truncate(raw.counts[0] + raw.counts[1]);
                Some(values.into_iter().map(Some).collect())
            }
            (Encoding::Cdr, topics::END_EFFECTOR) => Some(parse_point(data)?.map(Some).to_vec()),
            (Encoding::Cdr, _) => Some(parse_accelerations(data)?.into_iter().map(Some).collect()),
            (Encoding::Json, topic) => topics::decode_json(topic, data),
        }
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

//! Joint states, compactly: the numbers of all messages in one place.

use std::collections::HashMap;

use super::super::messages::{JointNames, Numbers, RawState};

/// What successive messages have in common: the names of the joints, and how many numbers there are.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    pub names: Vec<String>,
    /// Number of positions, velocities and efforts.
    pub counts: [usize; 3],
}

/// Joint states in file order.
#[derive(Default)]
pub struct States {
    shapes: Vec<Shape>,
    known: HashMap<(JointNames, [usize; 3]), u32>,
    /// The names of the last message, which the next one usually repeats.
    last: Option<(JointNames, [usize; 3], u32)>,
    /// Index of the shape of each message, [`UNDECODABLE`] for none.
    shape_of: Vec<u32>,
    /// Stamp of each message, ns since 1970.
    stamps: Vec<i64>,
    /// Where the numbers of each message begin, unless all messages have one shape.
    starts: Vec<usize>,
    values: Vec<f64>,
}

const UNDECODABLE: u32 = u32::MAX;

/// One message.
#[derive(Clone, Copy)]
pub struct State<'a> {
    pub shape: &'a Shape,
    /// Index of the shape.
    pub kind: usize,
    /// ns since 1970-01-01 UTC.
    pub stamp: i64,
    values: &'a [f64],
}

impl<'a> State<'a> {
    pub fn position(&self) -> &'a [f64] {
        &self.values[..self.shape.counts[0]]
    }

    pub fn velocity(&self) -> &'a [f64] {
        let [position, velocity, _] = self.shape.counts;
        &self.values[position..position + velocity]
    }

    pub fn effort(&self) -> &'a [f64] {
        let [position, velocity, _] = self.shape.counts;
        &self.values[position + velocity..]
    }
}

impl States {
    /// Appends a message; returns the memory it takes, bytes. One that cannot be decoded is kept as such.
    pub fn push(&mut self, data: &[u8]) -> usize {
        let start = self.values.len();
        let Some(raw) = RawState::parse(data, &mut Numbers::All(&mut self.values)) else {
            self.values.truncate(start);
            self.shape_of.push(UNDECODABLE);
            self.stamps.push(0);
            self.starts.push(start);
            return 20;
        };
        let is_last = |(names, counts, _): &&(JointNames, [usize; 3], u32)| *counts == raw.counts && raw.has(names);
        let (shape, new) = match self.last.as_ref().filter(is_last) {
            Some((_, _, shape)) => (*shape, 0),
            None => self.intern(&raw),
        };
        self.shape_of.push(shape);
        self.stamps.push(raw.stamp);
        self.starts.push(start);
        20 + 8 * (self.values.len() - start) + new
    }

    /// Index of the shape of a message, and the memory that it newly takes, bytes.
    fn intern(&mut self, raw: &RawState) -> (u32, usize) {
        let names = raw.names();
        let mut new = 0;
        let key = (names, raw.counts);
        let shape = match self.known.get(&key) {
            Some(shape) => *shape,
            None => {
                let shape = self.shapes.len() as u32;
                self.shapes.push(Shape { names: key.0.texts(), counts: raw.counts });
                new = 6 * key.0.len() + 200;
                self.known.insert(key.clone(), shape);
                shape
            }
        };
        self.last = Some((key.0, key.1, shape));
        (shape, new)
    }

    pub fn len(&self) -> usize {
        self.stamps.len()
    }

    pub fn shapes(&self) -> &[Shape] {
        &self.shapes
    }

    /// Message `i`; `None` if it cannot be decoded.
    pub fn get(&self, i: usize) -> Option<State<'_>> {
        let kind = self.shape_of[i] as usize;
        let shape = self.shapes.get(kind)?;
        let start = self.starts[i];
        let count: usize = shape.counts.iter().sum();
        Some(State { shape, kind, stamp: self.stamps[i], values: &self.values[start..start + count] })
    }

    /// Whether the messages are in order by their stamps.
    pub fn is_sorted(&self) -> bool {
        self.stamps.is_sorted()
    }

    /// Puts the messages into this order.
    pub fn reorder(&mut self, order: &[usize]) {
        self.shape_of = order.iter().map(|&i| self.shape_of[i]).collect();
        self.stamps = order.iter().map(|&i| self.stamps[i]).collect();
        self.starts = order.iter().map(|&i| self.starts[i]).collect();
    }
}

//! CDR, the serialisation format of ROS 2 messages ([DDS-XTypes], 7.4.1, plain CDR version 1).

use nalgebra::Vector3;

/// Little-endian CDR writer; alignment is relative to the end of the header.
#[derive(Default)]
pub(super) struct Writer(Vec<u8>);

impl Writer {
    fn align(&mut self, n: usize) {
        self.0.resize(self.0.len().next_multiple_of(n), 0);
    }

    pub fn u8(&mut self, v: u8) {
        self.0.push(v);
    }

    pub fn u32(&mut self, v: u32) {
        self.align(4);
        self.0.extend(v.to_le_bytes());
    }

    pub fn f64(&mut self, v: f64) {
        self.align(8);
        self.0.extend(v.to_le_bytes());
    }

    pub fn string(&mut self, s: &str) {
        self.u32(s.len() as u32 + 1);
        self.0.extend(s.as_bytes());
        self.0.push(0);
    }

    /// A sequence of strings.
    pub fn strings<S: AsRef<str>>(&mut self, names: &[S]) {
        self.u32(names.len() as u32);
        names.iter().for_each(|n| self.string(n.as_ref()));
    }

    /// A sequence of numbers.
    pub fn f64s(&mut self, v: &[f64]) {
        self.u32(v.len() as u32);
        v.iter().for_each(|x| self.f64(*x));
    }

    /// The complete message with its header.
    pub fn finish(self) -> Vec<u8> {
        [&[0, 1, 0, 0], &self.0[..]].concat()
    }
}

/// CDR reader for either byte order; every read past the end is `None`.
pub(super) struct Reader<'a> {
    data: &'a [u8],
    at: usize,
    little: bool,
}

impl<'a> Reader<'a> {
    /// Reader of data without header, in the byte order stated.
    pub fn bare(data: &'a [u8], little: bool) -> Self {
        Self { data, at: 0, little }
    }

    pub fn new(data: &'a [u8]) -> Option<Self> {
        let (header, data) = data.split_at_checked(4)?;
        let little = match header[..2] {
            [0, 0] => false,
            [0, 1] => true,
            _ => return None,
        };
        Some(Self { data, at: 0, little })
    }

    fn take(&mut self, n: usize, align: usize) -> Option<&'a [u8]> {
        let start = self.at.checked_next_multiple_of(align)?;
        let bytes = self.data.get(start..start.checked_add(n)?)?;
        self.at = start + n;
        Some(bytes)
    }

    pub fn u32(&mut self) -> Option<u32> {
        let bytes = self.take(4, 4)?.try_into().ok()?;
        Some(if self.little { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) })
    }

    pub fn f64(&mut self) -> Option<f64> {
        let bytes = self.take(8, 8)?.try_into().ok()?;
        Some(if self.little { f64::from_le_bytes(bytes) } else { f64::from_be_bytes(bytes) })
    }

    /// Three numbers, as in `geometry_msgs/Vector3`.
    pub fn vector(&mut self) -> Option<Vector3<f64>> {
        Some(Vector3::new(self.f64()?, self.f64()?, self.f64()?))
    }

    pub fn string(&mut self) -> Option<String> {
        let n = self.u32()? as usize;
        let bytes = self.take(n, 1)?;
        let text = bytes.strip_suffix(&[0]).unwrap_or(bytes);
        Some(String::from_utf8_lossy(text).into_owned())
    }

    /// The bytes of a sequence of strings, number included.
    pub fn raw_strings(&mut self) -> Option<&'a [u8]> {
        let start = self.at.checked_next_multiple_of(4)?;
        for _ in 0..self.u32()? {
            let n = self.u32()? as usize;
            self.take(n, 1)?;
        }
        self.data.get(start..self.at)
    }

    pub fn strings(&mut self) -> Option<Vec<String>> {
        (0..self.u32()?).map(|_| self.string()).collect()
    }

    /// Appends the numbers of a sequence to `out`, if they are wanted; returns how many there are.
    pub fn numbers(&mut self, out: Option<&mut Vec<f64>>) -> Option<usize> {
        let count = self.u32()? as usize;
        if count == 0 {
            return Some(0);
        }
        let bytes = self.take(count.checked_mul(8)?, 8)?;
        if let Some(out) = out {
            let (numbers, _) = bytes.as_chunks::<8>();
            let little = self.little;
            out.extend(numbers.iter().map(|&b| if little { f64::from_le_bytes(b) } else { f64::from_be_bytes(b) }));
        }
        Some(count)
    }

    pub fn f64s(&mut self) -> Option<Vec<f64>> {
        let mut out = Vec::new();
        self.numbers(Some(&mut out))?;
        Some(out)
    }

    pub fn is_little(&self) -> bool {
        self.little
    }
}

//! Series of a page as text: steps of sixteen bits, differences, byte planes, deflate, base64.

use std::io::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use deltatwin::identification::Dataset;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use serde_json::{Value, json};

/// Series at the same samples, in the order in which they were added.
pub struct Packed {
    kept: Vec<usize>,
    bytes: Vec<u8>,
}

impl Packed {
    /// No series yet; of every series the samples `kept` will be stored.
    pub fn new(kept: Vec<usize>) -> Self {
        Self { kept, bytes: Vec::new() }
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.kept.len()
    }

    /// The recording's indices of every `stride`-th sample.
    pub fn every(&self, stride: usize) -> Vec<usize> {
        self.kept.iter().step_by(stride).copied().collect()
    }

    /// Stores a series over the recording by [`Self::add_all`], at the samples of the page.
    pub fn add(&mut self, series: &[f64], step: f64, order: usize) -> Value {
        let own: Vec<f64> = self.kept.iter().map(|&k| series[k]).collect();
        self.add_all(&own, step, order)
    }

    /// Stores the differences of the given `order` of a series in steps of `step`; returns where it is.
    ///
    /// Differences are taken modulo 2¹⁶, so that summing restores every value that sixteen bits hold.
    pub fn add_all(&mut self, series: &[f64], step: f64, order: usize) -> Value {
        let quantised = |x: f64| (x / step).round().clamp(-32_767.0, 32_767.0) as i16;
        let mut values: Vec<i16> = series.iter().map(|x| quantised(*x)).collect();
        for _ in 0..order {
            for k in (1..values.len()).rev() {
                values[k] = values[k].wrapping_sub(values[k - 1]);
            }
        }
        let offset = self.bytes.len();
        for plane in 0..2 {
            self.bytes.extend(values.iter().map(|v| zigzag(*v).to_le_bytes()[plane]));
        }
        json!({"at": offset, "step": step, "order": order})
    }

    /// Stores the times in s of samples that are mostly `dt` apart, in 1/1000 of that; returns where they are.
    pub fn time(&mut self, t: &[f64], dt: f64) -> Value {
        let first = self.kept.first().map_or(0.0, |&k| t[k]);
        let last = self.kept.last().map_or(0.0, |&k| t[k]);
        let step = (1e-3 * dt).max((last - first) / 2e9).max(f64::MIN_POSITIVE);
        let mut values: Vec<i32> = self.kept.iter().map(|&k| ((t[k] - first) / step).round() as i32).collect();
        for _ in 0..2 {
            for k in (1..values.len()).rev() {
                values[k] = values[k].wrapping_sub(values[k - 1]);
            }
        }
        let offset = self.bytes.len();
        for plane in 0..4 {
            self.bytes.extend(values.iter().map(|v| v.to_le_bytes()[plane]));
        }
        json!({"at": offset, "step": step, "first": first})
    }

    /// Samples that begin a stretch after a gap.
    pub fn breaks(&self, dataset: &Dataset) -> Vec<usize> {
        let starts = dataset.segments.iter().skip(1).map(|s| self.kept.partition_point(|k| *k < s.start));
        starts.filter(|k| *k > 0 && *k < self.kept.len()).collect()
    }

    /// All series, compressed, as base64.
    pub fn text(&self) -> String {
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
        let written = encoder.write_all(&self.bytes).and_then(|()| encoder.finish());
        STANDARD.encode(written.expect("memory can be written"))
    }
}

/// Small numbers of either sign as small numbers.
fn zigzag(x: i16) -> u16 {
    ((x << 1) ^ (x >> 15)) as u16
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read as _;

    /// What `assets/page.js` does to get a series back.
    fn unpacked(text: &str, n: usize, place: &Value) -> Vec<f64> {
        let mut bytes = Vec::new();
        flate2::read::ZlibDecoder::new(&STANDARD.decode(text).unwrap()[..]).read_to_end(&mut bytes).unwrap();
        let at = place["at"].as_u64().unwrap() as usize;
        let value = |k: usize| {
            let z = u16::from_le_bytes([bytes[at + k], bytes[at + n + k]]);
            ((z >> 1) as i16) ^ -((z & 1) as i16)
        };
        let mut values: Vec<i16> = (0..n).map(value).collect();
        for _ in 0..place["order"].as_u64().unwrap() {
            for k in 1..n {
                values[k] = values[k].wrapping_add(values[k - 1]);
            }
        }
        values.iter().map(|v| f64::from(*v) * place["step"].as_f64().unwrap()).collect()
    }

    #[test]
    fn a_series_comes_back_to_half_a_step() {
        let series: Vec<f64> = (0..500).map(|k| 30.0 * (0.05 * f64::from(k)).sin() + f64::from(k % 7)).collect();
        let mut packed = Packed::new((0..series.len()).collect());
        for order in 0..3 {
            packed.add(&series, 0.01, order);
        }
        let last = packed.add(&[vec![-327.67; 250], vec![327.67; 250]].concat(), 0.01, 2);
        let text = packed.text();
        for order in 0..3_u64 {
            let place = json!({"at": order * 1000, "step": 0.01, "order": order});
            let back = unpacked(&text, series.len(), &place);
            assert!(back.iter().zip(&series).all(|(a, b)| (a - b).abs() < 0.0051), "{order}");
        }
        let ends = unpacked(&text, series.len(), &last);
        assert!((ends[0] + 327.67).abs() < 1e-9 && (ends[499] - 327.67).abs() < 1e-9);
    }
}

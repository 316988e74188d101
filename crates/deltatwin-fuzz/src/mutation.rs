//! Mutations of files: of their numbers, lines and bytes.

use rand::RngExt;
use rand::seq::IndexedRandom;
use rand_chacha::ChaCha8Rng;

/// Numbers at the edges of what a number may be.
const NUMBERS: [&str; 30] = [
    "0",
    "-0.0",
    "1",
    "-1",
    "0.5",
    "1e-300",
    "5e-324",
    "1e-9",
    "1e-3",
    "1e3",
    "1e9",
    "1e18",
    "1e300",
    "1.8e308",
    "-1e308",
    "nan",
    "inf",
    "-inf",
    "9223372036854775807",
    "-9223372036854775808",
    "4294967296",
    "65536",
    "true",
    "\"\"",
    "[]",
    "{}",
    "[1, 2]",
    "\"\\u001b[2J\"",
    "1e-12",
    "100000",
];

/// A mutated copy of `seed`, with parts of `other`.
pub fn mutated(seed: &[u8], other: &[u8], random: &mut ChaCha8Rng) -> Vec<u8> {
    let mut out = seed.to_vec();
    for _ in 0..random.random_range(1..=4) {
        let is_text = std::str::from_utf8(&out).is_ok();
        match random.random_range(0..if is_text { 10 } else { 5 }) {
            0 => flip(&mut out, random),
            1 => cut(&mut out, random),
            2 => splice(&mut out, other, random),
            3 => zero(&mut out, random),
            4 => length(&mut out, random),
            5..=7 => number(&mut out, random),
            _ => lines(&mut out, other, random),
        }
    }
    out
}

/// A copy of `seed` with one number of a text somewhat changed, or one bit of anything else.
pub fn nudged(seed: &[u8], random: &mut ChaCha8Rng) -> Vec<u8> {
    let mut out = seed.to_vec();
    if std::str::from_utf8(&out).is_err() {
        flip(&mut out, random);
        return out;
    }
    let Some((start, end)) = a_number(&out, random) else { return out };
    let old = std::str::from_utf8(&out[start..end]).ok().and_then(|text| text.parse::<f64>().ok());
    let new = old.map_or(String::new(), |old| (old * random.random_range(0.5..2.0)).to_string());
    out.splice(start..end, new.into_bytes());
    out
}

fn place(length: usize, random: &mut ChaCha8Rng) -> usize {
    if length == 0 { 0 } else { random.random_range(0..length) }
}

/// Changes a few bits.
fn flip(bytes: &mut [u8], random: &mut ChaCha8Rng) {
    for _ in 0..random.random_range(1..=3) {
        let at = place(bytes.len(), random);
        if let Some(byte) = bytes.get_mut(at) {
            *byte ^= 1 << random.random_range(0..8);
        }
    }
}

/// Removes a stretch, or the end.
fn cut(bytes: &mut Vec<u8>, random: &mut ChaCha8Rng) {
    let at = place(bytes.len(), random);
    let end = if random.random_bool(0.3) { bytes.len() } else { (at + random.random_range(1..200)).min(bytes.len()) };
    bytes.drain(at..end);
}

/// Inserts a stretch of another file, or of the same one.
fn splice(bytes: &mut Vec<u8>, other: &[u8], random: &mut ChaCha8Rng) {
    let from = if random.random_bool(0.5) { other.to_vec() } else { bytes.clone() };
    let start = place(from.len(), random);
    let end = (start + random.random_range(1..400)).min(from.len());
    let at = place(bytes.len(), random);
    let count = if random.random_bool(0.05) { 500 } else { 1 };
    let piece = from[start..end].repeat(count);
    bytes.splice(at..at, piece);
}

/// Overwrites a stretch as a bad sector does.
fn zero(bytes: &mut [u8], random: &mut ChaCha8Rng) {
    let at = place(bytes.len(), random);
    let end = (at + random.random_range(1..600)).min(bytes.len());
    let value = *[0, 0xff, b'9', b'['].choose(random).unwrap_or(&0);
    bytes[at..end].fill(value);
}

/// Overwrites what may be a length or a count.
fn length(bytes: &mut [u8], random: &mut ChaCha8Rng) {
    let at = place(bytes.len(), random);
    let value: u64 = *[0, 1, 0xff, 0xffff, 1 << 20, 1 << 31, u64::from(u32::MAX), 1 << 40, u64::MAX - 8, u64::MAX]
        .choose(random)
        .unwrap_or(&0);
    let width = if random.random_bool(0.5) { 4 } else { 8 };
    for (byte, new) in bytes.iter_mut().skip(at).zip(value.to_le_bytes()).take(width) {
        *byte = new;
    }
}

/// Where a random number of a text begins and ends.
fn a_number(bytes: &[u8], random: &mut ChaCha8Rng) -> Option<(usize, usize)> {
    let is_part = |b: &u8| b.is_ascii_digit() || b"+-.eE_".contains(b);
    let starts: Vec<usize> = (0..bytes.len())
        .filter(|&i| {
            bytes[i].is_ascii_digit() && (i == 0 || !bytes[i - 1].is_ascii_alphanumeric() && !is_part(&bytes[i - 1]))
        })
        .collect();
    let start = *starts.choose(random)?;
    Some((start, start + bytes[start..].iter().take_while(|b| is_part(b)).count()))
}

/// Replaces a number.
fn number(bytes: &mut Vec<u8>, random: &mut ChaCha8Rng) {
    let Some((start, end)) = a_number(bytes, random) else { return };
    let new = match random.random_range(0..4) {
        0 => format!("{:e}", 10f64.powi(random.random_range(-30..30)) * random.random_range(-1.0..1.0)),
        _ => NUMBERS.choose(random).map_or(String::new(), |text| text.to_string()),
    };
    bytes.splice(start..end, new.into_bytes());
}

/// Removes, repeats, exchanges or inserts lines.
fn lines(bytes: &mut Vec<u8>, other: &[u8], random: &mut ChaCha8Rng) {
    let mut own: Vec<Vec<u8>> = bytes.split(|b| *b == b'\n').map(<[u8]>::to_vec).collect();
    let (a, b) = (place(own.len(), random), place(own.len(), random));
    match random.random_range(0..5) {
        0 => drop(own.remove(a)),
        1 => own.insert(a, own[b].clone()),
        2 => own.swap(a, b),
        3 => {
            let count = *[2, 50, 2_000].choose(random).unwrap_or(&2);
            let line = own[a].clone();
            own.splice(a..a, std::iter::repeat_n(line, count));
        }
        _ => {
            let lines: Vec<&[u8]> = other.split(|b| *b == b'\n').collect();
            if let Some(line) = lines.choose(random) {
                own.insert(a, line.to_vec());
            }
        }
    }
    *bytes = own.join(&b'\n');
}

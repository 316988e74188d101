//! Digest of a study, and the random numbers that follow from it.

use std::fmt;

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use sha2::{Digest as _, Sha256};

/// SHA-256 of everything that determines the rows of a study.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Digest([u8; 32]);

impl Digest {
    /// Digest of named contents; it depends on their order and names, and on no boundary that could be shifted.
    pub fn of<'a>(contents: impl IntoIterator<Item = (&'a str, &'a [u8])>) -> Self {
        let mut hash = Sha256::new();
        for (name, content) in contents {
            for bytes in [name.as_bytes(), content] {
                hash.update((bytes.len() as u64).to_le_bytes());
                hash.update(bytes);
            }
        }
        Self(hash.finalize().into())
    }

    /// The digest with 64 hexadecimal digits.
    pub fn hex(&self) -> String {
        self.0.iter().map(|b| format!("{b:02x}")).collect()
    }
}

impl fmt::Debug for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.hex())
    }
}

/// Random numbers of a study: a pure function of (digest, seed, run, dimension).
///
/// Each dimension is a stream of ChaCha with 8 rounds, each run a position in it, so that a number costs the same
/// wherever it is in the stream.
#[derive(Clone, Debug)]
pub struct Draws {
    rng: ChaCha8Rng,
    key: [u8; 32],
}

/// Streams above all dimensions of a study.
const SEEDS: u64 = u64::MAX;
const KEYS: u64 = u64::MAX - 1;
/// Largest seed of a run; all integers up to here are exact in any reader of tables.
const LARGEST_SEED: u64 = (1 << 53) - 1;

impl Draws {
    /// Random numbers of the study with this digest and seed.
    pub fn new(digest: &Digest, seed: u64) -> Self {
        let key = Digest::of([("digest", &digest.0[..]), ("seed", &seed.to_le_bytes())]).0;
        Self { rng: ChaCha8Rng::from_seed(key), key }
    }

    fn bits(&self, stream: u64, position: u64) -> u64 {
        let mut rng = self.rng.clone();
        rng.set_stream(stream);
        rng.set_word_pos(2 * u128::from(position));
        rng.next_u64()
    }

    /// A number between 0 and 1, both excluded, uniformly distributed on a grid of 2⁻⁵³.
    pub fn uniform(&self, run: u64, dimension: usize) -> f64 {
        unit(self.bits(dimension as u64, run))
    }

    /// Seed of the scenario of a run, at most 2⁵³ − 1.
    pub fn seed(&self, run: u64) -> u64 {
        self.bits(SEEDS, run) & LARGEST_SEED
    }

    /// A key for scrambling or permuting one dimension.
    pub fn key(&self, dimension: usize) -> u64 {
        self.bits(KEYS, dimension as u64)
    }

    /// The generator of a purpose, independent of all numbers above.
    pub fn generator(&self, purpose: &str) -> ChaCha8Rng {
        ChaCha8Rng::from_seed(Digest::of([("key", &self.key[..]), ("purpose", purpose.as_bytes())]).0)
    }
}

/// The middle of the cell of width 2⁻⁵³ that the upper 53 bits select.
pub(crate) fn unit(bits: u64) -> f64 {
    // The sum is exact, except in the last cell, where it would be rounded to 1.
    (((bits >> 11) as f64 + 0.5) / (1u64 << 53) as f64).min(1.0 - f64::EPSILON / 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digests_are_those_of_sha_256() {
        // SHA-256 of sixteen zero bytes (two empty contents), computed by coreutils' sha256sum.
        let expected = "374708fff7719dd5979ec875d56cd2286f6d3cf7ec317a3b25632aab28ec37bb";
        assert_eq!(Digest::of([("", &b""[..])]).hex(), expected);
        let [a, b] = [("ab", &b"c"[..]), ("a", &b"bc"[..])].map(|content| Digest::of([content]));
        assert_ne!(a, b);
    }

    #[test]
    fn numbers_follow_from_their_place_alone() {
        let digest = Digest::of([("study", &b"x"[..])]);
        let draws = Draws::new(&digest, 1);
        let forwards: Vec<f64> = (0..100).map(|i| draws.uniform(i, 3)).collect();
        let backwards: Vec<f64> = (0..100).rev().map(|i| Draws::new(&digest, 1).uniform(i, 3)).collect();
        assert!(forwards.iter().eq(backwards.iter().rev()));
        assert_ne!(draws.uniform(0, 3), draws.uniform(0, 4));
        assert_ne!(draws.uniform(0, 3), Draws::new(&digest, 2).uniform(0, 3));
        assert!((0..1000).all(|i| draws.seed(i) <= LARGEST_SEED));
    }

    #[test]
    fn numbers_are_uniform_and_independent() {
        let draws = Draws::new(&Digest::of([]), 7);
        let n = 20_000;
        let all: Vec<[f64; 2]> = (0..n).map(|i| [0, 1].map(|d| draws.uniform(i, d))).collect();
        let mean = |f: &dyn Fn(&[f64; 2]) -> f64| all.iter().map(f).sum::<f64>() / n as f64;
        // Standard errors: 1/√(12 n) = 0.002, of the product of the centred numbers 1/(12 √n) = 0.0006.
        assert!((mean(&|u| u[0]) - 0.5).abs() < 0.008 && (mean(&|u| u[0] * u[0]) - 1.0 / 3.0).abs() < 0.009);
        assert!(mean(&|u| (u[0] - 0.5) * (u[1] - 0.5)).abs() < 0.0025);
        assert!(unit(u64::MAX) < 1.0 && unit(0) > 0.0);
    }
}

//! Ball sockets of a run: hold forces, wear, missing springs, and whether sockets may dislocate.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, Normal};

use crate::kinematics::motion::SOCKETS;

/// Number of clamp spring units, one per pair of sockets: limbs 1–3 upper (elbow), then limbs 1–3 lower (platform).
pub const SPRINGS: usize = SOCKETS / 2;

/// Stream of the random generator for the hold forces; the sensor noise uses stream 0.
const STREAM: u64 = 1;

/// State of the ball sockets; 0..6 at the elbows (struts 1–6), 6..12 at the platform.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SocketSetup {
    /// Whether a socket dislocates when the lateral reaction exceeds its hold force; otherwise margins are only
    /// reported.
    pub armed: bool,
    /// Hold force of each socket, N, in place of the model's.
    pub hold: Option<[f64; SOCKETS]>,
    /// Fraction of the hold force lost by each socket, 0 to 1.
    pub wear: [f64; SOCKETS],
    /// Number of missing springs, of the two in each unit, see [`spring_name`].
    pub missing: [u8; SPRINGS],
    /// Standard deviation of the hold forces about the model's, N; drawn with the scenario's seed.
    pub sigma: Option<f64>,
}

impl SocketSetup {
    /// Dislocation force of each socket, N, never negative; `healthy` is the model's value and `seed` the scenario's.
    ///
    /// It is the lateral force at zero load along the cup's opening, and proportional to the clamp force: a unit with
    /// one of its two springs missing holds half. Wear of the cup's rim and scatter do not change the clamp force.
    pub fn holds(&self, healthy: f64, seed: u64) -> [f64; SOCKETS] {
        let mut holds = self.hold.unwrap_or([healthy; SOCKETS]);
        if let Some(normal) = self.sigma.and_then(|sigma| Normal::new(0.0, sigma).ok()) {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream(STREAM);
            for hold in &mut holds {
                *hold += normal.sample(&mut rng);
            }
        }
        std::array::from_fn(|s| (holds[s] * self.springs(s) * (1.0 - self.wear[s])).max(0.0))
    }

    /// Force that presses each cup on its ball, N; `healthy` is the model's value.
    pub fn preloads(&self, healthy: f64) -> [f64; SOCKETS] {
        std::array::from_fn(|s| healthy * self.springs(s))
    }

    /// Fraction of the springs remaining at a socket.
    fn springs(&self, socket: usize) -> f64 {
        1.0 - 0.5 * f64::from(self.missing[spring(socket)].min(2))
    }
}

/// Index of the spring unit at `socket`.
pub fn spring(socket: usize) -> usize {
    socket / 2
}

/// Name of a spring unit: `limb1_upper` … `limb3_upper`, `limb1_lower` … `limb3_lower`.
pub fn spring_name(spring: usize) -> String {
    let limbs = SPRINGS / 2;
    format!("limb{}_{}", spring % limbs + 1, if spring < limbs { "upper" } else { "lower" })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn wear_and_missing_springs_weaken_their_own_sockets() {
        assert_eq!(SocketSetup::default().holds(200.0, 7), [200.0; SOCKETS]);
        let mut sockets = SocketSetup::default();
        sockets.wear[3] = 0.25;
        sockets.missing[4] = 1;
        sockets.missing[5] = 2;
        let mut expected = [200.0; SOCKETS];
        expected[3] = 150.0;
        (expected[8], expected[9]) = (100.0, 100.0);
        (expected[10], expected[11]) = (0.0, 0.0);
        assert_eq!(sockets.holds(200.0, 7), expected);
        // Wear does not change the preload.
        expected[3] = 200.0;
        assert_eq!(sockets.preloads(200.0), expected);
        assert_eq!(spring_name(4), "limb2_lower");
        // Both sockets of a unit are on the same limb and end.
        for s in 0..SOCKETS {
            let name = spring_name(spring(s));
            let strut = s % crate::machine::STRUTS;
            let end = if s < 6 { "upper" } else { "lower" };
            assert_eq!(name, format!("limb{}_{end}", strut / 2 + 1));
        }
    }

    #[test]
    fn draws_scatter_about_the_model_and_follow_the_seed() {
        let sockets = SocketSetup { sigma: Some(10.0), ..SocketSetup::default() };
        let all: Vec<f64> = (0..200).flat_map(|seed| sockets.holds(200.0, seed)).collect();
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        let sigma = (all.iter().map(|h| (h - mean).powi(2)).sum::<f64>() / all.len() as f64).sqrt();
        assert!((mean - 200.0).abs() < 1.0 && (sigma - 10.0).abs() < 0.7, "{mean} {sigma}");
        assert_eq!(sockets.holds(200.0, 3), sockets.holds(200.0, 3));
        assert_ne!(sockets.holds(200.0, 3), sockets.holds(200.0, 4));
    }

    proptest! {
        #[test]
        fn holds_are_never_negative(
            wear in prop::array::uniform12(0.0..=1.0f64),
            sigma in prop::option::of(0.0..1e3f64),
            missing in prop::array::uniform6(0u8..3),
            seed in any::<u64>(),
        ) {
            let sockets = SocketSetup { wear, sigma, missing, ..SocketSetup::default() };
            for (s, hold) in sockets.holds(200.0, seed).iter().enumerate() {
                prop_assert!(*hold >= 0.0 && hold.is_finite() && (missing[s / 2] < 2 || *hold == 0.0));
            }
        }
    }
}

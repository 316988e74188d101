//! Ball sockets of a run: hold forces, wear, missing springs, and whether sockets may dislocate.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, Normal};

use crate::machine::{Mechanism, PerSocket, each, every_limb, limbs_from};

/// Most clamp spring units, one per pair of sockets: those at the elbows limb by limb, then those at the plate in
/// the same order.
pub const MAX_SPRINGS: usize = limbs_from(LOWER).end;
/// First spring unit at the plate.
const LOWER: usize = every_limb().end;

/// Stream of the random generator for the hold forces; the sensor noise uses stream 0.
const STREAM: u64 = 1;

/// State of the ball sockets: one per strut at the elbows, then one per strut at the plate.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SocketSetup {
    /// Whether a socket dislocates when the lateral reaction exceeds its hold force; otherwise margins are only
    /// reported.
    pub armed: bool,
    /// Hold force of each socket, N, in place of the model's.
    pub hold: Option<PerSocket<f64>>,
    /// Fraction of the hold force lost by each socket, 0 to 1.
    pub wear: PerSocket<f64>,
    /// Number of sockets for which the arrays `hold` or `wear` are meant; 0 if neither is given.
    pub given: usize,
    /// Number of missing springs, of the two in each unit, see [`spring_name`].
    pub missing: [u8; MAX_SPRINGS],
    /// Standard deviation of the hold forces about the model's, N; drawn with the scenario's seed.
    pub sigma: Option<f64>,
}

impl SocketSetup {
    /// Dislocation force of each socket, N, never negative; `healthy` is the model's value and `seed` the scenario's.
    ///
    /// It is the lateral force at zero load along the cup's opening, and proportional to the clamp force: a unit with
    /// one of its two springs missing holds half. Wear of the cup's rim and scatter do not change the clamp force.
    pub fn holds(&self, healthy: f64, seed: u64, machine: Mechanism) -> PerSocket<f64> {
        let mut holds = self.hold.unwrap_or(each(healthy));
        if let Some(normal) = self.sigma.and_then(|sigma| Normal::new(0.0, sigma).ok()) {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream(STREAM);
            for hold in &mut holds {
                *hold += normal.sample(&mut rng);
            }
        }
        std::array::from_fn(|s| (holds[s] * self.springs(s, machine) * (1.0 - self.wear[s])).max(0.0))
    }

    /// Force that presses each cup on its ball, N; `healthy` is the model's value.
    pub fn preloads(&self, healthy: f64, machine: Mechanism) -> PerSocket<f64> {
        std::array::from_fn(|s| healthy * self.springs(s, machine))
    }

    /// Fraction of the springs remaining at a socket.
    fn springs(&self, socket: usize, machine: Mechanism) -> f64 {
        1.0 - 0.5 * f64::from(self.missing[spring(socket, machine)].min(2))
    }

    /// Why these sockets are not those of `machine`.
    pub fn misfit(&self, machine: Mechanism) -> Option<String> {
        let (sockets, limbs) = (2 * machine.struts(), machine.limbs());
        if ![0, sockets].contains(&self.given) {
            return Some(format!("`sockets` states {} sockets; expected {sockets}, two per strut", self.given));
        }
        let absent = (0..MAX_SPRINGS).find(|&s| self.missing[s] > 0 && s % LOWER >= limbs)?;
        Some(format!("`sockets.missing_springs` has {}; the robot has {limbs} limbs", spring_name(absent)))
    }
}

/// Index of the spring unit at `socket` of `machine`.
pub fn spring(socket: usize, machine: Mechanism) -> usize {
    let pairs = machine.limbs();
    let (end, limb) = if socket / 2 < pairs { (0, socket / 2) } else { (1, socket / 2 - pairs) };
    end * LOWER + limb.min(LOWER - 1)
}

/// Name of a spring unit: `limb1_upper` … at the elbows, then `limb1_lower` … at the plate.
pub fn spring_name(spring: usize) -> String {
    format!("limb{}_{}", spring % LOWER + 1, if spring < LOWER { "upper" } else { "lower" })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const DELTA: Mechanism = Mechanism::delta(true);

    #[test]
    fn wear_and_missing_springs_weaken_their_own_sockets() {
        assert_eq!(SocketSetup::default().holds(200.0, 7, DELTA), each(200.0));
        let mut sockets = SocketSetup::default();
        sockets.wear[3] = 0.25;
        sockets.missing[LOWER + 1] = 1;
        sockets.missing[LOWER + 2] = 2;
        let mut expected: PerSocket<f64> = each(200.0);
        expected[3] = 150.0;
        (expected[8], expected[9]) = (100.0, 100.0);
        (expected[10], expected[11]) = (0.0, 0.0);
        assert_eq!(sockets.holds(200.0, 7, DELTA), expected);
        // Wear does not change the preload.
        expected[3] = 200.0;
        assert_eq!(sockets.preloads(200.0, DELTA), expected);
        assert_eq!(spring_name(LOWER + 1), "limb2_lower");
        // Both sockets of a unit are on the same limb and end.
        for s in 0..12 {
            let name = spring_name(spring(s, DELTA));
            let strut = s % 6;
            let end = if s < 6 { "upper" } else { "lower" };
            assert_eq!(name, format!("limb{}_{end}", strut / 2 + 1));
        }
    }

    #[test]
    fn draws_scatter_about_the_model_and_follow_the_seed() {
        let sockets = SocketSetup { sigma: Some(10.0), ..SocketSetup::default() };
        let all: Vec<f64> = (0..200).flat_map(|seed| sockets.holds(200.0, seed, DELTA)).collect();
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        let sigma = (all.iter().map(|h| (h - mean).powi(2)).sum::<f64>() / all.len() as f64).sqrt();
        assert!((mean - 200.0).abs() < 1.0 && (sigma - 10.0).abs() < 0.7, "{mean} {sigma}");
        assert_eq!(sockets.holds(200.0, 3, DELTA), sockets.holds(200.0, 3, DELTA));
        assert_ne!(sockets.holds(200.0, 3, DELTA), sockets.holds(200.0, 4, DELTA));
    }

    proptest! {
        #[test]
        fn holds_are_never_negative(
            wear in prop::array::uniform16(0.0..=1.0f64),
            sigma in prop::option::of(0.0..1e3f64),
            missing in prop::array::uniform8(0u8..3),
            seed in any::<u64>(),
        ) {
            let sockets = SocketSetup { wear, sigma, missing, ..SocketSetup::default() };
            for (s, hold) in sockets.holds(200.0, seed, DELTA).iter().enumerate() {
                prop_assert!(*hold >= 0.0 && hold.is_finite() && (missing[spring(s, DELTA)] < 2 || *hold == 0.0));
            }
        }
    }
}

//! Plan of an exam: its campaigns.

use std::sync::Arc;

use super::campaign::Case;
use super::motion::MotionKind;
use super::noise::Noise;
use super::outside::Outside;
use super::size::Size;
use deltatwin::effects::{self, ActiveEffect, Effect};
use deltatwin::machine::Payload;

/// Plan of an exam.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Hidden effects, one at a time and in pairs.
    pub effects: Vec<String>,
    /// Sizes of single effects.
    pub sizes: Vec<Size>,
    /// Number of campaigns per effect and size.
    pub seeds: u64,
    /// Number of campaigns with two effects.
    pub pairs: u64,
    /// Number of campaigns with a law outside the library.
    pub outside: u64,
    /// Number of campaigns without a hidden effect.
    pub null: u64,
    /// Kinds of noise, used in turn.
    pub noise: Vec<Noise>,
    /// Kind of motion.
    pub motion: MotionKind,
    /// Whether two thirds of the robots have a force sensor in strut 1.
    pub strut_sensors: bool,
    /// Whether half of the robots have a payload.
    pub payloads: bool,
    /// Duration of each recording, s.
    pub duration: f64,
    /// Seed of the entire exam.
    pub seed: u64,
}

impl Plan {
    /// The campaigns with the names of their folders. The seed of a campaign depends on its name and the seed of the
    /// plan only, so adding campaigns does not change existing ones.
    ///
    /// # Panics
    /// If `noise` is empty.
    pub fn cases(&self) -> Vec<(String, Case)> {
        let mut out = Vec::new();
        for k in 1..=self.null {
            self.add(&mut out, NOTHING, Vec::new(), Size::Medium, k);
        }
        for size in &self.sizes {
            for name in &self.effects {
                for k in 1..=self.seeds {
                    self.add(&mut out, &format!("{name}-{size}"), vec![name.clone()], *size, k);
                }
            }
        }
        for k in 1..=self.pairs {
            let pair = self.pair(k);
            if pair.len() == 2 {
                self.add(&mut out, &pair.join("+"), pair, Size::Medium, k);
            }
        }
        let laws = Outside::all();
        for k in 1..=self.outside {
            let law = laws[(k - 1) as usize % laws.len()];
            self.add(&mut out, &format!("outside-{}", law.name), Vec::new(), Size::Medium, k);
            out.last_mut().expect("just added").1.outside = Some(law);
        }
        out
    }

    /// Every effect in turn, with a varying partner.
    fn pair(&self, k: u64) -> Vec<String> {
        let n = self.effects.len() as u64;
        if n < 2 {
            return Vec::new();
        }
        let first = (k - 1) % n;
        let second = (first + 1 + seed(self.seed, &format!("pair {k}")) % (n - 1)) % n;
        [first, second].map(|i| self.effects[i as usize].clone()).into()
    }

    fn add(&self, out: &mut Vec<(String, Case)>, label: &str, effects: Vec<String>, size: Size, k: u64) {
        let noise = self.noise[out.len() % self.noise.len()];
        let mut name = format!("{label}-{noise}");
        for (unusual, word) in [
            (self.motion != MotionKind::default(), self.motion.name()),
            (!self.strut_sensors, "torques"),
            (!self.payloads, "empty"),
        ] {
            if unusual {
                name += &format!("-{word}");
            }
        }
        name += &format!("-{k}");
        let seed = seed(self.seed, &name);
        let of_payload = effects.iter().any(|name| effects::find(name).is_some_and(reads_payload));
        let case = Case {
            seed,
            strut_sensor: self.strut_sensors && !(seed >> 17).is_multiple_of(3),
            payload: self.payloads && (of_payload || (seed >> 23).is_multiple_of(2)),
            effects,
            outside: None,
            size,
            scale: 1.0,
            noise,
            motion: self.motion,
            duration: self.duration,
        };
        out.push((name, case));
    }
}

/// Whether an effect's wrenches or its inertia depend on the payload, so that it appears only on a robot with one.
fn reads_payload(effect: Arc<dyn Effect>) -> bool {
    let active = ActiveEffect::absent(Arc::clone(&effect));
    let terms = |payload: &Payload| {
        let mut terms = Vec::new();
        effect.inertia(&active.values(), payload, &mut |k, body, inertia| terms.push((k, body, inertia)));
        terms
    };
    effect.spec().reads.payload || terms(&Payload::default()) != terms(&Payload::new(1.0, [0.1, 0.1, -0.1], 0.01))
}

/// Label of campaigns without a hidden effect.
pub const NOTHING: &str = "nothing";

/// Seed of a campaign from the exam's seed and the campaign's name (FNV-1a).
pub fn seed(exam: u64, name: &str) -> u64 {
    let bytes = exam.to_le_bytes().into_iter().chain(name.bytes());
    bytes.fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan() -> Plan {
        Plan {
            effects: ["torque_bias", "air_drag", "payload_mass_error"].map(String::from).into(),
            sizes: vec![Size::Small, Size::Large],
            seeds: 2,
            pairs: 7,
            outside: 2,
            null: 3,
            noise: Noise::ALL.into(),
            motion: MotionKind::Wideband,
            strut_sensors: true,
            payloads: true,
            duration: 20.0,
            seed: 1,
        }
    }

    #[test]
    fn every_campaign_is_another_and_follows_from_its_name() {
        let cases = plan().cases();
        assert_eq!(cases.len(), 3 + 2 * 3 * 2 + 7 + 2);
        let mut names: Vec<&String> = cases.iter().map(|(n, _)| n).collect();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), cases.len());
        // Without null campaigns the kinds of noise are assigned differently; campaigns with the same name keep their
        // seed.
        let fewer = Plan { null: 0, noise: vec![Noise::White], ..plan() }.cases();
        let shared = cases.iter().filter(|c| fewer.contains(c)).count();
        assert!(shared > 0, "{fewer:?}");
        let other = Plan { seed: 2, ..plan() }.cases();
        // The pairs differ as well.
        assert!(cases.iter().zip(&other).all(|((a, x), (b, y))| x.seed != y.seed && (a == b || a.contains('+'))));
    }

    #[test]
    fn pairs_are_of_two_effects_and_payload_errors_have_a_payload() {
        for (name, case) in plan().cases() {
            let mut effects = case.effects.clone();
            effects.dedup();
            assert_eq!(effects.len(), case.effects.len(), "{name}");
            assert!(case.payload || !case.effects.iter().any(|e| e == "payload_mass_error"), "{name}");
        }
        for (name, expected) in [("payload_compliance", true), ("payload_com_offset", true), ("air_drag", false)] {
            assert_eq!(effects::find(name).map(reads_payload), Some(expected), "{name}");
        }
        // Half of the others.
        assert!(plan().cases().iter().any(|(_, case)| !case.payload && !case.effects.is_empty()));
        let lone = Plan { effects: vec!["torque_bias".into()], ..plan() };
        assert_eq!(lone.cases().len(), 3 + 2 * 2 + 2);
    }
}

//! Which campaigns an exam consists of.

use std::sync::Arc;

use super::campaign::Case;
use super::motion::MotionKind;
use super::noise::Noise;
use super::outside::Outside;
use super::size::Size;
use deltatwin::effects::{self, ActiveEffect, Effect};
use deltatwin::machine::Payload;

/// What to examine.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Effects to hide, one at a time and in pairs.
    pub effects: Vec<String>,
    /// Sizes of single effects.
    pub sizes: Vec<Size>,
    /// Campaigns per effect and size.
    pub seeds: u64,
    /// Campaigns with two effects.
    pub pairs: u64,
    /// Campaigns with a law outside the library.
    pub outside: u64,
    /// Campaigns in which nothing is hidden.
    pub null: u64,
    /// Kinds of noise, in turn.
    pub noise: Vec<Noise>,
    /// What the robots do.
    pub motion: MotionKind,
    /// Whether robots may have a force sensor in strut 1: two thirds do.
    pub strut_sensors: bool,
    /// Whether robots may have a payload: half do.
    pub payloads: bool,
    /// Length of each recording, s.
    pub duration: f64,
    /// Seed of everything.
    pub seed: u64,
}

impl Plan {
    /// The campaigns with the names of their folders. A campaign follows from its name and the seed of the plan alone, so
    /// that others may be added without changing it.
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

    /// Every effect takes its turn, with ever another partner.
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
            noise,
            motion: self.motion,
            duration: self.duration,
        };
        out.push((name, case));
    }
}

/// Whether an effect's inertia depends on the payload, so that it shows on a robot that carries one.
fn reads_payload(effect: Arc<dyn Effect>) -> bool {
    let active = ActiveEffect::absent(Arc::clone(&effect));
    let terms = |payload: &Payload| {
        let mut terms = Vec::new();
        effect.inertia(&active.values(), payload, &mut |k, body, inertia| terms.push((k, body, inertia)));
        terms
    };
    terms(&Payload::default()) != terms(&Payload::new(1.0, [0.1, 0.1, -0.1], 0.01))
}

/// Label of campaigns in which nothing is hidden.
pub const NOTHING: &str = "nothing";

/// Seed of a campaign from that of the exam and its name (FNV-1a).
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
        // Without null campaigns the noise takes other turns; what keeps its name keeps its seed.
        let fewer = Plan { null: 0, noise: vec![Noise::White], ..plan() }.cases();
        let shared = cases.iter().filter(|c| fewer.contains(c)).count();
        assert!(shared > 0, "{fewer:?}");
        let other = Plan { seed: 2, ..plan() }.cases();
        // Pairs are others, too.
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
        // Of others half.
        assert!(plan().cases().iter().any(|(_, case)| !case.payload && !case.effects.is_empty()));
        let lone = Plan { effects: vec!["torque_bias".into()], ..plan() };
        assert_eq!(lone.cases().len(), 3 + 2 * 2 + 2);
    }
}

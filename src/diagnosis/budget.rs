//! Error budget: the shares of noise, of each added effect, and of the unexplained rest.

use crate::identification::{Estimate, Fit};
use crate::machine::Mechanism;
use crate::model::history::{Added, rounded};
use crate::recording::Channel;

/// Sequence of added effects with the residuals before and after each.
#[derive(Clone, Debug)]
pub struct Budget {
    /// Kind of machine.
    pub mechanism: Mechanism,
    /// Channels of the arrays.
    pub channels: Vec<Channel>,
    /// RMS residual without any of the effects, N·m or N.
    pub rms_before: Vec<f64>,
    /// Standard deviation of the sensor noise, N·m or N.
    pub noise_floor: Vec<f64>,
    /// The effects in the order they were added, with the RMS residual (N·m or N) after each.
    pub effects: Vec<(String, Vec<f64>)>,
    /// Whether the residuals are those of held-out data.
    pub held_out: bool,
}

/// Shares of a channel's mean square residual before anything was added. They add up to one; an effect's share is
/// negative where adding it increased the residual.
#[derive(Clone, Debug)]
pub struct Shares {
    /// Share of the noise, at most what is left: the noise floor is an estimate.
    pub noise: f64,
    /// Share of each effect.
    pub effects: Vec<f64>,
    /// Share of the unexplained rest.
    pub unexplained: f64,
}

impl Budget {
    /// Shares of channel `c`.
    pub fn shares(&self, c: usize) -> Shares {
        let whole = self.rms_before[c].powi(2).max(f64::MIN_POSITIVE);
        let share = |square: f64| square / whole;
        let mut now = self.rms_before[c];
        let effects = self.effects.iter().map(|(_, after)| {
            let fell = share(now.powi(2) - after[c].powi(2));
            now = after[c];
            fell
        });
        let effects: Vec<f64> = effects.collect();
        let left = share(now.powi(2));
        let noise = share(self.noise_floor[c].powi(2)).min(left);
        Shares { noise, unexplained: left - noise, effects }
    }

    /// RMS residual with all effects, N·m or N.
    pub fn rms_after(&self) -> &[f64] {
        self.effects.last().map_or(&self.rms_before, |(_, after)| after)
    }

    /// The sequence in the form of a model file's history.
    pub fn history(&self) -> Vec<Added> {
        let numbers = |rms: &[f64]| rms.iter().map(|x| rounded(*x)).collect::<Vec<f64>>();
        let mut before = &self.rms_before;
        let step = |(effect, after): &'_ (String, Vec<f64>), before: &[f64]| Added {
            effect: effect.clone(),
            channels: self.channels.iter().map(Channel::to_string).collect(),
            rms_before: numbers(before),
            rms_after: numbers(after),
            noise_floor: numbers(&self.noise_floor),
            held_out: self.held_out,
        };
        let mut out = Vec::new();
        for effect in &self.effects {
            out.push(step(effect, before));
            before = &effect.1;
        }
        out
    }
}

/// A parameter before and after an effect was added.
#[derive(Clone, Debug)]
pub struct Change {
    /// Before.
    pub before: Estimate,
    /// After.
    pub after: Estimate,
}

/// Parameters changed by an addition by more than three standard errors, or by more than a tenth and one standard
/// error.
pub fn changes(before: &Fit, after: &Fit) -> Vec<Change> {
    let pairs = before.parameters.iter().filter_map(|b| {
        let a = after.parameters.iter().find(|a| a.param == b.param)?;
        Some(Change { before: b.clone(), after: a.clone() })
    });
    pairs.filter(Change::counts).collect()
}

impl Change {
    fn counts(&self) -> bool {
        let Self { before, after } = self;
        let (moved, error) = ((after.value - before.value).abs(), before.std.max(after.std));
        let known = before.identified() && after.identified();
        known && (moved > 3.0 * error || (moved > 0.1 * before.value.abs() && moved > error))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn budget() -> Budget {
        Budget {
            mechanism: Mechanism::default(),
            channels: vec![Channel::Torque(0), Channel::StrutUpper(2)],
            rms_before: vec![1.0, 10.0],
            noise_floor: vec![0.4, 2.0],
            effects: vec![("a".into(), vec![0.6, 5.0]), ("b".into(), vec![0.5, 5.5])],
            held_out: true,
        }
    }

    #[test]
    fn shares_of_the_mean_square_add_up() {
        let shares = budget().shares(0);
        approx::assert_relative_eq!(shares.effects[0], 0.64, epsilon = 1e-12);
        approx::assert_relative_eq!(shares.effects[1], 0.11, epsilon = 1e-12);
        approx::assert_relative_eq!(shares.noise, 0.16, epsilon = 1e-12);
        approx::assert_relative_eq!(shares.unexplained, 0.09, epsilon = 1e-12);
        let other = budget().shares(1);
        assert!(other.effects[1] < 0.0);
        approx::assert_relative_eq!(
            other.effects.iter().sum::<f64>() + other.noise + other.unexplained,
            1.0,
            epsilon = 1e-12
        );
        // Less is left than the noise floor.
        let below = Budget { noise_floor: vec![0.55, 2.0], ..budget() }.shares(0);
        assert_eq!((below.noise, below.unexplained), (0.25, 0.0));
    }

    #[test]
    fn every_step_begins_where_the_last_one_ended() {
        let history = budget().history();
        assert_eq!(history[0].rms_before, [1.0, 10.0]);
        assert_eq!(history[1].rms_before, history[0].rms_after);
        assert_eq!((history[1].effect.as_str(), history[1].rms_after[1]), ("b", 5.5));
        assert_eq!(history[0].channels, ["tau1", "strut3_upper"]);
    }
}

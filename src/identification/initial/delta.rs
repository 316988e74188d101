//! A first model of a delta robot from a template.

use super::{
    BEYOND, Initial, InitialError, MARGIN, Number, PERIOD, encoder_bits, encoder_step, rounded_up, sample_time, widened,
};
use crate::effects::{Unit, smooth_sign};
use crate::evidence::noise::{correlation_time, difference_sigma};
use crate::identification::least_squares::least_squares;
use crate::identification::{Dataset, predict};
use crate::machine::{Stops, TELESCOPE_AXIS, three_arms};
use crate::model::Model;
use crate::model::history::rounded_to;
use crate::numerics::median;
use crate::recording::Recording;

/// Correlation of measured with predicted torque below which the template's friction is kept.
const FOLLOWS: f64 = 0.7;

/// A first model of a delta robot: `template` with the numbers that the recordings tell.
///
/// Torques do not tell the geometry, and masses only a fit; sampling time, encoder, travel, noise and friction are
/// replaced, and limits of the drives that the recordings exceed.
///
/// # Errors
/// [`InitialError::TooShort`] if a recording leaves no samples, [`InitialError::OtherMachine`] if the template has other
/// axes, [`InitialError::NoMotion`] without recordings.
pub fn delta(template: &Model, recordings: &[Recording]) -> Result<Initial, InitialError> {
    let first = recordings.first().ok_or(InitialError::NoMotion)?;
    let (expected, found) = (template.mechanism.axes(), first.signals.mechanism.axes());
    if expected != found {
        return Err(InitialError::OtherMachine { template: template.name.clone(), expected, found });
    }
    let datasets: Vec<Dataset> = recordings.iter().map(Dataset::new).collect();
    if let Some(empty) = datasets.iter().find(|d| d.is_empty()) {
        return Err(InitialError::TooShort { name: empty.name.clone() });
    }
    let mut own =
        Own { recordings, datasets: &datasets, model: template.clone(), numbers: Vec::new(), remarks: Vec::new() };
    let period = sample_time(recordings, &mut own.remarks);
    own.model.sample_time = period;
    own.number("", "sample_time", vec![period], Unit::S, "median step of time");
    own.travel();
    own.encoders();
    own.limits();
    own.noise();
    own.friction();
    Ok(Initial { model: own.model, numbers: own.numbers, remarks: own.remarks })
}

struct Own<'a> {
    recordings: &'a [Recording],
    datasets: &'a [Dataset],
    model: Model,
    numbers: Vec<Number>,
    remarks: Vec<String>,
}

/// A coefficient with its standard error.
type Get = fn(&Friction) -> (f64, f64);
/// Value of an arm at a sample of a dataset, or of its predicted channels.
type At<'a> = &'a dyn Fn(&Dataset, &[Vec<f64>], usize) -> f64;

/// Friction of one arm, with standard errors.
struct Friction {
    coulomb: (f64, f64),
    viscous: (f64, f64),
    /// Measured torque per torque of the template, without friction.
    slope: f64,
}

impl Own<'_> {
    fn number(&mut self, table: &'static str, key: &'static str, values: Vec<f64>, unit: Unit, how: impl Into<String>) {
        self.numbers.push(Number { table, key, values, unit, std: Vec::new(), how: how.into() });
    }

    /// Travel of the arms, within the template's stops and around the home pose.
    fn travel(&mut self) {
        let angles = self.recordings.iter().flat_map(|r| r.signals.q().iter().flat_map(|q| q[three_arms()].to_vec()));
        let mut limits = widened(angles);
        if self.model.stops != Stops::NONE {
            let [low, high] = self.model.stops.arm;
            limits = limits.map(|x| x.clamp(low, high));
        }
        let limits = [limits[0].min(0.0), limits[1].max(0.0)].map(|x| rounded_to(x, 4));
        if limits[0] < limits[1] {
            self.model.geometry.set_arm_limits(limits);
            let how = format!("travel of the arms and {:.0} % at either end, home included", 100.0 * BEYOND);
            self.number("geometry", "arm_limits", limits.to_vec(), Unit::Rad, how);
        }
    }

    /// Resolution of the encoders at the template's gear ratios.
    fn encoders(&mut self) {
        let steps: Vec<f64> = three_arms().filter_map(|i| encoder_step(self.recordings, i)).collect();
        if steps.is_empty() {
            self.remarks.push("The angles have no visible steps: `encoder_bits` is the template's.".into());
        } else {
            let (step, gear) = (median(steps), self.model.drives[0].gear_ratio);
            let bits = encoder_bits(step, gear);
            self.model.drives[three_arms()].iter_mut().for_each(|d| d.encoder_bits = bits);
            let how = format!("the angles step by {step:.3e} rad; gear of the template");
            self.number("drives.arm", "encoder_bits", vec![f64::from(bits)], Unit::Bit, how);
        }
        if !self.model.mechanism.has_telescope() {
            return;
        }
        if let Some(step) = encoder_step(self.recordings, TELESCOPE_AXIS) {
            let gear = self.model.drives[TELESCOPE_AXIS].gear_ratio;
            let bits = encoder_bits(step, gear);
            self.model.drives[TELESCOPE_AXIS].encoder_bits = bits;
            let how = format!("the angle steps by {step:.3e} rad; gear of the template");
            self.number("drives.telescope", "encoder_bits", vec![f64::from(bits)], Unit::Bit, how);
        }
    }

    /// Limits of torque and speed that the recordings exceed.
    fn limits(&mut self) {
        let groups: [(&str, std::ops::Range<usize>); 2] =
            [("drives.arm", three_arms()), ("drives.telescope", TELESCOPE_AXIS..self.model.mechanism.axes())];
        for (table, axes) in groups {
            let most = |of: &dyn Fn(&Dataset, usize, usize) -> f64| {
                let all = self.datasets.iter().flat_map(|d| axes.clone().map(move |i| (d, i)));
                all.flat_map(|(d, i)| (0..d.len()).map(move |k| (d, k, i)))
                    .map(|(d, k, i)| of(d, k, i).abs())
                    .fold(0.0, f64::max)
            };
            let (torque, speed) = (most(&|d, k, i| d.measured[i][k]), most(&|d, k, i| d.joints[k].qd[i]));
            let exceeded = format!("{MARGIN} × largest recorded, which exceeds the template's");
            let drives = &mut self.model.drives[axes];
            let Some(first) = drives.first().copied() else { continue };
            if torque > first.max_torque {
                drives.iter_mut().for_each(|d| d.max_torque = rounded_up(MARGIN * torque, 3));
            }
            if speed > first.max_speed {
                drives.iter_mut().for_each(|d| d.max_speed = rounded_up(MARGIN * speed, 3));
            }
            let now = drives[0];
            if torque > first.max_torque {
                self.number(table, "max_torque", vec![now.max_torque], Unit::NM, exceeded.clone());
            }
            if speed > first.max_speed {
                self.number(table, "max_speed", vec![now.max_speed], Unit::RadPerS, exceeded);
            }
        }
    }

    fn noise(&mut self) {
        let axes = self.model.mechanism.axes();
        let sigma = |i: usize| {
            let each: Vec<f64> =
                self.datasets.iter().filter_map(|d| difference_sigma(&d.measured[i], &d.segments, 4)).collect();
            rounded_to((each.iter().map(|s| s * s).sum::<f64>() / each.len().max(1) as f64).sqrt(), 3)
        };
        let sigma: Vec<f64> = (0..axes).map(sigma).collect();
        self.model.noise.torque[..axes].copy_from_slice(&sigma);
        self.number("noise", "torque", sigma, Unit::NM, "differences of fourth order");
    }

    /// Friction of the arms beside the torque that the template predicts without it.
    fn friction(&mut self) {
        let Some(place) = self.model.effects.iter().position(|a| a.effect.name() == "drive_friction") else { return };
        let mut without = self.model.clone();
        without.effects.retain(|a| a.effect.name() != "drive_friction");
        let steepness = self.model.effects.get(place).and_then(|a| a.values.last().copied()).unwrap_or(100.0);
        let Some(found) = self.each_arm(&without, steepness) else {
            self.remarks.push(
                "The torques do not follow the template's: its friction is kept. `check --model` tells why.".into(),
            );
            return;
        };
        let of = |get: Get| {
            let pairs = found.iter().map(get);
            pairs
                .map(|(value, std)| (rounded_to(value.max(0.0), 4), rounded_to(std, 2)))
                .unzip::<f64, f64, Vec<_>, Vec<_>>()
        };
        let how = "regression beside the template's torque";
        let fields: [(&str, Get, Unit); 2] =
            [("coulomb", |f| f.coulomb, Unit::NM), ("viscous", |f| f.viscous, Unit::NMSPerRad)];
        for (key, get, unit) in fields {
            let (values, std) = of(get);
            if let Some(active) = self.model.effects.iter_mut().nth(place) {
                let entries = active.entries();
                let mut next = values.iter();
                for (slot, entry) in active.values.iter_mut().zip(&entries).filter(|(_, e)| e.parameter.name == key) {
                    let (low, high) = entry.parameter.range;
                    *slot = next.next().map_or(*slot, |v| v.clamp(low, high));
                }
            }
            self.numbers.push(Number { table: "effects.drive_friction", key, values, unit, std, how: how.into() });
        }
        let slopes: Vec<String> = found.iter().map(|f| format!("{:.2}", f.slope)).collect();
        self.remarks.push(format!(
            "Beside friction, the torques of the arms are {} times those of the template: `identify` fits the masses.",
            slopes.join(", ")
        ));
    }

    /// Friction of every arm; `None` if a pose is impossible for the template or a torque does not follow it.
    fn each_arm(&self, without: &Model, steepness: f64) -> Option<Vec<Friction>> {
        let predicted: Vec<(Dataset, Vec<Vec<f64>>)> = self
            .datasets
            .iter()
            .map(|d| {
                let few = d.averaged(d.stride(PERIOD));
                let series = predict(&few.plant(without), &few).ok()?;
                Some((few, series))
            })
            .collect::<Option<_>>()?;
        let arm = |i: usize| {
            let gather = |of: At| {
                predicted
                    .iter()
                    .flat_map(|(d, p)| (0..d.len()).map(|k| of(d, p, k)).collect::<Vec<_>>())
                    .collect::<Vec<f64>>()
            };
            let torque = gather(&|d, _, k| d.measured[i][k]);
            let model = gather(&|_, p, k| p[i][k]);
            let rate = gather(&|d, _, k| d.joints[k].qd[i]);
            let sign: Vec<f64> = rate.iter().map(|v| smooth_sign(*v, steepness)).collect();
            let ones = vec![1.0; torque.len()];
            let features = [&model[..], &sign, &rate, &ones];
            let fit = least_squares(&features, &torque)?;
            let rest: Vec<f64> = (0..torque.len())
                .map(|k| torque[k] - fit.beta.iter().zip(&features).map(|(b, f)| b * f[k]).sum::<f64>())
                .collect();
            let variance = torque.iter().map(|x| x * x).sum::<f64>() / torque.len() as f64;
            let follows = fit.beta[0] > 0.0 && fit.mean_square < (1.0 - FOLLOWS * FOLLOWS) * variance;
            let inflation = correlation_time(&[rest]).sqrt();
            follows.then(|| Friction {
                coulomb: (fit.beta[1], inflation * fit.std[1]),
                viscous: (fit.beta[2], inflation * fit.std[2]),
                slope: fit.beta[0],
            })
        };
        three_arms().map(arm).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::Mechanism;
    use crate::model::testing::irb360;

    #[test]
    fn a_template_of_another_machine_is_refused() {
        let recording = Recording::default();
        let three = Model { mechanism: Mechanism::delta(false), ..irb360() };
        let answer = delta(&three, &[recording]);
        assert!(matches!(answer, Err(InitialError::OtherMachine { expected: 3, found: 4, .. })));
    }
}

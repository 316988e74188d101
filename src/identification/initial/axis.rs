//! A first model of a single axis.

mod regression;

use super::{
    BEYOND, DERIVED, Initial, InitialError, MARGIN, Number, encoder_bits, encoder_step, quantile, rounded_up,
    sample_time, step_of_noise, widened,
};
use regression::{Fit, Series, steepness};

use crate::effects::{ActiveEffect, Effects, Host, Role, Unit, find};
use crate::evidence::noise::difference_sigma;
use crate::identification::Dataset;
use crate::identification::bandwidth::{bandwidth, narrow};
use crate::identification::zeros::zeros;
use crate::machine::bodies::{ARM, SLOTS};
use crate::machine::{Bodies, Drive, Geometry, Inertia, Joint, LinkParameters, Mechanism, Noise, Sockets, Stops, each};
use crate::model::history::rounded_to;
use crate::model::{Meshes, Model};
use crate::numerics::deviation;
use crate::recording::{Channel, Recording};
use crate::text::significant;

/// Standard errors beyond which gravity is significant, share of the torque's variance that it must explain, and
/// least travel on which it is told from a constant, rad.
const GRAVITY: (f64, f64, f64) = (5.0, 0.02, 0.3);
/// Standard errors, and share of the torque's deviation, beyond which a constant torque counts, and constants of recordings
/// differ.
const OFFSET: (f64, f64) = (5.0, 0.02);
/// Standard errors, and amount, by which the share of a known load must differ from 1.
const SCALE: (f64, f64) = (4.0, 0.01);
/// Shares of a known load that a gain of the torque can express.
const GAINS: (f64, f64) = (0.1, 10.0);
/// Share of the torque that friction and inertia leave from which the residual is mentioned.
const LEFT: f64 = 0.2;
/// Largest position that a model file admits, rad or m.
const FARTHEST: f64 = 1e4;

/// A first model of the single axis that was recorded.
///
/// Inertia and friction follow from one linear regression over all recordings, τ = J·q̈ + p_C·tanh(k·q̇) + p_v·q̇ + a
/// constant per recording, on a revolute axis also + a·sin q + b·cos q per recording, as their zeros may differ. A constant
/// that all share is a bias of the torque. Standard errors take the autocorrelation of the residual into account.
/// `gear_ratio` is that of the drive, 1 if unknown.
///
/// # Errors
/// [`InitialError::TooShort`] if a recording leaves no samples, [`InitialError::NoMotion`] if the motion does not
/// determine inertia and friction.
pub fn axis(name: &str, recordings: &[Recording], gear_ratio: Option<f64>) -> Result<Initial, InitialError> {
    let mut datasets: Vec<Dataset> = recordings.iter().map(Dataset::new).collect();
    if let Some(empty) = datasets.iter().find(|d| d.is_empty()) {
        return Err(InitialError::TooShort { name: empty.name.clone() });
    }
    let mechanism = recordings.first().ok_or(InitialError::NoMotion)?.signals.mechanism;
    let on_times = |(d, r): (&Dataset, &Recording)| d.on_times(r).map(|sentence| sentence + ".");
    let mut remarks: Vec<String> = datasets.iter().zip(recordings).filter_map(on_times).collect();
    let joined = join(mechanism, recordings, &mut datasets, &mut remarks);
    let recordings = &joined[..];
    if let Some(cut_off) = bandwidth(mechanism, &datasets) {
        narrow(&mut datasets, cut_off);
        let text = significant(cut_off, 2);
        remarks.push(format!(
            "Accelerations are low-passed at {text} Hz: what is faster, noise or ringing, does not show in the torque."
        ));
    }
    let mut own = Own { mechanism, recordings, datasets: &datasets, numbers: Vec::new() };
    let period = sample_time(recordings, &mut remarks);
    own.number("", "sample_time", vec![period], Unit::S, "median step of time");
    let travel = own.travel(&mut remarks);
    let drive = own.drive(gear_ratio);
    let sigma = own.noise();
    let (drive, law) = own.law(drive, &mut remarks)?;
    let mut model = empty(name, mechanism, drive);
    model.sample_time = period;
    model.geometry.set_arm_limits(travel);
    model.noise.torque[0] = sigma;
    model.bodies[ARM] = Inertia::lone(law.inertia);
    model.effects = law.effects;
    let mut numbers = own.numbers;
    if let Some(limit) = numbers.iter_mut().find(|n| n.key == "max_torque") {
        limit.values = vec![drive.max_torque];
    }
    Ok(Initial { model, numbers, remarks })
}

/// The recordings with the zero of the first, as their datasets after this; a remark about each that had another.
fn join(
    mechanism: Mechanism,
    recordings: &[Recording],
    datasets: &mut [Dataset],
    remarks: &mut Vec<String>,
) -> Vec<Recording> {
    let mut joined = recordings.to_vec();
    for zero in zeros(mechanism, datasets) {
        let names = [zero.recording, 0].map(|r| recordings[r].name.as_str());
        remarks.push(format!("{}.", zero.sentence(names, mechanism.unit(Unit::Rad))));
        datasets[zero.recording].shift(0, zero.offset);
        if let Some(q) = joined[zero.recording].signals.get_mut(Channel::Angle(0)) {
            q.iter_mut().for_each(|q| *q += zero.offset);
        }
    }
    joined
}

/// Inertia and effects of the axis.
struct Law {
    inertia: f64,
    effects: Effects,
}

/// What is read from the recordings of one axis.
struct Own<'a> {
    mechanism: Mechanism,
    recordings: &'a [Recording],
    datasets: &'a [Dataset],
    numbers: Vec<Number>,
}

impl Own<'_> {
    fn number(&mut self, table: &'static str, key: &'static str, values: Vec<f64>, unit: Unit, how: impl Into<String>) {
        self.estimate(table, key, (values, Vec::new()), unit, how);
    }

    fn estimate(
        &mut self,
        table: &'static str,
        key: &'static str,
        (values, std): (Vec<f64>, Vec<f64>),
        unit: Unit,
        how: impl Into<String>,
    ) {
        let unit = self.mechanism.unit(unit);
        self.numbers.push(Number { table, key, values, unit, std, how: how.into() });
    }

    fn samples(&self, of: impl Fn(&Dataset, usize) -> f64) -> impl Iterator<Item = f64> {
        self.datasets.iter().flat_map(move |d| (0..d.len()).map(|k| of(d, k)).collect::<Vec<_>>())
    }

    /// Limits of the position.
    fn travel(&mut self, remarks: &mut Vec<String>) -> [f64; 2] {
        let positions = self.recordings.iter().flat_map(|r| r.signals[Channel::Angle(0)].iter().copied());
        let travel = widened(positions).map(|x| rounded_to(x.clamp(-FARTHEST, FARTHEST), 4));
        let turns = (travel[1] - travel[0]) / std::f64::consts::TAU;
        if self.mechanism.joint() == Joint::Revolute && turns > 2.0 {
            remarks.push(format!("The axis turns on ({turns:.1} turns): `limits` are only what was recorded."));
        }
        let how = format!("travel of the recordings and {:.0} % at either end", 100.0 * BEYOND);
        self.number("geometry", "limits", travel.to_vec(), Unit::Rad, how);
        travel
    }

    /// Drive with the limits that the recordings reach.
    fn drive(&mut self, gear_ratio: Option<f64>) -> Drive {
        let gear = gear_ratio.unwrap_or(1.0);
        let unknown = "unknown, 1 = no gear; --gear-ratio states it";
        let how = if gear_ratio.is_some() { "--gear-ratio" } else { unknown };
        self.number("drives.axis", "gear_ratio", vec![gear], Unit::RadPerRad, how);
        let unit = self.mechanism.unit(Unit::Rad);
        let (bits, how) = match encoder_step(self.recordings, 0) {
            Some(step) => (encoder_bits(step, gear), format!("the angles have steps of {step:.4e} {unit}")),
            None => match step_of_noise(self.recordings, 0) {
                Some(step) => {
                    let sigma = step / 12f64.sqrt();
                    (encoder_bits(step, gear), format!("no steps; as noisy as the angles, {sigma:.2e} {unit}"))
                }
                None => (32, "the angles have neither steps nor noise".into()),
            },
        };
        self.number("drives.axis", "encoder_bits", vec![f64::from(bits)], Unit::Bit, how);
        let largest = |of: &dyn Fn(&Dataset, usize) -> f64| self.samples(of).fold(0.0f64, |m, x| m.max(x.abs()));
        let speed = largest(&|d, k| d.joints[k].qd[0]);
        let torque = quantile(self.samples(|d, k| d.measured[0][k]), 1.0);
        let acceleration = quantile(self.samples(|d, k| d.joints[k].qdd[0]), DERIVED.1);
        let jerks = self.datasets.iter().flat_map(|d| {
            let steps = d.segments.iter().flat_map(|s| s.clone().zip(s.clone().skip(1)));
            steps.map(|(a, b)| (d.joints[b].qdd[0] - d.joints[a].qdd[0]) / d.step(b)).collect::<Vec<_>>()
        });
        let jerk = quantile(jerks, DERIVED.1);
        let most = |x: f64, factor: f64| rounded_up(factor * x.max(f64::MIN_POSITIVE.sqrt()), 3);
        let drive = Drive {
            gear_ratio: gear,
            encoder_bits: bits,
            max_torque: most(torque, MARGIN),
            max_speed: most(speed, MARGIN),
            max_acceleration: most(acceleration, DERIVED.0),
            max_jerk: most(jerk, DERIVED.0),
        };
        let seen = |what: &str, factor: f64| format!("{factor} × {what}, not a rating");
        let derived = format!("{} % quantile", 100.0 * DERIVED.1);
        self.number("drives.axis", "max_torque", vec![drive.max_torque], Unit::NM, seen("largest recorded", MARGIN));
        self.number("drives.axis", "max_speed", vec![drive.max_speed], Unit::RadPerS, seen("largest recorded", MARGIN));
        let limits = [
            ("max_acceleration", drive.max_acceleration, Unit::RadPerS2),
            ("max_jerk", drive.max_jerk, Unit::RadPerS3),
        ];
        for (key, value, unit) in limits {
            self.number("drives.axis", key, vec![value], unit, seen(&derived, DERIVED.0));
        }
        drive
    }

    /// Standard deviation of the noise of the torque.
    fn noise(&mut self) -> f64 {
        let each: Vec<f64> =
            self.datasets.iter().filter_map(|d| difference_sigma(&d.measured[0], &d.segments, 4)).collect();
        let sigma = (each.iter().map(|s| s * s).sum::<f64>() / each.len().max(1) as f64).sqrt();
        let sigma = rounded_to(sigma, 3);
        let how = if sigma > 0.0 { "differences of fourth order" } else { "none: is it measured?" };
        self.number("noise", "torque", vec![sigma], Unit::NM, how);
        sigma
    }

    /// Inertia, friction and gravity, and the drive with a torque limit that admits them.
    fn law(&mut self, drive: Drive, remarks: &mut Vec<String>) -> Result<(Drive, Law), InitialError> {
        let host = Host::new(self.mechanism, &drive);
        let usual = find("drive_friction")
            .map(|e| ActiveEffect::absent_on(e, host))
            .and_then(|a| a.entries().iter().find(|e| e.parameter.role == Role::Fixed).map(|e| e.parameter.default));
        let usual = usual.ok_or(InitialError::NoMotion)?;
        let seen = steepness(self.datasets, self.mechanism, usual, drive.max_speed);
        let mut series = Series::of(self.datasets, seen.unwrap_or(usual));
        let scale = self.scale(&series, remarks);
        let mut drive = drive;
        match scale {
            Some(scale) if !(GAINS.0..GAINS.1).contains(&scale) => {
                return Err(InitialError::Scale { scale, factor: rounded_to(1.0 / scale, 4) });
            }
            // In the unit of the load.
            Some(scale) => {
                drive.max_torque = rounded_up(drive.max_torque / scale, 3);
                series.torque.iter_mut().for_each(|torque| *torque /= scale);
            }
            None => series = series.unloaded(),
        }
        let plain = Fit::of(&series, false).ok_or(InitialError::NoMotion)?;
        let mut with = self.gravity(&series, &plain);
        let bias = self.bias(with.as_ref().unwrap_or(&plain), &series);
        if with.is_some() && bias.is_none() {
            with = Fit::without_constants(&series).or(with);
        }
        let fit = with.as_ref().unwrap_or(&plain);
        let inertia = fit.coefficient(Some(0));
        let [coulomb, viscous, _] = fit.friction.map(|place| fit.coefficient(place));
        let inertia = self.inertia(inertia, remarks);
        let mut effects = Effects::default();
        let friction = [("coulomb", positive(coulomb)), ("viscous", positive(viscous))];
        let names = [("coulomb", coulomb, Unit::NM), ("viscous", viscous, Unit::NMSPerRad)];
        for (key, (value, std), unit) in names {
            let how =
                if value > 0.0 { "linear regression" } else { "none: the regression with it gave a negative one" };
            let (value, std) = (rounded_to(value.max(0.0), 4), rounded_to(std, 2));
            let std = if value > 0.0 { vec![std] } else { Vec::new() };
            self.estimate("effects.drive_friction", key, (vec![value], std), unit, how);
        }
        let gravity = with.as_ref().map(|fit| self.note_gravity(fit, remarks));
        let gravity = gravity.filter(|_| find("axis_gravity").is_some());
        let common = bias.is_some();
        let bias = bias.map(|pair| {
            // In the unit of the recording.
            let [value, std] = <[f64; 2]>::from(pair).map(|x| x * scale.unwrap_or(1.0));
            let values = (vec![rounded_to(value, 4)], vec![rounded_to(std, 2)]);
            self.estimate(
                "effects.torque_bias",
                "bias",
                values,
                Unit::NM,
                "linear regression; a constant of the torque",
            );
            [("bias", rounded_to(value, 4))]
        });
        let own = bias.as_ref().map_or(&[][..], |bias| bias);
        let drive = admitting(drive, self.mechanism, &friction, gravity, own);
        let host = Host::new(self.mechanism, &drive);
        let mut friction = friction.to_vec();
        if let Some(steepness) = seen {
            let how = "least squares: friction reverses over about 1/steepness";
            self.number("effects.drive_friction", "steepness", vec![steepness], Unit::SPerRad, how);
            friction.push(("steepness", steepness));
        }
        effects.push(filled("drive_friction", host, &friction).ok_or(InitialError::NoMotion)?);
        if let Some(values) =
            gravity.and_then(|[sine, cosine]| filled("axis_gravity", host, &[("sine", sine), ("cosine", cosine)]))
        {
            effects.push(values);
        }
        if let Some(gain) = scale.and_then(|scale| filled("torque_gain_error", host, &[("gain", scale - 1.0)])) {
            effects.push(gain);
        }
        if let Some(bias) = bias.and_then(|bias| filled("torque_bias", host, &bias)) {
            effects.push(bias);
        }
        self.left(fit, &series, common, remarks);
        Ok((drive, Law { inertia, effects }))
    }

    /// Recorded torque per torque in the unit of the known load; `None` unless a load varies and shows it to be other than 1.
    fn scale(&mut self, series: &Series, remarks: &mut Vec<String>) -> Option<f64> {
        let fit = Fit::of(series, self.mechanism.joint() == Joint::Revolute).or_else(|| Fit::of(series, false))?;
        let (scale, std) = fit.coefficient(Some(fit.load?));
        let is_other = (scale - 1.0).abs() > SCALE.0 * std && (scale - 1.0).abs() > SCALE.1;
        if !is_other || scale <= SCALE.0 * std {
            return None;
        }
        let scale = rounded_to(scale, 4);
        remarks.push(format!(
            "The recorded torque is {scale} ± {std:.1e} times the load: the model is in the load's unit, with a gain of the \
             torque; `--map \"tau1=tau1/{scale}\"` states it once and for all."
        ));
        self.estimate(
            "effects.torque_gain_error",
            "gain",
            (vec![rounded_to(scale - 1.0, 4)], vec![rounded_to(std, 2)]),
            Unit::One,
            "linear regression on the known load",
        );
        Some(scale)
    }

    /// The inertia of the model: the estimate, or its standard error if the motion does not show it.
    fn inertia(&mut self, (value, std): (f64, f64), remarks: &mut Vec<String>) -> f64 {
        let key = if self.mechanism.joint() == Joint::Revolute { "inertia" } else { "mass" };
        let seen = value > 2.0 * std;
        let used = rounded_to(if seen { value } else { value.abs().max(std).max(1e-9) }, 4);
        if !seen {
            let unit = self.mechanism.unit(Unit::KgM2);
            remarks.push(format!(
                "The motion hardly shows the {key} ({value:.3e} ± {std:.1e} {unit}): faster accelerations tell it."
            ));
        }
        let how = if seen { "linear regression" } else { "not determined: its standard error" };
        self.estimate("bodies.axis", key, (vec![used], vec![rounded_to(std, 2)]), Unit::KgM2, how);
        used
    }

    /// The regression with gravity, if it is significant.
    fn gravity(&self, series: &Series, plain: &Fit) -> Option<Fit> {
        let [low, high] = widened(series.angle.iter().copied());
        if self.mechanism.joint() != Joint::Revolute || high - low < GRAVITY.2 {
            return None;
        }
        let with = Fit::of(series, true)?;
        let variance = deviation(&series.torque).powi(2);
        let explained = (plain.least.mean_square - with.least.mean_square) / variance.max(f64::MIN_POSITIVE);
        // Together: on a short travel sine, cosine and constant resemble each other, and none is significant alone.
        let is_significant =
            with.gain_over(plain, series.torque.len()) > GRAVITY.0.powi(2) * self.recordings.len() as f64;
        (is_significant && explained > GRAVITY.1).then_some(with)
    }

    /// The constant torque of all recordings, with its standard error; `None` if it is not significant, or not common.
    fn bias(&self, fit: &Fit, series: &Series) -> Option<(f64, f64)> {
        let mut places = fit.constants.iter().copied().collect::<Option<Vec<usize>>>()?;
        places.dedup();
        let constants: Vec<(f64, f64)> = places.into_iter().map(|k| fit.coefficient(Some(k))).collect();
        let weights: f64 = constants.iter().map(|(_, std)| std.powi(-2)).sum();
        let mean = constants.iter().map(|(value, std)| value / std.powi(2)).sum::<f64>() / weights;
        let counts = |value: f64, std: f64| counts(value, std, series);
        let is_common = constants.iter().all(|(value, std)| !counts(value - mean, *std));
        (is_common && counts(mean, weights.sqrt().recip())).then(|| (mean, weights.sqrt().recip()))
    }

    /// Records the gravity of the first recording; returns sine and cosine.
    fn note_gravity(&mut self, fit: &Fit, remarks: &mut Vec<String>) -> [f64; 2] {
        let [(sine, sine_std), (cosine, cosine_std)] = fit.gravity(0);
        let unit = self.mechanism.unit(Unit::NM);
        let size = sine.hypot(cosine);
        let known = find("axis_gravity").is_some();
        if known {
            for (key, value, std) in [("sine", sine, sine_std), ("cosine", cosine, cosine_std)] {
                let how = "linear regression; torque sine·sin q + cosine·cos q holds the weight";
                let pair = (vec![rounded_to(value, 4)], vec![rounded_to(std, 2)]);
                self.estimate("effects.axis_gravity", key, pair, Unit::NM, how);
            }
        }
        let end = if known { "" } else { "; no effect of the library has it, so it is left out of the model" };
        remarks.push(format!("Gravity: the torque varies by ±{size:.4} {unit} with the angle as a weight does{end}."));
        [sine, cosine].map(|x| rounded_to(x, 4))
    }

    /// Remarks about constants and about what the regression leaves.
    fn left(&self, fit: &Fit, series: &Series, common: bool, remarks: &mut Vec<String>) {
        let unit = self.mechanism.unit(Unit::NM);
        let told = fit.sines.is_none() || common;
        for (recording, place) in self.recordings.iter().zip(&fit.constants).filter(|_| told) {
            let (constant, std) = fit.coefficient(*place);
            if place.is_none() {
                let name = &recording.name;
                remarks
                    .push(format!("{name} turns in one direction only: a constant would count as Coulomb friction."));
                continue;
            }
            if counts(constant, std, series) {
                let name = &recording.name;
                let end = match common {
                    true => "in the model as torque_bias",
                    false => "left out of the model, as the recordings differ in it",
                };
                remarks.push(format!("{name}: a constant {constant:+.3e} ± {std:.0e} {unit} is {end}."));
            }
        }
        let share = fit.least.mean_square.sqrt() / deviation(&series.torque).max(f64::MIN_POSITIVE);
        if share > LEFT {
            remarks.push(format!(
                "Inertia and friction leave {:.0} % of the torque (RMS): `diagnose` looks for the rest.",
                100.0 * share
            ));
        }
    }
}

/// Whether a constant of the torque is significant and large enough.
fn counts(value: f64, std: f64, series: &Series) -> bool {
    value.abs() > OFFSET.0 * std && value.abs() > OFFSET.1 * deviation(&series.torque)
}

fn positive((value, _): (f64, f64)) -> f64 {
    rounded_to(value.max(0.0), 4)
}

/// The effect `name` with parameter values by name, the others at their defaults.
fn filled(name: &str, host: Host, values: &[(&str, f64)]) -> Option<ActiveEffect> {
    let mut active = ActiveEffect::absent_on(find(name)?, host);
    let entries = active.entries();
    for (place, entry) in active.values.iter_mut().zip(&entries) {
        let known = values.iter().find(|(key, _)| *key == entry.parameter.name);
        *place = known.map_or(*place, |(_, value)| *value);
    }
    Some(active)
}

/// The drive with a torque limit that admits the values: ranges of effects are proportional to it.
fn admitting(
    drive: Drive,
    mechanism: Mechanism,
    friction: &[(&str, f64)],
    gravity: Option<[f64; 2]>,
    bias: &[(&str, f64)],
) -> Drive {
    let host = Host::new(mechanism, &drive);
    let weight = gravity.map_or(Vec::new(), |[sine, cosine]| vec![("sine", sine), ("cosine", cosine)]);
    let mut factor: f64 = 1.0;
    for (name, values) in [("drive_friction", friction), ("axis_gravity", &weight[..]), ("torque_bias", bias)] {
        let Some(active) = find(name).map(|e| ActiveEffect::absent_on(e, host)) else { continue };
        for entry in active.entries() {
            let Some((_, value)) = values.iter().find(|(key, _)| *key == entry.parameter.name) else { continue };
            let (low, high) = entry.parameter.range;
            let bound = if *value < 0.0 { -low } else { high };
            if bound > 0.0 {
                factor = factor.max(value.abs() / bound);
            }
        }
    }
    let max_torque = if factor > 1.0 { rounded_up(factor * drive.max_torque, 3) } else { drive.max_torque };
    Drive { max_torque, ..drive }
}

/// A model of a single axis without numbers.
fn empty(name: &str, mechanism: Mechanism, drive: Drive) -> Model {
    let unused = Drive {
        gear_ratio: 0.0,
        encoder_bits: 0,
        max_torque: 0.0,
        max_speed: 0.0,
        max_acceleration: 0.0,
        max_jerk: 0.0,
    };
    Model {
        name: name.into(),
        path: None,
        source: None,
        mechanism,
        assembled: false,
        geometry: Geometry::single([0.0; 2]),
        bodies: Bodies([Inertia::ZERO; SLOTS]),
        link_parameters: LinkParameters::default(),
        drives: [drive, unused, unused, unused],
        sockets: Sockets {
            ball_radius: 0.0,
            preload: 0.0,
            dislocation_force: 0.0,
            clamp_share: 0.0,
            spin_damping: 0.0,
        },
        stops: Stops::NONE,
        noise: Noise { torque: each(0.0), strut_force: 0.0 },
        gravity: 0.0,
        sample_time: 0.0,
        effects: Effects::default(),
        history: Vec::new(),
        meshes: Meshes::default(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::smooth_sign;
    use crate::recording::Signals;

    /// τ = 0.02·q̈ + 0.3·tanh(k·q̇) + 0.05·q̇ + 0.4·sin(q) along a sum of sines, without noise.
    fn pendulum(zero: f64, steepness: f64) -> Recording {
        let mut samples = Vec::new();
        let waves = [(0.8, 2.1), (0.3, 5.3), (0.1, 11.0)];
        for k in 0..20_000 {
            let t = f64::from(k) * 5e-4;
            let sum = |of: &dyn Fn(f64, f64) -> f64| waves.iter().map(|(a, w)| of(*a, *w)).sum::<f64>();
            let q = sum(&|a, w| a * (w * t).sin());
            let qd = sum(&|a, w| a * w * (w * t).cos());
            let qdd = sum(&|a, w| -a * w * w * (w * t).sin());
            let tau = 0.02 * qdd + 0.3 * smooth_sign(qd, steepness) + 0.05 * qd + 0.4 * q.sin();
            samples.push([t, q - zero, tau]);
        }
        let signals = Signals::of_axis(Joint::Revolute, &samples);
        Recording { name: "pendulum".into(), signals, ..Recording::default() }
    }

    #[test]
    fn a_pendulum_gives_its_parameters_back() {
        let first = axis("pendulum", &[pendulum(0.0, 500.0)], None).unwrap();
        let steepness = 100.0 * 18.989 / first.model.drives[0].max_speed;
        let found = axis("pendulum", &[pendulum(0.0, steepness), pendulum(0.7, steepness)], Some(10.0)).unwrap();
        let of = |table: &str, key: &str| {
            let number = found.numbers.iter().find(|n| n.table == table && n.key == key);
            number.unwrap_or_else(|| panic!("{table}.{key}")).values[0]
        };
        let near = |value: f64, truth: f64| assert!((value / truth - 1.0).abs() < 0.01, "{value} for {truth}");
        near(of("bodies.axis", "inertia"), 0.02);
        near(of("effects.drive_friction", "coulomb"), 0.3);
        near(of("effects.drive_friction", "viscous"), 0.05);
        near(of("", "sample_time"), 5e-4);
        assert_eq!(of("drives.axis", "gear_ratio"), 10.0);
        assert!(
            found.remarks.iter().any(|r| r.starts_with("Gravity: the torque varies by ±0.4")),
            "{:?}",
            found.remarks
        );
        // The second recording's zero is where the first reads 0.7 rad.
        let elsewhere = found.remarks.iter().find(|r| r.contains("elsewhere")).expect("another zero");
        assert!(elsewhere.starts_with("pendulum: +0.70"), "{elsewhere}");
    }

    /// A constant of 0.2 N·m in both recordings, and one that is positive in the first and negative in the second.
    #[test]
    #[ignore = "campaign"]
    fn a_constant_that_all_recordings_share_is_in_the_model() {
        let with = |constant: f64| {
            let mut recording = pendulum(0.0, 100.0);
            let torque = recording.signals.get_mut(Channel::Torque(0)).unwrap();
            torque.iter_mut().for_each(|tau| *tau = ((*tau + constant) * 1e3).round() / 1e3);
            recording
        };
        let bias = |found: &Initial| {
            let mut own = found.model.effects.iter();
            own.find(|e| e.effect.name() == "torque_bias").map(|bias| bias.values[0])
        };
        let found = axis("pendulum", &[with(0.2), with(0.2)], None).unwrap();
        assert!(bias(&found).is_some_and(|bias| (bias - 0.2).abs() < 2e-3), "{:?}", found.remarks);
        assert!(found.remarks.iter().any(|r| r.ends_with("is in the model as torque_bias.")), "{:?}", found.remarks);
        for others in [[0.2, -0.2], [0.0, 0.0]] {
            let found = axis("pendulum", &others.map(with), None).unwrap();
            assert_eq!(bias(&found), None, "{:?}", found.remarks);
        }
    }

    #[test]
    fn a_machine_at_rest_gives_no_model() {
        let mut still = pendulum(0.0, 100.0);
        still.signals.get_mut(Channel::Angle(0)).unwrap().fill(0.25);
        assert!(matches!(axis("still", &[still], None), Err(InitialError::NoMotion)));
        assert!(matches!(axis("none", &[], None), Err(InitialError::NoMotion)));
    }
}

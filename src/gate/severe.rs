//! Findings that make a fit meaningless: signs, factors, order and zeros of columns, another machine.

use super::arrangement::{Arrangement, Judgement, Trial};
use super::instants::{Instants, Predicted, carrying};
use super::line::Line;
use super::load::carries;
use super::mild::load;
use super::{Evidence, Finding, Problem, Remedy, rounded};
use crate::dynamics::Plant;
use crate::identification::Dataset;
use crate::identification::least_squares::least_squares;
use crate::identification::residuals::{difference, rms};
use crate::kinematics::JointState;
use crate::machine::{Mechanism, each};
use crate::model::Model;

/// Range of slopes of measured over predicted torque that a missing effect may cause.
const SLOPE: (f64, f64) = (0.45, 2.2);
/// Correlation below which a torque counts as not following the model.
const CORRELATED: f64 = 0.8;
/// Unexplained share of an arm's torque, and of the telescope's, which friction dominates, from which other
/// arrangements are tried.
const ODD: (f64, f64) = (0.03, 0.2);
/// Largest ratio of the residual with a payload to the residual without it, and to the torque, at which no other
/// arrangement is tried: near a singular pose any load explains most of the residual.
const CARRIED: f64 = 0.3;
/// Correlation of an axis from which its slope is read as a factor: friction missing in the model may double a
/// torque, but lowers the correlation.
const MIN_CORRELATION: f64 = 0.95;
/// Correlation sufficient for slopes outside the range that effects cause, and that range.
const SUFFICIENT_FAR: (f64, std::ops::Range<f64>) = (0.8, 0.2..5.0);
/// Largest share of a torque that its factor, unless it is far, may leave unexplained.
const MOST_UNEXPLAINED: f64 = 0.2;
/// Absolute correlation from which a negative slope is a sign error.
const SIGN: f64 = 0.6;
/// Decrease of the cost required for another arrangement, and correlation required of every arm in it.
const BETTER: (f64, f64) = (4.0, 0.9);
/// Ratio of the slopes over weight and over inertia from which no common factor explains them.
const UNLIKE: f64 = 1.3;
/// Slope over the weight below which torques are without it, and slopes over the inertia that they then have.
const WEIGHTLESS: (f64, std::ops::Range<f64>) = (0.1, 0.5..2.0);
/// Largest values of torques in whole numbers that are per mille or counts of a drive, and difference from a power of ten
/// up to which they are in N·cm or the like.
const WHOLE: std::ops::Range<f64> = 50.0..40_000.0;
const NEAR_POWER: f64 = 0.05;
/// Ratio of the RMS of measured − predicted to that of the measured torque, above which the model predicts nothing.
const WORTHLESS: f64 = 2.0;

/// Findings about signs, factors, order and zeros; about the machine as a whole where nothing else explains them.
pub fn find(model: &Model, plant: &Plant, instants: &Instants) -> Vec<Finding> {
    let plain = Trial::new(plant).judge(instants, Arrangement::PLAIN);
    let drives = |p: &Judgement| p.lines.iter().copied().take(plant.mechanism.axes()).collect::<Vec<_>>();
    let all = plain.as_ref().map_or_else(Vec::new, drives);
    let arms = plant.mechanism.arms();
    let odd = |(i, l): (usize, &Option<Line>)| l.is_some_and(|l| l.unexplained > if i < arms { ODD.0 } else { ODD.1 });
    let strange = plain.is_none() || all.iter().enumerate().any(odd);
    if !strange && all.iter().flatten().all(usual) {
        return Vec::new();
    }
    if let Some(finding) = plain.as_ref().and_then(|p| weightless(model, plant, instants, p)) {
        return vec![finding];
    }
    let carried = strange.then(|| load(model, plant, instants)).flatten();
    if let Some(load) = carried.filter(|l| l.after < CARRIED * l.before.min(l.measured)) {
        let loaded = carrying(plant, load.inertia);
        let judged = Trial::new(&loaded).judge(instants, Arrangement::PLAIN);
        let context = |judged| Context { model, plant: &loaded, instants, plain: Some(judged), judged };
        return judged.as_ref().map_or_else(Vec::new, |judged| context(judged).findings());
    }
    let other = if strange { Trial::new(plant).best(instants) } else { None };
    let other = other.filter(|b| believable(b, plain.as_ref(), plant, instants));
    if let Some(found) = (strange && other.is_none()).then(|| with_load(model, plant, instants)).flatten() {
        return found;
    }
    let Some(judged) = other.as_ref().or(plain.as_ref()) else {
        return vec![impossible(plant, instants)];
    };
    Context { model, plant, instants, plain: plain.as_ref(), judged }.findings()
}

fn usual(line: &Line) -> bool {
    line.correlation > CORRELATED && (SLOPE.0..SLOPE.1).contains(&line.slope)
}

/// Findings about an arrangement that explains the recording together with a load that nobody stated, where neither does
/// alone.
fn with_load(model: &Model, plant: &Plant, instants: &Instants) -> Option<Vec<Finding>> {
    if !plant.assembled {
        return None;
    }
    let trial = Trial::loaded(plant);
    let plain = trial.judge(instants, Arrangement::PLAIN);
    let best = trial.best(instants).filter(|b| believable(b, plain.as_ref(), plant, instants))?;
    if !best.lines.iter().take(plant.mechanism.arms()).flatten().all(|l| l.slope < 0.0 || usual(l)) {
        return None;
    }
    // In the right arrangement the load is told as in any recording.
    let context = Context { model, plant, instants, plain: None, judged: &best };
    let arranged = context.arranged();
    let load = load(model, plant, &Instants::of(&arranged, super::INSTANTS))?;
    let loaded = carrying(plant, load.inertia);
    let judged = Trial::new(&loaded).judge(instants, best.arrangement)?;
    let plain = Trial::new(&loaded).judge(instants, Arrangement::PLAIN);
    let context = Context { model, plant: &loaded, instants, plain: plain.as_ref(), judged: &judged };
    let mut found = context.axes();
    if found.is_empty() {
        return None;
    }
    found.extend(carries(instants.dataset, &plant.payload, &load));
    Some(found)
}

/// Whether an arrangement explains the recording and the file's own does not.
fn believable(other: &Judgement, plain: Option<&Judgement>, plant: &Plant, instants: &Instants) -> bool {
    let arms = other.lines.iter().take(plant.mechanism.arms()).flatten();
    let correlated = arms.fold(f64::INFINITY, |least, l| least.min(l.correlation.abs())) > BETTER.1;
    let better = plain.is_none_or(|p| other.cost < p.cost - BETTER.0);
    correlated && better && !is_of_a_fit(other, plant, instants)
}

/// Whether only offset and friction of the axes and the payload's centre of mass, which a fit determines, speak for other
/// names or other zeros of a robot's arms: arms of equal build differ in nothing else, other names turn the payload, and
/// where friction is strong a torque resembles that of many poses.
fn is_of_a_fit(other: &Judgement, plant: &Plant, instants: &Instants) -> bool {
    let trial = Trial::beyond_friction(plant);
    let cost = |arrangement| trial.judge(instants, arrangement).map(|j| j.cost);
    let costs = || cost(Arrangement::PLAIN).zip(cost(other.arrangement));
    let is_robot = matches!(plant.mechanism, Mechanism::Delta { .. });
    is_robot
        && other.arrangement.keeps_senses(plant.mechanism.arms())
        && costs().is_some_and(|(plain, other)| other >= plain - BETTER.0)
}

/// Finding: the torques of all arms follow the model's inertia, but hold no weight.
fn weightless(model: &Model, plant: &Plant, instants: &Instants, plain: &Judgement) -> Option<Finding> {
    let arms = plant.mechanism.arms();
    if !matches!(plant.mechanism, Mechanism::Delta { .. }) {
        return None;
    }
    let context = Context { model, plant, instants, plain: Some(plain), judged: plain };
    let slopes: Vec<[f64; 2]> = (0..arms).map(|i| context.weight_and_inertia(i)).collect::<Option<_>>()?;
    let removed = |s: &[f64; 2]| s[0].abs() < WEIGHTLESS.0 && WEIGHTLESS.1.contains(&s[1]);
    if !slopes.iter().all(removed) {
        return None;
    }
    let text = |k: usize| slopes.iter().map(|s| rounded(s[k], 2).to_string()).collect::<Vec<_>>().join(", ");
    let (before, _) = context.rms(0, 1.0);
    Some(Finding {
        recording: instants.dataset.name.clone(),
        axis: None,
        problem: Problem::GravityRemoved,
        severe: true,
        evidence: Evidence { line: plain.lines[0], rms_before: before, ..Evidence::default() },
        sentence: format!(
            "the torques hold {} times the model's weight and {} times its inertia: gravity was already removed from them",
            text(0),
            text(1)
        ),
        remedy: Remedy::Words("torques before gravity compensation, or a model with gravity = 0.0"),
    })
}

/// Finding: too few poses of the recording are reachable for the machine.
fn impossible(plant: &Plant, instants: &Instants) -> Finding {
    let joints = instants.joints(|j| *j);
    let share = Predicted::new(plant, &instants.dataset.channels, 0.0, &joints).share();
    Finding {
        recording: instants.dataset.name.clone(),
        axis: None,
        problem: Problem::AnotherMachine,
        severe: true,
        evidence: Evidence::default(),
        sentence: format!(
            "{:.0} % of the poses are impossible for the model's geometry, with any order, sense or zero of the angles",
            100.0 * (1.0 - share)
        ),
        remedy: Remedy::Words("the model of the machine that was measured"),
    }
}

struct Context<'a> {
    model: &'a Model,
    plant: &'a Plant,
    instants: &'a Instants<'a>,
    plain: Option<&'a Judgement>,
    judged: &'a Judgement,
}

impl Context<'_> {
    fn drives(&self) -> usize {
        self.plant.mechanism.axes()
    }

    /// The recording with its columns in the judged arrangement and its torques scaled.
    fn arranged(&self) -> Dataset {
        let (a, mut arranged) = (&self.judged.arrangement, self.instants.dataset.clone());
        arranged.joints.iter_mut().for_each(|j| *j = a.joints(j));
        for axis in 0..self.drives() {
            let scale = self.scale(axis);
            arranged.measured[axis] =
                self.instants.dataset.measured[a.torque[axis]].iter().map(|x| scale * x).collect();
        }
        arranged
    }

    /// Factor that scales a torque to the size and sign of the predicted one.
    fn scale(&self, axis: usize) -> f64 {
        let Some(line) = &self.judged.lines[axis] else { return 1.0 };
        let sign = if line.slope < 0.0 && line.correlation < -SIGN { -1.0 } else { 1.0 };
        let size = line.slope.abs();
        let certain = if SUFFICIENT_FAR.1.contains(&size) { MIN_CORRELATION } else { SUFFICIENT_FAR.0 };
        // A factor scales the weight as well as the inertia, so the line passes through the origin.
        let offset = SUFFICIENT_FAR.1.contains(&size) && line.unexplained > MOST_UNEXPLAINED;
        if (SLOPE.0..SLOPE.1).contains(&size) || line.correlation.abs() < certain || offset {
            return sign;
        }
        if self.is_whole(axis) {
            let factor = 1.0 / size;
            let power = 10f64.powi(factor.log10().round() as i32);
            return sign * if (factor / power - 1.0).abs() < NEAR_POWER { power } else { rounded(factor, 3) };
        }
        sign * self.gear(axis, size).unwrap_or_else(|| nice(1.0 / size))
    }

    /// Whether a torque consists of whole numbers up to some thousands: per mille or counts.
    fn is_whole(&self, axis: usize) -> bool {
        let series = &self.instants.dataset.measured[self.judged.arrangement.torque[axis]];
        let most = series.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
        WHOLE.contains(&most) && series.iter().all(|x| x.fract() == 0.0)
    }

    /// The gear ratio or its reciprocal, if the slope matches it.
    fn gear(&self, axis: usize, slope: f64) -> Option<f64> {
        let gear = self.model.drives[axis].gear_ratio;
        let near = |x: f64| (SLOPE.0..SLOPE.1).contains(&x);
        if gear <= 1.0 {
            None
        } else if near(slope * gear) {
            Some(gear)
        } else {
            near(slope / gear).then_some(1.0 / gear)
        }
    }

    /// Findings about every axis, or about the machine as a whole where nothing else explains them.
    fn findings(&self) -> Vec<Finding> {
        let found = self.axes();
        match self.another_machine() {
            Some(finding) if found.iter().all(|f| f.problem == Problem::Factor) => vec![finding],
            _ if found.is_empty() => self.unrelated(),
            _ => found,
        }
    }

    fn axes(&self) -> Vec<Finding> {
        (0..self.drives()).filter_map(|axis| self.axis(axis)).collect()
    }

    fn axis(&self, axis: usize) -> Option<Finding> {
        let a = &self.judged.arrangement;
        let scale = self.scale(axis);
        let factor = scale.abs() != 1.0;
        let problem = if a.angle[axis] != axis || a.torque[axis] != axis {
            Problem::Order
        } else if a.zero[axis] != 0.0 {
            Problem::Zero
        } else if a.sign[axis] < 0.0 {
            if scale < 0.0 { Problem::AxisSign } else { Problem::PositionSign }
        } else if scale < 0.0 {
            Problem::TorqueSign
        } else if factor && !self.is_whole(axis) && self.gear(axis, 1.0 / scale) == Some(scale) {
            Problem::MotorSide
        } else if factor {
            Problem::Factor
        } else {
            return None;
        };
        let (before, after) = self.rms(axis, scale);
        let line = self.plain.and_then(|p| p.lines[axis]);
        Some(Finding {
            recording: self.instants.dataset.name.clone(),
            axis: Some(axis),
            problem,
            // On a single-axis bench the mass is the unknown, so a factor is not severe.
            severe: problem != Problem::Factor || !matches!(self.plant.mechanism, Mechanism::Axis(_)),
            evidence: Evidence {
                line,
                value: (problem == Problem::Zero).then_some((a.zero[axis], 0.0)),
                rms_before: before,
                rms_after: Some(after),
            },
            sentence: self.sentence(axis, problem, scale),
            remedy: Remedy::Map(self.assignments(axis, scale)),
        })
    }

    fn sentence(&self, axis: usize, problem: Problem, scale: f64) -> String {
        let (k, a) = (axis + 1, &self.judged.arrangement);
        match problem {
            Problem::Order if a.angle[axis] == axis => format!("tau{} is the torque of axis {k}", a.torque[axis] + 1),
            Problem::Order if a.torque[axis] == axis => format!("q{} is the angle of axis {k}", a.angle[axis] + 1),
            Problem::Order => format!("the columns of axis {} are those of axis {k}", a.angle[axis] + 1),
            Problem::Zero => {
                let sense = if a.sign[axis] < 0.0 { " and the other way" } else { "" };
                format!("the angle of axis {k} counts from {:.1}° elsewhere{sense}", a.zero[axis].to_degrees())
            }
            Problem::AxisSign => format!("angle and torque of axis {k} count the other way"),
            Problem::PositionSign => format!("the angle of axis {k} counts the other way"),
            Problem::TorqueSign => format!("the torque of axis {k} has the other sign"),
            Problem::MotorSide if scale > 1.0 => {
                format!("the torque of axis {k} is that of the motor, before a gear of {scale}")
            }
            Problem::MotorSide => format!("the torque of axis {k} holds the gear ratio {} twice", 1.0 / scale),
            _ if self.is_whole(axis) => format!(
                "the torque of axis {k} is in whole numbers, {} times too large: per mille of a rated torque of {} {} at the \
                 joint, or counts of a drive",
                rounded(1.0 / scale, 3),
                rounded(1000.0 * scale, 3),
                self.instants.dataset.channels[axis].unit(self.instants.dataset.mechanism)
            ),
            _ => format!("the torque of axis {k} is {} times too large: unit or torque constant?", nice(1.0 / scale)),
        }
    }

    /// Assignments for `--map` of one axis.
    fn assignments(&self, axis: usize, scale: f64) -> Vec<String> {
        let (k, a) = (axis + 1, &self.judged.arrangement);
        let mut assignments = Vec::new();
        if a.angle[axis] != axis || a.sign[axis] < 0.0 || a.zero[axis] != 0.0 {
            let sign = if a.sign[axis] < 0.0 { "-" } else { "" };
            let zero = if a.zero[axis] == 0.0 { String::new() } else { format!("{:+.4}", a.zero[axis]) };
            assignments.push(format!("q{k}={sign}q{}{zero}", a.angle[axis] + 1));
        }
        if a.torque[axis] != axis || scale != 1.0 {
            let factor = match scale {
                1.0 => String::new(),
                -1.0 => "-".into(),
                s if s.abs() < 1.0 && (1.0 / s).fract() == 0.0 => {
                    assignments.push(format!("tau{k}=tau{}/{}", a.torque[axis] + 1, 1.0 / s));
                    return assignments;
                }
                s => format!("{s}*"),
            };
            assignments.push(format!("tau{k}={factor}tau{}", a.torque[axis] + 1));
        }
        assignments
    }

    /// RMS of measured − predicted in the file's own arrangement and with the remedy, N·m.
    fn rms(&self, axis: usize, scale: f64) -> (Option<f64>, f64) {
        let left = |a: &Arrangement, scale: f64| {
            let joints = self.instants.joints(|j| a.joints(j));
            let predicted = Predicted::new(self.plant, &self.instants.dataset.channels, 0.0, &joints);
            let mut measured = predicted.of(self.instants.measured(a.torque[axis], 0));
            measured.iter_mut().for_each(|m| *m *= scale);
            rms(&difference(&measured, &predicted.series[axis]))
        };
        let before = self.plain.map(|p| left(&p.arrangement, 1.0));
        (before, left(&self.judged.arrangement, scale))
    }

    /// Finding: the torques of all arms are scaled alike, but weight and inertia by different factors.
    fn another_machine(&self) -> Option<Finding> {
        let arms = self.plant.mechanism.arms();
        if !matches!(self.plant.mechanism, Mechanism::Delta { .. }) {
            return None;
        }
        let lines = self.judged.lines.iter().take(arms).copied();
        let lines: Vec<Line> = lines.collect::<Option<_>>()?;
        let off = |l: &Line| !(SLOPE.0..SLOPE.1).contains(&l.slope) && l.correlation > MIN_CORRELATION;
        if !lines.iter().all(off) {
            return None;
        }
        let slopes: Vec<[f64; 2]> = (0..arms).map(|i| self.weight_and_inertia(i)).collect::<Option<_>>()?;
        let unlike = |s: &[f64; 2]| s[0] <= 0.0 || s[1] <= 0.0 || !(1.0 / UNLIKE..UNLIKE).contains(&(s[0] / s[1]));
        if slopes.iter().filter(|s| unlike(s)).count() < 2 {
            return None;
        }
        let text = |k: usize| slopes.iter().map(|s| rounded(s[k], 2).to_string()).collect::<Vec<_>>().join(", ");
        let (before, _) = self.rms(0, 1.0);
        Some(Finding {
            recording: self.instants.dataset.name.clone(),
            axis: None,
            problem: Problem::AnotherMachine,
            severe: true,
            evidence: Evidence { line: Some(lines[0]), rms_before: before, ..Evidence::default() },
            sentence: match slopes.iter().all(|s| s[0] > 0.0 && s[1] > 0.0) {
                true => {
                    format!("the arms carry {} times the model's weight and {} times its inertia", text(0), text(1))
                }
                false => "weight and inertia of the arms are not those of the model".into(),
            },
            remedy: Remedy::Words("the model of the machine that was measured, or --payload-mass"),
        })
    }

    /// Slopes of a measured torque over the parts of the predicted one due to weight and to inertia.
    fn weight_and_inertia(&self, axis: usize) -> Option<[f64; 2]> {
        let a = &self.judged.arrangement;
        let channels = &self.instants.dataset.channels;
        let still = |j: &JointState| JointState { qd: each(0.0), qdd: each(0.0), ..a.joints(j) };
        let whole = Predicted::new(self.plant, channels, 0.0, &self.instants.joints(|j| a.joints(j)));
        let weight = Predicted::new(self.plant, channels, 0.0, &self.instants.joints(still));
        let weight = &weight.series[axis];
        let measured = whole.of(self.instants.measured(a.torque[axis], 0));
        if weight.len() != measured.len() {
            return None;
        }
        let rest: Vec<f64> = whole.series[axis].iter().zip(weight).map(|(w, g)| w - g).collect();
        let ones = vec![1.0; measured.len()];
        let fit = least_squares(&[&ones, weight, &rest], &measured)?;
        Some([fit.beta[1], fit.beta[2]])
    }

    /// Findings about arms whose torque follows the model's in no arrangement.
    fn unrelated(&self) -> Vec<Finding> {
        let arms = self.plant.mechanism.arms();
        let finding = |axis: usize| {
            let line = self.judged.lines[axis].filter(|l| l.correlation < CORRELATED)?;
            let (before, _) = self.rms(axis, 1.0);
            let measured = rms(&self.instants.measured(axis, 0));
            let severe = before.is_some_and(|b| b > WORTHLESS * measured) && line.correlation < 0.5;
            Some(Finding {
                recording: self.instants.dataset.name.clone(),
                axis: Some(axis),
                problem: Problem::Unrelated,
                severe,
                evidence: Evidence { line: Some(line), rms_before: before, ..Evidence::default() },
                sentence: format!("the torque of axis {} hardly follows the model's", axis + 1),
                remedy: Remedy::Words("the model of the machine that was measured, and a look at the columns"),
            })
        };
        (0..arms).filter_map(finding).collect()
    }
}

/// Factor rounded for a user: a power of ten where it is near one, else three digits.
fn nice(factor: f64) -> f64 {
    let power = 10f64.powi(factor.log10().round() as i32);
    if (SLOPE.0..SLOPE.1).contains(&(factor / power)) && !(0.1..10.0).contains(&factor) {
        return power;
    }
    rounded(factor, 3)
}

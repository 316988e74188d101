//! Torques as the drives report them.

use super::Channels;
use crate::dynamics::{Plant, steady_inverse_dynamics};
use crate::effects::ActiveEffect;
use crate::identification::Dataset;
use crate::kinematics::{JointState, KinematicsError, Motion};
use crate::machine::PerAxis;
use crate::numerics::parallel;
use crate::recording::{Channel, Signals};

/// Longest time before a segment that is extrapolated, s: the memory of a filter is longer than what matters.
const LONGEST: f64 = 0.1;
/// Time over which the trend at the start of a segment is determined, s.
const TREND: f64 = 0.01;
/// Time over which torques along a smoothed motion are linear, s.
const LINEAR: f64 = 2e-3;
/// Step, in sampling periods, from which samples are no neighbours.
const GAP: f64 = 1.5;

/// Applies the sensors of a plant to the predicted torques of all samples. One with a memory begins a recording at rest, and sees
/// at samples that were left out the torques of the smoothed motion there.
pub fn observe(plant: &Plant, dataset: &Dataset, series: &mut Channels) {
    let remembers = plant.effects.iter().any(|active| active.sensor_reach() != [0.0; 2]);
    if !remembers || dataset.between.is_empty() {
        return observe_apart(plant, dataset, series);
    }
    match left_out(plant, dataset) {
        Ok(left_out) => observe_through(plant, dataset, &left_out, series),
        // A smoothed pose that the machine cannot take.
        Err(_) => observe_apart(plant, dataset, series),
    }
}

/// [`observe`] of each segment by itself, for changes of the torques, which are not known between segments.
pub fn observe_apart(plant: &Plant, dataset: &Dataset, series: &mut Channels) {
    let sensors: Vec<&ActiveEffect> = plant.effects.iter().collect();
    let drives = Channel::of_drives(plant.mechanism);
    for segment in dataset.segments.iter().filter(|_| plant.observes()) {
        let mut ideal = Signals::new(plant.mechanism, dataset.t[segment.clone()].to_vec());
        for (series, &drive) in series.iter().zip(&drives) {
            ideal.set(drive, series[segment.clone()].to_vec());
        }
        let signals = reported(ideal, &sensors, !dataset.motion_before(segment.start).is_empty());
        for (series, &drive) in series.iter_mut().zip(&drives) {
            series[segment.clone()].copy_from_slice(&signals[drive]);
        }
    }
}

/// A time, s, with the torques of the drives, and the sample there unless it was left out.
type Row = (f64, PerAxis<f64>, Option<usize>);

/// What was left out, in the order of [`Dataset::between`]: the first sample of each, and others up to the last in steps
/// in which the smoothed torques are linear.
fn left_out(plant: &Plant, dataset: &Dataset) -> Result<Vec<Vec<Row>>, KinematicsError> {
    let stride = dataset.stride(LINEAR);
    let at = |i: usize| {
        let all = &dataset.between[i].motion;
        let mut motion = Motion::REST;
        let mut one = |(t, joint): &(f64, JointState)| {
            plant.set_motion(&plant.behind_encoders(joint), &mut motion)?;
            Ok((*t, steady_inverse_dynamics(plant, *t, &motion, false)?.tau, None))
        };
        let used = |k: &usize| *k == 0 || (all.len() - 1 - k).is_multiple_of(stride);
        (0..all.len()).filter(used).map(|k| one(&all[k])).collect()
    };
    parallel::map(dataset.between.len(), at).into_iter().collect()
}

/// Applies the sensors to stretches without gaps of segments and of what was `left_out` between them.
fn observe_through(plant: &Plant, dataset: &Dataset, left_out: &[Vec<Row>], series: &mut Channels) {
    // The drives' channels come first.
    let axes = plant.mechanism.axes().min(series.len());
    let mut stretches: Vec<Vec<Row>> = Vec::new();
    for segment in &dataset.segments {
        let place = dataset.between.binary_search_by_key(&segment.start, |between| between.before);
        let before = place.map_or(&[][..], |i| &left_out[i]);
        let torque = |k: usize| std::array::from_fn(|i| if i < axes { series[i][k] } else { 0.0 });
        let own = segment.clone().map(|k| (dataset.t[k], torque(k), Some(k)));
        let added: Vec<Row> = before.iter().copied().chain(own).collect();
        let is_next = |last: &Row| added.first().is_some_and(|next| next.0 - last.0 < GAP * dataset.dt);
        match stretches.last_mut().filter(|stretch| stretch.last().is_some_and(is_next)) {
            Some(stretch) => stretch.extend(added),
            None => stretches.push(added),
        }
    }
    for stretch in stretches {
        let mut signals = Signals::new(plant.mechanism, stretch.iter().map(|row| row.0).collect());
        let rows: Vec<PerAxis<f64>> = stretch.iter().map(|row| row.1).collect();
        signals.set_rows(Channel::Torque, &rows);
        plant.effects.iter().for_each(|active| active.observe(&mut signals));
        for ((.., sample), tau) in stretch.iter().zip(signals.tau().iter()) {
            sample.iter().for_each(|k| (0..axes).for_each(|i| series[i][*k] = tau[i]));
        }
    }
}

/// Torques of one segment of samples as `sensors` report them.
///
/// `ideal` has no other channels. A sensor with memory begins a recording at rest. Where earlier samples were left out,
/// `is_cut`, the torques before the first sample follow their trend there instead.
pub fn reported(mut ideal: Signals, sensors: &[&ActiveEffect], is_cut: bool) -> Signals {
    let memory: f64 = sensors.iter().map(|sensor| sensor.sensor_reach()[0]).sum();
    let step = ideal.sample_time();
    let earlier = if is_cut && step > 0.0 { (memory.min(LONGEST) / step).ceil() as usize } else { 0 };
    if earlier > 0 {
        let before = |k: usize| (earlier - k) as f64 * step;
        let t: Vec<f64> = (0..earlier).map(|k| ideal.t[0] - before(k)).chain(ideal.t.iter().copied()).collect();
        let duration = ideal.t.iter().take_while(|t| **t - ideal.t[0] <= TREND).count();
        let far = duration.clamp(2, ideal.t.len()) - 1;
        let time = ideal.t[far] - ideal.t[0];
        let mut longer = Signals::new(ideal.mechanism, t);
        for (channel, tau) in ideal.series() {
            let slope = (tau[far] - tau[0]) / time;
            let extended = (0..earlier).map(|k| tau[0] - slope * before(k)).chain(tau.iter().copied());
            longer.set(channel, extended.collect());
        }
        ideal = longer;
    }
    sensors.iter().for_each(|sensor| sensor.observe(&mut ideal));
    if earlier == 0 { ideal } else { ideal.part(earlier..ideal.len()) }
}

//! Torques as the drives report them.

use crate::effects::ActiveEffect;
use crate::recording::Signals;

/// Longest time before a segment that is extrapolated, s: the memory of a filter is longer than what matters.
const LONGEST: f64 = 0.1;
/// Time over which the trend at the start of a segment is determined, s.
const TREND: f64 = 0.01;

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

//! Orders of cogging, from the lines of the residual's spectrum over the joint angle.
//!
//! Its orders are those of the motor turn, whose angle is N·q_k, N the gear ratio.

use super::judge::{Judge, Judged};
use crate::comparison::Finding;
use crate::effects::{ActiveEffect, cogging};
use crate::identification::lines::{MOST_ORDERS, OverAngle};
use crate::identification::{Dataset, Residuals};
use crate::model::Model;
use crate::text::significant;

/// Orders of the effect `torque_ripple`.
const RIPPLE: [f64; 2] = [1.0, 2.0];

/// Share of the residual of a drive that a line must take on the validation data.
const SHARE: f64 = 0.1;
/// Relative difference of the orders of a line in two recordings.
const SAME_ORDER: f64 = 0.02;

/// Whether the residuals of a channel have the same line over the angle of its motor on the fitted and on the validation data.
pub(super) fn have_line(judged: &Judged, judge: &Judge, channel: usize) -> bool {
    let model = &judged.fit.model;
    let arm = judge.data()[0].channels[channel].drive().filter(|i| *i < model.mechanism.arms());
    let line = |datasets, residuals| line(model, residuals, datasets, arm?);
    let fitted = line(judge.fitting.datasets, &judged.fit.residuals);
    let found = line(judge.data(), &judged.residuals).filter(|(_, share)| *share >= SHARE);
    fitted.zip(found).is_some_and(|(fitted, found)| (fitted.0 / found.0 - 1.0).abs() < SAME_ORDER)
}

/// The effect `cogging` at the orders of the motor turn that the residuals of a model contain; `None` if they contain
/// none, or only those of `torque_ripple`.
pub(super) fn cogging(model: &Model, residuals: &Residuals, datasets: &[Dataset]) -> Option<ActiveEffect> {
    if model.effects.iter().any(|a| a.effect.name() == cogging::NAME) {
        return None;
    }
    let mut orders: Vec<(f64, f64)> = Vec::new();
    for arm in 0..model.mechanism.arms() {
        let gear_ratio = model.drives[arm].gear_ratio;
        let series = over_motor(residuals, datasets, arm, gear_ratio);
        for (order, share) in series.orders(true) {
            match orders.iter_mut().find(|(known, _)| (known - order).abs() < series.width()) {
                Some(known) => known.1 = known.1.max(share),
                None => orders.push((order, share)),
            }
        }
    }
    orders.sort_by(|a, b| b.1.total_cmp(&a.1));
    orders.truncate(MOST_ORDERS);
    let orders: Vec<f64> = orders.into_iter().map(|(order, _)| order).collect();
    if orders.iter().all(|order| RIPPLE.contains(order)) {
        return None;
    }
    Some(cogging::at_orders(&orders, model.drives[0].gear_ratio, model.host()))
}

/// Turns of the motor that turns most, between the ends of its travel in the data.
pub(super) fn motor_turns(model: &Model, datasets: &[Dataset]) -> f64 {
    let turns = |arm: usize| {
        let angles = datasets.iter().flat_map(|t| &t.joints).map(|joint| joint.q[arm]);
        let (low, high) = angles.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
        (high - low) * model.drives[arm].gear_ratio / std::f64::consts::TAU
    };
    (0..model.mechanism.arms()).map(turns).fold(0.0, f64::max)
}

/// Order and share of the strongest line of the residual of arm drive `arm` over its angle; `None` without a line.
pub(super) fn line(model: &Model, residuals: &Residuals, datasets: &[Dataset], arm: usize) -> Option<(f64, f64)> {
    over_motor(residuals, datasets, arm, model.drives[arm].gear_ratio).orders(true).first().copied()
}

/// The strongest line of the residual of arm drive `arm` over its angle, as a pattern; `None` without a line.
pub(super) fn strongest(model: &Model, residuals: &Residuals, datasets: &[Dataset], arm: usize) -> Option<Finding> {
    let (order, share) = line(model, residuals, datasets, arm)?;
    let channel = datasets[0].channels[arm];
    let sentence = format!(
        "{}: {:.0} % of the residual lies at order {} of the motor turn",
        channel.title(model.mechanism),
        100.0 * share,
        significant(order, 4)
    );
    Some(Finding { channel, place: "order".into(), share, sentence })
}

/// Residual of one drive over the motor angle.
fn over_motor(residuals: &Residuals, datasets: &[Dataset], arm: usize, gear_ratio: f64) -> OverAngle {
    let (mut angle, mut residual) = (Vec::new(), Vec::new());
    let (mut squares, mut count, mut step) = (0.0, 0usize, 0.0f64);
    for (dataset, series) in datasets.iter().zip(&residuals.series) {
        angle.extend(dataset.joints.iter().map(|joint| gear_ratio * joint.q[arm]));
        residual.extend(&series[arm]);
        squares += dataset.joints.iter().map(|joint| (gear_ratio * joint.qd[arm]).powi(2)).sum::<f64>();
        count += dataset.len();
        step = step.max(dataset.dt);
    }
    OverAngle::new(angle, residual, (squares / count.max(1) as f64).sqrt(), step)
}

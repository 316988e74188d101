//! Arms and motor 4 of the disassembled robot: Σ of the torque measurement, Table 1 and Fig. 8 (section 6.2 of the
//! paper).

use miette::IntoDiagnostic;

use super::figures::measured_and_computed;
use super::least_squares::{Solution, Stack};
use super::page::{Comparison, Estimate, Plot, Row, Section};
use super::paper::{self, table_1};
use super::runs::{Campaign, Run};
use deltatwin::identification::{Dataset, Residuals};
use deltatwin::machine::bodies::{self, ROTOR};
use deltatwin::machine::{PerAxis, TELESCOPE_AXIS, every_axis};
use deltatwin::model::Model;

/// Mean and unbiased variance of a sample.
fn mean_and_variance(x: &[f64]) -> (f64, f64) {
    let n = x.len() as f64;
    let mean = x.iter().sum::<f64>() / n;
    (mean, x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0))
}

/// Speed below which a joint is commanded to be at rest, rad/s.
const REST: f64 = 1e-9;
/// Settling time, s: steep friction against the controller's stiffness decays within about 0.2 s.
const SETTLING: f64 = 1.5;

/// Mean and variance of the torque of `axis` at every static pose, N·m and N²·m².
pub fn at_rest(run: &Run, axis: usize) -> Vec<(f64, f64)> {
    let signals = &run.recording.signals;
    let mut poses: Vec<Vec<f64>> = Vec::new();
    let mut since = None;
    for ((t, tau), wanted) in signals.t.iter().zip(signals.tau().iter()).zip(&run.commanded) {
        if wanted.qd.iter().any(|v| v.abs() > REST) {
            since = None;
            continue;
        }
        let start = *since.get_or_insert_with(|| {
            poses.push(Vec::new());
            *t
        });
        if t - start >= SETTLING
            && let Some(pose) = poses.last_mut()
        {
            pose.push(tau[axis]);
        }
    }
    poses.iter().filter(|p| p.len() > 1).map(|p| mean_and_variance(p)).collect()
}

/// Standard deviations of the torque measurement, N·m: from the mean variance of all poses under the heavier weight.
pub fn noise(campaign: &Campaign) -> PerAxis<f64> {
    let Some(heaviest) = campaign.rests.last() else { return campaign.disassembled.noise.torque };
    std::array::from_fn(|axis| {
        let poses = at_rest(heaviest, axis);
        (poses.iter().map(|p| p.1).sum::<f64>() / poses.len().max(1) as f64).sqrt()
    })
}

/// Section on Σ from static poses.
pub fn covariance(campaign: &Campaign) -> Section {
    let mut rows = Vec::new();
    for axis in every_axis() {
        let ours = campaign.rests.iter().map(|run| {
            let poses = at_rest(run, axis);
            let n: f64 = poses.len() as f64;
            let (mean, spread) = mean_and_variance(&poses.iter().map(|p| p.1.sqrt()).collect::<Vec<_>>());
            Some(Estimate::new(mean, (spread / n).sqrt()))
        });
        let truth = campaign.disassembled.noise.torque[axis];
        let quantity = format!("σ of axis {}", axis + 1);
        rows.push(Row { quantity, unit: "N·m".into(), ours: ours.collect(), truth: Some(truth), paper: None });
    }
    let largest = |run: &Run| at_rest(run, 0).iter().map(|p| p.0.abs()).fold(0.0, f64::max);
    let loads: Vec<String> = campaign.rests.iter().map(|run| format!("{:.1}", largest(run))).collect();
    let titles = paper::ARM_WEIGHTS.iter().map(|m| format!("{m} kg on the arms")).collect();
    let table = Comparison { titles, rows };
    Section {
        key: "covariance",
        title: "Covariance of the torque measurement (section 6.2.1)".into(),
        text: format!(
            "The disassembled robot rests at several poses with weights on its elbows; the standard deviation of each \
             torque is taken per pose and averaged. The largest mean torque of arm 1 is {} N·m. Σ of the heavier weight \
             weighs the fit below.",
            loads.join(" and ")
        ),
        agreement: format!(
            "The paper prints no value. It sees the variance fall slightly with the load; the noise of the twin's sensors does \
             not depend on it. Under the heavier weight: {} This noise is white, and its size is an estimate, not the paper's.",
            table.hits(paper::ARM_WEIGHTS.len() - 1)
        ),
        tables: vec![table],
        plots: Vec::new(),
    }
}

/// Results of both weightings of eq. 9 on the disassembled robot.
pub struct Table1 {
    /// Solution with the weighting Σ⁻¹.
    pub solution: Solution,
    /// Largest difference to the weighting by the largest torques, relative to each value.
    pub difference: f64,
    /// All estimates with the twin's and the paper's values.
    pub rows: Vec<Row>,
}

/// Base parameters of the arms and of drive 4.
///
/// # Errors
/// If a pose of the recording is impossible for the model's geometry.
pub fn identify(model: &Model, excitation: &Run, sigma: &PerAxis<f64>) -> miette::Result<Table1> {
    let (stack, axes) = Stack::new(model, &Dataset::new(&excitation.recording)).into_diagnostic()?.by_axis();
    let solution = stack.solve(sigma);
    let by_torque = stack.solve(&model.drives.map(|d| d.max_torque));
    let size = |v: f64| v.abs().max(f64::MIN_POSITIVE);
    let difference =
        solution.values.iter().zip(&by_torque.values).map(|(a, b)| (a - b).abs() / size(*a)).fold(0.0, f64::max);
    let friction = model.effects.iter().find(|a| a.effect.name() == "drive_friction");
    let mut rows = Vec::new();
    for (k, &axis) in axes.iter().enumerate() {
        let name = &stack.parameters[k].name;
        let arm = &model.bodies[bodies::arm(axis.min(TELESCOPE_AXIS - 1))];
        let of_drive = |block: usize| friction.map_or(0.0, |f| f.values().block(block)[axis]);
        let (symbol, truth, printed) = if name.contains("first_moment_x") {
            ("m c_x", arm.first_moment.x, table_1::FIRST_MOMENT_X[axis])
        } else if name.contains("first_moment_z") {
            ("m c_z", arm.first_moment.z, table_1::FIRST_MOMENT_Z[axis])
        } else if name.contains("rotor") {
            ("C_M i_G²", model.bodies[ROTOR].tensor[(2, 2)], table_1::ROTOR_INERTIA)
        } else if name.contains("inertia_yy") {
            ("Θ_yy", arm.tensor[(1, 1)], table_1::INERTIA_YY[axis])
        } else if name.contains("coulomb") {
            ("p_C", of_drive(0), table_1::COULOMB[axis])
        } else {
            ("p_v", of_drive(1), table_1::VISCOUS[axis])
        };
        let what = if axis < TELESCOPE_AXIS { format!("arm {}", axis + 1) } else { format!("drive {}", axis + 1) };
        let ours = Estimate::new(solution.values[k], solution.std[k]);
        rows.push(Row::new(format!("{what}: {symbol}"), stack.parameters[k].unit, ours).truth(truth).paper(printed));
    }
    Ok(Table1 { solution, difference, rows })
}

impl Table1 {
    /// Estimate of the parameter `symbol` of an axis.
    pub fn value(&self, axis: usize, symbol: &str) -> Option<Estimate> {
        let place = format!("{} {}: {symbol}", if axis < TELESCOPE_AXIS { "arm" } else { "drive" }, axis + 1);
        self.rows.iter().find(|r| r.quantity == place).and_then(|r| r.ours[0])
    }

    /// Section on Table 1.
    pub fn section(&self) -> Section {
        let table = Comparison::new("identified", self.rows.clone());
        let agreement = format!(
            "{} They agree with the paper by construction: the twin's arms and drives were given the paper's Table 1, so \
             this shows that the chain of encoder quantisation, differentiation and least squares gives back what went \
             in. Weighting by the largest torques instead of Σ⁻¹ changes no parameter by more than {:.0e} of its value \
             (paper: in the order of {:.0e}), because the axes share no parameter and a factor on the rows of one axis \
             cancels.",
            table.hits(0),
            self.difference,
            table_1::DIFFERENCE
        );
        Section {
            key: "table_1",
            title: "Table 1: base parameters of the disassembled robot".into(),
            text:
                "Weighted least squares (eq. 9) with Σ⁻¹ on one excitation, all parameters at once, every arm with its \
                   own (eq. 46–47). Θ_yy contains the rotor and gear of the drive."
                    .into(),
            tables: vec![table],
            plots: Vec::new(),
            agreement,
        }
    }

    /// Section on Fig. 8: measured and computed torques of another motion.
    ///
    /// # Errors
    /// If a pose of the recording is impossible for the model's geometry.
    pub fn verification(&self, model: &Model, run: &Run) -> miette::Result<Section> {
        let dataset = Dataset::new(&run.recording);
        let (stack, _) = Stack::new(model, &dataset).into_diagnostic()?.by_axis();
        let computed = stack.torques(&self.solution.values);
        let rms = Residuals::of(&dataset, &computed).rms;
        let rows = every_axis()
            .map(|i| {
                Row::new(format!("e_rms of axis {}", i + 1), "N·m", Estimate::plain(rms[i]))
                    .truth(model.noise.torque[i])
            })
            .collect();
        let figure =
            measured_and_computed("Verification of the disassembled robot", &dataset, &[("computed", &computed)]);
        Ok(Section {
            key: "figure_8",
            title: "Fig. 8: verification of the disassembled robot".into(),
            text: "A motion that was not used for the fit. The twin's truth is the standard deviation of its torque noise, \
                   below which no model can come."
                .into(),
            tables: vec![Comparison::new("on the verification motion", rows)],
            plots: vec![Plot {
                name: "figure-8",
                figure,
                caption: "Measured and computed torques of the three arms and of drive 4.".into(),
            }],
            agreement: "The paper shows the curves without a number. Here what is left is sensor noise, as the model has \
                        the structure of the twin."
                .into(),
        })
    }
}

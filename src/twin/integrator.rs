//! One-step integrators for a flat state: the classical Runge–Kutta method and a Rosenbrock W-method.
//!
//! Stages: (1 − hγW) k_i = f(y_i) + W·h Σ_j γ_ij k_j, y_i = y + h Σ_j α_ij k_j; y ← y + h Σ b_i k_i. The order of a
//! W-method does not depend on W. W therefore contains the stiff terms only: damping of drives and spins, elastic
//! struts, stiff internal states. With W = 0 and γ = 0 the same loop is an explicit Runge–Kutta method.

use super::SingularPose;
use crate::numerics::worst;

/// Largest number of stages.
const STAGES: usize = 4;

type Table = [[f64; STAGES]; STAGES];

/// Coefficients of a method.
pub(super) struct Tableau {
    pub gamma: f64,
    alpha: Table,
    gammas: Table,
    b: [f64; STAGES],
    /// Weights of the embedded solution, one order lower; without them no error is estimated.
    embedded: Option<[f64; STAGES]>,
}

/// Classical Runge–Kutta method of order 4.
pub(super) static RK4: Tableau = Tableau {
    gamma: 0.0,
    alpha: [[0.0; 4], [0.5, 0.0, 0.0, 0.0], [0.0, 0.5, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
    gammas: [[0.0; 4]; 4],
    b: [1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0],
    embedded: None,
};

/// ROS34PW2 of [Rang 2005]: order 3 for any W, stiffly accurate, L-stable for the exact Jacobian.
pub(super) static ROS34PW2: Tableau = Tableau {
    gamma: 4.358_665_215_084_59e-1,
    alpha: [
        [0.0; 4],
        [8.717_330_430_169_18e-1, 0.0, 0.0, 0.0],
        [8.445_706_001_536_942e-1, -1.129_906_423_648_418_5e-1, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0],
    ],
    gammas: [
        [0.0; 4],
        [-8.717_330_430_169_18e-1, 0.0, 0.0, 0.0],
        [-9.033_805_701_304_408e-1, 5.418_067_238_809_532_6e-2, 0.0, 0.0],
        [2.421_238_070_609_534_6e-1, -1.223_250_583_904_514_7, 5.452_602_553_351_021e-1, 0.0],
    ],
    b: [2.421_238_070_609_534_6e-1, -1.223_250_583_904_514_7, 1.545_260_255_335_102, 4.358_665_215_084_59e-1],
    embedded: Some([3.781_090_314_581_937e-1, -9.604_229_221_242_318e-2, 0.5, 2.179_332_607_542_295e-1]),
};

/// A stage of a step: (1 − hγW) k = f(t, y) + W·s, with s = h Σ γ_ij k_j.
#[derive(Clone, Copy)]
pub(super) struct Stage<'a> {
    /// Time, s.
    pub t: f64,
    /// State.
    pub y: &'a [f64],
    /// s.
    pub sum: &'a [f64],
    /// hγ, s; zero for an explicit method.
    pub g: f64,
    /// Whether it is the first stage of its step, at which W is determined.
    pub first: bool,
}

/// System of differential equations to be integrated.
pub(super) trait System {
    /// Writes the stage derivative k.
    fn stage(&mut self, stage: &Stage, k: &mut [f64]) -> Result<(), SingularPose>;

    /// Projects a state onto the constraints.
    fn project(&mut self, y: &mut [f64]) -> Result<(), SingularPose>;
}

/// Buffers of a method for states of a given length.
pub(super) struct Stepper {
    k: [Vec<f64>; STAGES],
    y: Vec<f64>,
    sum: Vec<f64>,
}

impl Stepper {
    pub fn new(length: usize) -> Self {
        let zeros = || vec![0.0; length];
        Self { k: std::array::from_fn(|_| zeros()), y: zeros(), sum: zeros() }
    }

    /// Advances `y` from `t` by `h`. On an error `y` is unchanged.
    pub fn step(
        &mut self,
        tableau: &Tableau,
        system: &mut dyn System,
        t: f64,
        y: &mut [f64],
        h: f64,
    ) -> Result<(), SingularPose> {
        for i in 0..STAGES {
            let (done, rest) = self.k.split_at_mut(i);
            combine(&mut self.y, y, done, &tableau.alpha[i], h);
            if tableau.gamma != 0.0 {
                self.sum.fill(0.0);
                accumulate(&mut self.sum, done, &tableau.gammas[i], h);
            }
            let stage = Stage {
                t: t + h * tableau.alpha[i].iter().sum::<f64>(),
                y: &self.y,
                sum: &self.sum,
                g: h * tableau.gamma,
                first: i == 0,
            };
            system.stage(&stage, &mut rest[0])?;
        }
        combine(&mut self.y, y, &self.k, &tableau.b, h);
        system.project(&mut self.y)?;
        y.copy_from_slice(&self.y);
        Ok(())
    }
}

impl Stepper {
    /// Largest error of the first `count` entries of the state in the last step, of `h` s with `tableau`: the
    /// difference of the embedded solution, in the units of the state; NaN if one is. Zero for a method without one.
    pub fn error(&self, tableau: &Tableau, h: f64, count: usize) -> f64 {
        let Some(embedded) = &tableau.embedded else { return 0.0 };
        let [a, b, c, d] = std::array::from_fn(|i| h * (tableau.b[i] - embedded[i]));
        let [first, second, third, fourth] = &self.k;
        (0..count).map(|at| a * first[at] + b * second[at] + c * third[at] + d * fourth[at]).fold(0.0, worst)
    }
}

fn combine(out: &mut [f64], y: &[f64], k: &[Vec<f64>], weights: &[f64; STAGES], h: f64) {
    out.copy_from_slice(y);
    accumulate(out, k, weights, h);
}

/// out += h·Σ w·k over the weights other than zero.
fn accumulate(out: &mut [f64], k: &[Vec<f64>], weights: &[f64; STAGES], h: f64) {
    let n = out.len();
    let (mut factors, mut terms, mut count) = ([0.0; STAGES], [&[][..]; STAGES], 0);
    for (k, w) in k.iter().zip(weights).filter(|(_, w)| **w != 0.0) {
        (factors[count], terms[count]) = (h * w, &k[..n]);
        count += 1;
    }
    let ([a, b, c, d], [ka, kb, kc, kd]) = (factors, terms);
    match count {
        0 => {}
        1 => (0..n).for_each(|i| out[i] += a * ka[i]),
        2 => (0..n).for_each(|i| out[i] = out[i] + a * ka[i] + b * kb[i]),
        3 => (0..n).for_each(|i| out[i] = out[i] + a * ka[i] + b * kb[i] + c * kc[i]),
        _ => (0..n).for_each(|i| out[i] = out[i] + a * ka[i] + b * kb[i] + c * kc[i] + d * kd[i]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tableau_fulfils_the_order_conditions_of_a_w_method() {
        let Tableau { gamma, alpha, gammas, b, embedded } = &ROS34PW2;
        let times = |m: &Table, diagonal: f64, x: &[f64; STAGES]| -> [f64; STAGES] {
            std::array::from_fn(|i| (0..STAGES).map(|j| m[i][j] * x[j]).sum::<f64>() + diagonal * x[i])
        };
        let weigh = |x: &[f64; STAGES]| (0..STAGES).map(|i| b[i] * x[i]).sum::<f64>();
        let one = [1.0; STAGES];
        let a = times(alpha, 0.0, &one);
        let g = times(gammas, *gamma, &one);
        let square = std::array::from_fn(|i| a[i] * a[i]);
        // Order 1, 2, 3 for exact and for arbitrary Jacobians.
        for (got, want) in [
            (weigh(&one), 1.0),
            (weigh(&a), 0.5),
            (weigh(&g), 0.0),
            (weigh(&square), 1.0 / 3.0),
            (weigh(&times(alpha, 0.0, &a)), 1.0 / 6.0),
            (weigh(&times(alpha, 0.0, &g)), 0.0),
            (weigh(&times(gammas, *gamma, &a)), 0.0),
            (weigh(&times(gammas, *gamma, &g)), 0.0),
        ] {
            approx::assert_abs_diff_eq!(got, want, epsilon = 1e-13);
        }
        // The embedded solution is of order 2 for any W.
        let weigh = |x: &[f64; STAGES]| (0..STAGES).map(|i| embedded.expect("weights")[i] * x[i]).sum::<f64>();
        for (got, want) in [(weigh(&one), 1.0), (weigh(&a), 0.5), (weigh(&g), 0.0)] {
            approx::assert_abs_diff_eq!(got, want, epsilon = 1e-13);
        }
    }

    /// Damped oscillator ÿ = −(K + k)·y − (D + d)·ẏ with W for K and D only.
    struct Oscillator {
        steep: (f64, f64),
        rest: (f64, f64),
    }

    impl System for Oscillator {
        fn stage(&mut self, stage: &Stage, k: &mut [f64]) -> Result<(), SingularPose> {
            let Stage { y, sum, g, .. } = *stage;
            let ((ks, ds), (kr, dr)) = (self.steep, self.rest);
            let f = -(ks + kr) * y[0] - (ds + dr) * y[1];
            // k0 = y1 + sum1 + g k1, k1 = f − ks (sum0 + g k0) − ds (sum1 + g k1)
            let base = y[1] + sum[1];
            k[1] = (f - ks * (sum[0] + g * base) - ds * sum[1]) / (1.0 + g * ds + g * g * ks);
            k[0] = base + g * k[1];
            Ok(())
        }

        fn project(&mut self, _: &mut [f64]) -> Result<(), SingularPose> {
            Ok(())
        }
    }

    fn oscillate(tableau: &Tableau, system: &mut Oscillator, h: f64) -> f64 {
        let mut stepper = Stepper::new(2);
        let mut y = [1.0, 0.0];
        for i in 0..(1.0 / h).round() as usize {
            stepper.step(tableau, system, i as f64 * h, &mut y, h).unwrap();
        }
        y[0]
    }

    #[test]
    fn orders_are_three_and_four_against_the_closed_form() {
        // ω = 20 rad/s, damping 4 1/s: y = e^(−2t)(cos νt + 2/ν sin νt), ν = √(400 − 4)
        let nu = 396f64.sqrt();
        let exact = (-2f64).exp() * (nu.cos() + 2.0 / nu * nu.sin());
        let order = |tableau: &Tableau, split: ((f64, f64), (f64, f64))| {
            let mut system = Oscillator { steep: split.0, rest: split.1 };
            let e: Vec<f64> =
                [0.001_25, 0.000_625].iter().map(|&h| (oscillate(tableau, &mut system, h) - exact).abs()).collect();
            (e[0] / e[1]).log2()
        };
        let explicit = order(&RK4, ((0.0, 0.0), (400.0, 4.0)));
        let whole = order(&ROS34PW2, ((400.0, 4.0), (0.0, 0.0)));
        let partial = order(&ROS34PW2, ((150.0, 1.0), (250.0, 3.0)));
        assert!(
            (explicit - 4.0).abs() < 0.1 && (whole - 3.0).abs() < 0.1 && (partial - 3.0).abs() < 0.2,
            "{explicit} {whole} {partial}"
        );
    }

    #[test]
    fn a_rate_that_is_not_a_number_is_an_error_that_is_not_one() {
        for rest in [(250.0, 3.0), (f64::NAN, 3.0)] {
            let mut system = Oscillator { steep: (150.0, 1.0), rest };
            let mut stepper = Stepper::new(2);
            stepper.step(&ROS34PW2, &mut system, 0.0, &mut [1.0, 0.0], 1e-3).unwrap();
            let error = stepper.error(&ROS34PW2, 1e-3, 2);
            assert_eq!(error.is_nan(), rest.0.is_nan(), "{error}");
        }
        // Finite entries after the one that is not a number do not hide it.
        let mut stepper = Stepper::new(3);
        stepper.k[1] = vec![1.0, f64::NAN, 1.0];
        assert!(stepper.error(&ROS34PW2, 1e-3, 3).is_nan() && stepper.error(&ROS34PW2, 1e-3, 1) > 0.0);
    }

    #[test]
    fn steep_part_may_exceed_the_step_by_far() {
        let mut system = Oscillator { steep: (1e10, 1e6), rest: (0.0, 0.0) };
        assert!(oscillate(&ROS34PW2, &mut system, 0.01).abs() < 1.0);
    }
}

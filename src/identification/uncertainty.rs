//! Joint uncertainty of the parameters of a fitted model, and machines drawn from it.

use nalgebra::{DMatrix, DVector};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use thiserror::Error;

use super::Fit;
use super::fit::nominal_size;
use crate::dynamics::{Plant, set_parameters};
use crate::machine::Setup;
use crate::machine::bodies::SLOTS;
use crate::model::Model;

/// Estimated parameters with their covariance, in natural units.
#[derive(Clone, Debug, PartialEq)]
pub struct Uncertainty {
    /// Printed names of the parameters.
    pub names: Vec<String>,
    /// Covariance, in the order of `names`.
    pub covariance: DMatrix<f64>,
}

/// A parameter that the model does not have.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("the model has no parameter `{0}`, whose covariance is given")]
pub struct UnknownParameter(pub String);

/// Halvings of a body's deviation before it is left where it was.
const HALVINGS: i32 = 8;

impl Uncertainty {
    /// Uncertainty of a fit.
    pub fn of(fit: &Fit) -> Self {
        Self { names: fit.parameters.iter().map(|p| p.name.clone()).collect(), covariance: fit.covariance.clone() }
    }

    /// The machine number `number` of those that agree with the fit; number 0 is `model` itself.
    ///
    /// p = p̂ + Σ √λ_k·z_k·v_k with eigenvalues and eigenvectors of the covariance in units of the parameters' own sizes,
    /// and z standard normal. Directions with a standard deviation above the parameters' own size are not determined by
    /// the data and stay as they are. Values are cut off at the ends of their laws' ranges. The deviation of a body that
    /// would be physically inconsistent is halved until it is not.
    ///
    /// # Errors
    /// If a parameter is not in the model.
    ///
    /// # Panics
    /// If the covariance does not have a row and a column for every name.
    pub fn draw(&self, model: &Model, number: u64) -> Result<Model, UnknownParameter> {
        let all = Plant::new(model, &Setup::default()).parameters();
        let find = |name: &String| all.named(name).ok_or_else(|| UnknownParameter(name.clone()));
        let places = self.names.iter().map(find).collect::<Result<Vec<_>, _>>()?;
        if number == 0 {
            return Ok(model.clone());
        }
        let sizes: Vec<f64> = places.iter().map(|&k| nominal_size(&all[k])).collect();
        let deviation = self.deviation(&sizes, &mut ChaCha8Rng::seed_from_u64(number));
        let mut values = all.values();
        for ((&k, size), own) in places.iter().zip(&sizes).zip(&deviation) {
            let (low, high) = all[k].range;
            values[k] = (values[k] + size * own).clamp(low.min(values[k]), high.max(values[k]));
        }
        let mut drawn = model.clone();
        set_parameters(&mut drawn, &values);
        for body in 0..SLOTS {
            let (here, there) = (model.bodies[body], drawn.bodies[body]);
            let floor = here.min_eigenvalue().min(0.0);
            let between = |share: f64| {
                let mut sum = here * (1.0 - share);
                sum += there * share;
                sum
            };
            let mut shares = (0..=HALVINGS).map(|k| 0.5f64.powi(k));
            let share = shares.find(|&share| between(share).min_eigenvalue() >= floor);
            drawn.bodies[body] = match share {
                Some(1.0) => there,
                share => between(share.unwrap_or(0.0)),
            };
        }
        Ok(drawn)
    }

    /// A deviation in units of `sizes`.
    fn deviation(&self, sizes: &[f64], rng: &mut ChaCha8Rng) -> DVector<f64> {
        let n = self.names.len();
        let scaled = DMatrix::from_fn(n, n, |i, j| {
            0.5 * (self.covariance[(i, j)] + self.covariance[(j, i)]) / (sizes[i] * sizes[j])
        });
        let eigen = scaled.symmetric_eigen();
        let mut sum = DVector::zeros(n);
        for (lambda, direction) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
            let z: f64 = StandardNormal.sample(rng);
            if (0.0..1.0).contains(lambda) {
                sum.axpy(lambda.sqrt() * z, &direction, 1.0);
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::testing::irb360;

    fn friction() -> (Model, Uncertainty) {
        let model = irb360();
        let names = ["drive_friction.viscous_1", "drive_friction.viscous_2", "drive_friction.coulomb_1"];
        // Correlation −0.8 between the first and the third; the second is not determined at all.
        let covariance = DMatrix::from_row_slice(3, 3, &[4e-4, 0.0, -8e-4, 0.0, 1e4, 0.0, -8e-4, 0.0, 2.5e-3]);
        (model, Uncertainty { names: names.map(String::from).to_vec(), covariance })
    }

    #[test]
    fn machines_have_the_covariance_that_they_are_drawn_from() {
        let (model, uncertainty) = friction();
        const COUNT: u64 = 4000;
        let values = |model: &Model| {
            let all = Plant::new(model, &Setup::default()).parameters();
            DVector::from_iterator(3, uncertainty.names.iter().map(|name| all[all.named(name).unwrap()].value))
        };
        let start = values(&model);
        let draws: Vec<_> = (1..=COUNT).map(|k| values(&uncertainty.draw(&model, k).unwrap()) - &start).collect();
        let mean = draws.iter().sum::<DVector<f64>>() / COUNT as f64;
        let scatter = draws.iter().map(|d| d * d.transpose()).sum::<DMatrix<f64>>() / COUNT as f64;
        // Five standard errors of mean, variance and covariance.
        let error = 5.0 / (COUNT as f64).sqrt();
        for (i, sigma) in [(0, 0.02), (2, 0.05)] {
            assert!(mean[i].abs() < error * sigma, "{mean}");
            assert!((scatter[(i, i)] / (sigma * sigma) - 1.0).abs() < error * 2f64.sqrt(), "{scatter}");
        }
        assert!((scatter[(0, 2)] / 1e-3 + 0.8).abs() < error * (1.0 + 0.64f64).sqrt(), "{scatter}");
        assert_eq!((mean[1], scatter[(1, 1)]), (0.0, 0.0));
    }

    #[test]
    fn a_machine_depends_on_its_number_alone_and_is_possible() {
        let (model, mut uncertainty) = friction();
        let values = |model: &Model| Plant::new(model, &Setup::default()).parameters().values();
        let numbered = |number: u64| values(&uncertainty.draw(&model, number).unwrap());
        assert_eq!(numbered(0), values(&model));
        assert_eq!(numbered(7), numbered(7));
        assert_ne!(numbered(7), numbered(8));
        // All inertial parameters uncertain by half of their size.
        let all = Plant::new(&model, &Setup::default()).parameters();
        uncertainty.names = all.iter().map(|p| p.name.clone()).collect();
        let sizes = DVector::from_iterator(all.len(), all.iter().map(nominal_size));
        uncertainty.covariance = DMatrix::from_diagonal(&(&sizes * 0.5).component_mul(&(&sizes * 0.5)));
        for number in 1..40 {
            let drawn = uncertainty.draw(&model, number).unwrap();
            for body in 0..SLOTS {
                let least = model.bodies[body].min_eigenvalue().min(0.0);
                assert!(drawn.bodies[body].min_eigenvalue() >= least - 1e-15, "body {body} of machine {number}");
            }
        }
        uncertainty.names[0] = "nothing".into();
        assert_eq!(uncertainty.draw(&model, 1).err(), Some(UnknownParameter("nothing".into())));
    }
}

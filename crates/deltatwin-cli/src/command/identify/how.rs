//! Options of `deltatwin identify` for the fit.

use std::path::PathBuf;

use crate::data::positive;
use deltatwin::identification::Method;
use deltatwin::identification::estimator::PRIOR_INFORMATION;
use deltatwin::identification::fit::{Consistency, Options, Weighing};
use deltatwin::identification::regularisation::GroupWeight;
use deltatwin::machine::{BodyParameters, LinkParameters};
use deltatwin::model::Model;

/// How to fit.
#[derive(clap::Args, Clone, Debug)]
pub struct How {
    /// What the rows of the regression are weighed with.
    #[arg(long, value_enum, default_value_t)]
    weighing: Weights,
    /// Let outliers count less (Huber's loss).
    #[arg(long)]
    robust: bool,
    /// Way to physically consistent parameters; both lead to the same ones.
    #[arg(long, value_enum, default_value_t)]
    method: Programme,
    /// Model whose parameters are the regularisation values, instead of MODEL itself.
    #[arg(long, value_name = "MODEL")]
    prior: Option<PathBuf>,
    /// Weight of the regularisation: information per parameter, in units of its own size; 1 trusts the prior as much as a
    /// measurement of the parameter with 100 % error.
    #[arg(long, value_name = "GAMMA", default_value_t = PRIOR_INFORMATION, value_parser = positive)]
    regularisation: f64,
    /// Weight γ of one group (eq. 10) instead of that of --regularisation; may be given several times. GROUP is `torque`
    /// (γ_τ, with the mean over the samples in place of the sum), `bodies`, `friction` (all but the bodies), a kind of body
    /// such as `arm`, or an effect.
    #[arg(long, value_name = "GROUP=GAMMA", value_parser = group_weight)]
    gamma: Vec<GroupWeight>,
    /// Effect whose parameters stay as they are (`rigid_bodies` for the links); may be given several times.
    #[arg(long, value_name = "EFFECT")]
    hold: Vec<String>,
    /// Whether the limbs of the assembled robot have the same parameters [default: as the model's `limbs` says, alike].
    #[arg(long, value_enum)]
    limbs: Option<Limbs>,
    /// How many of its ten inertial parameters each link of the assembled robot has.
    #[arg(long, value_enum, default_value_t = Bodies::Symmetric)]
    bodies: Bodies,
    /// How rates and accelerations come from the angles.
    #[arg(long, value_enum, default_value_t = Derivatives::Reversals)]
    derivatives: Derivatives,
}

/// What the rows of the regression are weighed with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Weights {
    /// Noise of the channels: W = Σ⁻¹.
    #[default]
    Noise,
    /// Largest measured value of the channels: W = diag(max |τ|)⁻².
    Maximum,
}

impl From<Weights> for Weighing {
    fn from(chosen: Weights) -> Self {
        match chosen {
            Weights::Noise => Self::Noise,
            Weights::Maximum => Self::Maximum,
        }
    }
}

/// Ways to physically consistent parameters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Programme {
    /// Convex programme with second-order cones, and log-Cholesky where its solver proves none.
    #[default]
    Cones,
    /// Log-Cholesky variables, in which every value is possible.
    LogCholesky,
}

impl From<Programme> for Consistency {
    fn from(chosen: Programme) -> Self {
        match chosen {
            Programme::Cones => Self::Cones,
            Programme::LogCholesky => Self::LogCholesky,
        }
    }
}

/// Limbs of the assembled robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Limbs {
    /// One set of parameters for all.
    Alike,
    /// A set for each.
    #[value(alias = "each")]
    Own,
}

/// Inertial parameters of the links.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Bodies {
    /// The paper's 18 variables: symmetric, and only what enters.
    Symmetric,
    /// Mass, first moments and moments of inertia.
    Aligned,
    /// All ten, deviation moments included.
    Complete,
}

/// Ways to derivatives.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Derivatives {
    /// Forward difference, and a differentiating filter run forward and backward (Gnad et al. section 6.1).
    Paper,
    /// Local polynomials.
    Polynomial,
    /// Smoother, everywhere as smooth.
    Smoother,
    /// Smoother whose acceleration may jump at reversals.
    Reversals,
}

impl How {
    /// Options of a fit.
    pub fn options<'a>(&'a self, prior: Option<&'a Model>) -> Options<'a> {
        Options {
            weighing: self.weighing.into(),
            robust: self.robust,
            consistency: self.method.into(),
            prior,
            prior_information: Some(self.regularisation),
            weights: &self.gamma,
            fixed: &self.hold,
            ..Options::default()
        }
    }

    /// The model of `--prior`, with the same parametrisation as `model`.
    pub fn prior(&self, model: &Model) -> miette::Result<Option<Model>> {
        let Some(path) = &self.prior else { return Ok(None) };
        Ok(Some(Model { link_parameters: model.link_parameters, ..deltatwin_io::model::read(path)? }))
    }

    /// Effects that are fixed.
    pub fn fixed(&self) -> &[String] {
        &self.hold
    }

    /// Parametrisation of the links of `model`.
    pub fn links(&self, model: &Model) -> LinkParameters {
        let bodies = match self.bodies {
            Bodies::Symmetric => BodyParameters::Symmetric,
            Bodies::Aligned => BodyParameters::Aligned,
            Bodies::Complete => BodyParameters::Complete,
        };
        let each_limb = self.limbs.map_or(model.link_parameters.each_limb, |limbs| limbs == Limbs::Own);
        LinkParameters { each_limb, bodies }
    }

    /// Method of differentiation.
    pub fn method(&self) -> Method {
        match self.derivatives {
            Derivatives::Paper => Method::Paper,
            Derivatives::Polynomial => Method::Polynomial,
            Derivatives::Smoother => Method::Smoother,
            Derivatives::Reversals => Method::Reversals,
        }
    }
}

fn group_weight(text: &str) -> Result<GroupWeight, String> {
    let Some((group, weight)) = text.split_once('=') else {
        return Err("expected GROUP=GAMMA, such as friction=0.1".into());
    };
    Ok(GroupWeight { group: group.trim().into(), weight: positive(weight.trim())? })
}

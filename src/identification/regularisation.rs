//! Weights γ of the regularisation (eq. 10), one per group of parameters.
//!
//! J = γ_τ/n_s·‖τ − Yp‖²_W + Σ γ_reg,j·d(p_j, p_reg,j) + γ_reg,f·‖p_f − p_reg,f‖². The estimate depends on ratios of
//! the weights only, so the rows keep their weight W and every γ_reg is replaced by γ_reg·n_s/γ_τ; without γ_τ the
//! sum over the rows is not divided, γ_τ = n_s. Distances are those of eq. 11, relative to a parameter's own size,
//! also for friction.

use super::fit::FitError;
use crate::dynamics::PlantParameter;
use crate::effects::rigid_bodies;

/// A weight γ of a group of parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct GroupWeight {
    /// Group: [`TORQUE`], [`BODIES`], [`FRICTION`], a kind of body (`arm`) or an effect.
    pub group: String,
    /// γ, positive.
    pub weight: f64,
}

/// Group of the rows of the regression.
pub const TORQUE: &str = "torque";
/// Group of the inertia parameters of all links.
pub const BODIES: &str = "bodies";
/// Group of all other parameters.
pub const FRICTION: &str = "friction";

/// Kinds of bodies: prefixes of the parameters of the links.
const KINDS: [&str; 6] = ["arm", "strut", "platform", "telescope_upper", "telescope_lower", "rotor"];

/// γ·n_s/γ_τ of every parameter: the last given weight of a group that it belongs to, else `information`.
///
/// # Errors
/// If a weight refers to a group without parameters.
pub fn weights(
    parameters: &[PlantParameter],
    information: f64,
    given: &[GroupWeight],
    samples: usize,
) -> Result<Vec<f64>, FitError> {
    for one in given.iter().filter(|g| g.group != TORQUE) {
        if !parameters.iter().any(|p| belongs(p, &one.group)) {
            return Err(FitError::NoSuchGroup { group: one.group.clone(), known: groups(parameters).join(", ") });
        }
    }
    let torque = given.iter().rfind(|g| g.group == TORQUE).map_or(1.0, |g| samples as f64 / g.weight);
    let own = |p: &PlantParameter| given.iter().rfind(|g| belongs(p, &g.group)).map_or(information, |g| g.weight);
    Ok(parameters.iter().map(|p| own(p) * torque).collect())
}

fn belongs(p: &PlantParameter, group: &str) -> bool {
    let link = p.param.effect == rigid_bodies::NAME;
    let kind = || p.name.strip_prefix(rigid_bodies::NAME)?.strip_prefix('.')?.strip_prefix(group)?.chars().next();
    p.param.effect == group
        || (group == BODIES && link)
        || (group == FRICTION && !link)
        || (link && KINDS.contains(&group) && kind() == Some('_'))
}

/// Groups with at least one parameter.
fn groups(parameters: &[PlantParameter]) -> Vec<&str> {
    let mut all: Vec<&str> = KINDS.into_iter().filter(|kind| parameters.iter().any(|p| belongs(p, kind))).collect();
    for p in parameters {
        if !all.contains(&p.param.effect) {
            all.push(p.param.effect);
        }
    }
    all
}

//! Axial elasticity of the struts and their sockets.

use super::{About, Compliance, Count, Effect, Parameter, Part, Role, Spec, Unit, Values};
use crate::machine::PerStrut;

/// Axial spring and damper in each strut: T = Δl/c + d·Δl̇ (N), tension positive, Δl (m) the elongation.
///
/// c in m/N per limb (both struts equal), d in N·s/m; c ≤ 1e-10 m/N counts as rigid. Represents rod and both sockets.
///
/// Only the twin implements it, because the platform's motion then no longer follows from the joint angles. Inverse
/// dynamics along a measured joint motion treats the struts as rigid (deflections of 15 µm per 50 N), so that the
/// effect is neither diagnosed nor identified.
pub struct StrutElasticity;

const COMPLIANCE: usize = 0;
const DAMPING: usize = 1;

/// Compliance up to which a strut counts as rigid, m/N.
const RIGID: f64 = 1e-10;

/// An elastic strut: T = stiffness · elongation + damping · elongation rate.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StrutSpring {
    /// Stiffness, N/m.
    pub stiffness: f64,
    /// Damping, N·s/m.
    pub damping: f64,
}

const PARAMETERS: &[Parameter] = &[
    Parameter::new("compliance", Unit::MPerN, Role::Linear, 1.0 / 3.4e6, (0.0, 2e-6)).counted(Count::PerLimb),
    Parameter::new("damping", Unit::NSPerM, Role::Fixed, 300.0, (0.0, 1e5)),
];

static SPEC: Spec = Spec::new(
    "strut_elasticity",
    Part::Linkage,
    About {
        summary: "axial compliance of the struts with their sockets (twin only)",
        law: "T = Δl/c + d·dΔl/dt in each strut, tension positive",
        shows: "vibration of the platform against the arms above 50 Hz, lag of the platform under acceleration",
        source: "E·A/l of a carbon tube 16/14 mm, 5.1e6 N/m at 120 GPa, in series with two sockets of 2e7: 3.4e6 N/m \
                     (2.3e6–5e6, estimate); d: about a tenth of critical for 0.4 kg per strut",
    },
    PARAMETERS,
)
.twin_only();

impl Effect for StrutElasticity {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn compliance(&self) -> Option<&dyn Compliance> {
        Some(self)
    }
}

impl Compliance for StrutElasticity {
    fn strut_spring(&self, values: &Values) -> Option<PerStrut<StrutSpring>> {
        let compliance = values.block(COMPLIANCE);
        // A rigid limb among elastic ones gets the largest stiffness that the law allows.
        let spring = |s: usize| StrutSpring {
            stiffness: 1.0 / compliance.get(s / 2).map_or(RIGID, |c| c.max(RIGID)),
            damping: values.one(DAMPING),
        };
        compliance.iter().any(|c| *c > RIGID).then(|| std::array::from_fn(spring))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::ActiveEffect;

    #[test]
    fn stiffness_is_the_inverse_of_compliance() {
        // 0.25 µm/N: 4e6 N/m; 34 N stretch it by 8.5 µm.
        let active = ActiveEffect::new(Arc::new(StrutElasticity), &[&[2.5e-7, 5e-7, 2.5e-7], &[300.0]]);
        let springs = StrutElasticity.strut_spring(&active.values()).unwrap();
        approx::assert_relative_eq!(springs[1].stiffness, 4e6);
        approx::assert_relative_eq!(springs[2].stiffness, 2e6);
        approx::assert_relative_eq!(34.0 / springs[0].stiffness, 8.5e-6);
        assert_eq!(springs[5].damping, 300.0);
    }

    #[test]
    fn without_compliance_struts_are_rigid() {
        assert_eq!(StrutElasticity.strut_spring(&ActiveEffect::absent(Arc::new(StrutElasticity)).values()), None);
    }
}

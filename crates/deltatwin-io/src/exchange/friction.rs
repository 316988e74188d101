//! Friction in the joints, as far as other programs have its laws.

use deltatwin::effects::{ActiveEffect, Kind};
use deltatwin::machine::PerAxis;
use deltatwin::model::Model;

/// Friction of a joint: −c·sign(v) − d·v.
#[derive(Clone, Copy, Default)]
pub(super) struct Friction {
    /// c, N·m or N.
    pub coulomb: f64,
    /// d, N·m·s/rad or N·s/m.
    pub viscous: f64,
}

/// Friction of all joints that have any.
#[derive(Default)]
pub(super) struct Frictions {
    /// At the drives.
    pub drives: PerAxis<Friction>,
    /// In the telescope's sliding joint.
    pub telescope: Friction,
    /// About each cross axis of the telescope's Hooke joints.
    pub hooke: Friction,
}

impl Frictions {
    /// The friction of a model, and a sentence for every effect that is left out or changed.
    pub fn of(model: &Model) -> (Self, Vec<String>) {
        let (mut own, mut left_out) = (Self::default(), Vec::new());
        for effect in &model.effects {
            let get = |name: &str| block(effect, name);
            let both = |axis: usize| {
                let at = |values: &[f64]| values.get(axis).copied().unwrap_or(0.0);
                Friction { coulomb: at(get("coulomb")), viscous: at(get("viscous")) }
            };
            match effect.effect.name() {
                "drive_friction" => own.drives = std::array::from_fn(|axis| own.drives[axis].plus(both(axis))),
                "telescope_friction" => own.telescope = both(0),
                "hooke_friction" => own.hooke = both(0),
                "axis4_friction" => {
                    own.drives[3] = own.drives[3].plus(Friction { viscous: 0.0, ..both(0) });
                    left_out.push("axis4_friction: without the part that saturates with speed".into());
                }
                _ if matches!(effect.effect.kind(), Kind::Inertia | Kind::Geometry) => {}
                name => left_out.push(format!("{name}: no joint, link or drive of the format has this law")),
            }
        }
        (own, left_out)
    }
}

impl Friction {
    fn plus(self, other: Self) -> Self {
        Self { coulomb: self.coulomb + other.coulomb, viscous: self.viscous + other.viscous }
    }

    /// Whether there is none.
    pub fn is_none(self) -> bool {
        self.coulomb == 0.0 && self.viscous == 0.0
    }
}

/// Values of the parameter `name` of an effect; none if it has no such parameter.
fn block<'a>(active: &'a ActiveEffect, name: &str) -> &'a [f64] {
    let block = active.effect.parameters().iter().position(|p| p.name == name);
    block.map_or(&[], |b| active.values().block(b))
}

//! One factor at a time.

/// What one factor alone changes.
#[derive(Debug, Clone, PartialEq)]
pub struct Swing {
    /// Factor.
    pub name: String,
    /// Output with the factor at its low value, all others nominal.
    pub at_low: f64,
    /// Output with the factor at its high value.
    pub at_high: f64,
}

impl Swing {
    /// Range of the output over low, high and `nominal`.
    pub fn width(&self, nominal: f64) -> f64 {
        let high = self.at_low.max(self.at_high).max(nominal);
        high - self.at_low.min(self.at_high).min(nominal)
    }
}

/// The swings in descending order of their width around the `nominal` output; those without a finite width last, equal
/// ones in their given order.
pub fn tornado(nominal: f64, mut swings: Vec<Swing>) -> Vec<Swing> {
    let size = |swing: &Swing| {
        let finite = swing.at_low.is_finite() && swing.at_high.is_finite();
        if finite { swing.width(nominal) } else { f64::NEG_INFINITY }
    };
    swings.sort_by(|a, b| size(b).total_cmp(&size(a)));
    swings
}

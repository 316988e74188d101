//! Figure of the error budget of a diagnosis.

use deltatwin::diagnosis::budget::Budget;
use deltatwin::recording::Channel;

use crate::{Figure, StackedBar, stacked};

/// Error budget as stacked bars, one per channel.
pub fn figure(budget: &Budget) -> Figure {
    let names = budget.effects.iter().map(|(name, _)| name.as_str());
    let parts: Vec<&str> = std::iter::once("noise").chain(names).chain(["unexplained"]).collect();
    let bar = |(c, &channel): (usize, &Channel)| {
        let shares = budget.shares(c);
        let all = std::iter::once(shares.noise).chain(shares.effects).chain([shares.unexplained]);
        StackedBar { name: channel.title(budget.mechanism), shares: all.collect() }
    };
    let bars: Vec<StackedBar> = budget.channels.iter().enumerate().map(bar).collect();
    stacked("Error budget", "share of the mean square error of the model without the effects / %", &parts, &bars)
}

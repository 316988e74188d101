//! SVG figures: time series, stacked panels, falling errors, binned scatter, spectra, rankings.
//!
//! Every function returns a [`Figure`] for any data: values that are not finite leave gaps, and a figure without
//! drawable data shows "no data".

mod axis;
mod canvas;
mod color;
mod curve;
mod falling_error;
mod framed;
mod legend;
mod live;
mod matrix;
mod numbers;
mod ranking;
mod rates;
mod scatter;
mod spectrum;
mod stacked;
pub mod study;
#[cfg(test)]
mod tests;
mod time_series;

pub(crate) use color::style;
pub use color::{Color, Role};
pub use curve::{Curve, Style};
pub use falling_error::{ErrorGroup, falling_error};
pub use matrix::{Cell, matrix};
pub use ranking::{RankRow, ranking};
pub use rates::{Rate, rates};
pub use scatter::scatter_binned;
pub use spectrum::{Marker, spectrum};
pub use stacked::{StackedBar, stacked};
pub use time_series::{Panel, panels, time_series};

/// Width of every figure in CSS pixels.
pub const WIDTH: f64 = 920.0;

/// Largest number of scatter dots in one figure.
const MAX_DOTS: usize = 900;
/// Magnitudes above this are treated as missing: their differences would overflow.
const HUGE: f64 = 1e200;
const RIGHT: f64 = 18.0;
const TICK_SIZE: f64 = 11.0;
const LABEL_SIZE: f64 = 12.0;

/// A finished figure.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    title: String,
    svg: String,
    /// Its curves as data.
    live: Option<String>,
}

impl Figure {
    /// Title, also drawn in the figure.
    pub fn title(&self) -> &str {
        &self.title
    }

    /// The complete `<svg>` element.
    pub fn svg(&self) -> &str {
        &self.svg
    }

    /// The curves of the figure as JSON, for a page that draws them to be zoomed; `None` of other figures.
    pub(crate) fn live(&self) -> Option<&str> {
        self.live.as_deref()
    }
}

//! Figures and the report page: generic drawing and HTML, no knowledge of the robot.

pub mod figure;
pub mod html;

pub use figure::{
    Color, Curve, ErrorGroup, Figure, Marker, Panel, RankRow, StackedBar, Style, falling_error, panels, ranking,
    scatter_binned, spectrum, stacked, time_series,
};
pub use html::{Callout, Report};

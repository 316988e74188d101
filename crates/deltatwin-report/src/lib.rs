//! Figures and pages: [`figure`] and [`html`] are independent of the robot, [`drawing`] draws results of the library, and
//! [`component`] has the parts of pages about them.

pub mod component;
pub mod drawing;
pub mod figure;
pub mod html;
pub mod plan;
pub mod study;

pub use figure::{
    Cell, Color, Curve, ErrorGroup, Figure, Marker, Panel, RankRow, Rate, Role, StackedBar, Style, falling_error,
    matrix, panels, ranking, rates, scatter_binned, spectrum, stacked, time_series,
};
pub use html::{Callout, Report};
pub use plan::{PlanPage, plan_page};
pub use study::{FmeaRow, KeyNumber, StudyPage, StudySection, study_page};

//! How far the diagnosis can be trusted: campaigns with a known truth, drawn from seeds, simulated, judged and counted.
//!
//! A [`Case`] says what to hide, at what size, under what noise; [`campaign()`] simulates it; [`folder`] keeps recordings,
//! truth and answer beside each other; [`mod@judge`] asks the diagnosis and grades its answer.

pub mod campaign;
pub mod figures;
pub mod folder;
pub mod judge;
pub mod motion;
pub mod noise;
pub mod outside;
pub mod plan;
pub mod score;
pub mod size;
pub mod span;

pub use campaign::{Campaign, CampaignError, Case, campaign, campaign_with, hideable, perturb};
pub use judge::{Answer, Grade, judge};
pub use motion::MotionKind;
pub use noise::Noise;
pub use size::{Hidden, Rise, Size};

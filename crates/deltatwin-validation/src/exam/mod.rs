//! Exam of the diagnosis: campaigns with a known truth are drawn from seeds, simulated, diagnosed and graded.
//!
//! A [`Case`] specifies the hidden effects, their size and the noise; [`campaign()`] simulates it; [`folder`] stores
//! recordings, truth and answer; [`mod@judge`] runs the diagnosis and grades its answer. An [`Exam`] does all of it for
//! the campaigns of a [`plan::Plan`], chunk by chunk.

pub mod campaign;
#[cfg(feature = "exam")]
pub mod conduct;
#[cfg(feature = "exam")]
pub mod experiment;
#[cfg(feature = "exam")]
pub mod figures;
pub mod folder;
pub mod judge;
pub mod motion;
pub mod noise;
pub mod outside;
#[cfg(feature = "exam")]
pub mod page;
#[cfg(feature = "exam")]
pub mod plan;
#[cfg(feature = "exam")]
pub mod score;
pub mod size;
pub mod span;

pub use campaign::{Campaign, CampaignError, Case, campaign, campaign_with, hideable, perturb};
#[cfg(feature = "exam")]
pub use conduct::Exam;
pub use judge::{Answer, Grade, judge};
pub use motion::MotionKind;
pub use noise::Noise;
pub use size::{Hidden, Rise, Size};

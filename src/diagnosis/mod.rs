//! Which effect does a linear-in-parameters model lack? Pure statistics, without robot and without files.
//!
//! The stacked system is `y = Y θ + Σ_j Z_j c_j + ε`, rows (channel, time), with errors that are autocorrelated, unequal
//! over channels and of varying size. One step ([`evaluate`]) whitens by an autoregression per channel, projects the base
//! parameters out (Frisch–Waugh–Lovell), scores every candidate by its block scores and controls the family-wise error by
//! common sign flips. [`select`] adds effects one at a time and tells what cannot be told apart.
//!
//! # Sources
//!
//! - Frisch & Waugh 1933, Lovell 1963: projection of the base parameters.
//! - Kline & Santos 2012, "A score based approach to wild bootstrap inference": sign flips of block scores.
//! - Westfall & Young 1993, Romano & Wolf 2005: the smallest p over candidates, with their correlation kept.
//! - Hansen, Lunde & Nason 2011, "The model confidence set"; Vuong 1989 for a pair.
//! - Langsrud 2005, "Rotation tests": what repeats tell without a noise model.

mod base_fit;
mod compare;
mod describe;
pub mod error;
mod evaluate;
mod flip;
mod gram;
pub mod noise;
mod predict;
pub mod problem;
mod project;
pub mod ranking;
pub mod repeats;
mod score;
pub mod select;
mod special;
pub mod whiten;

#[cfg(test)]
mod campaign;

pub use error::Error;
pub use evaluate::{evaluate, evaluate_only};
pub use problem::{Candidate, Channel, Chosen, Column, Problem, Settings, Variant};
pub use ranking::{Absorption, Assessment, Estimate, Ranking, Visibility};
pub use select::{Finding, Outcome, Step, Verdict, select, select_with};

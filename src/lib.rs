//! deltatwin: a digital twin of the ABB IRB 360-6/1600 delta robot that finds the physical effect its model lacks.
//!
//! A [`model::Model`] says what the machine is, a [`recording::Recording`] what was measured; the crate `deltatwin-io` reads
//! and writes their files. Identification estimates the parameters, diagnosis names the effect that is missing, and the
//! result is a model again:
//!
//! ```no_run
//! use std::path::Path;
//!
//! use deltatwin::diagnosis::{add, diagnose};
//! use deltatwin::identification::{Dataset, fit::fit, dataset::noise_floor};
//! use deltatwin_io::{model, recording};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let model = model::read(Path::new("models/irb360-6-1600.toml"))?;
//! let (recording, warnings) = recording::read(Path::new("run.csv"), None)?;
//! let datasets = [Dataset::new(&recording)];
//! let fitted = fit(&model, &datasets, &[noise_floor(&model, &datasets)])?;
//! let answer = diagnose(&fitted.model, &datasets, &[], &mut |stage| log(stage))?;
//! if let Some(missing) = answer.effects.first() {
//!     let better = add(&fitted.model, &missing.name, &datasets, &[])?;
//!     model::write(&better.fit.model, Path::new("better.toml"))?;
//! }
//! # fn log(_: &str) {}
//! # drop(warnings);
//! # Ok(())
//! # }
//! ```
//!
//! Quantities are in SI units, angles in rad; the frames are those of the README. Modules stand in the order in which the data
//! flow, and a module uses those above it. What holds everywhere:
//!
//! - Every law is written once, as wrenches per unit of its parameters, so that the twin and the regressor cannot differ.
//! - A run is a function of scenario, model and seed, bit by bit, on any number of threads.
//! - What was found is printed by the program, never here; what cannot be done is an error that names file and place.

// Numbers as text, suggestions for misspelt names, and elementary numerics.
pub mod text;

pub mod numerics;

// What the machine is made of, and what was measured on it.
pub mod machine;

pub mod recording;

// Its motion, the laws that act on it, the machine with its laws, and the torques they demand.
pub mod kinematics;

pub mod effects;

pub mod model;

pub mod dynamics;

// The machine that runs.
pub mod cell;

pub mod scenario;

pub mod twin;

// What a recording says about a model.
pub mod evidence;

pub mod identification;

pub mod gate;

pub mod excitation;

pub mod constraint_forces;

pub mod planner;

pub mod comparison;

pub mod diagnosis;

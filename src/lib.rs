//! deltatwin: a digital twin of the ABB IRB 360-6/1600 delta robot that finds the physical effect that its model
//! lacks.
//!
//! A [`model::Model`] describes the machine, a [`recording::Recording`] contains measurements; the crate
//! `deltatwin-io` reads and writes their files. Identification estimates the parameters, diagnosis names the missing
//! effect, and the result is a model again:
//!
//! ```
//! use deltatwin::diagnosis::{add, diagnose};
//! use deltatwin::identification::{Dataset, NoiseLevel, fit::fit};
//! use deltatwin::{model::Model, recording::Recording};
//!
//! /// The model with the first missing effect that a recording shows.
//! fn better(model: &Model, recording: &Recording) -> Result<Option<Model>, Box<dyn std::error::Error>> {
//!     let datasets = [Dataset::new(recording)];
//!     let fitted = fit(model, &datasets, &NoiseLevel::of(model, &datasets).of_each)?;
//!     let answer = diagnose(&fitted.model, &datasets, &[], &mut |_| {})?;
//!     let Some(missing) = answer.effects.first() else { return Ok(None) };
//!     Ok(Some(add(&fitted.model, &missing.name, &datasets, &[])?.fit.model))
//! }
//! ```
//!
//! Quantities are in SI units, angles in rad; the frames are those of the model files. The modules are in the order of the
//! data flow, and a module uses only those above it. Principles of the library:
//!
//! - Every law is implemented once, as wrenches per unit of its parameters, so the twin and the regressor always
//!   agree.
//! - A run is a function of scenario, model and seed, bit by bit, on any number of threads.
//! - Results are printed by the program, not by the library; errors name file and place.

// Numbers as text, suggestions for misspelt names, and elementary numerics.
pub mod text;

pub mod numerics;

// Description of the machine, and measurements.
pub mod machine;

pub mod recording;

// Motion of the machine, effects on it, the machine with its effects, and inverse dynamics.
pub mod kinematics;

pub mod effects;

pub mod model;

pub mod dynamics;

// Simulation.
pub mod cell;

pub mod scenario;

pub mod twin;

// Statistics, identification, design of motions, constraint forces, planning, monitoring and diagnosis.
pub mod evidence;

pub mod identification;

pub mod gate;

pub mod excitation;

pub mod constraint_forces;

pub mod planner;

pub mod comparison;

pub mod monitoring;

pub mod diagnosis;

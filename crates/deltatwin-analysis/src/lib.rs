//! The loop from recordings to a better model: check, identify, compare, diagnose, add.
//!
//! [`run::run`] does all of it and tells how far it is; [`folder`] keeps the results: `result.json`, models and the page.
//! The modules [`compare`], [`identify`], [`diagnose`], [`add`] and [`gate`] have the stages' results as JSON, the same for
//! the single commands and for the whole loop. Nothing is printed here, so that the command line, the studio and other
//! languages share it.

pub mod add;
pub mod budget;
pub mod compare;
pub mod data;
pub mod diagnose;
pub mod folder;
pub mod gate;
pub mod identify;
pub mod json;
pub mod law;
pub mod page;
pub mod progress;
pub mod run;
pub mod sentence;
pub mod unexplained;

pub use data::{Data, DataError, Inputs, Joined};
pub use run::{Analysis, RunError, Settings, Step, run};

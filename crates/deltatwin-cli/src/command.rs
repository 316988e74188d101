//! The commands, one module each.

pub mod add;
pub mod check;
pub mod compare;
pub mod convert;
pub mod demo;
pub mod diagnose;
pub mod effects;
pub mod exam;
pub mod excite;
pub mod forces;
pub mod gate;
pub mod identify;
pub mod new;
pub mod noise;
pub mod plan;
pub mod replay;
pub mod reproduce;
pub mod run;
pub mod shell;
pub mod simulate;
#[cfg(feature = "studio")]
pub mod studio;
pub mod study;
#[cfg(feature = "viewer")]
pub mod view;
pub mod watch;

//! The loop in a browser: drop recordings and a model, check, fit, see where the model fails and why, add, undo, save.
//!
//! [`serve`] answers on this machine alone, to whom has the token. The session is a folder (`session`): recordings,
//! models, results of every stage and the commands that give them, so that a reload, a second window, a killed server or
//! the command line go on where it was.

mod claim;
mod http;
mod job;
mod live;
mod server;
mod session;
mod stage;
mod studio;
mod upload;
mod view;
#[cfg(feature = "viewer")]
mod viewer;

pub use http::{Server, serve};
pub use session::{How, Recording, Session, StageResult, Version};
pub use studio::Studio;
pub use upload::{MOST_BYTES, safe_name};

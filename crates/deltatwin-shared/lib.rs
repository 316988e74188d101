//! Nothing but the dependencies of Cargo.toml.

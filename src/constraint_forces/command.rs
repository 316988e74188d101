//! `deltatwin forces`.

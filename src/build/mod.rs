//! Filled in below.

pub mod source;

//! The trained codec: symbols in contexts, prediction, and what vectors must not change.

mod rans;
mod standalone;
mod vectors;

//! The reference model: the rules of `docs/design.md` written as plainly as they can be, slow, and
//! sharing no code with the library, which must equal it.

// Each test program uses its own part.
#![allow(dead_code)]

pub mod lattice;
pub mod model;
pub mod surface;

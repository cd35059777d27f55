//! The packed file: what goes in comes out, damage is named, and a file under its final name is whole.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]

mod build_faults;
mod content;
mod damage;
mod faults;
mod faulty_sink;
mod layout;
mod repair;
mod round_trip;

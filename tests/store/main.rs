//! The packed file: what goes in comes out, damage is named, and a file under its final name is whole.

mod content;
mod damage;
mod faults;
mod layout;
mod round_trip;

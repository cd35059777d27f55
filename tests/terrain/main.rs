//! Rasters to repositories and back, beside a reference model that shares no code with the library.

mod against_reference;
mod depth;
mod elevation;
mod filters;
mod golden;
mod memory;
mod methods;
mod pyramid;
mod rasters;
mod reference;
mod reference_model;
mod repair;
mod round_trip;
mod second_reader;
mod stability;
mod tables;
mod transforms;
mod update;

//! Colours in a repository: what goes in comes out, within its bound, on every kind of image.

mod bad_input;
mod domain;
mod image;
mod repair;
mod round_trip;

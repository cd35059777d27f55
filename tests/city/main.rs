//! Cities: what is read of them, and what BlockMaps keep and show of it.

mod bakes;
mod casting;
mod codec;
mod png;
mod samples;
mod seams;
mod sources;
mod tree;
mod visits;

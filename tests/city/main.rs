//! Cities: what is read of them, and what BlockMaps keep and show of it.

mod bakes;
mod casting;
mod samples;
mod seams;
mod sources;
mod visits;

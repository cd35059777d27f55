//! Properties of cuts: legal, without cracks, within budgets, settled when nothing moves.

mod best;
mod cases;
mod conformity;
mod flights;
mod metrics;
mod missing;
mod properties;
mod ray_hits;
mod rays;
mod repositories;
mod scenes;
#[path = "../support/mod.rs"]
mod support;
mod threads;
mod viewers;

//! Properties of cuts: legal, without cracks, within budgets, settled when nothing moves.

mod areas;
mod best;
mod cases;
mod conformity;
mod flights;
mod grounds;
mod heights;
mod metrics;
mod missing;
mod profiles;
mod properties;
mod ray_hits;
mod rays;
mod repositories;
mod scenes;
#[path = "../support/mod.rs"]
mod support;
mod surface;
mod threads;

//! Helpers of several tests: sources of diamonds in memory, and cameras.

#![allow(dead_code)]

pub mod camera;
pub mod memory;
pub mod repositories;

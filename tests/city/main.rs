//! Cities: what is read of them, and their blocks and files.

mod codec;
mod png;
mod sources;
mod tree;

//! Cities: what is read of them.

mod sources;

//! `kmb`: the command line of Kimberlite.

fn main() {}

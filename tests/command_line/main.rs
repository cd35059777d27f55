//! What `kmb` promises to scripts: its results, its keys, its exit codes and its messages.

mod bad_input;
mod cities;
mod damage;
mod interruption;
mod kmb;
mod large;
mod repair;
mod results;
mod resume;
mod successor;
mod update;

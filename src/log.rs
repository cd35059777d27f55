//! Messages for the embedding program: a callback instead of prints.

use std::sync::RwLock;

/// How much a message matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum LogLevel {
    /// Progress and choices that the library made.
    Info = 0,
    /// Something was odd in the input, and how it was read.
    Warning = 1,
}

type Callback = Box<dyn Fn(LogLevel, &str) + Send + Sync>;

static CALLBACK: RwLock<Option<Callback>> = RwLock::new(None);

/// Installs the callback that gets every message, from any thread, or removes it.
pub fn set_log_callback(callback: Option<Callback>) {
    match CALLBACK.write() {
        Ok(mut slot) => *slot = callback,
        Err(poisoned) => *poisoned.into_inner() = callback,
    }
}

/// Sends one line to the callback, if there is one.
pub(crate) fn log(level: LogLevel, message: &str) {
    if let Ok(slot) = CALLBACK.read()
        && let Some(callback) = slot.as_ref()
    {
        callback(level, message);
    }
}

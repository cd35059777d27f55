//! `kmb`: the command line of Kimberlite.

mod arguments;
mod cities;
mod commands;
mod progress;
mod report;

use arguments::Arguments;
use clap::Parser;
use clap::error::ErrorKind;
use kimberlite::{Error, LogLevel};
use std::io::{self, Write};
use std::path::Path;
use std::process::ExitCode;

/// The check that was asked for failed.
const FAILED: u8 = 1;
/// Bad usage or input.
const BAD: u8 = 2;
/// Stopped by the user, as shells report it.
const INTERRUPTED: u8 = 130;

fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) => return usage(&error),
    };
    kimberlite::set_log_callback(Some(Box::new(|level, message| {
        if level >= LogLevel::Warning {
            complain(&format!("warning: {message}"));
        }
    })));
    let outcome = commands::run(&arguments.command).and_then(|outcome| {
        let json = arguments.json;
        show(&if json {
            outcome.report.json()
        } else {
            outcome.report.text()
        })?;
        Ok(outcome.failure)
    });
    match outcome {
        Ok(None) => ExitCode::SUCCESS,
        Ok(Some(failure)) => {
            complain(&format!(
                "{}: {failure}",
                arguments.command.subject().display()
            ));
            ExitCode::from(FAILED)
        }
        Err(error) => {
            complain(&describe(&error, arguments.command.subject()));
            ExitCode::from(if matches!(error, Error::Cancelled) {
                INTERRUPTED
            } else {
                BAD
            })
        }
    }
}

/// Help goes to standard output; a mistake becomes one line.
fn usage(error: &clap::Error) -> ExitCode {
    if matches!(
        error.kind(),
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion
    ) {
        return match error.print() {
            Ok(()) => ExitCode::SUCCESS,
            Err(_) => ExitCode::from(BAD),
        };
    }
    let text = error.to_string();
    let cause = text.split("\n\n").next().unwrap_or_default();
    complain(cause.strip_prefix("error: ").unwrap_or(cause));
    ExitCode::from(BAD)
}

/// The error with the file that it is about.
fn describe(error: &Error, subject: &Path) -> String {
    match error {
        Error::Argument(_) | Error::Cancelled => format!("{}: {error}", subject.display()),
        _ => error.to_string(),
    }
}

/// One line on standard error, whatever line ends the message has.
fn complain(message: &str) {
    let line = message.lines().map(str::trim).collect::<Vec<_>>().join(" ");
    // There is nobody left to tell when standard error is closed.
    let _ = writeln!(io::stderr(), "kmb: {line}");
}

/// Prints the result. A reader that has gone away wanted no more.
fn show(text: &str) -> kimberlite::Result<()> {
    let mut output = io::stdout().lock();
    match output
        .write_all(text.as_bytes())
        .and_then(|()| output.flush())
    {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(Error::io(
            Path::new("standard output"),
            "cannot write",
        )(error)),
        _ => Ok(()),
    }
}

//! Cardan's command line: proves fixed-point sensor firmware against its golden model before silicon.
//!
//! [`main`] is the whole program. [`rig`] is a session of `compare` as a library.

mod commands;
mod dump;
mod eeprom_file;
mod failure;
mod files;
mod judge;
mod output;
mod participants;
mod recording;
pub mod rig;
mod run_options;
mod toolchain;
mod verdict;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::output::Output;

/// Proves fixed-point sensor firmware before silicon: golden model, native run and cycle-accurate
/// emulation of the same algorithm, compared bit by bit.
#[derive(Parser)]
#[command(
    name = "cardan",
    version,
    propagate_version = true,
    arg_required_else_help = true
)]
struct Cli {
    #[command(flatten)]
    output: output::Options,
    #[command(subcommand)]
    command: Command,
}

/// The verbs; one file each in `commands`.
#[derive(Subcommand)]
enum Command {
    /// Run golden model, native firmware and emulated firmware, and judge them
    Compare(commands::compare::CompareArgs),
    /// Take part in a session as the golden model
    Golden(commands::participants::ModelArgs),
    /// Take part in a session as the native firmware
    Native(commands::participants::ModelArgs),
    /// Take part in a session as the emulated board
    Emulate(commands::participants::EmulateArgs),
    /// Take part in a session as the judge
    Diff(commands::participants::DiffArgs),
    Tune(Box<commands::tune::Arguments>),
    Ranges(commands::ranges::Arguments),
    Calibrate(commands::calibrate::Arguments),
    Accuracy(commands::accuracy::Arguments),
    Run(commands::run::Arguments),
    Build(commands::build::Arguments),
    Doctor(commands::doctor::Arguments),
}

/// The program: parses the arguments, runs the verb, and gives its exit code.
#[must_use]
pub fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        // Wrong usage is exit 2; help and version are not errors.
        Err(error) => error.exit(),
    };
    // A participant that `compare` started ends with it, from its first moment on.
    cardan_link::end_with_supervisor();
    let output = Output::new(&cli.output);
    let done = match &cli.command {
        Command::Compare(args) => commands::compare::compare(args, output),
        Command::Golden(args) => commands::participants::golden(args, output),
        Command::Native(args) => commands::participants::native(args, output),
        Command::Emulate(args) => commands::participants::emulate(args, output),
        Command::Diff(args) => commands::participants::diff(args, output),
        Command::Tune(args) => commands::tune::execute(args, output),
        Command::Ranges(args) => commands::ranges::execute(args, output),
        Command::Calibrate(args) => commands::calibrate::execute(args, output),
        Command::Accuracy(args) => commands::accuracy::execute(args, output),
        Command::Run(args) => commands::run::execute(args, output),
        Command::Build(args) => commands::build::execute(args, output),
        Command::Doctor(args) => commands::doctor::execute(args, output),
    };
    match done {
        Ok(code) => code,
        Err(failure) => {
            output.error(&failure);
            failure.exit_code()
        }
    }
}

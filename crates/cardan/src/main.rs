//! Cardan: proves fixed-point sensor firmware against its golden model before silicon.

mod commands;
mod failure;
mod output;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::output::Output;

/// Proves fixed-point sensor firmware before silicon: golden model, native run and cycle-accurate
/// emulation of the same algorithm, compared bit by bit.
#[derive(Parser)]
#[command(name = "cardan", version, propagate_version = true, arg_required_else_help = true)]
struct Cli {
    #[command(flatten)]
    output: output::Options,
    #[command(subcommand)]
    command: Command,
}

/// The verbs; one file each in `commands`.
#[derive(Subcommand)]
enum Command {
}

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        // Wrong usage is exit 2; help and version are not errors.
        Err(error) => error.exit(),
    };
    let output = Output::new(&cli.output);
    let done = match cli.command {};
    match done {
        Ok(code) => code,
        Err(failure) => {
            output.error(&failure);
            failure.exit_code()
        }
    }
}

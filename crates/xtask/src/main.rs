//! Build and test automation: `cargo xtask test` installs what the tests need and runs everything,
//! `cargo xtask images` rebuilds the committed firmware images.

mod needs;
mod steps;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::steps::Step;

/// Build and test automation.
#[derive(Parser)]
#[command(name = "cargo xtask")]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Install what the tests need, then run every check
    Test {
        /// Only these steps
        #[arg(long, value_delimiter = ',', value_name = "STEP")]
        only: Vec<Step>,
    },
    /// Rebuild the firmware images from source and write them where they are committed
    Images,
}

fn main() -> ExitCode {
    let done = match Cli::parse().command {
        Command::Test { only } => steps::test(&only),
        Command::Images => steps::images(),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("xtask: {message}");
            ExitCode::FAILURE
        }
    }
}

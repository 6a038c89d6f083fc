//! Cardan's command line: proves fixed-point sensor firmware against its golden model before silicon.
//!
//! [`main`] is the whole program. [`rig`] is a session of `compare` as a library.

mod arguments;
mod ci;
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

use clap::{CommandFactory, Parser, Subcommand};

use crate::commands::help;
use crate::output::Output;

/// Proves fixed-point sensor firmware before silicon: golden model, native run and cycle-accurate
/// emulation of the same algorithm, compared bit by bit.
#[derive(Parser)]
#[command(
    name = "cardan",
    version,
    propagate_version = true,
    after_help = help::TOP,
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
    #[command(after_help = help::COMPARE)]
    Compare(commands::compare::CompareArgs),
    /// Take part in a session as the golden model
    #[command(after_help = help::GOLDEN)]
    Golden(commands::participants::ModelArgs),
    /// Take part in a session as the native firmware
    #[command(after_help = help::NATIVE)]
    Native(commands::participants::ModelArgs),
    /// Take part in a session as the emulated board
    #[command(after_help = help::EMULATE)]
    Emulate(commands::participants::EmulateArgs),
    /// Take part in a session as the judge
    #[command(after_help = help::DIFF)]
    Diff(commands::participants::DiffArgs),
    #[command(after_help = help::TUNE)]
    Tune(Box<commands::tune::Arguments>),
    #[command(after_help = help::RANGES)]
    Ranges(commands::ranges::Arguments),
    #[command(after_help = help::CALIBRATE)]
    Calibrate(commands::calibrate::Arguments),
    #[command(after_help = help::ACCURACY)]
    Accuracy(commands::accuracy::Arguments),
    #[command(after_help = help::RUN)]
    Run(commands::run::Arguments),
    #[command(after_help = help::BUILD)]
    Build(commands::build::Arguments),
    #[command(after_help = help::DOCTOR)]
    Doctor(commands::doctor::Arguments),
    /// Print the completions of a shell
    #[command(after_help = help::COMPLETIONS)]
    Completions {
        /// Shell
        shell: clap_complete::Shell,
    },
    /// Print the manual page, or write one per verb
    #[command(after_help = help::MAN)]
    Man {
        /// Write cardan.1 and a page per verb into this folder
        #[arg(long, value_name = "DIR")]
        out: Option<std::path::PathBuf>,
    },
}

/// The program: parses the arguments, runs the verb, and gives its exit code.
#[must_use]
pub fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => return usage(&error),
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
        Command::Completions { shell } => {
            commands::manual::completions(*shell, Cli::command(), output)
        }
        Command::Man { out } => commands::manual::man(out.as_deref(), Cli::command(), output),
    };
    match done {
        Ok(code) => code,
        Err(failure) => {
            output.error(&failure);
            failure.exit_code()
        }
    }
}

/// Wrong usage is exit 2; help and version are results, in a document if that is asked for.
fn usage(error: &clap::Error) -> ExitCode {
    if error.use_stderr() {
        // Where even errors go nothing can be told of an error.
        let _ = error.print();
        return ExitCode::from(failure::code::INPUT);
    }
    let is_json = std::env::args_os().any(|argument| argument == "--json");
    let options = output::Options {
        json: is_json,
        quiet: true,
    };
    let output = Output::new(&options);
    let text = error.render();
    let written = if is_json {
        output.document(&serde_json::json!({ "help": text.to_string() }))
    } else if output.style().color {
        output.result(&text.ansi().to_string())
    } else {
        output.result(&text.to_string())
    };
    match written {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            output.error(&failure);
            failure.exit_code()
        }
    }
}

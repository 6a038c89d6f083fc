//! Build and test automation.
//!
//! `cargo xtask test [--only STEP,...]` runs every check of the repository; `cargo xtask images`
//! rebuilds the committed firmware images; `cargo xtask node-docs` writes the documents of the nodes; `cargo
//! xtask c-header` writes the node table for firmware
//! in C; `cargo xtask soak` is the long test; `cargo xtask dist` packs a release. What Cardan's own commands know (which parts of the
//! system are missing, how images are built) is asked of them.

mod c_header;
mod deny;
mod dist;
mod licences;
mod prepare;
mod shell;
mod soak;
mod steps;

use std::process::ExitCode;

const USAGE: &str = "\
usage: cargo xtask test [--only STEP,...]   every check: installs what is missing, then runs all steps
       cargo xtask images                   rebuilds the committed firmware images from source
       cargo xtask soak [--minutes N]       each fuzz target for N minutes (10), random programs for 10^9 cycles,
                                            10^7 random operations per rounding and overflow mode,
                                            10^6 random algorithms on tapes
       cargo xtask dist [--out DIR] [--program FILE]   a Debian package and a tar archive, the same bytes from the
                                            same sources, in DIR (target/dist); FILE instead of a release build
       cargo xtask node-docs                writes docs/nodes.md and docs/nodes.svg
       cargo xtask c-header                 writes firmware/c/nodes.h from firmware/wordlengths.toml";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    if let Err(message) = shell::find_root() {
        eprintln!("xtask: {message}");
        return ExitCode::from(2);
    }
    let done = match arguments[..] {
        ["test"] => steps::run(None),
        ["test", "--only", list] => steps::run(Some(list)),
        ["c-header"] => c_header::write(),
        ["images"] => steps::write_images(),
        ["node-docs"] => steps::write_node_docs(),
        ["dist", ref options @ ..] => dist::dist(options),
        ["soak"] => soak::soak(soak::MINUTES),
        ["soak", "--minutes", minutes] => match minutes.parse() {
            Ok(minutes @ 1..=10_000) => soak::soak(minutes),
            _ => Err(format!(
                "--minutes {minutes}: expected whole minutes, 1 to 10000"
            )),
        },
        ["help" | "--help" | "-h"] => {
            println!("{USAGE}\nsteps: {}", steps::names());
            return ExitCode::SUCCESS;
        }
        _ => {
            eprintln!("{USAGE}\nsteps: {}", steps::names());
            return ExitCode::from(2);
        }
    };
    match done {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(message) => {
            eprintln!("xtask: {message}");
            ExitCode::FAILURE
        }
    }
}

//! `completions` and `man`: made from the description of the options, so that they cannot lag behind.

use std::io::{self, Write as _};
use std::path::Path;
use std::process::ExitCode;

use clap::Command;
use clap_complete::Shell;
use clap_mangen::Man;

use crate::failure::{Done, Failure};
use crate::files::{make_folder, write_whole};
use crate::output::Output;

/// Prints the completions of `shell`.
pub(crate) fn completions(shell: Shell, mut cli: Command) -> Done {
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut cli, "cardan", &mut text);
    print(&text)
}

/// Prints the page of the whole program, or writes it and one per verb.
pub(crate) fn man(folder: Option<&Path>, mut cli: Command, output: Output) -> Done {
    let Some(folder) = folder else {
        return print(&page(cli)?);
    };
    make_folder("--out", folder)?;
    cli.build();
    for verb in cli
        .get_subcommands()
        .filter(|verb| verb.get_name() != "help")
    {
        let name = format!("cardan-{}", verb.get_name());
        let verb = verb.clone().display_name(name.clone());
        write_whole("--out", &folder.join(format!("{name}.1")), page(verb)?)?;
    }
    write_whole("--out", &folder.join("cardan.1"), page(cli)?)?;
    output.note(&format!("written: {}", folder.display()));
    Ok(ExitCode::SUCCESS)
}

fn page(command: Command) -> Result<Vec<u8>, Failure> {
    let mut text = Vec::new();
    Man::new(command)
        .render(&mut text)
        .map_err(Failure::participant)?;
    Ok(text)
}

/// A closed pipe is the reader's choice, not an error.
fn print(text: &[u8]) -> Done {
    match io::stdout()
        .write_all(text)
        .and_then(|()| io::stdout().flush())
    {
        Ok(()) => Ok(ExitCode::SUCCESS),
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(ExitCode::SUCCESS),
        Err(error) => Err(Failure::input(format!(
            "standard output: cannot be written: {error}"
        ))),
    }
}

//! `completions` and `man`: made from the description of the options, so that they cannot lag behind.

use std::collections::BTreeMap;
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
pub(crate) fn completions(shell: Shell, mut cli: Command, output: Output) -> Done {
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut cli, "cardan", &mut text);
    if output.is_json() {
        return document(&[(&format!("completions.{shell}"), &text)], output);
    }
    print(&text)
}

/// Texts by their names, as one document.
fn document(texts: &[(&str, &[u8])], output: Output) -> Done {
    let texts = texts
        .iter()
        .map(|(name, text)| (*name, String::from_utf8_lossy(text)));
    output.document(&texts.collect::<BTreeMap<_, _>>())?;
    Ok(ExitCode::SUCCESS)
}

/// Prints the page of the whole program, or writes it and one per verb.
pub(crate) fn man(folder: Option<&Path>, mut cli: Command, output: Output) -> Done {
    let Some(folder) = folder else {
        let text = page(cli)?;
        return match output.is_json() {
            true => document(&[("cardan.1", &text)], output),
            false => print(&text),
        };
    };
    make_folder("--out", folder)?;
    let mut written = vec!["cardan.1".to_owned()];
    cli.build();
    for verb in cli
        .get_subcommands()
        .filter(|verb| verb.get_name() != "help")
    {
        let name = format!("cardan-{}", verb.get_name());
        let verb = verb.clone().display_name(name.clone());
        write_whole("--out", &folder.join(format!("{name}.1")), page(verb)?)?;
        written.push(format!("{name}.1"));
    }
    write_whole("--out", &folder.join("cardan.1"), page(cli)?)?;
    output.note(&format!("written: {}", folder.display()));
    if output.is_json() {
        output.document(&serde_json::json!({ "written": written }))?;
    }
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

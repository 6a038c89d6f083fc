//! `golden`, `native`, `emulate`, `diff`: the participants by hand, on as many terminals.

use std::path::PathBuf;
use std::process::ExitCode;

use cardan_link::Role;
use clap::Args;

use crate::dump;
use crate::failure::{Done, Failure};
use crate::judge::{Names, Wanted};
use crate::output::Output;
use crate::participants::{JoinOptions, diff, emulated, golden, native};
use crate::run_options::RunOptions;
use crate::verdict::{self, Extras};

/// Options of `emulate`.
#[derive(Args, Debug)]
pub(crate) struct EmulateArgs {
    #[command(flatten)]
    join: JoinOptions,
    #[command(flatten)]
    run: RunOptions,
    /// Publishes a pin (PB1) or an inner voltage (adc0_band_pass_V), which `diff --dump` writes; may
    /// be repeated
    #[arg(long, value_name = "NAME")]
    dump_signal: Vec<String>,
}

/// Options of `golden` and `native`: all else comes from `emulate`.
#[derive(Args, Debug)]
pub(crate) struct ModelArgs {
    #[command(flatten)]
    join: JoinOptions,
    /// Application
    #[arg(long, value_name = "NAME", default_value = "attitude")]
    app: String,
    /// Formats other than the deployed ones, the same for all participants
    #[arg(long, value_name = "FILE")]
    wordlengths: Option<PathBuf>,
}

/// Options of `diff`.
#[derive(Args, Debug)]
pub(crate) struct DiffArgs {
    #[command(flatten)]
    join: JoinOptions,
    #[command(flatten)]
    run: RunOptions,
    #[command(flatten)]
    extras: Extras,
    /// Session id to print in the result instead of the real one
    #[arg(long, hide = true, value_name = "ID")]
    report_session: Option<String>,
}

impl ModelArgs {
    fn run_options(&self) -> RunOptions {
        RunOptions {
            app: self.app.clone(),
            scenario: String::new(),
            recording: None,
            firmware: None,
            build: false,
            checkout: None,
            eeprom: None,
            wordlengths: self.wordlengths.clone(),
            seconds: None,
            set: Vec::new(),
            seed: 1,
        }
    }
}

pub(crate) fn emulate(args: &EmulateArgs, output: Output) -> Done {
    let setup = args.run.resolve()?;
    // Bad input is told before the others are waited for.
    setup
        .app
        .emulated(&setup.scenario, setup.seed, setup.seconds, &setup.firmware)
        .map_err(Failure::input)?;
    let signals = dump::signals(&args.dump_signal, setup.app)?;
    let session = args.join.join(Role::Emulated, setup.formats_hash)?;
    output.note(&format!(
        "emulating {} for {} s",
        setup.scenario.name, setup.seconds
    ));
    emulated::run(session, &setup, &signals)?;
    completed(Role::Emulated, &args.join, output)
}

pub(crate) fn native(args: &ModelArgs, output: Output) -> Done {
    let (app, formats, hash) = args.run_options().app_and_formats()?;
    let session = args.join.join(Role::Native, hash)?;
    output.note(&format!("running {} natively", app.name()));
    native::run(session, app, formats.as_deref())?;
    completed(Role::Native, &args.join, output)
}

pub(crate) fn golden(args: &ModelArgs, output: Output) -> Done {
    let (app, _, hash) = args.run_options().app_and_formats()?;
    let session = args.join.join(Role::Golden, hash)?;
    output.note(&format!("running {}'s golden model", app.name()));
    golden::run(session, app)?;
    completed(Role::Golden, &args.join, output)
}

/// What a participant that judges nothing says at its end.
fn completed(role: Role, join: &JoinOptions, output: Output) -> Done {
    if output.is_json() {
        output.document(&serde_json::json!({
            "participant": role.to_string(),
            "session": join.session,
            "completed": true,
        }))?;
    }
    Ok(ExitCode::SUCCESS)
}

pub(crate) fn diff(args: &DiffArgs, output: Output) -> Done {
    args.extras.files(&args.run).check()?;
    let setup = args.run.resolve()?;
    let plan = args.extras.dump.plan(setup.app)?;
    args.extras.ci.check(&setup)?;
    // Bad input is told before the others are waited for.
    setup
        .app
        .emulated(&setup.scenario, setup.seed, setup.seconds, &setup.firmware)
        .map_err(Failure::input)?;
    let session = args.join.join(Role::Diff, setup.formats_hash)?;
    let names = Names {
        session: args.report_session.as_deref().unwrap_or(&args.join.session),
        command: &verdict::command_line(&args.run),
    };
    let wanted = Wanted {
        dump: plan.as_ref(),
        plots: args.extras.report.is_some(),
    };
    let outcome = diff::judge(session, &setup, names, &wanted)?;
    verdict::publish(outcome, &args.extras, output)
}

//! `compare`: the main job. Starts the participants, which meet over shared memory, and hands on
//! the differ's result.

use std::io::Write as _;
use std::path::Path;
use std::process::{Command, ExitCode, Stdio};
use std::thread;
use std::time::Duration;

use cardan_compare::Report;
use cardan_link::{
    Ending, Finished, Participant, Role, STALL_TIMEOUT, Session, SessionId, Supervisor,
    SupervisorError, Transport,
};
use cardan_scenario::print_scenario;
use clap::Args;

use super::corners::{self, CornerOptions};
use super::explain;
use crate::arguments::Arguments;
use crate::dump;
use crate::failure::{Done, Failure, code};
use crate::judge::{Names, Wanted};
use crate::output::{Output, to_standard_output};
use crate::participants::{Patience, diff, emulated, golden, join, native};
use crate::run_options::{RunOptions, Setup};
use crate::verdict::{self, Extras};

/// Name of the session in results when the user gave none: results of equal runs are equal.
const AUTOMATIC: &str = "auto";

/// How long participants wait for each other where nobody says.
pub(crate) const PATIENCE: Patience = Patience {
    join_timeout: Duration::from_secs(10),
    stall_timeout: STALL_TIMEOUT,
};

/// Options of `compare`.
#[derive(Args, Debug)]
pub(crate) struct CompareArgs {
    #[command(flatten)]
    pub(crate) run: RunOptions,
    #[command(flatten)]
    extras: Extras,
    #[command(flatten)]
    corners: CornerOptions,
    /// Session in which the participants meet [default: one of its own]
    #[arg(long, value_name = "ID")]
    session: Option<String>,
    #[command(flatten)]
    patience: Patience,
    /// All participants as threads of this process
    #[arg(long)]
    in_process: bool,
    /// Print the scenario, as the other options make it, with all its keys, units, defaults and sources, and
    /// stop
    #[arg(long, conflicts_with_all = ["session", "report", "dump", "junit", "baseline", "annotations"])]
    print_scenario: bool,
    /// Say what a node is, its unit, format, range and resolution, what enters it, what uses it, and its
    /// limit; `all` for every node; and stop
    #[arg(long, value_name = "NODE", conflicts_with_all = ["corners", "session", "report",
        "dump", "junit", "baseline", "annotations", "print_scenario"])]
    explain: Option<String>,
    /// Write nodes.md and nodes.svg into this folder, and stop
    #[arg(long, value_name = "DIR", hide = true)]
    explain_docs: Option<std::path::PathBuf>,
}

impl CompareArgs {
    /// Options that say how something is done are refused where it is not done. (The parser asks for it only
    /// where nothing else forbids it.)
    fn check_alone(&self) -> Result<(), Failure> {
        let corners = self.corners.corners.is_some();
        let builds = self.run.build || self.run.wordlengths.is_some();
        let dump = self.extras.dump.file().is_some();
        let alone = [
            ("--mc", self.corners.has_units() && !corners, "--corners"),
            ("--jobs", self.corners.has_jobs() && !corners, "--corners"),
            (
                "--margin",
                self.extras.ci.has_margin() && self.extras.ci.baseline().is_none(),
                "--baseline",
            ),
            (
                "--dump-signal",
                !self.extras.dump.signals().is_empty() && !dump,
                "--dump",
            ),
            (
                "--checkout",
                self.run.checkout.is_some() && !builds,
                "--build or --wordlengths",
            ),
        ];
        for (option, is_alone, needed) in alone {
            if is_alone {
                return Err(Failure::input(format!(
                    "{option}: has no effect without {needed}; give that too, or leave it out"
                )));
            }
        }
        if corners && self.in_process {
            return Err(Failure::input(
                "--in-process: corners are compared in processes of their own; leave it out",
            ));
        }
        Ok(())
    }
}

pub(crate) fn compare(args: &CompareArgs, output: Output) -> Done {
    args.check_alone()?;
    if let Some(node) = &args.explain {
        args.run.check_files()?;
        return explain::execute(node, &args.run, output);
    }
    if let Some(folder) = &args.explain_docs {
        return explain::write_documents(folder, &args.run, output);
    }
    if args.print_scenario {
        return print(&args.run, output);
    }
    args.extras.files(&args.run).check()?;
    let session: SessionId = match &args.session {
        Some(id) => id.parse().map_err(Failure::input)?,
        None => SessionId::fresh(),
    };
    args.run.announce_build(output)?;
    // Every bad input is told here, before anything starts.
    let setup = args.run.resolve()?;
    let plan = args.extras.dump.plan(setup.app)?;
    args.extras.ci.check(&setup)?;
    setup.announce(output)?;
    setup
        .app
        .emulated(&setup.scenario, setup.seed, setup.seconds, &setup.firmware)
        .map_err(Failure::input)?;
    if let Some(file) = &args.corners.corners {
        let run = args.run.with_image_of(&setup);
        let folder = args.extras.report.as_deref();
        return corners::execute(&args.corners, file, &run, &setup, (folder, output));
    }
    if args.in_process {
        in_threads(args, &setup, plan.as_ref(), session, output)
    } else {
        let run = args.run.with_image_of(&setup);
        in_processes(args, &run, &session, output)
    }
}

/// Prints a scenario, as a file that is one; as JSON its keys and values.
fn print(run: &RunOptions, output: Output) -> Done {
    run.check_files()?;
    let (mut scenario, _) = run.changed_scenario()?;
    scenario.seconds = run.seconds_of(&scenario)?;
    let text = print_scenario(&scenario);
    if output.is_json() {
        let values: toml::Value = toml::from_str(&text).map_err(Failure::participant)?;
        output.document(&values)?;
    } else {
        output.result(&text)?;
    }
    Ok(ExitCode::SUCCESS)
}

fn in_processes(args: &CompareArgs, run: &RunOptions, session: &SessionId, output: Output) -> Done {
    let program = std::env::current_exe()
        .map_err(|error| Failure::participant(format!("this program cannot be found: {error}")))?;
    let participants = [Role::Emulated, Role::Native, Role::Golden, Role::Diff]
        .map(|role| participant(args, run, role, &program, session, output));
    let finished = Supervisor::start(session, participants.into())
        .and_then(|supervisor| supervisor.stall_timeout(args.patience.stall_timeout).wait())
        .map_err(ended_early)?;
    let diff = finished
        .into_iter()
        .find(|finished| finished.role == Role::Diff);
    let Some(Finished {
        code,
        stdout,
        stderr,
        ..
    }) = diff
    else {
        return Err(Failure::participant("participant 'diff' left no result"));
    };
    // Where even errors go nothing can be told of an error.
    let _ = std::io::stderr().write_all(stderr.as_bytes());
    to_standard_output(&stdout, false)?;
    Ok(ExitCode::from(
        u8::try_from(code).unwrap_or(code::PARTICIPANT),
    ))
}

fn participant(
    args: &CompareArgs,
    run: &RunOptions,
    role: Role,
    program: &Path,
    session: &SessionId,
    output: Output,
) -> Participant {
    let mut command = Command::new(program);
    command.arg(match role {
        Role::Emulated => "emulate",
        Role::Native => "native",
        Role::Golden => "golden",
        Role::Diff => "diff",
    });
    command
        .arg("--session")
        .arg(session.as_str())
        .arg("--quiet")
        .args(args.patience.arguments())
        .stdout(Stdio::null());
    match role {
        Role::Native | Role::Golden => {
            let mut own = Arguments::default();
            own.give("--app", &args.run.app);
            own.give_some("--wordlengths", args.run.wordlengths.as_ref());
            command.args(own);
        }
        Role::Emulated | Role::Diff => {
            let mut own = run.arguments_here();
            for name in args.extras.dump.signals() {
                own.give("--dump-signal", name);
            }
            command.args(own);
        }
    }
    let mut participant = Participant::new(role, command);
    if role == Role::Diff {
        let mut own = args.extras.ci.arguments();
        let shown = args.session.as_deref().unwrap_or(AUTOMATIC);
        own.give("--report-session", shown);
        if output.is_json() {
            own.switch("--json");
        }
        own.give_some("--report", args.extras.report.as_deref());
        own.give_some("--dump", args.extras.dump.file());
        participant.command.args(own);
        // Its text goes through a pipe, and is laid out for what this process writes to.
        let style = output.style();
        participant.command.env("COLUMNS", style.width.to_string());
        if style.color {
            participant.command.env("CLICOLOR_FORCE", "1");
        } else {
            participant.command.env("NO_COLOR", "1");
        }
        participant.capture_stdout = true;
        participant.completes_with = vec![code::PASS.into(), code::FAIL.into(), code::CRASH.into()];
    }
    participant
}

/// A participant that refuses its input is bad input; any other end is exit 3 with its name.
fn ended_early(error: SupervisorError) -> Failure {
    match &error {
        SupervisorError::ParticipantDied {
            how: Ending::Exit(exit),
            ..
        } if *exit == i32::from(code::INPUT) => Failure::input(error),
        _ => Failure::participant(error),
    }
}

fn in_threads(
    args: &CompareArgs,
    setup: &Setup,
    plan: Option<&dump::Plan>,
    session: SessionId,
    output: Output,
) -> Done {
    let names = Names {
        session: args.session.as_deref().unwrap_or(AUTOMATIC),
        command: &verdict::command_line(&args.run),
    };
    let wanted = Wanted {
        dump: plan,
        plots: args.extras.report.is_some(),
    };
    let signals = plan.map(dump::Plan::signals).unwrap_or_default();
    let outcome = threads(setup, &session, signals, args.patience, |session| {
        diff::judge(session, setup, names, &wanted)
    })?;
    verdict::publish(outcome, &args.extras, output)
}

/// The verdict of a run in this process, for other commands.
pub(crate) fn report(run: &RunOptions) -> Result<Report, Failure> {
    let setup = run.resolve()?;
    let names = Names {
        session: AUTOMATIC,
        command: &verdict::command_line(run),
    };
    let outcome = threads(&setup, &SessionId::fresh(), &[], PATIENCE, |session| {
        diff::judge(session, &setup, names, &Wanted::default())
    })?;
    Ok(outcome.report)
}

/// Everything that a run publishes.
pub(crate) fn collected(setup: &Setup) -> Result<diff::Collected, Failure> {
    threads(setup, &SessionId::fresh(), &[], PATIENCE, |session| {
        diff::collect(session, setup)
    })
}

/// Runs all participants as threads; `judge` is the last of them.
fn threads<T>(
    setup: &Setup,
    session: &SessionId,
    signals: &[dump::Signal],
    patience: Patience,
    judge: impl FnOnce(Session) -> Result<T, Failure>,
) -> Result<T, Failure> {
    let join = |role: Role| {
        join(
            role,
            session.clone(),
            setup.formats_hash,
            Transport::InProcess,
            patience,
        )
    };
    thread::scope(|scope| {
        let emulated = scope.spawn(|| emulated::run(join(Role::Emulated)?, setup, signals));
        let native =
            scope.spawn(|| native::run(join(Role::Native)?, setup.app, setup.formats.as_deref()));
        let golden = scope.spawn(|| golden::run(join(Role::Golden)?, setup.app));
        let judged = join(Role::Diff).and_then(judge);
        for (name, thread) in [
            ("emulated", emulated),
            ("native", native),
            ("golden", golden),
        ] {
            match thread.join() {
                Ok(done) => done?,
                Err(_) => {
                    return Err(Failure::participant(format!(
                        "participant '{name}' panicked"
                    )));
                }
            }
        }
        judged
    })
}

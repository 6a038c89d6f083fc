//! A participant for tests: plays any role with made-up data that every reader can check.
//!
//! `link-participant ROLE SESSION [records=N] [batch=N] [batches=N] [slow=MICROSECONDS] [blob=BYTES]
//! [join=MILLISECONDS] [format=N] [stall=SECONDS]`
//!
//! `link-participant supervise SESSION [key=value]...` starts all four and tells how they ended.

use std::process::{Command, ExitCode};
use std::time::Duration;

use cardan_link::{LinkError, Options, Participant, Role, Supervisor};
use roles::{Load, take_part};

mod roles;

fn main() -> ExitCode {
    let args: Vec<_> = std::env::args().skip(1).collect();
    if args.first().is_some_and(|first| first == "supervise") {
        return supervise(&args[1..]);
    }
    let (options, load) = match parse(&args) {
        Ok(parsed) => parsed,
        Err(error) => {
            eprintln!("{error}");
            return ExitCode::from(2);
        }
    };
    let role = options.role;
    match take_part(options, load) {
        Ok((counters, seconds)) => {
            println!(
                "{role}: sent {} received {} messages, {} records, {} lost, {seconds:.3} s",
                counters.sent.messages,
                counters.received.messages,
                counters.received.records,
                counters.lost
            );
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("{role}: {error}");
            ExitCode::from(error.exit_code() as u8)
        }
    }
}

fn supervise(args: &[String]) -> ExitCode {
    let program = std::env::current_exe().expect("this program has a path");
    let session = args[0].parse().expect("a session id");
    let participants = Role::ALL.map(|role| {
        let mut command = Command::new(&program);
        command.arg(role.name()).args(args);
        Participant {
            capture_stdout: true,
            ..Participant::new(role, command)
        }
    });
    match Supervisor::start(&session, participants.into()).and_then(Supervisor::wait) {
        Ok(finished) => {
            finished
                .iter()
                .for_each(|one| print!("{}", String::from_utf8_lossy(&one.stdout)));
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("{error}");
            ExitCode::from(error.exit_code() as u8)
        }
    }
}

fn parse(args: &[String]) -> Result<(Options, Load), String> {
    let [role, session, settings @ ..] = args else {
        return Err("usage: link-participant ROLE SESSION [key=value]...".to_owned());
    };
    let session = session.parse().map_err(|e: LinkError| e.to_string())?;
    let mut options = Options::new(role.parse()?, session);
    let mut load = Load {
        records: 20_000,
        slow: Duration::ZERO,
        blob: 100_000,
        stall: Duration::ZERO,
    };
    for setting in settings {
        let (key, value) = setting
            .split_once('=')
            .ok_or(format!("'{setting}' is no key=value"))?;
        let value: u64 = value.parse().map_err(|e| format!("{setting}: {e}"))?;
        match key {
            "records" => load.records = value,
            "batch" => options.batch_records = value as usize,
            "batches" => options.buffered_batches = value as usize,
            "slow" => load.slow = Duration::from_micros(value),
            "blob" => load.blob = value as usize,
            "join" => options.join_timeout = Duration::from_millis(value),
            "format" => options.format_hash = value,
            "stall" => load.stall = Duration::from_secs(value),
            _ => return Err(format!("unknown setting '{key}'")),
        }
    }
    Ok((options, load))
}

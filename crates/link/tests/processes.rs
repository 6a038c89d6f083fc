//! Participants as processes: deaths at random moments, and nothing left afterwards.

mod common;

use std::collections::BTreeSet;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use cardan_link::{
    Ending, Finished, LinkError, Options, Participant, Role, Session, SessionId, Supervisor,
    SupervisorError,
};
use common::{Watchdog, alone, assert_no_traces, traces};

const PROGRAM: &str = env!("CARGO_BIN_EXE_link-participant");

/// Contract: a death is noticed, and the run over, within this time.
const NOTICED: Duration = Duration::from_secs(2);

/// A run that lasts about a second: emulated sleeps in the middle of it.
const LONG: &[&str] = &["records=50000", "stall=1"];

fn command(role: Role, session: &SessionId, settings: &[&str]) -> Command {
    let mut command = Command::new(PROGRAM);
    command
        .arg(role.name())
        .arg(session.as_str())
        .args(settings);
    command
}

fn start(session: &SessionId, settings: &[&str]) -> Supervisor {
    let participants = Role::ALL.map(|role| {
        let command = command(role, session, settings);
        Participant {
            capture_stdout: true,
            ..Participant::new(role, command)
        }
    });
    Supervisor::start(session, participants.into()).expect("all start")
}

fn pids(supervisor: &Supervisor) -> BTreeSet<u32> {
    Role::ALL
        .iter()
        .filter_map(|&role| supervisor.pid(role))
        .collect()
}

fn kill(pid: u32) {
    let killed = Command::new("kill")
        .args(["-KILL", &pid.to_string()])
        .status();
    assert!(
        killed.expect("kill is there").success(),
        "{pid} cannot be killed"
    );
}

/// Without a supervisor, as on terminals of their own.
fn by_hand(role: Role, session: &SessionId, settings: &[&str]) -> Child {
    command(role, session, settings)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("starts")
}

fn message(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The n-th number of a fixed sequence (SplitMix64).
fn random(n: u64) -> u64 {
    let mut z = n.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Kills `role` 20 times: every other time within the start-up, else within the whole run.
fn dies_at_random_moments(role: Role) {
    let _watchdog = Watchdog::new(200);
    let _alone = alone();
    let mut worst = Duration::ZERO;
    for n in 0..20 {
        let window_us = if n % 2 == 0 { 60_000 } else { 800_000 };
        let moment = Duration::from_micros(random(100 * role as u64 + n) % window_us);
        let session = SessionId::fresh();
        let supervisor = start(&session, LONG);
        let (pids, victim) = (pids(&supervisor), supervisor.pid(role).expect("runs"));
        let killer = std::thread::spawn(move || {
            std::thread::sleep(moment);
            kill(victim);
            Instant::now()
        });
        let error = supervisor.wait().expect_err("a participant was killed");
        let took = killer.join().expect("kills").elapsed();
        match &error {
            SupervisorError::ParticipantDied {
                role: named, how, ..
            } => {
                assert_eq!(
                    (*named, *how),
                    (role, Ending::Signal(9)),
                    "after {moment:?}: {error}"
                );
            }
            _ => panic!("{error}"),
        }
        assert_eq!(error.exit_code(), 3);
        assert!(took < NOTICED, "killed after {moment:?}: took {took:?}");
        assert_no_traces(&session, &pids, &format!("killed after {moment:?}"));
        worst = worst.max(took);
    }
    println!("{role} killed 20 times: run over after at most {worst:?}");
}

#[test]
fn emulated_killed_at_random_moments_ends_the_run_by_name_and_leaves_nothing() {
    dies_at_random_moments(Role::Emulated);
}

#[test]
fn native_killed_at_random_moments_ends_the_run_by_name_and_leaves_nothing() {
    dies_at_random_moments(Role::Native);
}

#[test]
fn golden_killed_at_random_moments_ends_the_run_by_name_and_leaves_nothing() {
    dies_at_random_moments(Role::Golden);
}

#[test]
fn diff_killed_at_random_moments_ends_the_run_by_name_and_leaves_nothing() {
    dies_at_random_moments(Role::Diff);
}

#[test]
fn a_complete_run_leaves_nothing_and_returns_what_its_children_printed() {
    let _watchdog = Watchdog::new(60);
    let _alone = alone();
    let session = SessionId::fresh();
    let supervisor = start(&session, &[]);
    let pids = pids(&supervisor);
    let finished = supervisor.wait().expect("completes");
    assert_eq!(
        finished.iter().map(|one| one.role).collect::<Vec<_>>(),
        Role::ALL
    );
    for Finished {
        role, code, stdout, ..
    } in &finished
    {
        assert_eq!(*code, 0);
        let stdout = String::from_utf8_lossy(stdout);
        assert!(
            stdout.starts_with(role.name()) && stdout.contains(" 0 lost"),
            "{stdout}"
        );
    }
    assert_no_traces(&session, &pids, "afterwards");
}

#[test]
fn two_sessions_side_by_side_never_meet_and_a_death_in_one_leaves_the_other_alone() {
    let _watchdog = Watchdog::new(60);
    let _alone = alone();
    let (doomed, healthy) = (SessionId::fresh(), SessionId::fresh());
    let (first, second) = (start(&doomed, LONG), start(&healthy, LONG));
    let both: BTreeSet<_> = pids(&first).union(&pids(&second)).copied().collect();
    std::thread::sleep(Duration::from_millis(200));
    assert!(
        !traces(&doomed, &BTreeSet::new()).is_empty(),
        "a running session has traces"
    );
    kill(first.pid(Role::Native).expect("runs"));
    let first = first.wait().expect_err("native was killed");
    assert!(matches!(
        first,
        SupervisorError::ParticipantDied {
            role: Role::Native,
            ..
        }
    ));
    assert_eq!(second.wait().expect("is not concerned").len(), 4);
    for session in [doomed, healthy] {
        assert_no_traces(&session, &both, "afterwards");
    }
}

#[test]
fn a_participant_that_computes_for_seconds_is_not_taken_for_dead() {
    let _watchdog = Watchdog::new(60);
    let _alone = alone();
    let session = SessionId::fresh();
    let finished = start(&session, &["records=1000", "stall=4"]).wait();
    assert_eq!(finished.expect("completes").len(), 4);
}

/// Starts `link-participant supervise`, kills it after `moment` and returns its children's pids
/// when they have ended.
fn kill_supervisor(session: &SessionId, settings: &[&str], moment: Duration) -> BTreeSet<u32> {
    let mut supervisor = Command::new(PROGRAM)
        .args(["supervise", session.as_str()])
        .args(settings)
        .stderr(Stdio::null())
        .spawn()
        .expect("starts");
    std::thread::sleep(moment);
    let children = children_of(supervisor.id());
    kill(supervisor.id());
    supervisor.wait().expect("is reaped");
    let start = Instant::now();
    while children.iter().any(|&pid| is_running(pid)) {
        assert!(
            start.elapsed() < NOTICED,
            "children outlive their supervisor"
        );
        std::thread::sleep(Duration::from_millis(10));
    }
    children
}

#[test]
fn children_end_when_their_supervisor_is_killed_at_any_moment_and_leave_nothing() {
    let _watchdog = Watchdog::new(120);
    let _alone = alone();
    let mut ended = 0;
    for n in 0..12 {
        let session = SessionId::fresh();
        let moment = Duration::from_micros(20_000 + random(n) % 100_000);
        let endless = ["records=1000000000000"];
        let children = kill_supervisor(&session, &endless, moment);
        assert_no_traces(&session, &children, &format!("after {moment:?}"));
        ended += children.len();
    }
    assert!(ended > 12, "only {ended} children in 12 runs");
}

#[test]
fn what_a_child_that_had_to_be_ended_left_is_removed_by_the_next_session() {
    let _watchdog = Watchdog::new(60);
    let _alone = alone();
    let session = SessionId::fresh();
    // Emulated sleeps and does not notice by itself that its supervisor is gone.
    let asleep = ["records=50000", "stall=20"];
    let children = kill_supervisor(&session, &asleep, Duration::from_millis(500));
    assert_eq!(children.len(), 4);
    let next = start(&SessionId::fresh(), &[]).wait();
    assert_eq!(next.expect("completes").len(), 4);
    assert_no_traces(&session, &children, "after the next session");
}

fn children_of(pid: u32) -> BTreeSet<u32> {
    let tasks = std::fs::read_dir(format!("/proc/{pid}/task")).expect("the supervisor runs");
    let lists = tasks
        .flatten()
        .map(|task| std::fs::read_to_string(task.path().join("children")));
    let children: String = lists.flatten().collect();
    children
        .split_whitespace()
        .map(|pid| pid.parse().expect("a number"))
        .collect()
}

/// True unless the process is gone or only waits to be reaped.
fn is_running(pid: u32) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    stat.rsplit(')')
        .next()
        .is_some_and(|rest| !rest.is_empty() && !rest.starts_with(" Z"))
}

#[test]
fn participants_started_by_hand_name_the_one_that_was_killed_and_clean_up() {
    let _watchdog = Watchdog::new(120);
    let _alone = alone();
    for victim in Role::ALL {
        let session = SessionId::fresh();
        let children = Role::ALL.map(|role| (role, by_hand(role, &session, LONG)));
        let pids: BTreeSet<_> = children.iter().map(|(_, child)| child.id()).collect();
        std::thread::sleep(Duration::from_millis(300));
        kill(children[victim as usize].1.id());
        let killed_at = Instant::now();
        for (role, child) in children {
            let output = child.wait_with_output().expect("ends");
            if role != victim {
                let text = message(&output);
                assert_eq!(output.status.code(), Some(3), "{role}: {text}");
                assert!(
                    text.contains(&format!("participant '{victim}' was killed")),
                    "{role}: {text}"
                );
            }
        }
        assert!(
            killed_at.elapsed() < NOTICED,
            "took {:?}",
            killed_at.elapsed()
        );
        assert_no_traces(&session, &pids, &format!("{victim} killed"));
    }
}

#[test]
fn a_session_by_hand_completes_and_leaves_nothing() {
    let _watchdog = Watchdog::new(60);
    let _alone = alone();
    let session = SessionId::fresh();
    let children = Role::ALL.map(|role| {
        std::thread::sleep(Duration::from_millis(150));
        by_hand(role, &session, &[])
    });
    let pids: BTreeSet<_> = children.iter().map(Child::id).collect();
    for child in children {
        let output = child.wait_with_output().expect("ends");
        assert!(output.status.success(), "{}", message(&output));
    }
    assert_no_traces(&session, &pids, "afterwards");
}

#[test]
fn a_role_that_is_not_started_by_hand_is_named_after_the_join_timeout() {
    let _watchdog = Watchdog::new(60);
    let _alone = alone();
    let session = SessionId::fresh();
    let roles = [Role::Emulated, Role::Native, Role::Diff];
    let children = roles.map(|role| by_hand(role, &session, &["join=700"]));
    let pids: BTreeSet<_> = children.iter().map(Child::id).collect();
    let outputs = children.map(|child| child.wait_with_output().expect("ends"));
    assert!(outputs.iter().all(|output| output.status.code() == Some(3)));
    let named = |output: &Output| message(output).contains("golden did not join");
    assert!(outputs.iter().any(named), "{outputs:?}");
    assert_no_traces(&session, &pids, "afterwards");
}

#[test]
fn a_child_that_refuses_its_input_is_named_with_its_message_and_exit_code_2() {
    let _watchdog = Watchdog::new(60);
    let _alone = alone();
    let session = SessionId::fresh();
    let participants = Role::ALL.map(|role| {
        let settings: &[&str] = if role == Role::Golden {
            &["tea=1"]
        } else {
            LONG
        };
        Participant::new(role, command(role, &session, settings))
    });
    let supervisor = Supervisor::start(&session, participants.into()).expect("all start");
    let pids = pids(&supervisor);
    let error = supervisor.wait().expect_err("golden refuses");
    assert_eq!(error.exit_code(), 2);
    assert_eq!(
        error.to_string(),
        "participant 'golden' ended with exit code 2; it said: unknown setting 'tea'"
    );
    assert_no_traces(&session, &pids, "afterwards");
}

#[test]
fn a_program_that_is_not_there_is_named_and_the_others_are_ended() {
    let _watchdog = Watchdog::new(60);
    let _alone = alone();
    let session = SessionId::fresh();
    let missing = Command::new("no-such-program-anywhere");
    let participants = vec![
        Participant::new(Role::Emulated, command(Role::Emulated, &session, LONG)),
        Participant::new(Role::Native, missing),
    ];
    let error = Supervisor::start(&session, participants)
        .err()
        .expect("cannot start");
    assert!(
        matches!(
            error,
            SupervisorError::CouldNotStart {
                role: Role::Native,
                ..
            }
        ),
        "{error}"
    );
    assert!(
        error.to_string().contains("no-such-program-anywhere"),
        "{error}"
    );
    assert_no_traces(&session, &BTreeSet::new(), "afterwards");
}

#[test]
fn a_session_id_can_be_used_again_after_all_its_participants_were_killed() {
    let _watchdog = Watchdog::new(60);
    let _alone = alone();
    let session = SessionId::fresh();
    let mut children = Role::ALL.map(|role| by_hand(role, &session, LONG));
    let mut pids: BTreeSet<_> = children.iter().map(Child::id).collect();
    std::thread::sleep(Duration::from_millis(300));
    for child in &mut children {
        child.kill().expect("runs");
    }
    for child in &mut children {
        child.wait().expect("is reaped");
    }
    let children = Role::ALL.map(|role| by_hand(role, &session, &[]));
    pids.extend(children.iter().map(Child::id));
    for child in children {
        let output = child.wait_with_output().expect("ends");
        assert!(output.status.success(), "{}", message(&output));
    }
    assert_no_traces(&session, &pids, "afterwards");
}

#[test]
fn a_dead_session_does_not_take_a_running_one_of_another_name_with_it() {
    let _watchdog = Watchdog::new(60);
    let _alone = alone();
    let (living, dead) = (SessionId::fresh(), SessionId::fresh());
    let running = start(&living, LONG);
    cardan_link::cleanup(&dead);
    cardan_link::cleanup(&living);
    let join_timeout = Duration::from_millis(100);
    let error = Session::join(Options {
        join_timeout,
        ..Options::new(Role::Diff, dead)
    })
    .err();
    assert!(matches!(error, Some(LinkError::JoinTimeout { .. })));
    assert_eq!(running.wait().expect("is not concerned").len(), 4);
}

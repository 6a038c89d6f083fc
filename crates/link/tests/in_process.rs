//! Whole sessions in threads of one process, over both transports with the same code.

mod common;
#[path = "../participant/roles.rs"]
mod roles;

use std::time::Duration;

use cardan_link::stream::{Events, Frames, Instants, Nodes};
use cardan_link::{
    Counters, Death, Frame, LinkError, Options, Role, Session, SessionId, Transport,
};
use common::Watchdog;
use roles::{Load, take_part};

const BOTH: [Transport; 2] = [Transport::InProcess, Transport::Processes];

fn options(role: Role, session: &SessionId, transport: Transport) -> Options {
    Options {
        transport,
        ..Options::new(role, session.clone())
    }
}

/// Plays all four roles in threads.
fn play(load: Load, adjust: impl Fn(Options) -> Options) -> Vec<Result<Counters, LinkError>> {
    let session = SessionId::fresh();
    let roles = Role::ALL.map(|role| {
        let options = adjust(Options::new(role, session.clone()));
        std::thread::spawn(move || take_part(options, load).map(|(counters, _)| counters))
    });
    roles
        .map(|thread| thread.join().expect("no role panics"))
        .into()
}

/// Runs two roles in threads and returns how each ended.
fn pair<A: Send + 'static>(
    transport: Transport,
    emulated: impl FnOnce(Session) -> A + Send + 'static,
    diff: impl FnOnce(Session) -> A,
) -> (A, A) {
    let session = SessionId::fresh();
    let expected = vec![Role::Emulated, Role::Diff];
    let options = |role| Options {
        expected: expected.clone(),
        ..options(role, &session, transport)
    };
    let upstream = options(Role::Emulated);
    let thread =
        std::thread::spawn(move || emulated(Session::join(upstream).expect("diff joins too")));
    let here = diff(Session::join(options(Role::Diff)).expect("emulated joins too"));
    (thread.join().expect("does not panic"), here)
}

#[test]
fn all_four_exchange_everything_without_loss_over_both_transports() {
    let _watchdog = Watchdog::new(120);
    for transport in BOTH {
        let ended = play(Load::default(), |options| Options {
            transport,
            ..options
        });
        let counters: Vec<_> = ended
            .into_iter()
            .map(|end| end.expect("completes"))
            .collect();
        let sent: u64 = counters.iter().map(|c| c.sent.messages).sum();
        let [_, _, _, diff] = counters[..] else {
            panic!("four roles")
        };
        assert_eq!(diff.received.messages, sent, "diff reads all there is");
        assert!(counters.iter().all(|c| c.lost == 0));
    }
}

#[test]
fn the_counters_of_two_runs_are_equal() {
    let _watchdog = Watchdog::new(120);
    let run = || {
        let ended = play(Load::default(), |o| Options {
            transport: Transport::InProcess,
            ..o
        });
        ended.into_iter().map(|end| end.expect("completes"))
    };
    let (one, other): (Vec<Counters>, Vec<Counters>) = (run().collect(), run().collect());
    assert!(one.iter().any(|counters| counters.sent.messages > 0));
    assert_eq!(one, other);
}

#[test]
fn millions_of_records_survive_buffers_of_one_slice_and_a_slow_reader() {
    let _watchdog = Watchdog::new(300);
    for transport in BOTH {
        let load = Load {
            records: 1_500_000,
            slow: Duration::from_micros(50),
            ..Load::default()
        };
        let tight = |o: Options| Options {
            transport,
            batch_records: 100,
            buffered_batches: 1,
            ..o
        };
        for end in play(load, tight) {
            assert_eq!(end.expect("completes").lost, 0);
        }
    }
}

#[test]
fn blobs_of_many_megabytes_pass_through_buffers_of_one_slice() {
    let _watchdog = Watchdog::new(120);
    let load = Load {
        blob: 20_000_001,
        ..Load::default()
    };
    for end in play(load, |o| Options {
        buffered_batches: 1,
        ..o
    }) {
        assert_eq!(end.expect("completes").lost, 0);
    }
}

#[test]
fn a_session_without_a_record_completes() {
    let _watchdog = Watchdog::new(60);
    for transport in BOTH {
        let ended = pair(transport, |s| s.close(), |s| s.close());
        assert!(matches!(ended, (Ok(_), Ok(_))));
    }
}

#[test]
fn dropping_a_session_before_its_end_is_noticed_and_named() {
    let _watchdog = Watchdog::new(60);
    for transport in BOTH {
        let read = |s: Session| {
            let reader = s.reader(Role::Emulated, Events).expect("routed");
            reader.collect().map(drop).expect_err("the writer goes")
        };
        let leave = |session: Session| {
            drop(session);
            LinkError::SupervisorDied
        };
        let (_, error) = pair(transport, leave, read);
        let gave_up = LinkError::PeerDied {
            role: Role::Emulated,
            how: Death::Aborted,
        };
        assert_eq!(error, gave_up);
    }
}

#[test]
fn a_writer_that_waits_for_a_full_buffer_notices_that_its_reader_gave_up() {
    let _watchdog = Watchdog::new(60);
    for transport in BOTH {
        let write = |session: Session| {
            let mut truth = session.writer(Frames).expect("routed");
            let frame = Frame::new(0, b"frame").expect("short");
            std::iter::repeat_with(|| truth.push(frame)).find_map(Result::err)
        };
        let leave = |session: Session| {
            // Long enough for the buffers to fill up.
            std::thread::sleep(Duration::from_millis(300));
            drop(session);
            None
        };
        let (error, _) = pair(transport, write, leave);
        assert!(
            matches!(
                error,
                Some(LinkError::PeerDied {
                    role: Role::Diff,
                    ..
                })
            ),
            "{error:?}"
        );
    }
}

#[test]
fn closing_with_an_unfinished_writer_is_refused_by_name() {
    let _watchdog = Watchdog::new(60);
    let forget = |session: Session| {
        let _nodes = session.writer(Nodes);
        session.close().expect_err("nodes are unfinished")
    };
    let other = |session: Session| session.close().expect_err("emulated gave up");
    let (error, other) = pair(Transport::InProcess, forget, other);
    assert_eq!(
        error,
        LinkError::Unfinished {
            role: Role::Emulated,
            stream: "nodes"
        }
    );
    assert!(matches!(
        other,
        LinkError::PeerDied {
            role: Role::Emulated,
            ..
        }
    ));
}

#[test]
fn each_stream_is_had_once_and_only_by_its_own_roles() {
    let _watchdog = Watchdog::new(60);
    let writer = |session: Session| {
        let truth = session.writer(Instants).expect("emulated publishes it");
        assert!(matches!(
            session.writer(Instants),
            Err(LinkError::NotRouted { .. })
        ));
        assert!(session.reader(Role::Diff, Nodes).is_err());
        truth.finish().and_then(|()| session.close())
    };
    let reader = |session: Session| {
        let truth = session
            .reader(Role::Emulated, Instants)
            .expect("diff reads it");
        assert!(matches!(
            session.reader(Role::Emulated, Instants),
            Err(LinkError::NotRouted { .. })
        ));
        assert!(session.writer(Nodes).is_err());
        truth.collect().and_then(|_| session.close())
    };
    let ended = pair(Transport::InProcess, writer, reader);
    assert!(matches!(ended, (Ok(_), Ok(_))));
}

#[test]
fn a_participant_that_nobody_joins_names_who_is_missing() {
    let _watchdog = Watchdog::new(60);
    for transport in BOTH {
        let session = SessionId::fresh();
        let join_timeout = Duration::from_millis(200);
        let options = Options {
            join_timeout,
            ..options(Role::Golden, &session, transport)
        };
        let error = Session::join(options).err().expect("nobody comes");
        let missing = vec![Role::Emulated, Role::Native, Role::Diff];
        let session = session.to_string();
        assert_eq!(
            error,
            LinkError::JoinTimeout {
                session,
                missing,
                waited: join_timeout
            }
        );
        assert_eq!(error.exit_code(), 3);
    }
}

#[test]
fn a_second_participant_of_a_role_is_refused() {
    let _watchdog = Watchdog::new(60);
    for transport in BOTH {
        let session = SessionId::fresh();
        let patient = options(Role::Golden, &session, transport);
        let patient = Options {
            join_timeout: Duration::from_secs(2),
            ..patient
        };
        let first = std::thread::spawn(move || Session::join(patient).err());
        std::thread::sleep(Duration::from_millis(500));
        let second = Session::join(options(Role::Golden, &session, transport)).err();
        let taken = LinkError::RoleTaken {
            role: Role::Golden,
            session: session.to_string(),
        };
        assert_eq!(second, Some(taken));
        let first = first.join().expect("does not panic");
        assert!(
            matches!(first, Some(LinkError::JoinTimeout { .. })),
            "{first:?}"
        );
    }
}

#[test]
fn participants_with_different_format_tables_do_not_work_together() {
    let _watchdog = Watchdog::new(60);
    let session = SessionId::fresh();
    let threads = [(Role::Emulated, 1), (Role::Diff, 2)].map(|(role, format_hash)| {
        let expected = vec![Role::Emulated, Role::Diff];
        let options = Options {
            format_hash,
            expected,
            ..options(role, &session, Transport::InProcess)
        };
        std::thread::spawn(move || Session::join(options).err())
    });
    let errors = threads.map(|thread| thread.join().expect("does not panic").expect("refused"));
    let named = |error: &LinkError| matches!(error, LinkError::FormatMismatch { .. });
    assert!(errors.iter().any(named), "{errors:?}");
}

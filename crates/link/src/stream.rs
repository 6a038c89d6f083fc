//! The table of streams: what is published, by whom, and who reads it.
//!
//! Data flows one way ([`Role`]), and a participant that waits for data drains all its inputs; so
//! no set of full buffers can make participants wait for each other in a circle.

use crate::error::LinkError;
use crate::record::{
    Event, Frame, Instant, NodeReal, NodeWord, Notice, Record, SignalValue, StageValue, Status,
};
use crate::role::Role;

/// A stream of records of one type. Implemented by the markers of this module only.
pub trait Stream: Copy + 'static {
    /// What one record is.
    type Record: Record;
    /// Part of the service's name.
    const NAME: &'static str;
    /// Roles that publish such a stream.
    const WRITERS: &'static [Role];
    /// Roles that read it from each of the writers other than themselves.
    const READERS: &'static [Role];
}

/// Something to be done for every stream of the table.
pub(crate) trait Visitor {
    fn visit<S: Stream>(&mut self, stream: S) -> Result<(), LinkError>;
}

macro_rules! streams {
    ($($(#[$doc:meta])* $marker:ident = $name:literal, $record:ty: $writers:expr => $readers:expr;)*) => {
        $(
            $(#[$doc])*
            #[derive(Debug, Clone, Copy, PartialEq, Eq)]
            pub struct $marker;

            impl Stream for $marker {
                type Record = $record;
                const NAME: &'static str = $name;
                const WRITERS: &'static [Role] = $writers;
                const READERS: &'static [Role] = $readers;
            }
        )*

        /// Visits every stream of the table, in its order.
        pub(crate) fn for_each(visitor: &mut impl Visitor) -> Result<(), LinkError> {
            $( visitor.visit($marker)?; )*
            Ok(())
        }
    };
}

const EMULATED: &[Role] = &[Role::Emulated];
const FIRMWARES: &[Role] = &[Role::Emulated, Role::Native];
const MODELS: &[Role] = &[Role::Native, Role::Golden];
const DIFF: &[Role] = &[Role::Diff];
const UPSTREAM: &[Role] = &[Role::Emulated, Role::Native, Role::Golden];
const DOWNSTREAM: &[Role] = &[Role::Native, Role::Golden, Role::Diff];
const ALL: &[Role] = &Role::ALL;

streams! {
    /// What each participant tells all others; the sessions' own, not for users.
    Notices = "notices", Notice: ALL => ALL;
    /// What the firmware took in: codes with their ideal voltages, bytes, edges.
    Events = "events", Event: EMULATED => DOWNSTREAM;
    /// The instants that solutions stand for.
    Instants = "instants", Instant: EMULATED => DOWNSTREAM;
    /// Node values of the deployed arithmetic.
    Nodes = "nodes", NodeWord: FIRMWARES => DIFF;
    /// Frames off the serial port.
    Frames = "frames", Frame: FIRMWARES => DIFF;
    /// Real node values on the codes: golden's, and native's in the real interpretation.
    RealNodes = "real-nodes", NodeReal: MODELS => DIFF;
    /// Values along the product's chain that are no nodes of native, emulated or golden on the codes.
    Stages = "stages", StageValue: UPSTREAM => DIFF;
    /// Status words of the models on the codes: golden's, and native's in the real interpretation.
    Statuses = "statuses", Status: MODELS => DIFF;
    /// Pins and inner voltages that are to be dumped; empty unless asked for.
    Signals = "signals", SignalValue: EMULATED => DIFF;
    /// Named byte strings of any length: configuration, calibration, run summary.
    Blobs = "blobs", u8: UPSTREAM => DOWNSTREAM;
}

/// True when `writer` publishes `S` to `reader`.
pub(crate) fn is_routed<S: Stream>(writer: Role, reader: Role) -> bool {
    writer != reader
        && S::WRITERS.contains(&writer)
        && S::READERS.contains(&reader)
        && (S::READERS.len() == Role::ALL.len() || is_upstream(writer, reader))
}

/// Emulated feeds native and golden, and all three feed diff.
fn is_upstream(writer: Role, reader: Role) -> bool {
    matches!(
        (writer, reader),
        (Role::Emulated, Role::Native | Role::Golden)
            | (Role::Emulated | Role::Native | Role::Golden, Role::Diff)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Routes(Vec<(&'static str, Role, Role)>);

    impl Visitor for Routes {
        fn visit<S: Stream>(&mut self, _: S) -> Result<(), LinkError> {
            for writer in Role::ALL {
                for reader in Role::ALL {
                    if is_routed::<S>(writer, reader) {
                        self.0.push((S::NAME, writer, reader));
                    }
                }
            }
            Ok(())
        }
    }

    fn routes() -> Vec<(&'static str, Role, Role)> {
        let mut routes = Routes(Vec::new());
        for_each(&mut routes).expect("visiting cannot fail");
        routes.0
    }

    #[test]
    fn every_data_stream_flows_downstream_so_that_no_circle_can_block() {
        let data = routes()
            .into_iter()
            .filter(|route| route.0 != Notices::NAME);
        for (name, writer, reader) in data {
            assert!(
                writer < reader,
                "{name} flows from {writer} back to {reader}"
            );
        }
    }

    #[test]
    fn everyone_tells_everyone_else_its_notices() {
        let notices = routes()
            .into_iter()
            .filter(|route| route.0 == Notices::NAME)
            .count();
        assert_eq!(notices, 12);
    }

    #[test]
    fn native_and_golden_read_events_and_diff_reads_all_there_is() {
        let all = routes();
        assert!(all.contains(&("events", Role::Emulated, Role::Native)));
        assert!(all.contains(&("events", Role::Emulated, Role::Golden)));
        assert!(!all.contains(&("blobs", Role::Native, Role::Golden)));
        for (name, writer, _) in &all {
            assert!(*writer == Role::Diff || all.contains(&(*name, *writer, Role::Diff)));
        }
    }
}

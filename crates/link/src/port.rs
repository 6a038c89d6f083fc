//! Both ends of a stream with their book-keeping: sequence numbers, counts, end of stream.

use std::any::Any;
use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::rc::Rc;

use crate::error::{Death, LinkError};
use crate::record::{Header, Record};
use crate::role::Role;
use crate::transport::{InPort, OutPort};

/// What every header of a participant carries, and must find in those of its peers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stamp {
    pub(crate) session: u64,
    pub(crate) format: u64,
}

/// Traffic in one direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Traffic {
    /// Slices, ends of streams included.
    pub messages: u64,
    /// Records.
    pub records: u64,
    /// Bytes of the records.
    pub bytes: u64,
}

impl Traffic {
    fn add<T>(cell: &Cell<Self>, records: usize) {
        let mut traffic = cell.get();
        traffic.messages += 1;
        traffic.records += records as u64;
        traffic.bytes += (records * size_of::<T>()) as u64;
        cell.set(traffic);
    }

    pub(crate) fn plus(self, other: Self) -> Self {
        Self {
            messages: self.messages + other.messages,
            records: self.records + other.records,
            bytes: self.bytes + other.bytes,
        }
    }
}

/// An output whatever its records are.
pub(crate) trait AnyOutput {
    fn stream(&self) -> &'static str;
    fn is_finished(&self) -> bool;
    /// Sends the end of the stream.
    fn end(&self) -> Result<(), LinkError>;
    /// Readers that are announced and have not yet seen the end.
    fn readers(&self) -> usize;
    fn expected_readers(&self) -> usize;
    fn traffic(&self) -> Traffic;
    fn as_any(self: Rc<Self>) -> Rc<dyn Any>;
}

pub(crate) struct Output<T: Record> {
    stream: &'static str,
    port: Box<dyn OutPort<T>>,
    readers: Vec<Role>,
    stamp: Stamp,
    next: Cell<u64>,
    records: Cell<u64>,
    finished: Cell<bool>,
    traffic: Cell<Traffic>,
}

impl<T: Record> Output<T> {
    pub(crate) fn new(
        stream: &'static str,
        port: Box<dyn OutPort<T>>,
        readers: Vec<Role>,
        stamp: Stamp,
    ) -> Self {
        Self {
            stream,
            port,
            readers,
            stamp,
            next: Cell::new(0),
            records: Cell::new(0),
            finished: Cell::new(false),
            traffic: Cell::default(),
        }
    }

    /// Sends one slice; an empty one ends the stream.
    pub(crate) fn send(&self, records: &[T]) -> Result<(), LinkError> {
        let header = Header {
            session: self.stamp.session,
            format: self.stamp.format,
            sequence: self.next.get(),
            records_before: self.records.get(),
            cycle: records.first().map_or(0, Record::cycle),
            end: u64::from(records.is_empty()),
        };
        let took = self.port.send(header, records)?;
        if took != self.readers.len() {
            // iceoryx2 counts a reader out that has closed its end.
            let doing = format!("sending {}", self.stream);
            let cause = format!("{took} of {} readers are left", self.readers.len());
            return Err(LinkError::Transport { doing, cause });
        }
        self.next.set(header.sequence + 1);
        self.records
            .set(header.records_before + records.len() as u64);
        self.finished.set(records.is_empty());
        Traffic::add::<T>(&self.traffic, records.len());
        Ok(())
    }
}

impl<T: Record> AnyOutput for Output<T> {
    fn stream(&self) -> &'static str {
        self.stream
    }

    fn is_finished(&self) -> bool {
        self.finished.get()
    }

    fn end(&self) -> Result<(), LinkError> {
        self.send(&[])
    }

    fn readers(&self) -> usize {
        self.port.readers()
    }

    fn expected_readers(&self) -> usize {
        self.readers.len()
    }

    fn traffic(&self) -> Traffic {
        self.traffic.get()
    }

    fn as_any(self: Rc<Self>) -> Rc<dyn Any> {
        self
    }
}

/// An input whatever its records are.
pub(crate) trait AnyInput {
    fn stream(&self) -> &'static str;
    fn writer(&self) -> Role;
    fn connect(&self) -> Result<bool, LinkError>;
    /// Moves what is there into this input's queue; true if there was anything.
    fn drain(&self) -> Result<bool, LinkError>;
    fn has_ended(&self) -> bool;
    fn traffic(&self) -> Traffic;
    fn as_any(self: Rc<Self>) -> Rc<dyn Any>;
}

pub(crate) struct Input<T: Record> {
    stream: &'static str,
    writer: Role,
    /// Dropped at the end of the stream, which tells the writer that all has arrived.
    port: RefCell<Option<Box<dyn InPort<T>>>>,
    stamp: Stamp,
    queue: RefCell<VecDeque<Vec<T>>>,
    next: Cell<u64>,
    records: Cell<u64>,
    traffic: Cell<Traffic>,
    on_end: Option<Box<dyn Fn()>>,
}

impl<T: Record> Input<T> {
    /// `on_end` is called at the end of the stream, before the writer can know that it arrived.
    pub(crate) fn new(
        stream: &'static str,
        writer: Role,
        port: Box<dyn InPort<T>>,
        stamp: Stamp,
        on_end: Option<Box<dyn Fn()>>,
    ) -> Self {
        Self {
            stream,
            writer,
            port: RefCell::new(Some(port)),
            stamp,
            queue: RefCell::default(),
            next: Cell::new(0),
            records: Cell::new(0),
            traffic: Cell::default(),
            on_end,
        }
    }

    /// The oldest slice that has been received and not been taken.
    pub(crate) fn take(&self) -> Option<Vec<T>> {
        self.queue.borrow_mut().pop_front()
    }

    /// Receives at most one slice; true if there was one.
    pub(crate) fn receive(&self) -> Result<bool, LinkError> {
        let received = match &*self.port.borrow() {
            Some(port) => port.receive()?,
            None => None,
        };
        let Some((header, records)) = received else {
            return Ok(false);
        };
        self.check(&header, &records)?;
        self.next.set(header.sequence + 1);
        self.records
            .set(header.records_before + records.len() as u64);
        Traffic::add::<T>(&self.traffic, records.len());
        if header.end == 0 {
            self.queue.borrow_mut().push_back(records);
        } else {
            if let Some(on_end) = &self.on_end {
                on_end();
            }
            self.port.borrow_mut().take();
        }
        Ok(true)
    }

    fn check(&self, header: &Header, records: &[T]) -> Result<(), LinkError> {
        let (role, stream) = (self.writer, self.stream);
        if header.session != self.stamp.session {
            return Err(LinkError::ForeignSession { role, stream });
        }
        let (expected, found) = (self.stamp.format, header.format);
        if found != expected {
            return Err(LinkError::FormatMismatch {
                role,
                expected,
                found,
            });
        }
        let (expected, found) = (self.next.get(), header.sequence);
        if found != expected {
            return Err(LinkError::SequenceGap {
                role,
                stream,
                expected,
                found,
            });
        }
        let (announced, received) = (header.records_before, self.records.get());
        if announced != received || (header.end != 0) != records.is_empty() {
            return Err(LinkError::CountMismatch {
                role,
                stream,
                announced,
                received,
            });
        }
        Ok(())
    }
}

impl<T: Record> AnyInput for Input<T> {
    fn stream(&self) -> &'static str {
        self.stream
    }

    fn writer(&self) -> Role {
        self.writer
    }

    fn connect(&self) -> Result<bool, LinkError> {
        match &*self.port.borrow() {
            Some(port) => port.connect(),
            None => Err(LinkError::PeerDied {
                role: self.writer,
                how: Death::Left,
            }),
        }
    }

    fn drain(&self) -> Result<bool, LinkError> {
        let mut any = false;
        while self.receive()? {
            any = true;
        }
        Ok(any)
    }

    fn has_ended(&self) -> bool {
        self.port.borrow().is_none()
    }

    fn traffic(&self) -> Traffic {
        self.traffic.get()
    }

    fn as_any(self: Rc<Self>) -> Rc<dyn Any> {
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Delivers prepared slices.
    struct Script(RefCell<VecDeque<(Header, Vec<u8>)>>);

    impl InPort<u8> for Script {
        fn receive(&self) -> Result<Option<(Header, Vec<u8>)>, LinkError> {
            Ok(self.0.borrow_mut().pop_front())
        }

        fn connect(&self) -> Result<bool, LinkError> {
            Ok(true)
        }
    }

    const STAMP: Stamp = Stamp {
        session: 11,
        format: 22,
    };

    fn slice(sequence: u64, records_before: u64, bytes: &[u8]) -> (Header, Vec<u8>) {
        let end = u64::from(bytes.is_empty());
        let header = Header {
            session: 11,
            format: 22,
            sequence,
            records_before,
            cycle: 0,
            end,
        };
        (header, bytes.to_vec())
    }

    fn drain(slices: Vec<(Header, Vec<u8>)>) -> (Result<bool, LinkError>, Input<u8>) {
        let script = Script(RefCell::new(slices.into()));
        let input = Input::new("bytes", Role::Emulated, Box::new(script), STAMP, None);
        (input.drain(), input)
    }

    #[test]
    fn slices_in_order_arrive_and_the_end_closes_the_port() {
        let (result, input) = drain(vec![
            slice(0, 0, b"ab"),
            slice(1, 2, b"c"),
            slice(2, 3, b""),
        ]);
        assert_eq!(result, Ok(true));
        assert_eq!(
            (input.take(), input.take(), input.take()),
            (Some(b"ab".to_vec()), Some(b"c".to_vec()), None)
        );
        assert!(input.has_ended());
        assert_eq!(
            input.traffic(),
            Traffic {
                messages: 3,
                records: 3,
                bytes: 3
            }
        );
    }

    #[test]
    fn a_missing_slice_is_an_error_that_names_writer_and_numbers() {
        let (result, _) = drain(vec![slice(0, 0, b"ab"), slice(2, 2, b"c")]);
        let gap = LinkError::SequenceGap {
            role: Role::Emulated,
            stream: "bytes",
            expected: 1,
            found: 2,
        };
        assert_eq!(result, Err(gap));
    }

    #[test]
    fn a_count_that_disagrees_is_an_error_in_the_middle_and_at_the_end() {
        for last in [slice(1, 3, b"c"), slice(1, 1, b"")] {
            let (result, _) = drain(vec![slice(0, 0, b"ab"), last]);
            assert!(matches!(
                result,
                Err(LinkError::CountMismatch { received: 2, .. })
            ));
        }
    }

    #[test]
    fn another_session_or_format_table_is_an_error() {
        let mut foreign = slice(0, 0, b"a");
        foreign.0.session = 12;
        assert!(matches!(
            drain(vec![foreign]).0,
            Err(LinkError::ForeignSession { .. })
        ));
        let mut format = slice(0, 0, b"a");
        format.0.format = 23;
        let mismatch = LinkError::FormatMismatch {
            role: Role::Emulated,
            expected: 22,
            found: 23,
        };
        assert_eq!(drain(vec![format]).0, Err(mismatch));
    }
}

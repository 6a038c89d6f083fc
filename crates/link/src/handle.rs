//! What participants hold: one writer per stream they publish, one reader per stream they read.

use std::rc::Rc;

use crate::error::LinkError;
use crate::port::{Input, Output};
use crate::role::Role;
use crate::shared::Shared;
use crate::stream::Stream;

/// Publishes one stream. Records are collected and sent in slices.
pub struct Writer<S: Stream> {
    shared: Rc<Shared>,
    output: Rc<Output<S::Record>>,
    batch: Vec<S::Record>,
    capacity: usize,
}

impl<S: Stream> Writer<S> {
    pub(crate) fn new(shared: Rc<Shared>, output: Rc<Output<S::Record>>, capacity: usize) -> Self {
        Self {
            shared,
            output,
            batch: Vec::with_capacity(capacity),
            capacity,
        }
    }

    /// The role of this participant.
    pub(crate) fn role(&self) -> Role {
        self.shared.role()
    }

    /// Adds a record; sends the batch when it is full. Waits while a reader's buffer is full.
    ///
    /// # Errors
    /// Whatever ended the session: a death, an abort, the transport.
    pub fn push(&mut self, record: S::Record) -> Result<(), LinkError> {
        self.batch.push(record);
        if self.batch.len() < self.capacity {
            self.shared.check()
        } else {
            self.flush()
        }
    }

    /// Adds many records.
    ///
    /// # Errors
    /// As [`push`](Self::push).
    pub fn extend(&mut self, mut records: &[S::Record]) -> Result<(), LinkError> {
        while !records.is_empty() {
            let (now, later) =
                records.split_at(records.len().min(self.capacity - self.batch.len()));
            self.batch.extend_from_slice(now);
            records = later;
            if self.batch.len() == self.capacity {
                self.flush()?;
            }
        }
        Ok(())
    }

    /// Sends what has been collected.
    ///
    /// # Errors
    /// As [`push`](Self::push).
    pub fn flush(&mut self) -> Result<(), LinkError> {
        self.shared.check()?;
        if !self.batch.is_empty() {
            let sent = self.output.send(&self.batch);
            sent.map_err(|error| self.shared.explain(error))?;
            self.batch.clear();
        }
        Ok(())
    }

    /// Sends what is left and ends the stream, which tells the readers how many records it had.
    ///
    /// # Errors
    /// As [`push`](Self::push).
    pub fn finish(mut self) -> Result<(), LinkError> {
        self.flush()?;
        self.output
            .send(&[])
            .map_err(|error| self.shared.explain(error))
    }
}

/// Reads one stream of one participant.
pub struct Reader<S: Stream> {
    shared: Rc<Shared>,
    input: Rc<Input<S::Record>>,
    writer: Role,
    batch: std::vec::IntoIter<S::Record>,
}

impl<S: Stream> Reader<S> {
    pub(crate) fn new(shared: Rc<Shared>, input: Rc<Input<S::Record>>, writer: Role) -> Self {
        Self {
            shared,
            input,
            writer,
            batch: Vec::new().into_iter(),
        }
    }

    /// The participant that publishes the stream.
    #[must_use]
    pub const fn writer(&self) -> Role {
        self.writer
    }

    /// Waits for records and returns them in order; `None` after the last one.
    ///
    /// While it waits, all other inputs of this participant are drained into memory, so readers
    /// may be read in any order without a deadlock.
    ///
    /// # Errors
    /// Whatever ended the session: a death, an abort, a gap, the transport.
    pub fn next_batch(&mut self) -> Result<Option<Vec<S::Record>>, LinkError> {
        let rest: Vec<_> = std::mem::take(&mut self.batch).collect();
        if !rest.is_empty() {
            return Ok(Some(rest));
        }
        self.shared.next_batch(&self.input)
    }

    /// Waits for the next record; `None` after the last one.
    ///
    /// # Errors
    /// As [`next_batch`](Self::next_batch).
    #[expect(
        clippy::should_implement_trait,
        reason = "fails for good, which an iterator cannot"
    )]
    pub fn next(&mut self) -> Result<Option<S::Record>, LinkError> {
        loop {
            if let Some(record) = self.batch.next() {
                return Ok(Some(record));
            }
            match self.shared.next_batch(&self.input)? {
                Some(batch) => self.batch = batch.into_iter(),
                None => return Ok(None),
            }
        }
    }

    /// Reads the whole stream.
    ///
    /// # Errors
    /// As [`next_batch`](Self::next_batch).
    pub fn collect(mut self) -> Result<Vec<S::Record>, LinkError> {
        let mut all = Vec::new();
        while let Some(batch) = self.next_batch()? {
            all.extend(batch);
        }
        Ok(all)
    }
}

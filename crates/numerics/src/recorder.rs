//! Observers that keep everything: of a mixed run, and of the deployed arithmetic.

use std::cell::RefCell;

use cardan_datapath::Tap;

use crate::Observer;

/// How often a node did not fit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Overflows {
    /// Number of overflows.
    pub count: u64,
    /// Which of the node's writes was the first, from 0.
    pub first: Option<u64>,
}

impl Overflows {
    fn add(&mut self, write: usize) {
        self.count += 1;
        self.first.get_or_insert(write as u64);
    }
}

/// What a run wrote, per node in the order of the node table.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// Every value in the node's unit, in the order of writing. Empty in a deployed recording,
    /// whose words tell the same.
    pub values: Vec<Vec<f64>>,
    /// Every raw word; empty for real nodes.
    pub raws: Vec<Vec<i64>>,
    /// Overflows.
    pub overflows: Vec<Overflows>,
}

impl Recording {
    fn new(nodes: usize) -> Self {
        Self {
            values: vec![Vec::new(); nodes],
            raws: vec![Vec::new(); nodes],
            overflows: vec![Overflows::default(); nodes],
        }
    }
}

/// Keeps every value of a mixed run.
#[derive(Clone, Debug)]
pub struct Recorder(RefCell<Recording>);

impl Recorder {
    /// For an algorithm of `nodes` nodes.
    #[must_use]
    pub fn new(nodes: usize) -> Self {
        Self(RefCell::new(Recording::new(nodes)))
    }

    /// What was recorded so far; nothing is kept.
    pub fn take(&self) -> Recording {
        let nodes = self.0.borrow().values.len();
        self.0.replace(Recording::new(nodes))
    }

    /// What was recorded.
    #[must_use]
    pub fn into_recording(self) -> Recording {
        self.0.into_inner()
    }
}

impl Observer for Recorder {
    fn write(&self, node: usize, value: f64, raw: Option<i64>) {
        let mut recording = self.0.borrow_mut();
        recording.values[node].push(value);
        recording.raws[node].extend(raw);
    }

    fn overflow(&self, node: usize) {
        let mut recording = self.0.borrow_mut();
        let write = recording.values[node].len();
        recording.overflows[node].add(write);
    }
}

/// Keeps every word of the deployed arithmetic.
#[derive(Clone, Debug)]
pub struct DeployedRecorder(RefCell<Recording>);

impl DeployedRecorder {
    /// For an algorithm of `nodes` nodes.
    #[must_use]
    pub fn new(nodes: usize) -> Self {
        Self(RefCell::new(Recording::new(nodes)))
    }

    /// What was recorded so far; nothing is kept.
    pub fn take(&self) -> Recording {
        let nodes = self.0.borrow().raws.len();
        self.0.replace(Recording::new(nodes))
    }
}

impl Tap for DeployedRecorder {
    fn write(&self, index: usize, raw: i64) {
        self.0.borrow_mut().raws[index].push(raw);
    }

    fn overflow(&self, index: usize) {
        let mut recording = self.0.borrow_mut();
        let write = recording.raws[index].len();
        recording.overflows[index].add(write);
    }
}

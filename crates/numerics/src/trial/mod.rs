//! Word-length trials: a tape on many steps at once, in formats that change from trial to trial.
//!
//! Every operation has a column with its word in every step (structure of arrays). Operations that
//! wait for no earlier result of their own run over a whole block of steps at a time, in loops
//! that the compiler vectorises, with the processor's features chosen at run time; feedback loops
//! run step by step. A trial recomputes only what lies downstream of nodes whose format changed
//! since the one before. Results are those of [`crate::tape::Words`] bit for bit.

mod column;
mod dispatch;
mod graph;
mod lanes;
mod looped;
mod plan;

use std::ops::{ControlFlow, Range};

use cardan_datapath::{Format, Overflow};
use fearless_simd::Level;

pub use column::Column;
pub use plan::{Violation, deployable};

use crate::Word;
use crate::tape::{Entry, Inputs, NO_NODE, Op, Ref, Runner, Tape, Words};
use dispatch::Kernel;
use graph::Stage;
use plan::Plan;

/// Steps per block: the columns of a block stay in the cache.
const BLOCK: usize = 512;

/// A tape with its inputs, ready for trials.
pub struct Trial<'a> {
    tape: &'a Tape,
    inputs: &'a Inputs,
    domain_flag: u16,
    level: Level,
    stages: Vec<Stage>,
    /// Columns that each steady operation reads.
    reads: Vec<Vec<usize>>,
    /// Steady operations that later steps look at, with how far back.
    looked_back_at: Vec<(usize, usize)>,
    /// Largest magnitude of each input port, as a power of two.
    port_bits: Vec<u32>,
    /// Columns of what stands before the steps, then of the steady operations.
    columns: Vec<Column>,
    /// In which format each column was computed; none: not at all, or not to its end.
    computed: Vec<Option<Format>>,
    plans: Vec<Plan>,
    overflows: Vec<u64>,
    /// Steps in which an operation failed (zero divisor, negative radicand, trap).
    failures: Vec<Vec<u32>>,
    /// The words of the first steps.
    transient: Vec<Vec<Word>>,
    transient_counts: Vec<u64>,
    /// Status bits of every step.
    status: Vec<u16>,
    scratch: dispatch::Scratch,
    /// Node writes computed so far, for figures of speed.
    pub operations: u64,
}

impl<'a> Trial<'a> {
    /// Trials of `tape` on `inputs`; the arithmetic's own status bit is `domain_flag`.
    #[must_use]
    pub fn new(tape: &'a Tape, inputs: &'a Inputs, domain_flag: u16) -> Self {
        let slots = tape.before.len() + tape.steady.len();
        let magnitude = |port: &Vec<i32>| {
            let largest = port.iter().map(|raw| raw.unsigned_abs()).max();
            u32::BITS - largest.unwrap_or(0).saturating_sub(1).leading_zeros()
        };
        Self {
            tape,
            inputs,
            domain_flag,
            level: Level::new(),
            stages: graph::stages(tape),
            reads: tape.steady.iter().map(|entry| reads(tape, entry)).collect(),
            looked_back_at: looked_back_at(tape),
            port_bits: inputs.raws.iter().map(magnitude).collect(),
            columns: vec![Column::default(); slots],
            computed: vec![None; slots],
            plans: vec![Plan::default(); slots],
            overflows: vec![0; slots],
            failures: vec![Vec::new(); slots],
            transient: Vec::new(),
            transient_counts: Vec::new(),
            status: Vec::new(),
            scratch: dispatch::Scratch::default(),
            operations: 0,
        }
    }

    /// The steps that trials compute: all but the first, which differ.
    #[must_use]
    pub fn steps(&self) -> Range<usize> {
        self.tape.transient.len().min(self.inputs.steps)..self.inputs.steps
    }

    /// Runs in `formats`, one per node. After each block of steps `judge` sees the trial with the
    /// columns filled up to the block's end, and may end it; then the columns' rest is undefined.
    /// Returns false if it did.
    pub fn run(
        &mut self,
        formats: &[Format],
        mut judge: impl FnMut(&Self, Range<usize>) -> ControlFlow<()>,
    ) -> bool {
        self.begin(formats);
        let dirty = self.prepare(formats);
        let steps = self.steps();
        let mut start = steps.start;
        while start < steps.end {
            let block = start..(start + BLOCK).min(steps.end);
            self.block(&dirty, block.clone());
            if judge(self, block.clone()).is_break() && block.end < steps.end {
                for (slot, dirty) in dirty.iter().enumerate() {
                    if *dirty {
                        self.computed[slot] = None;
                    }
                }
                return false;
            }
            start = block.end;
        }
        self.collect_status();
        true
    }

    /// As [`Trial::run`], to the end.
    pub fn run_all(&mut self, formats: &[Format]) {
        self.run(formats, |_, _| ControlFlow::Continue(()));
    }

    /// The column of steady operation `index`.
    #[must_use]
    pub fn column(&self, index: usize) -> &Column {
        &self.columns[self.tape.before.len() + index]
    }

    /// Status bits of every step, after a run to the end.
    #[must_use]
    pub fn status(&self) -> &[u16] {
        &self.status
    }

    /// The words of the first steps, which differ, by step and operation.
    #[must_use]
    pub fn transient(&self) -> &[Vec<Word>] {
        &self.transient
    }

    /// Overflows per node, after a run to the end.
    #[must_use]
    pub fn overflows(&self) -> Vec<u64> {
        let mut counts = self.transient_counts.clone();
        for (entry, count) in self
            .tape
            .steady
            .iter()
            .zip(&self.overflows[self.tape.before.len()..])
        {
            if entry.node != NO_NODE {
                counts[entry.node as usize] += count;
            }
        }
        counts
    }

    /// Column number of an operand.
    fn slot(&self, operand: Ref) -> usize {
        match operand {
            Ref::Before(index) => index as usize,
            Ref::Here(index) | Ref::Ago { index, .. } => self.tape.before.len() + index as usize,
        }
    }

    /// The first steps, and what stands before them, word by word.
    fn begin(&mut self, formats: &[Format]) {
        let mut words = Words::new(formats, self.domain_flag);
        let mut runner = Runner::new(self.tape, &mut words);
        let before: Vec<Word> = runner.before().to_vec();
        self.status.clear();
        self.status.resize(self.inputs.steps, 0);
        self.transient.clear();
        let first = self.tape.transient.len().min(self.inputs.steps);
        for step in 0..first {
            self.transient
                .push(runner.step(&mut words, self.inputs, step).to_vec());
            self.status[step] = std::mem::take(&mut words.status);
        }
        self.transient_counts = words
            .counts
            .iter()
            .map(|counts| counts.overflows.count)
            .collect();
        for (index, word) in before.iter().enumerate() {
            let node = self.tape.before[index].node as usize;
            let format = formats.get(node).copied();
            let column = &mut self.columns[index];
            let unchanged = column.len() == self.inputs.steps && column.get(0) == word.raw;
            if unchanged && self.computed[index].is_some() && self.computed[index] == format {
                continue;
            }
            let is_narrow = format.is_none_or(|format| format.word <= i32::BITS);
            column.fill(word.raw, is_narrow, self.inputs.steps);
            // Dirty until `prepare` has seen it.
            self.computed[index] = None;
        }
    }

    /// Plans what must be computed again; the first steps' words are put where later steps look.
    fn prepare(&mut self, formats: &[Format]) -> Vec<bool> {
        let base = self.tape.before.len();
        let format_of = |node: u32| formats.get(node as usize).copied();
        let mut dirty = vec![false; self.columns.len()];
        for (slot, entry) in self.tape.before.iter().enumerate() {
            let format = format_of(entry.node).or(Some(plan::TRUTH));
            dirty[slot] = self.computed[slot] != format;
            self.computed[slot] = format;
        }
        let tape = self.tape;
        for stage in &self.stages {
            let operations: &[usize] = match stage {
                Stage::Lanes(index) => std::slice::from_ref(index),
                Stage::Loop(indices) => indices,
            };
            let changed = |index: &usize| {
                let format = format_of(tape.steady[*index].node).unwrap_or(plan::TRUTH);
                self.computed[base + index] != Some(format)
                    || self.reads[*index].iter().any(|&slot| dirty[slot])
            };
            if !operations.iter().any(changed) {
                continue;
            }
            for &index in operations {
                let slot = base + index;
                let entry = &tape.steady[index];
                dirty[slot] = true;
                self.computed[slot] = Some(format_of(entry.node).unwrap_or(plan::TRUTH));
                self.overflows[slot] = 0;
                self.failures[slot].clear();
                self.plans[slot] = Plan::new(tape, entry, formats, &self.port_bits);
                self.columns[slot].resize(self.plans[slot].is_narrow, self.inputs.steps);
            }
        }
        self.place_transient();
        dirty
    }

    fn place_transient(&mut self) {
        let first = self.transient.len();
        if self.steps().is_empty() {
            return;
        }
        for &(index, steps) in &self.looked_back_at {
            let slot = self.tape.before.len() + index;
            let is_truth = self.tape.steady[index].node == NO_NODE;
            for step in first.saturating_sub(steps)..first {
                let raw = self.transient[step][index].raw;
                self.columns[slot].set(step, raw, is_truth);
            }
        }
    }

    fn block(&mut self, dirty: &[bool], block: Range<usize>) {
        let base = self.tape.before.len();
        let stages = std::mem::take(&mut self.stages);
        for stage in &stages {
            match stage {
                Stage::Lanes(index) if dirty[base + index] => {
                    self.operations += block.len() as u64;
                    self.lanes(*index, block.clone());
                }
                Stage::Loop(indices) if dirty[base + indices[0]] => {
                    self.operations += (block.len() * indices.len()) as u64;
                    self.looped(indices, block.clone());
                }
                _ => {}
            }
        }
        self.stages = stages;
    }

    /// One operation over a block of steps.
    fn lanes(&mut self, index: usize, block: Range<usize>) {
        let slot = self.tape.before.len() + index;
        let mut out = std::mem::take(&mut self.columns[slot]);
        let entry = self.tape.steady[index];
        let kernel = Kernel {
            level: self.level,
            plan: self.plans[slot],
            block,
        };
        let ago = |operand: Ref| match operand {
            Ref::Ago { steps, .. } => steps as usize,
            Ref::Here(_) | Ref::Before(_) => 0,
        };
        let columns = &self.columns;
        let op = entry
            .op
            .map(|operand| (&columns[self.slot(operand)], ago(operand)));
        let failures = &mut self.failures[slot];
        self.overflows[slot] += kernel.run(op, self.inputs, &mut out, &mut self.scratch, failures);
        self.columns[slot] = out;
    }

    fn collect_status(&mut self) {
        let base = self.tape.before.len();
        let steps = self.steps();
        for (index, entry) in self.tape.steady.iter().enumerate() {
            if let Op::Raise(flags, _) = entry.op {
                self.columns[base + index].raise(flags, &mut self.status, steps.clone());
            }
            for &step in &self.failures[base + index] {
                self.status[step as usize] |= self.domain_flag;
            }
        }
    }
}

fn reads(tape: &Tape, entry: &Entry) -> Vec<usize> {
    let slot = |operand: Ref| match operand {
        Ref::Before(index) => index as usize,
        Ref::Here(index) | Ref::Ago { index, .. } => tape.before.len() + index as usize,
    };
    entry.op.operands().into_iter().map(slot).collect()
}

fn looked_back_at(tape: &Tape) -> Vec<(usize, usize)> {
    let operands = tape.steady.iter().flat_map(|entry| entry.op.operands());
    let mut all: Vec<(usize, usize)> = operands
        .filter_map(|operand| match operand {
            Ref::Ago { steps, index } => Some((index as usize, steps as usize)),
            Ref::Here(_) | Ref::Before(_) => None,
        })
        .collect();
    all.sort_unstable();
    all.dedup();
    all
}

/// True for nodes whose overflows must be known step by step.
const fn traps(format: Format) -> bool {
    matches!(format.overflow, Overflow::Trap)
}

//! Running one algorithm over several arithmetics.

use cardan_datapath::Arithmetic;

use crate::{Datapath, Formats, Mixed, Recorder, Recording};

/// An algorithm with its inputs, ready to run over any arithmetic: what a closure would be if
/// closures could be generic.
pub trait Algorithm {
    /// What is wanted besides the node values (status bits, say).
    type Output;

    /// Runs from the start to the end of the inputs.
    fn run<M: Arithmetic>(&self, m: &M) -> Self::Output;
}

/// Runs `algorithm` in the given formats and keeps every value of every node.
pub fn record<A: Algorithm>(algorithm: &A, formats: &Formats) -> (A::Output, Recording) {
    let m = Mixed::new(formats, Recorder::new(formats.len()));
    let output = algorithm.run(&m);
    (output, m.into_observer().into_recording())
}

/// A datapath with the inputs of every step, as an algorithm; its output is the status of each step.
pub struct Steps<'a, A, I> {
    /// The datapath.
    pub datapath: &'a A,
    /// Inputs per step.
    pub inputs: &'a [I],
}

impl<A: Datapath, I: AsRef<[i32]>> Algorithm for Steps<'_, A, I> {
    type Output = Vec<u16>;

    fn run<M: Arithmetic>(&self, m: &M) -> Vec<u16> {
        let mut state = self.datapath.start(m);
        let mut step = |inputs: &I| {
            self.datapath.step(m, &mut state, inputs.as_ref());
            m.take_status()
        };
        self.inputs.iter().map(&mut step).collect()
    }
}

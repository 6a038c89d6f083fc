//! Running one algorithm over several arithmetics.

use cardan_datapath::Arithmetic;

use crate::{Formats, Mixed, Recorder, Recording};

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

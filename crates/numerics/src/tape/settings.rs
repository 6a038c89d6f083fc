//! Constants, settings and table entries that their nodes do not hold.

use cardan_datapath::{Format, Rounding};

use super::{Op, Tape};
use crate::exact;

/// Per node, the first constant, setting or table entry that its format does not hold: a constant or
/// an entry saturates there without a word.
#[must_use]
pub fn beyond(tape: &Tape, formats: &[Format]) -> Vec<Option<f64>> {
    let mut found = vec![None; formats.len()];
    let bodies = tape.transient.iter().chain([&tape.steady, &tape.before]);
    for entry in bodies.flatten() {
        let Some(&format) = formats.get(entry.node as usize) else {
            continue;
        };
        let misfit = match entry.op {
            Op::Constant(value) => Some(value).filter(|&value| !holds(format, value)),
            Op::Lookup(_, table) => table.iter().copied().find(|&value| !holds(format, value)),
            Op::Parameter { raw, frac } => exact::fit(raw.into(), frac, format)
                .1
                .then(|| libm::ldexp(raw.into(), -frac)),
            _ => None,
        };
        if found[entry.node as usize].is_none() {
            found[entry.node as usize] = misfit;
        }
    }
    found
}

/// The word nearest to a constant exists.
fn holds(format: Format, value: f64) -> bool {
    let nearest = Format {
        rounding: Rounding::NearestAway,
        ..format
    };
    value.is_finite() && !exact::quantise(value, nearest).1
}

//! A user's own datapaths, written against Cardan's public crates: a biquad, a 32-tap FIR filter and
//! a PI controller, with their nodes in `wordlengths.toml`. The guide is
//! `docs/bring-your-own-datapath.md`.

mod biquad;
mod fir;
mod pi;

pub use biquad::Biquad;
pub use fir::Fir;
pub use pi::Pi;

use cardan_numerics::Datapath;
use cardan_numerics::tape::TraceError;
use cardan_tune::{Case, Problem, Quantity};

/// Node types, generated from `wordlengths.toml`.
pub mod nodes {
    include!(concat!(env!("OUT_DIR"), "/nodes.rs"));
}

/// The problem of tuning `datapath`, whose result is `node` and is called `name` in budgets: on one
/// set of steps, to be verified on another. The reference is the algorithm on real numbers.
///
/// # Errors
/// An algorithm whose steps differ.
pub fn problem<A: Datapath>(
    datapath: &A,
    name: &str,
    node: usize,
    tuning: &[[i32; 1]],
    held_out: &[[i32; 1]],
) -> Result<Problem, TraceError> {
    let quantities = vec![Quantity {
        name: name.to_owned(),
        node,
        scale: 1.0,
        period: None,
    }];
    let case = |case: &str, steps: &[[i32; 1]]| -> Result<Case, TraceError> {
        let recorded = Case::record(case, datapath, steps)?;
        Ok(recorded.against_real(&quantities, &nodes::NODES))
    };
    Ok(Problem {
        name: name.to_owned(),
        nodes: nodes::NODES.to_vec(),
        background: Vec::new(),
        domain_flag: cardan_datapath::DEFAULT_DOMAIN_FLAG,
        tuning: vec![case("tuning", tuning)?],
        held_out: vec![case("held out", held_out)?],
        combined: Vec::new(),
        quantities,
    })
}

/// Converter words of two tones and some noise, other ones for another seed.
#[must_use]
pub fn signal(samples: usize, seed: u32) -> Vec<[i32; 1]> {
    let mut state = seed;
    let mut sample = |at: usize| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let noise = f64::from(state >> 16) / 65_536.0 - 0.5;
        let time = at as f64 + 1000.0 * f64::from(seed);
        let tones = 0.4 * libm::sin(0.031 * time) + 0.4 * libm::sin(0.41 * time);
        [(32_767.0 * (tones + 0.2 * noise)) as i32]
    };
    (0..samples).map(&mut sample).collect()
}

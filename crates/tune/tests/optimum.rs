//! The default method against every combination of a space that is small enough to go through.

mod common;

use std::collections::HashMap;

use cardan_datapath::{Format, Overflow, Rounding};
use cardan_numerics::trial::Trial;
use cardan_tune::{Options, Problem, tune};
use common::problem;

/// Twelve widths per node.
const WIDTHS: std::ops::Range<u32> = 6..18;
/// Combinations of five nodes.
const COMBINATIONS: u64 = 12_u64.pow(5);

/// Bits and rms error of every combination, for nodes with these integer bits.
fn all(problem: &Problem, integer: &[i32]) -> Vec<(u32, f64)> {
    let case = &problem.tuning[0];
    let output = problem.quantities[0].node;
    let last = case.tape.last_write(output).expect("is written");
    let mut trial = Trial::new(&case.tape, &case.inputs, problem.domain_flag);
    let format = |node: usize, word: u32| {
        let frac = (word.cast_signed() - integer[node]).unsigned_abs();
        Format::new(word, frac, Rounding::NearestUp, Overflow::Saturate)
    };
    let mut found = Vec::new();
    for at in 0..COMBINATIONS {
        // The first node changes most rarely: what lies before a change is not computed again.
        let word = |node: u32| WIDTHS.start + (at / 12_u64.pow(4 - node) % 12) as u32;
        let words: Vec<u32> = (0..5).map(word).collect();
        let formats: Vec<Format> = words
            .iter()
            .enumerate()
            .map(|(n, &w)| format(n, w))
            .collect();
        trial.run_all(&formats);
        let lsb = formats[output].lsb();
        // Start-up steps count like all others.
        let word = |step: usize| match trial.transient().get(step) {
            None => trial.column(last).get(step),
            Some(words) => words[case.tape.last_write_in(step, output).expect("is written")].raw,
        };
        let errors = (0..case.inputs.steps).map(|step| {
            let reference = case.references[0][step];
            (word(step) as f64 * lsb - reference).powi(2)
        });
        let judged: Vec<f64> = errors.filter(|error| error.is_finite()).collect();
        let rms = (judged.iter().sum::<f64>() / judged.len() as f64).sqrt();
        found.push((words.iter().sum(), rms));
    }
    found
}

#[test]
fn the_default_method_finds_the_optimum_of_five_nodes_with_twelve_widths() {
    const BUDGETS: usize = 100;
    let problem = problem(60);
    let mut tables: HashMap<Vec<i32>, Vec<(u32, f64)>> = HashMap::new();
    let mut state: u32 = 7;
    let (mut optima, mut most) = (0, 0);
    for _ in 0..BUDGETS {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let exponent = 4.0 + 6.0 * f64::from(state >> 8) / f64::from(1 << 24);
        let limit = libm::exp2(-exponent);
        let options = Options {
            widths: WIDTHS.collect(),
            pareto: Vec::new(),
            threads: 2,
            // 2 % of the combinations.
            evaluations: Some(COMBINATIONS / 50),
            ..Options::new([format!("y.rms<={limit:e}")])
        };
        let found = tune(&problem, &options, None, &mut |_| {}).expect("runs");
        let formats = found.best.formats.0.iter().map(|(_, format)| *format);
        let integer: Vec<i32> = formats
            .map(|f| f.word.cast_signed() - f.frac.cast_signed())
            .collect();
        let table = tables
            .entry(integer)
            .or_insert_with_key(|integer| all(&problem, integer));
        let feasible = table.iter().filter(|(_, rms)| *rms <= limit);
        let best = feasible.map(|(bits, _)| u64::from(*bits)).min();
        assert_eq!(found.feasible, best.is_some(), "{limit:e}");
        let Some(best) = best else { continue };
        assert!(
            found.best.bits >= best,
            "{limit:e}: cheaper than the optimum"
        );
        optima += usize::from(found.best.bits == best);
        most = most.max(found.evaluations);
    }
    println!(
        "{optima} of {BUDGETS} optima, at most {most} evaluations, {} sets of integer bits",
        tables.len()
    );
    assert!(most <= COMBINATIONS / 50 + 10, "{most}");
    assert!(optima >= 95, "{optima} of {BUDGETS}");
}

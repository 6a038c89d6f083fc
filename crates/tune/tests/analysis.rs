//! Ranges and the noise model against what simulation shows.

mod common;

use cardan_datapath::{Format, Overflow, Rounding};
use cardan_tune::{Options, Problem, ranges, ranges_page, sensitivities, tune};
use common::problem;

#[test]
fn the_noise_model_is_within_a_decibel_of_simulation_where_it_applies() {
    let problem = problem(3000);
    let formats: Vec<Format> =
        vec![Format::new(16, 12, Rounding::NearestUp, Overflow::Saturate); problem.nodes.len()];
    let all = sensitivities(&problem, &formats, true, 1);
    let applies: Vec<_> = all
        .iter()
        .filter(|noise| noise.not_applicable.is_none())
        .collect();
    for noise in &all {
        println!("{noise:?}");
    }
    for noise in &applies {
        let db = noise.difference_db.expect("both are known");
        assert!(db.abs() <= 1.0, "{noise:?}");
    }
    assert!(applies.len() >= 4, "it applies to most nodes");
}

/// The error of a cube in steps of 2^-11, rounded so; the model agrees with what is measured.
fn cube_error(rounding: Rounding) -> f64 {
    let problem = problem(3000);
    let formats: Vec<Format> =
        vec![Format::new(16, 11, rounding, Overflow::Saturate); problem.nodes.len()];
    let all = sensitivities(&problem, &formats, true, 1);
    let cube = all.iter().find(|noise| noise.node == "cube");
    let cube = cube.expect("is there");
    let db = cube.difference_db.expect("both are known");
    assert!(db.abs() <= 1.0, "{cube:?}");
    cube.predicted * 2048.0
}

/// Its rms is lsb / sqrt(3), twice that of rounding to nearest. Toward zero an error is that of a floor with
/// the value's sign, which a cube of noise changes as often.
#[test]
fn a_floor_brings_its_bias_toward_zero_spreads_as_far_and_the_model_knows() {
    for rounding in [Rounding::Floor, Rounding::Zero] {
        let error = cube_error(rounding);
        assert!((error - 0.577).abs() < 0.01, "{rounding:?}: {error}");
    }
}

fn with_word(problem: &mut Problem, node: usize, word: u32, frac: u32) {
    problem.nodes[node].format = Format::new(word, frac, Rounding::NearestUp, Overflow::Saturate);
}

#[test]
fn ranges_prove_what_cannot_overflow_and_find_what_can() {
    let mut problem = problem(500);
    // x is below 1, so that 2.14 holds its square; 1.12 does not hold the output. The port allows
    // any 16-bit word, twice what simulation shows.
    for case in problem.tuning.iter_mut().chain(&mut problem.held_out) {
        case.ports = vec![(-32768, 32767)];
    }
    with_word(&mut problem, 0, 16, 12);
    with_word(&mut problem, 1, 16, 10);
    with_word(&mut problem, 2, 12, 10);
    let found = ranges(&problem, 1, 4000, 1);
    let node = |name: &str| {
        found
            .nodes
            .iter()
            .find(|node| node.name == name)
            .expect("is there")
    };
    assert!(node("input").proven && node("square").proven);
    assert!(!node("cube").proven, "8 does not fit 2 bits");
    assert_eq!(node("cube").overflows, 0, "simulation does not show it");
    let witness = node("cube").witness.as_ref().expect("search finds it");
    let x = f64::from(witness.inputs[0]) / 16384.0;
    assert!((x * x * x).abs() > 1.9, "{witness:?}");
    let square = node("square");
    assert_eq!(
        square.derived.hi.map(|hi| (hi * 100.0).round() / 100.0),
        Some(4.0)
    );
    assert!(
        square
            .derived
            .lo
            .is_some_and(|lo| (-0.01..=0.0).contains(&lo)),
        "a square"
    );
    assert!(square.integer >= square.integer_simulated.expect("is simulated"));
    for node in &found.nodes {
        let (plain, affine) = (node.derived.ends(), node.derived_affine.ends());
        let (plain, affine) = (plain.expect("is bounded"), affine.expect("is bounded"));
        assert!(affine.0 >= plain.0 && affine.1 <= plain.1, "{node:?}");
        let simulated = node.min.zip(node.max).expect("is simulated");
        // Constants are rounded in words only; here they are exact.
        assert!(
            affine.0 <= simulated.0 && affine.1 >= simulated.1,
            "{node:?}"
        );
    }
    // Every value but zero has its place among the powers of two; noise is hardly ever zero.
    let counted: u64 = square.histogram.iter().map(|bin| bin.count).sum();
    assert!(
        counted <= square.samples && counted * 100 > square.samples * 99,
        "{square:?}"
    );
    let top = square.histogram.iter().map(|bin| bin.exponent).max();
    assert_eq!(top, square.max.map(libm::ilogb), "{square:?}");
}

/// held = held - held/4 + x/4 shares `held` with itself, which intervals forget: they have it grow until
/// it saturates. Affine forms prove that 8 holds what stems from an input within 1.
#[test]
fn affine_bounds_prove_a_low_pass_that_intervals_do_not() {
    let mut problem = problem(500);
    for case in problem.tuning.iter_mut().chain(&mut problem.held_out) {
        case.ports = vec![(-16384, 16384)];
    }
    with_word(&mut problem, 3, 16, 12);
    let found = ranges(&problem, 1, 0, 1);
    let held = (found.nodes.iter())
        .find(|node| node.name == "held")
        .expect("is there");
    let (plain, affine) = (held.derived, held.derived_affine);
    assert!(plain.hi.is_some_and(|hi| hi > 8.0), "{held:?}");
    assert!(affine.hi.is_some_and(|hi| hi > 1.0 && hi < 1.1), "{held:?}");
    assert!(held.proven, "{held:?}");
}

#[test]
fn the_page_shows_all_three_ranges_side_by_side() {
    let found = ranges(&problem(200), 1, 0, 1);
    let page = ranges_page(&found, "small: ranges", "cardan ranges <&>");
    let place = |head: &str| page.find(&format!(">{head}</th>")).expect("a heading");
    assert!(place("simulated") < place("interval") && place("interval") < place("affine"));
    assert!(page.contains("cardan ranges &lt;&amp;&gt;"));
    for node in &found.nodes {
        let simulated = (
            node.min.expect("is simulated"),
            node.max.expect("is simulated"),
        );
        let derived = [node.derived, node.derived_affine].map(|range| range.ends());
        let [interval, affine] = derived.map(|ends| ends.expect("is bounded"));
        let cells = [simulated, interval, affine]
            .map(|(lo, hi)| format!("<td class=\"number\">{lo:.5} … {hi:.5}</td>"));
        assert!(page.contains(&cells.concat()), "{}: {cells:?}", node.name);
    }
}

#[test]
fn a_node_that_never_changes_is_named() {
    let mut problem = problem(50);
    let found = ranges(&problem, 1, 0, 1);
    assert!(found.nodes.iter().all(|node| !node.unexcited));
    for case in problem.tuning.iter_mut().chain(&mut problem.held_out) {
        case.inputs.raws[0].fill(0);
    }
    let found = ranges(&problem, 1, 0, 1);
    assert_eq!(found.nodes.len(), problem.nodes.len());
    assert!(found.nodes.iter().all(|node| node.unexcited));
    let options = Options {
        pareto: Vec::new(),
        threads: 1,
        ..Options::new(["y.rms<=1e-3"])
    };
    let outcome = tune(&problem, &options, None, &mut |_| {}).expect("runs");
    for node in &problem.nodes {
        let told = format!("node '{}' took the value 0 only", node.name);
        assert!(
            outcome
                .warnings
                .iter()
                .any(|warning| warning.contains(&told)),
            "{told}"
        );
    }
}

//! More slack never costs anything, whatever the method: on random problems, a looser limit never gets
//! a dearer result.

mod common;

use cardan_datapath::{Format, NodeInfo, Overflow, Rounding};
use cardan_numerics::tape::{Entry, Inputs, Op, Ref, Tape};
use cardan_tune::{Case, Method, Options, Problem, Quantity, tune};

/// A reproducible stream of numbers.
struct Draw(u64);

impl Draw {
    fn below(&mut self, limit: u32) -> u32 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as u32) % limit
    }

    fn share(&mut self) -> f64 {
        f64::from(self.below(1 << 24)) / f64::from(1 << 24)
    }
}

/// Sums and products of two inputs and of earlier results, some with feedback; values stay about one.
fn random(draw: &mut Draw, nodes: u32) -> Problem {
    let mut steady = vec![
        Entry {
            node: 0,
            op: Op::Input { port: 0, frac: 15 },
        },
        Entry {
            node: 1,
            op: Op::Input { port: 1, frac: 15 },
        },
    ];
    for node in 2..nodes {
        let here = |draw: &mut Draw| Ref::Here(draw.below(steady.len() as u32));
        let (a, b) = (here(draw), here(draw));
        let op = match draw.below(8) {
            0 | 1 => Op::Add(a, b),
            2 => Op::Sub(a, b),
            3 | 4 => Op::Mul(a, b),
            5 => Op::Abs(a),
            _ => Op::Mul(a, Ref::Before(draw.below(3))),
        };
        // The half of it, so that sums of sums stay small.
        steady.push(Entry { node, op });
        let last = Ref::Here(steady.len() as u32 - 1);
        steady.push(Entry {
            node,
            op: Op::Shift(last, -1),
        });
    }
    let before = [0.7, -0.31, 0.9];
    let before = before.map(|value| Entry {
        node: nodes,
        op: Op::Constant(value),
    });
    let tape = Tape {
        before: before.to_vec(),
        transient: Vec::new(),
        steady,
    };
    let names = [
        "n0", "n1", "n2", "n3", "n4", "n5", "n6", "n7", "n8", "n9", "n10", "n11",
    ];
    let format = Format::new(28, 24, Rounding::NearestUp, Overflow::Saturate);
    let infos: Vec<NodeInfo> = (0..=nodes as usize)
        .map(|at| NodeInfo {
            name: names[at],
            unit: "1",
            meaning: "",
            format,
        })
        .collect();
    let quantities = vec![Quantity {
        name: "y".to_owned(),
        node: nodes as usize - 1,
        scale: 1.0,
        period: None,
    }];
    let mut port = || {
        (0..150)
            .map(|_| draw.below(65_536) as i32 - 32_768)
            .collect()
    };
    let inputs = Inputs {
        raws: vec![port(), port()],
        truths: Vec::new(),
        steps: 150,
    };
    let case = Case {
        name: "random".to_owned(),
        tape,
        inputs,
        ports: vec![(-32_768, 32_767); 2],
        channels: 1,
        references: Vec::new(),
        truths: Vec::new(),
    };
    let case = case.against_real(&quantities, &infos);
    Problem {
        name: "random".to_owned(),
        nodes: infos,
        background: Vec::new(),
        domain_flag: 16,
        tuning: vec![case.clone()],
        held_out: vec![case],
        combined: Vec::new(),
        quantities,
    }
}

fn bits(problem: &Problem, method: Method, limit: f64, widths: &[u32]) -> (bool, u64) {
    let options = Options {
        method,
        widths: widths.to_vec(),
        pareto: vec![],
        threads: 1,
        ..Options::new([format!("y.rms<={limit:e}")])
    };
    let found = tune(problem, &options, None, &mut |_| {}).expect("runs");
    if found.feasible {
        let error = found.best.error.expect("is measured");
        assert!(error <= limit, "{method:?}: {error:e} of {limit:e}");
    }
    (found.feasible, found.best.bits)
}

/// Limits near each other and far apart.
fn assert_law(draw: &mut Draw, problem: &Problem, method: Method, widths: &[u32], count: usize) {
    let mut limits: Vec<f64> = (0..count)
        .map(|_| libm::exp2(-4.0 - 7.0 * draw.share()))
        .collect();
    limits.push(limits[0] * 1.01);
    limits.push(limits[1] * 1.1);
    limits.sort_by(|a, b| a.total_cmp(b));
    let mut tighter: Option<(f64, u64)> = None;
    for limit in limits {
        let (feasible, bits) = bits(problem, method, limit, widths);
        if let Some((other, fewer)) = tighter {
            assert!(feasible, "{method:?}: {limit:e} is looser than {other:e}");
            assert!(
                bits <= fewer,
                "{method:?}: {limit:e} takes {bits} bits, {other:e} takes {fewer}"
            );
        }
        if feasible {
            tighter = Some((limit, bits));
        }
    }
    assert!(tighter.is_some(), "some limit can be met");
}

/// How many random problems; `CARDAN_PROBLEMS` for more.
fn problems() -> u64 {
    let more = std::env::var("CARDAN_PROBLEMS").ok();
    more.and_then(|text| text.parse().ok()).unwrap_or(4)
}

#[test]
fn the_default_method_never_takes_more_for_a_looser_limit() {
    for seed in 0..problems() {
        let mut draw = Draw(seed);
        let problem = random(&mut draw, 10);
        assert_law(&mut draw, &problem, Method::Sensitivity, &[], 4);
    }
}

#[test]
fn greedy_methods_never_take_more_for_a_looser_limit() {
    for seed in 0..problems() {
        let mut draw = Draw(100 + seed);
        let problem = random(&mut draw, 6);
        for method in [Method::MaxMinusOne, Method::MinPlusOne] {
            assert_law(&mut draw, &problem, method, &[], 4);
        }
    }
}

#[test]
fn small_spaces_never_take_more_for_a_looser_limit() {
    let widths: Vec<u32> = (5..15).collect();
    for seed in 0..problems() {
        let mut draw = Draw(200 + seed);
        let problem = random(&mut draw, 4);
        for method in [Method::Sensitivity, Method::Exhaustive, Method::Uniform] {
            assert_law(&mut draw, &problem, method, &widths, 4);
        }
    }
}

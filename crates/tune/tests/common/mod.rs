//! A small datapath with a few free nodes: a biquad-like sum of rounded products.
#![allow(dead_code, reason = "each test program uses a part")]

use cardan_datapath::{Arithmetic, Constant, Format, Node, NodeInfo, Overflow, Rounding, Value};
use cardan_numerics::Datapath;
use cardan_tune::{Case, Problem, Quantity};

macro_rules! nodes {
    ($($name:ident $index:literal $text:literal;)*) => {$(
        #[derive(Clone, Copy)]
        pub(crate) struct $name;
        impl Node for $name {
            const INDEX: usize = $index;
            const NAME: &'static str = $text;
            const UNIT: &'static str = "1";
            const FORMAT: Format = Format::new(24, 20, Rounding::NearestUp, Overflow::Saturate);
            type Word = fixed::FixedI32<fixed::types::extra::U20>;
        }
    )*
    pub(crate) const NODES: &[NodeInfo] = &[$(NodeInfo {
        name: $text,
        unit: "1", meaning: "",
        format: <$name as Node>::FORMAT,
    }),*];
    };
}
nodes! {
    Input 0 "input";
    Square 1 "square";
    Cube 2 "cube";
    Held 3 "held";
    Output 4 "output";
}

struct Weight;
impl Constant for Weight {
    const VALUE: f64 = 0.25;
}
struct Zero;
impl Constant for Zero {
    const VALUE: f64 = 0.0;
}

/// output = x^3 + x^2 + a low-passed x.
pub(crate) struct Small;

impl Datapath for Small {
    type State<M: Arithmetic> = Value<M, Held>;

    fn start<M: Arithmetic>(&self, m: &M) -> Value<M, Held> {
        m.constant::<Held, Zero>()
    }

    fn step<M: Arithmetic>(&self, m: &M, held: &mut Value<M, Held>, inputs: &[i32]) {
        let x: Value<M, Input> = m.input::<Input, 14>(inputs[0]);
        let square: Value<M, Square> = m.mul(x, x);
        let cube: Value<M, Cube> = m.mul(square, x);
        let quarter: Value<M, Held> = m.shift::<Held, Input, -2>(x);
        let rest: Value<M, Held> = m.shift::<Held, Held, -2>(*held);
        let kept: Value<M, Held> = m.sub(*held, rest);
        *held = m.add(kept, quarter);
        let sum: Value<M, Output> = m.add(cube, square);
        let _: Value<M, Output> = m.add(sum, *held);
    }
}

/// Steps of a noisy sine; another phase for another seed.
pub(crate) fn steps(count: usize, seed: u32) -> Vec<Vec<i32>> {
    let mut state = seed;
    (0..count)
        .map(|at| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let noise = (state >> 20) as i32 % 3001 - 1500;
            let phase = at as f64 * 0.07 + f64::from(seed);
            vec![(13_000.0 * libm::sin(phase)) as i32 + noise]
        })
        .collect()
}

pub(crate) fn problem(count: usize) -> Problem {
    let quantities = vec![Quantity {
        name: "y".to_owned(),
        node: Output::INDEX,
        scale: 1.0,
        period: None,
    }];
    let case = |name: &str, seed| {
        Case::record(name, &Small, &steps(count, seed))
            .expect("is steady")
            .against_real(&quantities, NODES)
    };
    Problem {
        name: "small".to_owned(),
        nodes: NODES.to_vec(),
        background: Vec::new(),
        domain_flag: 16,
        tuning: vec![case("tuned", 1)],
        held_out: vec![case("held out", 2)],
        combined: Vec::new(),
        quantities,
    }
}

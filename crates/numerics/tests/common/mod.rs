//! Datapaths that between them use every operation, a feedback loop and a delay line.
#![allow(dead_code, reason = "each test program uses a part")]

use cardan_datapath::{
    Arithmetic, Constant, Format, Node, NodeInfo, Overflow, Rounding, Table, Value,
};
use cardan_numerics::Datapath;
use cardan_numerics::tape::{Inputs, Interval, NO_NODE, Tape};
use cardan_numerics::trial::Trial;

/// Nodes of every datapath here.
pub(crate) const NODES: usize = 16;
/// A node that nothing but outputs depends on.
pub(crate) const LAST: usize = 15;

/// Node number `I`.
#[derive(Clone, Copy)]
pub(crate) struct At<const I: usize>;
impl<const I: usize> Node for At<I> {
    const INDEX: usize = I;
    const NAME: &'static str = "n";
    const UNIT: &'static str = "1";
    const FORMAT: Format = Format::new(16, 10, Rounding::NearestUp, Overflow::Saturate);
    type Word = fixed::FixedI16<fixed::types::extra::U10>;
}

pub(crate) fn deployed() -> Vec<Format> {
    vec![At::<0>::FORMAT; NODES]
}

struct Zero;
impl Constant for Zero {
    const VALUE: f64 = 0.0;
}
struct Gain;
impl Constant for Gain {
    const VALUE: f64 = -0.7;
}
struct Curve;
impl Table for Curve {
    const VALUES: &'static [f64] = &[0.5, -0.25, 3.0, 0.125];
}

/// Every operation of the arithmetic, with state in words and truths and a first step apart.
pub(crate) struct Everything;

pub(crate) struct EverythingState<M: Arithmetic> {
    setting: Value<M, At<3>>,
    held: Value<M, At<9>>,
    sign: M::Bool,
    started: bool,
}

impl Datapath for Everything {
    type State<M: Arithmetic> = EverythingState<M>;

    fn start<M: Arithmetic>(&self, m: &M) -> EverythingState<M> {
        EverythingState {
            setting: m.parameter::<At<3>, 8>(391),
            held: m.constant::<At<9>, Zero>(),
            sign: m.truth(false),
            started: false,
        }
    }

    fn step<M: Arithmetic>(&self, m: &M, state: &mut EverythingState<M>, inputs: &[i32]) {
        let a: Value<M, At<0>> = m.input::<At<0>, 6>(inputs[0]);
        let b: Value<M, At<1>> = m.input::<At<1>, 0>(inputs[1]);
        let c: Value<M, At<2>> = m.input::<At<2>, 4>(inputs[2]);
        let sum: Value<M, At<4>> = m.add(a, b);
        let difference: Value<M, At<5>> = m.sub(sum, c);
        let product: Value<M, At<6>> = m.mul(difference, state.setting);
        let quotient: Value<M, At<7>> = m.div(product, c);
        let root: Value<M, At<8>> = m.sqrt(product);
        let shifted: Value<M, At<10>> = m.shift::<At<10>, At<8>, 3>(root);
        let lowered: Value<M, At<10>> = m.shift::<At<10>, At<10>, -2>(shifted);
        let negative: Value<M, At<11>> = m.neg(quotient);
        let magnitude: Value<M, At<12>> = m.abs(difference);
        let looked: Value<M, At<13>> = m.lookup::<At<13>, At<5>, Curve>(difference);
        let entry: Value<M, At<13>> = m.entry::<At<13>, Curve>(2);
        let larger = m.less(a, magnitude);
        let below = m.negative(quotient);
        let outside = m.truth(inputs[0] > 100);
        let either = m.either(m.not(larger), m.xor(below, outside), state.sign);
        let chosen: Value<M, At<14>> = m.select(m.or(either, outside), negative, lowered);
        let kept: Value<M, At<9>> = m.select(larger, chosen, state.held);
        let scaled: Value<M, At<14>> = m.mul(kept, m.constant::<At<3>, Gain>());
        let _: Value<M, At<15>> = m.add(scaled, looked);
        let _: Value<M, At<15>> = m.sub(entry, kept);
        m.raise(1, below);
        m.raise(2, m.less(entry, kept));
        if state.started {
            state.sign = m.xor(state.sign, below);
        } else {
            state.sign = below;
        }
        state.held = kept;
        state.started = true;
    }
}

/// y = x + a y' with everything rounded.
pub(crate) struct Iir;

impl Datapath for Iir {
    type State<M: Arithmetic> = [Value<M, At<2>>; 2];

    fn start<M: Arithmetic>(&self, m: &M) -> Self::State<M> {
        [m.constant::<At<2>, Zero>(); 2]
    }

    fn step<M: Arithmetic>(&self, m: &M, state: &mut Self::State<M>, inputs: &[i32]) {
        let gain = m.constant::<At<3>, Gain>();
        let x: Value<M, At<0>> = m.input::<At<0>, 7>(inputs[0]);
        let a: Value<M, At<1>> = m.mul(state[0], gain);
        let b: Value<M, At<4>> = m.mul(state[1], gain);
        let sum: Value<M, At<5>> = m.add(x, a);
        let y: Value<M, At<2>> = m.sub(sum, b);
        state[1] = state[0];
        state[0] = y;
    }
}

/// The sum of the last five inputs, kept in a ring buffer.
pub(crate) struct Fir;

pub(crate) struct Ring<M: Arithmetic> {
    words: [Value<M, At<0>>; 5],
    at: usize,
}

impl Datapath for Fir {
    type State<M: Arithmetic> = Ring<M>;

    fn start<M: Arithmetic>(&self, m: &M) -> Ring<M> {
        Ring {
            words: [m.constant::<At<0>, Zero>(); 5],
            at: 0,
        }
    }

    fn step<M: Arithmetic>(&self, m: &M, state: &mut Ring<M>, inputs: &[i32]) {
        state.words[state.at] = m.input::<At<0>, 7>(inputs[0]);
        let mut sum = m.constant::<At<1>, Zero>();
        for age in 0..5 {
            let word = state.words[(state.at + 5 - age) % 5];
            let term: Value<M, At<2>> = m.mul(word, m.entry::<At<3>, Curve>(age));
            sum = m.add(sum, term);
        }
        let _: Value<M, At<15>> = m.shift::<At<15>, At<1>, 0>(sum);
        state.at = (state.at + 1) % 5;
    }
}

/// Branches in Rust on its input: cannot be recorded.
pub(crate) struct Unsteady;

impl Datapath for Unsteady {
    type State<M: Arithmetic> = ();

    fn start<M: Arithmetic>(&self, _: &M) {}

    fn step<M: Arithmetic>(&self, m: &M, (): &mut (), inputs: &[i32]) {
        let x: Value<M, At<0>> = m.input::<At<0>, 7>(inputs[0]);
        if inputs[0] >= 50 {
            let _: Value<M, At<1>> = m.neg(x);
        }
    }
}

/// The words that any value of `bound` may become.
pub(crate) fn words_of(bound: Interval, format: Format) -> Interval {
    let lsb = format.lsb();
    let (lo, hi) = (
        (bound.lo / lsb).floor() * lsb,
        (bound.hi / lsb).ceil() * lsb,
    );
    let (min, max) = (format.real(format.min_raw()), format.real(format.max_raw()));
    if format.overflow == Overflow::Wrap && (lo < min || hi > max) {
        return Interval::new(min, max);
    }
    Interval::new(lo.clamp(min, max), hi.clamp(min, max))
}

/// A node table of these formats.
pub(crate) fn infos(formats: &[Format]) -> Vec<NodeInfo> {
    let info = |format: &Format| NodeInfo {
        name: "n",
        unit: "1",
        meaning: "",
        format: *format,
    };
    formats.iter().map(info).collect()
}

/// Every recorded word of a trial, per node.
pub(crate) fn columns(
    tape: &Tape,
    inputs: &Inputs,
    trial: &Trial<'_>,
    nodes: usize,
) -> Vec<Vec<i64>> {
    let mut raws = vec![Vec::new(); nodes];
    for step in 0..inputs.steps {
        for (index, entry) in tape.body(step).iter().enumerate() {
            if entry.node == NO_NODE || !entry.op.is_recorded() {
                continue;
            }
            raws[entry.node as usize].push(match trial.transient().get(step) {
                Some(words) => words[index].raw,
                None => trial.column(index).get(step),
            });
        }
    }
    raws
}

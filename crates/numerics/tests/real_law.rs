//! Laws of real nodes and of mixtures: real never rounds, recording changes nothing, traps report.

use cardan_datapath::fixed::FixedI16;
use cardan_datapath::fixed::types::extra::{U12, U15};
use cardan_datapath::{
    Arithmetic, Constant, DEFAULT_DOMAIN_FLAG, Format, Node, NodeInfo, Overflow, Rounding, Silent,
    Table, Value,
};
use cardan_numerics::{Algorithm, Formats, Mixed, Number, Recorder, Trap, record};
use proptest::prelude::*;

/// A quantity in -8..8.
#[derive(Clone, Copy, Debug)]
struct Quantity;
impl Node for Quantity {
    const INDEX: usize = 0;
    const NAME: &'static str = "quantity";
    const UNIT: &'static str = "1";
    const FORMAT: Format = Format::new(16, 12, Rounding::NearestUp, Overflow::Saturate);
    type Word = FixedI16<U12>;
}

/// An angle in half turns: wraps by design.
#[derive(Clone, Copy, Debug)]
struct Turn;
impl Node for Turn {
    const INDEX: usize = 1;
    const NAME: &'static str = "turn";
    const UNIT: &'static str = "half_turn";
    const FORMAT: Format = Format::new(16, 15, Rounding::Floor, Overflow::Wrap);
    type Word = FixedI16<U15>;
}

const NODES: [NodeInfo; 2] = [
    NodeInfo {
        name: Quantity::NAME,
        unit: Quantity::UNIT,
        meaning: "",
        format: Quantity::FORMAT,
    },
    NodeInfo {
        name: Turn::NAME,
        unit: Turn::UNIT,
        meaning: "",
        format: Turn::FORMAT,
    },
];

struct Third;
impl Constant for Third {
    const VALUE: f64 = 1.0 / 3.0;
}

struct Entries;
impl Table for Entries {
    const VALUES: &'static [f64] = &[0.1, -0.7, 1e9];
}

fn real() -> Mixed<Recorder> {
    Mixed::new(&Formats::real(2), Recorder::new(2))
}

fn number<N: Node>(real: f64) -> Value<Mixed<Recorder>, N> {
    Value::new(Number { real, raw: None })
}

fn any_finite() -> impl Strategy<Value = f64> {
    prop_oneof![
        -8.0..8.0,
        any::<f64>().prop_filter("finite", |x| x.is_finite())
    ]
}

/// The end of the range instead of infinity.
fn finite(value: f64) -> f64 {
    value.clamp(f64::MIN, f64::MAX)
}

proptest! {
    #[test]
    fn real_operations_are_those_of_f64(a in any_finite(), b in any_finite(), raw: i32) {
        let m = real();
        let (x, y) = (number::<Quantity>(a), number::<Quantity>(b));
        let mut expected = vec![a + b, a - b, a * b, -a, a.abs(), a * 8.0, a / 4.0, a.min(b)];
        m.add::<Quantity, _, _>(x, y);
        m.sub::<Quantity, _, _>(x, y);
        m.mul::<Quantity, _, _>(x, y);
        m.neg::<Quantity, _>(x);
        m.abs::<Quantity, _>(x);
        m.shift::<Quantity, _, 3>(x);
        m.shift::<Quantity, _, -2>(x);
        m.select::<Quantity, _, _>(m.less(x, y), x, y);
        m.sqrt::<Quantity, _>(m.abs::<Quantity, _>(y));
        expected.extend([b.abs(), b.abs().sqrt()]);
        if b != 0.0 {
            m.div::<Quantity, _, _>(x, y);
            expected.push(a / b);
        }
        m.input::<Quantity, 20>(raw);
        expected.push(f64::from(raw) / 1_048_576.0);
        prop_assert_eq!(m.take_status(), 0);
        let overflows = expected.iter().filter(|x| !x.is_finite()).count();
        let recording = m.into_observer().into_recording();
        let expected: Vec<f64> = expected.into_iter().map(finite).collect();
        prop_assert_eq!(&recording.values[0], &expected);
        prop_assert_eq!(recording.overflows[0].count, overflows as u64);
        prop_assert!(recording.raws[0].is_empty());
    }

    #[test]
    fn a_wrapping_node_keeps_real_angles_modulo_a_turn(a in -1.0..1.0, b in -1.0..1.0, turns in -3..3) {
        let m = real();
        let far = number::<Quantity>(a + 2.0 * f64::from(turns));
        let sum: Value<_, Turn> = m.add(far, number::<Quantity>(b));
        let sum = sum.word().real;
        prop_assert!((-1.0..1.0).contains(&sum));
        let exact = far.word().real + b;
        prop_assert_eq!((exact - sum) % 2.0, 0.0);
        prop_assert_eq!(m.into_observer().into_recording().overflows[1].count, 0);
    }

    #[test]
    fn recording_changes_nothing(inputs in proptest::collection::vec(any::<i16>(), 1..20), known in 0usize..=2) {
        let formats = Formats::deployed(&NODES).unwrap().prefix(known);
        let run = Chain(inputs);
        let silent = run.run(&Mixed::new(&formats, Silent));
        let (recorded, _) = record(&run, &formats);
        prop_assert_eq!(silent, recorded);
    }
}

/// A recursion through both nodes; the status after each step.
struct Chain(Vec<i16>);
impl Algorithm for Chain {
    type Output = Vec<(u16, bool)>;
    fn run<M: Arithmetic>(&self, m: &M) -> Self::Output {
        let mut state = m.constant::<Turn, Third>();
        let step = |input: &i16| {
            let x = m.input::<Quantity, 12>((*input).into());
            let turn: Value<M, Turn> = m.add(state, x);
            let quotient: Value<M, Quantity> = m.div(turn, x);
            state = m.mul(quotient, m.sqrt::<Quantity, _>(x));
            m.raise(1, m.less(state, x));
            let flags = m.take_status();
            (flags, flags & 1 != 0)
        };
        self.0.iter().map(step).collect()
    }
}

#[test]
fn constants_and_tables_stay_unrounded() {
    let m = real();
    assert_eq!(m.constant::<Quantity, Third>().word().real, 1.0 / 3.0);
    for (index, expected) in [0.1, -0.7, 1e9, 1e9].into_iter().enumerate() {
        assert_eq!(m.entry::<Quantity, Entries>(index).word().real, expected);
    }
    for (index, expected) in [(-5.0, 0.1), (0.999, 0.1), (1.0, -0.7), (1e300, 1e9)] {
        let found: Value<_, Quantity> = m.lookup::<_, _, Entries>(number::<Quantity>(index));
        assert_eq!(found.word().real, expected);
    }
    assert_eq!(m.parameter::<Quantity, 31>(1).word().real, 2f64.powi(-31));
    assert_eq!(m.take_status(), 0);
}

#[test]
fn a_zero_divisor_and_a_negative_radicand_are_met_as_deployed() {
    let m = real();
    let zero = number::<Quantity>(0.0);
    for (dividend, end) in [
        (1e-9, 32767.0 / 4096.0),
        (-1e-9, -8.0),
        (0.0, 32767.0 / 4096.0),
    ] {
        let quotient: Value<_, Quantity> = m.div(number::<Quantity>(dividend), zero);
        assert_eq!(quotient.word().real, end);
        assert_eq!(m.take_status(), DEFAULT_DOMAIN_FLAG);
    }
    let root: Value<_, Quantity> = m.sqrt(number::<Quantity>(-1e-9));
    assert_eq!(root.word().real, 0.0);
    assert_eq!(m.take_status(), DEFAULT_DOMAIN_FLAG);
    assert_eq!(m.into_observer().into_recording().overflows[0].count, 3);
}

#[test]
fn the_first_trapped_overflow_is_reported_with_its_node_and_write() {
    let mut nodes = NODES;
    nodes[0].format.overflow = Overflow::Trap;
    let m = Mixed::with_domain_flag(
        &Formats::deployed(&nodes).unwrap(),
        Recorder::new(2),
        1 << 9,
    );
    m.input::<Turn, 0>(1);
    m.input::<Quantity, 0>(7);
    assert_eq!((m.trap(), m.take_status()), (None, 0));
    let ends: Value<_, Quantity> = m.input::<Quantity, 0>(8);
    m.input::<Quantity, 0>(-9);
    assert_eq!(ends.word().raw, Some(32767));
    assert_eq!(m.trap(), Some(Trap { node: 0, write: 1 }));
    assert_eq!(m.take_status(), 1 << 9);
    let overflows = m.into_observer().into_recording().overflows;
    assert_eq!((overflows[0].count, overflows[0].first), (2, Some(1)));
    assert_eq!((overflows[1].count, overflows[1].first), (1, Some(0)));
}

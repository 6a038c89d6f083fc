//! Law: with the deployed formats the mixed arithmetic equals the deployed one bit for bit, in
//! words, status, overflows and their order.
//!
//! The deployed formats are types, so combinations are listed; the values run over all pairs of
//! edges, random words, and for words to 6 bits over all.

use std::cell::RefCell;
use std::marker::PhantomData;

use cardan_datapath::fixed::traits::Fixed;
use cardan_datapath::fixed::types::extra::{
    U0, U1, U2, U3, U7, U10, U13, U14, U16, U19, U20, U24, U28, U30, U64,
};
use cardan_datapath::fixed::{FixedI8, FixedI16, FixedI32, FixedI64};
use cardan_datapath::{
    Arithmetic, Constant, Container, Deployed, Format, Node, NodeInfo, Overflow, Rounding, Table,
    Tap, Value,
};
use cardan_numerics::{Formats, Mixed, Number, Observer};
use rand_chacha::ChaCha8Rng;
use rand_core::{RngCore, SeedableRng};

/// Node `I` of a test: a word of `WORD` bits in the `fixed` type `C`; `MODE` counts rounding modes
/// first.
#[derive(Clone, Copy)]
struct T<const I: usize, const WORD: u32, const MODE: usize, C>(PhantomData<C>);

impl<const I: usize, const WORD: u32, const MODE: usize, C> Node for T<I, WORD, MODE, C>
where
    C: Fixed<Bits: Container> + Copy + 'static,
{
    const INDEX: usize = I;
    const NAME: &'static str = ["a", "b", "n"][I];
    const UNIT: &'static str = "1";
    const FORMAT: Format = Format::new(
        WORD,
        C::FRAC_NBITS,
        Rounding::ALL[MODE % 6].0,
        Overflow::ALL[MODE / 6].0,
    );
    type Word = C;
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Event {
    Write(usize, i64),
    Overflow(usize),
}

#[derive(Default)]
struct Events(RefCell<Vec<Event>>);

impl Tap for Events {
    fn write(&self, index: usize, raw: i64) {
        self.0.borrow_mut().push(Event::Write(index, raw));
    }
    fn overflow(&self, index: usize) {
        self.0.borrow_mut().push(Event::Overflow(index));
    }
}

impl Observer for Events {
    fn write(&self, node: usize, value: f64, raw: Option<i64>) {
        let raw = raw.expect("every node is quantised");
        assert!(value.is_finite());
        self.0.borrow_mut().push(Event::Write(node, raw));
    }
    fn overflow(&self, node: usize) {
        self.0.borrow_mut().push(Event::Overflow(node));
    }
}

/// An arithmetic into which a test puts words, and takes what it did.
trait Probe: Arithmetic {
    fn value<N: Node>(&self, raw: i64) -> Value<Self, N>;
    fn raw<N: Node>(&self, value: Value<Self, N>) -> i64;
    fn events(&self) -> Vec<Event>;
}

/// As [`Events`], for firmware: overflows are not told, which lets 16-bit kernels compute.
#[derive(Default)]
struct Words(Events);

impl Tap for Words {
    const SEES_OVERFLOWS: bool = false;

    fn write(&self, index: usize, raw: i64) {
        Tap::write(&self.0, index, raw);
    }
    fn overflow(&self, _index: usize) {}
}

impl Probe for Deployed<Words> {
    fn value<N: Node>(&self, raw: i64) -> Value<Self, N> {
        Value::new(N::Word::from_bits(Container::from_i64(raw)))
    }
    fn raw<N: Node>(&self, value: Value<Self, N>) -> i64 {
        value.word().to_bits().to_i64()
    }
    fn events(&self) -> Vec<Event> {
        self.tap().0.0.take()
    }
}

impl Probe for Deployed<Events> {
    fn value<N: Node>(&self, raw: i64) -> Value<Self, N> {
        Value::new(N::Word::from_bits(Container::from_i64(raw)))
    }
    fn raw<N: Node>(&self, value: Value<Self, N>) -> i64 {
        value.word().to_bits().to_i64()
    }
    fn events(&self) -> Vec<Event> {
        self.tap().0.take()
    }
}

impl Probe for Mixed<Events> {
    fn value<N: Node>(&self, raw: i64) -> Value<Self, N> {
        Value::new(Number {
            real: N::FORMAT.real(raw),
            raw: Some(raw),
        })
    }
    fn raw<N: Node>(&self, value: Value<Self, N>) -> i64 {
        value.word().raw.expect("every node is quantised")
    }
    fn events(&self) -> Vec<Event> {
        self.observer().0.take()
    }
}

/// Operations on words of nodes A and B that write N.
trait Operations {
    fn run<M: Probe, A: Node, B: Node, N: Node>(m: &M, a: Value<M, A>, b: Value<M, B>);
}

macro_rules! operations {
    ($($(#[$doc:meta])* $name:ident: |$m:ident, $a:ident, $b:ident| $body:block)*) => {$(
        $(#[$doc])*
        struct $name;
        impl Operations for $name {
            fn run<M: Probe, A: Node, B: Node, N: Node>(
                $m: &M,
                $a: Value<M, A>,
                $b: Value<M, B>,
            ) $body
        }
    )*};
}

struct Coefficients;
impl Table for Coefficients {
    const VALUES: &'static [f64] = &[0.3, -1.0, 1e9, -0.0078125, 0.5];
}

struct Pi;
impl Constant for Pi {
    const VALUE: f64 = -std::f64::consts::PI;
}

operations! {
    /// Everything that aligns two words.
    Sums: |m, a, b| {
        m.add::<N, _, _>(a, b);
        m.sub::<N, _, _>(a, b);
        m.raise(1, m.less(a, b));
        m.raise(2, m.xor(m.negative(a), m.not(m.negative(b))));
        m.select::<N, _, _>(m.less(b, a), a, b);
    }
    Products: |m, a, b| {
        m.mul::<N, _, _>(a, b);
    }
    Quotients: |m, a, b| {
        m.div::<N, _, _>(a, b);
    }
    /// Operations on a alone.
    Singles: |m, a, _b| {
        m.neg::<N, _>(a);
        m.abs::<N, _>(a);
        m.shift::<N, _, 0>(a);
        m.shift::<N, _, 1>(a);
        m.shift::<N, _, 2>(a);
        m.shift::<N, _, -1>(a);
        m.shift::<N, _, -9>(a);
        m.shift::<N, _, -70>(a);
    }
    Roots: |m, a, _b| {
        m.sqrt::<N, _>(a);
    }
    /// What comes from outside; a serves as the index.
    Sources: |m, a, b| {
        let raw = m.raw(b) as i32;
        m.input::<N, 0>(raw);
        m.input::<N, 7>(raw);
        m.input::<N, 28>(raw);
        m.input::<N, 80>(raw);
        m.shift::<N, _, 0>(m.parameter::<N, 14>(raw));
        m.shift::<N, _, 0>(m.constant::<N, Pi>());
        m.shift::<N, _, 0>(m.entry::<N, Coefficients>(raw.unsigned_abs() as usize % 9));
        m.lookup::<N, _, Coefficients>(a);
    }
}

/// Words of a format: all if there are few, else the edges and random ones.
fn words(format: Format, rng: &mut ChaCha8Rng) -> Vec<i64> {
    let (min, max) = (format.min_raw(), format.max_raw());
    if format.word <= 6 {
        return (min..=max).collect();
    }
    let mut words = vec![min, min + 1, min / 2, -1, 0, 1, max / 2 + 1, max - 1, max];
    let unused = 64 - format.word;
    for _ in 0..24 {
        // All magnitudes are as likely.
        let less = rng.next_u32() % format.word;
        words.push(rng.next_u64().cast_signed() >> (unused + less));
    }
    words
}

/// What an operation did.
#[derive(Debug, PartialEq)]
struct Outcome {
    events: Vec<Event>,
    status: u16,
}

fn outcome<O: Operations, M: Probe, A: Node, B: Node, N: Node>(m: &M, a: i64, b: i64) -> Outcome {
    O::run::<M, A, B, N>(m, m.value(a), m.value(b));
    Outcome {
        events: m.events(),
        status: m.take_status(),
    }
}

/// The mixed arithmetic takes formats from its table: any node types do.
fn mixed<O: Operations>(m: &Mixed<Events>, a: i64, b: i64) -> Outcome {
    type Any<const I: usize> = T<I, 1, 0, FixedI8<U0>>;
    outcome::<O, _, Any<0>, Any<1>, Any<2>>(m, a, b)
}

/// Runs the operations in both arithmetics over many words.
fn check<O: Operations, A: Node, B: Node, N: Node>(rng: &mut ChaCha8Rng) {
    compare(
        rng,
        [A::FORMAT, B::FORMAT, N::FORMAT],
        outcome::<O, Deployed<Events>, A, B, N>,
        outcome::<O, Deployed<Words>, A, B, N>,
        mixed::<O>,
    );
}

fn compare(
    rng: &mut ChaCha8Rng,
    formats: [Format; 3],
    deployed: fn(&Deployed<Events>, i64, i64) -> Outcome,
    firmware: fn(&Deployed<Words>, i64, i64) -> Outcome,
    mixed: fn(&Mixed<Events>, i64, i64) -> Outcome,
) {
    let nodes = formats.map(|format| NodeInfo {
        name: "",
        unit: "1",
        meaning: "",
        format,
    });
    let m_deployed = Deployed::new(Events::default());
    let m_firmware = Deployed::new(Words::default());
    let m_mixed = Mixed::new(&Formats::deployed(&nodes).unwrap(), Events::default());
    let others = words(formats[1], rng);
    for a in words(formats[0], rng) {
        for &b in &others {
            let mut expected = deployed(&m_deployed, a, b);
            assert!(!expected.events.is_empty());
            let place = format!("a = {a}, b = {b} in {formats:?}");
            assert_eq!(mixed(&m_mixed, a, b), expected, "{place}");
            let is_write = |event: &Event| matches!(event, Event::Write(..));
            expected.events.retain(is_write);
            assert_eq!(firmware(&m_firmware, a, b), expected, "{place}, kernels");
        }
    }
}

/// Checks operations for every listed A and B and the three N; each N takes all rounding modes, the
/// three together all pairs of rounding and overflow.
macro_rules! every {
    ($ops:ident, [$($a:ty),*], $bs:tt, $ns:tt) => {{
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        $(every!(@a rng, $ops, $a, $bs, $ns);)*
    }};
    (@a $rng:ident, $ops:ident, $a:ty, [$($b:ty),*], $ns:tt) => {
        $(every!(@b $rng, $ops, $a, $b, $ns);)*
    };
    (@b $rng:ident, $ops:ident, $a:ty, $b:ty,
     [($w1:literal, $c1:ty), ($w2:literal, $c2:ty), ($w3:literal, $c3:ty)]) => {
        every!(@n $rng, $ops, $a, $b, $w1, $c1, 0 7 14 3 10 17);
        every!(@n $rng, $ops, $a, $b, $w2, $c2, 6 13 2 9 16 5);
        every!(@n $rng, $ops, $a, $b, $w3, $c3, 12 1 8 15 4 11);
    };
    (@n $rng:ident, $ops:ident, $a:ty, $b:ty, $word:literal, $c:ty, $($mode:literal)*) => {
        $(check::<$ops, $a, $b, T<2, $word, $mode, $c>>(&mut $rng);)*
    };
}

type A6 = T<0, 6, 0, FixedI8<U3>>;
type A11 = T<0, 11, 0, FixedI16<U2>>;
type A16 = T<0, 16, 0, FixedI16<U14>>;
type A24 = T<0, 24, 0, FixedI32<U10>>;
type A32 = T<0, 32, 0, FixedI32<U20>>;
type A40 = T<0, 40, 0, FixedI64<U24>>;
type A60 = T<0, 60, 0, FixedI64<U30>>;
type B5 = T<1, 5, 0, FixedI8<U2>>;
type B8 = T<1, 8, 0, FixedI8<U7>>;
type B16 = T<1, 16, 0, FixedI16<U10>>;
type B24 = T<1, 24, 0, FixedI32<U10>>;
type B32 = T<1, 32, 0, FixedI32<U24>>;
type B33 = T<1, 33, 0, FixedI64<U30>>;

#[test]
fn sums_in_32_bits_equal() {
    every!(
        Sums,
        [A6, A16],
        [B5, B16],
        [(1, FixedI8<U0>), (4, FixedI8<U1>), (16, FixedI16<U14>)]
    );
}

#[test]
fn sums_in_64_bits_equal() {
    every!(
        Sums,
        [A32, A60],
        [B24, B33],
        [(32, FixedI32<U16>), (64, FixedI64<U30>), (47, FixedI64<U20>)]
    );
}

#[test]
fn products_in_32_bits_equal() {
    every!(
        Products,
        [A6, A16, A24],
        [B5, B8],
        [(4, FixedI8<U1>), (16, FixedI16<U10>), (23, FixedI32<U14>)]
    );
}

#[test]
fn products_in_64_bits_equal() {
    every!(
        Products,
        [A16, A32],
        [B24, B32],
        [(16, FixedI16<U10>), (32, FixedI32<U30>), (64, FixedI64<U24>)]
    );
    every!(
        Products,
        [A40],
        [B16, B24],
        [(24, FixedI32<U16>), (64, FixedI64<U30>), (41, FixedI64<U1>)]
    );
}

#[test]
fn quotients_in_32_bits_equal() {
    every!(
        Quotients,
        [A6, A16],
        [B5, B16],
        [(3, FixedI8<U0>), (8, FixedI8<U7>), (16, FixedI16<U10>)]
    );
}

#[test]
fn quotients_in_64_bits_equal() {
    every!(
        Quotients,
        [A11, A32, A40],
        [B24],
        [(16, FixedI16<U1>), (32, FixedI32<U30>), (50, FixedI64<U24>)]
    );
}

#[test]
fn single_operands_equal() {
    every!(
        Singles,
        [A6, A16],
        [B5],
        [(1, FixedI8<U0>), (6, FixedI8<U3>), (16, FixedI16<U14>)]
    );
    every!(
        Singles,
        [A32, A60],
        [B5],
        [(32, FixedI32<U16>), (64, FixedI64<U30>), (33, FixedI64<U20>)]
    );
}

#[test]
fn square_roots_equal() {
    every!(
        Roots,
        [A6],
        [B5],
        [(3, FixedI8<U2>), (8, FixedI8<U7>), (16, FixedI16<U14>)]
    );
    every!(
        Roots,
        [A16],
        [B5],
        [(8, FixedI8<U7>), (14, FixedI16<U14>), (32, FixedI32<U20>)]
    );
    every!(
        Roots,
        [A32, A40],
        [B5],
        [(16, FixedI16<U14>), (32, FixedI32<U20>), (64, FixedI64<U16>)]
    );
}

#[test]
fn values_from_outside_equal() {
    every!(
        Sources,
        [T<0, 16, 0, FixedI16<U7>>, T<0, 63, 0, FixedI64<U0>>, T<0, 64, 0, FixedI64<U64>>],
        [T<1, 32, 0, FixedI32<U0>>],
        [(8, FixedI8<U0>), (13, FixedI16<U14>), (32, FixedI32<U28>)]
    );
}

/// Formats just at and beyond the widths of the intermediates.
mod borders {
    use super::*;

    type A<const WORD: u32, C> = T<0, WORD, 0, C>;
    type B<const WORD: u32, C> = T<1, WORD, 0, C>;

    #[test]
    fn sums_equal() {
        every!(
            Sums,
            [A<30, FixedI32<U20>>, A<31, FixedI32<U20>>, A<32, FixedI32<U20>>],
            [B<31, FixedI32<U20>>, B<32, FixedI32<U20>>],
            [(31, FixedI32<U20>), (32, FixedI32<U19>), (31, FixedI32<U16>)]
        );
        every!(
            Sums,
            [A<61, FixedI64<U20>>, A<62, FixedI64<U20>>],
            [B<62, FixedI64<U20>>],
            [(62, FixedI64<U20>), (64, FixedI64<U19>), (63, FixedI64<U16>)]
        );
    }

    #[test]
    fn single_operands_equal() {
        every!(
            Singles,
            [A<30, FixedI32<U20>>, A<31, FixedI32<U20>>, A<32, FixedI32<U20>>],
            [B5],
            [(31, FixedI32<U20>), (32, FixedI32<U19>), (32, FixedI32<U16>)]
        );
        every!(
            Singles,
            [A<61, FixedI64<U20>>, A<62, FixedI64<U20>>],
            [B5],
            [(62, FixedI64<U19>), (64, FixedI64<U16>), (63, FixedI64<U0>)]
        );
    }

    #[test]
    fn products_equal() {
        every!(
            Products,
            [A<16, FixedI16<U14>>, A<17, FixedI32<U14>>, A<31, FixedI32<U14>>],
            [B<1, FixedI8<U0>>, B<15, FixedI16<U10>>, B<16, FixedI16<U10>>],
            [(32, FixedI32<U14>), (31, FixedI32<U16>), (8, FixedI8<U7>)]
        );
        every!(
            Products,
            [A<32, FixedI32<U14>>, A<63, FixedI64<U14>>],
            [B<1, FixedI8<U0>>],
            [(64, FixedI64<U14>), (63, FixedI64<U14>), (33, FixedI64<U10>)]
        );
    }

    #[test]
    fn quotients_equal() {
        every!(
            Quotients,
            [A<19, FixedI32<U14>>, A<20, FixedI32<U14>>, A<51, FixedI64<U14>>],
            [B<16, FixedI16<U10>>],
            [(32, FixedI32<U16>), (31, FixedI32<U16>), (17, FixedI32<U16>)]
        );
        every!(
            Quotients,
            [A<31, FixedI32<U30>>],
            [B<11, FixedI16<U0>>, B<12, FixedI16<U0>>, B<43, FixedI64<U0>>],
            [(32, FixedI32<U10>), (11, FixedI16<U10>), (1, FixedI16<U10>)]
        );
    }

    #[test]
    fn square_roots_equal() {
        every!(
            Roots,
            [A<31, FixedI32<U20>>, A<32, FixedI32<U20>>, A<33, FixedI64<U20>>, A<64, FixedI64<U20>>],
            [B5],
            [(32, FixedI32<U10>), (16, FixedI16<U10>), (17, FixedI32<U10>)]
        );
    }
}

/// Formats that the 16-bit kernels take: rounded to nearest with ties up, saturated (mode 9).
#[test]
fn kernels_equal() {
    type A<C> = T<0, 16, 0, C>;
    type B<C> = T<1, 16, 0, C>;
    type N<C> = T<2, 16, 9, C>;
    macro_rules! kernels {
        ($($ops:ident: $a:ty, $b:ty => $($n:ty),*;)*) => {{
            let mut rng = ChaCha8Rng::seed_from_u64(2);
            $($(check::<$ops, A<FixedI16<$a>>, B<FixedI16<$b>>, $n>(&mut rng);)*)*
        }};
    }
    type N14 = N<FixedI16<U14>>;
    type N16 = N<FixedI16<U16>>;
    type Wide<const MODE: usize> = T<2, 31, MODE, FixedI32<U28>>;
    kernels! {
        Products: U14, U14 => N14, Wide<9>, Wide<6>, N<FixedI16<U10>>;
        Products: U14, U16 => N14, N16;
        Products: U16, U16 => N16;
        Products: U14, U1 => N14, N<FixedI16<U0>>, N<FixedI16<U1>>;
        Quotients: U14, U14 => N14, N<FixedI16<U16>>;
        Quotients: U16, U14 => N16;
        Quotients: U14, U1 => N<FixedI16<U1>>, N<FixedI16<U2>>;
        Sums: U14, U14 => N14, T<2, 16, 6, FixedI16<U14>>, T<2, 16, 0, FixedI16<U14>>;
        Singles: U14, U14 => N14, N16, T<2, 16, 6, FixedI16<U14>>;
        Roots: U14, U14 => N14, N<FixedI16<U7>>;
    }
    type A31 = T<0, 31, 0, FixedI32<U28>>;
    type A32 = T<0, 32, 0, FixedI32<U28>>;
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    check::<Singles, A31, B5, N14>(&mut rng);
    check::<Singles, A31, B5, T<2, 16, 9, FixedI16<U13>>>(&mut rng);
    check::<Roots, A31, B5, N14>(&mut rng);
    check::<Roots, A32, B5, N14>(&mut rng);
    check::<Sums, A31, T<1, 31, 0, FixedI32<U28>>, N14>(&mut rng);
}

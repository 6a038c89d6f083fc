//! Law: every operation of the mixed arithmetic on words of any format agrees with exact rational
//! arithmetic, in every rounding and overflow mode.

#[allow(dead_code, reason = "each test uses its part of the oracle")]
#[path = "../../datapath/tests/rationals/mod.rs"]
mod rationals;

use cardan_datapath::fixed::FixedI8;
use cardan_datapath::fixed::types::extra::U0;
use cardan_datapath::{Arithmetic, Format, Node, NodeInfo, Overflow, Rounding, Value};
use cardan_numerics::{Formats, Mixed, Number, Overflows, Recorder};
use num_bigint::BigInt;
use num_rational::BigRational;
use num_traits::{Signed, Zero};
use rand_chacha::ChaCha8Rng;
use rand_core::{RngCore, SeedableRng};

use rationals::{fitted, fitted_root, power_of_two, random_operations, real};

/// Node `I` of the test; its format is given at run time.
#[derive(Clone, Copy)]
struct At<const I: usize>;
impl<const I: usize> Node for At<I> {
    const INDEX: usize = I;
    const NAME: &'static str = "";
    const UNIT: &'static str = "1";
    const FORMAT: Format = Format::new(1, 0, Rounding::Floor, Overflow::Saturate);
    type Word = FixedI8<U0>;
}
type A = At<0>;
type B = At<1>;
type N = At<2>;

type M = Mixed<Recorder>;

/// A written word, how often it did not fit, and whether the domain status was raised.
#[derive(Debug, PartialEq)]
struct Outcome {
    raw: BigInt,
    overflows: u64,
    failed: bool,
}

/// An operation of the mixed arithmetic, and the same on rational numbers.
struct Operation {
    name: &'static str,
    mixed: fn(&M, Value<M, A>, Value<M, B>),
    exact: fn(BigRational, BigRational, Format) -> Outcome,
}

fn written(value: &BigRational, format: Format) -> Outcome {
    outcome(fitted(value, format), format, false)
}

/// A trapped overflow raises the status as well.
fn outcome((raw, overflow): (BigInt, bool), format: Format, failed: bool) -> Outcome {
    Outcome {
        raw,
        overflows: overflow.into(),
        failed: failed || (overflow && format.overflow == Overflow::Trap),
    }
}

fn quotient(a: BigRational, b: BigRational, format: Format) -> Outcome {
    if !b.is_zero() {
        return written(&(a / b), format);
    }
    let end = BigInt::from(1) << (format.word - 1);
    Outcome {
        raw: if a.is_negative() { -end } else { end - 1 },
        overflows: 1,
        failed: true,
    }
}

fn root(a: BigRational, _: BigRational, format: Format) -> Outcome {
    outcome(fitted_root(&a, format), format, a.is_negative())
}

macro_rules! shifts {
    ($($power:literal)*) => {
        [$(Operation {
            name: concat!("shift by ", $power),
            mixed: |m, a, _| {
                m.shift::<N, _, $power>(a);
            },
            exact: |a, _, format| written(&(a * power_of_two($power)), format),
        }),*]
    };
}

const OPERATIONS: [Operation; 10] = [
    Operation {
        name: "add",
        mixed: |m, a, b| {
            m.add::<N, _, _>(a, b);
        },
        exact: |a, b, format| written(&(a + b), format),
    },
    Operation {
        name: "sub",
        mixed: |m, a, b| {
            m.sub::<N, _, _>(a, b);
        },
        exact: |a, b, format| written(&(a - b), format),
    },
    Operation {
        name: "mul",
        mixed: |m, a, b| {
            m.mul::<N, _, _>(a, b);
        },
        exact: |a, b, format| written(&(a * b), format),
    },
    Operation {
        name: "div",
        mixed: |m, a, b| {
            m.div::<N, _, _>(a, b);
        },
        exact: quotient,
    },
    Operation {
        name: "sqrt",
        mixed: |m, a, _| {
            m.sqrt::<N, _>(a);
        },
        exact: root,
    },
    Operation {
        name: "neg",
        mixed: |m, a, _| {
            m.neg::<N, _>(a);
        },
        exact: |a, _, format| written(&-a, format),
    },
    Operation {
        name: "abs",
        mixed: |m, a, _| {
            m.abs::<N, _>(a);
        },
        exact: |a, _, format| written(&a.abs(), format),
    },
    Operation {
        name: "the smaller",
        mixed: |m, a, b| {
            m.select::<N, _, _>(m.less(a, b), a, b);
        },
        exact: |a, b, format| written(&a.min(b), format),
    },
    Operation {
        name: "the negative one",
        mixed: |m, a, b| {
            m.select::<N, _, _>(m.negative(a), a, b);
        },
        exact: |a, b, format| written(if a.is_negative() { &a } else { &b }, format),
    },
    Operation {
        name: "mul by itself",
        mixed: |m, a, _| {
            m.mul::<N, _, _>(a, a);
        },
        exact: |a, _, format| written(&(&a * &a), format),
    },
];

const SHIFTS: [Operation; 12] = shifts! { 0 1 -1 2 -2 5 -7 31 -64 130 -200 63 };

fn any_operation(rng: &mut ChaCha8Rng) -> &'static Operation {
    static ALL: [&[Operation]; 2] = [&OPERATIONS, &SHIFTS];
    // A shift has one operand: the others come more often.
    let group = ALL[usize::from(rng.next_u32().is_multiple_of(5))];
    &group[rng.next_u32() as usize % group.len()]
}

/// The mixed arithmetic over three formats, `None` if these are refused.
fn mixed(formats: [Format; 3]) -> Option<M> {
    let nodes = formats.map(|format| NodeInfo {
        name: "",
        unit: "1",
        meaning: "",
        format,
    });
    Some(Mixed::new(
        &Formats::deployed(&nodes).ok()?,
        Recorder::new(3),
    ))
}

fn check(m: &M, formats: [Format; 3], operation: &Operation, a: i64, b: i64) {
    let word = |raw: i64, format: Format| Number {
        real: format.real(raw),
        raw: Some(raw),
    };
    (operation.mixed)(
        m,
        Value::new(word(a, formats[0])),
        Value::new(word(b, formats[1])),
    );
    let recording = m.observer().take();
    let [raw] = recording.raws[2][..] else {
        panic!("one write expected: {recording:?}");
    };
    let Overflows { count, first } = recording.overflows[2];
    assert_eq!(first.is_some(), count > 0);
    let found = Outcome {
        raw: raw.into(),
        overflows: count,
        failed: m.take_status() != 0,
    };
    let exact = |raw: i64, format: Format| real(raw, format.frac);
    let expected = (operation.exact)(exact(a, formats[0]), exact(b, formats[1]), formats[2]);
    assert_eq!(
        found, expected,
        "{}: a = {a}, b = {b} in {formats:?}",
        operation.name
    );
}

fn modes() -> impl Iterator<Item = (Rounding, Overflow)> {
    let pair = |rounding| Overflow::ALL.map(|(overflow, _)| (rounding, overflow));
    Rounding::ALL
        .into_iter()
        .flat_map(move |(rounding, _)| pair(rounding))
}

/// Every word to 6 bits on either side; every target word, resolutions coarser and finer.
#[test]
fn all_words_to_6_bits_agree() {
    let format = |frac| Format::new(6, frac, Rounding::Floor, Overflow::Wrap);
    for (rounding, overflow) in modes() {
        for (step, word) in (1..=6).enumerate() {
            // Resolutions are walked through, not crossed: all their sums and differences occur.
            for frac in [0, 3, 6] {
                let (a, b) = (format((2 * step) as u32 % 7), format((frac + 4) % 7));
                let formats = [a, b, Format::new(word, frac, rounding, overflow)];
                let m = mixed(formats).unwrap();
                for a in -32i64..32 {
                    for b in -32..32 {
                        let which = (a * 64 + b).rem_euclid(3) as usize + 7;
                        for operation in &OPERATIONS[..4] {
                            check(&m, formats, operation, a, b);
                        }
                        check(&m, formats, &OPERATIONS[which], a, b);
                    }
                    for operation in OPERATIONS[4..7].iter().chain(&SHIFTS) {
                        check(&m, formats, operation, a, 0);
                    }
                }
            }
        }
    }
}

/// A word of `format`: often an edge, else of random magnitude.
fn any_word(rng: &mut ChaCha8Rng, format: Format) -> i64 {
    let (min, max) = (format.min_raw(), format.max_raw());
    let edges = [
        min,
        max,
        0,
        1.min(max),
        -1,
        min + i64::from(format.word > 1),
        min / 2,
    ];
    let pick = rng.next_u32() as usize % 40;
    let less = rng.next_u32() % format.word;
    let any = rng.next_u64().cast_signed() >> (64 - format.word + less);
    edges.get(pick).copied().unwrap_or(any)
}

fn any_format(rng: &mut ChaCha8Rng, rounding: Rounding, overflow: Overflow) -> Format {
    let word = 1 + rng.next_u32() % 64;
    let frac = match rng.next_u32() % 4 {
        0 => rng.next_u32() % 65,
        _ => rng.next_u32() % (word + 1),
    };
    Format::new(word, frac, rounding, overflow)
}

#[test]
fn random_words_to_64_bits_agree() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    for (rounding, overflow) in modes() {
        let mut done = 0;
        while done < random_operations() {
            let formats = [(); 3].map(|()| any_format(&mut rng, rounding, overflow));
            let Some(m) = mixed(formats) else { continue };
            for _ in 0..20 {
                let (a, b) = (
                    any_word(&mut rng, formats[0]),
                    any_word(&mut rng, formats[1]),
                );
                check(&m, formats, any_operation(&mut rng), a, b);
                done += 1;
            }
        }
    }
}

/// The edges of the widest formats, where intermediates are longest.
#[test]
fn the_edges_of_the_widest_formats_agree() {
    let edges = [
        i64::MIN,
        i64::MIN + 1,
        i64::MIN / 2,
        -3,
        -1,
        0,
        1,
        2,
        i64::MAX / 2,
        i64::MAX,
    ];
    for (rounding, overflow) in modes() {
        let format = |word, frac| Format::new(word, frac, rounding, overflow);
        let wide = [
            format(64, 0),
            format(64, 62),
            format(64, 31),
            format(1, 62),
            format(2, 0),
        ];
        for a in wide {
            for b in wide {
                for n in wide {
                    let formats = [a, b, n];
                    let m = mixed(formats).unwrap();
                    let fits =
                        |raw: i64, format: Format| raw.clamp(format.min_raw(), format.max_raw());
                    for (index, raw) in edges.iter().enumerate() {
                        for other in &edges[index % 2..] {
                            let (raw, other) = (fits(*raw, a), fits(*other, b));
                            let operation = &OPERATIONS[index % OPERATIONS.len()];
                            check(&m, formats, &OPERATIONS[3], raw, other);
                            check(&m, formats, operation, raw, other);
                        }
                        check(&m, formats, &OPERATIONS[4], fits(*raw, a), 0);
                    }
                }
            }
        }
    }
}

/// An operation with a real operand is computed in `f64` and its exact value is rounded.
#[test]
fn real_numbers_enter_formats_from_their_exact_value() {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    for (rounding, overflow) in modes() {
        for _ in 0..random_operations() / 20 {
            let format = any_format(&mut rng, rounding, overflow);
            let nodes = [format; 3].map(|format| NodeInfo {
                name: "",
                unit: "1",
                meaning: "",
                format,
            });
            let formats = Formats::new(&nodes, vec![None, None, Some(format)]).unwrap();
            let m = Mixed::new(&formats, Recorder::new(3));
            // A word of the format, moved by a little or not, or any number at all.
            let near = format.real(any_word(&mut rng, format));
            let value = match rng.next_u32() % 4 {
                0 => near,
                1 => near + format.lsb() / 2.0,
                2 => near.next_up(),
                _ => Some(f64::from_bits(rng.next_u64()))
                    .filter(|x| x.is_finite())
                    .unwrap_or(f64::MAX),
            };
            m.shift::<N, A, 0>(Value::new(Number {
                real: value,
                raw: None,
            }));
            let recording = m.observer().take();
            let expected = written(&BigRational::from_float(value).unwrap(), format);
            assert_eq!(
                BigInt::from(recording.raws[2][0]),
                expected.raw,
                "{value:e} in {format:?}"
            );
            assert_eq!(
                recording.overflows[2].count, expected.overflows,
                "{value:e} in {format:?}"
            );
            assert_eq!(m.take_status() != 0, expected.failed);
        }
    }
}

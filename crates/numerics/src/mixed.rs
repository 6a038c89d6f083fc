//! The mixed arithmetic: every node in a run-time format, or real.

use std::cell::Cell;

use cardan_datapath::{
    Arithmetic, Constant, DEFAULT_DOMAIN_FLAG, Format, Node, Overflow, Silent, Table, Value,
};

use crate::Formats;
use crate::exact::{self, Fitted, Word};

/// Sees every write and every overflow of a node.
pub trait Observer {
    /// Node `node` takes `value`; `raw` is its word if the node is quantised.
    fn write(&self, node: usize, value: f64, raw: Option<i64>);
    /// The value about to be written did not fit node `node`.
    fn overflow(&self, node: usize);
}

impl Observer for Silent {
    fn write(&self, _node: usize, _value: f64, _raw: Option<i64>) {}
    fn overflow(&self, _node: usize) {}
}

/// A value: its word if the node is quantised, and always its real value (exact for words up to 53
/// bits, else the nearest).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Number {
    /// As a real number; finite.
    pub real: f64,
    /// The word, for the format of the node.
    pub raw: Option<i64>,
}

/// The first overflow of a node whose overflow mode is [`Overflow::Trap`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Trap {
    /// The node.
    pub node: usize,
    /// Which of the node's writes it was, from 0.
    pub write: u64,
}

/// A node of the run.
struct Slot {
    format: Option<Format>,
    lsb: f64,
    writes: Cell<u64>,
}

/// Computes with run-time formats.
///
/// An operation whose operands are all quantised is computed exactly (in 128 bits) and rounded and
/// limited once into its target. If an operand is real, the operation is computed in `f64`, and the
/// exact value of that is rounded if the target is quantised. A real target is never rounded. With
/// every node in its deployed format, words, status and overflows are those of
/// [`cardan_datapath::Deployed`].
///
/// Real values are finite. Beyond the `f64` range they stay at its end, which counts as overflow; a
/// zero divisor gives the end of the node's deployed range, as it does there. A node whose deployed
/// overflow is [`Overflow::Wrap`] holds its value modulo its range by design (an angle modulo a
/// turn), so its real values are reduced too: exactly, and not counted as overflow.
///
/// # Panics
/// An operation on a node whose index is beyond the formats panics: formats and algorithm belong to
/// different node tables.
pub struct Mixed<O: Observer> {
    slots: Vec<Slot>,
    observer: O,
    domain_flag: u16,
    status: Cell<u16>,
    trap: Cell<Option<Trap>>,
}

impl<O: Observer> Mixed<O> {
    /// Computes in `formats`; writes are shown to `observer`.
    pub fn new(formats: &Formats, observer: O) -> Self {
        Self::with_domain_flag(formats, observer, DEFAULT_DOMAIN_FLAG)
    }

    /// As [`Mixed::new`]; the arithmetic's own status bit is `domain_flag`.
    pub fn with_domain_flag(formats: &Formats, observer: O, domain_flag: u16) -> Self {
        let slot = |format: &Option<Format>| Slot {
            format: *format,
            lsb: format.map_or(0.0, Format::lsb),
            writes: Cell::new(0),
        };
        Self {
            slots: formats.as_slice().iter().map(slot).collect(),
            observer,
            domain_flag,
            status: Cell::new(0),
            trap: Cell::new(None),
        }
    }

    /// The observer.
    pub const fn observer(&self) -> &O {
        &self.observer
    }

    /// The observer, when the run is over.
    pub fn into_observer(self) -> O {
        self.observer
    }

    /// The first trapped overflow.
    pub const fn trap(&self) -> Option<Trap> {
        self.trap.get()
    }

    /// a 2^power.
    fn scaled<N: Node, A: Node>(&self, a: Value<Self, A>, power: i32) -> Value<Self, N> {
        self.write(
            |format| {
                let a = self.word(a)?;
                let frac = a.frac.cast_signed().saturating_sub(power);
                Some(exact::fit(a.raw.into(), frac, format))
            },
            || libm::ldexp(a.word().real, power),
        )
    }

    fn fail(&self) {
        self.status.set(self.status.get() | self.domain_flag);
    }

    fn overflow<N: Node>(&self) {
        self.observer.overflow(N::INDEX);
    }

    /// The overflow of a quantised node.
    fn note<N: Node>(&self, format: Format) {
        self.overflow::<N>();
        if format.overflow == Overflow::Trap {
            self.fail();
            if self.trap.get().is_none() {
                self.trap.set(Some(Trap {
                    node: N::INDEX,
                    write: self.slots[N::INDEX].writes.get(),
                }));
            }
        }
    }

    /// The word of a quantised value.
    fn word<A: Node>(&self, a: Value<Self, A>) -> Option<Word> {
        let frac = self.slots[A::INDEX].format?.frac;
        Some(Word {
            raw: a.word().raw?,
            frac,
        })
    }

    fn words<A: Node, B: Node>(
        &self,
        a: Value<Self, A>,
        b: Value<Self, B>,
    ) -> Option<(Word, Word)> {
        Some((self.word(a)?, self.word(b)?))
    }

    /// A value of node `N`: `exact` gives it in a format if the operands are words, else `real`.
    fn fit<N: Node>(
        &self,
        exact: impl FnOnce(Format) -> Option<Fitted>,
        real: impl FnOnce() -> f64,
    ) -> Value<Self, N> {
        let Some(format) = self.slots[N::INDEX].format else {
            return self.real::<N>(real());
        };
        let (raw, overflow) =
            exact(format).unwrap_or_else(|| exact::quantise(finite(real()), format));
        if overflow {
            self.note::<N>(format);
        }
        self.quantised(raw)
    }

    fn quantised<N: Node>(&self, raw: i64) -> Value<Self, N> {
        Value::new(Number {
            real: raw as f64 * self.slots[N::INDEX].lsb,
            raw: Some(raw),
        })
    }

    /// A value of real node `N`.
    fn real<N: Node>(&self, value: f64) -> Value<Self, N> {
        let limited = finite(value);
        if limited != value {
            self.overflow::<N>();
        }
        unrounded(match N::FORMAT.overflow {
            Overflow::Wrap => wrapped(limited, N::FORMAT),
            Overflow::Saturate | Overflow::Trap => limited,
        })
    }

    /// Shows a write to the observer.
    fn record<N: Node>(&self, value: Value<Self, N>) -> Value<Self, N> {
        let writes = &self.slots[N::INDEX].writes;
        let number = value.word();
        self.observer.write(N::INDEX, number.real, number.raw);
        writes.set(writes.get() + 1);
        value
    }

    fn write<N: Node>(
        &self,
        exact: impl FnOnce(Format) -> Option<Fitted>,
        real: impl FnOnce() -> f64,
    ) -> Value<Self, N> {
        self.record(self.fit(exact, real))
    }

    /// What a zero divisor gives: the end of the range on the dividend's side.
    fn end<N: Node>(&self, negative: bool) -> Value<Self, N> {
        let end = |format: Format| {
            if negative {
                format.min_raw()
            } else {
                format.max_raw()
            }
        };
        match self.slots[N::INDEX].format {
            Some(format) => {
                self.note::<N>(format);
                self.quantised(end(format))
            }
            None => {
                self.overflow::<N>();
                unrounded(N::FORMAT.real(end(N::FORMAT)))
            }
        }
    }

    /// A constant of node `N`.
    fn known<N: Node>(&self, value: f64) -> Value<Self, N> {
        match self.slots[N::INDEX].format {
            Some(format) => self.quantised(format.constant(value)),
            None => unrounded(value),
        }
    }
}

fn unrounded<O: Observer, N: Node>(real: f64) -> Value<Mixed<O>, N> {
    Value::new(Number { real, raw: None })
}

/// The end of the `f64` range for an infinite result. (Finite operands never give NaN here.)
pub(crate) fn finite(value: f64) -> f64 {
    value.clamp(f64::MIN, f64::MAX)
}

/// `value` modulo the range of `format`, from -half the range up to and without half of it; exact.
pub(crate) fn wrapped(value: f64, format: Format) -> f64 {
    let half = -format.real(format.min_raw());
    let rest = value % (2.0 * half);
    if rest >= half {
        rest - 2.0 * half
    } else if rest < -half {
        rest + 2.0 * half
    } else {
        rest
    }
}

impl<O: Observer> Arithmetic for Mixed<O> {
    type Word<N: Node> = Number;
    type Bool = bool;

    fn input<N: Node, const F: u32>(&self, raw: i32) -> Value<Self, N> {
        self.record(self.parameter::<N, F>(raw))
    }

    fn parameter<N: Node, const F: u32>(&self, raw: i32) -> Value<Self, N> {
        let frac = const {
            assert!(F <= 1000, "an input has at most 1000 fractional bits");
            F.cast_signed()
        };
        self.fit(
            |format| Some(exact::fit(raw.into(), frac, format)),
            || libm::ldexp(raw.into(), -frac),
        )
    }

    fn constant<N: Node, C: Constant>(&self) -> Value<Self, N> {
        self.known(C::VALUE)
    }

    fn entry<N: Node, T: Table>(&self, index: usize) -> Value<Self, N> {
        self.known(T::VALUES[index.min(T::VALUES.len() - 1)])
    }

    fn lookup<N: Node, I: Node, T: Table>(&self, index: Value<Self, I>) -> Value<Self, N> {
        let last = T::VALUES.len() - 1;
        let whole = match self.word(index) {
            Some(word) => (i128::from(word.raw) >> word.frac).clamp(0, last as i128) as usize,
            None => index.word().real.floor().clamp(0.0, last as f64) as usize,
        };
        self.record(self.entry::<N, T>(whole))
    }

    fn add<N: Node, A: Node, B: Node>(
        &self,
        a: Value<Self, A>,
        b: Value<Self, B>,
    ) -> Value<Self, N> {
        self.write(
            |format| {
                self.words(a, b)
                    .map(|(a, b)| exact::sum(a, b, false, format))
            },
            || a.word().real + b.word().real,
        )
    }

    fn sub<N: Node, A: Node, B: Node>(
        &self,
        a: Value<Self, A>,
        b: Value<Self, B>,
    ) -> Value<Self, N> {
        self.write(
            |format| {
                self.words(a, b)
                    .map(|(a, b)| exact::sum(a, b, true, format))
            },
            || a.word().real - b.word().real,
        )
    }

    fn mul<N: Node, A: Node, B: Node>(
        &self,
        a: Value<Self, A>,
        b: Value<Self, B>,
    ) -> Value<Self, N> {
        self.write(
            |format| self.words(a, b).map(|(a, b)| exact::product(a, b, format)),
            || a.word().real * b.word().real,
        )
    }

    fn div<N: Node, A: Node, B: Node>(
        &self,
        a: Value<Self, A>,
        b: Value<Self, B>,
    ) -> Value<Self, N> {
        if b.word().real == 0.0 {
            self.fail();
            return self.record(self.end(a.word().real < 0.0));
        }
        self.write(
            |format| self.words(a, b).map(|(a, b)| exact::quotient(a, b, format)),
            || a.word().real / b.word().real,
        )
    }

    fn sqrt<N: Node, A: Node>(&self, a: Value<Self, A>) -> Value<Self, N> {
        let negative = a.word().real < 0.0;
        if negative {
            self.fail();
        }
        let radicand = |word: Word| Word {
            raw: word.raw.max(0),
            ..word
        };
        self.write(
            |format| self.word(a).map(|a| exact::root(radicand(a), format)),
            || if negative { 0.0 } else { a.word().real.sqrt() },
        )
    }

    fn shift<N: Node, A: Node, const POWER: i32>(&self, a: Value<Self, A>) -> Value<Self, N> {
        self.scaled(a, POWER)
    }

    fn scale<N: Node, A: Node, const LEAST: i32, const MOST: i32>(
        &self,
        a: Value<Self, A>,
        power: i32,
    ) -> Value<Self, N> {
        self.scaled(a, power.min(MOST).max(LEAST))
    }

    fn neg<N: Node, A: Node>(&self, a: Value<Self, A>) -> Value<Self, N> {
        self.write(
            |format| {
                self.word(a)
                    .map(|a| exact::fit(-i128::from(a.raw), a.frac.cast_signed(), format))
            },
            || -a.word().real,
        )
    }

    fn abs<N: Node, A: Node>(&self, a: Value<Self, A>) -> Value<Self, N> {
        self.write(
            |format| {
                self.word(a)
                    .map(|a| exact::fit(i128::from(a.raw).abs(), a.frac.cast_signed(), format))
            },
            || a.word().real.abs(),
        )
    }

    fn less<A: Node, B: Node>(&self, a: Value<Self, A>, b: Value<Self, B>) -> bool {
        match self.words(a, b) {
            Some((a, b)) => exact::less(a, b),
            None => a.word().real < b.word().real,
        }
    }

    fn negative<A: Node>(&self, a: Value<Self, A>) -> bool {
        a.word().real < 0.0
    }

    fn truth(&self, value: bool) -> bool {
        value
    }

    fn not(&self, a: bool) -> bool {
        !a
    }

    fn or(&self, a: bool, b: bool) -> bool {
        a | b
    }

    fn xor(&self, a: bool, b: bool) -> bool {
        a ^ b
    }

    fn either(&self, condition: bool, a: bool, b: bool) -> bool {
        if condition { a } else { b }
    }

    fn select<N: Node, A: Node, B: Node>(
        &self,
        condition: bool,
        a: Value<Self, A>,
        b: Value<Self, B>,
    ) -> Value<Self, N> {
        if condition {
            self.shift::<N, A, 0>(a)
        } else {
            self.shift::<N, B, 0>(b)
        }
    }

    fn raise(&self, flags: u16, condition: bool) {
        if condition {
            self.status.set(self.status.get() | flags);
        }
    }

    fn take_status(&self) -> u16 {
        self.status.replace(0)
    }
}

//! Bounds of every write of a tape for any inputs within given bounds: interval arithmetic, rounded
//! outward, with what earlier steps leave iterated to a fixed point.

use cardan_datapath::{Format, Overflow};

use super::{Entry, NO_NODE, Op, Ref, Tape};

/// Iterations of the feedback before what still grows is given its format's whole range.
const ITERATIONS: usize = 40;

/// A closed interval; truths are within 0..=1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// Lower end.
    pub lo: f64,
    /// Upper end.
    pub hi: f64,
}

impl Interval {
    /// From one end to the other.
    #[must_use]
    pub const fn new(lo: f64, hi: f64) -> Self {
        Self { lo, hi }
    }

    const ALL: Self = Self::new(f64::NEG_INFINITY, f64::INFINITY);
    const TRUTH: Self = Self::new(0.0, 1.0);

    /// Ends of a computed interval: one place outward, so that rounding of `f64` cannot hide a value.
    fn outward(lo: f64, hi: f64) -> Self {
        if lo.is_nan() || hi.is_nan() {
            return Self::ALL;
        }
        Self::new(lo.next_down(), hi.next_up())
    }

    /// The smallest interval that holds both.
    #[must_use]
    pub const fn hull(self, other: Self) -> Self {
        Self::new(self.lo.min(other.lo), self.hi.max(other.hi))
    }

    fn over_ends(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        let ends = [
            f(self.lo, other.lo),
            f(self.lo, other.hi),
            f(self.hi, other.lo),
            f(self.hi, other.hi),
        ];
        if ends.iter().any(|end| end.is_nan()) {
            return Self::ALL;
        }
        let lo = ends.into_iter().fold(f64::INFINITY, f64::min);
        let hi = ends.into_iter().fold(f64::NEG_INFINITY, f64::max);
        Self::outward(lo, hi)
    }

    fn divided_by(self, divisor: Self) -> Self {
        if divisor.lo <= 0.0 && divisor.hi >= 0.0 {
            return Self::ALL;
        }
        self.over_ends(divisor, |a, b| a / b)
    }

    fn magnitude(self) -> Self {
        let hi = self.lo.abs().max(self.hi.abs());
        let contains_zero = self.lo <= 0.0 && self.hi >= 0.0;
        let lo = if contains_zero {
            0.0
        } else {
            self.lo.abs().min(self.hi.abs())
        };
        Self::new(lo, hi)
    }

    /// True if every value fits `format`, rounding included.
    #[must_use]
    pub fn fits(self, format: Format) -> bool {
        let lsb = format.lsb();
        self.lo >= format.real(format.min_raw())
            && self.hi <= format.real(format.max_raw()) + lsb / 4.0
    }

    /// What a node of this format holds after a write of any of these values.
    fn quantised(self, format: Format) -> Self {
        let whole = Self::new(format.real(format.min_raw()), format.real(format.max_raw()));
        let lsb = format.lsb();
        // Both ends are on the grid already, or move by less than one place.
        let on_grid = |value: f64| (value / lsb).fract() == 0.0;
        let lo = if on_grid(self.lo) {
            self.lo
        } else {
            self.lo - lsb
        };
        let hi = if on_grid(self.hi) {
            self.hi
        } else {
            self.hi + lsb
        };
        if lo >= whole.lo && hi <= whole.hi {
            return Self::new(lo, hi);
        }
        match format.overflow {
            Overflow::Wrap => whole,
            Overflow::Saturate | Overflow::Trap => {
                Self::new(lo.clamp(whole.lo, whole.hi), hi.clamp(whole.lo, whole.hi))
            }
        }
    }
}

/// Bounds of every node's writes before they are rounded and limited to its format; `None` for nodes
/// that are never written. `ports` bounds the raw inputs of a step; values in `formats`.
#[must_use]
pub fn bounds(tape: &Tape, ports: &[(i32, i32)], formats: &[Format]) -> Vec<Option<Interval>> {
    let mut analysis = Analysis {
        tape,
        ports,
        formats,
        before: Vec::new(),
        found: vec![None; formats.len()],
    };
    for entry in &tape.before {
        let item = analysis.evaluate(entry, &[], |_, _| Interval::ALL);
        analysis.before.push(item);
    }
    // The first steps one by one; they are few, and what they leave feeds the others.
    let mut steps: Vec<Vec<Interval>> = Vec::new();
    for step in 0..tape.transient.len() + tape.memory() + 1 {
        let mut items = Vec::new();
        for entry in tape.body(step) {
            let ago = |back: u32, index: u32| steps[step - back as usize][index as usize];
            let item = analysis.evaluate(entry, &items, ago);
            items.push(item);
        }
        steps.push(items);
    }
    let held = analysis.fixed_point(&steps);
    let mut items = Vec::new();
    for entry in &tape.steady {
        let item = analysis.evaluate(entry, &items, |_, index| held[index as usize]);
        items.push(item);
    }
    analysis.found
}

struct Analysis<'a> {
    tape: &'a Tape,
    ports: &'a [(i32, i32)],
    formats: &'a [Format],
    before: Vec<Interval>,
    /// Per node the hull of its writes before they are limited.
    found: Vec<Option<Interval>>,
}

impl Analysis<'_> {
    /// Bounds of what a steady step leaves, whatever the steps before it were.
    fn fixed_point(&mut self, steps: &[Vec<Interval>]) -> Vec<Interval> {
        let steady = steps.last().map_or(&[][..], Vec::as_slice);
        let mut held = steady.to_vec();
        // Indices that operations look back at are those of the bodies they were written in.
        for entry in &self.tape.steady {
            for operand in entry.op.operands() {
                if let Ref::Ago { steps: back, index } = operand {
                    let first = self.tape.transient.len();
                    for items in &steps[first.saturating_sub(back as usize)..] {
                        let held = &mut held[index as usize];
                        *held = held.hull(items[index as usize]);
                    }
                }
            }
        }
        for iteration in 0.. {
            let mut items: Vec<Interval> = Vec::new();
            let mut grown = false;
            for entry in &self.tape.steady {
                let item = self.evaluate(entry, &items, |_, index| held[index as usize]);
                items.push(item);
            }
            for (index, item) in items.iter().enumerate() {
                let hull = held[index].hull(*item);
                if hull == held[index] {
                    continue;
                }
                grown = true;
                held[index] = if iteration < ITERATIONS {
                    hull
                } else {
                    self.whole(&self.tape.steady[index])
                };
            }
            if !grown {
                break;
            }
        }
        held
    }

    /// All that an operation's node can hold.
    fn whole(&self, entry: &Entry) -> Interval {
        match self.formats.get(entry.node as usize) {
            Some(format) => Interval::ALL.quantised(*format),
            None => Interval::TRUTH,
        }
    }

    fn evaluate(
        &mut self,
        entry: &Entry,
        items: &[Interval],
        ago: impl Fn(u32, u32) -> Interval,
    ) -> Interval {
        let item = |operand: Ref| match operand {
            Ref::Before(index) => self.before[index as usize],
            Ref::Here(index) => items[index as usize],
            Ref::Ago { steps, index } => ago(steps, index),
        };
        if entry.node == NO_NODE {
            return truth(entry.op.map(item));
        }
        let format = self.formats[entry.node as usize];
        let computed = match entry.op {
            Op::Select(condition, a, b) => {
                let deciding = match condition {
                    Ref::Here(index) => self.tape.steady.get(index as usize).map(|entry| entry.op),
                    Ref::Before(_) | Ref::Ago { .. } => None,
                };
                selected(item(condition), (a, item(a)), (b, item(b)), deciding, item)
            }
            Op::Mul(a, b) if a == b => {
                let a = item(a).magnitude();
                Interval::outward(a.lo * a.lo, a.hi * a.hi)
            }
            Op::Input { port, frac } => {
                let (lo, hi) = self.ports[port as usize];
                let real = |raw: i32| libm::ldexp(raw.into(), -frac);
                Interval::new(real(lo), real(hi))
            }
            op => value(op.map(item), format),
        };
        if entry.op.is_recorded() {
            let found = &mut self.found[entry.node as usize];
            *found = Some(found.map_or(computed, |found| found.hull(computed)));
        }
        computed.quantised(format)
    }
}

/// A selection, refined by the comparison that decides it: behind `a < b`, a is under b's end.
fn selected(
    condition: Interval,
    (a_ref, mut a): (Ref, Interval),
    (b_ref, mut b): (Ref, Interval),
    deciding: Option<Op<Ref>>,
    item: impl Fn(Ref) -> Interval,
) -> Interval {
    match deciding {
        Some(Op::Less(p, q)) => {
            let (low, high) = (item(p), item(q));
            if a_ref == p {
                a.hi = a.hi.min(high.hi).max(a.lo);
            } else if a_ref == q {
                a.lo = a.lo.max(low.lo).min(a.hi);
            }
            if b_ref == p {
                b.lo = b.lo.max(high.lo).min(b.hi);
            } else if b_ref == q {
                b.hi = b.hi.min(low.hi).max(b.lo);
            }
        }
        Some(Op::Negative(p)) => {
            if a_ref == p {
                a.hi = a.hi.min(0.0).max(a.lo);
            }
            if b_ref == p {
                b.lo = b.lo.max(0.0).min(b.hi);
            }
        }
        _ => {}
    }
    if condition.lo == 1.0 {
        a
    } else if condition.hi == 0.0 {
        b
    } else {
        a.hull(b)
    }
}

fn value(op: Op<Interval>, format: Format) -> Interval {
    match op {
        Op::Parameter { raw, frac } => {
            let real = libm::ldexp(raw.into(), -frac);
            Interval::new(real, real)
        }
        Op::Constant(value) => {
            let real = format.real(format.constant(value));
            Interval::new(real, real)
        }
        Op::Lookup(_, table) => table.iter().fold(
            Interval::new(f64::INFINITY, f64::NEG_INFINITY),
            |hull, &value| hull.hull(Interval::new(value, value)),
        ),
        Op::Add(a, b) => Interval::outward(a.lo + b.lo, a.hi + b.hi),
        Op::Sub(a, b) => Interval::outward(a.lo - b.hi, a.hi - b.lo),
        Op::Mul(a, b) => a.over_ends(b, |a, b| a * b),
        Op::Div(a, b) => a.divided_by(b),
        Op::Sqrt(a) => Interval::outward(a.lo.max(0.0).sqrt(), a.hi.max(0.0).sqrt()),
        Op::Shift(a, power) => Interval::new(libm::ldexp(a.lo, power), libm::ldexp(a.hi, power)),
        Op::Neg(a) => Interval::new(-a.hi, -a.lo),
        Op::Abs(a) => a.magnitude(),
        _ => Interval::ALL,
    }
}

fn truth(op: Op<Interval>) -> Interval {
    let known = |value: bool| {
        let value = f64::from(u8::from(value));
        Interval::new(value, value)
    };
    match op {
        Op::Less(a, b) if a.hi < b.lo => known(true),
        Op::Less(a, b) if a.lo >= b.hi => known(false),
        Op::Negative(a) if a.hi < 0.0 => known(true),
        Op::Negative(a) if a.lo >= 0.0 => known(false),
        Op::Known(value) => known(value),
        Op::Not(a) => Interval::new(1.0 - a.hi, 1.0 - a.lo),
        Op::Or(a, b) => Interval::new(a.lo.max(b.lo), a.hi.max(b.hi)),
        _ => Interval::TRUTH,
    }
}

//! Bounds of every write of a tape for any inputs within given bounds: interval arithmetic, rounded
//! outward, with what earlier steps leave iterated to a fixed point.

use cardan_datapath::Format;

use super::{Entry, Interval, NO_NODE, Op, Ref, Tape};

/// Iterations of the feedback before what still grows is given its format's whole range.
const ITERATIONS: usize = 40;

/// Bounds of every node's writes before they are rounded and limited to its format; `None` for nodes
/// that are never written. `ports` bounds the raw inputs of a step; values in `formats`.
#[must_use]
pub fn bounds(tape: &Tape, ports: &[(i32, i32)], formats: &[Format]) -> Vec<Option<Interval>> {
    Analysis::run(tape, ports, formats).found
}

/// What intervals know of every operation.
pub(super) struct Analysis<'a> {
    pub(super) tape: &'a Tape,
    pub(super) ports: &'a [(i32, i32)],
    pub(super) formats: &'a [Format],
    /// What stands before the first step.
    pub(super) before: Vec<Interval>,
    /// The first steps: those that differ, and as many equal ones as operations look back.
    pub(super) steps: Vec<Vec<Interval>>,
    /// Every later step.
    pub(super) held: Vec<Interval>,
    /// Per node the hull of its writes before they are limited: those before the first step.
    pub(super) found_before: Vec<Option<Interval>>,
    /// All of them.
    pub(super) found: Vec<Option<Interval>>,
}

impl<'a> Analysis<'a> {
    pub(super) fn run(tape: &'a Tape, ports: &'a [(i32, i32)], formats: &'a [Format]) -> Self {
        let mut analysis = Self {
            tape,
            ports,
            formats,
            before: Vec::new(),
            steps: Vec::new(),
            held: Vec::new(),
            found_before: Vec::new(),
            found: vec![None; formats.len()],
        };
        for entry in &tape.before {
            let item = analysis.evaluate(&tape.before, entry, &[], |_, _| Interval::ALL);
            analysis.before.push(item);
        }
        analysis.found_before.clone_from(&analysis.found);
        // The first steps one by one; they are few, and what they leave feeds the others.
        let mut steps: Vec<Vec<Interval>> = Vec::new();
        for step in 0..tape.transient.len() + tape.memory() + 1 {
            let mut items = Vec::new();
            for entry in tape.body(step) {
                let ago = |back: u32, index: u32| steps[step - back as usize][index as usize];
                let item = analysis.evaluate(tape.body(step), entry, &items, ago);
                items.push(item);
            }
            steps.push(items);
        }
        analysis.held = analysis.fixed_point(&steps);
        analysis.steps = steps;
        analysis
    }

    /// Bounds of what a steady step leaves, whatever the steps before it were.
    fn fixed_point(&mut self, steps: &[Vec<Interval>]) -> Vec<Interval> {
        let tape = self.tape;
        let mut held = early(tape, steps);
        for iteration in 0.. {
            let mut items: Vec<Interval> = Vec::new();
            let mut grown = false;
            for entry in &tape.steady {
                let ago = |_, index: u32| held[index as usize];
                let item = self.evaluate(&tape.steady, entry, &items, ago);
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
                    self.whole(&tape.steady[index])
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
        body: &[Entry],
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
        let computed = computed(entry.op, body, self.ports, format, item);
        if entry.op.is_recorded() {
            let found = &mut self.found[entry.node as usize];
            *found = Some(found.map_or(computed, |found| found.hull(computed)));
        }
        computed.quantised(format)
    }
}

/// What the first steps leave to the later ones: the hull of those that an operation may look back
/// at, and of the last of them everywhere.
pub(super) fn early(tape: &Tape, steps: &[Vec<Interval>]) -> Vec<Interval> {
    let mut held = steps.last().cloned().unwrap_or_default();
    // Indices that operations look back at are those of the bodies they were written in.
    for entry in &tape.steady {
        for operand in entry.op.operands() {
            if let Ref::Ago { steps: back, index } = operand {
                let first = tape.transient.len();
                for items in &steps[first.saturating_sub(back as usize)..] {
                    let held = &mut held[index as usize];
                    *held = held.hull(items[index as usize]);
                }
            }
        }
    }
    held
}

/// What an operation of `body` gives, before its node rounds and limits it.
pub(super) fn computed(
    op: Op<Ref>,
    body: &[Entry],
    ports: &[(i32, i32)],
    format: Format,
    item: impl Fn(Ref) -> Interval,
) -> Interval {
    match op {
        Op::Select(condition, a, b) => {
            let deciding = deciding(condition, body);
            selected(item(condition), (a, item(a)), (b, item(b)), deciding, item)
        }
        Op::Mul(a, b) if a == b => {
            let a = item(a).magnitude();
            Interval::outward(a.lo * a.lo, a.hi * a.hi)
        }
        Op::Input { port, frac } => {
            let (lo, hi) = ports[port as usize];
            let real = |raw: i32| libm::ldexp(raw.into(), -frac);
            Interval::new(real(lo), real(hi))
        }
        op => value(op.map(item), format),
    }
}

/// The comparison behind a condition, where it is one of the same step.
pub(super) fn deciding(condition: Ref, body: &[Entry]) -> Option<Op<Ref>> {
    match condition {
        Ref::Here(index) => body.get(index as usize).map(|entry| entry.op),
        Ref::Before(_) | Ref::Ago { .. } => None,
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
        Op::Constant(value) => Interval::of_word(format.constant(value), format),
        Op::Lookup(index, table) => {
            let last = table.len().saturating_sub(1) as f64;
            let place = |at: f64| at.floor().clamp(0.0, last) as usize;
            let reached = table.get(place(index.lo)..=place(index.hi));
            let none = Interval::new(f64::INFINITY, f64::NEG_INFINITY);
            let hull = |hull: Interval, &value: &f64| hull.hull(Interval::new(value, value));
            reached.unwrap_or_default().iter().fold(none, hull)
        }
        Op::Add(a, b) => Interval::outward(a.lo + b.lo, a.hi + b.hi),
        Op::Sub(a, b) => Interval::outward(a.lo - b.hi, a.hi - b.lo),
        Op::Mul(a, b) => a.over_ends(b, |a, b| a * b),
        Op::Div(a, b) => a.divided_by(b),
        Op::Sqrt(a) => Interval::outward(a.lo.max(0.0).sqrt(), a.hi.max(0.0).sqrt()),
        Op::Shift(a, power) => shifted(a, power),
        Op::Neg(a) => Interval::new(-a.hi, -a.lo),
        Op::Abs(a) => a.magnitude(),
        _ => Interval::ALL,
    }
}

/// a 2^power; outward where the result has left the normal numbers.
fn shifted(a: Interval, power: i32) -> Interval {
    let (lo, hi) = (libm::ldexp(a.lo, power), libm::ldexp(a.hi, power));
    let is_exact = |from: f64, to: f64| from == 0.0 || to.is_normal() || from.is_infinite();
    if is_exact(a.lo, lo) && is_exact(a.hi, hi) {
        Interval::new(lo, hi)
    } else {
        Interval::outward(lo, hi)
    }
}

pub(super) fn truth(op: Op<Interval>) -> Interval {
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

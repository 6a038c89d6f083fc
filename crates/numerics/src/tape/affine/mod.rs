//! Bounds of every write of a tape by affine arithmetic with intervals as its companion: every value
//! has a form, which remembers what it shares with others, and a range, in which both must lie; so no
//! bound is wider than that of intervals alone. What a step takes from earlier ones is a range and
//! nothing more: correlation is followed within a step.

mod exact;
mod form;

use cardan_datapath::{Format, Overflow, Rounding};

use super::interval::{self, Analysis};
use super::{Entry, Interval, NO_NODE, Op, Ref, Tape};
use form::{Form, Symbol};

/// Iterations of the feedback before the intervals' own bounds are taken.
const ITERATIONS: i32 = 48;
/// From this one on what grows is given more room each time, twice as much as the time before.
const PATIENCE: i32 = 12;
/// Steps taken from bounds that hold to tighter ones.
const NARROWINGS: usize = 16;

/// A value of a step. Truths, within 0..=1, have a range only.
#[derive(Clone, Debug)]
struct Item {
    range: Interval,
    form: Form,
}

/// As [`bounds`](super::bounds), never wider: values that are computed from the same inputs are known
/// to be. The ranges hold for words and, where nothing overflows and constants are exact in their
/// nodes, for the real interpretation.
#[must_use]
pub fn affine_bounds(
    tape: &Tape,
    ports: &[(i32, i32)],
    formats: &[Format],
) -> Vec<Option<Interval>> {
    let outer = Analysis::run(tape, ports, formats);
    let mut found = outer.found_before.clone();
    let mut steps: Vec<Vec<Interval>> = Vec::new();
    for number in 0..outer.steps.len() {
        let step = Step {
            outer: &outer,
            number: Some(number),
            limits: &outer.steps[number],
        };
        let ago = |back: u32, index: u32| steps[number - back as usize][index as usize];
        let ranges = step.run(ago, Some(&mut found));
        steps.push(ranges);
    }
    let steady = Step {
        outer: &outer,
        number: None,
        limits: &outer.held,
    };
    let held = fixed_point(&steady, &steps);
    steady.run(|_, index| held[index as usize], Some(&mut found));
    let both = found.iter().zip(&outer.found);
    both.map(|(found, outer)| Some((*outer)?.meet((*found)?)))
        .collect()
}

/// Bounds of what a steady step leaves, whatever the steps before it were: from below until nothing
/// grows, then narrowed.
fn fixed_point(steady: &Step<'_>, steps: &[Vec<Interval>]) -> Vec<Interval> {
    let tape = steady.outer.tape;
    let outer = &steady.outer.held;
    let mut looked_at = vec![false; tape.steady.len()];
    for operand in tape.steady.iter().flat_map(|entry| entry.op.operands()) {
        if let Ref::Ago { index, .. } = operand {
            looked_at[index as usize] = true;
        }
    }
    let first = interval::early(tape, steps);
    if !looked_at.contains(&true) {
        return first;
    }
    let step = |held: &[Interval]| steady.run(|_, index| held[index as usize], None);
    let mut held = first.clone();
    let mut stable = false;
    for iteration in 0..ITERATIONS {
        let items = step(&held);
        stable = true;
        for index in (0..held.len()).filter(|&index| looked_at[index]) {
            let hull = held[index].hull(items[index]);
            if hull != held[index] {
                stable = false;
                held[index] = inflated(held[index], hull, iteration - PATIENCE).meet(outer[index]);
            }
        }
        if stable {
            break;
        }
    }
    if !stable {
        held.clone_from(outer);
    }
    for _ in 0..NARROWINGS {
        let items = step(&held);
        let narrowed =
            |(index, item): (usize, &Interval)| held[index].meet(first[index].hull(*item));
        let next: Vec<Interval> = items.iter().enumerate().map(narrowed).collect();
        if next == held {
            break;
        }
        held = next;
    }
    held
}

/// What `before` has grown to, and 2^power times its growth more.
fn inflated(before: Interval, grown: Interval, power: i32) -> Interval {
    if power < 0 {
        return grown;
    }
    let more = |growth: f64| libm::ldexp(growth, power);
    Interval::new(
        grown.lo - more(before.lo - grown.lo),
        grown.hi + more(grown.hi - before.hi),
    )
}

/// One step of the tape.
struct Step<'a> {
    /// What intervals alone know.
    outer: &'a Analysis<'a>,
    /// Which of the first steps it is; none for every later one.
    number: Option<usize>,
    /// What intervals alone know of its values.
    limits: &'a [Interval],
}

/// The step as far as it is computed.
struct Known<'a, F> {
    body: &'a [Entry],
    items: Vec<Item>,
    ago: F,
}

impl Step<'_> {
    /// Ranges of all values of the step; bounds before limiting are added to `found`.
    fn run(
        &self,
        ago: impl Fn(u32, u32) -> Interval,
        mut found: Option<&mut Vec<Option<Interval>>>,
    ) -> Vec<Interval> {
        let tape = self.outer.tape;
        let mut known = Known {
            body: self.number.map_or(&tape.steady, |step| tape.body(step)),
            items: Vec::new(),
            ago,
        };
        for (index, entry) in known.body.iter().enumerate() {
            if entry.node == NO_NODE {
                let range = self.truth(&known, entry.op).meet(self.limits[index]);
                let form = Form::default();
                known.items.push(Item { range, form });
                continue;
            }
            let (item, computed) = self.value(&known, index, entry);
            known.items.push(item);
            if let (true, Some(found)) = (entry.op.is_recorded(), &mut found) {
                let found = &mut found[entry.node as usize];
                *found = Some(found.map_or(computed, |found| found.hull(computed)));
            }
        }
        known.items.into_iter().map(|item| item.range).collect()
    }

    fn range(&self, known: &Known<'_, impl Fn(u32, u32) -> Interval>, operand: Ref) -> Interval {
        match operand {
            Ref::Here(index) => known.items[index as usize].range,
            Ref::Before(index) => self.outer.before[index as usize],
            Ref::Ago { steps, index } => (known.ago)(steps, index),
        }
    }

    fn operand(&self, known: &Known<'_, impl Fn(u32, u32) -> Interval>, operand: Ref) -> Item {
        if let Ref::Here(index) = operand {
            return known.items[index as usize].clone();
        }
        let range = self.range(known, operand);
        let form = Form::of(range).named(Symbol::Value(operand));
        Item { range, form }
    }

    fn truth(&self, known: &Known<'_, impl Fn(u32, u32) -> Interval>, op: Op<Ref>) -> Interval {
        let range = interval::truth(op.map(|operand| self.range(known, operand)));
        let Op::Less(a, b) = op else { return range };
        let difference = self
            .operand(known, a)
            .form
            .minus(&self.operand(known, b).form);
        range.meet(interval::truth(Op::Negative(difference.range())))
    }

    /// The value that enters the node, and its bounds before it is rounded and limited.
    fn value(
        &self,
        known: &Known<'_, impl Fn(u32, u32) -> Interval>,
        index: usize,
        entry: &Entry,
    ) -> (Item, Interval) {
        let format = self.outer.formats[entry.node as usize];
        let range = |operand| self.range(known, operand);
        let companion = interval::computed(entry.op, known.body, self.outer.ports, format, range);
        let form = self.form(known, entry.op).filter(Form::is_finite);
        let computed = form
            .as_ref()
            .map_or(companion, |form| companion.meet(form.range()));
        let exact = self.is_exact(known.body, entry.op, format);
        let written = form.and_then(|form| written(form, computed, format, exact));
        let mut range = computed.quantised(format).meet(self.limits[index]);
        // A form that knows much less than the range is worse than none: it would only spread.
        let written = written.filter(|form| {
            let own = form.range();
            let narrow = own.width() <= 2.0 * range.width();
            range = range.meet(own);
            narrow
        });
        let form = written.unwrap_or_else(|| Form::of(range));
        let name = Symbol::Value(Ref::Here(index as u32));
        let form = form.named(name);
        (Item { range, form }, computed)
    }

    /// The operation on forms, exact but for what its function bends; `None` where the range says all.
    fn form(&self, known: &Known<'_, impl Fn(u32, u32) -> Interval>, op: Op<Ref>) -> Option<Form> {
        let item = |operand| self.operand(known, operand);
        Some(match op {
            Op::Input { port, frac } => {
                let (lo, hi) = self.outer.ports[port as usize];
                let real = |raw: i32| libm::ldexp(raw.into(), -frac);
                Form::of(Interval::new(real(lo), real(hi))).named(Symbol::Port(port))
            }
            Op::Add(a, b) => item(a).form.plus(&item(b).form),
            Op::Sub(a, b) => item(a).form.minus(&item(b).form),
            Op::Neg(a) => Form::default().minus(&item(a).form),
            Op::Shift(a, power) => {
                let factor = libm::ldexp(1.0, power);
                item(a).form.scaled(factor, Interval::new(0.0, 0.0))
            }
            Op::Mul(a, b) if a == b => {
                let a = item(a);
                a.form.square(a.range)?
            }
            Op::Mul(a, b) => item(a).form.times(&item(b).form),
            Op::Div(a, b) => {
                let b = item(b);
                if b.range.lo <= 0.0 && b.range.hi >= 0.0 {
                    return None;
                }
                item(a).form.times(&b.form.reciprocal(b.range)?)
            }
            Op::Sqrt(a) => {
                let a = item(a);
                a.form.root(a.range)?
            }
            Op::Abs(a) => {
                let a = item(a);
                a.form.magnitude(a.range)?
            }
            Op::Select(condition, a, b) => return self.selected(known, condition, a, b),
            _ => return None,
        })
    }

    fn selected(
        &self,
        known: &Known<'_, impl Fn(u32, u32) -> Interval>,
        condition: Ref,
        a: Ref,
        b: Ref,
    ) -> Option<Form> {
        let (truth, first, second) = (
            self.range(known, condition),
            self.operand(known, a),
            self.operand(known, b),
        );
        if truth.lo == 1.0 {
            return Some(first.form);
        }
        if truth.hi == 0.0 {
            return Some(second.form);
        }
        // The smaller or the larger of a value and one that is known is a limit.
        let smaller = match interval::deciding(condition, known.body) {
            Some(Op::Less(p, q)) if (p, q) == (a, b) => Some(true),
            Some(Op::Less(p, q)) if (q, p) == (a, b) => Some(false),
            Some(Op::Negative(p)) if p == b && first.range == ZERO => Some(false),
            Some(Op::Negative(p)) if p == a && second.range == ZERO => Some(true),
            _ => None,
        };
        let limits = |at: f64, smaller: bool| {
            if smaller {
                Interval::new(f64::NEG_INFINITY, at)
            } else {
                Interval::new(at, f64::INFINITY)
            }
        };
        for (point, other) in [(&first, &second), (&second, &first)] {
            if let (Some(smaller), true) = (smaller, point.range.width() == 0.0) {
                let limits = limits(point.range.lo, smaller);
                return other.form.limited(other.range, limits);
            }
        }
        Some(first.form.joined(&second.form))
    }

    /// True if the operation's result is a word of `format` as soon as its operands are words.
    fn is_exact(&self, body: &[Entry], op: Op<Ref>, format: Format) -> bool {
        let places = |operand| self.places(body, operand);
        let needed = match op {
            Op::Input { frac, .. } => Some(frac),
            Op::Add(a, b) | Op::Sub(a, b) | Op::Select(_, a, b) => {
                both(places(a), places(b), i32::max)
            }
            Op::Mul(a, b) => both(places(a), places(b), |a, b| a + b),
            Op::Neg(a) | Op::Abs(a) => places(a),
            Op::Shift(a, power) => places(a).map(|places| places - power),
            _ => None,
        };
        needed.is_some_and(|needed| needed <= format.frac.cast_signed())
    }

    /// Fractional bits of an operand's node; `None` where steps differ in it.
    fn places(&self, body: &[Entry], operand: Ref) -> Option<i32> {
        let tape = self.outer.tape;
        let node = match operand {
            Ref::Here(index) => body.get(index as usize)?.node,
            Ref::Before(index) => tape.before.get(index as usize)?.node,
            Ref::Ago { steps, index } => {
                let node = |step: usize| Some(tape.body(step).get(index as usize)?.node);
                let last = self.number.unwrap_or(tape.transient.len() + steps as usize);
                let back = last.saturating_sub(steps as usize);
                // A steady step may look at any step from the last different one on.
                let from = if self.number.is_some() {
                    back
                } else {
                    tape.transient.len().saturating_sub(steps as usize)
                };
                let found = node(back)?;
                if (from..back).any(|step| node(step) != Some(found)) {
                    return None;
                }
                found
            }
        };
        let format = self.outer.formats.get(node as usize)?;
        Some(format.frac.cast_signed())
    }
}

const ZERO: Interval = Interval::new(0.0, 0.0);

fn both(a: Option<i32>, b: Option<i32>, f: impl Fn(i32, i32) -> i32) -> Option<i32> {
    Some(f(a?, b?))
}

/// The form after it is rounded and limited; `computed` bounds it before. `None` if it may wrap.
fn written(form: Form, computed: Interval, format: Format, exact: bool) -> Option<Form> {
    let whole = Interval::whole(format);
    let form = match format.overflow {
        _ if computed.fits(format) => form,
        Overflow::Wrap => return None,
        Overflow::Saturate | Overflow::Trap => {
            let limited = form.limited(computed, whole)?;
            // The last word of a wide format is no f64, and lies below the end that stands for it.
            let last = Interval::of_word(format.max_raw(), format);
            if last.lo == last.hi {
                limited
            } else {
                limited.scaled(1.0, Interval::new(last.lo - last.hi, 0.0))
            }
        }
    };
    if exact {
        return Some(form);
    }
    let lsb = format.lsb();
    // Zero is always among them: the real interpretation does not round.
    let moved = match format.rounding {
        Rounding::Floor => Interval::new(-lsb, 0.0),
        Rounding::Ceil => Interval::new(0.0, lsb),
        Rounding::Zero if computed.lo >= 0.0 => Interval::new(-lsb, 0.0),
        Rounding::Zero if computed.hi <= 0.0 => Interval::new(0.0, lsb),
        Rounding::Zero => Interval::new(-lsb, lsb),
        Rounding::NearestUp | Rounding::NearestAway | Rounding::NearestEven => {
            Interval::new(-lsb / 2.0, lsb / 2.0)
        }
    };
    Some(form.scaled(1.0, moved))
}

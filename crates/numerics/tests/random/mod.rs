//! Random algorithms over the arithmetic: every operation, delay lines, tables, truths, and one operand
//! that may change with the step or with an input.

use cardan_datapath::{Arithmetic, Constant, Format, Node, Overflow, Rounding, Table, Value};
use cardan_numerics::Datapath;

/// Nodes of every random algorithm.
pub(crate) const NODES: usize = 4;
/// Longest delay line.
pub(crate) const LONGEST: usize = 70;

/// Node number `I`.
#[derive(Clone, Copy)]
pub(crate) struct At<const I: usize>;
impl<const I: usize> Node for At<I> {
    const INDEX: usize = I;
    const NAME: &'static str = ["a", "b", "c", "d"][I];
    const UNIT: &'static str = "1";
    const FORMAT: Format = Format::new(16, 10, Rounding::NearestUp, Overflow::Saturate);
    type Word = fixed::FixedI16<fixed::types::extra::U10>;
}

struct Zero;
impl Constant for Zero {
    const VALUE: f64 = 0.0;
}
struct Curve;
impl Table for Curve {
    const VALUES: &'static [f64] = &[0.5, -0.25, 3.0, -1.56, 1.0, 123_456.789];
}

/// A value of some node.
pub(crate) enum Slot<M: Arithmetic> {
    A(Value<M, At<0>>),
    B(Value<M, At<1>>),
    C(Value<M, At<2>>),
    D(Value<M, At<3>>),
}
impl<M: Arithmetic> Clone for Slot<M> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<M: Arithmetic> Copy for Slot<M> {}

macro_rules! of {
    ($slot:expr, $value:ident => $body:expr) => {
        match $slot {
            Slot::A($value) => $body,
            Slot::B($value) => $body,
            Slot::C($value) => $body,
            Slot::D($value) => $body,
        }
    };
}
macro_rules! into {
    ($node:expr, $body:expr) => {
        match $node {
            0 => Slot::A($body),
            1 => Slot::B($body),
            2 => Slot::C($body),
            _ => Slot::D($body),
        }
    };
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    InputCoarse,
    InputFine,
    Parameter(i32),
    Entry(usize),
    Lookup,
    Add,
    Sub,
    Mul,
    Div,
    Sqrt,
    Halve,
    Double,
    Scale(i32),
    Neg,
    Abs,
    Select,
    /// The oldest value of a delay line.
    Delayed(usize),
}

/// An operation on earlier values and truths of the step, by number.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Instruction {
    pub(crate) kind: Kind,
    pub(crate) node: usize,
    pub(crate) operands: [usize; 2],
    pub(crate) truth: usize,
}

/// When an operand is another one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum When {
    Never,
    From(usize),
    Every(usize),
    Above(i32),
}

#[derive(Clone, Debug)]
pub(crate) struct Program {
    pub(crate) instructions: Vec<Instruction>,
    /// Length of each delay line, and the value that enters it.
    pub(crate) delays: Vec<(usize, usize)>,
    pub(crate) when: When,
    /// The instruction whose first operand changes, and to which value.
    pub(crate) changed: (usize, usize),
}

pub(crate) struct State<M: Arithmetic> {
    step: usize,
    lines: Vec<Vec<Slot<M>>>,
    sign: M::Bool,
}

impl Program {
    fn is_changed(&self, step: usize, input: i32) -> bool {
        match self.when {
            When::Never => false,
            When::From(first) => step >= first,
            When::Every(period) => step % period == period - 1,
            When::Above(limit) => input > limit,
        }
    }

    fn computed<M: Arithmetic, N: Node>(
        m: &M,
        instruction: Instruction,
        (values, truths): (&[Slot<M>], &[M::Bool]),
        operands: [usize; 2],
        inputs: &[i32],
    ) -> Value<M, N> {
        let [a, b] = operands.map(|at| values.get(at).copied());
        let (Some(a), Some(b)) = (a, b) else {
            return m.input::<N, 15>(inputs[0]);
        };
        match instruction.kind {
            Kind::InputCoarse => m.input::<N, 0>(inputs[1]),
            Kind::InputFine | Kind::Delayed(_) => m.input::<N, 15>(inputs[0]),
            Kind::Parameter(raw) => m.parameter::<N, 8>(raw),
            Kind::Entry(at) => m.entry::<N, Curve>(at),
            Kind::Lookup => of!(a, a => m.lookup::<N, _, Curve>(a)),
            Kind::Add => of!(a, a => of!(b, b => m.add(a, b))),
            Kind::Sub => of!(a, a => of!(b, b => m.sub(a, b))),
            Kind::Mul => of!(a, a => of!(b, b => m.mul(a, b))),
            Kind::Div => of!(a, a => of!(b, b => m.div(a, b))),
            Kind::Sqrt => of!(a, a => m.sqrt(a)),
            Kind::Halve => of!(a, a => m.shift::<N, _, -1>(a)),
            Kind::Double => of!(a, a => m.shift::<N, _, 3>(a)),
            Kind::Scale(power) => of!(a, a => m.scale::<N, _, -6, 6>(a, power)),
            Kind::Neg => of!(a, a => m.neg(a)),
            Kind::Abs => of!(a, a => m.abs(a)),
            Kind::Select => {
                let truth = truths[instruction.truth % truths.len()];
                of!(a, a => of!(b, b => m.select(truth, a, b)))
            }
        }
    }
}

impl Datapath for Program {
    type State<M: Arithmetic> = State<M>;

    fn start<M: Arithmetic>(&self, m: &M) -> State<M> {
        let line = |&(length, from): &(usize, usize)| {
            let zero = into!(self.instructions[from].node, m.constant::<_, Zero>());
            vec![zero; length]
        };
        State {
            step: 0,
            lines: self.delays.iter().map(line).collect(),
            sign: m.truth(false),
        }
    }

    fn step<M: Arithmetic>(&self, m: &M, state: &mut State<M>, inputs: &[i32]) {
        let mut values: Vec<Slot<M>> = Vec::new();
        let mut truths = vec![state.sign, m.truth(inputs[1] & 1 == 1)];
        let is_changed = self.is_changed(state.step, inputs[0]);
        for (at, &instruction) in self.instructions.iter().enumerate() {
            let mut operands = instruction.operands;
            if is_changed && at == self.changed.0 {
                operands[0] = self.changed.1;
            }
            let value = match instruction.kind {
                Kind::Delayed(line) => state.lines[line][state.step % state.lines[line].len()],
                _ => {
                    let known = (&values[..], &truths[..]);
                    into!(
                        instruction.node,
                        Self::computed(m, instruction, known, operands, inputs)
                    )
                }
            };
            let below = of!(value, value => m.negative(value));
            let before = values.last().copied().unwrap_or(value);
            let less = of!(value, a => of!(before, b => m.less(a, b)));
            let last = truths[instruction.truth % truths.len()];
            truths.push(match instruction.truth % 4 {
                0 => below,
                1 => m.or(less, last),
                2 => m.xor(m.not(less), last),
                _ => m.either(below, less, last),
            });
            values.push(value);
        }
        let last = truths[truths.len() - 1];
        m.raise(1, last);
        state.sign = m.xor(state.sign, last);
        for (line, &(length, from)) in state.lines.iter_mut().zip(&self.delays) {
            line[state.step % length] = values[from];
        }
        state.step += 1;
    }
}

/// A reproducible stream of numbers.
pub(crate) struct Draw(pub(crate) u64);

impl Draw {
    pub(crate) fn next(&mut self) -> u32 {
        // SplitMix64.
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z >> 32) as u32
    }

    pub(crate) fn below(&mut self, limit: usize) -> usize {
        self.next() as usize % limit
    }

    fn kind(&mut self) -> Kind {
        match self.below(18) {
            0 => Kind::InputCoarse,
            1 | 2 => Kind::InputFine,
            3 => Kind::Parameter(self.next().cast_signed() >> (1 + self.below(30))),
            4 => Kind::Entry(self.below(6)),
            5 => Kind::Lookup,
            6 | 7 => Kind::Add,
            8 => Kind::Sub,
            9 | 10 => Kind::Mul,
            11 => Kind::Div,
            12 => Kind::Sqrt,
            13 => Kind::Halve,
            14 => [Kind::Double, Kind::Scale(-3), Kind::Scale(5)][self.below(3)],
            15 => Kind::Neg,
            16 => Kind::Abs,
            _ => Kind::Select,
        }
    }

    pub(crate) fn program(&mut self) -> Program {
        let count = 3 + self.below(10);
        let mut delays = Vec::new();
        let mut instructions = Vec::new();
        for at in 0..count {
            let operands = [self.below(at.max(1)), self.below(at.max(1))];
            let (node, truth) = (self.below(NODES), self.below(16));
            let kind = if at == 0 {
                Kind::InputFine
            } else {
                self.kind()
            };
            instructions.push(Instruction {
                kind,
                node,
                operands,
                truth,
            });
        }
        for _ in 0..self.below(3) {
            let length = [1, 2, 15, 16, 17, 33, 64, 1 + self.below(LONGEST)][self.below(8)];
            let from = self.below(count);
            // Some instruction reads it; the line holds the node of what enters it.
            let reader = 1 + self.below(count - 1);
            instructions[reader].kind = Kind::Delayed(delays.len());
            delays.push((length, from));
        }
        // A delayed value has the node of what enters its line, which is no delayed one itself.
        for (_, from) in &mut delays {
            if matches!(instructions[*from].kind, Kind::Delayed(_)) {
                *from = 0;
            }
        }
        for at in 0..count {
            if let Kind::Delayed(line) = instructions[at].kind {
                instructions[at].node = instructions[delays[line].1].node;
            }
        }
        let when = match self.below(6) {
            0 => When::From(1 + self.below(60)),
            1 => When::Every(2 + self.below(40)),
            2 => When::Above(self.next().cast_signed() >> 17),
            _ => When::Never,
        };
        let changed = 1 + self.below(count - 1);
        Program {
            changed: (changed, self.below(changed)),
            instructions,
            delays,
            when,
        }
    }

    pub(crate) fn format(&mut self) -> Format {
        let word = match self.below(4) {
            0 => 1 + self.below(64),
            1 => 50 + self.below(15),
            _ => 4 + self.below(24),
        } as u32;
        let frac = self.below(1 + (word as usize + 4).min(64)) as u32;
        let rounding = Rounding::ALL[self.below(6)].0;
        Format::new(word, frac, rounding, Overflow::ALL[self.below(3)].0)
    }

    /// Steps within the bounds of both ports, often at their ends.
    pub(crate) fn steps(&mut self, count: usize, ports: [(i32, i32); 2]) -> Vec<[i32; 2]> {
        let mut raw = |(lo, hi): (i32, i32)| match self.below(4) {
            0 => lo,
            1 => hi,
            _ => {
                let span = (i64::from(hi) - i64::from(lo) + 1) as u64;
                (i64::from(lo) + (u64::from(self.next()) % span) as i64) as i32
            }
        };
        (0..count).map(|_| ports.map(&mut raw)).collect()
    }

    pub(crate) fn port(&mut self) -> (i32, i32) {
        let shift = self.below(31);
        let ends = [self.next(), self.next()].map(|raw| raw.cast_signed() >> shift);
        (ends[0].min(ends[1]), ends[0].max(ends[1]))
    }
}

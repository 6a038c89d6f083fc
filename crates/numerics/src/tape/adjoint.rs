//! How strongly a node's result feels a small change of each write: derivatives along the tape,
//! backwards (reverse-mode differentiation), through feedback and delays.

use cardan_datapath::Format;

use super::{Inputs, NO_NODE, Op, Real, Ref, Runner, Tape};

/// Every real value of a run, step by step, and the status of each step.
#[derive(Clone, Debug, Default)]
pub struct Reals {
    /// What stands before the first step.
    pub before: Vec<f64>,
    /// Per step, the values in the order of its operations.
    pub steps: Vec<Vec<f64>>,
    /// Status bits per step.
    pub status: Vec<u16>,
}

impl Reals {
    /// Runs `tape` on real numbers; nodes that wrap are reduced to the range of `formats`.
    #[must_use]
    pub fn run(tape: &Tape, inputs: &Inputs, formats: &[Format], domain_flag: u16) -> Self {
        let mut real = Real::new(formats, domain_flag);
        let mut runner = Runner::new(tape, &mut real);
        let before = runner.before().to_vec();
        let mut reals = Self {
            before,
            ..Self::default()
        };
        for step in 0..inputs.steps {
            reals
                .steps
                .push(runner.step(&mut real, inputs, step).to_vec());
            reals.status.push(std::mem::take(&mut real.status));
        }
        reals
    }

    fn value(&self, step: usize, operand: Ref) -> f64 {
        match operand {
            Ref::Before(index) => self.before[index as usize],
            Ref::Here(index) => self.steps[step][index as usize],
            Ref::Ago { steps, index } => self.steps[step - steps as usize][index as usize],
        }
    }
}

/// Derivatives of the weighted sum of the results of steady operation `target` (the weight of step t
/// is `weights[t]`) to every write; `visit(step, index, derivative)` is called for each steady write
/// that matters, last step first. With weights of random sign, the mean square of a derivative is
/// the power gain from that write to the target, feedback included.
pub fn gains(
    tape: &Tape,
    reals: &Reals,
    target: usize,
    weights: &[f64],
    mut visit: impl FnMut(usize, usize, f64),
) {
    let first = tape.transient.len();
    let memory = tape.memory();
    let width = tape.steady.len();
    // Derivatives of this step and of those that it looks back at.
    let mut ring = vec![vec![0.0; width]; memory + 1];
    for step in (first..reals.steps.len()).rev() {
        let here = step % (memory + 1);
        ring[here][target] += weights[step];
        for index in (0..width).rev() {
            let derivative = ring[here][index];
            let entry = &tape.steady[index];
            if derivative == 0.0 || entry.node == NO_NODE {
                continue;
            }
            if entry.op.is_recorded() {
                visit(step, index, derivative);
            }
            let result = reals.steps[step][index];
            let value = |operand: Ref| reals.value(step, operand);
            partials(entry.op, value, result, |operand, partial| {
                let change = derivative * partial;
                match operand {
                    Ref::Here(index) => ring[here][index as usize] += change,
                    Ref::Ago { steps, index } if step - steps as usize >= first => {
                        let there = (step - steps as usize) % (memory + 1);
                        ring[there][index as usize] += change;
                    }
                    Ref::Ago { .. } | Ref::Before(_) => {}
                }
            });
        }
        ring[here].fill(0.0);
    }
}

/// The derivative of an operation to each of its operands.
fn partials(op: Op<Ref>, value: impl Fn(Ref) -> f64, result: f64, mut add: impl FnMut(Ref, f64)) {
    match op {
        Op::Add(a, b) => {
            add(a, 1.0);
            add(b, 1.0);
        }
        Op::Sub(a, b) => {
            add(a, 1.0);
            add(b, -1.0);
        }
        Op::Mul(a, b) => {
            add(a, value(b));
            add(b, value(a));
        }
        Op::Div(a, b) => {
            let divisor = value(b);
            if divisor != 0.0 {
                add(a, 1.0 / divisor);
                add(b, -value(a) / (divisor * divisor));
            }
        }
        Op::Sqrt(a) if result > 0.0 => add(a, 0.5 / result),
        Op::Shift(a, power) => add(a, libm::ldexp(1.0, power)),
        Op::Neg(a) => add(a, -1.0),
        Op::Abs(a) => add(a, if value(a) < 0.0 { -1.0 } else { 1.0 }),
        Op::Select(condition, a, b) => add(if value(condition) != 0.0 { a } else { b }, 1.0),
        // Tables are flat between their steps; constants and inputs have no operands.
        _ => {}
    }
}

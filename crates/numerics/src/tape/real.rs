//! A tape on real numbers, as [`crate::Mixed`] computes with every node real.

use cardan_datapath::{Format, Overflow};

use super::{Domain, Op};
use crate::mixed::{finite, wrapped};

/// The real interpretation. Truths are 0 and 1.
pub struct Real<'a> {
    formats: &'a [Format],
    domain_flag: u16,
    /// Status bits raised since they were last taken.
    pub status: u16,
}

impl<'a> Real<'a> {
    /// `formats` are the deployed ones: nodes that wrap are reduced to their range.
    #[must_use]
    pub fn new(formats: &'a [Format], domain_flag: u16) -> Self {
        Self {
            formats,
            domain_flag,
            status: 0,
        }
    }

    fn write(&self, node: usize, value: f64) -> f64 {
        let format = self.formats[node];
        let limited = finite(value);
        match format.overflow {
            Overflow::Wrap => wrapped(limited, format),
            Overflow::Saturate | Overflow::Trap => limited,
        }
    }
}

impl Domain for Real<'_> {
    type Item = f64;

    fn input(&mut self, node: usize, _port: usize, raw: i32, frac: i32) -> f64 {
        self.write(node, libm::ldexp(raw.into(), -frac))
    }

    fn external(&mut self, _port: usize, value: bool) -> f64 {
        f64::from(u8::from(value))
    }

    fn apply(&mut self, node: usize, op: Op<&f64>) -> f64 {
        let holds = |a: &f64| *a != 0.0;
        let truth = |value: bool| f64::from(u8::from(value));
        let value = match op {
            Op::Parameter { raw, frac } => libm::ldexp(raw.into(), -frac),
            Op::Constant(value) => return value,
            Op::Lookup(index, table) => {
                return table[index.floor().clamp(0.0, (table.len() - 1) as f64) as usize];
            }
            Op::Add(a, b) => a + b,
            Op::Sub(a, b) => a - b,
            Op::Mul(a, b) => a * b,
            Op::Div(a, b) if *b == 0.0 => {
                self.status |= self.domain_flag;
                let format = self.formats[node];
                return format.real(if *a < 0.0 {
                    format.min_raw()
                } else {
                    format.max_raw()
                });
            }
            Op::Div(a, b) => a / b,
            Op::Sqrt(a) => {
                if *a < 0.0 {
                    self.status |= self.domain_flag;
                }
                if *a < 0.0 { 0.0 } else { a.sqrt() }
            }
            Op::Shift(a, power) => libm::ldexp(*a, power),
            Op::Neg(a) => -a,
            Op::Abs(a) => a.abs(),
            Op::Select(c, a, b) => {
                if holds(c) {
                    *a
                } else {
                    *b
                }
            }
            Op::Less(a, b) => return truth(a < b),
            Op::Negative(a) => return truth(*a < 0.0),
            Op::Known(value) => return truth(value),
            Op::Not(a) => return truth(!holds(a)),
            Op::Or(a, b) => return truth(holds(a) || holds(b)),
            Op::Xor(a, b) => return truth(holds(a) != holds(b)),
            Op::Either(c, a, b) => return if holds(c) { *a } else { *b },
            Op::Raise(flags, a) => {
                if holds(a) {
                    self.status |= flags;
                }
                return *a;
            }
            Op::Input { .. } | Op::External { .. } => 0.0,
        };
        self.write(node, value)
    }
}

//! The sources of error of a step, and what a write adds to them.

use cardan_datapath::{Format, Overflow};

use super::Uncertain;
use super::span::Span;
use crate::exact;
use crate::mixed::{finite, wrapped};
use crate::tape::noise::rounding_noise;

/// Standard deviations by which a value may jump that a doubtful selection picks, so that both
/// choices lie well within the limits that are set on errors.
pub(super) const JUMP: f64 = 3.0;

/// The error-propagating interpretation.
pub(super) struct Propagation {
    pub(super) formats: Vec<Format>,
    pub(super) domain_flag: u16,
    /// Sources of this step so far; the first are what earlier steps left.
    pub(super) sources: usize,
    /// Operations so far.
    pub(super) operations: u64,
    /// Status bits of the step: on real numbers, for certain in fixed point, and at most there.
    pub(super) status: u16,
    pub(super) certain: u16,
    pub(super) possible: u16,
}

impl Propagation {
    /// Adds an independent error to a spread.
    pub(super) fn add_source(&mut self, spread: &mut Vec<f64>, deviation: f64) {
        if deviation > 0.0 {
            spread.resize(self.sources, 0.0);
            spread.push(deviation);
            self.sources += 1;
        }
    }

    pub(super) fn raise(&mut self, flags: u16, holds: bool, doubtful: bool) {
        if holds {
            self.status |= flags;
        }
        if holds && !doubtful {
            self.certain |= flags;
        }
        if holds || doubtful {
            self.possible |= flags;
        }
    }

    /// A real result with its operands' errors enters `node`, from `natural` fractional bits.
    pub(super) fn enter(&mut self, node: usize, mut item: Uncertain, natural: i64) -> Uncertain {
        let format = self.formats[node];
        let is_exact = item.spread.is_empty() && item.bias == 0.0 && !item.unbounded;
        let dropped = natural.saturating_sub(format.frac.into());
        // What rounding makes of a value without error is known: nothing, where it ends before the word does.
        let known = (is_exact && dropped > 0).then(|| {
            let (word, _) = exact::quantise(item.value, format);
            format.real(word) - item.value
        });
        let (variance, mean) = match known {
            Some(error) if error.abs() <= format.lsb() => (0.0, error),
            _ => rounding_noise(format, dropped),
        };
        let mut spread = std::mem::take(&mut item.spread);
        self.add_source(&mut spread, variance.sqrt());
        item.bias += mean;
        item.spread = spread;
        let range = Span::of(format.real(format.min_raw()), format.real(format.max_raw()));
        item.span = match format.overflow {
            Overflow::Wrap => range,
            Overflow::Saturate | Overflow::Trap => Span::of(
                item.span.lo.clamp(range.lo, range.hi),
                item.span.hi.clamp(range.lo, range.hi),
            )
            .within(range, format.lsb()),
        };
        self.limit(format, &mut item);
        if format.overflow != Overflow::Wrap {
            let (native, reach) = (item.value + item.bias, item.reach());
            item.span = Span::of(native - reach, native + reach).within(item.span, format.lsb());
        }
        item.frac = format.frac.into();
        item
    }

    /// What the range of the word does to a value and its error.
    pub(super) fn limit(&mut self, format: Format, item: &mut Uncertain) {
        item.value = finite(item.value);
        if format.overflow == Overflow::Wrap {
            item.value = wrapped(item.value, format);
        }
        let (least, most) = (format.real(format.min_raw()), format.real(format.max_raw()));
        if item.unbounded {
            // A word is never farther away than its span is wide.
            item.unbounded = false;
            let mut spread = Vec::new();
            let far = (item.span.hi - item.value)
                .abs()
                .max((item.value - item.span.lo).abs());
            self.add_source(&mut spread, far.min(most - least) / JUMP);
            item.spread = spread;
            return;
        }
        if format.overflow == Overflow::Wrap {
            return;
        }
        let native = item.value + item.bias;
        let reach = item.reach();
        if native - reach > most || native + reach < least {
            // Certainly limited. The place by which a range ends early is what the format explains; a
            // value that is farther out does not fit, and that is no rounding.
            let end = if native > most { most } else { least };
            item.bias = (end - item.value).clamp(-format.lsb(), format.lsb());
            item.spread.clear();
        } else if native > most || native < least {
            let limited = native.clamp(least, most) - item.value;
            item.bias = limited.clamp(
                item.bias.min(0.0) - format.lsb(),
                item.bias.max(0.0) + format.lsb(),
            );
        }
    }

    /// A value that is known before the run: its error is known too. More than a place is no rounding:
    /// the value does not fit.
    pub(super) fn known(&self, node: usize, value: f64, word: i64) -> Uncertain {
        let format = self.formats[node];
        let error = format.real(word) - value;
        Uncertain {
            value,
            bias: error.clamp(-format.lsb(), format.lsb()),
            span: Span::of(format.real(word), format.real(word)),
            frac: format.frac.into(),
            ..Uncertain::default()
        }
    }

    /// A setting or an input: raw over 2^frac.
    pub(super) fn given(&self, node: usize, raw: i32, frac: i32) -> Uncertain {
        let format = self.formats[node];
        let value = libm::ldexp(raw.into(), -frac);
        let (word, _) = exact::fit(raw.into(), frac, format);
        let value = match format.overflow {
            Overflow::Wrap => wrapped(value, format),
            Overflow::Saturate | Overflow::Trap => value,
        };
        self.known(node, value, word)
    }

    pub(super) fn truth(holds: bool, doubtful: bool) -> Uncertain {
        Uncertain {
            value: f64::from(u8::from(holds)),
            doubtful,
            ..Uncertain::default()
        }
    }
}

//! Magnitudes by bit weight against a word: which bits of a format values use.

use maud::{Markup, html};

/// Magnitudes in 2^exponent up to twice that.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bin {
    /// The exponent.
    pub exponent: i32,
    /// Values.
    pub count: u64,
}

/// Bins below the last place that are shown at most.
const BELOW: i32 = 8;

/// Bars over the weights of bits, heaviest at the left as in a word, with an axis that names the weights.
/// The word's own bits are shaded: 2^(`top` - 1) to 2^`bottom`.
#[must_use]
pub fn histogram(name: &str, caption: &str, bins: &[Bin], top: i32, bottom: i32) -> Markup {
    let most = bins.iter().map(|bin| bin.count).max().unwrap_or(0);
    if most == 0 {
        return html! {};
    }
    let first = bins
        .iter()
        .map(|bin| bin.exponent)
        .max()
        .unwrap_or(0)
        .max(top - 1);
    let least = bins.iter().map(|bin| bin.exponent).min().unwrap_or(0);
    let last = least.min(bottom).max(bottom - BELOW);
    let columns = (first - last + 1).max(1);
    let place = |exponent: i32| 100.0 * f64::from(first - exponent) / f64::from(columns);
    let width = 100.0 / f64::from(columns);
    let class = |exponent: i32| {
        if exponent >= top {
            "out"
        } else if exponent < bottom - 1 {
            "low"
        } else {
            "in"
        }
    };
    html! {
        figure.small {
            figcaption { strong { (name) } span.muted { " " (caption) } }
            div.bits role="img" aria-label=(format!("magnitudes of {name} by bit weight")) {
                div.word style=(format!(
                    "left:{:.2}%;width:{:.2}%", place(top - 1), width * f64::from((top - bottom).max(0))
                )) {}
                @for bin in bins.iter().filter(|bin| bin.exponent >= last) {
                    b class=(class(bin.exponent)) title=(format!("2^{}: {} values", bin.exponent, bin.count))
                        style=(format!(
                            "left:{:.2}%;width:{:.2}%;height:{:.1}%",
                            place(bin.exponent), 0.8 * width,
                            100.0 * (bin.count as f64 / most as f64).sqrt()
                        )) {}
                }
            }
            div.bit-axis aria-hidden="true" {
                @for exponent in marks(first, last) {
                    span style=(format!("left:{:.2}%", place(exponent) + 0.4 * width)) {
                        "2" sup { (exponent) }
                    }
                }
            }
        }
    }
}

/// Weights that are named: every fourth at least.
fn marks(first: i32, last: i32) -> impl Iterator<Item = i32> {
    let step = if first - last > 24 { 8 } else { 4 };
    (last..=first)
        .rev()
        .filter(move |exponent| exponent.rem_euclid(step) == 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_in_the_word_beyond_it_and_below_it_are_told_apart_over_an_axis() {
        let bin = |exponent, count| Bin { exponent, count };
        let bins = [bin(1, 3), bin(0, 40), bin(-3, 100), bin(-9, 7)];
        let text = histogram("x", "2.6", &bins, 1, -6).into_string();
        assert_eq!(text.matches("class=\"out\"").count(), 1);
        assert_eq!(text.matches("class=\"in\"").count(), 2);
        assert_eq!(text.matches("class=\"low\"").count(), 1);
        assert!(
            text.contains("<sup>0</sup>") && text.contains("<sup>-8</sup>"),
            "{text}"
        );
        assert!(histogram("x", "", &[], 1, -6).into_string().is_empty());
    }
}

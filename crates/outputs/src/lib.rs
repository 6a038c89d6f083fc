//! What a product gives, as data: quantities, status bits, the messages that carry both, and the stages of
//! the chain that leads to them.
//!
//! A product lists its [`Outputs`] once. Whoever compares, tunes or shows them needs no knowledge of
//! the product: a quantity names the node that holds its reference, a status bit its mask, and a
//! decoded [`Message`] is the values in the order of that list. A [`Group`] is the quantities whose error
//! is followed from [`Stage`] to stage: neighbouring stages are the parts of the error budget.

mod chain;

use serde::Serialize;

pub use chain::{Combined, Group, Is, Member, Shown, Stage};

/// A value that the product sends.
#[derive(Clone, Debug, PartialEq)]
pub struct Quantity {
    /// Name in reports.
    pub name: String,
    /// The node that holds it.
    pub node: String,
    /// Which of the node's writes in a solution it is, from 0.
    pub write: usize,
    /// Unit of the node.
    pub unit: String,
    /// What is the same value again, in that unit (2 half turns); none for a plain number.
    pub period: Option<f64>,
    /// One step of the message's format, in that unit.
    pub step: f64,
    /// Whether it is meaningful in a solution with status bits too.
    pub in_flagged: bool,
}

/// A status bit that the product sends.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StatusBit {
    /// Name in reports.
    pub name: String,
    /// Its bit in the status word.
    pub mask: u32,
}

/// All that a product sends of one solution.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outputs {
    /// In the order of the message.
    pub quantities: Vec<Quantity>,
    /// Lowest bit first.
    pub status: Vec<StatusBit>,
    /// The number of a message is counted modulo this.
    pub sequence_modulus: u64,
    /// The quantities whose error is followed along the chain; none if nothing is.
    pub group: Option<Group>,
}

/// A decoded message.
#[derive(Clone, Debug, PartialEq)]
pub struct Message {
    /// Number of the solution, modulo [`Outputs::sequence_modulus`].
    pub sequence: u64,
    /// In the order of [`Outputs::quantities`].
    pub values: Vec<f64>,
    /// Status word.
    pub status: u32,
}

/// The status of a solution as a reference computes it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Status {
    /// Bits that are set.
    pub set: u32,
    /// Bits on whose threshold the solution lies, so that rounding decides.
    pub doubtful: u32,
}

/// A figure with its limits.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Check {
    /// Which part of the chain is checked.
    pub party: String,
    /// What is measured.
    pub what: String,
    /// Its value; not a number fails.
    pub value: f64,
    /// Smallest permitted value.
    pub least: f64,
    /// Largest permitted value.
    pub most: f64,
    /// Unit of all three.
    pub unit: String,
    /// Why these limits.
    pub reason: String,
}

impl Check {
    /// The party of checks on the controller itself: what they find causes whatever else is late.
    pub const CONTROLLER: &'static str = "controller";

    /// Whether the value lies within the limits; what is not a number does not.
    #[must_use]
    pub fn is_met(&self) -> bool {
        self.least <= self.value && self.value <= self.most
    }
}

impl Quantity {
    /// value - reference, the short way round where there is a period.
    #[must_use]
    pub fn difference(&self, value: f64, reference: f64) -> f64 {
        chain::short_way(value - reference, self.period)
    }
}

impl Outputs {
    /// Names of the bits of a status word, lowest first.
    #[must_use]
    pub fn names(&self, status: u32) -> Vec<&str> {
        let set = self.status.iter().filter(|bit| status & bit.mask != 0);
        set.map(|bit| bit.name.as_str()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quantity(period: Option<f64>) -> Quantity {
        Quantity {
            name: "yaw".into(),
            node: "yaw".into(),
            write: 0,
            unit: "half_turn".into(),
            period,
            step: 1.0 / 32768.0,
            in_flagged: false,
        }
    }

    #[test]
    fn differences_take_the_short_way_round_a_period_and_no_other() {
        let near = |value: f64, expected: f64| assert!((value - expected).abs() < 1e-12);
        near(quantity(Some(2.0)).difference(0.9, -0.9), -0.2);
        near(quantity(Some(2.0)).difference(-0.9, 0.9), 0.2);
        near(quantity(None).difference(0.9, -0.9), 1.8);
        assert!(quantity(Some(2.0)).difference(f64::NAN, 0.0).is_nan());
    }

    #[test]
    fn a_status_word_is_told_by_its_names() {
        let bit = |name: &str, mask| StatusBit {
            name: name.into(),
            mask,
        };
        let outputs = Outputs {
            status: vec![bit("low", 1), bit("high", 0x8000_0000)],
            ..Outputs::default()
        };
        assert_eq!(outputs.names(0x8000_0001), ["low", "high"]);
        assert_eq!(outputs.names(2), [""; 0]);
    }
}

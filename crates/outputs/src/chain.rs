//! The chain from the truth to what the device gives, and the quantities that are followed along it.

use std::borrow::Cow;

/// A unit as figures are shown in it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Shown {
    /// What keys of the document end in, without the underscore (`deg`); may be empty.
    pub suffix: Cow<'static, str>,
    /// Behind a figure, with its space where one belongs there (`°`, ` g`).
    pub symbol: Cow<'static, str>,
    /// In sentences (`degrees`).
    pub words: Cow<'static, str>,
}

/// A quantity of a group.
#[derive(Clone, Debug, PartialEq)]
pub struct Member {
    /// Name in reports.
    pub name: String,
    /// The node that holds it, once per solution.
    pub node: String,
    /// The shown unit's number per unit of the values (180 degrees per half turn).
    pub scale: f64,
    /// What is the same value again, in the values' unit (2 half turns); none for a plain number.
    pub period: Option<f64>,
}

/// An error made of all members of a group, in the shown unit: of values against references, both in the
/// members' order.
#[derive(Clone, Debug)]
pub struct Combined {
    /// Name in reports.
    pub name: String,
    /// What it is, in a word (`rotation`).
    pub what: String,
    /// Its size; not negative.
    pub error: fn(values: &[f64], references: &[f64]) -> f64,
}

/// Equal by name: functions cannot be compared.
impl PartialEq for Combined {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name && self.what == other.what
    }
}

/// Quantities of one unit whose error is followed along the chain.
#[derive(Clone, Debug, PartialEq)]
pub struct Group {
    /// Its key in the document.
    pub key: String,
    /// Its name on pages.
    pub title: String,
    /// What a reader should know of it, in a sentence.
    pub note: String,
    /// What one of them is, in a word (`angle`).
    pub member: String,
    /// The unit of all figures.
    pub unit: Shown,
    /// In the order of the stages' values.
    pub members: Vec<Member>,
    /// The error of all together; where there is none, that of a single member stands for the whole.
    pub combined: Option<Combined>,
}

/// What the values of a stage are, as far as a comparison must know.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Is {
    /// The truth.
    Truth,
    /// The reference on inputs that are better than the device's own.
    Model,
    /// The reference on the device's own inputs.
    Golden,
    /// The firmware's algorithm on real numbers.
    Real,
    /// The firmware on the host.
    Native,
    /// The firmware on the chip.
    Emulated,
}

/// A stage of the chain, from the truth to the device. The step from the stage before to this one is a part
/// of the error budget.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stage {
    /// What it is.
    pub is: Is,
    /// Its name in messages (`golden on codes`).
    pub name: Cow<'static, str>,
    /// The part that ends here, as a key of the document; empty at the first stage.
    pub part: Cow<'static, str>,
    /// The same as a title.
    pub title: Cow<'static, str>,
    /// What the part is, in a few words.
    pub remark: Cow<'static, str>,
}

impl Stage {
    /// A stage known at compile time.
    #[must_use]
    pub const fn new(
        is: Is,
        name: &'static str,
        part: &'static str,
        title: &'static str,
        remark: &'static str,
    ) -> Self {
        Self {
            is,
            name: Cow::Borrowed(name),
            part: Cow::Borrowed(part),
            title: Cow::Borrowed(title),
            remark: Cow::Borrowed(remark),
        }
    }
}

impl Member {
    /// value - reference in the shown unit, the short way round where there is a period.
    #[must_use]
    pub fn difference(&self, value: f64, reference: f64) -> f64 {
        self.scale * short_way(value - reference, self.period)
    }
}

/// A difference, the short way round a period.
pub(crate) fn short_way(plain: f64, period: Option<f64>) -> f64 {
    match period {
        Some(period) if plain.is_finite() && plain.abs() >= period / 2.0 => {
            plain - period * (plain / period).round()
        }
        _ => plain,
    }
}

impl Group {
    /// The size of the error of the whole group: the combined one, or that of its only member.
    #[must_use]
    pub fn size(&self, values: &[f64], references: &[f64]) -> Option<f64> {
        match (&self.combined, self.members.as_slice()) {
            (Some(combined), _) => Some((combined.error)(values, references)),
            (None, [only]) => Some(only.difference(values[0], references[0]).abs()),
            (None, _) => None,
        }
    }

    /// What the error of the whole group is called.
    #[must_use]
    pub fn whole(&self) -> Option<&str> {
        match (&self.combined, self.members.as_slice()) {
            (Some(combined), _) => Some(&combined.name),
            (None, [only]) => Some(&only.name),
            (None, _) => None,
        }
    }
}

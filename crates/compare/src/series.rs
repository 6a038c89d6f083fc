//! What each stage of the chain gives, solution by solution.

use cardan_outputs::{Is, Stage};

/// The values of a stage: as many per solution as its group has members, in their order. A solution that the
/// stage does not know holds values that are not numbers; an empty series is one that the run does not have.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series {
    width: usize,
    values: Vec<f64>,
}

impl Series {
    /// A series without solutions, of `width` values each.
    #[must_use]
    pub fn new(width: usize) -> Self {
        Self {
            width,
            values: Vec::new(),
        }
    }

    /// Solutions.
    #[must_use]
    pub fn len(&self) -> usize {
        self.values.len().checked_div(self.width).unwrap_or(0)
    }

    /// Whether there is no solution.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// Adds a solution; `None` is one that the stage does not know.
    pub fn push(&mut self, values: Option<&[f64]>) {
        match values {
            Some(values) => self.values.extend_from_slice(values),
            None => (self.values).extend(std::iter::repeat_n(f64::NAN, self.width)),
        }
    }

    /// The values of a solution, where all of them are known.
    #[must_use]
    pub fn at(&self, solution: usize) -> Option<&[f64]> {
        let start = solution * self.width;
        let values = self.values.get(start..start + self.width)?;
        (self.width > 0 && values.iter().all(|value| value.is_finite())).then_some(values)
    }

    /// Takes the first solutions off, as a series of their own.
    #[must_use]
    pub fn take(&mut self, solutions: usize) -> Self {
        let count = solutions.saturating_mul(self.width).min(self.values.len());
        Self {
            width: self.width,
            values: self.values.drain(..count).collect(),
        }
    }

    /// From one solution's values after another, `None` where they are not known.
    #[must_use]
    pub fn of<T: AsRef<[f64]>>(
        width: usize,
        solutions: impl IntoIterator<Item = Option<T>>,
    ) -> Self {
        let mut series = Self::new(width);
        for solution in solutions {
            series.push(solution.as_ref().map(AsRef::as_ref));
        }
        series
    }
}

/// A stage with its values.
#[derive(Clone, Debug, PartialEq)]
pub struct StageValues {
    /// Which stage.
    pub stage: Stage,
    /// Its values; empty if the run has none.
    pub values: Series,
}

/// The values with the rounding of this node and of all steps before it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RoundingStep {
    /// The node whose rounding this step adds.
    pub node: String,
    /// The values.
    pub values: Series,
}

/// The group's values at each stage.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chain {
    /// From the truth to the device.
    pub stages: Vec<StageValues>,
    /// Between the real interpretation and the native firmware: each step adds the rounding of one more node,
    /// in signal order. May be empty.
    pub steps: Vec<RoundingStep>,
}

impl Chain {
    /// The chain of these stages, without values.
    #[must_use]
    pub fn new(stages: &[Stage], width: usize) -> Self {
        let stages = stages.iter().map(|stage| StageValues {
            stage: stage.clone(),
            values: Series::new(width),
        });
        Self {
            stages: stages.collect(),
            steps: Vec::new(),
        }
    }

    /// The place of the first stage that is this.
    #[must_use]
    pub fn place(&self, is: Is) -> Option<usize> {
        self.stages.iter().position(|stage| stage.stage.is == is)
    }

    /// The values of the first stage that is this.
    #[must_use]
    pub fn values(&self, is: Is) -> Option<&Series> {
        self.place(is).map(|place| &self.stages[place].values)
    }

    /// The same, to be changed.
    pub fn values_mut(&mut self, is: Is) -> Option<&mut Series> {
        self.place(is).map(|place| &mut self.stages[place].values)
    }
}

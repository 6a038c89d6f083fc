//! Candidates that are built and measured on the target.

use cardan_datapath::Format;

use super::{Run, TuneError};
use crate::budget::Measure;
use crate::outcome::{Candidate, Reached};

impl Run<'_> {
    /// By measured cycles the cheapest of what the search found and of the deployed formats, as they
    /// are and relaxed: the model that the search goes by is an estimate.
    pub(super) fn cheapest_measured(
        &mut self,
        best: Candidate,
        formats: Vec<Format>,
    ) -> Result<(Candidate, Vec<Format>), TuneError> {
        let mut cheapest = (best, formats);
        let is_restricted = !self.options.widths.is_empty() || !self.options.coupled.is_empty();
        let deployed = self.problem.deployed();
        if is_restricted || !self.pool.score(&deployed).is_feasible() {
            return Ok(cheapest);
        }
        let mut relaxed = deployed.clone();
        self.relax(&mut relaxed, 1.0);
        for (name, formats) in [("deployed", deployed), ("deployed, relaxed", relaxed)] {
            if self.measured.iter().any(|known| known.formats.is(&formats)) {
                continue;
            }
            let mut candidate = self.candidate(name, &formats);
            if !self.measured_if_it_fits(&mut candidate, &formats)? {
                continue;
            }
            let is_within = |reached: &Reached| reached.ratio.is_some_and(|ratio| ratio <= 1.0);
            if candidate.reached.iter().all(is_within) && cheaper(&candidate, &cheapest.0) {
                cheapest = (candidate, formats);
            }
        }
        if cheapest.0.name != "best" {
            self.warnings.push(format!(
                "the result is '{}': the search's own choice took more cycles when measured",
                cheapest.0.name
            ));
        }
        Ok(cheapest)
    }

    /// Measures a candidate; false, with a warning, if it cannot be built.
    pub(super) fn measured_if_it_fits(
        &mut self,
        candidate: &mut Candidate,
        formats: &[Format],
    ) -> Result<bool, TuneError> {
        match self.measure(candidate, formats) {
            Ok(()) => Ok(true),
            Err(TuneError::Unbuildable(why)) => {
                let name = &candidate.name;
                self.warnings
                    .push(format!("'{name}' cannot be built for the target: {why}"));
                Ok(false)
            }
            Err(error) => Err(error),
        }
    }

    pub(super) fn measure(
        &mut self,
        candidate: &mut Candidate,
        formats: &[Format],
    ) -> Result<(), TuneError> {
        let on_target = self.on_target.ok_or_else(|| {
            TuneError::Target(
                "cycles and flash are measured on the target, which needs the firmware's toolchain; \
                 `cardan doctor` says what is missing"
                    .into(),
            )
        })?;
        let found = on_target(formats)?;
        candidate.cycles = Some(found.cycles);
        candidate.flash = Some(found.flash);
        candidate.ram = Some(found.ram);
        for (reached, constraint) in candidate.reached.iter_mut().zip(&self.budget.0) {
            let value = match constraint.measure {
                Measure::Cycles => found.cycles,
                Measure::Flash => found.flash,
                _ => continue,
            };
            (reached.value, reached.ratio) = (Some(value), Some(constraint.ratio(value)));
        }
        self.measured.push(candidate.clone());
        Ok(())
    }
}

/// Fewer measured cycles; none were measured of what cannot be built.
fn cheaper(a: &Candidate, b: &Candidate) -> bool {
    match (a.cycles, b.cycles) {
        (Some(a), Some(b)) => a < b,
        (a, None) => a.is_some(),
        (None, _) => false,
    }
}

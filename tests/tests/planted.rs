//! The verdict's oracle: a catalogue of planted faults over all parties. Each must fail the comparison,
//! and the reason named first must name the right party and place. A pass that a planted fault gets is
//! a defect of the product.
//!
//! Faults are planted at the seam between participant and judge (`cardan::rig`): in frames, node
//! values, status words, truths, conversions, counters. A fault before the firmware is followed by a
//! new run of firmware and golden model, so that both agree with each other as they would on the
//! bench. `patches.rs` plants faults in the compiled image.

#[path = "planted/chain.rs"]
mod chain;
#[path = "planted/frames.rs"]
mod frames;
#[path = "planted/settings.rs"]
mod settings;
#[path = "planted/unseen.rs"]
mod unseen;
#[path = "planted/values.rs"]
mod values;

use std::collections::BTreeSet;

use cardan::rig::{Collected, Rig};
use cardan_compare::{Report, Verdict};

/// The unchanged run that a fault is planted in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Run {
    /// The bundled scenario.
    Tumble,
    /// With a disturbed field.
    Magnet,
    /// Upside down too, with a third tilt axis.
    Somersault,
    /// With a magnet that drives a channel to its rail.
    Clipped,
    /// A misaligned unit with its calibration.
    Misaligned,
    /// The image without taps.
    Plain,
}

impl Run {
    const ALL: [Self; 6] = [
        Self::Tumble,
        Self::Magnet,
        Self::Somersault,
        Self::Clipped,
        Self::Misaligned,
        Self::Plain,
    ];

    fn arguments(self) -> Vec<String> {
        let plain = cardan_tests::root().join("firmware/boards/atmega328p/images/plain.elf");
        let plain = plain.display().to_string();
        let arguments: &[&str] = match self {
            Self::Tumble => &["--scenario", "tumble", "--seconds", "12"],
            Self::Magnet => &["--scenario", "magnet", "--seconds", "8"],
            Self::Somersault => &["--scenario", "somersault", "--seconds", "12"],
            Self::Clipped => &["--scenario", "rails", "--seconds", "4"],
            Self::Misaligned => &["--scenario", "misaligned", "--seconds", "4"],
            Self::Plain => &[
                "--scenario",
                "tumble",
                "--seconds",
                "3",
                "--firmware",
                &plain,
            ],
        };
        arguments
            .iter()
            .map(|&argument| argument.to_owned())
            .collect()
    }
}

type Change = Box<dyn Fn(&mut Collected) + Send + Sync>;

/// A fault, and what the first reason must begin with (alternatives are set apart by bars).
pub(crate) struct Fault {
    name: &'static str,
    run: Run,
    expected: &'static str,
    change: Change,
    recomputed: bool,
}

impl Fault {
    pub(crate) fn new(
        name: &'static str,
        run: Run,
        expected: &'static str,
        change: impl Fn(&mut Collected) + Send + Sync + 'static,
    ) -> Self {
        Self {
            name,
            run,
            expected,
            change: Box::new(change),
            recomputed: false,
        }
    }

    /// Firmware and golden model run again on the changed conversions.
    pub(crate) fn recomputed(self) -> Self {
        Self {
            recomputed: true,
            ..self
        }
    }

    /// What is wrong with the verdict on this fault.
    fn complaint(&self, rig: &Rig, before: &Report) -> Option<String> {
        let mut faulty = rig.with(|collected| (self.change)(collected));
        if self.recomputed {
            faulty.recompute().expect("engines run");
        }
        let report = faulty.judge().expect("can be judged");
        // A run that fails by itself (a rail that is reached) must fail by something new.
        let known: BTreeSet<String> = before.reasons.iter().map(ToString::to_string).collect();
        let reasons = report.reasons.iter().map(ToString::to_string);
        let first = reasons.into_iter().find(|reason| !known.contains(reason));
        match first {
            None => Some(format!("{}: passes", self.name)),
            Some(_) if report.verdict == Verdict::Pass => Some(format!("{}: passes", self.name)),
            Some(first)
                if self
                    .expected
                    .split('|')
                    .any(|start| first.starts_with(start)) =>
            {
                None
            }
            Some(first) => Some(format!(
                "{}: expected '{}', found '{first}'",
                self.name, self.expected
            )),
        }
    }
}

pub(crate) fn fault(
    name: &'static str,
    run: Run,
    expected: &'static str,
    change: fn(&mut Collected),
) -> Fault {
    Fault::new(name, run, expected, change)
}

fn all() -> Vec<Fault> {
    let mut all = frames::faults();
    all.extend(values::faults());
    all.extend(settings::faults());
    all.extend(chain::faults());
    all.extend(unseen::faults());
    all
}

#[test]
fn every_planted_fault_fails_and_is_named_with_its_party_and_place() {
    let faults = all();
    assert!(faults.len() >= 60, "{} faults", faults.len());
    let names: BTreeSet<&str> = faults.iter().map(|fault| fault.name).collect();
    assert_eq!(names.len(), faults.len(), "a name stands twice");
    let mut complaints = Vec::new();
    for run in Run::ALL {
        let arguments = run.arguments();
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let rig = Rig::record(&arguments).expect("records");
        let before = rig.judge().expect("can be judged");
        if before.verdict == Verdict::Fail {
            complaints.push(format!(
                "{run:?} fails unchanged: {:?}",
                before.reasons.first()
            ));
        }
        let of_run = faults.iter().filter(|fault| fault.run == run);
        complaints.extend(of_run.filter_map(|fault| fault.complaint(&rig, &before)));
    }
    assert!(
        complaints.is_empty(),
        "{} of {} planted faults:\n{}",
        complaints.len(),
        faults.len(),
        complaints.join("\n")
    );
}

#[test]
fn running_firmware_and_golden_model_again_on_the_same_conversions_changes_nothing() {
    let mut rig = Rig::record(&["--seconds", "2"]).expect("records");
    let before = serde_json::to_value(rig.judge().expect("can be judged")).expect("a document");
    rig.recompute().expect("engines run");
    let after = serde_json::to_value(rig.judge().expect("can be judged")).expect("a document");
    assert_eq!(before, after);
}

//! Candidates on the target: built, measured in the emulator, and put into the firmware.

use cardan_bench::App;
use cardan_compare::{Report, Verdict};
use cardan_datapath::{Format, wordlengths};
use cardan_tune::{OnTarget, TuneError};

use crate::commands::build::measure::measure;
use crate::failure::Failure;
use crate::files::{Plan, read_text, write_whole};
use crate::output::Output;
use crate::run_options::RunOptions;
use crate::toolchain::{self, BOARDS, Checkout};

/// Builds the plain image in `formats` and measures it.
pub(super) fn on_target(
    checkout: &Checkout,
    app: &'static dyn App,
    formats: &[Format],
    output: Output,
) -> Result<OnTarget, TuneError> {
    output.note(&format!(
        "building a candidate for the target from {checkout}"
    ));
    let declared = toolchain::declared(app.nodes(), formats);
    let built = toolchain::build_board(checkout, &BOARDS[0], false, Some(&declared), true)
        .map_err(|failure| refused(&failure.to_string()))?;
    let measured = measure(&built.file.display().to_string(), &built.elf)
        .map_err(|failure| TuneError::Target(failure.to_string()))?;
    let cycles = measured
        .solution_own_cycles
        .or(measured.solution_cycles)
        .ok_or_else(|| {
            let what = "the candidate computed no solution in the emulator";
            TuneError::Unbuildable(what.to_owned())
        })?;
    Ok(OnTarget {
        cycles: cycles.mean,
        flash: measured.flash_bytes as f64,
        ram: measured.ram_bytes.map_or(f64::NAN, f64::from),
    })
}

/// A build that fails in the linker is too large; everything else ends the search.
fn refused(message: &str) -> TuneError {
    let too_large = message
        .lines()
        .find(|line| line.contains("will not fit") || line.contains("overflowed by"));
    match too_large {
        Some(line) => TuneError::Unbuildable(line.trim().to_owned()),
        None => TuneError::Target(message.to_owned()),
    }
}

/// The checkout that `--apply` changes: the user's own, whose firmware has the nodes that are tuned.
///
/// # Errors
/// There is none, its word lengths cannot be read or written, or are of other nodes.
pub(super) fn to_apply_to(run: &RunOptions, app: &'static dyn App) -> Result<Checkout, Failure> {
    let checkout = Checkout::to_write(run.checkout.as_deref(), "--apply")?;
    let file = checkout.wordlengths();
    Plan::default().output("--apply", Some(&file)).check()?;
    let (name, text) = (file.display().to_string(), read_text(&file)?);
    let declared = wordlengths::parse(&text, &name).map_err(Failure::input)?;
    wordlengths::align(&declared, app.nodes(), &name).map_err(Failure::input)?;
    Ok(checkout)
}

/// Writes the word lengths into the firmware of `checkout`, rebuilds it, and compares it in the emulator with
/// the golden model. The old file is put back if the new one cannot be built or run.
pub(super) fn apply(
    checkout: &Checkout,
    run: &RunOptions,
    rewritten: impl Fn(&str, &str) -> Result<String, String>,
    output: Output,
) -> Result<Report, Failure> {
    let file = checkout.wordlengths();
    let shown = file.display().to_string();
    let before = read_text(&file)?;
    let text = rewritten(&before, &shown).map_err(Failure::input)?;
    write_whole("--apply", &file, text)?;
    output.note(&format!("written: {shown}; building and comparing"));
    let run = RunOptions {
        wordlengths: Some(file.clone()),
        checkout: Some(checkout.root().to_owned()),
        ..run.clone()
    };
    match crate::commands::compare::report(&run) {
        Ok(report) => Ok(report),
        Err(failure) => {
            write_whole("--apply", &file, before)?;
            output.note(&format!("{shown}: restored"));
            Err(failure)
        }
    }
}

/// The rebuilt firmware, emulated, did the same as the tuned model in every node.
pub(super) fn is_bit_equal(report: &Report) -> bool {
    let equal = |node: &cardan_compare::NodeReport| {
        let bits = node.native_vs_emulated.as_ref();
        bits.is_some_and(|bits| bits.compared > 0 && bits.mismatches == 0)
    };
    !report.nodes.is_empty() && report.nodes.iter().all(equal)
}

/// The verdict of the rebuilt firmware in words.
pub(super) fn told(report: &Report) -> String {
    let bits = if is_bit_equal(report) {
        "emulated and native are equal in every bit of every node"
    } else {
        "emulated and native DIFFER"
    };
    let verdict = match report.verdict {
        Verdict::Pass => "the comparison passes".to_owned(),
        Verdict::Fail => format!(
            "the comparison does not pass ({} reasons; the bundled tolerances are those of the formats \
             before)",
            report.reasons.len()
        ),
    };
    format!("applied: {bits}; {verdict}")
}

//! The result of a search for people.

use std::fmt::Write as _;

use cardan_page::text::{Style, Tone};
use cardan_tune::output::told;
use cardan_tune::{Candidate, Outcome, Verification};

/// Nodes that are listed by their share of the error.
const LISTED: usize = 10;

pub(super) fn render(outcome: &Outcome, style: Style) -> String {
    let mut out = verdict(outcome);
    let end = out.find('\n').unwrap_or(out.len());
    let good = outcome.binding.is_none() && outcome.verified;
    out.replace_range(..end, &style.toned(Tone::of(good), &out[..end]));
    let _ = writeln!(
        out,
        "{:<20} {:>6} {:>7} {:>10} {:>12}",
        "", "bits", "saved", "cycles", "error"
    );
    row(&mut out, &outcome.baseline, outcome.baseline.bits);
    row(&mut out, &outcome.deployed, outcome.baseline.bits);
    if let Some(uniform) = &outcome.best_uniform {
        row(&mut out, uniform, outcome.baseline.bits);
    }
    row(&mut out, &outcome.best, outcome.baseline.bits);
    if let Some(uniform) = &outcome.best_uniform {
        against_uniform(&mut out, outcome, uniform);
    }
    measured(&mut out, &outcome.measured);
    for reached in &outcome.best.reached {
        let value = reached
            .value
            .map_or("-".to_owned(), |value| format!("{value:.4e}"));
        let _ = writeln!(out, "  {:<28} {value}", reached.constraint);
    }
    shares(&mut out, outcome);
    for point in &outcome.pareto {
        let error = point
            .error
            .map_or("-".to_owned(), |error| format!("{error:.3e}"));
        let _ = writeln!(
            out,
            "  limits x {:<5} {:>6} bits  error {error}",
            point.limit_factor, point.bits
        );
    }
    if let Some(found) = &outcome.statistics {
        let _ = writeln!(out, "{}", told(found));
    }
    held_out(&mut out, &outcome.verification);
    let missed = |case: &&Verification| case.held_out && !case.pass;
    for case in outcome.verification.iter().filter(missed) {
        let over = case
            .over_tuning
            .map_or("-".to_owned(), |over| format!("{over:.2}"));
        let _ = writeln!(
            out,
            "held out, {}: MISSES the budget, {over} times the error tuned on",
            case.case
        );
        let differing = case.flags.iter().filter(|flag| flag.differing > 0);
        for flag in differing {
            let _ = writeln!(
                out,
                "  status bit {:#06x}: raised {} times, {} on real numbers, {} solutions differ",
                flag.bit, flag.tuned, flag.real, flag.differing
            );
        }
    }
    let _ = match &outcome.binding {
        None => write!(
            out,
            "met on the runs tuned on after {} candidates in {:.1} s",
            outcome.evaluations, outcome.seconds
        ),
        Some(_) => write!(
            out,
            "{} candidates in {:.1} s",
            outcome.evaluations, outcome.seconds
        ),
    };
    out
}

/// Runs that errors were not tuned on, fresh ones apart, and that hold.
fn held_out(out: &mut String, verification: &[Verification]) {
    let own = |case: &&Verification| case.held_out && !case.fresh && case.pass;
    let over: Vec<f64> = verification
        .iter()
        .filter(own)
        .filter_map(|case| case.over_tuning)
        .collect();
    if over.is_empty() {
        return;
    }
    let least = over.iter().copied().fold(f64::INFINITY, f64::min);
    let most = over.iter().copied().fold(0.0, f64::max);
    let _ = writeln!(
        out,
        "{} held-out runs, which ranges alone are taken from: within the budget, {least:.2} to {most:.2} \
         times the error tuned on",
        over.len()
    );
}

/// What does not hold comes first.
fn verdict(outcome: &Outcome) -> String {
    let mut out = String::new();
    if let Some(binding) = &outcome.binding {
        let _ = writeln!(
            out,
            "budget NOT met: {binding} is missed even by the closest point below"
        );
        if let Some(reason) = &outcome.reason {
            let _ = writeln!(out, "  {reason}");
        }
    } else if outcome.verified {
        let _ = writeln!(
            out,
            "budget met, verified on runs that nothing was tuned on"
        );
    } else {
        let missed = outcome.verification.iter().filter(|case| !case.pass);
        let _ = writeln!(
            out,
            "NOT VERIFIED: the budget is met on the runs tuned on, and does not hold on others ({} of \
             {} runs miss it)",
            missed.count(),
            outcome.verification.len()
        );
    }
    out
}

fn row(out: &mut String, candidate: &Candidate, baseline: u64) {
    let saved = 100.0 * (1.0 - candidate.bits as f64 / baseline as f64);
    let cycles = match (candidate.cycles, candidate.cycles_estimated) {
        (Some(cycles), _) => format!("{cycles:.0}"),
        // The model's estimate.
        (None, Some(estimated)) => format!("~{estimated:.0}"),
        (None, None) => "-".to_owned(),
    };
    let error = candidate
        .error
        .map_or("-".to_owned(), |error| format!("{error:.4e}"));
    let _ = writeln!(
        out,
        "{:<20} {:>6} {saved:>6.1}% {cycles:>10} {error:>12}",
        candidate.name, candidate.bits
    );
}

/// What was tuned for, beside the best uniform word length.
fn against_uniform(out: &mut String, outcome: &Outcome, uniform: &Candidate) {
    let best = &outcome.best;
    let (what, ratio) = match (outcome.cost, best.cycles, uniform.cycles) {
        ("cycles", Some(best), Some(uniform)) => ("cycles", best / uniform),
        ("area", ..) => match (best.area, uniform.area) {
            (Some(best), Some(uniform)) => ("area", best / uniform),
            _ => return,
        },
        ("bits", ..) => ("bits", best.bits as f64 / uniform.bits as f64),
        _ => return,
    };
    let saved = 100.0 * (1.0 - ratio);
    let _ = writeln!(
        out,
        "{saved:.1} % less {what} than the best uniform word length"
    );
}

/// Candidates that were built, with how far off the model's estimates are.
fn measured(out: &mut String, candidates: &[Candidate]) {
    if !candidates.is_empty() {
        let _ = writeln!(
            out,
            "measured on the target   cycles  estimated  model error    flash      RAM"
        );
    }
    for candidate in candidates {
        let (Some(cycles), Some(estimated)) = (candidate.cycles, candidate.cycles_estimated) else {
            continue;
        };
        let error = 100.0 * (estimated / cycles - 1.0);
        let bytes =
            |bytes: Option<f64>| bytes.map_or("-".to_owned(), |bytes| format!("{bytes:.0}"));
        let _ = writeln!(
            out,
            "  {:<20} {cycles:>8.0} {estimated:>10.0} {error:>+10.1} % {:>8} {:>8}",
            candidate.name,
            bytes(candidate.flash),
            bytes(candidate.ram)
        );
    }
}

fn shares(out: &mut String, outcome: &Outcome) {
    let mut shares: Vec<_> = outcome.sensitivities.iter().collect();
    shares.sort_by(|a, b| b.share.total_cmp(&a.share));
    let _ = writeln!(out, "largest shares of the rounding error (noise model):");
    for noise in shares.iter().take(LISTED) {
        let _ = writeln!(
            out,
            "  {:<19} {:>5.1} % of {}",
            noise.node,
            noise.share * 100.0,
            noise.quantity
        );
    }
}

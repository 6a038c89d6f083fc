//! Budget expressions: what formats must achieve.
//!
//! `attitude.rms<=0.05`, `yaw.p99<0.1`, `truth.yaw.rms<=1.5`, `sqnr(tilt_x)>=60dB`, `lsb(yaw)<=2`,
//! `overflow==0`, `overflow(NODE)==0`, `flags<=0.01`, `cycles<=20000`, `flash<=28000`.

use crate::catalogue::mend;
use crate::problem::Problem;

/// Which figure of many errors counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Statistic {
    /// Root mean square.
    Rms,
    /// 99th percentile of the size (nearest rank).
    P99,
    /// Largest size.
    Max,
}

/// What an output is compared with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Against {
    /// The golden model on the same inputs.
    Golden,
    /// The truth.
    Truth,
}

/// Whose error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Subject {
    /// A quantity, by index.
    Quantity(usize),
    /// A combined error, by index.
    Combined(usize),
}

/// What is limited.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Measure {
    /// An error of the outputs.
    Error(Against, Subject, Statistic),
    /// Signal over rounding noise of a node, in dB: at least.
    Sqnr(usize),
    /// Largest distance of a node from the real interpretation, in its own places.
    Lsb(usize),
    /// Overflows of one node, or of all that do not wrap by design.
    Overflow(Option<usize>),
    /// Share of the solutions whose status bits are not those of the real interpretation.
    Flags,
    /// Measured cycles of a solution.
    Cycles,
    /// Measured flash in bytes.
    Flash,
}

/// A limit with the text it was written as.
#[derive(Clone, Debug, PartialEq)]
pub struct Constraint {
    /// As written.
    pub text: String,
    /// What is limited.
    pub measure: Measure,
    /// At most (at least, for SQNR).
    pub limit: f64,
}

impl Constraint {
    /// How far `value` stretches the limit: up to 1 is within it.
    #[must_use]
    pub fn ratio(&self, value: f64) -> f64 {
        if value.is_nan() {
            return f64::INFINITY;
        }
        match self.measure {
            Measure::Sqnr(_) => libm::pow(10.0, (self.limit - value) / 20.0),
            _ if self.limit > 0.0 => value / self.limit,
            // A limit of zero: zero is within it, anything else far outside.
            _ if value <= 0.0 => 0.0,
            _ => 1.0 + value,
        }
    }
}

/// All limits.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Budget(pub Vec<Constraint>);

/// Why a budget expression was refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("budget '{text}': {what}")]
pub struct BudgetError {
    text: String,
    what: String,
}

/// Share of the solutions whose status may differ, where the budget says nothing: without it a
/// candidate could flag its way out of being judged.
pub const FLAGS_LIMIT: f64 = 0.01;

impl Budget {
    /// Reads expressions for `problem`.
    ///
    /// # Errors
    /// None at all, bad syntax, unknown names; the message lists what is admissible.
    pub fn parse<S: AsRef<str>>(texts: &[S], problem: &Problem) -> Result<Self, BudgetError> {
        if texts.is_empty() {
            return Err(BudgetError {
                text: String::new(),
                what: format!(
                    "nothing to meet: give at least one, such as '{}.rms<=0.05'",
                    whole(problem)
                ),
            });
        }
        let mut constraints = Vec::new();
        for text in texts {
            let text = text.as_ref();
            let parsed = constraint(text, problem).map_err(|what| BudgetError {
                text: text.to_owned(),
                what,
            })?;
            constraints.push(parsed);
        }
        if !constraints.iter().any(|c| c.measure == Measure::Flags) {
            constraints.push(Constraint {
                text: format!("flags<={FLAGS_LIMIT}"),
                measure: Measure::Flags,
                limit: FLAGS_LIMIT,
            });
        }
        Ok(Self(constraints))
    }

    /// True if something must be measured on the target.
    #[must_use]
    pub fn needs_target(&self) -> bool {
        let on_target = |c: &Constraint| matches!(c.measure, Measure::Cycles | Measure::Flash);
        self.0.iter().any(on_target)
    }
}

const SHAPE: &str = "expected NAME.rms|p99|max<=NUMBER, sqnr(NODE)>=NUMBERdB, lsb(NODE)<=NUMBER, \
                     overflow==0, flags<=SHARE, cycles<=N or flash<=N";

/// What stands for all quantities together, or the first of them.
fn whole(problem: &Problem) -> &str {
    let combined = problem.combined.first().map(|combined| &combined.name);
    let first = problem.quantities.first().map(|quantity| &quantity.name);
    combined.or(first).map_or("NAME", String::as_str)
}

fn constraint(text: &str, problem: &Problem) -> Result<Constraint, String> {
    let squeezed: String = text.chars().filter(|c| !c.is_whitespace()).collect();
    let at = squeezed.find(['<', '>', '=']).ok_or(SHAPE)?;
    let (name, rest) = squeezed.split_at(at);
    let sign_end = rest.find(|c| !['<', '>', '='].contains(&c)).ok_or(SHAPE)?;
    let (sign, number) = rest.split_at(sign_end);
    let number = number.strip_suffix("dB").unwrap_or(number);
    let number = number.strip_suffix("deg").unwrap_or(number);
    let limit: f64 = number
        .parse()
        .map_err(|_| format!("'{number}' is not a number; {SHAPE}"))?;
    let measure = measure(name, problem)?;
    let wanted: &[&str] = match measure {
        Measure::Sqnr(_) => &[">="],
        Measure::Overflow(_) => &["==", "<="],
        _ => &["<="],
    };
    if !wanted.contains(&sign) {
        return Err(format!("'{sign}': expected '{}' here", wanted[0]));
    }
    let zero_allowed = matches!(
        measure,
        Measure::Sqnr(_) | Measure::Overflow(_) | Measure::Flags
    );
    if !limit.is_finite() || limit < 0.0 || (limit == 0.0 && !zero_allowed) {
        let least = if zero_allowed { "from 0 up" } else { "above 0" };
        return Err(format!("limit {limit}: expected a finite number {least}"));
    }
    if matches!(measure, Measure::Overflow(_)) && limit != 0.0 {
        return Err(format!(
            "limit {limit}: expected 0: no overflow is admissible, or leave it out"
        ));
    }
    if measure == Measure::Flags && limit > 1.0 {
        return Err(format!(
            "limit {limit}: expected a share of the solutions, 0 to 1"
        ));
    }
    Ok(Constraint {
        text: squeezed.clone(),
        measure,
        limit,
    })
}

fn measure(name: &str, problem: &Problem) -> Result<Measure, String> {
    if let Some((function, rest)) = name.split_once('(') {
        let node = rest.strip_suffix(')').ok_or(SHAPE)?;
        let node = problem.node(node).ok_or_else(|| {
            let names = problem.nodes.iter().map(|node| node.name);
            format!("no node '{node}'; {}", mend(node, names))
        })?;
        return match function {
            "sqnr" => Ok(Measure::Sqnr(node)),
            "lsb" => Ok(Measure::Lsb(node)),
            "overflow" => Ok(Measure::Overflow(Some(node))),
            _ => {
                let known = ["sqnr", "lsb", "overflow"];
                Err(format!(
                    "no measure '{function}'; {}",
                    mend(function, known.into_iter())
                ))
            }
        };
    }
    match name {
        "overflow" => return Ok(Measure::Overflow(None)),
        "flags" => return Ok(Measure::Flags),
        "cycles" => return Ok(Measure::Cycles),
        "flash" => return Ok(Measure::Flash),
        _ => {}
    }
    let (against, name) = match name.strip_prefix("truth.") {
        Some(rest) => (Against::Truth, rest),
        None => (Against::Golden, name),
    };
    // `truth.rms` is that of all quantities together.
    let whole = problem
        .combined
        .first()
        .map_or("", |first| first.name.as_str());
    let (what, statistic) = name.rsplit_once('.').unwrap_or((whole, name));
    let statistic = match statistic {
        "rms" => Statistic::Rms,
        "p99" => Statistic::P99,
        "max" => Statistic::Max,
        other => return Err(unknown(what, other, name, problem)),
    };
    if against == Against::Truth && problem.tuning.iter().any(|case| case.truths.is_empty()) {
        return Err("there is no truth to compare with: the run has no reference".into());
    }
    let quantity = problem.quantities.iter().position(|q| q.name == what);
    let combined = problem.combined.iter().position(|c| c.name == what);
    let subject = quantity
        .map(Subject::Quantity)
        .or(combined.map(Subject::Combined))
        .ok_or_else(|| unknown(what, "rms", name, problem))?;
    Ok(Measure::Error(against, subject, statistic))
}

/// What an unknown metric's message says.
fn unknown(what: &str, statistic: &str, name: &str, problem: &Problem) -> String {
    let combined = problem.combined.iter().map(|c| c.name.as_str());
    let subjects = combined.chain(problem.quantities.iter().map(|q| q.name.as_str()));
    let others = [
        "overflow",
        "flags",
        "cycles",
        "flash",
        "sqnr(NODE)",
        "lsb(NODE)",
    ];
    let is_known = subjects.clone().any(|subject| subject == what);
    if is_known {
        let known = ["rms", "p99", "max"];
        return format!(
            "no statistic '{statistic}'; {}",
            mend(statistic, known.into_iter())
        );
    }
    let listed: Vec<String> = subjects.map(|subject| format!("{subject}.rms")).collect();
    let known = listed.iter().map(String::as_str).chain(others);
    format!("no metric '{name}'; {}", mend(name, known))
}

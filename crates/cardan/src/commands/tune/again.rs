//! The command line of a search, for those who look at its result.

use clap::ValueEnum as _;

use super::Arguments;

/// The command that finds the same again: every option that the result depends on.
pub(super) fn command_line(arguments: &Arguments) -> String {
    let mut line = format!("cardan tune{}", arguments.run.arguments().typed());
    let mut give = |name: &str, value: &str| line.push_str(&format!(" {name} {value}"));
    for budget in &arguments.budget {
        give("--budget", &format!("'{budget}'"));
    }
    let named = |value: Option<clap::builder::PossibleValue>| {
        value.map_or_else(String::new, |value| value.get_name().to_owned())
    };
    give("--cost", &named(arguments.cost.to_possible_value()));
    give("--method", &named(arguments.method.to_possible_value()));
    give("--guard-bits", &arguments.guard_bits.to_string());
    give("--runs", &arguments.runs.to_string());
    give("--fresh", &arguments.fresh.to_string());
    if let Some(file) = &arguments.coefficients {
        give("--coefficients", &file.display().to_string());
    }
    for node in &arguments.lock {
        give("--lock", node);
    }
    for nodes in &arguments.couple {
        give("--couple", nodes);
    }
    if !arguments.widths.is_empty() {
        let widths: Vec<String> = arguments.widths.iter().map(u32::to_string).collect();
        give("--widths", &widths.join(","));
    }
    let limits = [
        (
            "--evaluations",
            arguments.evaluations.map(|n| n.to_string()),
        ),
        ("--time", arguments.time.map(|s| s.to_string())),
        ("--patience", arguments.patience.map(|n| n.to_string())),
    ];
    for (name, value) in limits {
        if let Some(value) = value {
            give(name, &value);
        }
    }
    for (name, scenarios) in [
        ("--also", &arguments.also),
        ("--held-out", &arguments.held_out),
    ] {
        for scenario in scenarios {
            give(name, scenario);
        }
    }
    line
}

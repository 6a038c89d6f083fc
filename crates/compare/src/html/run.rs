//! The machine that ran, what is assumed, and how to run it again.

use maud::{Markup, html};

use crate::format::{count, number, percent};
use crate::report::Report;
use cardan_page::framed;

pub(super) fn section(report: &Report) -> Markup {
    html! {
        (framed(
            "machine",
            "Controller and link",
            "Counted by cycle on the emulated controller; messages between the participants.",
            &machine(report),
        ))
        (framed(
            "assumed",
            "Assumed parameters",
            "Values that are neither published nor measured. They stand in the scenario file and \
             can be changed there.",
            &assumed(report),
        ))
        (framed(
            "reproduce",
            "Reproduce",
            "The same command with the same seed gives the same figures; only the real-time factor \
             may differ.",
            &reproduce(report),
        ))
    }
}

fn fact(name: &str, value: &str, bad: bool) -> Markup {
    html! { div .bad[bad] { dt { (name) } dd { (value) } } }
}

fn machine(report: &Report) -> Markup {
    let (emulator, link, frames) = (&report.emulator, &report.link, &report.frames);
    let stack = emulator.stack_peak.map_or_else(
        || "not measured".to_owned(),
        |bytes| format!("{} bytes", count(bytes)),
    );
    let counted = |name: &str, value: u64| fact(name, &count(value), value > 0);
    html! {
        dl.facts {
            (fact("Cycles", &count(emulator.cycles), false))
            (fact("Instructions", &count(emulator.instructions), false))
            (fact("CPU load", &percent(emulator.cpu_load), false))
            (fact("Largest stack", &stack, false))
            (fact(
                "Longest interrupt latency",
                &format!("{} cycles", emulator.isr_latency_max_cycles),
                false,
            ))
            (fact("Times real time", &number(emulator.realtime_factor), false))
            (counted("Late conversions", emulator.late_conversions))
            (counted("Lost conversions", emulator.lost_conversions))
            (counted("Missed deadlines", emulator.missed_deadlines))
        }
        dl.facts {
            (fact("Frames compared", &count(frames.compared), frames.compared == 0))
            (counted("Frames differing", frames.mismatches))
            (fact("Messages", &count(link.messages), false))
            (fact("Bytes", &count(link.bytes), false))
            (counted("Messages lost", link.lost))
        }
    }
}

fn assumed(report: &Report) -> Markup {
    html! {
        @if report.assumed.is_empty() {
            p.muted { "None in this run." }
        } @else {
            div.scroll {
                table {
                    thead { tr {
                        th scope="col" { "parameter" }
                        th scope="col" { "value" }
                        th scope="col" { "reason" }
                    } }
                    tbody {
                        @for parameter in &report.assumed {
                            tr {
                                th scope="row" { code { (parameter.name) } }
                                td { (parameter.value) }
                                td.prose { (parameter.reason) }
                            }
                        }
                    }
                }
            }
        }
    }
}

fn reproduce(report: &Report) -> Markup {
    html! {
        pre { code { (report.reproduce.command) } }
        @if !report.reproduce.provenance.is_empty() {
            dl.provenance {
                @for (name, value) in &report.reproduce.provenance {
                    dt { (name) } dd { code { (value) } }
                }
            }
        }
    }
}

//! The result as JUnit XML, which every server of continuous integration reads.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use cardan_compare::Report;

/// Kinds of check that every comparison makes, beside its nodes; a reason's text begins with its kind.
const KINDS: [&str; 8] = [
    "attitude",
    "baseline",
    "error budget",
    "frames",
    "image",
    "link",
    "status",
    "timing",
];

/// The document: one suite, a case per node and per kind of check, with the reasons as failures.
pub(super) fn document(report: &Report) -> String {
    let mut cases: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for kind in KINDS {
        cases.entry(kind.to_owned()).or_default();
    }
    for check in &report.checks {
        cases.entry(check.party.clone()).or_default();
    }
    let mut of_nodes: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    for reason in report.reasons.iter().map(ToString::to_string) {
        let kind = reason
            .split_once(": ")
            .map_or(reason.as_str(), |(kind, _)| kind);
        let node = kind.strip_prefix("node ");
        let node = node.and_then(|name| report.nodes.iter().find(|node| node.name == name));
        match node {
            Some(node) => of_nodes.entry(&node.name).or_default().push(reason),
            None => cases.entry(kind.to_owned()).or_default().push(reason),
        }
    }
    let suite = format!("{}.{}", report.app, report.scenario);
    let mut body = String::new();
    let (mut tests, mut failures) = (0, 0);
    let mut add = |group: &str, name: &str, reasons: &[String]| {
        tests += 1;
        failures += usize::from(!reasons.is_empty());
        case(&mut body, &format!("{suite}.{group}"), name, reasons);
    };
    for node in &report.nodes {
        let reasons = of_nodes.get(node.name.as_str());
        add("nodes", &node.name, reasons.map_or(&[], Vec::as_slice));
    }
    for (name, reasons) in &cases {
        add("checks", name, reasons);
    }
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites name=\"cardan compare\" tests=\"{tests}\" \
         failures=\"{failures}\">\n  <testsuite name=\"{}\" tests=\"{tests}\" failures=\"{failures}\" \
         errors=\"0\" skipped=\"0\">\n    <properties>\n      <property name=\"seed\" value=\"{}\"/>\n      \
         <property name=\"reproduce\" value=\"{}\"/>\n    </properties>\n{body}  </testsuite>\n</testsuites>\n",
        escaped(&suite),
        report.seed,
        escaped(&report.reproduce.command),
    )
}

fn case(out: &mut String, class: &str, name: &str, reasons: &[String]) {
    let (class, name) = (escaped(class), escaped(name));
    let Some(first) = reasons.first() else {
        let _ = writeln!(out, "    <testcase classname=\"{class}\" name=\"{name}\"/>");
        return;
    };
    let _ = writeln!(
        out,
        "    <testcase classname=\"{class}\" name=\"{name}\">\n      <failure message=\"{}\">{}</failure>\n    \
         </testcase>",
        escaped(first),
        escaped(&reasons.join("\n")),
    );
}

/// Text as XML 1.0 may hold it; characters that it may not are replaced.
fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\n' => out.push_str("&#10;"),
            '\t' => out.push_str("&#9;"),
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardan_compare::{Comparison, Reason, compare};

    #[test]
    fn reasons_stand_at_their_case_and_nothing_breaks_the_markup() {
        let mut report = compare(&Comparison::default());
        report.scenario = "a<b>\"&\u{1}".into();
        report.reasons = vec![
            Reason::NoFrames,
            Reason::MessagesLost(3),
            Reason::MessagesLost(4),
        ];
        let text = document(&report);
        assert!(text.contains("failures=\"2\""), "{text}");
        assert!(text.contains("a&lt;b&gt;&quot;&amp;\u{fffd}"), "{text}");
        assert!(
            text.contains("3 messages lost&#10;link: 4 messages lost"),
            "{text}"
        );
        assert!(text.contains("name=\"timing\"/>"), "{text}");
    }
}

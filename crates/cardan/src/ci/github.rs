//! Annotations of GitHub's workflow commands: one per reason.

use cardan_compare::Report;

/// Annotations of one step that GitHub shows.
const MOST: usize = 10;

/// The lines to be said; none where the verdict is pass.
pub(super) fn annotations(report: &Report) -> Vec<String> {
    let title = format!("cardan compare: {} on {}", report.app, report.scenario);
    let mut lines: Vec<String> = report
        .reasons
        .iter()
        .take(MOST)
        .map(|reason| {
            format!(
                "::error title={}::{}",
                property(&title),
                data(&reason.to_string())
            )
        })
        .collect();
    if let Some(last) = lines.last_mut()
        && report.reasons.len() > MOST
    {
        last.push_str(&format!(
            " (and {} reasons more)",
            report.reasons.len() - MOST
        ));
    }
    lines
}

fn data(text: &str) -> String {
    text.replace('%', "%25")
        .replace('\r', "%0D")
        .replace('\n', "%0A")
}

fn property(text: &str) -> String {
    data(text).replace(':', "%3A").replace(',', "%2C")
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardan_compare::Reason;

    #[test]
    fn every_reason_is_one_line_and_nothing_in_it_ends_the_command() {
        let report = |reasons: usize| {
            let mut report = cardan_compare::compare(&cardan_compare::Comparison::default());
            report.app = "a:b".into();
            report.reasons = vec![Reason::Stale("50 %\nworse".into()); reasons];
            report
        };
        let lines = annotations(&report(2));
        assert_eq!(lines.len(), 2);
        assert!(
            lines[0]
                .starts_with("::error title=cardan compare%3A a%3Ab on ::image: 50 %25%0Aworse")
        );
        assert!(annotations(&report(0)).is_empty());
        let many = annotations(&report(14));
        assert!(many.len() == 10 && many[9].ends_with("(and 4 reasons more)"));
    }
}

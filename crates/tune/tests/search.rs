//! The search finds optima, is the same on any number of threads, and goes on from a journal.

mod common;

use cardan_tune::{Method, Options, Outcome, TuneError, tune};
use common::problem;

fn quiet(problem: &cardan_tune::Problem, options: &Options) -> Result<Outcome, TuneError> {
    tune(problem, options, None, &mut |_| {})
}

fn options(budget: &str) -> Options {
    Options {
        pareto: Vec::new(),
        threads: 2,
        ..Options::new([budget])
    }
}

#[test]
fn the_result_does_not_depend_on_the_number_of_threads() {
    let problem = problem(300);
    let with = |threads| Options {
        threads,
        ..options("y.rms<=1e-3")
    };
    let one = quiet(&problem, &with(1)).expect("runs");
    let three = quiet(&problem, &with(3)).expect("runs");
    assert!(one.feasible);
    assert_eq!(
        Outcome {
            seconds: 0.0,
            ..one
        },
        Outcome {
            seconds: 0.0,
            ..three
        }
    );
}

#[test]
fn every_method_meets_the_budget_and_none_beats_the_optimum() {
    let problem = problem(200);
    let mut bits = Vec::new();
    for (method, name) in Method::ALL {
        let widths = (8..18).collect();
        let outcome = quiet(
            &problem,
            &Options {
                method,
                widths,
                ..options("y.rms<=2e-3")
            },
        )
        .expect("runs");
        assert!(outcome.feasible, "{name}");
        assert!(outcome.best.error.expect("measured") <= 2e-3, "{name}");
        bits.push((name, outcome.best.bits));
    }
    let optimum = bits
        .iter()
        .find(|(name, _)| *name == "exhaustive")
        .expect("ran")
        .1;
    assert!(bits.iter().all(|(_, bits)| *bits >= optimum), "{bits:?}");
    let uniform = bits
        .iter()
        .find(|(name, _)| *name == "uniform")
        .expect("ran")
        .1;
    let default = bits
        .iter()
        .find(|(name, _)| *name == "sensitivity")
        .expect("ran")
        .1;
    assert!(default < uniform, "{bits:?}");
}

#[test]
fn an_impossible_budget_is_infeasible_and_names_what_binds() {
    let problem = problem(100);
    let widths = (4..12).collect();
    let outcome = quiet(
        &problem,
        &Options {
            widths,
            ..options("y.rms<=1e-9")
        },
    )
    .expect("runs");
    assert!(!outcome.feasible);
    assert_eq!(outcome.binding.as_deref(), Some("y.rms<=1e-9"));
    assert!(outcome.best.error.expect("the closest point is measured") > 1e-9);
}

#[test]
fn locked_nodes_keep_their_formats_and_coupled_ones_share_a_length() {
    let problem = problem(200);
    let outcome = quiet(
        &problem,
        &Options {
            locked: vec!["cube".into()],
            coupled: vec![vec!["square".into(), "held".into()]],
            ..options("y.rms<=1e-3")
        },
    )
    .expect("runs");
    let format = |name: &str| {
        outcome
            .best
            .formats
            .0
            .iter()
            .find(|(n, _)| n == name)
            .expect("is there")
            .1
    };
    assert_eq!(format("cube"), problem.nodes[2].format);
    assert_eq!(format("square").word, format("held").word);
}

#[test]
fn an_interrupted_search_goes_on_from_its_journal() {
    let problem = problem(200);
    let folder = tempfile::tempdir().expect("temporary folder");
    let journal = folder.path().join("search.journal");
    let with = |evaluations| Options {
        journal: Some(journal.clone()),
        evaluations,
        ..options("y.rms<=1e-3")
    };
    let whole = quiet(&problem, &options("y.rms<=1e-3")).expect("runs");
    quiet(&problem, &with(Some(20))).expect("runs");
    // Cut in the middle of a record.
    let text = std::fs::read(&journal).expect("is written");
    std::fs::write(&journal, &text[..text.len() - 7]).expect("can be cut");
    let resumed = quiet(&problem, &with(None)).expect("runs");
    assert_eq!(resumed.best, whole.best);
    assert_eq!(resumed.evaluations, whole.evaluations);
    assert!(
        resumed
            .warnings
            .iter()
            .any(|warning| warning.contains("cut off"))
    );

    // Another budget's journal is refused and left as it is.
    let before = std::fs::read(&journal).expect("is there");
    let other = Options {
        budget: vec!["y.max<=1e-3".into()],
        ..with(None)
    };
    assert!(matches!(
        quiet(&problem, &other),
        Err(TuneError::Journal(_))
    ));
    assert_eq!(std::fs::read(&journal).expect("is there"), before);
}

#[test]
fn bad_budgets_and_options_are_told_with_what_is_admissible() {
    let problem = problem(50);
    let told = |options: Options| match quiet(&problem, &options) {
        Err(error) => error.to_string(),
        Ok(_) => panic!("is refused"),
    };
    let budget = |text: &str| told(options(text));
    assert!(
        budget("z.rms<=1").contains("y.rms"),
        "{}",
        budget("z.rms<=1")
    );
    assert!(budget("y.rmss<=1").contains("did you mean 'rms'?"));
    assert!(budget("sqnr(squar)>=60dB").contains("did you mean 'square'?"));
    assert!(budget("sqnr(square)<=60dB").contains("expected '>='"));
    assert!(budget("y.rms<=-1").contains("above 0"));
    assert!(budget("y.rms<=x").contains("not a number"));
    assert!(budget("nonsense").contains("expected NAME"));
    assert!(budget("truth.y.rms<=1").contains("no truth"));
    assert!(
        told(Options {
            locked: vec!["outptu".into()],
            ..options("y.rms<=1")
        })
        .contains("'output'")
    );
    assert!(
        told(Options {
            widths: vec![65],
            ..options("y.rms<=1")
        })
        .contains("1 to 32")
    );
    assert!(
        told(Options {
            budget: Vec::new(),
            ..options("")
        })
        .contains("at least one")
    );
}

#[test]
fn a_journal_cut_or_glued_anywhere_gives_the_same_result() {
    let problem = problem(200);
    let folder = tempfile::tempdir().expect("temporary folder");
    let journal = folder.path().join("search.journal");
    let with = |budget: &str| Options {
        journal: Some(journal.clone()),
        ..options(budget)
    };
    let whole = quiet(&problem, &with("y.rms<=1e-3")).expect("runs");
    let own = std::fs::read(&journal).expect("is written");
    std::fs::remove_file(&journal).expect("is there");
    quiet(&problem, &with("y.max<=1e-3")).expect("runs");
    let foreign = std::fs::read(&journal).expect("is written");
    let header = own.iter().position(|&byte| byte == b'\n').expect("a line") + 1;
    let at = |share: usize| own.len() * share / 7;
    let mut pieces = vec![
        own[..0].to_vec(),
        own[..header / 2].to_vec(),
        own[..header].to_vec(),
        own[header..].to_vec(),
        [&own[..], &own].concat(),
        [&own[..at(4)], &foreign].concat(),
        [&foreign[..], &own].concat(),
        [&own[..at(2)], &own[at(3)..]].concat(),
        [
            &own[..at(5)],
            &own[at(1)..at(2)],
            b"\xff\x00\n",
            &own[at(2)..],
        ]
        .concat(),
    ];
    pieces.extend((1..7).map(|share| own[..at(share)].to_vec()));
    // A digit that changed on the disk.
    let digit = own.iter().rposition(u8::is_ascii_digit).expect("numbers");
    let mut changed = own.clone();
    changed[digit - 2] = if changed[digit - 2] == b'1' {
        b'2'
    } else {
        b'1'
    };
    pieces.push(changed);
    for (number, piece) in pieces.iter().enumerate() {
        std::fs::write(&journal, piece).expect("written");
        let resumed = quiet(&problem, &with("y.rms<=1e-3")).expect("goes on");
        assert_eq!(resumed.best, whole.best, "piece {number}");
        assert_eq!(resumed.evaluations, whole.evaluations, "piece {number}");
        // What was evaluated again is kept again.
        let kept = std::fs::read(&journal).expect("is there");
        assert!(kept.len() >= own.len(), "piece {number}");
    }
    std::fs::write(&journal, "a text of somebody's\n").expect("written");
    assert!(matches!(
        quiet(&problem, &with("y.rms<=1e-3")),
        Err(TuneError::Journal(_))
    ));
}

//! What the guide says holds: the three datapaths are tuned within their budgets, and a run of the
//! compiled arithmetic is the trial's, bit for bit.

use bring_your_own::nodes::{BiquadOutput, FirOutput, NODES, PiOutput};
use bring_your_own::{Biquad, Fir, Pi, problem, signal};
use cardan_datapath::{DEFAULT_DOMAIN_FLAG, Deployed, Format, Node};
use cardan_numerics::tape::Tape;
use cardan_numerics::trial::Trial;
use cardan_numerics::{Algorithm, Datapath, DeployedRecorder, Steps};
use cardan_tune::{Options, ranges, tune};

fn assert_tuned<A: Datapath>(datapath: &A, name: &str, node: usize, budget: &str) {
    let problem =
        problem(datapath, name, node, &signal(600, 1), &signal(600, 2)).expect("is steady");
    let others = NODES.iter().filter(|node| !node.name.starts_with(name));
    let options = Options {
        locked: others.map(|node| node.name.to_owned()).collect(),
        pareto: Vec::new(),
        ..Options::new([budget])
    };
    let outcome = tune(&problem, &options, None, &mut |_| {}).expect("runs");
    assert!(outcome.feasible, "{:?}", outcome.best.reached);
    let bits = |formats: &[(String, Format)]| -> u32 {
        let own = formats.iter().filter(|(node, _)| node.starts_with(name));
        own.map(|(_, format)| format.word).sum()
    };
    let deployed: u32 = NODES
        .iter()
        .filter(|node| node.name.starts_with(name))
        .map(|node| node.format.word)
        .sum();
    assert!(
        bits(&outcome.best.formats.0) < deployed,
        "fewer than one would begin with"
    );
}

fn assert_bit_equal<A: Datapath>(datapath: &A) {
    let steps = signal(1500, 3);
    let m = Deployed::new(DeployedRecorder::new(NODES.len()));
    Steps {
        datapath,
        inputs: &steps,
    }
    .run(&m);
    let expected = m.tap().take();
    let (tape, inputs) = Tape::record(datapath, &steps).expect("is steady");
    let formats: Vec<Format> = NODES.iter().map(|node| node.format).collect();
    let mut trial = Trial::new(&tape, &inputs, DEFAULT_DOMAIN_FLAG);
    trial.run_all(&formats);
    let mut compared = 0;
    for (node, info) in NODES.iter().enumerate() {
        let Some(write) = tape.last_write(node) else {
            continue;
        };
        let per_step = expected.raws[node].len() / steps.len();
        for step in trial.steps() {
            let word = expected.raws[node][step * per_step + per_step - 1];
            assert_eq!(
                trial.column(write).get(step),
                word,
                "{} in step {step}",
                info.name
            );
        }
        compared += 1;
    }
    // Three nodes or more of each datapath, over steps of which hardly any belong to the start-up.
    assert!(compared >= 3, "{compared} nodes");
    assert!(trial.steps().count() > 1400, "{:?}", trial.steps());
}

#[test]
fn the_biquad_is_tuned() {
    assert_bit_equal(&Biquad);
    assert_tuned(&Biquad, "biquad", BiquadOutput::INDEX, "biquad.rms<=2e-4");
}

#[test]
fn the_fir_is_tuned() {
    assert_bit_equal(&Fir);
    assert_tuned(&Fir, "fir", FirOutput::INDEX, "fir.rms<=1e-4");
}

#[test]
fn the_pi_controller_is_tuned() {
    assert_bit_equal(&Pi);
    assert_tuned(&Pi, "pi", PiOutput::INDEX, "pi.max<=0.01");
}

#[test]
fn a_filter_without_feedback_is_proven_and_the_limits_of_the_controller_are_seen() {
    let fir = problem(
        &Fir,
        "fir",
        FirOutput::INDEX,
        &signal(100, 1),
        &signal(100, 2),
    )
    .expect("is steady");
    let found = ranges(&fir, 1, 0, 1);
    let proven = |name: &str| {
        found
            .nodes
            .iter()
            .find(|node| node.name == name)
            .expect("is there")
            .proven
    };
    assert!(proven("fir_product") && proven("fir_sum"));
    let pi =
        problem(&Pi, "pi", PiOutput::INDEX, &signal(100, 1), &signal(100, 2)).expect("is steady");
    let found = ranges(&pi, 1, 0, 1);
    let output = found
        .nodes
        .iter()
        .find(|node| node.name == "pi_output")
        .expect("is there");
    assert!(
        output.proven && output.derived.hi.is_some_and(|hi| hi < 16.0),
        "{output:?}"
    );
}

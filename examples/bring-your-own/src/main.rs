//! Tunes the three datapaths and prints what was found.
//!
//! `cargo run --release -p bring-your-own`

use bring_your_own::nodes::{BiquadOutput, FirOutput, NODES, PiOutput};
use bring_your_own::{Biquad, Fir, Pi, problem, signal};
use cardan_datapath::Node;
use cardan_numerics::Datapath;
use cardan_tune::{Options, output, tune};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    show(&Biquad, "biquad", BiquadOutput::INDEX, "biquad.rms<=2e-4")?;
    show(&Fir, "fir", FirOutput::INDEX, "fir.rms<=1e-4")?;
    show(&Pi, "pi", PiOutput::INDEX, "pi.max<=0.01")
}

fn show<A: Datapath>(
    datapath: &A,
    name: &str,
    node: usize,
    budget: &str,
) -> Result<(), Box<dyn std::error::Error>> {
    let problem = problem(datapath, name, node, &signal(2000, 1), &signal(2000, 2))?;
    // Nodes of the other datapaths stay as they are.
    let others = NODES.iter().filter(|node| !node.name.starts_with(name));
    let options = Options {
        locked: others.map(|node| node.name.to_owned()).collect(),
        pareto: Vec::new(),
        ..Options::new([budget])
    };
    let outcome = tune(&problem, &options, None, &mut |_| {})?;
    println!(
        "# {budget}: {} bits, every node 32 bit {}, {} candidates in {:.1} s, held out: {}",
        outcome.best.bits,
        outcome.baseline.bits,
        outcome.evaluations,
        outcome.seconds,
        if outcome.verified {
            "within the budget"
        } else {
            "missed"
        }
    );
    let text = output::wordlengths(&outcome, &problem.nodes, "cargo run -p bring-your-own");
    let own = format!("name = \"{name}");
    for table in text.split("\n\n").filter(|table| table.contains(&own)) {
        println!("{table}\n");
    }
    Ok(())
}

//! A board, its clock and scripted experiences.

use std::iter::Peekable;

use cardan_frontend::Frontend;
use cardan_frontend::design::nominal_edges;
use cardan_frontend::switching::Edge;
use cardan_scenario::{Experience, Scenario, Stimulus};
use cardan_spec::Channel;
use cardan_spec::timing::CPU_HZ;
use cardan_units::Cycles;

/// An experience that is a function of time.
pub(crate) struct Script<F>(pub(crate) F);

impl<F: Fn(f64) -> Experience> Stimulus for Script<F> {
    fn at(&self, t_s: f64) -> Experience {
        (self.0)(t_s)
    }
}

pub(crate) fn constant(force_x: f64, field_y: f64) -> Script<impl Fn(f64) -> Experience> {
    Script(move |_| Experience {
        specific_force_g: [force_x, 0.0, -1.0],
        field_ut: [0.0, field_y, 40.0],
        ..Experience::default()
    })
}

pub(crate) fn quiet() -> Scenario {
    let mut scenario = Scenario::default();
    scenario.noise.enabled = false;
    scenario
}

/// Pushes the edges up to `cycle`.
pub(crate) fn clock<S: Stimulus>(
    board: &mut Frontend<S>,
    edges: &mut Peekable<impl Iterator<Item = Edge>>,
    cycle: u64,
) {
    while let Some(edge) = edges.next_if(|edge| edge.cycle <= cycle) {
        board
            .pin_edge(Cycles(edge.cycle), edge.pin, edge.high)
            .expect("in order");
    }
}

/// Voltages of one channel at the given times.
pub(crate) fn voltages<S: Stimulus>(
    scenario: &Scenario,
    seed: u64,
    stimulus: S,
    channel: Channel,
    times_s: impl Iterator<Item = f64>,
) -> Vec<f64> {
    let mut board = Frontend::new(scenario, seed, stimulus).expect("a working design");
    let mut edges = nominal_edges().peekable();
    times_s
        .map(|t| {
            let cycle = (t * CPU_HZ as f64) as u64;
            clock(&mut board, &mut edges, cycle);
            board.voltage(Cycles(cycle), channel).expect("in order").0
        })
        .collect()
}

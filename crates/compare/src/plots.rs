//! What the page draws, kept in little memory: extremes over stretches of time.

use cardan_outputs::{Group, Is};
use cardan_page::plot::Envelope;

use crate::input::Comparison;
use crate::series::{Chain, Series};

/// Points of a curve at most; more cannot be told apart on a screen.
const POINTS: usize = 1200;
/// Stretches of an envelope or of the flagged stripes.
const STRETCHES: usize = 500;
/// The same for the small plots of nodes.
const NODE_STRETCHES: usize = 200;

/// The curves of a run.
#[derive(Clone, Debug, Default)]
pub struct Plots {
    /// 1 in solutions with a status bit.
    pub(crate) flagged: Envelope,
    /// By member, in the shown unit.
    pub(crate) members: Vec<MemberPlot>,
    /// Size of the whole group's error over unflagged solutions, against truth and against golden.
    pub(crate) error: [Envelope; 2],
    /// By node: the difference that is judged, in the node's unit, over unflagged solutions.
    pub(crate) nodes: Vec<Envelope>,
}

/// A member over time.
#[derive(Clone, Debug)]
pub(crate) struct MemberPlot {
    pub(crate) device: Envelope,
    /// The truth, and golden on the same inputs.
    pub(crate) references: [Envelope; 2],
}

impl Plots {
    pub(crate) fn new(facts: &Comparison, group: &Group) -> Self {
        let member = |_| MemberPlot {
            device: Envelope::new(POINTS),
            references: [Envelope::new(POINTS), Envelope::new(POINTS)],
        };
        Self {
            flagged: Envelope::new(STRETCHES),
            members: group.members.iter().map(member).collect(),
            error: [Envelope::new(STRETCHES), Envelope::new(STRETCHES)],
            nodes: vec![Envelope::new(NODE_STRETCHES); facts.nodes.len()],
        }
    }

    /// Adds a node's differences, one per value; what is not a number is not drawn.
    pub(crate) fn node(&mut self, index: usize, differences: &[f64]) {
        for &difference in differences {
            self.nodes[index].push(Some(difference).filter(|difference| difference.is_finite()));
        }
    }

    /// Adds a solution of a window.
    pub(crate) fn solution(
        &mut self,
        group: &Group,
        chain: &Chain,
        device: Option<&Series>,
        solution: usize,
        is_clean: bool,
    ) {
        self.flagged.push(Some(if is_clean { 0.0 } else { 1.0 }));
        let device = device.and_then(|device| device.at(solution));
        let references = [Is::Truth, Is::Golden]
            .map(|is| chain.values(is).and_then(|values| values.at(solution)));
        for (at, (member, plot)) in group.members.iter().zip(&mut self.members).enumerate() {
            // Angles are drawn within one turn.
            let shown = |values: &[f64]| member.difference(values[at], 0.0);
            plot.device.push(device.map(shown));
            for (envelope, values) in plot.references.iter_mut().zip(references) {
                envelope.push(values.map(shown));
            }
        }
        for (envelope, reference) in self.error.iter_mut().zip(references) {
            let size = match (device, reference) {
                (Some(device), Some(reference)) if is_clean => group.size(device, reference),
                _ => None,
            };
            envelope.push(size);
        }
    }
}

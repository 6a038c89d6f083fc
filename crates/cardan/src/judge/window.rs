//! A window of a session as it is compared.

use cardan_compare::{
    Chain, Comparison, Frames, Messages, Node, RoundingStep, Series, StageValues,
};
use cardan_outputs::{Is, Message, Status};

use super::Session;
use crate::participants::diff::Collected;

impl Session<'_> {
    /// What was published, by what it is compared with.
    pub(super) fn window(&self, collected: &Collected) -> Comparison {
        let decode = |frames: &[Vec<u8>]| -> Vec<Result<Message, String>> {
            frames
                .iter()
                .map(|frame| self.setup.app.decode(frame))
                .collect()
        };
        let (native, emulated) = (
            decode(&collected.native_frames),
            decode(&collected.emulated_frames),
        );
        // A message that cannot be read counts as flagged throughout.
        let status = |message: &Result<Message, String>| {
            message.as_ref().map_or(u32::MAX, |message| message.status)
        };
        let nodes = self.facts.nodes.iter().enumerate();
        let nodes: Vec<Node> = nodes
            .map(|(at, node)| self.node(at, node, collected))
            .collect();
        Comparison {
            frames: Frames {
                native: collected.native_frames.clone(),
                emulated: collected.emulated_frames.clone(),
            },
            flags: native.iter().map(status).collect(),
            outputs: self.facts.outputs.clone(),
            chain: self.chain(collected, &nodes, &emulated),
            messages: Messages { native, emulated },
            status: statuses(collected),
            tuned: self.facts.tuned.clone(),
            nodes,
            ..Comparison::default()
        }
    }

    fn node(&self, at: usize, facts: &Node, collected: &Collected) -> Node {
        let index = self.indices[at];
        let words = |streams: &std::collections::BTreeMap<usize, Vec<i64>>| {
            streams.get(&index).cloned().unwrap_or_default()
        };
        let golden = self.golden[at].map(|node| collected.golden.get(&node));
        Node {
            native: words(&collected.native),
            emulated: (facts.emulated.as_ref()).map(|_| words(&collected.emulated)),
            real: Some(collected.real.get(&index).cloned().unwrap_or_default()),
            expected: Some(collected.expected.get(&index).cloned().unwrap_or_default()),
            golden: golden.map(|values| values.cloned().unwrap_or_default()),
            ..facts.clone()
        }
    }

    /// The values along the chain: of stages that are published as such, or of the nodes that hold them.
    fn chain(
        &self,
        collected: &Collected,
        nodes: &[Node],
        emulated: &[Result<Message, String>],
    ) -> Chain {
        let Some(group) = &self.facts.outputs.group else {
            return Chain::default();
        };
        let width = group.members.len();
        let of_nodes = |values: &dyn Fn(&Node) -> Option<Vec<f64>>| {
            let members = group.members.iter().map(|member| {
                let node = nodes.iter().find(|node| node.name == member.node);
                node.and_then(values).unwrap_or_default()
            });
            series(width, &members.collect::<Vec<_>>())
        };
        let scaled = |node: &Node, words: &[i64]| -> Vec<f64> {
            words.iter().map(|&raw| raw as f64 * node.lsb).collect()
        };
        let published = |place: usize| {
            let values = collected.stages.get(&place);
            values.map_or_else(|| Series::new(width), |values| series(width, values))
        };
        let facts = &self.facts.chain;
        let stages = facts.stages.iter().enumerate().map(|(place, facts)| {
            let values = match facts.stage.is {
                Is::Truth | Is::Model => published(place),
                Is::Golden => of_nodes(&|node| node.golden.clone()),
                Is::Real => of_nodes(&|node| node.real.clone()),
                Is::Native => of_nodes(&|node| Some(scaled(node, &node.native))),
                Is::Emulated if self.setup.firmware.taps.is_some() => {
                    of_nodes(&|node| Some(scaled(node, node.emulated.as_deref()?)))
                }
                Is::Emulated => self.of_messages(width, emulated),
            };
            StageValues {
                stage: facts.stage.clone(),
                values,
            }
        });
        let first_step = facts.stages.len();
        let steps = facts
            .steps
            .iter()
            .enumerate()
            .map(|(node, step)| RoundingStep {
                node: step.node.clone(),
                values: published(first_step + node),
            });
        Chain {
            stages: stages.collect(),
            steps: steps.collect(),
        }
    }

    /// The group's members as messages tell them.
    fn of_messages(&self, width: usize, messages: &[Result<Message, String>]) -> Series {
        let outputs = &self.facts.outputs;
        let members = outputs.group.iter().flat_map(|group| &group.members);
        let places: Option<Vec<usize>> = members
            .map(|member| {
                let mut quantities = outputs.quantities.iter();
                quantities.position(|quantity| quantity.name == member.name)
            })
            .collect();
        let values = |message: &Result<Message, String>| -> Option<Vec<f64>> {
            let message = message.as_ref().ok()?;
            let value = |&place: &usize| message.values.get(place).copied();
            places.as_ref()?.iter().map(value).collect()
        };
        Series::of(width, messages.iter().map(values))
    }
}

/// Members side by side, as far as all of them go.
fn series(width: usize, members: &[Vec<f64>]) -> Series {
    let count = members.iter().map(Vec::len).min().unwrap_or(0);
    let at = |solution: usize| {
        let values = members.iter().map(|values| values[solution]);
        Some(values.collect::<Vec<f64>>())
    };
    Series::of(width, (0..count).map(at))
}

/// Golden's status of each solution; the real interpretation knows which bits rounding decides.
fn statuses(collected: &Collected) -> Vec<Status> {
    let doubts = collected.real_status.iter().map(|real| real.doubtful);
    collected
        .golden_status
        .iter()
        .zip(doubts.chain(std::iter::repeat(0)))
        .map(|(golden, doubtful)| Status {
            set: golden.set,
            doubtful,
        })
        .collect()
}

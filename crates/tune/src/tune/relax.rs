//! Rounding and overflow mode per node: what costs least and still meets the budget.

use cardan_datapath::{Format, Overflow, Rounding};
use cardan_numerics::tape::{Interval, affine_bounds, beyond};

use super::Run;
use crate::noise::sensitivities;

impl Run<'_> {
    /// Rounding down wherever it costs no more than to nearest and the budget allows, wrapping wherever
    /// it costs no more than saturation and no input can overflow.
    pub(super) fn relax(&mut self, formats: &mut Vec<Format>, margin: f64) {
        let mut order = self.quietest_first(formats);
        let quiet = order.iter().take_while(|(_, share)| *share == 0.0).count();
        let nodes: Vec<usize> = order.drain(..).map(|(node, _)| node).collect();
        // Those that the model sees no effect of, at once; the others one by one.
        let mut steps: Vec<&[usize]> = vec![&nodes[..quiet]];
        steps.extend(nodes.chunks(1));
        for step in steps {
            let mut next = formats.clone();
            for &node in step {
                next[node].rounding = Rounding::Floor;
            }
            if next != *formats && self.cost(&next) <= self.cost(formats) {
                self.evaluations += 1;
                if self.is_within(&self.pool.score(&next), margin) {
                    *formats = next;
                }
            }
        }
        let derived = self.derived(formats);
        let beyond = self.beyond(formats);
        for &node in &nodes {
            let mut next = formats.clone();
            next[node].overflow = Overflow::Wrap;
            if formats[node].overflow == Overflow::Saturate
                && self.cost(&next) <= self.cost(formats)
                && derived.iter().all(|case| fits(case[node], formats[node]))
                && beyond[node].is_none()
            {
                *formats = next;
            }
        }
    }

    /// Free nodes with their largest shares of the error, ascending.
    fn quietest_first(&self, formats: &[Format]) -> Vec<(usize, f64)> {
        let noise = sensitivities(self.problem, formats, false, self.options.seed);
        let share = |node: usize| {
            let own = noise
                .iter()
                .filter(|n| n.node == self.problem.nodes[node].name);
            own.fold(0.0, |worst: f64, n| worst.max(n.share))
        };
        let free = self.space.groups.iter().flat_map(|group| &group.nodes);
        let mut order: Vec<(usize, f64)> = free.map(|&node| (node, share(node))).collect();
        order.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
        order
    }

    /// Derived bounds of every node in every case. A node that is proven not to overflow has the same
    /// ones after it wraps.
    fn derived(&self, formats: &[Format]) -> Vec<Vec<Option<Interval>>> {
        let cases = self.problem.cases();
        let derived = cases.map(|case| affine_bounds(&case.tape, &case.ports, formats));
        derived.collect()
    }

    /// Per node a constant, setting or table entry that it does not hold in some case.
    pub(super) fn beyond(&self, formats: &[Format]) -> Vec<Option<f64>> {
        let none = vec![None; formats.len()];
        self.problem.cases().fold(none, |all, case| {
            let own = beyond(&case.tape, formats);
            all.into_iter().zip(own).map(|(a, b)| a.or(b)).collect()
        })
    }

    /// Names of the nodes that no input within the ports' bounds makes overflow in `formats`, by the
    /// bounds of these formats in every case.
    pub(super) fn proven(&self, formats: &[Format]) -> Vec<String> {
        let (derived, beyond) = (self.derived(formats), self.beyond(formats));
        let is_proven = |node: &usize| {
            let holds = |case: &Vec<Option<Interval>>| {
                case[*node].is_none_or(|bound| bound.fits(formats[*node]))
            };
            beyond[*node].is_none() && derived.iter().all(holds)
        };
        let nodes = (0..formats.len()).filter(is_proven);
        nodes
            .map(|node| self.problem.nodes[node].name.to_owned())
            .collect()
    }
}

fn fits(bound: Option<Interval>, format: Format) -> bool {
    bound.is_some_and(|bound| bound.fits(format))
}

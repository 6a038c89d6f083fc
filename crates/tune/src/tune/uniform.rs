//! One word length for all nodes.

use cardan_datapath::Format;

use super::{Options, Run};
use crate::evaluate::Score;
use crate::pool::Pool;
use crate::space::{LONGEST, Levels, Space};

/// All free nodes with one word length.
pub(super) struct Uniform {
    pub(super) word: u32,
    pub(super) formats: Vec<Format>,
    score: Score,
}

/// Every length, with the integer bits of each space.
pub(super) fn all(options: &Options, pool: &Pool<'_>, spaces: [&Space; 2]) -> Vec<Uniform> {
    let mut words = options.effective_widths();
    if words.is_empty() {
        words = (1..=LONGEST).collect();
    }
    let each = words
        .iter()
        .flat_map(|&word| spaces.map(|space| (word, space.uniform(word))));
    let (words, batch): (Vec<u32>, Vec<Vec<Format>>) = each.unzip();
    let scores = pool.scores(&batch, false);
    let all = words.into_iter().zip(batch).zip(scores);
    all.map(|((word, formats), score)| Uniform {
        word,
        formats,
        score,
    })
    .collect()
}

impl Run<'_> {
    /// The cheapest that meets the limits times `margin`.
    pub(super) fn uniform_at(&self, margin: f64) -> Option<&Uniform> {
        let all = self.uniforms.iter();
        let within = all.filter(|uniform| self.is_within(&uniform.score, margin));
        within.min_by(|a, b| {
            let costs = (self.cost(&a.formats), self.cost(&b.formats));
            costs.0.total_cmp(&costs.1).then(a.word.cmp(&b.word))
        })
    }

    /// As a choice of the search.
    pub(super) fn uniform_levels(&self, margin: f64) -> Option<Levels> {
        let word = self.uniform_at(margin)?.word;
        let level = |group: &crate::space::Group| {
            let at = group.widths.iter().position(|&width| width >= word)?;
            u8::try_from(at).ok()
        };
        self.space.groups.iter().map(level).collect()
    }
}

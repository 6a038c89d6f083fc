//! Where and when a stage left its linear range: there the model is no longer exact.

use cardan_spec::Channel;

/// A stage of the chain that can saturate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// First amplifier.
    Lna,
    /// Band-pass.
    BandPass,
    /// Output amplifier, at the rails: clipped as it would be.
    Output,
}

impl Stage {
    const ALL: [Stage; 3] = [Stage::Lna, Stage::BandPass, Stage::Output];
}

/// Saturation of one stage of one channel.
///
/// After `Output` alone the model stays exact: the rails clip a static stage. After `Lna` or
/// `BandPass` it does not: the model goes on linearly and the voltages from there on are too large.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Saturation {
    /// The channel.
    pub channel: Channel,
    /// The stage.
    pub stage: Stage,
    /// First cycle at which it was seen.
    pub first_cycle: u64,
    /// At how many looks it was seen.
    pub instants: u64,
}

/// What one channel has seen.
#[derive(Clone, Debug, Default)]
pub(crate) struct Watch {
    seen: [Option<(u64, u64)>; Stage::ALL.len()],
}

impl Watch {
    /// Notes a look at `stage`.
    #[inline]
    pub(crate) fn see(&mut self, stage: Stage, cycle: u64, saturated: bool) {
        if saturated {
            let (_, count) = self.seen[stage as usize].get_or_insert((cycle, 0));
            *count += 1;
        }
    }

    /// Everything seen, for `channel`.
    pub(crate) fn report(&self, channel: Channel) -> impl Iterator<Item = Saturation> + '_ {
        Stage::ALL.into_iter().filter_map(move |stage| {
            let (first_cycle, instants) = self.seen[stage as usize]?;
            Some(Saturation {
                channel,
                stage,
                first_cycle,
                instants,
            })
        })
    }
}

//! The golden model as an engine.

use cardan_golden::Golden;
use cardan_spec::{Channel, REFERENCE_V, flags};
use cardan_units::{AdcCode, Volts, ideal_bipolar_code};

use super::{calibration_of, words_of};
use crate::app::{Configuration, Feed};
use crate::engine::{Conversion, Engine, EngineError, Sink};

/// The golden model on one of its feeds. Nodes are indices into the shared nodes' table.
pub(super) struct GoldenEngine {
    golden: Golden,
    feed: Feed,
    /// A conversion of this solution came late, or not at all.
    late: bool,
    /// What the current conversion caused.
    writes: Vec<(usize, f64)>,
}

impl GoldenEngine {
    pub(super) fn new(configuration: &Configuration, feed: Feed) -> Self {
        let calibration = calibration_of(&words_of(configuration));
        Self {
            golden: Golden::with_averaging(&calibration, configuration.averaging()),
            feed,
            late: false,
            writes: Vec::new(),
        }
    }
}

impl Engine for GoldenEngine {
    fn conversion(
        &mut self,
        conversion: &Conversion,
        sink: &mut dyn Sink,
    ) -> Result<(), EngineError> {
        let channel = Channel::of(conversion.channel)
            .ok_or_else(|| EngineError::Input(format!("channel {}", conversion.channel)))?;
        let code = AdcCode(conversion.code);
        let fed = match self.feed {
            Feed::Codes => f64::from(code.bipolar()),
            Feed::IdealVolts => {
                ideal_bipolar_code(Volts(conversion.ideal_volts), Volts(REFERENCE_V))
            }
            Feed::Experienced => conversion.experienced_code,
            Feed::Direct => conversion.direct_code,
        };
        // Only real codes can clip; the other feeds have no rails.
        let clipped = self.feed == Feed::Codes && code.is_clipped();
        self.golden
            .third_tilt(conversion.third_tilt.and_then(|third| match self.feed {
                Feed::Codes | Feed::IdealVolts => Some(third.upside_down),
                Feed::Experienced | Feed::Direct => third.truly_upside_down,
            }));
        self.late |= conversion.late || conversion.lost;
        let solution = self
            .golden
            .convert(channel, fed, clipped, &mut |node, value| {
                self.writes.push((node, value));
            });
        for (node, value) in self.writes.drain(..) {
            sink.real(node, value, conversion.cycle)?;
        }
        if let Some(solution) = solution {
            let late = std::mem::take(&mut self.late);
            let status = solution.flags | if late { flags::LATE } else { 0 };
            sink.status(status, 0, conversion.cycle)?;
        }
        Ok(())
    }
}

//! The analog chain with track-and-hold, stepped exactly between controller events.
//!
//! Per channel: sensor -> first amplifier -> band-pass -> track-and-hold pair, (H+ - H-)/2 ->
//! second-order low-pass -> output amplifier around mid supply -> converter pin. [`switching`] tells
//! how the controller's pins drive it, [`chain`] gives the equations, [`design`] the gains, corners
//! and the group delay. The controller pushes edges in cycle order and asks for the voltage of a pin
//! at an exact cycle; a channel is advanced only then, by matrix exponentials from event to event.
//!
//! What is held: the sensors' inputs over each carrier period (62.5 us) at their value in its
//! middle. What is not exact: a saturated filter, see [`Frontend::saturations`].

pub mod adc;
pub mod chain;
mod channel;
pub mod design;
mod error;
pub mod matrix;
pub mod pattern;
pub mod propagate;
mod saturation;
pub mod switching;

use cardan_scenario::experience::REFERENCE_K;
use cardan_scenario::random::{Random, Source};
use cardan_scenario::{Scenario, Stimulus};
use cardan_sensors::{Accelerometer, Axis, Flicker, Magnetometer};
use cardan_spec::timing::CPU_HZ;
use cardan_spec::{CHANNELS, Channel as Name};
use cardan_units::{Cycles, Volts};

pub use adc::AdcErrors;
pub use design::Design;
pub use error::Error;
pub use saturation::{Saturation, Stage};
pub use switching::Pin;

use chain::Chain;
use channel::{Channel, FLICKER_PERIODS, Inputs, Stages, Unit};
use design::{ChainDesign, PERIOD_CYCLES};
use pattern::Patterns;
use switching::{Edge, EdgeQueue, Switching};

/// Waiting edges at which all channels are brought up to date, so that the queue stays short even
/// if nobody asks for a voltage.
const MOST_WAITING: usize = 8192;

/// The board's analog side with its four channels.
#[derive(Clone, Debug)]
pub struct Frontend<S> {
    channels: [Channel; CHANNELS],
    design: Design,
    inputs: Inputs<S>,
    edges: EdgeQueue,
    levels: [bool; 2],
    /// Latest edge pushed or voltage asked for.
    reached: u64,
}

impl<S: Stimulus> Frontend<S> {
    /// The board of `scenario` with the noise of `seed`, experiencing `stimulus`; both pins low.
    ///
    /// # Errors
    /// Parameters that give no working design together.
    pub fn new(scenario: &Scenario, seed: u64, stimulus: S) -> Result<Self, Error> {
        let design = Design::new(scenario)?;
        let mut inputs = Inputs::new(stimulus);
        let channels = Name::ALL.map(|name| build(scenario, &design, name, seed, &mut inputs));
        let (edges, levels) = (EdgeQueue::default(), [false; 2]);
        Ok(Self {
            channels,
            design,
            inputs,
            edges,
            levels,
            reached: 0,
        })
    }

    /// Gains, corners, group delay.
    #[must_use]
    pub fn design(&self) -> &Design {
        &self.design
    }

    /// A pin of the controller takes `high` at `cycle`; the same level again is no edge.
    ///
    /// # Errors
    /// `cycle` lies before an earlier edge or reading.
    pub fn pin_edge(&mut self, cycle: Cycles, pin: Pin, high: bool) -> Result<(), Error> {
        self.reach(cycle)?;
        let level = &mut self.levels[pin as usize];
        if *level == high {
            return Ok(());
        }
        *level = high;
        self.edges.push(Edge {
            cycle: cycle.0,
            pin,
            high,
        });
        if self.edges.waiting() > MOST_WAITING {
            self.catch_up();
        }
        Ok(())
    }

    /// Voltage at a converter pin at `cycle`: the ideal voltage, without the converter's errors.
    ///
    /// # Errors
    /// `cycle` lies before an earlier reading of this channel, or before an edge that the channel
    /// has already passed.
    pub fn voltage(&mut self, cycle: Cycles, name: Name) -> Result<Volts, Error> {
        let channel = &mut self.channels[name as usize];
        if cycle.0 < channel.now() {
            return Err(Error::OutOfOrder {
                cycle: cycle.0,
                reached: channel.now(),
            });
        }
        self.reached = self.reached.max(cycle.0);
        let volts = channel.voltage(cycle.0, &self.edges, &mut self.inputs);
        self.edges.drop_before(
            self.channels
                .iter()
                .map(Channel::next_edge)
                .min()
                .unwrap_or(0),
        );
        Ok(Volts(volts))
    }

    /// Every stage that left its linear range, with channel, first cycle and count.
    #[must_use]
    pub fn saturations(&self) -> Vec<Saturation> {
        let each = self.channels.iter().zip(Name::ALL);
        each.flat_map(|(channel, name)| channel.watch().report(name))
            .collect()
    }

    fn reach(&mut self, cycle: Cycles) -> Result<(), Error> {
        if cycle.0 < self.reached {
            return Err(Error::OutOfOrder {
                cycle: cycle.0,
                reached: self.reached,
            });
        }
        self.reached = cycle.0;
        Ok(())
    }

    /// Advances every channel to the last whole period before the latest edge.
    fn catch_up(&mut self) {
        let cycle = self.reached / PERIOD_CYCLES * PERIOD_CYCLES;
        for channel in &mut self.channels {
            if channel.now() < cycle {
                channel.advance(cycle, &self.edges, &mut self.inputs);
            }
        }
        self.edges.drop_before(
            self.channels
                .iter()
                .map(Channel::next_edge)
                .min()
                .unwrap_or(0),
        );
    }
}

fn build<S: Stimulus>(
    scenario: &Scenario,
    design: &Design,
    name: Name,
    seed: u64,
    inputs: &mut Inputs<S>,
) -> Channel {
    let noisy = scenario.noise.enabled;
    let axis = match name {
        Name::TiltX | Name::FieldX => Axis::X,
        Name::TiltY | Name::FieldY => Axis::Y,
    };
    let index = name as u8;
    let (unit, sensor, chain_design, strobe, flicker) = match name {
        Name::TiltX | Name::TiltY => {
            let unit = Accelerometer::new(&scenario.sensors.accelerometer, axis);
            let (density, corner_hz) = unit.flicker();
            let interval_s = (FLICKER_PERIODS * PERIOD_CYCLES) as f64 / CPU_HZ as f64;
            let flicker = (noisy && corner_hz > 0.0)
                .then(|| Flicker::new(density, corner_hz, interval_s, seed, index));
            let sensor = unit.linear();
            (Unit::Tilt(unit), sensor, design.tilt, Pin::Strobe, flicker)
        }
        Name::FieldX | Name::FieldY => {
            let unit = Magnetometer::new(&scenario.sensors.magnetometer, axis);
            let sensor = unit.linear(REFERENCE_K);
            (Unit::Field(unit), sensor, design.field, Pin::Carrier, None)
        }
    };
    let ChainDesign {
        band_pass_gain,
        low_pass_hz,
        ..
    } = chain_design;
    let parameters = &scenario.frontend;
    let chain = Chain {
        sensor,
        parameters,
        band_pass_gain,
        low_pass_hz,
        noisy,
    };
    Channel::new(
        unit,
        Stages::new(parameters, band_pass_gain),
        Patterns::new(&chain, CPU_HZ),
        Switching::new(strobe, parameters.aperture_cycles as u64),
        Random::new(seed, Source::Channel(index)),
        flicker,
        inputs.during(0),
    )
}

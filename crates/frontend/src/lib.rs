//! The analog chain with track-and-hold, stepped exactly between controller events.
//!
//! Per channel: sensor -> first amplifier -> band-pass -> track-and-hold pair, (H+ - H-)/2 ->
//! second-order low-pass -> output amplifier around mid supply -> converter pin. The two tilt channels
//! share one band-pass behind a multiplexer. [`switching`] tells how the controller's pins drive it,
//! [`chain`] gives the equations, [`design`] the gains, corners, the group delay and what a turn
//! leaves of the neighbour. The controller pushes edges in cycle order and asks for the voltage of a
//! pin at an exact cycle; a channel is advanced only then, by matrix exponentials from event to event.
//!
//! The shared band-pass has its two states in the system of the channel that has it. Where the
//! multiplexer switches, both channels are advanced to that cycle and the states are handed over. The
//! deselected channel goes on with a copy that stands for nothing: nobody samples or watches it.
//!
//! A third tilt channel along body z, where the scenario fits it, is a chain of the same kind beside
//! the four, with a band-pass of its own: it ends at the controller's comparator ([`Frontend::third_tilt`])
//! or, where it is measured, at a fifth pin of the converter.
//!
//! What is approximated: the sensors' inputs run straight between their exact values every 125 us.
//! That is h^2/8 times their second derivative, under 1e-6 V for motion of 1 Hz over the whole
//! scale (steps held at mid-interval cost 7e-6 V: with a reversing drive they make a force in
//! quadrature, of which sampling after an aperture of 1 us sees a tenth). What is not exact: a
//! saturated filter, see [`Frontend::saturations`].

pub mod adc;
pub mod chain;
mod channel;
pub mod chopping;
pub mod design;
mod error;
pub mod matrix;
pub mod pattern;
pub mod propagate;
mod sampler;
mod saturation;
pub mod switching;
mod turns;

use std::collections::VecDeque;

use cardan_scenario::scenario::Sensors;
use cardan_scenario::{Experience, Scenario, Stimulus};
use cardan_sensors::{Accelerometer, Axis, Magnetometer};
use cardan_spec::{
    CHANNELS, Channel as Name, FIELD_FULL_SCALE_UT, REFERENCE_V, TILT_FULL_SCALE_G, ThirdTilt,
};
use cardan_units::{Cycles, Volts};

pub use adc::AdcErrors;
pub use channel::Inner;
pub use design::Design;
pub use error::Error;
pub use saturation::{Saturation, Stage};
pub use switching::Pin;

use channel::{Channel, Inputs, Plan, SPAN_CYCLES, Unit};
use design::ChainDesign;
use sampler::Sampler;
use switching::{Edge, EdgeQueue, PINS, Wiring};

/// Waiting edges at which all channels are brought up to date, so that the queue stays short even
/// if nobody asks for a voltage.
const MOST_WAITING: usize = 8192;

/// The channels that share a band-pass, as [`Pin::Select`] low and high selects them.
const SHARING: [Name; 2] = [Name::TiltX, Name::TiltY];

/// The board's analog side with its four channels, and the third tilt axis where fitted.
#[derive(Clone, Debug)]
pub struct Frontend<S> {
    channels: [Channel; CHANNELS],
    third: Option<Channel>,
    /// It is on the converter, not on the comparator.
    third_is_measured: bool,
    design: Design,
    inputs: Inputs<S>,
    edges: EdgeQueue,
    levels: [bool; PINS],
    /// Edges of [`Pin::Select`] that have not yet handed over the band-pass.
    turns: VecDeque<Edge>,
    sampler: Sampler,
    /// Latest edge pushed or voltage asked for.
    reached: u64,
}

impl<S: Stimulus> Frontend<S> {
    /// The board of `scenario` with the noise of `seed`, experiencing `stimulus`; all pins low.
    ///
    /// # Errors
    /// Parameters that give no working design together.
    pub fn new(scenario: &Scenario, seed: u64, stimulus: S) -> Result<Self, Error> {
        let design = Design::new(scenario)?;
        let mut inputs = Inputs::new(stimulus);
        for name in Name::ALL {
            check_rest(&plan(scenario, &design, name), name)?;
        }
        let first = *inputs.at(0);
        let channels = Name::ALL
            .map(|name| Channel::new(plan(scenario, &design, name), seed, name as u8, &first));
        let kind = scenario.sensors.third_tilt;
        if kind == ThirdTilt::Measured {
            check_rest(&plan(scenario, &design, Name::TiltZ), Name::TiltZ)?;
        }
        let third = kind.is_fitted().then(|| {
            let plan = plan(scenario, &design, Name::TiltZ);
            Channel::new(plan, seed, Name::TiltZ as u8, &first)
        });
        let sampler = Sampler::new(&scenario.adc)?;
        Ok(Self {
            channels,
            third,
            third_is_measured: kind == ThirdTilt::Measured,
            design,
            inputs,
            edges: EdgeQueue::default(),
            levels: [false; PINS],
            turns: VecDeque::new(),
            sampler,
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
        let edge = Edge {
            cycle: cycle.0,
            pin,
            high,
        };
        self.edges.push(edge);
        if pin == Pin::Select {
            self.turns.push_back(edge);
        }
        if self.edges.waiting() > MOST_WAITING {
            self.catch_up();
        }
        Ok(())
    }

    /// Voltage on the converter's sampling capacitor when it holds a channel at `cycle`: the ideal
    /// voltage, without the converter's errors. Readings are conversions: each leaves its voltage on
    /// the capacitor for the next. 0 V at the fifth pin, unless the third tilt axis is measured.
    ///
    /// # Errors
    /// `cycle` lies before an earlier reading of this channel, or before an edge that the channel
    /// has already passed.
    pub fn voltage(&mut self, cycle: Cycles, name: Name) -> Result<Volts, Error> {
        let measured = self.third.as_ref().filter(|_| self.third_is_measured);
        let read = self.channels.get(name as usize).or(measured);
        let now = read.map_or(self.reached, Channel::now);
        if cycle.0 < now {
            return Err(Error::OutOfOrder {
                cycle: cycle.0,
                reached: now,
            });
        }
        self.reached = self.reached.max(cycle.0);
        if SHARING.contains(&name) {
            self.hand_over(cycle.0);
        }
        let measured = self.third.as_mut().filter(|_| self.third_is_measured);
        let volts = match (self.channels.get_mut(name as usize), measured) {
            (Some(channel), _) | (None, Some(channel)) => {
                channel.voltage(cycle.0, &self.edges, &mut self.inputs)
            }
            // Nothing is connected there.
            (None, None) => 0.0,
        };
        // At the comparator the third axis is read seldom; it follows by whole spans, while inputs are
        // remembered.
        let spans = cycle.0 / SPAN_CYCLES * SPAN_CYCLES;
        if let Some(third) = &mut self.third
            && !self.third_is_measured
            && third.now() < spans
        {
            third.advance(spans, &self.edges, &mut self.inputs);
        }
        self.drop_edges();
        Ok(Volts(self.sampler.take(volts)))
    }

    /// Voltage of the third tilt channel at `cycle`, which a comparator's input does not load: above
    /// mid supply where the specific force along body z is positive, which at rest is upside down.
    /// `None` where the scenario fits no third axis to the comparator.
    ///
    /// # Errors
    /// `cycle` lies before an earlier reading of this channel, or before an edge that the channel
    /// has already passed.
    pub fn third_tilt(&mut self, cycle: Cycles) -> Result<Option<Volts>, Error> {
        let compared = self.third.as_mut().filter(|_| !self.third_is_measured);
        let Some(channel) = compared else {
            return Ok(None);
        };
        if cycle.0 < channel.now() {
            return Err(Error::OutOfOrder {
                cycle: cycle.0,
                reached: channel.now(),
            });
        }
        self.reached = self.reached.max(cycle.0);
        let volts = channel.voltage(cycle.0, &self.edges, &mut self.inputs);
        self.drop_edges();
        Ok(Some(Volts(volts)))
    }

    /// Voltages inside a channel in the instant of its last reading.
    #[must_use]
    pub fn inner(&self, name: Name) -> Inner {
        let channel = self.channels.get(name as usize).or(self.third.as_ref());
        channel.map_or_else(Inner::default, Channel::inner)
    }

    /// Every stage that left its linear range, with channel, first cycle and count. (Not those of a
    /// third tilt axis at the comparator: only its sign counts, which saturation keeps.)
    #[must_use]
    pub fn saturations(&self) -> Vec<Saturation> {
        let measured = self.third.iter().filter(|_| self.third_is_measured);
        let each = self.channels.iter().chain(measured).zip(Name::MOST);
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

    /// Carries out the multiplexer's switching up to `cycle`: both channels go on to each switching,
    /// and the one selected takes the band-pass as the other leaves it. No channel is beyond it: one
    /// passes a switching only here.
    fn hand_over(&mut self, cycle: u64) {
        while let Some(turn) = self.turns.pop_front_if(|turn| turn.cycle <= cycle) {
            for name in SHARING {
                let channel = &mut self.channels[name as usize];
                channel.advance(turn.cycle, &self.edges, &mut self.inputs);
            }
            let [from, to] = [!turn.high, turn.high].map(|level| SHARING[usize::from(level)]);
            let states = self.channels[from as usize].band_pass();
            self.channels[to as usize].take_band_pass(states);
        }
    }

    /// Advances every channel to the last whole span before the latest edge.
    fn catch_up(&mut self) {
        let cycle = self.reached / SPAN_CYCLES * SPAN_CYCLES;
        self.hand_over(cycle);
        for channel in self.channels.iter_mut().chain(&mut self.third) {
            if channel.now() < cycle {
                channel.advance(cycle, &self.edges, &mut self.inputs);
            }
        }
        self.drop_edges();
    }

    /// Drops the edges that every channel has seen.
    fn drop_edges(&mut self) {
        let channels = self.channels.iter().chain(&self.third);
        self.edges
            .drop_before(channels.map(Channel::next_edge).min().unwrap_or(0));
    }
}

/// Refuses a unit that leaves the converter's range at rest: 1 g to either side, or no field at all.
fn check_rest(plan: &Plan, name: Name) -> Result<(), Error> {
    let (rest_g, full_scale, section) = match plan.unit {
        Unit::Tilt(_) => (1.0, TILT_FULL_SCALE_G, "sensors.accelerometer"),
        Unit::Field(_) => (0.0, FIELD_FULL_SCALE_UT, "sensors.magnetometer"),
    };
    for force in [-rest_g, rest_g] {
        let mut rest = Experience {
            specific_force_g: [0.0; 3],
            ..Experience::default()
        };
        let axis = if name == Name::TiltZ {
            2
        } else {
            name as usize % 2
        };
        rest.specific_force_g[axis] = force;
        let p = &plan.parameters;
        let offset = 1e-3 * p.output_offset_mv / (0.5 * REFERENCE_V);
        let share = plan.unit.input(&rest) / full_scale * (1.0 + p.gain_error) + offset;
        if share.abs() >= 1.0 {
            let message = format!(
                "{name:?} is driven to {:.0} % of its range at rest ({force} g along its axis, no \
                 field); expected under 100 %",
                100.0 * share
            );
            let keys = format!("{section}.* (offset, sensitivity, power) or frontend.gain_error");
            return Err(Error::design(&keys, &message));
        }
    }
    Ok(())
}

/// How channel `name` is built.
fn plan(scenario: &Scenario, design: &Design, name: Name) -> Plan {
    let sensors = &scenario.sensors;
    let (unit, design) = match name {
        Name::TiltX => (tilt(sensors, Axis::X), design.tilt),
        Name::TiltY => (tilt(sensors, Axis::Y), design.tilt),
        Name::FieldX => (field(sensors, Axis::X), design.field),
        Name::FieldY => (field(sensors, Axis::Y), design.field),
        Name::TiltZ => (tilt(sensors, Axis::Z), design.third_tilt),
    };
    build(scenario, unit, design, Wiring::of(name))
}

fn build(scenario: &Scenario, unit: Unit, design: ChainDesign, wiring: Wiring) -> Plan {
    let (parameters, noisy) = (scenario.frontend.clone(), scenario.noise.enabled);
    let clock_hz = scenario.clock_hz();
    Plan {
        unit,
        parameters,
        design,
        wiring,
        noisy,
        clock_hz,
    }
}

fn tilt(sensors: &Sensors, axis: Axis) -> Unit {
    Unit::Tilt(Accelerometer::new(&sensors.accelerometer, axis))
}

fn field(sensors: &Sensors, axis: Axis) -> Unit {
    Unit::Field(Magnetometer::new(&sensors.magnetometer, axis))
}

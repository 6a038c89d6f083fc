//! The signals of a dump: names on the command line to nodes, codes, voltages and pins.

use cardan_bench::App;
use cardan_emulator::Pin;
use cardan_frontend::Inner;
use cardan_spec::MOST_CHANNELS;

/// A signal that can be dumped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Signal {
    /// A node of the datapath, by index.
    Node(usize),
    /// The converter's codes.
    Code,
    /// The ideal voltage of a channel at its hold instants.
    Voltage(u8),
    /// A voltage inside the front end at the channel's hold instants.
    Inner(u8, Stage),
    /// A pin of the controller.
    Pin(Pin),
}

/// A place inside a channel of the front end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stage {
    BandPass,
    HoldPlus,
    HoldMinus,
    LowPass,
}

impl Stage {
    const ALL: [(Self, &'static str); 4] = [
        (Self::BandPass, "band_pass"),
        (Self::HoldPlus, "hold_plus"),
        (Self::HoldMinus, "hold_minus"),
        (Self::LowPass, "low_pass"),
    ];

    /// Its voltage; none for a band-pass that another channel has.
    pub(crate) fn of(self, inner: &Inner) -> Option<f64> {
        match self {
            Self::BandPass => inner.band_pass_v,
            Self::HoldPlus => Some(inner.hold_v[0]),
            Self::HoldMinus => Some(inner.hold_v[1]),
            Self::LowPass => Some(inner.low_pass_v),
        }
    }

    fn name(self) -> &'static str {
        let found = Self::ALL.iter().find(|(stage, _)| *stage == self);
        found.map_or("", |(_, name)| name)
    }
}

/// Name of the codes.
const CODE: &str = "code";
/// Pins of the controller: three ports of eight.
const PINS: u16 = 24;
/// What may be named, for messages.
const EXPECTED: &str = "expected a node, code, a pin (PB0 to PD7), adc0_V to adc4_V, or \
                        adc0_band_pass_V, adc0_hold_plus_V, adc0_hold_minus_V, adc0_low_pass_V (to \
                        adc4_...)";
/// Names that are less alike than this are no suggestions.
const ALIKE: f64 = 0.75;

impl Signal {
    /// The signal of that name.
    ///
    /// # Errors
    /// There is none; the message says which names there are, and the most similar.
    pub(crate) fn parse(name: &str, app: &dyn App) -> Result<Self, String> {
        if let Some(node) = app.nodes().iter().position(|node| node.name == name) {
            return Ok(Self::Node(node));
        }
        let name = name.strip_prefix("pin ").unwrap_or(name);
        if let Ok(pin) = name.parse() {
            return Ok(Self::Pin(pin));
        }
        let others = analog()
            .chain([Self::Code])
            .find(|signal| signal.name(app) == name);
        others.ok_or_else(|| unknown(name, app))
    }

    /// Its name; a node's is that of the application.
    pub(crate) fn name(self, app: &dyn App) -> String {
        match self {
            Self::Node(node) => app
                .nodes()
                .get(node)
                .map_or("", |node| node.name)
                .to_owned(),
            Self::Code => CODE.to_owned(),
            Self::Voltage(channel) => format!("adc{channel}_V"),
            Self::Inner(channel, stage) => format!("adc{channel}_{}_V", stage.name()),
            Self::Pin(pin) => pin.to_string(),
        }
    }

    /// Number under which `emulated` publishes it; none for what is published always.
    pub(crate) fn published(self) -> Option<u16> {
        match self {
            Self::Pin(pin) => Some(pin.index() as u16),
            Self::Inner(channel, stage) => {
                let stages = Stage::ALL.len() as u16;
                Some(PINS + u16::from(channel) * stages + stage as u16)
            }
            Self::Node(_) | Self::Code | Self::Voltage(_) => None,
        }
    }
}

/// All voltages.
fn analog() -> impl Iterator<Item = Signal> {
    (0..MOST_CHANNELS as u8).flat_map(|channel| {
        let inner = Stage::ALL.map(|(stage, _)| Signal::Inner(channel, stage));
        [Signal::Voltage(channel)].into_iter().chain(inner)
    })
}

fn unknown(name: &str, app: &dyn App) -> String {
    let nodes = app.nodes().iter().map(|node| node.name.to_owned());
    let known = nodes.chain(analog().map(|signal| signal.name(app)));
    let folded = name.to_ascii_lowercase();
    let alike = known.chain([CODE.to_owned()]).map(|known| {
        let alike = strsim::jaro_winkler(&folded, &known.to_ascii_lowercase());
        (alike, known)
    });
    match alike.max_by(|a, b| a.0.total_cmp(&b.0)) {
        Some((alike, known)) if alike > ALIKE => {
            format!("no such signal; did you mean `{known}`? {EXPECTED}")
        }
        _ => format!("no such signal; {EXPECTED}"),
    }
}

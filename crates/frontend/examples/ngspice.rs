//! The analog chain against ngspice on a netlist of the same chain: cost and held-output error side
//! by side. `cargo run --release -p cardan-frontend --example ngspice [-- FOLDER]`; needs Debian's
//! `ngspice`. Netlists and results are left in FOLDER (a temporary one by default).
//!
//! The netlist is written from the scenario's parameters, not from our matrices: sensors as
//! behavioural sources and integrators, the modulation as a product with the carrier, track-and-hold
//! as voltage-controlled switches that charge capacitors, filters as integrators. Both sides see the
//! same straight lines of sensor input, every 125 us, and the nominal edges. The tilt channels' netlist
//! has both sensors, the multiplexer as two switched sources into the one band-pass, and strobes that
//! an enable gates; y's part ends at the multiplexer, since its track-and-hold loads nothing. ngspice
//! has no error control that meets this chain (reltol leaves the phase error of its trapezoidal rule
//! alone), so its largest step is what is varied.

use std::error::Error;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::time::Instant;

use cardan_frontend::chain::{Chain, STATES};
use cardan_frontend::design::{ChainDesign, PERIOD_CYCLES, nominal_edges};
use cardan_frontend::{Design, Frontend, matrix};
use cardan_scenario::{Experience, Scenario, Stimulus, Trajectory};
use cardan_sensors::{Accelerometer, Axis, LinearSensor, Magnetometer, Modulation};
use cardan_spec::timing::{
    ADC_HOLD_CYCLES, CARRIER_COUNT, CONVERSION_CYCLES, CPU_HZ, HALF_CARRIER_CYCLES,
    SETTLING_CYCLES, STROBE_COUNT, TURN_CYCLES,
};
use cardan_spec::{CHANNELS, Channel, REFERENCE_V};
use cardan_units::Cycles;

/// Scenario without noise and without deviations that the netlist lacks.
const SCENARIO: &str = "tumble-quiet";
/// Simulated time: the slowest filter settles in a tenth of it.
const SECONDS: f64 = 0.2;
/// Runs of our side: on a shared machine the shortest counts.
const REPEATS: u32 = 20;
/// Largest steps of ngspice in seconds.
const STEPS: [f64; 3] = [1e-6, 0.5e-6, 0.25e-6];
/// Cycles from one straight line of input to the next, as in the front end.
const SPAN_CYCLES: u64 = 2 * PERIOD_CYCLES;
/// Rise and fall time of the sources that stand for pins: under a hundredth of a clock cycle.
const EDGE_S: f64 = 0.5e-9;

type Done<T> = Result<T, Box<dyn Error>>;

/// What stands at the converter when it holds, without the zero of the last amplifier, in volts.
struct AtHold {
    /// (H+ - H-)/2 times the gain that follows.
    held: f64,
    /// The pin's voltage.
    pin: f64,
}

fn main() -> Done<()> {
    let folder = std::env::args_os().nth(1).map_or_else(
        || std::env::temp_dir().join("cardan-ngspice"),
        PathBuf::from,
    );
    fs::create_dir_all(&folder)?;
    let scenario = Scenario::load(SCENARIO)?;
    check(&scenario)?;
    let trajectory = Arc::new(Trajectory::new(&scenario, 1)?);
    println!("{SCENARIO}, {SECONDS} s; seconds of the host per simulated second (user time)");
    let (ours, cost) = exact(&scenario, &trajectory)?;
    println!("exact stepping, four channels        {cost:>9.5} s/s");
    for (name, channel) in [("tilt_x", Channel::TiltX), ("field_x", Channel::FieldX)] {
        let chain = Circuit::new(&scenario, &trajectory, channel)?;
        for step_s in STEPS {
            let file = folder.join(format!("{name}-{:.0}ns.cir", step_s * 1e9));
            let (theirs, cost) = chain.simulate(&file, step_s)?;
            let worst = |of: fn(&AtHold) -> f64| {
                let pairs = ours[channel as usize].iter().zip(&theirs);
                pairs
                    .map(|(a, b)| (of(a) - of(b)).abs())
                    .fold(0.0, f64::max)
            };
            let (held, pin) = (worst(|at| at.held), worst(|at| at.pin));
            let lsb = REFERENCE_V / 1024.0;
            println!(
                "ngspice, {name:7}, steps of {:>5.0} ns  {cost:>9.2} s/s; largest difference of the \
                 held pair {:.3} mV, at the pin {:.3} mV ({:.3} LSB)",
                step_s * 1e9,
                held * 1e3,
                pin * 1e3,
                pin / lsb
            );
        }
    }
    println!("netlists and results: {}", folder.display());
    Ok(())
}

/// What the netlist does not model must be absent.
fn check(scenario: &Scenario) -> Done<()> {
    let p = &scenario.frontend;
    if scenario.noise.enabled || p.injection_plus_pc != 0.0 || p.injection_minus_pc != 0.0 {
        return Err("expected a scenario without noise and charge injection".into());
    }
    Ok(())
}

/// Our side: values at each channel's hold instants, and its cost.
fn exact(
    scenario: &Scenario,
    trajectory: &Arc<Trajectory>,
) -> Done<([Vec<AtHold>; CHANNELS], f64)> {
    let board = Frontend::new(scenario, 1, Arc::clone(trajectory))?;
    let mut best = f64::INFINITY;
    let mut values = Default::default();
    for _ in 0..REPEATS {
        let mut board = board.clone();
        let started = Instant::now();
        values = run(&mut board, scenario)?;
        best = best.min(started.elapsed().as_secs_f64());
    }
    Ok((values, best / SECONDS))
}

fn run<S: Stimulus>(board: &mut Frontend<S>, scenario: &Scenario) -> Done<[Vec<AtHold>; CHANNELS]> {
    let mut values: [Vec<AtHold>; CHANNELS] = Default::default();
    let gain = output_gain(scenario);
    let mut conversion = 0;
    let end = (SECONDS * CPU_HZ as f64) as u64;
    for edge in nominal_edges().take_while(|edge| edge.cycle <= end) {
        let hold = hold_cycle(conversion);
        if hold <= edge.cycle {
            let index = conversion as usize % CHANNELS;
            let channel = Channel::ALL[index];
            board.voltage(Cycles(hold), channel)?;
            let inner = board.inner(channel);
            values[index].push(AtHold {
                held: 0.5 * gain * (inner.hold_v[0] - inner.hold_v[1]),
                pin: gain * inner.low_pass_v,
            });
            conversion += 1;
        }
        board.pin_edge(Cycles(edge.cycle), edge.pin, edge.high)?;
    }
    Ok(values)
}

/// Cycle at which conversion number `conversion` holds: the strobe's match triggers it.
fn hold_cycle(conversion: u64) -> u64 {
    u64::from(STROBE_COUNT) + 1 + conversion * CONVERSION_CYCLES + ADC_HOLD_CYCLES
}

fn output_gain(scenario: &Scenario) -> f64 {
    scenario.frontend.output_gain * (1.0 + scenario.frontend.gain_error)
}

/// A channel's netlist, but for the step.
struct Circuit {
    text: String,
    first_hold_s: f64,
    every_s: f64,
    gain: f64,
}

impl Circuit {
    fn new(scenario: &Scenario, trajectory: &Trajectory, channel: Channel) -> Done<Self> {
        let Design { tilt, field, .. } = Design::new(scenario)?;
        let first = trajectory.at(0.0);
        let sensors = &scenario.sensors;
        let accelerometer = Accelerometer::new(&sensors.accelerometer, Axis::X);
        let magnetometer = Magnetometer::new(&sensors.magnetometer, Axis::X);
        type Input<'a> = Box<dyn Fn(&Experience) -> f64 + 'a>;
        let (sensor, design, strobe, input): (LinearSensor, ChainDesign, u16, Input<'_>) =
            match channel {
                Channel::TiltX => (
                    accelerometer.linear(),
                    tilt,
                    STROBE_COUNT,
                    Box::new(|at| accelerometer.input(at)),
                ),
                Channel::FieldX => (
                    magnetometer.linear(first.temperature_k),
                    field,
                    CARRIER_COUNT,
                    Box::new(|at| magnetometer.input(at)),
                ),
                other => return Err(format!("{other:?} is wired as the channel of x").into()),
            };
        let clock_hz = scenario.clock_hz();
        let mut text = format!("* {channel:?} of {SCENARIO}\n");
        source(&mut text, "in", trajectory, &input, clock_hz);
        pins(&mut text, scenario, strobe, clock_hz);
        let start = settled(scenario, &sensor, &design, input(&first))?;
        let shared = channel == Channel::TiltX;
        if shared {
            let other = Accelerometer::new(&sensors.accelerometer, Axis::Y);
            source(
                &mut text,
                "iny",
                trajectory,
                &|at| other.input(at),
                clock_hz,
            );
            let start = settled(scenario, &other.linear(), &design, other.input(&first))?;
            let gain = scenario.frontend.lna_gain * design.band_pass_gain;
            bridge(
                &mut text,
                ["y1", "y2"],
                "iny",
                &other.linear(),
                gain,
                &start,
            );
        }
        chain(&mut text, scenario, &sensor, &design, &start, shared);
        Ok(Self {
            text,
            first_hold_s: hold_cycle(channel as u64) as f64 / clock_hz,
            every_s: (CHANNELS as u64 * CONVERSION_CYCLES) as f64 / clock_hz,
            gain: output_gain(scenario),
        })
    }

    /// Runs ngspice; values at the hold instants (ngspice interpolates between its steps; the held
    /// voltages and the low-pass's output are smooth there), and user time per simulated second.
    fn simulate(&self, netlist: &Path, step_s: f64) -> Done<(Vec<AtHold>, f64)> {
        let results = netlist.with_extension("txt");
        let text = format!(
            "{}.tran {:e} {:e} {:e} {step_s:e} uic\n.save v(hp) v(hm) v(lp)\n.control\nrun\n\
             linearize v(hp) v(hm) v(lp)\nset wr_singlescale\nset numdgt=15\nwrdata {} v(hp) v(hm) \
             v(lp)\nquit\n.endc\n.end\n",
            self.text,
            self.every_s,
            SECONDS,
            self.first_hold_s,
            results.display(),
        );
        fs::write(netlist, text)?;
        let before = children_user_s();
        let started = Instant::now();
        let output = Command::new("ngspice")
            .arg("-b")
            .arg(netlist)
            .output()
            .map_err(|error| format!("ngspice: {error}; sudo apt-get install ngspice"))?;
        let wall = started.elapsed().as_secs_f64();
        let cost = match (before, children_user_s()) {
            (Some(before), Some(after)) => after - before,
            _ => wall,
        };
        let values = fs::read_to_string(&results).map_err(|error| {
            let said = String::from_utf8_lossy(&output.stderr);
            format!("{}: {error}; ngspice said: {said}", results.display())
        })?;
        Ok((self.instants(&values)?, cost / SECONDS))
    }

    /// Rows of time, H+, H-, low-pass.
    fn instants(&self, text: &str) -> Done<Vec<AtHold>> {
        let mut values = Vec::new();
        for line in text.lines() {
            let numbers: Vec<f64> = line
                .split_whitespace()
                .map(str::parse)
                .collect::<Result<_, _>>()?;
            let [_, plus, minus, low_pass] = numbers[..] else {
                return Err(format!("expected four numbers, not {line:?}").into());
            };
            values.push(AtHold {
                held: 0.5 * self.gain * (plus - minus),
                pin: self.gain * low_pass,
            });
        }
        Ok(values)
    }
}

/// A sensor's input as straight lines between its values every span.
fn source(
    text: &mut String,
    name: &str,
    trajectory: &Trajectory,
    input: &dyn Fn(&Experience) -> f64,
    clock_hz: f64,
) {
    let _ = writeln!(text, "V{name} {name} 0 PWL(");
    let spans = (SECONDS * CPU_HZ as f64) as u64 / SPAN_CYCLES + 1;
    for span in 0..=spans {
        let cycle = (span * SPAN_CYCLES) as f64;
        let value = input(&trajectory.at(cycle / CPU_HZ as f64));
        let _ = writeln!(text, "+ {:.12e} {value:.17e}", cycle / clock_hz);
    }
    text.push_str("+ )\n");
}

/// Carrier, and the pulses of the monostables: the strobe's rising edges close H-, its falling ones
/// H+, those of the tilt channel only in its turns once settled. A switch's control passes its
/// threshold in the middle of an edge, which stands at the cycle.
fn pins(text: &mut String, scenario: &Scenario, strobe: u16, clock_hz: f64) {
    let seconds = |cycles: f64| cycles / clock_hz;
    let half = HALF_CARRIER_CYCLES as f64;
    let mut pulse = |name: &str, low: i32, from: f64, width: f64, period: f64| {
        let _ = writeln!(
            text,
            "V{name} {name} 0 PULSE({low} 1 {:.12e} {EDGE_S:e} {EDGE_S:e} {:.12e} {:.12e})",
            seconds(from) - EDGE_S / 2.0,
            seconds(width) - EDGE_S,
            seconds(period),
        );
    };
    let rise = f64::from(strobe) + 1.0;
    let aperture = scenario.frontend.aperture_cycles;
    let (turn, settling) = (TURN_CYCLES as f64, SETTLING_CYCLES as f64);
    let gated = strobe == STROBE_COUNT;
    let [minus, plus] = if gated { ["rm", "rp"] } else { ["cm", "cp"] };
    pulse("car", -1, f64::from(CARRIER_COUNT) + 1.0, half, 2.0 * half);
    pulse(minus, 0, rise, aperture, 2.0 * half);
    pulse(plus, 0, rise + half, aperture, 2.0 * half);
    if gated {
        pulse("sel", 0, turn, turn, 2.0 * turn);
        pulse("en", 0, settling, turn - settling, 2.0 * turn);
        text.push_str("Bcm cm 0 V=V(rm)*V(en)\nBcp cp 0 V=V(rp)*V(en)\n");
    }
}

/// Per second: keeps currents and capacitors of a size that ngspice's tolerances are made for.
const RATE: f64 = 1e6;

/// A node that a current of its derivative charges in one farad per unit of [`RATE`].
fn state(text: &mut String, node: &str, derivative: &str) {
    let _ = writeln!(text, "B{node} 0 {node} I=({derivative})/{RATE:e}");
    let _ = writeln!(text, "C{node} {node} 0 {:e}", 1.0 / RATE);
}

/// The bridge of the tilt channel that shares the band-pass: its sensor's two states.
fn bridge(
    text: &mut String,
    nodes: [&str; 2],
    input: &str,
    sensor: &LinearSensor,
    gain: f64,
    start: &[f64; STATES],
) {
    let (a, b, [one, two]) = (&sensor.a, &sensor.b, nodes);
    for (row, node) in nodes.into_iter().enumerate() {
        let derivative = format!(
            "({:.17e})*V({one})+({:.17e})*V({two})+({:.17e})*V({input})",
            a[row][0],
            a[row][1],
            gain * b[row]
        );
        state(text, node, &derivative);
        let _ = writeln!(text, ".ic V({node})={:.17e}", start[row]);
    }
}

/// Sensor, band-pass (behind the multiplexer if it is shared), track-and-hold, low-pass; a node per
/// state.
fn chain(
    text: &mut String,
    scenario: &Scenario,
    sensor: &LinearSensor,
    design: &ChainDesign,
    start: &[f64; STATES],
    shared: bool,
) {
    let p = &scenario.frontend;
    let turn = 2.0 * std::f64::consts::PI;
    let (w, gain) = (turn * p.band_pass_hz, p.lna_gain * design.band_pass_gain);
    let (width, low) = (w / p.band_pass_quality, turn * design.low_pass_hz);
    let (bias, drive) = match sensor.modulation {
        Modulation::Bias => ("V(car)", "1"),
        Modulation::Drive => ("1", "V(car)"),
    };
    let mut state = |node: &str, derivative: String| state(text, node, &derivative);
    let (a, b, c) = (&sensor.a, &sensor.b, &sensor.c);
    for (row, node) in ["s1", "s2"].into_iter().enumerate() {
        let free = format!("({:.17e})*V(s1)+({:.17e})*V(s2)", a[row][0], a[row][1]);
        state(
            node,
            format!("{free}+({:.17e})*{drive}*V(in)", gain * b[row]),
        );
    }
    let signal =
        |one: &str, two: &str| format!("(({:.17e})*V({one})+({:.17e})*V({two}))", c[0], c[1]);
    let selected = match shared {
        true => format!(
            "({}*(1-V(sel))+{}*V(sel))",
            signal("s1", "s2"),
            signal("y1", "y2")
        ),
        false => signal("s1", "s2"),
    };
    let bridge = format!("{selected}*{bias}");
    let leak = format!("({:.17e})*V(car)", gain * sensor.feedthrough_v);
    state(
        "bp",
        format!("{width:.17e}*({bridge}+{leak}-V(bp))-{w:.17e}*V(bq)"),
    );
    state("bq", format!("{w:.17e}*V(bp)"));
    state("lp", format!("{low:.17e}*V(lr)"));
    let pair = "0.5*(V(hp)-V(hm))";
    let root = std::f64::consts::SQRT_2;
    state("lr", format!("{low:.17e}*({pair}-V(lp)-{root:.17e}*V(lr))"));
    let _ = writeln!(text, "Ebuffer bb 0 bp 0 1");
    for (hold, control) in [("hp", "cp"), ("hm", "cm")] {
        let _ = writeln!(text, "S{hold} bb {hold} {control} 0 hold off");
        let _ = writeln!(text, "C{hold} {hold} 0 {:e}", p.hold_pf * 1e-12);
        let _ = writeln!(text, "R{hold} {hold} 0 {:e}", p.leak_ohm);
    }
    let ohm = p.switch_ohm;
    let _ = writeln!(text, ".model hold SW(vt=0.5 vh=0 ron={ohm:e} roff=1e15)");
    let nodes = ["s1", "s2", "bp", "bq", "hp", "hm", "lp", "lr"];
    for (node, volts) in nodes.into_iter().zip(start) {
        let _ = writeln!(text, ".ic V({node})={volts:.17e}");
    }
}

/// States at reset: settled under the low carrier, both switches open.
fn settled(
    scenario: &Scenario,
    sensor: &LinearSensor,
    design: &ChainDesign,
    input: f64,
) -> Done<[f64; STATES]> {
    let chain = Chain {
        sensor: *sensor,
        parameters: &scenario.frontend,
        band_pass_gain: design.band_pass_gain,
        low_pass_hz: design.low_pass_hz,
        noisy: false,
    };
    let system = chain.system(0);
    let mut drive = [0.0; STATES];
    matrix::add_scaled(&mut drive, &system.b[0], -input);
    matrix::add_scaled(&mut drive, &system.b[1], -1.0);
    let start = matrix::solve(&system.a, &drive);
    start.ok_or_else(|| "the chain has no rest".into())
}

/// User time of ended child processes, where the system tells (Linux: proc(5), field 16).
fn children_user_s() -> Option<f64> {
    /// Linux counts in these units wherever it runs.
    const TICKS_PER_S: f64 = 100.0;
    let stat = fs::read_to_string("/proc/self/stat").ok()?;
    let after_name = stat.rsplit_once(')')?.1;
    let ticks: f64 = after_name.split_whitespace().nth(13)?.parse().ok()?;
    Some(ticks / TICKS_PER_S)
}

//! Measures an image by running it in the emulator, instruction by instruction.
//!
//! Every solution sees other voltages, anywhere between the rails and on them, from a fixed
//! sequence; the last solutions are sent as text, which needs the deepest stack. The calibration
//! is the nominal one (the EEPROM is empty), and for a second run that of a device that measures its third
//! tilt axis. So the figures are those of a varied run, not bounds.

use cardan_bench::attitude::nominal_eeprom;
use cardan_emulator::{
    ATMEGA328P, AnalogInput, Environment, Image, Machine, Memory, Pin, SerialByte, Stop,
};
use cardan_spec::frame::COMMAND_TEXT;
use cardan_spec::timing::{Averaging, CPU_HZ, pins};
use cardan_spec::{CHANNELS, REFERENCE_V, ThirdTilt};
use serde::Serialize;

use crate::failure::Failure;

/// Solutions measured in binary mode.
pub(super) const SOLUTIONS: u64 = 120;
/// Solutions in text mode after them, for the stack.
pub(super) const TEXT_SOLUTIONS: u64 = 20;
/// Bytes of code per interrupt vector.
const VECTOR_BYTES: u32 = 4;
/// Vector of the converter, which is the sample interrupt.
const SAMPLE_VECTOR: &str = "ADC";
/// The status register's interrupt enable.
const INTERRUPT_ENABLE: u8 = 0x80;

/// What an image needs.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Measured {
    /// Program memory: code, constants and initial values.
    pub(crate) flash_bytes: usize,
    /// Program memory of the chip.
    pub(crate) flash_size: usize,
    /// Static data; `null` if the image does not tell.
    pub(crate) ram_bytes: Option<u32>,
    /// RAM of the chip.
    pub(crate) ram_size: u32,
    /// Stack at its deepest; `null` where nothing is there that runs the image.
    pub(crate) stack_bytes: Option<u32>,
    /// From the first cycle of the entry to the last of RETI.
    pub(crate) sample_interrupt_cycles: Option<Spread>,
    /// From the solving pin's rise to its fall, interrupts included.
    pub(crate) solution_cycles: Option<Spread>,
    /// The same without interrupts.
    pub(crate) solution_own_cycles: Option<Spread>,
    /// Share of the time in which the processor does not sleep.
    pub(crate) cpu_load: Option<f64>,
    /// The same of a device that measures its third tilt axis; `null` if it was not asked for.
    pub(crate) measured_third_axis: Option<Run>,
}

/// What a run shows.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Run {
    pub(crate) stack_bytes: u32,
    pub(crate) sample_interrupt_cycles: Option<Spread>,
    pub(crate) solution_cycles: Option<Spread>,
    pub(crate) solution_own_cycles: Option<Spread>,
    pub(crate) cpu_load: f64,
}

/// Largest and mean of a number of spans.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub(crate) struct Spread {
    pub(crate) max: u64,
    pub(crate) mean: f64,
    pub(crate) count: u64,
    #[serde(skip)]
    sum: u64,
}

impl Spread {
    fn add(&mut self, value: u64) {
        self.count += 1;
        self.sum += value;
        self.max = self.max.max(value);
        self.mean = self.sum as f64 / self.count as f64;
    }

    fn if_any(self) -> Option<Self> {
        (self.count > 0).then_some(self)
    }
}

/// Runs the image from the bytes of file `name`.
pub(crate) fn measure(name: &str, elf: &[u8]) -> Result<Measured, Failure> {
    let image = Image::parse(name, elf, &ATMEGA328P).map_err(Failure::input)?;
    let run = run_as(name, &image, ThirdTilt::Absent)?;
    Ok(Measured {
        flash_bytes: image.flash.len(),
        flash_size: ATMEGA328P.flash_bytes,
        ram_bytes: static_data(&image),
        ram_size: ATMEGA328P.sram_bytes.into(),
        stack_bytes: Some(run.stack_bytes),
        sample_interrupt_cycles: run.sample_interrupt_cycles,
        solution_cycles: run.solution_cycles,
        solution_own_cycles: run.solution_own_cycles,
        cpu_load: Some(run.cpu_load),
        measured_third_axis: None,
    })
}

/// The same with a run of a device that measures its third tilt axis.
pub(crate) fn measure_both(name: &str, elf: &[u8]) -> Result<Measured, Failure> {
    let image = Image::parse(name, elf, &ATMEGA328P).map_err(Failure::input)?;
    Ok(Measured {
        measured_third_axis: Some(run_as(name, &image, ThirdTilt::Measured)?),
        ..measure(name, elf)?
    })
}

/// Runs the image as a device with this third tilt axis.
fn run_as(name: &str, image: &Image, third_tilt: ThirdTilt) -> Result<Run, Failure> {
    let mut machine = Machine::new(&ATMEGA328P, CPU_HZ);
    machine.load(image);
    if third_tilt != ThirdTilt::Absent {
        let settings = nominal_eeprom(third_tilt);
        machine.eeprom_mut()[..settings.len()].copy_from_slice(&settings);
    }
    let averaging = Averaging::DEFAULT.with(third_tilt);
    let mut probe = Probe::new(averaging)?;
    let block = averaging.block_cycles();
    let binary = averaging.warm_up_cycles() + SOLUTIONS * block;
    run(&mut machine, &mut probe, binary, name)?;
    let asleep = machine.statistics().sleeping_cycles;
    let cpu_load = 1.0 - asleep as f64 / machine.cycle() as f64;
    let (sample, solution, own) = (probe.sample, probe.solution, probe.own);
    probe.command = Some(COMMAND_TEXT);
    run(
        &mut machine,
        &mut probe,
        binary + TEXT_SOLUTIONS * block,
        name,
    )?;
    Ok(Run {
        stack_bytes: (ATMEGA328P.ram_end() - machine.statistics().lowest_sp).into(),
        sample_interrupt_cycles: sample.if_any(),
        solution_cycles: solution.if_any(),
        solution_own_cycles: own.if_any(),
        cpu_load,
    })
}

/// Bytes from the first initialised to the last uninitialised variable, by the linker's symbols.
fn static_data(image: &Image) -> Option<u32> {
    let address = |name: &str| {
        let symbol = image.symbol(name)?;
        (symbol.memory == Memory::Data).then_some(symbol.address)
    };
    let end = address("__noinit_end").max(address("__bss_end"))?;
    end.checked_sub(address("__data_start")?)
}

/// Runs step by step and measures interrupts by their entry and by the stack after RETI.
fn run(machine: &mut Machine, probe: &mut Probe, until: u64, name: &str) -> Result<(), Failure> {
    let vectors = 1..ATMEGA328P.vectors.len() as u32;
    let mut handlers: Vec<Handler> = Vec::new();
    while machine.cycle() < until {
        let (cycle, sp, enabled) = (machine.cycle(), machine.sp(), is_enabled(machine));
        if let Some(stop) = machine.step(probe) {
            return Err(stopped(name, machine, &stop));
        }
        let vector = machine.pc() / VECTOR_BYTES;
        let is_entry = enabled
            && !is_enabled(machine)
            && machine.pc().is_multiple_of(VECTOR_BYTES)
            && vectors.contains(&vector)
            && machine.sp() == sp.wrapping_sub(2);
        if is_entry {
            handlers.push(Handler {
                vector,
                begin: cycle,
                sp,
            });
        } else if let Some(handler) = handlers.pop_if(|handler| handler.sp == machine.sp()) {
            probe.handled(&handler, machine.cycle(), handlers.is_empty());
        }
    }
    Ok(())
}

fn is_enabled(machine: &Machine) -> bool {
    machine.sreg() & INTERRUPT_ENABLE != 0
}

fn stopped(name: &str, machine: &Machine, stop: &Stop) -> Failure {
    let what = match stop {
        Stop::Crash(crash) => crash.to_string(),
        other => format!("{other:?} at {:#06x}", machine.pc()),
    };
    Failure::input(format!(
        "{name}: the image does not run to be measured: {what}"
    ))
}

/// An interrupt handler that runs.
struct Handler {
    vector: u32,
    begin: u64,
    /// Stack pointer before the entry and after RETI.
    sp: u16,
}

/// The environment: voltages in, the solving pin out.
struct Probe {
    solving: Pin,
    block_cycles: u64,
    sample: Spread,
    solution: Spread,
    own: Spread,
    /// Cycles spent in interrupt handlers so far.
    handled: u64,
    /// Cycle at which the solving pin rose, and `handled` then.
    risen: Option<(u64, u64)>,
    command: Option<u8>,
}

impl Probe {
    fn new(averaging: Averaging) -> Result<Self, Failure> {
        Ok(Self {
            solving: pins::SOLVING.parse().map_err(Failure::input)?,
            block_cycles: averaging.block_cycles(),
            sample: Spread::default(),
            solution: Spread::default(),
            own: Spread::default(),
            handled: 0,
            risen: None,
            command: None,
        })
    }

    fn handled(&mut self, handler: &Handler, end: u64, is_outermost: bool) {
        let cycles = end - handler.begin;
        if is_outermost {
            self.handled += cycles;
        }
        if ATMEGA328P.vectors.get(handler.vector as usize) == Some(&SAMPLE_VECTOR) {
            self.sample.add(cycles);
        }
    }
}

impl Environment for Probe {
    fn pin_edge(&mut self, cycle: u64, pin: Pin, level: bool) {
        if pin != self.solving {
            return;
        }
        if level {
            self.risen = Some((cycle, self.handled));
        } else if let Some((begin, handled)) = self.risen.take() {
            self.solution.add(cycle - begin);
            self.own.add(cycle - begin - (self.handled - handled));
        }
    }

    fn analog(&mut self, cycle: u64, input: AnalogInput) -> f64 {
        match input {
            AnalogInput::Pin(channel) => voltage(cycle / self.block_cycles, channel),
            _ => 0.0,
        }
    }

    fn uart_rx(&mut self, cycle: u64) -> Option<SerialByte> {
        let byte = self.command.take()?;
        Some(SerialByte {
            start_cycle: cycle,
            byte,
            ninth: false,
        })
    }
}

/// A voltage that differs from solution to solution: a quarter of them at a rail, the others
/// anywhere between.
pub(super) fn voltage(solution: u64, channel: u8) -> f64 {
    // A fifth channel's numbers are its own.
    let own = u64::from(usize::from(channel) >= CHANNELS) << 32;
    let number = scrambled(own + solution * CHANNELS as u64 + u64::from(channel));
    let between = (number >> 11) as f64 / (1u64 << 53) as f64;
    match number & 7 {
        0 => 0.0,
        1 => REFERENCE_V,
        _ => REFERENCE_V * between,
    }
}

/// SplitMix64 (Steele, Lea, Flood 2014): a different, evenly spread number for every input.
fn scrambled(index: u64) -> u64 {
    let mut z = (index + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use cardan_bench::App;
    use cardan_bench::attitude::Attitude;

    use super::*;

    #[test]
    fn a_device_that_measures_its_third_axis_converts_five_channels_in_the_same_solutions() {
        for tapped in [false, true] {
            let elf = Attitude.bundled(tapped).expect("bundled");
            let measured = measure_both("bundled", elf).expect("runs");
            let third = measured.measured_third_axis.clone().expect("asked for");
            println!("{measured:?}");
            let of = |spread: Option<Spread>| spread.expect("measured");
            let four = of(measured.sample_interrupt_cycles);
            let five = of(third.sample_interrupt_cycles);
            // A conversion more or less at the ends, and text mode is not counted.
            assert!((five.count * 4).abs_diff(four.count * 5) < 8 * 64);
            assert!(
                five.max.abs_diff(four.max) <= 4,
                "{} and {}",
                five.max,
                four.max
            );
            let solutions = of(third.solution_own_cycles);
            assert_eq!(solutions.count, of(measured.solution_own_cycles).count);
            assert!(
                solutions.max < 12_000,
                "the averages are in time: {solutions:?}"
            );
        }
    }
}

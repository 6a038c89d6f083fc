//! Measures an image by running it in the emulator, instruction by instruction.
//!
//! Every solution sees other voltages, anywhere between the rails and on them, from a fixed
//! sequence; the last solutions are sent as text, which needs the deepest stack. The calibration
//! is the nominal one (the EEPROM is empty). So the figures are those of a varied run, not bounds.

use cardan_emulator::{
    ATMEGA328P, AnalogInput, Environment, Image, Machine, Memory, Pin, SerialByte, Stop,
};
use cardan_spec::frame::COMMAND_TEXT;
use cardan_spec::timing::{BLOCK_CYCLES, CPU_HZ, WARM_UP_BLOCKS, pins};
use cardan_spec::{CHANNELS, REFERENCE_V};
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
    let mut machine = Machine::new(&ATMEGA328P, CPU_HZ);
    machine.load(&image);
    let mut probe = Probe::new()?;
    let binary = (WARM_UP_BLOCKS as u64 + SOLUTIONS) * BLOCK_CYCLES;
    run(&mut machine, &mut probe, binary, name)?;
    let asleep = machine.statistics().sleeping_cycles;
    let load = 1.0 - asleep as f64 / machine.cycle() as f64;
    let (sample, solution, own) = (probe.sample, probe.solution, probe.own);
    probe.command = Some(COMMAND_TEXT);
    run(
        &mut machine,
        &mut probe,
        binary + TEXT_SOLUTIONS * BLOCK_CYCLES,
        name,
    )?;
    Ok(Measured {
        flash_bytes: image.flash.len(),
        flash_size: ATMEGA328P.flash_bytes,
        ram_bytes: static_data(&image),
        ram_size: ATMEGA328P.sram_bytes.into(),
        stack_bytes: Some((ATMEGA328P.ram_end() - machine.statistics().lowest_sp).into()),
        sample_interrupt_cycles: sample.if_any(),
        solution_cycles: solution.if_any(),
        solution_own_cycles: own.if_any(),
        cpu_load: Some(load),
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
    fn new() -> Result<Self, Failure> {
        Ok(Self {
            solving: pins::SOLVING.parse().map_err(Failure::input)?,
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
            AnalogInput::Pin(channel) => voltage(cycle / BLOCK_CYCLES, channel),
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
    let number = scrambled(solution * CHANNELS as u64 + u64::from(channel));
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

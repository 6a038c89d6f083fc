//! The profile of a run as a document: what `--json` shows, and `profile.json` holds.

use std::path::Path;

use cardan_emulator::{
    Device, Distribution, FunctionCost, Image, LoadWindow, Machine, Memory, ProfileReport, Symbols,
    VectorCost, shortened,
};
use serde::Serialize;

/// Classes of load in the histogram: ten per cent each.
const CLASSES: usize = 10;

/// A profile.
#[derive(Serialize)]
pub(super) struct Document {
    pub(super) totals: Totals,
    /// The most expensive first.
    pub(super) functions: Vec<Function>,
    /// Source lines with code that was executed, the most expensive first.
    pub(super) lines: Vec<Line>,
    pub(super) interrupts: Vec<Interrupt>,
    pub(super) load: Load,
    pub(super) stack: Stack,
    pub(super) memory: Usage,
    /// There were too many call paths: the deepest count for their callers.
    pub(super) call_paths_cut: bool,
    /// Why names are missing.
    pub(super) problem: Option<String>,
}

/// Cycles by what they were spent on; the last four add up to the first.
#[derive(Serialize)]
pub(super) struct Totals {
    pub(super) cycles: u64,
    pub(super) executing_cycles: u64,
    pub(super) interrupt_entry_cycles: u64,
    pub(super) asleep_cycles: u64,
    pub(super) halted_cycles: u64,
    pub(super) instructions: u64,
}

#[derive(Serialize)]
pub(super) struct Function {
    /// Demangled; `null` for all code that no symbol covers.
    pub(super) name: Option<String>,
    symbol: Option<String>,
    /// Byte address and size.
    address: Option<u32>,
    size: Option<u32>,
    pub(super) self_cycles: u64,
    pub(super) inclusive_cycles: u64,
    pub(super) calls: u64,
    instructions: u64,
}

#[derive(Serialize)]
pub(super) struct Line {
    pub(super) file: String,
    pub(super) line: u32,
    pub(super) cycles: u64,
    pub(super) count: u64,
}

#[derive(Serialize)]
pub(super) struct Interrupt {
    vector: usize,
    pub(super) name: &'static str,
    pub(super) count: u64,
    cycles: u64,
    /// Share of all cycles.
    pub(super) load: Option<f64>,
    pub(super) latency: Cycles,
    pub(super) duration: Cycles,
}

/// A distribution of cycles.
#[derive(Serialize)]
pub(super) struct Cycles {
    pub(super) min: Option<u64>,
    pub(super) mean: Option<f64>,
    pub(super) max: Option<u64>,
    pub(super) bins: Vec<Bin>,
}

/// Values from `from` to `to`, both included.
#[derive(Serialize)]
pub(super) struct Bin {
    pub(super) from: u64,
    pub(super) to: u64,
    pub(super) count: u64,
}

#[derive(Serialize)]
pub(super) struct Load {
    /// Share of all cycles that the processor was awake, and in interrupts.
    pub(super) awake: Option<f64>,
    pub(super) interrupts: Option<f64>,
    pub(super) window_cycles: u64,
    windows: Vec<Window>,
    /// Whole windows by the share that the processor was awake: up to 10 %, 20 %, ... 100 %.
    pub(super) histogram: [u64; CLASSES],
}

#[derive(Serialize)]
struct Window {
    begin: u64,
    cycles: u64,
    awake: u64,
    interrupts: u64,
}

#[derive(Serialize)]
pub(super) struct Stack {
    pub(super) peak_bytes: u16,
    sp: u16,
    /// Byte address of the instruction that made it so deep.
    pub(super) pc: u32,
    pub(super) place: Option<String>,
    /// From the program's origin to the innermost function, through interrupts.
    pub(super) path: Vec<String>,
}

#[derive(Serialize)]
pub(super) struct Usage {
    pub(super) flash_bytes: usize,
    pub(super) flash_size: usize,
    /// Variables with a fixed place; `null` without symbols.
    pub(super) static_bytes: Option<u32>,
    pub(super) sram_size: u16,
    /// What variables and the deepest stack leave; negative where they overlap.
    pub(super) sram_free_bytes: Option<i64>,
    pub(super) eeprom_bytes: usize,
}

impl Document {
    /// The document of a run; paths below `base` are shown relative to it.
    pub(super) fn new(
        report: &ProfileReport,
        machine: &Machine,
        image: &Image,
        symbols: &Symbols,
        base: &Path,
    ) -> Self {
        let totals = report.totals;
        let share = |cycles: u64| (totals.cycles > 0).then(|| cycles as f64 / totals.cycles as f64);
        let interrupts: u64 = report.vectors.iter().map(|vector| vector.cycles).sum();
        let awake = totals.cycles - totals.asleep;
        Self {
            totals: Totals {
                cycles: totals.cycles,
                executing_cycles: totals.executing,
                interrupt_entry_cycles: totals.entries,
                asleep_cycles: totals.asleep,
                halted_cycles: totals.halted,
                instructions: totals.instructions,
            },
            functions: report.functions.iter().map(function).collect(),
            lines: lines(report, base),
            interrupts: report
                .vectors
                .iter()
                .map(|vector| interrupt(vector, share(vector.cycles)))
                .collect(),
            load: load(&report.windows, share(awake), share(interrupts)),
            stack: Stack {
                peak_bytes: report.stack.bytes,
                sp: report.stack.sp,
                pc: report.stack.pc,
                place: symbols.describe(report.stack.pc, base),
                path: report.stack.path.clone(),
            },
            memory: usage(machine.device(), image, report.stack.bytes),
            call_paths_cut: report.is_cut,
            problem: symbols.problem().map(str::to_owned),
        }
    }
}

fn function(cost: &FunctionCost) -> Function {
    let function = cost.function.as_ref();
    Function {
        name: function.map(|function| function.name.clone()),
        symbol: function.map(|function| function.symbol.clone()),
        address: function.map(|function| function.start),
        size: function.map(|function| function.end - function.start),
        self_cycles: cost.self_cycles,
        inclusive_cycles: cost.inclusive_cycles,
        calls: cost.calls,
        instructions: cost.instructions,
    }
}

fn lines(report: &ProfileReport, base: &Path) -> Vec<Line> {
    let executed = report.lines.iter().filter(|line| line.cycles > 0);
    let mut lines: Vec<Line> = executed
        .map(|line| Line {
            file: shortened(&line.file, base).to_owned(),
            line: line.line,
            cycles: line.cycles,
            count: line.count,
        })
        .collect();
    lines.sort_by_key(|line| std::cmp::Reverse(line.cycles));
    lines
}

fn interrupt(cost: &VectorCost, load: Option<f64>) -> Interrupt {
    Interrupt {
        vector: cost.number,
        name: cost.name,
        count: cost.latency.count(),
        cycles: cost.cycles,
        load,
        latency: cycles(&cost.latency),
        duration: cycles(&cost.duration),
    }
}

fn cycles(distribution: &Distribution) -> Cycles {
    let bins = distribution.bins().into_iter();
    Cycles {
        min: distribution.least(),
        mean: distribution.mean(),
        max: distribution.most(),
        bins: bins
            .map(|(from, to, count)| Bin { from, to, count })
            .collect(),
    }
}

fn load(windows: &[LoadWindow], awake: Option<f64>, interrupts: Option<f64>) -> Load {
    let window_cycles = windows.first().map_or(0, |window| window.cycles);
    let mut histogram = [0; CLASSES];
    for window in windows
        .iter()
        .filter(|window| window.cycles == window_cycles)
    {
        // A share of exactly 10 % belongs to the first class.
        let class = (window.window.awake * CLASSES as u64).div_ceil(window.cycles.max(1));
        histogram[(class as usize).clamp(1, CLASSES) - 1] += 1;
    }
    Load {
        awake,
        interrupts,
        window_cycles,
        windows: windows
            .iter()
            .map(|window| Window {
                begin: window.begin,
                cycles: window.cycles,
                awake: window.window.awake,
                interrupts: window.window.interrupts,
            })
            .collect(),
        histogram,
    }
}

fn usage(device: &Device, image: &Image, peak: u16) -> Usage {
    let data = image
        .symbols
        .iter()
        .filter(|symbol| symbol.memory == Memory::Data);
    let ends = data.map(|symbol| symbol.address.saturating_add(symbol.size));
    let start = u32::from(device.sram_start);
    let in_sram = |end: &u32| (start..=start + u32::from(device.sram_bytes)).contains(end);
    let static_bytes = ends.filter(in_sram).max().map(|end| end - start);
    Usage {
        flash_bytes: image.flash.len(),
        flash_size: device.flash_bytes,
        static_bytes,
        sram_size: device.sram_bytes,
        sram_free_bytes: static_bytes
            .map(|bytes| i64::from(device.sram_bytes) - i64::from(bytes) - i64::from(peak)),
        eeprom_bytes: image.eeprom.len(),
    }
}

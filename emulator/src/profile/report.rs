//! What a profile comes to: costs by function, source line, interrupt and place.

use crate::device::Device;
use crate::machine::Machine;
use crate::symbols::{Function, Row, Symbols};

use super::calls::Label;
use super::{ASLEEP, Distribution, ENTRIES, HALTED, LoadWindow, Place, Profile, WORDS};

/// Cycles of a run by what they were spent on; the last four add up to the first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Totals {
    /// All cycles.
    pub cycles: u64,
    /// Instructions executed.
    pub instructions: u64,
    /// Cycles of instructions.
    pub executing: u64,
    /// Cycles of interrupt entries.
    pub entries: u64,
    /// Cycles asleep.
    pub asleep: u64,
    /// Cycles between sleep or reset and the first instruction.
    pub halted: u64,
}

/// What a function cost.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FunctionCost {
    /// The function; `None` for all code that no symbol covers.
    pub function: Option<Function>,
    /// Cycles of its own instructions.
    pub self_cycles: u64,
    /// Cycles while it was on the stack, without the interrupts that came meanwhile.
    pub inclusive_cycles: u64,
    /// How often it was entered: calls and jumps to its first instruction.
    pub calls: u64,
    /// Instructions executed in it.
    pub instructions: u64,
}

/// What a source line cost. Lines with code that was never executed are listed, too.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LineCost {
    /// Source file as the debug information spells it.
    pub file: String,
    /// Line from 1.
    pub line: u32,
    /// Cycles of its instructions.
    pub cycles: u64,
    /// How often it was executed: of the pieces of code that it gave rise to, the most frequent.
    pub count: u64,
}

/// Executions and cycles of one instruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlaceCost {
    /// Byte address.
    pub pc: u32,
    /// Times executed.
    pub count: u64,
    /// Its cycles.
    pub cycles: u64,
}

/// What an interrupt cost.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VectorCost {
    /// Number of the vector.
    pub number: usize,
    /// Its name in the data sheet.
    pub name: &'static str,
    /// Cycles spent on it: entries and all code that it ran, without other interrupts.
    pub cycles: u64,
    /// From flag and enable being set to the first cycle of the entry; one value per entry.
    pub latency: Distribution,
    /// From the first cycle of the entry to the end of the return, other interrupts included; one
    /// value per return.
    pub duration: Distribution,
}

/// Where the stack was deepest.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StackPeak {
    /// Lowest stack pointer.
    pub sp: u16,
    /// Bytes above it.
    pub bytes: u16,
    /// Byte address of the instruction that made it so deep (or that the interrupt came before).
    pub pc: u32,
    /// From the program's origin to the innermost function, through interrupts.
    pub path: Vec<String>,
}

/// The results of a [`Profile`].
#[derive(Clone, Debug)]
pub struct Report {
    /// Cycles by what they were spent on.
    pub totals: Totals,
    /// Every function that was executed, the most expensive first.
    pub functions: Vec<FunctionCost>,
    /// Every source line with code, in the order of files and lines.
    pub lines: Vec<LineCost>,
    /// Every instruction executed, in the order of the addresses.
    pub places: Vec<PlaceCost>,
    /// Every interrupt that was taken, in the order of the vectors.
    pub vectors: Vec<VectorCost>,
    /// Load over time.
    pub windows: Vec<LoadWindow>,
    /// The deepest stack.
    pub stack: StackPeak,
    /// Cycles of each call path: labels from the origin to the innermost function.
    pub paths: Vec<(Vec<String>, u64)>,
    /// There were too many call paths: the deepest count for their callers.
    pub is_cut: bool,
}

impl Profile {
    /// The results so far, for the run of `machine` with the names in `symbols`.
    pub fn report(&self, machine: &Machine, symbols: &Symbols) -> Report {
        let device = machine.device();
        Report {
            totals: self.totals(),
            functions: self.function_costs(),
            lines: self.line_costs(symbols),
            places: self.place_costs(),
            vectors: self.vector_costs(device),
            windows: self.load.windows(),
            stack: StackPeak {
                sp: self.deepest.sp,
                bytes: device.ram_end().saturating_sub(self.deepest.sp),
                pc: u32::from(self.deepest.pc) * 2,
                path: self.names(&self.deepest.labels, device),
            },
            paths: self.paths(device),
            is_cut: self.calls.is_cut,
        }
    }

    fn totals(&self) -> Totals {
        let sum = |places: &[Place]| places.iter().map(|place| place.cycles).sum();
        let words = &self.places[..WORDS];
        Totals {
            cycles: self.since.saturating_sub(self.begin),
            instructions: words.iter().map(|place| place.count).sum(),
            executing: sum(words),
            entries: sum(&self.places[ENTRIES..ASLEEP]),
            asleep: self.places[ASLEEP].cycles,
            halted: self.places[HALTED].cycles,
        }
    }

    fn function_costs(&self) -> Vec<FunctionCost> {
        let count = self.functions.len() + 1;
        let mut costs: Vec<FunctionCost> = (0..count)
            .map(|number| FunctionCost {
                function: self.functions.get(number).cloned(),
                self_cycles: 0,
                inclusive_cycles: 0,
                calls: self.calls.entered[number],
                instructions: 0,
            })
            .collect();
        for (place, &function) in self.places.iter().zip(self.function_of.iter()) {
            let cost = &mut costs[usize::from(function)];
            cost.self_cycles += place.cycles;
            cost.instructions += place.count;
        }
        for (number, cycles) in self.inclusive(count).into_iter().enumerate() {
            costs[number].inclusive_cycles = cycles;
        }
        costs.retain(|cost| cost.instructions > 0);
        costs.sort_by_key(|cost| std::cmp::Reverse(cost.self_cycles));
        costs
    }

    /// Cycles of all paths that a function is on; of a recursive one each path counts once.
    fn inclusive(&self, count: usize) -> Vec<u64> {
        let mut inclusive = vec![0; count];
        for node in &self.calls.nodes {
            let mut seen: Vec<usize> = Vec::new();
            let mut next = Some(node);
            while let Some(at) = next {
                if let Some(function) = at.label.as_function()
                    && !seen.contains(&function)
                {
                    inclusive[function] += node.cycles;
                    seen.push(function);
                }
                next = at.parent.map(|parent| &self.calls.nodes[parent]);
            }
        }
        inclusive
    }

    fn line_costs(&self, symbols: &Symbols) -> Vec<LineCost> {
        let mut order: Vec<&Row> = symbols.rows().iter().collect();
        order.sort_by_key(|row| (symbols.file(row.file), row.line));
        let mut costs: Vec<LineCost> = Vec::new();
        for row in order {
            let words = (row.start / 2) as usize..row.end.div_ceil(2) as usize;
            let places = self.places[..WORDS].get(words).unwrap_or_default();
            let cycles = places.iter().map(|place| place.cycles).sum::<u64>();
            let count = places.first().map_or(0, |place| place.count);
            let file = symbols.file(row.file);
            match costs.last_mut() {
                Some(cost) if cost.file == file && cost.line == row.line => {
                    cost.cycles += cycles;
                    cost.count = cost.count.max(count);
                }
                _ => costs.push(LineCost {
                    file: file.to_owned(),
                    line: row.line,
                    cycles,
                    count,
                }),
            }
        }
        costs
    }

    fn place_costs(&self) -> Vec<PlaceCost> {
        let words = self.places[..WORDS].iter().enumerate();
        let executed = words.filter(|(_, place)| place.count > 0);
        executed
            .map(|(word, place)| PlaceCost {
                pc: word as u32 * 2,
                count: place.count,
                cycles: place.cycles,
            })
            .collect()
    }

    fn vector_costs(&self, device: &Device) -> Vec<VectorCost> {
        let mut cycles = vec![0; self.vectors.len()];
        for node in &self.calls.nodes {
            let mut origin = node;
            while let Some(parent) = origin.parent {
                origin = &self.calls.nodes[parent];
            }
            if let Some(vector) = origin.label.as_vector()
                && let Some(sum) = cycles.get_mut(vector)
            {
                *sum += node.cycles;
            }
        }
        let vectors = self.vectors.iter().enumerate();
        let taken = vectors.filter(|(_, vector)| vector.latency.count() > 0);
        taken
            .map(|(number, vector)| VectorCost {
                number,
                name: device.vectors[number],
                cycles: cycles[number],
                latency: vector.latency.clone(),
                duration: vector.duration.clone(),
            })
            .collect()
    }

    fn paths(&self, device: &Device) -> Vec<(Vec<String>, u64)> {
        let nodes = self.calls.nodes.iter().filter(|node| node.cycles > 0);
        nodes
            .map(|node| {
                let mut labels = vec![node.label];
                let mut next = node.parent;
                while let Some(parent) = next {
                    labels.push(self.calls.nodes[parent].label);
                    next = self.calls.nodes[parent].parent;
                }
                labels.reverse();
                (self.names(&labels, device), node.cycles)
            })
            .collect()
    }

    fn names(&self, labels: &[Label], device: &Device) -> Vec<String> {
        labels
            .iter()
            .map(|&label| self.name(label, device))
            .collect()
    }

    fn name(&self, label: Label, device: &Device) -> String {
        if let Some(vector) = label.as_vector() {
            return device
                .vectors
                .get(vector)
                .map_or("?", |name| name)
                .to_owned();
        }
        match label.as_function() {
            Some(number) => match self.functions.get(number) {
                Some(function) => function.name.clone(),
                None => "(no symbol)".to_owned(),
            },
            None if label == Label::ASLEEP => "(asleep)".to_owned(),
            None => "(halted)".to_owned(),
        }
    }
}

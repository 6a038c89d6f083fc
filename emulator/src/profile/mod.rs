//! Profile of a run: where its cycles went, exactly.
//!
//! Every cycle has one owner: the instruction it belongs to, an interrupt entry, sleep, or the
//! halt after sleep and reset; so the parts add up to the cycles of the run. Functions are told
//! apart by the program counter, calls and returns by the stack pointer ([`calls`]), which also
//! holds for tail jumps, computed jumps, `longjmp` and code that moves its own stack.

mod calls;
mod distribution;
mod export;
mod load;
mod report;

use crate::isa::Code;
use crate::machine::Machine;
use crate::observer::{Moment, Observer, Pause};
use crate::symbols::{Function, Symbols};

use self::calls::{Calls, Label, Transfer};
pub use self::distribution::Distribution;
use self::load::{Load, State};
pub use self::load::{LoadWindow, Window};
pub use self::report::{FunctionCost, LineCost, PlaceCost, Report, StackPeak, Totals, VectorCost};

/// Word addresses, and behind them the owners that are no instruction.
const WORDS: usize = 0x1_0000;
/// Owners of interrupt entries, by vector.
const ENTRIES: usize = WORDS;
/// Room for vectors.
const VECTORS: usize = 64;
const ASLEEP: usize = ENTRIES + VECTORS;
const HALTED: usize = ASLEEP + 1;
/// A power of two, so that indexing needs no check.
const OWNERS: usize = 2 * WORDS;
const _: () = assert!(HALTED < OWNERS);
/// No function: whatever comes next is looked at.
const ANYTHING: u16 = u16::MAX;

/// Executions and cycles of one owner.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Place {
    count: u64,
    cycles: u64,
}

/// Latencies and durations of one interrupt vector.
#[derive(Clone, Debug, Default)]
struct Vector {
    latency: Distribution,
    duration: Distribution,
}

/// The deepest stack so far.
#[derive(Clone, Debug)]
struct Deepest {
    sp: u16,
    /// Word address of the instruction that made it so deep.
    pc: u16,
    labels: Vec<Label>,
}

/// Collects a profile while a machine runs ([`Machine::run_observed`]).
#[derive(Clone, Debug)]
pub struct Profile {
    functions: Vec<Function>,
    /// Number of the function of each word address.
    function_of: Box<[u16; WORDS]>,
    places: Box<[Place; OWNERS]>,
    /// Who owns the cycles since `since`.
    owner: usize,
    since: u64,
    begin: u64,
    /// Function in which the last instruction was, or [`ANYTHING`].
    function: u16,
    transfer: Transfer,
    calls: Calls,
    load: Load,
    vectors: Vec<Vector>,
    deepest: Deepest,
}

impl Profile {
    /// A profile of the run that `machine` is about to begin or to go on with.
    pub fn new(symbols: &Symbols, machine: &Machine) -> Profile {
        let functions = symbols.functions().to_vec();
        // What lies between the functions has no name.
        let mut function_of = crate::core::boxed::<_, WORDS>(functions.len() as u16);
        for (number, function) in functions.iter().enumerate() {
            let words = (function.start / 2) as usize..function.end.div_ceil(2) as usize;
            if let Some(words) = function_of.get_mut(words) {
                words.fill(number as u16);
            }
        }
        let starts = functions.iter().map(|function| (function.start / 2) as u16);
        Profile {
            calls: Calls::new(starts.collect()),
            functions,
            function_of,
            places: crate::core::boxed(Place::default()),
            owner: HALTED,
            since: machine.core.cycle,
            begin: machine.core.cycle,
            function: ANYTHING,
            transfer: Transfer::Jump,
            load: Load::new(machine.core.cycle, machine.frequency_hz()),
            vectors: vec![Vector::default(); machine.device.vectors.len().min(VECTORS)],
            deepest: Deepest {
                sp: machine.core.lowest_sp,
                pc: machine.core.pc,
                labels: Vec::new(),
            },
        }
    }

    /// The cycles up to `cycle` belong to the owner so far, those from there to `owner`.
    #[inline(always)]
    fn hand_over(&mut self, owner: usize, cycle: u64) {
        let place = &mut self.places[self.owner % OWNERS];
        place.cycles = place.cycles.wrapping_add(cycle.wrapping_sub(self.since));
        self.since = cycle;
        self.owner = owner;
    }

    /// Word address of the last instruction.
    fn last_pc(&self) -> u16 {
        u16::try_from(self.owner).unwrap_or(self.deepest.pc)
    }

    /// The flow of control has come to `pc` by something else than one instruction after another
    /// within a function.
    #[cold]
    #[inline(never)]
    fn arrive(&mut self, pc: u16, sp: u16, cycle: u64) {
        let function = self.function_of[usize::from(pc)];
        let transfer = std::mem::replace(&mut self.transfer, Transfer::Jump);
        for (vector, begin) in self.calls.arrive(transfer, function, pc, sp, cycle) {
            self.vectors[vector].duration.add(cycle - begin);
        }
        self.function = function;
        let state = match self.calls.is_interrupted() {
            true => State::Interrupt,
            false => State::Main,
        };
        self.load.enter(state, cycle);
    }

    /// Accounts for everything up to now.
    pub(crate) fn finish(&mut self, machine: &Machine) {
        let cycle = machine.core.cycle;
        self.hand_over(self.owner, cycle);
        self.calls.settle(cycle);
        self.load.settle(cycle);
    }

    fn note_depth(&mut self, sp: u16) {
        self.deepest = Deepest {
            sp,
            pc: self.last_pc(),
            labels: self.calls.path(),
        };
    }
}

impl Observer for Profile {
    #[inline(always)]
    fn instruction(&mut self, moment: &Moment<'_>) {
        if moment.code == Code::Wrap {
            return;
        }
        if moment.lowest_sp < self.deepest.sp {
            self.note_depth(moment.lowest_sp);
        }
        self.hand_over(usize::from(moment.pc), moment.cycle);
        self.places[usize::from(moment.pc)].count += 1;
        if self.function_of[usize::from(moment.pc)] != self.function {
            self.arrive(moment.pc, moment.sp, moment.cycle);
        }
        if matches!(moment.code, Code::Call | Code::Icall | Code::Ret) {
            self.function = ANYTHING;
            self.transfer = match moment.code {
                Code::Ret => Transfer::Return,
                _ => Transfer::Call {
                    pc: moment.pc,
                    sp: moment.sp,
                },
            };
        }
    }

    fn completed(&mut self, code: Code, times: u64) {
        let place = &mut self.places[self.owner % OWNERS];
        // It was counted once when it was shown.
        place.count = (place.count + times).saturating_sub(1);
        if code == Code::Reti {
            self.function = ANYTHING;
            self.transfer = Transfer::Return;
        }
    }

    fn pause(&mut self, pause: Pause, machine: &Machine) {
        let (cycle, core) = (machine.core.cycle, &machine.core);
        let owner = match pause {
            Pause::Entry { vector, latency } => {
                if self.function_of[usize::from(core.pc)] != self.function {
                    self.arrive(core.pc, core.sp, cycle);
                }
                self.vectors[vector].latency.add(latency);
                for (ended, begin) in self.calls.interrupt(vector, core.sp, cycle) {
                    self.vectors[ended].duration.add(cycle - begin);
                }
                self.load.enter(State::Interrupt, cycle);
                ENTRIES + vector
            }
            Pause::Asleep => {
                self.calls.pause(Label::ASLEEP, cycle);
                self.load.enter(State::Asleep, cycle);
                ASLEEP
            }
            Pause::Halted | Pause::Reset => {
                if pause == Pause::Reset {
                    self.calls.reset(cycle);
                    self.transfer = Transfer::Jump;
                }
                self.calls.pause(Label::HALTED, cycle);
                self.load.enter(State::Main, cycle);
                HALTED
            }
        };
        self.hand_over(owner, cycle);
        if let Pause::Entry { vector, .. } = pause {
            self.places[ENTRIES + vector].count += 1;
        }
        self.function = ANYTHING;
    }

    fn settled(&mut self, machine: &Machine) {
        if machine.core.lowest_sp < self.deepest.sp {
            self.note_depth(machine.core.lowest_sp);
        }
    }
}

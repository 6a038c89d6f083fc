//! Following the program from an entry: which instructions belong to the region, and what follows
//! each of them.

use std::collections::HashMap;

use cardan_emulator::engine::{Code, Core, Op};

use super::{Flow, Instruction, MAX_ENTRIES, Places, Target};
use crate::facts::{self, Follows};

/// Most instructions in a region.
const MAX_INSTRUCTIONS: usize = 300;
/// Longest chain of calls followed.
const MAX_DEPTH: usize = 6;
/// Most instructions of a function, and of what it calls, whose calls are followed.
const MAX_FOLLOWED: usize = 64;

/// A chain of calls: the place to return to and the chain around it.
#[derive(Clone, Copy)]
struct Context {
    return_pc: u16,
    around: usize,
    depth: usize,
}

/// Follows the program from an entry.
pub(super) struct Explorer<'a> {
    core: &'a Core,
    engine: &'a dyn Places,
    /// Instructions at which the region may be entered.
    pub(super) entries: Vec<usize>,
    pub(super) instructions: Vec<Instruction>,
    pub(super) places: Vec<usize>,
    pub(super) flows: Vec<Flow>,
    found: HashMap<(u16, usize), usize>,
    /// Context 0 is that of the entry: whoever called it.
    contexts: Vec<Context>,
    known: HashMap<(u16, usize), usize>,
    /// Places of instructions that were left to the machine.
    pub(super) machine: Vec<u16>,
}

impl Explorer<'_> {
    /// The first instruction, whatever else covers it.
    fn start(&mut self, pc: u16) -> Option<()> {
        let op = self.core.op_at(pc);
        if pc > self.core.pc_mask() || needs_machine(self.core, op) {
            return None;
        }
        self.instructions.push(Instruction { pc, op });
        self.places.push(0);
        self.found.insert((pc, 0), 0);
        Some(())
    }

    fn needs_machine(&mut self, pc: u16) -> bool {
        let needs = needs_machine(self.core, self.core.op_at(pc));
        if needs {
            self.machine.push(pc);
        }
        needs
    }

    /// A jump target that is not followed.
    fn outside(&mut self, pc: u16) -> Target {
        if self.needs_machine(pc) {
            return Target::Machine(pc);
        }
        Target::Outside(pc)
    }

    fn target(&mut self, pc: u16, context: usize) -> Target {
        if pc > self.core.pc_mask() {
            return Target::Interpreter(pc);
        }
        if let Some(&i) = self.found.get(&(pc, context)) {
            return Target::Inside(i);
        }
        if self.needs_machine(pc) {
            return Target::Machine(pc);
        }
        let op = self.core.op_at(pc);
        let is_elsewhere = context == 0 && self.engine.is_covered(pc);
        if self.instructions.len() >= MAX_INSTRUCTIONS || is_elsewhere {
            return Target::Outside(pc);
        }
        let i = self.instructions.len();
        self.instructions.push(Instruction { pc, op });
        self.places.push(context);
        self.found.insert((pc, context), i);
        Target::Inside(i)
    }

    fn jump_target(&mut self, pc: u16, context: usize) -> Target {
        if self.engine.is_cold(pc) && !self.found.contains_key(&(pc, context)) {
            return self.outside(pc);
        }
        self.target(pc, context)
    }

    /// Goes on behind a call that is not followed: the callee returns to here from outside.
    fn add_entry(&mut self, pc: u16) {
        if self.engine.is_entry(pc) || self.entries.len() >= MAX_ENTRIES {
            return;
        }
        if let Target::Inside(i) = self.target(pc, 0)
            && !self.entries.contains(&i)
        {
            self.entries.push(i);
        }
    }

    fn call_target(&mut self, to: u16, return_pc: u16, around: usize) -> Target {
        let depth = self.contexts[around].depth + 1;
        let is_recursive = || {
            let mut at = around;
            while at != 0 {
                if self.contexts[at].return_pc == return_pc {
                    return true;
                }
                at = self.contexts[at].around;
            }
            false
        };
        let is_followed =
            depth <= MAX_DEPTH && !is_recursive() && size(self.core, to, MAX_FOLLOWED).is_some();
        if !is_followed {
            if around == 0 {
                self.add_entry(return_pc);
            }
            return self.outside(to);
        }
        let next = self.contexts.len();
        let context = *self.known.entry((return_pc, around)).or_insert(next);
        if context == next {
            self.contexts.push(Context {
                return_pc,
                around,
                depth,
            });
        }
        self.target(to, context)
    }

    fn flow(&mut self, i: usize) -> Flow {
        let (Instruction { pc, op }, context) = (self.instructions[i], self.places[i]);
        match facts::follows(op) {
            Follows::Next(words) => Flow::Next(self.target(pc + words, context)),
            Follows::Jump => Flow::Next(self.jump_target(op.k, context)),
            Follows::Branch => Flow::Branch {
                taken: self.jump_target(op.k, context),
                extra_cycles: 1,
                other: self.target(pc + 1, context),
            },
            Follows::Skip => Flow::Branch {
                taken: self.target(pc + 1 + u16::from(op.n), context),
                extra_cycles: i64::from(op.n),
                other: self.target(pc + 1, context),
            },
            Follows::Call => {
                let return_pc = (pc + u16::from(op.r)) & self.core.pc_mask();
                Flow::Next(self.call_target(op.k, return_pc, context))
            }
            Follows::Return if context != 0 => {
                let Context {
                    return_pc, around, ..
                } = self.contexts[context];
                Flow::Return {
                    expected: return_pc,
                    to: self.target(return_pc, around),
                }
            }
            Follows::Return | Follows::Anywhere | Follows::Machine => Flow::Anywhere,
        }
    }
}

/// Whether the machine has to execute the instruction, whatever the registers hold.
fn needs_machine(core: &Core, op: Op) -> bool {
    let (start, bytes) = core.ram();
    let is_static = matches!(op.code, Code::Lds | Code::Sts);
    is_static && op.k.wrapping_sub(start) >= bytes || facts::follows(op) == Follows::Machine
}

/// Number of instructions that can be reached from a function's beginning, calls included; nothing
/// if there are more than `limit`.
fn size(core: &Core, from: u16, limit: usize) -> Option<usize> {
    let mut seen = vec![from];
    let mut next = 0;
    while let Some(&pc) = seen.get(next) {
        next += 1;
        if pc > core.pc_mask() || seen.len() > limit {
            return None;
        }
        let op = core.op_at(pc);
        let behind = match facts::follows(op) {
            Follows::Next(words) => [Some(pc + words), None],
            Follows::Jump => [Some(op.k), None],
            Follows::Branch => [Some(op.k), Some(pc + 1)],
            Follows::Skip => [Some(pc + 1 + u16::from(op.n)), Some(pc + 1)],
            Follows::Call => [Some(op.k), Some((pc + u16::from(op.r)) & core.pc_mask())],
            Follows::Return => [None, None],
            Follows::Anywhere | Follows::Machine => return None,
        };
        for pc in behind.into_iter().flatten() {
            if !seen.contains(&pc) {
                seen.push(pc);
            }
        }
    }
    Some(seen.len())
}

/// All that an entry reaches. Nothing if the entry itself is for the machine.
pub(super) fn explored<'a>(
    core: &'a Core,
    entry: u16,
    engine: &'a dyn Places,
) -> Option<Explorer<'a>> {
    let mut explorer = Explorer {
        core,
        engine,
        entries: vec![0],
        instructions: Vec::new(),
        places: Vec::new(),
        flows: Vec::new(),
        found: HashMap::new(),
        contexts: vec![Context {
            return_pc: 0,
            around: 0,
            depth: 0,
        }],
        known: HashMap::new(),
        machine: Vec::new(),
    };
    explorer.start(entry)?;
    while explorer.flows.len() < explorer.instructions.len() {
        let flow = explorer.flow(explorer.flows.len());
        explorer.flows.push(flow);
    }
    Some(explorer)
}

//! Regions: what is translated as one function. A region is the hot entry and whatever direct
//! jumps, branches and calls reach from it, within limits; calls are followed into the called
//! function, once per place of call, so that the state stays in host registers there and back.

use std::collections::{BTreeSet, HashMap};

use cardan_emulator::engine::{Core, Op};

use crate::facts::{self, Follows, bit};

/// Most instructions in a region.
const MAX_INSTRUCTIONS: usize = 300;
/// Longest chain of calls followed.
const MAX_DEPTH: usize = 6;
/// Most instructions of a function, and of what it calls, whose calls are followed.
const MAX_FOLLOWED: usize = 64;
/// Most entries of a region.
const MAX_ENTRIES: usize = 32;
/// Most instructions in a block.
const MAX_BLOCK: usize = 40;
/// Most cycles between two looks at the cycles left, apart from those of one block: what the
/// interpreter executes before each event.
const MAX_REACH: i64 = 48;
/// Most instructions of a loop that keeps its registers in the host's.
const MAX_LOOP: usize = 80;

/// What the engine knows about places in program memory.
pub(crate) trait Places {
    /// A jump target that is not worth following: it was never reached.
    fn is_cold(&self, pc: u16) -> bool;
    /// Whether there is code for this place already.
    fn is_entry(&self, pc: u16) -> bool;
    /// Whether there is that much code for this place that more is not worth it.
    fn is_covered(&self, pc: u16) -> bool;
}

/// Where control goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Target {
    /// To this instruction while exploring, to this block of the region later.
    Inside(usize),
    /// Out of the region, to this word address.
    Outside(u16),
    /// To an instruction that the machine executes.
    Machine(u16),
    /// To a word address that only the interpreter understands: behind the last word.
    Interpreter(u16),
}

/// What follows an instruction.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Flow {
    Next(Target),
    Branch {
        taken: Target,
        extra_cycles: i64,
        other: Target,
    },
    /// A return, expected at the word address.
    Return {
        expected: u16,
        to: Target,
    },
    /// A return, jump or call to anywhere.
    Anywhere,
}

/// An instruction at its place.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Instruction {
    pub(crate) pc: u16,
    pub(crate) op: Op,
}

/// Straight-line code.
#[derive(Debug)]
pub(crate) struct Block {
    pub(crate) instructions: Vec<Instruction>,
    /// What follows the last.
    pub(crate) flow: Flow,
    /// Whether the cycles left are looked at before the block is entered.
    pub(crate) is_checkpoint: bool,
    /// Most cycles from the beginning of the block to the beginning of an instruction that is
    /// executed before the cycles left are looked at again.
    pub(crate) reach: i64,
    /// Lazy flags whose values must be at hand when the block is entered.
    pub(crate) live_in: u64,
    /// State that may differ from what is in memory.
    pub(crate) dirty_in: u64,
    /// The small innermost loop to which the block belongs.
    inner_loop: Option<usize>,
}

/// What becomes one function.
#[derive(Debug)]
pub(crate) struct Region {
    pub(crate) blocks: Vec<Block>,
    /// Blocks at which it may be entered.
    pub(crate) entries: Vec<usize>,
    /// Places that it covers, other than in functions whose calls were followed.
    pub(crate) covers: Vec<u16>,
    /// Program memory that it was made from: word addresses and contents.
    pub(crate) source: Vec<(u16, u16)>,
}

/// Blocks that a flow leads to, and the cycles that it costs beyond those of the instruction.
fn edges(flow: Flow) -> impl Iterator<Item = (usize, i64)> {
    let (first, second) = match flow {
        Flow::Next(to) | Flow::Return { to, .. } => (Some((to, 0)), None),
        Flow::Branch {
            taken,
            extra_cycles,
            other,
        } => (Some((taken, extra_cycles)), Some((other, 0))),
        Flow::Anywhere => (None, None),
    };
    [first, second]
        .into_iter()
        .flatten()
        .filter_map(|(target, extra)| {
            let Target::Inside(i) = target else {
                return None;
            };
            Some((i, extra))
        })
}

/// Blocks that a flow leads to.
fn insides(flow: Flow) -> impl Iterator<Item = usize> {
    edges(flow).map(|(next, _)| next)
}

impl Region {
    /// Whether registers stay in the host's on the way from one block to another; else they are
    /// written back, so that there is little to write wherever the region is left.
    pub(crate) fn keeps_registers(&self, from: usize, to: usize) -> bool {
        keeps_registers(&self.blocks, from, to)
    }
}

fn keeps_registers(blocks: &[Block], from: usize, to: usize) -> bool {
    let inner_loop = blocks[from].inner_loop;
    inner_loop.is_some() && inner_loop == blocks[to].inner_loop
}

/// A chain of calls: the place to return to and the chain around it.
#[derive(Clone, Copy)]
struct Context {
    return_pc: u16,
    around: usize,
    depth: usize,
}

/// Follows the program from an entry.
struct Explorer<'a> {
    core: &'a Core,
    engine: &'a dyn Places,
    /// Instructions at which the region may be entered.
    entries: Vec<usize>,
    instructions: Vec<Instruction>,
    places: Vec<usize>,
    flows: Vec<Flow>,
    found: HashMap<(u16, usize), usize>,
    /// Context 0 is that of the entry: whoever called it.
    contexts: Vec<Context>,
    known: HashMap<(u16, usize), usize>,
    /// Places of instructions that were left to the machine.
    machine: Vec<u16>,
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
    use cardan_emulator::engine::Code;
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

/// The region of a hot entry. Nothing if the entry itself is for the machine.
pub(crate) fn explore(core: &Core, entry: u16, engine: &dyn Places) -> Option<Region> {
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
    let Explorer {
        instructions,
        places,
        flows,
        entries,
        machine,
        ..
    } = explorer;
    let (mut blocks, heads) = blocks(&instructions, &flows, &entries);
    let (order, loops) = find_loops(&mut blocks, entries.len());
    keep_small_loops(&mut blocks, &loops);
    place_checkpoints(&mut blocks, &order);
    find_live_flags(&mut blocks);
    find_dirty_state(&mut blocks);
    let own_blocks = heads.iter().map(|&head| places[head] == 0);
    let entries = choose_entries(&blocks, entries.len(), own_blocks);
    let own = instructions
        .iter()
        .zip(&places)
        .filter(|&(_, &place)| place == 0);
    Some(Region {
        blocks,
        entries,
        covers: own.map(|(instruction, _)| instruction.pc).collect(),
        source: source(core, &instructions, &machine),
    })
}

/// The words that decided what the region is: each instruction with the two words behind it (its
/// own second word, or the length of what it skips).
fn source(core: &Core, instructions: &[Instruction], machine: &[u16]) -> Vec<(u16, u16)> {
    let mask = core.pc_mask();
    let inside = instructions.iter().map(|instruction| instruction.pc);
    let mut words: Vec<(u16, u16)> = inside
        .chain(machine.iter().copied())
        .flat_map(|pc| (0..3).map(move |i| pc.wrapping_add(i) & mask))
        .map(|pc| (pc, core.flash()[usize::from(pc)]))
        .collect();
    words.sort_unstable();
    words.dedup();
    words
}

/// Cuts instructions into blocks, the entries first; with the first instruction of each.
fn blocks(
    instructions: &[Instruction],
    flows: &[Flow],
    entries: &[usize],
) -> (Vec<Block>, Vec<usize>) {
    let mut arrivals = vec![0; instructions.len()];
    for &entry in entries {
        arrivals[entry] = 2;
    }
    for &flow in flows {
        let weight = if matches!(flow, Flow::Next(_)) { 1 } else { 2 };
        for i in insides(flow) {
            arrivals[i] += weight;
        }
    }
    let mut heads = entries.to_vec();
    let mut numbers: HashMap<usize, usize> = heads.iter().copied().zip(0..).collect();
    let mut blocks: Vec<Block> = Vec::new();
    while blocks.len() < heads.len() {
        let mut at = heads[blocks.len()];
        let mut run = vec![instructions[at]];
        while let Flow::Next(Target::Inside(next)) = flows[at]
            && arrivals[next] == 1
            && run.len() < MAX_BLOCK
        {
            at = next;
            run.push(instructions[at]);
        }
        let mut number = |target: Target| match target {
            Target::Inside(i) => Target::Inside(*numbers.entry(i).or_insert_with(|| {
                heads.push(i);
                heads.len() - 1
            })),
            other => other,
        };
        let flow = match flows[at] {
            Flow::Next(to) => Flow::Next(number(to)),
            Flow::Branch {
                taken,
                extra_cycles,
                other,
            } => Flow::Branch {
                taken: number(taken),
                extra_cycles,
                other: number(other),
            },
            Flow::Return { expected, to } => Flow::Return {
                expected,
                to: number(to),
            },
            Flow::Anywhere => Flow::Anywhere,
        };
        blocks.push(Block {
            flow,
            is_checkpoint: false,
            reach: 0,
            live_in: 0,
            dirty_in: 0,
            inner_loop: None,
            instructions: run,
        });
    }
    (blocks, heads)
}

/// Places the looks at the cycles left: one in each loop, and one where the way from the last has
/// become long.
fn place_checkpoints(blocks: &mut [Block], order: &[usize]) {
    for &i in order {
        let cycles: Vec<i64> = blocks[i]
            .instructions
            .iter()
            .map(|instruction| facts::cycles(instruction.op))
            .collect();
        let total: i64 = cycles.iter().sum();
        let mut reach = total - cycles[cycles.len() - 1];
        for (next, extra) in edges(blocks[i].flow) {
            if blocks[next].is_checkpoint {
                continue;
            }
            let way = total + extra + blocks[next].reach;
            if way > MAX_REACH {
                blocks[next].is_checkpoint = true;
            } else {
                reach = reach.max(way);
            }
        }
        blocks[i].reach = reach;
    }
}

/// Finds the backward edges (from, to) and makes their targets checkpoints. The order returned
/// has each block after what follows it.
fn find_loops(blocks: &mut [Block], entries: usize) -> (Vec<usize>, Vec<(usize, usize)>) {
    #[derive(Clone, Copy, PartialEq)]
    enum Visit {
        Not,
        Under,
        Done,
    }
    let mut visits = vec![Visit::Not; blocks.len()];
    let mut order = Vec::with_capacity(blocks.len());
    let mut loops = Vec::new();
    for entry in 0..entries {
        if visits[entry] != Visit::Not {
            continue;
        }
        visits[entry] = Visit::Under;
        let mut stack = vec![(entry, insides(blocks[entry].flow).collect::<Vec<_>>())];
        while let Some((i, rest)) = stack.last_mut() {
            let i = *i;
            let Some(next) = rest.pop() else {
                visits[i] = Visit::Done;
                order.push(i);
                stack.pop();
                continue;
            };
            match visits[next] {
                Visit::Not => {
                    visits[next] = Visit::Under;
                    stack.push((next, insides(blocks[next].flow).collect()));
                }
                Visit::Under => {
                    blocks[next].is_checkpoint = true;
                    loops.push((i, next));
                }
                Visit::Done => {}
            }
        }
    }
    (order, loops)
}

/// The blocks at which the region may be entered: those that must be, and any other of the
/// function itself, so that the way back into translated code is short after an event. Not the
/// small loops: there an entry would cost something in every round.
fn choose_entries(
    blocks: &[Block],
    needed: usize,
    is_own: impl Iterator<Item = bool>,
) -> Vec<usize> {
    let others = is_own
        .enumerate()
        .skip(needed)
        .filter(|&(i, is_own)| is_own && blocks[i].inner_loop.is_none());
    (0..needed)
        .chain(others.map(|(i, _)| i))
        .take(MAX_ENTRIES)
        .collect()
}

/// Marks the blocks of innermost loops that are small.
fn keep_small_loops(blocks: &mut [Block], loops: &[(usize, usize)]) {
    let mut before = vec![Vec::new(); blocks.len()];
    for (i, block) in blocks.iter().enumerate() {
        for next in insides(block.flow) {
            before[next].push(i);
        }
    }
    let heads: BTreeSet<usize> = loops.iter().map(|&(_, head)| head).collect();
    for &head in &heads {
        let ends = loops.iter().filter(|&&(_, to)| to == head);
        let mut todo: Vec<usize> = ends.map(|&(from, _)| from).collect();
        let mut body = BTreeSet::from([head]);
        while let Some(i) = todo.pop() {
            if body.insert(i) {
                todo.extend(&before[i]);
            }
        }
        let size: usize = body.iter().map(|&i| blocks[i].instructions.len()).sum();
        let is_innermost = body.intersection(&heads).eq([&head]);
        if is_innermost && size <= MAX_LOOP {
            for i in body {
                blocks[i].inner_loop = Some(head);
            }
        }
    }
}

/// Finds the lazy flags that each block reads before it writes them, or may have to hand over
/// where it leaves the region; backwards until nothing changes.
fn find_live_flags(blocks: &mut [Block]) {
    let mut changed = true;
    while changed {
        changed = false;
        for i in (0..blocks.len()).rev() {
            let mut live = if leaves(&blocks[i], blocks) {
                bit::LAZY
            } else {
                insides(blocks[i].flow).fold(0, |live, next| live | blocks[next].live_in)
            };
            for instruction in blocks[i].instructions.iter().rev() {
                let op = instruction.op;
                live &= !facts::writes(op);
                live |= facts::reads_flags(op, facts::is_checked(op));
            }
            live &= bit::LAZY;
            changed |= live != blocks[i].live_in;
            blocks[i].live_in = live;
        }
    }
}

/// Whether control may leave the region behind the block.
fn leaves(block: &Block, blocks: &[Block]) -> bool {
    let stays = |target| matches!(target, Target::Inside(i) if !blocks[i].is_checkpoint);
    match block.flow {
        Flow::Next(to) | Flow::Return { to, .. } => !stays(to),
        Flow::Branch { taken, other, .. } => !stays(taken) || !stays(other),
        Flow::Anywhere => true,
    }
}

fn written(block: &Block) -> u64 {
    block
        .instructions
        .iter()
        .fold(0, |written, i| written | facts::writes(i.op))
}

/// What may have been written on the way to each block, forwards until nothing changes.
fn find_dirty_state(blocks: &mut [Block]) {
    let mut changed = true;
    while changed {
        changed = false;
        for i in 0..blocks.len() {
            let written = blocks[i].dirty_in | written(&blocks[i]);
            for next in insides(blocks[i].flow).collect::<Vec<_>>() {
                let out = if keeps_registers(blocks, i, next) {
                    written
                } else {
                    written & !bit::REGISTERS
                };
                changed |= blocks[next].dirty_in | out != blocks[next].dirty_in;
                blocks[next].dirty_in |= out;
            }
        }
    }
}

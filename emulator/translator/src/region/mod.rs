//! Regions: what is translated as one function. A region is the hot entry and whatever direct
//! jumps, branches and calls reach from it, within limits; calls are followed into the called
//! function, once per place of call, so that the state stays in host registers there and back.

mod analysis;
mod explorer;

use cardan_emulator::engine::{Core, Op};

use self::analysis::{
    blocks, choose_entries, find_dirty_state, find_live_flags, find_loops, keep_small_loops,
    place_checkpoints,
};
use self::explorer::{Explorer, explored};

/// Most entries of a region.
const MAX_ENTRIES: usize = 32;

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

/// The region of a hot entry. Nothing if the entry itself is for the machine.
pub(crate) fn explore(core: &Core, entry: u16, engine: &dyn Places) -> Option<Region> {
    let Explorer {
        instructions,
        places,
        flows,
        entries,
        machine,
        ..
    } = explored(core, entry, engine)?;
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

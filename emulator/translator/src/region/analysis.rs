//! From instructions to blocks: checkpoints, loops, live flags, dirty state.

use std::collections::{BTreeSet, HashMap};

use super::{Block, Flow, Instruction, MAX_ENTRIES, Target, edges, insides, keeps_registers};
use crate::facts::{self, bit};

/// Most instructions in a block.
const MAX_BLOCK: usize = 40;
/// Most cycles between two looks at the cycles left, apart from those of one block: what the
/// interpreter executes before each event.
const MAX_REACH: i64 = 48;
/// Most instructions of a loop that keeps its registers in the host's.
const MAX_LOOP: usize = 80;

/// Cuts instructions into blocks, the entries first; with the first instruction of each.
pub(super) fn blocks(
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
pub(super) fn place_checkpoints(blocks: &mut [Block], order: &[usize]) {
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
pub(super) fn find_loops(
    blocks: &mut [Block],
    entries: usize,
) -> (Vec<usize>, Vec<(usize, usize)>) {
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
pub(super) fn choose_entries(
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
pub(super) fn keep_small_loops(blocks: &mut [Block], loops: &[(usize, usize)]) {
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
pub(super) fn find_live_flags(blocks: &mut [Block]) {
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
pub(super) fn find_dirty_state(blocks: &mut [Block]) {
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

//! The engine: interprets, counts where the program jumps to, translates what is hot, and runs
//! what is translated.

use std::time::Instant;

use cardan_emulator::engine::{Arrivals, Core, Engine, Exit};

use crate::code::HostCode;
use crate::compiler::Compiler;
use crate::limits::{Limits, Work};
use crate::lower::left;
use crate::region::{Places, explore};

/// Word addresses of the whole range of the program counter.
const PLACES: usize = 0x1_0000;
/// Arrivals left at a place that has host code, and at one that cannot have any.
const TRANSLATED: u32 = 0;
const REFUSED: u32 = u32::MAX;
/// How much hotter a place must be that other code covers already.
const COVERED_FACTOR: u32 = 32;
/// Regions that may cover a place beside the one that begins there.
const MAX_COVERS: u8 = 2;

/// A region's host code and the program memory that it was made from.
struct Translated {
    entries: Vec<u16>,
    covers: Vec<u16>,
    code: HostCode,
    source: Vec<(u16, u16)>,
}

/// Arrivals left at each place until it is translated.
struct Heat {
    left: Box<[u32; PLACES]>,
}

impl Arrivals for Heat {
    const IS_WATCHING: bool = true;

    #[inline(always)]
    fn stops_at(&mut self, pc: u16) -> bool {
        let left = &mut self.left[usize::from(pc)];
        match *left {
            TRANSLATED => return true,
            REFUSED => return false,
            _ => *left -= 1,
        }
        *left == TRANSLATED
    }

    #[inline(always)]
    fn is_known(&self, pc: u16) -> bool {
        self.left[usize::from(pc)] == TRANSLATED
    }
}

/// An engine that translates.
pub struct Translator {
    compiler: Compiler,
    heat: Heat,
    /// Where each place's code is: index in `translated` plus one, and number of the entry.
    places: Box<[(u32, u32); PLACES]>,
    /// How many regions cover each place.
    covers: Box<[u8; PLACES]>,
    translated: Vec<Translated>,
    /// State of the program memory that the code belongs to.
    flash_stamp: Option<u64>,
    limits: Limits,
    work: Work,
}

impl std::fmt::Debug for Translator {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Translator")
            .field("limits", &self.limits)
            .field("work", &self.work)
            .finish_non_exhaustive()
    }
}

fn table<T: Copy>(value: T) -> Box<[T; PLACES]> {
    match vec![value; PLACES].into_boxed_slice().try_into() {
        Ok(array) => array,
        Err(_) => unreachable!("the vector has PLACES elements"),
    }
}

impl Translator {
    /// A translator with its usual limits; nothing on hosts that it has no code generator for.
    pub fn new() -> Option<Translator> {
        Translator::with_limits(Limits::default())
    }

    /// A translator with other limits.
    pub fn with_limits(mut limits: Limits) -> Option<Translator> {
        limits.threshold = limits.threshold.min(REFUSED - 1);
        Some(Translator {
            compiler: Compiler::new()?,
            heat: Heat {
                left: table(limits.threshold),
            },
            places: table((0, 0)),
            covers: table(0),
            translated: Vec::new(),
            flash_stamp: None,
            limits,
            work: Work::default(),
        })
    }

    /// What it has done so far.
    pub fn work(&self) -> Work {
        self.work
    }

    /// Drops code that does not belong to this program memory.
    fn follow(&mut self, core: &Core) {
        self.flash_stamp = Some(core.flash_stamp());
        let flash = core.flash();
        let is_current = |translated: &Translated| {
            let mut source = translated.source.iter();
            source.all(|&(pc, word)| flash.get(usize::from(pc)) == Some(&word))
        };
        if self.translated.iter().all(is_current) {
            return;
        }
        self.translated.retain(is_current);
        self.heat.left.fill(self.limits.threshold);
        self.places.fill((0, 0));
        self.covers.fill(0);
        self.work.code_bytes = 0;
        for index in 0..self.translated.len() {
            self.enter(index);
        }
    }

    fn covered_threshold(&self) -> u32 {
        let threshold = self.limits.threshold.saturating_mul(COVERED_FACTOR);
        threshold.min(REFUSED - 1)
    }

    /// Makes the code of a region known to its places.
    fn enter(&mut self, index: usize) {
        let translated = &self.translated[index];
        self.work.code_bytes += translated.code.bytes();
        for &pc in &translated.covers {
            let pc = usize::from(pc);
            self.covers[pc] = self.covers[pc].saturating_add(1);
            if self.heat.left[pc] != TRANSLATED {
                self.heat.left[pc] = self.covered_threshold();
            }
        }
        for (number, &pc) in translated.entries.iter().enumerate() {
            self.places[usize::from(pc)] = (index as u32 + 1, number as u32);
            self.heat.left[usize::from(pc)] = TRANSLATED;
        }
    }

    /// The code at the program counter, which is translated if it has become hot, and the entry.
    fn code_here(&mut self, core: &Core) -> Option<(usize, u32)> {
        let pc = core.pc();
        let (index, entry) = self.places[usize::from(pc)];
        if index != 0 {
            return Some((index as usize - 1, entry));
        }
        let left = &mut self.heat.left[usize::from(pc)];
        match *left {
            REFUSED => return None,
            TRANSLATED => {}
            _ => {
                *left -= 1;
                return None;
            }
        }
        let begin = Instant::now();
        let translated = self.translate(core, pc);
        self.work.time += begin.elapsed();
        let Some(translated) = translated else {
            self.heat.left[usize::from(pc)] = REFUSED;
            return None;
        };
        self.work.regions += 1;
        self.translated.push(translated);
        self.enter(self.translated.len() - 1);
        Some((self.translated.len() - 1, 0))
    }

    fn translate(&mut self, core: &Core, pc: u16) -> Option<Translated> {
        if self.work.code_bytes >= self.limits.code_bytes {
            return None;
        }
        let region = explore(core, pc, self)?;
        let code = self.compiler.compile(&region, core)?;
        let entries = region.entries.iter().map(|&block| &region.blocks[block]);
        Some(Translated {
            entries: entries.map(|block| block.instructions[0].pc).collect(),
            covers: region.covers,
            code,
            source: region.source,
        })
    }
}

impl Places for Translator {
    fn is_cold(&self, pc: u16) -> bool {
        let pc = usize::from(pc);
        // If everything is to be translated, nothing has had the time to become warm.
        self.limits.threshold > 0 && self.heat.left[pc] == self.limits.threshold
    }

    fn is_entry(&self, pc: u16) -> bool {
        self.places[usize::from(pc)].0 != 0
    }

    fn is_covered(&self, pc: u16) -> bool {
        self.is_entry(pc) && self.covers[usize::from(pc)] >= MAX_COVERS
    }
}

impl Engine for Translator {
    fn run(&mut self, core: &mut Core) -> Exit {
        if self.flash_stamp != Some(core.flash_stamp()) {
            self.follow(core);
        }
        if core.has_traps() {
            return core.run();
        }
        loop {
            if let Some((index, entry)) = self.code_here(core) {
                self.work.entries += 1;
                match self.translated[index].code.run(core, entry) {
                    left::REGION => continue,
                    left::MACHINE if !core.is_due() => return Exit::Machine,
                    // The few cycles that are left.
                    left::BUDGET | left::MACHINE => return core.run(),
                    _ => {}
                }
            }
            self.work.interpreted += 1;
            match core.run_watched(&mut self.heat) {
                Exit::Arrival => {}
                exit => return exit,
            }
        }
    }
}

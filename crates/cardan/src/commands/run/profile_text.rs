//! The profile of a run as tables for people.

use std::fmt::{self, Display, Formatter};

use super::profile::{Cycles, Document};

/// Rows of functions and of lines that are shown; the files hold all.
const ROWS: usize = 20;
/// Columns of the longest bar.
const BAR: u64 = 40;

impl Display for Document {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        self.show_functions(f)?;
        self.show_lines(f)?;
        self.show_interrupts(f)?;
        self.show_load(f)?;
        self.show_memory(f)?;
        if self.call_paths_cut {
            writeln!(
                f,
                "\nnote: too many call paths; the deepest count for their callers"
            )?;
        }
        if let Some(problem) = &self.problem {
            writeln!(f, "\nnote: {problem}")?;
        }
        Ok(())
    }
}

impl Document {
    fn percent(&self, cycles: u64) -> f64 {
        100.0 * cycles as f64 / self.totals.cycles.max(1) as f64
    }

    fn show_functions(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "\n{:>14} {:>6} {:>14} {:>6} {:>10}  function",
            "self cycles", "%", "inclusive", "%", "calls"
        )?;
        for function in self.functions.iter().take(ROWS) {
            writeln!(
                f,
                "{:>14} {:>6.2} {:>14} {:>6.2} {:>10}  {}",
                function.self_cycles,
                self.percent(function.self_cycles),
                function.inclusive_cycles,
                self.percent(function.inclusive_cycles),
                function.calls,
                function.name.as_deref().unwrap_or("(no symbol)")
            )?;
        }
        let others = self.functions.iter().skip(ROWS);
        let (count, cycles) = others.fold((0, 0), |(count, cycles), function| {
            (count + 1, cycles + function.self_cycles)
        });
        let totals = &self.totals;
        for (cycles, what) in [
            (cycles, format!("({count} other functions)")),
            (
                totals.interrupt_entry_cycles,
                "(interrupt entries)".to_owned(),
            ),
            (totals.asleep_cycles, "(asleep)".to_owned()),
            (
                totals.halted_cycles,
                "(halted after sleep and reset)".to_owned(),
            ),
        ] {
            if cycles > 0 {
                let percent = self.percent(cycles);
                writeln!(
                    f,
                    "{cycles:>14} {percent:>6.2} {:>14} {:>6} {:>10}  {what}",
                    "", "", ""
                )?;
            }
        }
        writeln!(
            f,
            "{:>14} {:>6.2} {:>14} {:>6} {:>10}  total",
            totals.cycles, 100.0, "", "", ""
        )
    }

    fn show_lines(&self, f: &mut Formatter<'_>) -> fmt::Result {
        if self.lines.is_empty() {
            return Ok(());
        }
        writeln!(
            f,
            "\n{:>14} {:>6} {:>14}  source line",
            "cycles", "%", "executed"
        )?;
        for line in self.lines.iter().take(ROWS) {
            let percent = self.percent(line.cycles);
            writeln!(
                f,
                "{:>14} {percent:>6.2} {:>14}  {}:{}",
                line.cycles, line.count, line.file, line.line
            )?;
        }
        Ok(())
    }

    fn show_interrupts(&self, f: &mut Formatter<'_>) -> fmt::Result {
        if self.interrupts.is_empty() {
            return Ok(());
        }
        writeln!(
            f,
            "\n{:<14} {:>10} {:>7}   {:<24}   duration in cycles: min mean max",
            "interrupt", "taken", "load %", "latency: min mean max"
        )?;
        for interrupt in &self.interrupts {
            let load = 100.0 * interrupt.load.unwrap_or(0.0);
            writeln!(
                f,
                "{:<14} {:>10} {load:>7.2}   {:<24}   {}",
                interrupt.name,
                interrupt.count,
                summary(&interrupt.latency),
                summary(&interrupt.duration)
            )?;
        }
        for interrupt in &self.interrupts {
            writeln!(f, "\nlatency of {} in cycles", interrupt.name)?;
            let most = interrupt.latency.bins.iter().map(|bin| bin.count).max();
            for bin in &interrupt.latency.bins {
                let range = match bin.to {
                    u64::MAX => format!("{}..", bin.from),
                    to if to == bin.from => to.to_string(),
                    to => format!("{}..{to}", bin.from),
                };
                let bar = bar(bin.count, most.unwrap_or(0));
                writeln!(f, "{range:>14} {:>10} {bar}", bin.count)?;
            }
        }
        Ok(())
    }

    fn show_load(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let percent = |share: Option<f64>| 100.0 * share.unwrap_or(0.0);
        writeln!(
            f,
            "\nprocessor awake {:.2} % of the time, in interrupts {:.2} %",
            percent(self.load.awake),
            percent(self.load.interrupts)
        )?;
        if self.totals.asleep_cycles == 0 {
            return Ok(());
        }
        writeln!(
            f,
            "windows of {} cycles by time awake",
            self.load.window_cycles
        )?;
        let most = self.load.histogram.iter().copied().max().unwrap_or(0);
        for (class, &count) in self.load.histogram.iter().enumerate() {
            let bar = bar(count, most);
            writeln!(
                f,
                "{:>10} % {count:>10} {bar}",
                format!("..{}", (class + 1) * 10)
            )?;
        }
        Ok(())
    }

    fn show_memory(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let (stack, memory) = (&self.stack, &self.memory);
        write!(
            f,
            "\nstack at its deepest {} bytes, at {:#06x}",
            stack.peak_bytes, stack.pc
        )?;
        match &stack.place {
            Some(place) => writeln!(f, " in {place}")?,
            None => writeln!(f)?,
        }
        if !stack.path.is_empty() {
            writeln!(f, "    {}", stack.path.join(" > "))?;
        }
        write!(
            f,
            "flash {} of {} bytes; SRAM of {} bytes: ",
            memory.flash_bytes, memory.flash_size, memory.sram_size
        )?;
        match (memory.static_bytes, memory.sram_free_bytes) {
            (Some(bytes), Some(free @ 0..)) => writeln!(
                f,
                "variables {bytes}, stack {}, never used {free}",
                stack.peak_bytes
            ),
            (Some(bytes), Some(free)) => writeln!(
                f,
                "variables {bytes}, stack {}: THEY OVERLAP by {} bytes",
                stack.peak_bytes, -free
            ),
            _ => writeln!(
                f,
                "stack {}, variables unknown (no symbols)",
                stack.peak_bytes
            ),
        }
    }
}

fn summary(cycles: &Cycles) -> String {
    match (cycles.min, cycles.mean, cycles.max) {
        (Some(min), Some(mean), Some(max)) => format!("{min} {mean:.1} {max}"),
        _ => "-".to_owned(),
    }
}

fn bar(count: u64, most: u64) -> String {
    let columns = (count * BAR).div_ceil(most.max(1));
    "#".repeat(columns.min(BAR) as usize)
}

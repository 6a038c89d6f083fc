//! Commands of our own: what is typed after `monitor`.

use std::fmt::Write;

use super::chip::Chip;
use crate::environment::Environment;

const HELP: &str = "\
monitor cycles       cycles, instructions and time since the start
monitor io [NAME]    I/O registers, read without side effects
monitor interrupts   interrupts taken and their worst latency
monitor reports      odd accesses of the program so far
monitor reset        reset as by pin RESET (then: maintenance flush register-cache)
monitor help         this list
";

impl<E: Environment> Chip<E> {
    /// The answer to a command.
    pub(super) fn monitor(&mut self, command: &str) -> String {
        let words: Vec<&str> = command.split_whitespace().collect();
        match words[..] {
            ["cycles"] => self.cycles(),
            ["io"] => self.registers(None),
            ["io", name] => self.registers(Some(name)),
            ["interrupts"] => self.interrupts(),
            ["reports"] => self.reports(),
            ["reset"] => {
                self.reset();
                format!("reset; pc = {:#06x}\n", self.machine.pc())
            }
            [] | ["help"] => HELP.to_owned(),
            _ => format!("unknown command `{command}`; there are:\n{HELP}"),
        }
    }

    fn cycles(&self) -> String {
        let statistics = self.machine.statistics();
        format!(
            "{} cycles, {} instructions, {} cycles asleep; {} Hz\n",
            statistics.cycles,
            statistics.instructions,
            statistics.sleeping_cycles,
            self.machine.frequency_hz(),
        )
    }

    fn registers(&mut self, wanted: Option<&str>) -> String {
        let mut text = String::new();
        let device = self.machine.device();
        for (address, name) in device.registers.iter().copied() {
            if wanted.is_some_and(|wanted| !name.eq_ignore_ascii_case(wanted)) {
                continue;
            }
            let value = self
                .machine
                .peek(address..address + 1, &mut self.environment);
            for value in value {
                let _ = writeln!(
                    text,
                    "{name:<8} {address:#06x}  {value:#04x}  {value:#010b}"
                );
            }
        }
        match wanted {
            Some(name) if text.is_empty() => {
                format!("no register is called `{name}` on the {}\n", device.name)
            }
            _ => text,
        }
    }

    fn interrupts(&self) -> String {
        let mut text = String::new();
        let names = self.machine.device().vectors;
        for (name, vector) in names.iter().zip(self.machine.statistics().vectors) {
            if vector.count > 0 {
                let _ = writeln!(
                    text,
                    "{name:<14} {:>10} times, at most {} cycles late",
                    vector.count, vector.latency_max
                );
            }
        }
        if text.is_empty() {
            text.push_str("none yet\n");
        }
        text
    }

    fn reports(&self) -> String {
        let mut text = String::new();
        for report in self.machine.reports() {
            let _ = writeln!(text, "{report}");
        }
        if text.is_empty() {
            text.push_str("none\n");
        }
        text
    }
}

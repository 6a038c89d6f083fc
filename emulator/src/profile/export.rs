//! Formats that other programs read: lcov's tracefile, folded stacks.

use std::collections::BTreeMap;
use std::fmt::Write;

use super::report::{FunctionCost, LineCost, Report};
use crate::symbols::Symbols;

impl Report {
    /// Call paths as `flamegraph.pl` and inferno read them: one line each, names from the origin to
    /// the innermost function with semicolons between them, a space, and the path's own cycles.
    pub fn folded(&self) -> String {
        let mut lines: Vec<String> = self
            .paths
            .iter()
            .map(|(names, cycles)| {
                let names: Vec<String> = names.iter().map(|name| name.replace(';', ":")).collect();
                format!("{} {cycles}\n", names.join(";"))
            })
            .collect();
        lines.sort();
        lines.concat()
    }

    /// Line coverage as lcov and genhtml read it. Functions have their names in the file, which
    /// `genhtml --demangle-cpp` spells out.
    pub fn lcov(&self, symbols: &Symbols) -> String {
        let mut files: BTreeMap<&str, Source<'_>> = BTreeMap::new();
        for line in &self.lines {
            files.entry(&line.file).or_default().lines.push(line);
        }
        let executed: BTreeMap<u32, &FunctionCost> = self
            .functions
            .iter()
            .filter_map(|cost| Some((cost.function.as_ref()?.start, cost)))
            .collect();
        for function in symbols.functions() {
            if let Some((file, line)) = symbols.line_at(function.start)
                && let Some(source) = files.get_mut(file)
            {
                // What was executed was entered, if only by running into it.
                let calls = executed
                    .get(&function.start)
                    .map_or(0, |cost| cost.calls.max(1));
                source.functions.push((line, &function.symbol, calls));
            }
        }
        let mut text = String::from("TN:\n");
        for (name, source) in files {
            // Writing into a String cannot fail.
            let _ = source.write(name, &mut text);
        }
        text
    }
}

#[derive(Default)]
struct Source<'a> {
    lines: Vec<&'a LineCost>,
    /// Line, name, calls.
    functions: Vec<(u32, &'a str, u64)>,
}

impl Source<'_> {
    fn write(&self, name: &str, text: &mut String) -> std::fmt::Result {
        writeln!(text, "SF:{name}")?;
        for (line, function, _) in &self.functions {
            writeln!(text, "FN:{line},{function}")?;
        }
        for (_, function, calls) in &self.functions {
            writeln!(text, "FNDA:{calls},{function}")?;
        }
        let hit = self.functions.iter().filter(|function| function.2 > 0);
        writeln!(text, "FNF:{}\nFNH:{}", self.functions.len(), hit.count())?;
        for line in &self.lines {
            writeln!(text, "DA:{},{}", line.line, line.count)?;
        }
        let hit = self.lines.iter().filter(|line| line.count > 0);
        writeln!(
            text,
            "LF:{}\nLH:{}\nend_of_record",
            self.lines.len(),
            hit.count()
        )
    }
}

//! Prints what is known of a program's places: functions, and source lines with inlined calls.
//!
//! `cargo run --release -p cardan-emulator --example places -- IMAGE`

use std::error::Error;

use cardan_emulator::Symbols;

fn main() -> Result<(), Box<dyn Error>> {
    let file = std::env::args().nth(1).ok_or("usage: places IMAGE")?;
    let symbols = Symbols::parse(&std::fs::read(file)?);
    let base = std::env::current_dir()?;
    for function in symbols.functions() {
        println!(
            "{:#06x}..{:#06x} {}",
            function.start, function.end, function.name
        );
        let rows = symbols.rows().iter();
        for row in rows.filter(|row| (function.start..function.end).contains(&row.start)) {
            let place = symbols.describe(row.start, &base).unwrap_or_default();
            println!("    {:#06x} {place}", row.start);
        }
    }
    if let Some(problem) = symbols.problem() {
        println!("note: {problem}");
    }
    Ok(())
}

//! The signals of a dump: names on the command line to pins, voltages, registers and variables.

use cardan_emulator::{Device, Image, Memory, Pin, Symbol, Watched, demangle};

/// What a signal shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Source {
    /// The level that the chip drives.
    Pin(Pin),
    /// The voltage of an ADC channel when it is held.
    Analog(u8),
    /// A register or variable.
    Value(Watched),
}

/// A signal.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Signal {
    pub(super) name: String,
    /// Scope it is shown in.
    pub(super) scope: &'static str,
    pub(super) source: Source,
    pub(super) bits: u32,
    pub(super) is_signed: bool,
}

/// The scopes, in the order in which they are written.
pub(super) const SCOPES: [&str; 5] = ["pins", "analog", "core", "io", "variables"];
/// What can be asked for.
const EXPECTED: &str = "expected a pin (PB0), adc0_V to adc7_V, r0 to r31, sreg, sp, pc, an I/O \
                        register that keeps what is written (OCR1A, PORTB, GPIOR0 ...), a variable \
                        of the program, each with a type if need be (count:i16), or an address \
                        (@0x0123:u8)";
/// Most names that a refusal suggests.
const SUGGESTIONS: usize = 3;

/// All pins, which is what a dump shows by default.
pub(super) fn pins() -> Vec<Signal> {
    let all = (0..3).flat_map(|port| (0..8).filter_map(move |bit| Pin::new(port, bit)));
    all.map(|pin| Signal::new("pins", pin.to_string(), Source::Pin(pin), 1))
        .collect()
}

/// The signals called `names`; an error names the one that does not exist.
pub(super) fn named(
    names: &[String],
    image: &Image,
    device: &Device,
) -> Result<Vec<Signal>, String> {
    let mut signals: Vec<Signal> = Vec::new();
    for name in names {
        let signal = Finder { image, device }
            .find(name)
            .map_err(|what| format!("--vcd-signal {name}: {what}"))?;
        if signals.iter().any(|known| known.name == signal.name) {
            return Err(format!("--vcd-signal {name} is given twice; remove one"));
        }
        signals.push(signal);
    }
    Ok(signals)
}

impl Signal {
    fn new(scope: &'static str, name: impl Into<String>, source: Source, bits: u32) -> Self {
        Self {
            // White space would end the name in the file.
            name: name.into().replace(char::is_whitespace, "_"),
            scope,
            source,
            bits,
            is_signed: false,
        }
    }
}

/// A type after the name: bytes and sign.
#[derive(Clone, Copy)]
struct Type {
    bytes: u8,
    is_signed: bool,
}

/// `NAME:u16` taken apart; a C++ name has colons, too, but two in a row.
fn split(text: &str) -> (&str, Option<Type>) {
    let whole = (text, None);
    let Some((name, kind)) = text.rsplit_once(':') else {
        return whole;
    };
    let (sign, bits) = kind.split_at_checked(1).unwrap_or(("", ""));
    let bytes = match bits {
        "8" => 1,
        "16" => 2,
        "24" => 3,
        "32" => 4,
        "64" => 8,
        _ => return whole,
    };
    match sign {
        "u" | "i" if !name.is_empty() && !name.ends_with(':') => {
            let is_signed = sign == "i";
            (name, Some(Type { bytes, is_signed }))
        }
        _ => whole,
    }
}

struct Finder<'a> {
    image: &'a Image,
    device: &'a Device,
}

impl Finder<'_> {
    fn find(&self, text: &str) -> Result<Signal, String> {
        let (name, kind) = split(text);
        let found = self
            .pin_or_core(name)
            .or_else(|| self.register(name).transpose())
            .or_else(|| self.address(name, kind).transpose());
        if let Some(found) = found.transpose()? {
            let has_own_type = kind.is_some() && !name.starts_with('@');
            return match has_own_type {
                true => Err("only variables and addresses take a type; leave it out".to_owned()),
                false => Ok(found),
            };
        }
        self.variable(name, kind)
    }

    fn pin_or_core(&self, name: &str) -> Option<Result<Signal, String>> {
        if let Ok(pin) = name.parse::<Pin>() {
            return Some(Ok(Signal::new(
                "pins",
                pin.to_string(),
                Source::Pin(pin),
                1,
            )));
        }
        let volts = name
            .strip_prefix("adc")
            .and_then(|rest| rest.strip_suffix("_V"));
        if let Some(channel) = volts.and_then(|channel| channel.parse().ok())
            && channel < 8
        {
            return Some(Ok(Signal::new("analog", name, Source::Analog(channel), 64)));
        }
        let (watched, bits) = match name {
            "pc" => (Watched::ProgramCounter, 16),
            "sp" => (Watched::StackPointer, 16),
            "sreg" => (Watched::Status, 8),
            _ => {
                let number: u16 = name.strip_prefix('r')?.parse().ok()?;
                let is_plain = number < 32 && name == format!("r{number}");
                let register = Watched::Memory {
                    address: number,
                    bytes: 1,
                };
                (is_plain.then_some(register)?, 8)
            }
        };
        Some(Ok(Signal::new("core", name, Source::Value(watched), bits)))
    }

    /// An I/O register, or two that belong together.
    fn register(&self, name: &str) -> Result<Option<Signal>, String> {
        let address = |name: &str| {
            let mut registers = self.device.registers.iter();
            registers.find(|register| register.1 == name).map(|r| r.0)
        };
        let pair = address(&format!("{name}L")).zip(address(&format!("{name}H")));
        let (address, bytes) = match (address(name), pair) {
            (Some(address), _) => (address, 1),
            (None, Some((low, high))) if high == low + 1 => (low, 2),
            _ => return Ok(None),
        };
        // What a register keeps does not depend on the state: any machine knows which do.
        let machine = cardan_emulator::Machine::new(&cardan_emulator::ATMEGA328P, 1);
        if (0..u16::from(bytes)).any(|i| machine.stored_register(address + i).is_none()) {
            return Err(
                "the chip changes this register by itself, or reading it has an effect; a dump \
                 shows registers that keep what the program writes, such as OCR1A or PORTB"
                    .to_owned(),
            );
        }
        let watched = Watched::Register { address, bytes };
        let bits = u32::from(bytes) * 8;
        Ok(Some(Signal::new("io", name, Source::Value(watched), bits)))
    }

    /// `@0x0123`.
    fn address(&self, name: &str, kind: Option<Type>) -> Result<Option<Signal>, String> {
        let Some(digits) = name.strip_prefix('@') else {
            return Ok(None);
        };
        let address = match digits.strip_prefix("0x") {
            Some(digits) => u16::from_str_radix(digits, 16).ok(),
            None => digits.parse().ok(),
        };
        let address = address.ok_or("expected an address such as @0x0123:u8")?;
        let kind = kind.unwrap_or(Type {
            bytes: 1,
            is_signed: false,
        });
        self.memory(name, address.into(), kind).map(Some)
    }

    fn variable(&self, name: &str, kind: Option<Type>) -> Result<Signal, String> {
        let data = || {
            let symbols = self.image.symbols.iter();
            symbols.filter(|symbol| symbol.memory == Memory::Data)
        };
        let raw = data().find(|symbol| symbol.name == name);
        let symbol = raw.or_else(|| data().find(|symbol| demangle(&symbol.name) == name));
        let symbol = symbol.ok_or_else(|| self.unknown(name, data()))?;
        let kind = match (kind, symbol.size) {
            (Some(kind), _) => kind,
            (None, 1 | 2 | 3 | 4 | 8) => Type {
                bytes: symbol.size as u8,
                is_signed: false,
            },
            (None, size) => {
                return Err(format!(
                    "this variable has {size} bytes; say how its first bytes are to be read: \
                     {name}:u8, :u16, :u32, :u64, :i8 ..."
                ));
            }
        };
        self.memory(name, symbol.address, kind)
    }

    fn memory(&self, name: &str, address: u32, kind: Type) -> Result<Signal, String> {
        let end = address + u32::from(kind.bytes);
        let is_sram = address >= u32::from(self.device.sram_start)
            && end <= u32::from(self.device.ram_end()) + 1;
        if !is_sram && end > 32 {
            return Err(format!(
                "{address:#06x} is no place in SRAM ({:#06x} to {:#06x}); I/O registers go by name",
                self.device.sram_start,
                self.device.ram_end()
            ));
        }
        let watched = Watched::Memory {
            address: address as u16,
            bytes: kind.bytes,
        };
        let bits = u32::from(kind.bytes) * 8;
        Ok(Signal {
            is_signed: kind.is_signed,
            ..Signal::new("variables", name, Source::Value(watched), bits)
        })
    }

    fn unknown<'s>(&self, name: &str, data: impl Iterator<Item = &'s Symbol>) -> String {
        let registers = self.device.registers.iter().map(|r| r.1.to_owned());
        let core = ["sreg", "sp", "pc"].map(str::to_owned);
        let variables = data
            .filter(|symbol| symbol.size > 0)
            .map(|symbol| demangle(&symbol.name));
        let all = registers.chain(core).chain(variables);
        let folded = name.to_ascii_lowercase();
        let mut near: Vec<(f64, String)> = all
            .map(|known| {
                let alike = strsim::jaro_winkler(&folded, &known.to_ascii_lowercase());
                (alike, known)
            })
            .filter(|(alike, _)| *alike > 0.75)
            .collect();
        near.sort_by(|a, b| b.0.total_cmp(&a.0).then_with(|| a.1.cmp(&b.1)));
        near.dedup_by(|a, b| a.1 == b.1);
        let near: Vec<String> = near
            .into_iter()
            .take(SUGGESTIONS)
            .map(|(_, known)| format!("`{known}`"))
            .collect();
        match near.is_empty() {
            true => format!("no such signal; {EXPECTED}"),
            false => format!(
                "no such signal; did you mean {}? {EXPECTED}",
                near.join(", ")
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn types_are_told_from_names_with_colons() {
        let taken = |text| {
            let (name, kind) = split(text);
            (name, kind.map(|kind| (kind.bytes, kind.is_signed)))
        };
        assert_eq!(taken("count"), ("count", None));
        assert_eq!(taken("count:u16"), ("count", Some((2, false))));
        assert_eq!(taken("a::b:i32"), ("a::b", Some((4, true))));
        assert_eq!(taken("a::u8"), ("a::u8", None));
        assert_eq!(taken(":u8"), (":u8", None));
        assert_eq!(taken("count:"), ("count:", None));
        assert_eq!(taken("count:\u{e9}8"), ("count:\u{e9}8", None));
    }
}

//! Node types from a word-length file, for build scripts.
//!
//! In `build.rs`: `cardan_datapath::codegen::generate_to_out_dir("wordlengths.toml")`, and in the
//! crate: `include!(concat!(env!("OUT_DIR"), "/nodes.rs"));`.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::string::{String, ToString};
use std::vec::Vec;
use std::{env, format, fs, println};

use crate::wordlengths::{self, DeclaredNode, WordlengthsError, container_bits, type_name};

/// Reads the word-length file and writes `nodes.rs` into Cargo's `OUT_DIR`. The environment variable
/// `CARDAN_WORDLENGTHS` names another file, so that a candidate can be built without editing the
/// source tree.
///
/// # Errors
/// A file that cannot be read or is refused.
pub fn generate_to_out_dir(default_file: &str) -> Result<(), String> {
    println!("cargo::rerun-if-env-changed=CARDAN_WORDLENGTHS");
    println!("cargo::rerun-if-env-changed=CARDAN_SOURCES");
    let file = env::var_os("CARDAN_WORDLENGTHS")
        .map_or_else(|| PathBuf::from(default_file), PathBuf::from);
    println!("cargo::rerun-if-changed={}", file.display());
    let name = file.display().to_string();
    let text = fs::read_to_string(&file).map_err(|error| format!("{name}: {error}"))?;
    let nodes =
        wordlengths::parse(&text, &name).map_err(|error: WordlengthsError| error.to_string())?;
    let out = env::var("OUT_DIR").map_err(|_| "OUT_DIR is not set: call this from build.rs")?;
    let sources = env::var("CARDAN_SOURCES").unwrap_or_default();
    let text = generate_with(&nodes, &sources);
    fs::write(Path::new(&out).join("nodes.rs"), text).map_err(|error| error.to_string())
}

/// Rust source of the nodes: a type per node, the table `NODES`, the format table `FORMAT_TABLE`, and
/// a macro: `format_section!(FORMAT_TABLE)` in a program makes it the symbol `CARDAN_FORMATS` in a
/// section that is not loaded. Hosts find it in the ELF file, and it takes no flash. (Only assembler
/// can make such a section, and it counts as unsafe code.)
#[must_use]
pub fn generate(nodes: &[DeclaredNode]) -> String {
    generate_with(nodes, "")
}

/// The same, with the digest of the program's sources (hexadecimal digits; else nothing), which goes beside
/// the format table as the symbol `CARDAN_SOURCES`. Hosts tell by it which sources an image was made of.
#[must_use]
pub fn generate_with(nodes: &[DeclaredNode], sources: &str) -> String {
    let mut out = String::from("// Generated from the word-length file.\n");
    for (index, node) in nodes.iter().enumerate() {
        let f = node.format;
        let container = container_bits(f.word);
        let _ = write!(
            out,
            "\n/// Node `{name}` in `{unit}`: {word} bits, {frac} fractional.\n\
             #[derive(Clone, Copy, Debug)]\n\
             pub struct {ty};\n\
             impl ::cardan_datapath::Node for {ty} {{\n    \
                 const INDEX: usize = {index};\n    \
                 const NAME: &'static str = {name:?};\n    \
                 const UNIT: &'static str = {unit:?};\n    \
                 const FORMAT: ::cardan_datapath::Format = ::cardan_datapath::Format::new({word}, {frac}, \
                 ::cardan_datapath::Rounding::{rounding:?}, ::cardan_datapath::Overflow::{overflow:?});\n    \
                 type Word = ::cardan_datapath::fixed::FixedI{container}<\
                 ::cardan_datapath::fixed::types::extra::U{frac}>;\n}}\n",
            name = node.name,
            unit = node.unit,
            ty = type_name(&node.name),
            word = f.word,
            frac = f.frac,
            rounding = f.rounding,
            overflow = f.overflow,
        );
    }
    let _ = writeln!(
        out,
        "\n/// Number of nodes.\npub const NODE_COUNT: usize = {};",
        nodes.len()
    );
    out.push_str(
        "\n/// All nodes in order.\npub const NODES: [::cardan_datapath::NodeInfo; NODE_COUNT] = [\n",
    );
    for node in nodes {
        let ty = type_name(&node.name);
        let _ = writeln!(
            out,
            "    ::cardan_datapath::NodeInfo {{ name: {:?}, unit: {:?}, \
             meaning: {:?}, format: <{ty} as ::cardan_datapath::Node>::FORMAT }},",
            node.name, node.unit, node.meaning
        );
    }
    out.push_str("];\n");
    push_format_table(&mut out, nodes.len(), sources);
    out
}

fn push_format_table(out: &mut String, nodes: usize, sources: &str) {
    let len = crate::format_table_len(nodes);
    let (places, bytes): (Vec<_>, Vec<_>) = (0..len)
        .map(|index| ("{}", format!("const $table[{index}]")))
        .unzip();
    let _ = write!(
        out,
        "\n/// What an image carries to tell its formats.\n\
         pub const FORMAT_TABLE: [u8; {len}] = ::cardan_datapath::format_table(&NODES);\n\
         \n/// Puts the table into a section of the program that is not loaded.\n\
         #[macro_export]\n\
         macro_rules! format_section {{\n    \
             ($table:expr) => {{\n        \
                 ::core::arch::global_asm!(\n            \
                     r#\".section .cardan.formats,\"\",@progbits\"#,\n            \
                     \".globl CARDAN_FORMATS\",\n            \
                     \".type CARDAN_FORMATS, @object\",\n            \
                     \".size CARDAN_FORMATS, {len}\",\n            \
                     \"CARDAN_FORMATS:\",\n            \
                     \".byte {places}\",\n            \
                     {sources}\".text\",\n            \
                     {bytes},\n        \
                 );\n    \
             }};\n\
         }}\n",
        places = places.join(", "),
        bytes = bytes.join(", "),
        sources = source_lines(sources),
    );
}

/// Lines of assembler that put the digest of the sources after the table.
fn source_lines(sources: &str) -> String {
    if sources.is_empty() || !sources.bytes().all(|byte| byte.is_ascii_hexdigit()) {
        return String::new();
    }
    format!(
        "\".globl CARDAN_SOURCES\",\n            \
         \".type CARDAN_SOURCES, @object\",\n            \
         \".size CARDAN_SOURCES, {len}\",\n            \
         \"CARDAN_SOURCES:\",\n            \
         \".byte {bytes}\",\n            ",
        len = sources.len(),
        bytes = sources
            .bytes()
            .map(|byte| byte.to_string())
            .collect::<Vec<_>>()
            .join(", "),
    )
}

//! Links with riscv-rt's script, for the memory in `memory.x`.

fn main() {
    println!("cargo::rustc-link-search={}", env!("CARGO_MANIFEST_DIR"));
    println!("cargo::rustc-link-arg-bins=-Tmemory.x");
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
    // Nothing in the program refers to its format table.
    println!("cargo::rustc-link-arg-bins=--undefined=CARDAN_FORMATS");
    println!("cargo::rerun-if-changed=memory.x");
}

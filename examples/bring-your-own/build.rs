//! Turns `wordlengths.toml` into node types.

fn main() {
    if let Err(error) = cardan_datapath::codegen::generate_to_out_dir("wordlengths.toml") {
        println!("cargo::error={error}");
    }
}

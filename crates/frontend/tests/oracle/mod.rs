//! Calls the oracle in Python.

use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::Value;

/// What to do when Python or scipy is missing.
const INSTALL: &str = "this test compares with scipy. Install it with\n  \
    python3 -m venv target/oracle && target/oracle/bin/pip install numpy scipy\nand run with \
    CARDAN_PYTHON=target/oracle/bin/python (an absolute path works from every folder)";

/// The oracle's answer to `request`.
///
/// # Panics
/// Python or scipy is missing (with the command that installs it), or the oracle fails.
pub(crate) fn ask(request: &Value) -> Value {
    let python = std::env::var("CARDAN_PYTHON").unwrap_or_else(|_| "python3".into());
    let usable = Command::new(&python)
        .args(["-c", "import numpy, scipy"])
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success());
    assert!(
        usable,
        "'{python}' cannot import numpy and scipy: {INSTALL}"
    );
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/oracle/oracle.py");
    let mut child = Command::new(&python)
        .arg(script)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("python starts");
    let mut input = child.stdin.take().expect("piped");
    input
        .write_all(request.to_string().as_bytes())
        .expect("the oracle reads its request");
    drop(input);
    let output = child.wait_with_output().expect("the oracle ends");
    assert!(output.status.success(), "the oracle failed");
    serde_json::from_slice(&output.stdout).expect("the oracle answers in JSON")
}

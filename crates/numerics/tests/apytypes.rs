//! The mixed arithmetic agrees with apytypes, an independent fixed-point library.
//!
//! Needs a Python with apytypes: `python3`, or the interpreter that `CARDAN_PYTHON` names.

use std::fmt::Write as _;
use std::io::Write as _;
use std::process::{Command, Stdio};

use cardan_datapath::fixed::FixedI8;
use cardan_datapath::fixed::types::extra::U0;
use cardan_datapath::{Arithmetic, Format, Node, NodeInfo, Overflow, Rounding, Value};
use cardan_numerics::{Formats, Mixed, Number, Recorder};
use rand_chacha::ChaCha8Rng;
use rand_core::{RngCore, SeedableRng};

const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/apytypes_oracle.py");
const OPERATIONS: [&str; 6] = ["add", "sub", "mul", "neg", "abs", "same"];
/// Cases per operation, rounding and overflow mode.
const CASES: usize = 500;

/// Node `I` of the test; its format is given at run time.
#[derive(Clone, Copy)]
struct At<const I: usize>;
impl<const I: usize> Node for At<I> {
    const INDEX: usize = I;
    const NAME: &'static str = "";
    const UNIT: &'static str = "1";
    const FORMAT: Format = Format::new(1, 0, Rounding::Floor, Overflow::Saturate);
    type Word = FixedI8<U0>;
}

struct Case {
    operation: &'static str,
    words: [i64; 2],
    formats: [Format; 3],
}

impl Case {
    fn any(
        rng: &mut ChaCha8Rng,
        operation: &'static str,
        rounding: Rounding,
        overflow: Overflow,
    ) -> Self {
        let formats = [(); 3].map(|()| {
            let word = 1 + rng.next_u32() % 64;
            Format::new(word, rng.next_u32() % (word + 1), rounding, overflow)
        });
        let mut word = |format: Format| {
            let less = rng.next_u32() % format.word;
            match rng.next_u32() % 8 {
                0 => format.min_raw(),
                1 => format.max_raw(),
                _ => rng.next_u64().cast_signed() >> (64 - format.word + less),
            }
        };
        let words = [word(formats[0]), word(formats[1])];
        Self {
            operation,
            words,
            formats,
        }
    }

    fn mixed(&self) -> i64 {
        let nodes = self.formats.map(|format| NodeInfo {
            name: "",
            unit: "1",
            meaning: "",
            format,
        });
        let m = Mixed::new(&Formats::deployed(&nodes).unwrap(), Recorder::new(3));
        let number = |at: usize| Number {
            real: self.formats[at].real(self.words[at]),
            raw: Some(self.words[at]),
        };
        let a: Value<_, At<0>> = Value::new(number(0));
        let b: Value<_, At<1>> = Value::new(number(1));
        let result: Value<_, At<2>> = match self.operation {
            "add" => m.add(a, b),
            "sub" => m.sub(a, b),
            "mul" => m.mul(a, b),
            "neg" => m.neg(a),
            "abs" => m.abs(a),
            "same" => m.shift::<_, _, 0>(a),
            other => unreachable!("{other} is not in OPERATIONS"),
        };
        result.word().raw.unwrap()
    }

    fn line(&self) -> String {
        let mut line = self.operation.to_string();
        for (raw, format) in self.words.iter().zip(&self.formats) {
            write!(line, " {raw} {} {}", format.word, format.frac).unwrap();
        }
        let n = self.formats[2];
        let (rounding, overflow) = (n.rounding.name(), n.overflow.name());
        writeln!(line, " {} {} {rounding} {overflow}", n.word, n.frac).unwrap();
        line
    }
}

fn cases() -> Vec<Case> {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut cases = Vec::new();
    for (rounding, _) in Rounding::ALL {
        for overflow in [Overflow::Wrap, Overflow::Saturate] {
            for operation in OPERATIONS {
                let case = |_| Case::any(&mut rng, operation, rounding, overflow);
                cases.extend((0..CASES).map(case));
            }
        }
    }
    cases
}

/// The results of apytypes; fails with what to install if it is missing.
fn apytypes(cases: &[Case]) -> Vec<i64> {
    let python = std::env::var("CARDAN_PYTHON").unwrap_or_else(|_| "python3".to_string());
    let mend =
        format!("`{python} -m pip install apytypes`, or name another Python in CARDAN_PYTHON");
    let present = Command::new(&python)
        .args(["-c", "import apytypes"])
        .output();
    assert!(
        present.is_ok_and(|output| output.status.success()),
        "{python} with apytypes is needed: {mend}"
    );
    let mut child = Command::new(&python)
        .arg(SCRIPT)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("the interpreter ran before");
    let lines: String = cases.iter().map(Case::line).collect();
    let mut stdin = child.stdin.take().expect("piped");
    let writer = std::thread::spawn(move || stdin.write_all(lines.as_bytes()));
    let output = child.wait_with_output().expect("the script ends");
    assert!(output.status.success(), "{SCRIPT} failed");
    writer
        .join()
        .expect("the writer ends")
        .expect("the script reads every case");
    let text = String::from_utf8(output.stdout).expect("numbers");
    text.lines()
        .map(|line| line.parse().expect("a raw word"))
        .collect()
}

#[test]
fn every_mode_that_apytypes_has_agrees() {
    let cases = cases();
    let expected = apytypes(&cases);
    assert_eq!(expected.len(), cases.len());
    for (case, expected) in cases.iter().zip(expected) {
        assert_eq!(case.mixed(), expected, "{}", case.line());
    }
}

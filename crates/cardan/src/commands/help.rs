//! What `--help` says below the options of each verb: examples, and what the exit codes mean.

/// What an exit code means.
macro_rules! code {
    (done) => {
        "\n  0  done; a verdict is pass"
    };
    (fail) => {
        "\n  1  done; the verdict is fail (tolerance missed, bits differ, budget not met, checks failed)"
    };
    (input) => {
        "\n  2  wrong usage or bad input; the message says what to change"
    };
    (participant) => {
        "\n  3  a participant died, timed out or could not start"
    };
    (crash) => {
        "\n  4  the emulated program crashed"
    };
    (built) => {
        "\n  0  done: every target that was asked for is built (--test: all tests passed)"
    };
    (partly_built) => {
        "\n  1  some targets are built, the others are listed with what installs their toolchain, or with the\n     compiler's message (--test: a test failed)"
    };
    (nothing_built) => {
        "\n  2  nothing could be built, wrong usage or bad input; the message says what to change"
    };
}

/// Examples, then the exit codes.
macro_rules! help {
    ($examples:literal, $($code:ident),+) => {
        concat!($examples, "\n\nExit codes:", $(code!($code)),+)
    };
}

/// Of `compare`.
pub(crate) const COMPARE: &str = help!(
    "\
Examples:
  cardan compare
  cardan compare --scenario static --seconds 4 --report out
  cardan compare --recording walk.csv.gz --set field.horizontal_ut=22 --set field.vertical_ut=42
  cardan compare --wordlengths mine.toml
  cardan compare --build                      # after a change of the firmware
  cardan compare --explain octant             # what a node is
  cardan compare --corners corners.toml --mc 100
  cardan compare --json > run.json; cardan compare --baseline run.json --junit cardan.xml

Pages in docs/ of the sources, by question: a first verdict, every line of a result, my recording, my
firmware, my word lengths, my CI (docs/README.md)",
    done, fail, input, participant, crash
);

/// Of `golden`.
pub(crate) const GOLDEN: &str = help!(
    "\
Examples:
  cardan golden --session s1   # beside native, emulate and diff on other terminals",
    done,
    input,
    participant
);

/// Of `native`.
pub(crate) const NATIVE: &str = help!(
    "\
Examples:
  cardan native --session s1   # beside golden, emulate and diff on other terminals",
    done,
    input,
    participant
);

/// Of `emulate`.
pub(crate) const EMULATE: &str = help!(
    "\
Examples:
  cardan emulate --session s1 --seconds 4   # beside golden, native and diff",
    done,
    input,
    participant
);

/// Of `diff`.
pub(crate) const DIFF: &str = help!(
    "\
Examples:
  cardan diff --session s1 --seconds 4      # the same run options as emulate",
    done,
    fail,
    input,
    participant,
    crash
);

/// Of `tune`.
pub(crate) const TUNE: &str = help!(
    "\
Examples:
  cardan tune --budget 'attitude.rms<=0.02'
  cardan tune --budget 'attitude.rms<=0.02' 'overflow==0' --out mine.toml --report out
  cardan tune --cost cycles --budget 'attitude.rms<=0.02' --apply   # in a checkout: changes it",
    done,
    fail,
    input
);

/// Of `ranges`.
pub(crate) const RANGES: &str = help!(
    "\
Examples:
  cardan ranges
  cardan ranges --wordlengths mine.toml --also magnet --report out",
    done,
    input
);

/// Of `calibrate`.
pub(crate) const CALIBRATE: &str = help!(
    "\
Examples:
  cardan calibrate --out unit.hex
  cardan compare --eeprom unit.hex",
    done,
    fail,
    input,
    crash
);

/// Of `accuracy`.
pub(crate) const ACCURACY: &str = help!(
    "\
Examples:
  cardan accuracy
  cardan accuracy --chopping",
    done,
    input
);

/// Of `run`.
pub(crate) const RUN: &str = help!(
    "\
Examples:
  cardan run blink.elf
  cardan run monitor.hex --uart pty
  cardan run device.elf --stimulus volts.csv --vcd trace.vcd --cycles 16000000
  cardan run device.elf --profile",
    done,
    input,
    crash
);

/// Of `build`.
pub(crate) const BUILD: &str = help!(
    "\
Examples:
  cardan build
  cardan build --target all
  cardan build --wordlengths mine.toml --out images
  cardan build --checkout ~/cardan            # from anywhere",
    built,
    partly_built,
    nothing_built
);

/// Of `doctor`.
pub(crate) const DOCTOR: &str = help!(
    "\
Examples:
  cardan doctor",
    done,
    fail
);

/// Of `completions`.
pub(crate) const COMPLETIONS: &str = help!(
    "\
Examples:
  cardan completions bash > ~/.local/share/bash-completion/completions/cardan
  cardan completions zsh > ~/.zfunc/_cardan",
    done,
    input
);

/// Of `man`.
pub(crate) const MAN: &str = help!(
    "\
Examples:
  cardan man | man -l -
  cardan man --out ~/.local/share/man/man1",
    done,
    input
);

/// Of the program.
pub(crate) const TOP: &str = help!(
    "\
Examples:
  cardan compare                   # golden model, native and emulated firmware on the bundled scenario
  cardan tune --budget 'attitude.rms<=0.02'
  cardan run firmware.elf",
    done, fail, input, participant, crash
);

//! What `--help` says below the options of each verb: examples, and what the exit codes mean.

/// Of `compare`.
pub(crate) const COMPARE: &str = "\
Examples:
  cardan compare
  cardan compare --scenario static --seconds 4 --report out
  cardan compare --recording walk.csv.gz --set field.horizontal_ut=22 --set field.vertical_ut=42
  cardan compare --wordlengths mine.toml
  cardan compare --build                      # after a change of the firmware
  cardan compare --explain octant             # what a node is
  cardan compare --corners corners.toml --mc 100
  cardan compare --json > run.json; cardan compare --baseline run.json --junit cardan.xml

Exit codes:
  0  done; a verdict is pass
  1  done; the verdict is fail (tolerance missed, bits differ, budget not met, checks failed)
  2  wrong usage or bad input; the message says what to change
  3  a participant died, timed out or could not start
  4  the emulated program crashed";

/// Of `golden`.
pub(crate) const GOLDEN: &str = "\
Examples:
  cardan golden --session s1   # beside native, emulate and diff on other terminals

Exit codes:
  0  done; a verdict is pass
  2  wrong usage or bad input; the message says what to change
  3  a participant died, timed out or could not start";

/// Of `native`.
pub(crate) const NATIVE: &str = "\
Examples:
  cardan native --session s1   # beside golden, emulate and diff on other terminals

Exit codes:
  0  done; a verdict is pass
  2  wrong usage or bad input; the message says what to change
  3  a participant died, timed out or could not start";

/// Of `emulate`.
pub(crate) const EMULATE: &str = "\
Examples:
  cardan emulate --session s1 --seconds 4   # beside golden, native and diff

Exit codes:
  0  done; a verdict is pass
  2  wrong usage or bad input; the message says what to change
  3  a participant died, timed out or could not start";

/// Of `diff`.
pub(crate) const DIFF: &str = "\
Examples:
  cardan diff --session s1 --seconds 4      # the same run options as emulate

Exit codes:
  0  done; a verdict is pass
  1  done; the verdict is fail (tolerance missed, bits differ, budget not met, checks failed)
  2  wrong usage or bad input; the message says what to change
  3  a participant died, timed out or could not start
  4  the emulated program crashed";

/// Of `tune`.
pub(crate) const TUNE: &str = "\
Examples:
  cardan tune --budget 'attitude.rms<=0.02'
  cardan tune --budget 'attitude.rms<=0.02' 'overflow==0' --out mine.toml --report out
  cardan tune --cost cycles --budget 'attitude.rms<=0.02' --apply   # in a checkout: changes it

Exit codes:
  0  done; a verdict is pass
  1  done; the verdict is fail (tolerance missed, bits differ, budget not met, checks failed)
  2  wrong usage or bad input; the message says what to change";

/// Of `ranges`.
pub(crate) const RANGES: &str = "\
Examples:
  cardan ranges
  cardan ranges --wordlengths mine.toml --also magnet --report out

Exit codes:
  0  done; a verdict is pass
  2  wrong usage or bad input; the message says what to change";

/// Of `calibrate`.
pub(crate) const CALIBRATE: &str = "\
Examples:
  cardan calibrate --out unit.hex
  cardan compare --eeprom unit.hex

Exit codes:
  0  done; a verdict is pass
  1  done; the verdict is fail (tolerance missed, bits differ, budget not met, checks failed)
  2  wrong usage or bad input; the message says what to change
  4  the emulated program crashed";

/// Of `accuracy`.
pub(crate) const ACCURACY: &str = "\
Examples:
  cardan accuracy
  cardan accuracy --chopping

Exit codes:
  0  done; a verdict is pass
  2  wrong usage or bad input; the message says what to change";

/// Of `run`.
pub(crate) const RUN: &str = "\
Examples:
  cardan run blink.elf
  cardan run monitor.hex --uart pty
  cardan run device.elf --stimulus volts.csv --vcd trace.vcd --cycles 16000000
  cardan run device.elf --profile

Exit codes:
  0  done; a verdict is pass
  2  wrong usage or bad input; the message says what to change
  4  the emulated program crashed";

/// Of `build`.
pub(crate) const BUILD: &str = "\
Examples:
  cardan build
  cardan build --target all
  cardan build --wordlengths mine.toml --out images
  cardan build --checkout ~/cardan            # from anywhere

Exit codes:
  0  done: every target that was asked for is built (--test: all tests passed)
  1  some targets are built, the others are listed with what installs their toolchain, or with the
     compiler's message (--test: a test failed)
  2  nothing could be built, wrong usage or bad input; the message says what to change";

/// Of `doctor`.
pub(crate) const DOCTOR: &str = "\
Examples:
  cardan doctor

Exit codes:
  0  done; a verdict is pass
  1  done; the verdict is fail (tolerance missed, bits differ, budget not met, checks failed)";

/// Of `completions`.
pub(crate) const COMPLETIONS: &str = "\
Examples:
  cardan completions bash > ~/.local/share/bash-completion/completions/cardan
  cardan completions zsh > ~/.zfunc/_cardan

Exit codes:
  0  done; a verdict is pass
  2  wrong usage or bad input; the message says what to change";

/// Of `man`.
pub(crate) const MAN: &str = "\
Examples:
  cardan man | man -l -
  cardan man --out ~/.local/share/man/man1

Exit codes:
  0  done; a verdict is pass
  2  wrong usage or bad input; the message says what to change";

/// Of the program.
pub(crate) const TOP: &str = "\
Examples:
  cardan compare                   # golden model, native and emulated firmware on the bundled scenario
  cardan tune --budget 'attitude.rms<=0.02'
  cardan run firmware.elf

Exit codes:
  0  done; a verdict is pass
  1  done; the verdict is fail (tolerance missed, bits differ, budget not met, checks failed)
  2  wrong usage or bad input; the message says what to change
  3  a participant died, timed out or could not start
  4  the emulated program crashed";

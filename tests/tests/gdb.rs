//! `run --gdb` with the real `avr-gdb`.

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, Output, Stdio};
use std::thread::{self, JoinHandle};

use cardan_tests::program::{compile_for_debugger, folder, hex_text, text, write};
use cardan_tests::{cardan, run, stderr};
use serde_json::Value;

/// The debugger.
const GDB: &str = "avr-gdb";

/// A run that waits for a debugger.
struct Waiting {
    child: Child,
    /// HOST:PORT.
    place: String,
    /// The rest of standard error, read all along so that the run never waits for us.
    said: JoinHandle<String>,
}

impl Waiting {
    fn start(file: &Path, arguments: &[&str]) -> Self {
        let mut child = Command::new(cardan())
            .args(["run", text(file), "--json", "--gdb", "0"])
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("cardan starts");
        let mut from = BufReader::new(child.stderr.take().expect("piped"));
        let mut line = String::new();
        from.read_line(&mut line).expect("readable");
        let place = line.strip_prefix("gdb: waiting at ");
        let place = place.and_then(|rest| rest.split(';').next());
        let place = place
            .unwrap_or_else(|| panic!("no port: {line}"))
            .to_owned();
        let said = thread::spawn(move || rest(from));
        Self { child, place, said }
    }

    /// Its document, what it said, and its exit code.
    fn end(self) -> (Value, String, i32) {
        let output = self.child.wait_with_output().expect("our child");
        let said = self.said.join().expect("it reads");
        let document = serde_json::from_slice(&output.stdout)
            .unwrap_or_else(|error| panic!("{error}: {said}"));
        (
            document,
            said,
            output.status.code().expect("it ends by itself"),
        )
    }
}

fn rest(mut from: BufReader<ChildStderr>) -> String {
    let mut said = Vec::new();
    from.read_to_end(&mut said).expect("readable");
    String::from_utf8_lossy(&said).into_owned()
}

/// Scripts `avr-gdb` and returns what it says.
fn gdb(file: &Path, place: &str, commands: &str) -> String {
    let script = file.with_extension("gdb");
    let head = format!(
        "set pagination off\nset confirm off\nset width 0\nfile {}\ntarget remote {place}\n",
        text(file)
    );
    fs::write(&script, head + commands).expect("the folder is ours");
    // Both of its outputs in one, in order.
    let log = file.with_extension("log");
    let to = fs::File::create(&log).expect("the folder is ours");
    Command::new(GDB)
        .args(["-nx", "-batch", "-x", text(&script)])
        .stdin(Stdio::null())
        .stdout(to.try_clone().expect("a file"))
        .stderr(to)
        .status()
        .unwrap_or_else(|error| missing(&error));
    String::from_utf8_lossy(&fs::read(log).expect("written")).into_owned()
}

fn missing(error: &std::io::Error) -> ! {
    panic!("{GDB} cannot be started ({error}); install it: apt-get install gdb-avr")
}

/// A whole session: what GDB says, and what the run leaves.
fn session(file: &Path, arguments: &[&str], commands: &str) -> (String, Value, String, i32) {
    let waiting = Waiting::start(file, arguments);
    let said = gdb(file, &waiting.place, commands);
    let (document, errors, code) = waiting.end();
    (said, document, errors, code)
}

fn program(folder: &Path) -> PathBuf {
    compile_for_debugger("debugged", folder)
}

/// Asserts that the texts stand in `said` in this order.
fn in_order(said: &str, texts: &[&str]) {
    let mut left = said;
    for text in texts {
        match left.split_once(text) {
            Some((_, after)) => left = after,
            None => panic!("`{text}` is not said, or too early:\n{said}"),
        }
    }
}

/// The document without what the host's speed decides.
fn timeless(mut document: Value) -> Value {
    for name in ["host_seconds", "mcycles_per_second"] {
        document[name] = Value::Null;
    }
    document
}

#[test]
fn breakpoints_backtraces_values_and_steps_follow_the_source() {
    let folder = folder();
    let file = program(folder.path());
    let (said, _, _, code) = session(
        &file,
        &[],
        "break inner\ncontinue\nbacktrace\nprint x\nfinish\ndelete\n\
         hbreak outer if x == 3\ncontinue\nnext\nprint $r24\nstep\nstepi\ninfo registers pc\n\
         info symbol $pc\ndelete\ntbreak put\ncontinue\nkill\n",
    );
    in_order(
        &said,
        &[
            "Breakpoint 1, inner (x=1",
            "#0  inner (x=1",
            "#1  ",
            "outer (x=1",
            "#2  ",
            "main ()",
            "$1 = 1",
            "Value returned is $2 = 2",
            "Breakpoint 2, outer (x=3",
            "$3 = 8",
            "pc ",
            "Temporary breakpoint 3, put (c=101",
            "killed",
        ],
    );
    assert_eq!(code, 0);
}

#[test]
fn watchpoints_see_variables_and_registers_read_and_written() {
    let folder = folder();
    let file = program(folder.path());
    let (said, ..) = session(
        &file,
        &[],
        "watch total\ncontinue\ncontinue\ndelete\n\
         rwatch *(unsigned char*)0x8000c0\ncontinue\ndelete\n\
         awatch *(unsigned char*)0x800025\ncontinue\ndelete\n\
         watch ticks\ncontinue\nbacktrace 1\n",
    );
    in_order(
        &said,
        &[
            "Hardware watchpoint 1: total",
            "Old value = 0",
            "New value = 1",
            "inner (x=1",
            "Old value = 1",
            "New value = 3",
            "inner (x=2",
            // UCSR0A, on the way to the next byte.
            "Hardware read watchpoint 2",
            "put (c=99 'c')",
            // PORTB.
            "Hardware access (read/write) watchpoint 3",
            "Hardware watchpoint 4: ticks",
            "__vector_14 ()",
        ],
    );
}

#[test]
fn a_run_under_breakpoints_and_steps_is_the_run_without() {
    let folder = folder();
    let file = program(folder.path());
    let alone = run(&["run", text(&file), "--json"]);
    let alone = serde_json::from_slice(&alone.stdout).expect("a document");
    let commands = "break outer\nbreak __vector_14\nwatch total\ncontinue\ncontinue\ncontinue\nstepi 10\n\
                    next\nnext\nstep\ncontinue\nfinish\ncontinue\nx/64xb 0x800020\ninfo registers\n\
                    delete\nuntil\nstepi 200\ncontinue\nmonitor cycles\n";
    let (said, document, errors, code) = session(&file, &[], commands);
    assert_eq!(timeless(document), timeless(alone), "{said}");
    assert!(said.contains("SIGTERM"), "{said}");
    assert_eq!(code, 0);
    assert!(errors.starts_with("abcde"), "{errors}");
    let (_, document, ..) = session(&file, &[], "break inner\ncontinue\ndetach\n");
    let left = run(&["run", text(&file), "--json"]);
    let left = serde_json::from_slice(&left.stdout).expect("a document");
    assert_eq!(timeless(document), timeless(left), "after detaching");
}

#[test]
fn registers_and_memories_are_read_and_written_and_a_program_is_loaded() {
    let folder = folder();
    let file = program(folder.path());
    let (said, document, _, code) = session(
        &file,
        &["--program-exit"],
        "break outer if x == 4\ncontinue\nset var total = 100\nprint total\nset var $r20 = 7\n\
         print $r20\nset var *(unsigned char*)0x810005 = 0x42\nprint/x *(unsigned char*)0x810005\n\
         print/x *(unsigned char*)0x800025\nmonitor io PORTB\nmonitor nonsense\nmonitor reset\n\
         maintenance flush register-cache\nprint/x (int)$pc\nload\ndelete\nbreak inner\ncontinue\n\
         detach\n",
    );
    in_order(
        &said,
        &[
            "$1 = 100",
            "$2 = 7",
            "$3 = 0x42",
            "$4 = 0x9",
            "PORTB    0x0025  0x09",
            "unknown command `nonsense`",
            "monitor cycles",
            "reset; pc = 0x0000",
            "$5 = 0x0",
            "Loading section .text",
            "inner (x=1",
        ],
    );
    assert_eq!(document["stop"], "halt");
    assert_eq!(code, 15, "the sum of 1 to 5, from a fresh start");
}

#[test]
fn the_end_of_a_program_is_a_signal_and_the_run_keeps_its_exit_code() {
    let folder = folder();
    let file = program(folder.path());
    let jump = "break main\ncontinue\n";
    let crash = format!("{jump}set var $pc = 0x7000\ncontinue\n");
    let (said, document, errors, code) = session(&file, &[], &crash);
    assert!(said.contains("SIGILL"), "{said}");
    assert_eq!((&document["stop"], code), (&"crash".into(), 4), "{errors}");
    let (said, document, ..) = session(&file, &["--cycles", "3000"], "continue\ncontinue\n");
    in_order(&said, &["SIGXCPU", "SIGXCPU"]);
    assert_eq!(document["stop"], "limit");
    let (said, ..) = session(&file, &["--program-exit"], &format!("{jump}kill\n"));
    assert!(said.contains("killed"), "{said}");
}

#[test]
fn an_interrupt_halts_a_program_that_never_ends() {
    // Sends the letter U for ever: ldi r16, 8; sts UCSR0B, r16; sts UDR0, r16; rjmp .-6
    let endless = [0xE008, 0x9300, 0x00C1, 0x9300, 0x00C6, 0xCFFD];
    let folder = folder();
    let file = write(&folder, "endless.hex", hex_text(&endless));
    let sent = folder.path().join("sent");
    let waiting = Waiting::start(&file, &["--uart", text(&sent)]);
    let mut gdb = Command::new(GDB)
        .args(["-nx", "-quiet"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap_or_else(|error| missing(&error));
    let mut to = gdb.stdin.take().expect("piped");
    let script = format!(
        "set confirm off\ntarget remote {}\ncontinue\n",
        waiting.place
    );
    to.write_all(script.as_bytes()).expect("it listens");
    // It runs when bytes come.
    while fs::metadata(&sent).map_or(0, |file| file.len()) < 100 {
        assert!(gdb.try_wait().expect("our child").is_none(), "avr-gdb ends");
        thread::yield_now();
    }
    let killed = Command::new("kill")
        .args(["-INT", &gdb.id().to_string()])
        .status();
    assert!(killed.expect("kill is there").success());
    to.write_all(b"info registers pc\nkill\nquit\n")
        .expect("it listens");
    drop(to);
    let Output { stdout, .. } = gdb.wait_with_output().expect("our child");
    let said = String::from_utf8_lossy(&stdout);
    in_order(&said, &["SIGINT", "pc ", "killed"]);
    let (document, _, code) = waiting.end();
    assert_eq!((&document["stop"], code), (&"limit".into(), 0));
}

#[test]
fn a_debugger_that_vanishes_ends_the_run_with_3_and_bad_addresses_with_2() {
    let folder = folder();
    let file = program(folder.path());
    let waiting = Waiting::start(&file, &[]);
    drop(TcpStream::connect(&waiting.place).expect("it listens"));
    let (document, errors, code) = waiting.end();
    assert_eq!((&document["stop"], code), (&"limit".into(), 3), "{errors}");
    assert!(errors.contains("the debugger is gone"), "{errors}");
    let taken = std::net::TcpListener::bind("127.0.0.1:0").expect("a free port");
    let taken = taken.local_addr().expect("a port").to_string();
    for address in ["nonsense", "1:2:x", "70000", "192.0.2.1:1", &taken] {
        let holder = std::net::TcpListener::bind(&taken);
        let output = run(&["run", text(&file), "--gdb", address]);
        drop(holder);
        assert_eq!(
            output.status.code(),
            Some(2),
            "{address}: {}",
            stderr(&output)
        );
        assert!(stderr(&output).contains("--gdb"), "{}", stderr(&output));
    }
}

//! Every output that cannot be written is an error, is found before the work where it can be, and
//! leaves old files as they were and nothing of the new ones.

use std::fs;
use std::io::Read as _;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use cardan_tests::{SHORT_SEARCH, assert_refused, cardan, not_run, run, stderr};
use tempfile::TempDir;

const SHORT: [&str; 3] = ["compare", "--seconds", "0.2"];

/// Runs the program with its standard output at the full device.
fn full(arguments: &[&str]) -> Output {
    let full = fs::OpenOptions::new().write(true).open("/dev/full");
    Command::new(cardan())
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(full.expect("Linux has it"))
        .stderr(Stdio::piped())
        .output()
        .expect("starts")
}

/// Runs the program with a standard output whose reader is gone.
fn closed(arguments: &[&str]) -> Output {
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    Command::new(cardan())
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(writer)
        .stderr(Stdio::piped())
        .output()
        .expect("starts")
}

fn text(path: &Path) -> &str {
    path.to_str().expect("test paths are UTF-8")
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).expect("a folder").flatten();
    let mut names: Vec<_> = entries
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

fn corner_file(folder: &TempDir) -> String {
    let file = folder.path().join("corners.toml");
    fs::write(&file, "").expect("written");
    text(&file).to_owned()
}

#[test]
fn a_full_or_closed_standard_output_is_an_error_of_every_verb() {
    let folder = TempDir::new().expect("a folder");
    let corners = corner_file(&folder);
    let image = "firmware/boards/atmega328p/images/plain.elf";
    let image = cardan_tests::root().join(image);
    let verbs: [&[&str]; 12] = [
        &["--help"],
        &["--version"],
        &["tune", "--help", "--json"],
        &["doctor"],
        &["compare", "--print-scenario"],
        &SHORT,
        &["compare", "--seconds", "0.2", "--in-process"],
        &["compare", "--seconds", "0.2", "--corners", &corners],
        &["ranges", "--seconds", "0.2", "--search", "0"],
        &["accuracy", "--attitudes", "4", "--averaging", "1"],
        &["calibrate", "--attitudes", "6", "--solutions", "2"],
        &["run", text(&image), "--cycles", "4000000"],
    ];
    for verb in verbs {
        for json in [&[][..], &["--json"]] {
            let arguments = [verb, json].concat();
            // A serial line goes to standard output, or to standard error beside the document.
            for (kind, output) in [("full", full(&arguments)), ("closed", closed(&arguments))] {
                let is_line = verb[0] == "run" && json.is_empty() && kind == "closed";
                let expected = if is_line { 0 } else { 2 };
                let said = stderr(&output);
                assert_eq!(
                    output.status.code(),
                    Some(expected),
                    "{kind} {arguments:?}: {said}"
                );
                if !is_line {
                    assert!(said.contains("output"), "{kind} {arguments:?}: {said}");
                }
            }
        }
    }
}

#[test]
fn files_on_a_full_device_are_errors() {
    let out = ["--out", "/dev/full"];
    let budget = [
        "--budget",
        "attitude.rms<=1",
        "--seconds",
        "0.2",
        "--runs",
        "1",
    ];
    let quick = ["--fresh", "0", "--method", "uniform", "--also", "static"];
    let tune = run(&[&["tune"], &budget[..], &quick, &out].concat());
    assert_refused(&tune, &["--out /dev/full", "No space left"]);
    let image = cardan_tests::root().join("firmware/boards/atmega328p/images/plain.elf");
    for option in ["--vcd", "--uart"] {
        let arguments = [
            "run",
            text(&image),
            "--cycles",
            "400000000",
            option,
            "/dev/full",
        ];
        let output = run(&arguments);
        assert_refused(&output, &["/dev/full", "No space left"]);
    }
}

#[test]
fn outputs_are_checked_before_the_work_begins() {
    let folder = TempDir::new().expect("a folder");
    let at = |name: &str| text(&folder.path().join(name)).to_owned();
    fs::create_dir(at("folder")).expect("made");
    fs::create_dir(at("x.csv")).expect("made");
    fs::write(at("file"), "").expect("written");
    fs::create_dir_all(at("taken/report.html")).expect("made");
    fs::copy(
        cardan_tests::root().join("firmware/wordlengths.toml"),
        at("words.toml"),
    )
    .expect("copied");
    symlink(at("words.toml"), at("link.csv")).expect("linked");
    // So long that a check after the work would not be seen.
    let long = ["compare", "--seconds", "900000"];
    let wordlengths = at("words.toml");
    let cases: [(&[&str], &[&str]); 9] = [
        (
            &["--dump", &at("none/x.csv")],
            &["--dump", "is not there", "mkdir -p"],
        ),
        (&["--dump", &at("x.csv")], &["--dump", "is a folder"]),
        (&["--dump", &at("file/x.csv")], &["--dump", "is no folder"]),
        (&["--dump", ""], &["--dump"]),
        (&["--report", &at("file")], &["--report", "is no folder"]),
        (
            &["--report", &at("file/deeper")],
            &["--report", "is no folder"],
        ),
        (&["--report", &at("taken")], &["report.html", "is a folder"]),
        (&["--dump", "/proc/x.csv"], &["/proc/x.csv"]),
        (
            &["--wordlengths", &wordlengths, "--dump", &at("link.csv")],
            &["link.csv", "is the input of --wordlengths"],
        ),
    ];
    for (options, parts) in cases {
        for more in [&[][..], &["--in-process"]] {
            assert_refused(&run(&[&long, options, more].concat()), parts);
        }
    }
    let image = cardan_tests::root().join("firmware/boards/atmega328p/images/plain.elf");
    fs::copy(image, at("plain.elf")).expect("copied");
    let elf = at("plain.elf");
    let cases: [(&[&str], &str); 5] = [
        (&["--vcd", &at("none/x.vcd")], "is not there"),
        (&["--vcd", &elf], "is the input of FILE"),
        (&["--uart", &elf], "is the input of FILE"),
        (&["--profile-out", &at("file")], "is no folder"),
        (&["--vcd", &at("a"), "--uart", &at("a")], "writes, too"),
    ];
    for (options, part) in cases {
        let before = fs::read(&elf).expect("there");
        assert_refused(&run(&[&["run", &elf], options].concat()), &[part]);
        assert_eq!(fs::read(&elf).expect("there"), before);
    }
    for arguments in [
        &[
            "tune",
            "--budget",
            "attitude.rms<=1",
            "--out",
            &at("none/w.toml"),
        ][..],
        &[
            "tune",
            "--budget",
            "attitude.rms<=1",
            "--journal",
            &at("folder"),
        ],
        &["calibrate", "--out", &at("none/e.hex")],
        &["ranges", "--report", &at("file")],
    ] {
        assert_eq!(run(arguments).status.code(), Some(2), "{arguments:?}");
    }
}

#[test]
fn an_old_dump_stays_until_the_new_one_is_complete_whoever_ends_the_run() {
    let folder = TempDir::new().expect("a folder");
    let file = folder.path().join("old.vcd");
    let image = cardan_tests::root().join("firmware/boards/atmega328p/images/plain.elf");
    for (signal, is_completed) in [("-KILL", false), ("-INT", true), ("-TERM", true)] {
        fs::write(&file, "old").expect("written");
        let mut child = Command::new(cardan())
            .args(["run", text(&image), "--vcd", text(&file)])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("starts");
        let mut first = [0; 64];
        let mut from = child.stdout.take().expect("piped");
        from.read_exact(&mut first).expect("the program sends");
        assert_eq!(fs::read(&file).expect("there"), b"old", "{signal}");
        let pid = child.id().to_string();
        let sent = Command::new("kill").args([signal, &pid]).status();
        assert!(sent.expect("kill runs").success());
        // Whatever it still sends is taken.
        let mut rest = Vec::new();
        from.read_to_end(&mut rest).expect("readable");
        assert_eq!(child.wait().expect("ends").code(), None, "by {signal}");
        let dump = fs::read(&file).expect("there");
        if is_completed {
            let commands = vcd::Parser::new(&dump[..]);
            assert!(commands.into_iter().all(|command| command.is_ok()));
            assert_eq!(names(folder.path()), ["old.vcd"], "{signal}");
        } else {
            assert_eq!(dump, b"old");
            for name in names(folder.path()) {
                if name != "old.vcd" {
                    fs::remove_file(folder.path().join(name)).expect("ours");
                }
            }
        }
    }
}

/// A disk of so many KiB at `disk`, if this user may mount one.
fn mounts(disk: &Path, kib: u32) -> bool {
    fs::create_dir(disk).expect("made");
    let size = format!("size={kib}k");
    let mounted = Command::new("mount")
        .args(["-t", "tmpfs", "-o", &size, "tmpfs", text(disk)])
        .stderr(Stdio::null())
        .status();
    let is_mounted = mounted.is_ok_and(|status| status.success());
    if !is_mounted {
        not_run("a small disk can be mounted by root only");
    }
    is_mounted
}

fn unmount(disk: &Path) {
    let unmounted = Command::new("umount").arg(disk).status();
    assert!(unmounted.expect("umount runs").success());
}

#[test]
fn a_disk_that_runs_full_keeps_the_old_file_and_nothing_of_the_new_one() {
    let folder = TempDir::new().expect("a folder");
    let disk = folder.path().join("disk");
    if !mounts(&disk, 256) {
        return;
    }
    let file = disk.join("dump.csv");
    fs::write(&file, "old").expect("written");
    let output = run(&["compare", "--seconds", "4", "--dump", text(&file)]);
    let left = names(&disk);
    let old = fs::read(&file);
    unmount(&disk);
    assert_refused(&output, &["--dump", "No space left"]);
    assert_eq!(left, ["dump.csv"]);
    assert_eq!(old.expect("there"), b"old");
}

/// The search's result does not need its journal, which was asked for all the same.
#[test]
fn a_journal_that_cannot_be_written_is_an_error_behind_the_whole_result() {
    let folder = TempDir::new().expect("a folder");
    let disk = folder.path().join("disk");
    if !mounts(&disk, 8) {
        return;
    }
    let journal = disk.join("search.journal");
    let out = folder.path().join("tuned.toml");
    let more = ["--quiet", "--budget", "attitude.rms<=0.05"];
    let files = ["--journal", text(&journal), "--out", text(&out)];
    let output = run(&[&SHORT_SEARCH[..], &more, &files].concat());
    unmount(&disk);
    assert_eq!(output.status.code(), Some(2));
    let told = String::from_utf8_lossy(&output.stderr);
    for part in [
        "--journal",
        "search.journal",
        "No space left",
        "another disk",
    ] {
        assert!(told.contains(part), "{part}: {told}");
    }
    assert!(String::from_utf8_lossy(&output.stdout).contains("uniform"));
    let tuned = fs::read_to_string(&out).expect("written");
    assert!(tuned.contains("[tuned]"), "{tuned}");
}

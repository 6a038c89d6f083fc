//! Processes that are killed, stopped, or short of what they need, as a user meets them.

use std::fs;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use cardan_tests::{cardan, not_run, run, stderr};
use tempfile::TempDir;

/// Child processes of `parent`, with the verb that each runs.
fn children(parent: u32) -> Vec<(u32, String)> {
    let own = fs::read(format!("/proc/{parent}/cmdline")).unwrap_or_default();
    // Any of its threads may have started them.
    let tasks = fs::read_dir(format!("/proc/{parent}/task"))
        .into_iter()
        .flatten();
    let lists = tasks.flatten().map(|task| task.path().join("children"));
    let text: String = lists
        .filter_map(|list| fs::read_to_string(list).ok())
        .collect();
    text.split_whitespace()
        .filter_map(|pid| {
            let line = fs::read(format!("/proc/{pid}/cmdline")).ok()?;
            // Until a child runs its own program it shows its parent's command line.
            if line == own {
                return None;
            }
            let verb = line.split(|&byte| byte == 0).nth(1)?;
            Some((
                pid.parse().ok()?,
                String::from_utf8_lossy(verb).into_owned(),
            ))
        })
        .collect()
}

fn start(arguments: &[&str]) -> Child {
    Command::new(cardan())
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("starts")
}

fn await_children(parent: u32, count: usize) -> Vec<(u32, String)> {
    let begin = Instant::now();
    loop {
        let found = children(parent);
        if found.len() >= count && found.iter().all(|(_, verb)| !verb.is_empty()) {
            return found;
        }
        assert!(begin.elapsed() < Duration::from_secs(60), "{found:?}");
        sleep(Duration::from_millis(5));
    }
}

fn signal(name: &str, pid: u32) {
    let sent = Command::new("kill").args([name, &pid.to_string()]).status();
    assert!(sent.expect("kill runs").success());
}

fn is_running(pid: u32) -> bool {
    // One that nobody has waited for yet has ended all the same.
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    let state = stat
        .rsplit_once(')')
        .map(|(_, rest)| rest.trim_start().chars().next());
    !matches!(state, None | Some(None | Some('Z' | 'X')))
}

#[test]
fn corners_take_their_children_along_however_they_end() {
    let folder = TempDir::new().expect("a folder");
    let file = folder.path().join("corners.toml");
    fs::write(
        &file,
        "[spread]\n\"frontend.gain_error\" = { range = 0.001 }\n",
    )
    .expect("written");
    let file = file.to_string_lossy();
    for name in ["-TERM", "-KILL", "-INT"] {
        let options = ["--quiet", "--seconds", "3000", "--mc", "4", "--jobs", "2"];
        let mut corners = start(&[&["compare", "--corners", &file][..], &options].concat());
        let found = await_children(corners.id(), 2);
        signal(name, corners.id());
        corners.wait().expect("ours");
        let killed = Instant::now();
        while found.iter().any(|(pid, _)| is_running(*pid)) {
            assert!(
                killed.elapsed() < Duration::from_secs(10),
                "{name}: {found:?}"
            );
            sleep(Duration::from_millis(10));
        }
    }
}

#[test]
fn a_participant_that_is_stopped_in_mid_run_ends_it_with_its_name() {
    for (verb, role) in [
        ("emulate", "emulated"),
        ("native", "native"),
        ("golden", "golden"),
        ("diff", "diff"),
    ] {
        let options = [
            "compare",
            "--quiet",
            "--seconds",
            "900",
            "--stall-timeout",
            "1",
        ];
        let run = start(&options);
        let found = await_children(run.id(), 4);
        let victim = found
            .iter()
            .find(|(_, of)| of == verb)
            .expect("its child")
            .0;
        // In the middle of the run, or still joining: it is the same.
        sleep(Duration::from_millis(700));
        signal("-STOP", victim);
        let output = run.wait_with_output().expect("ends");
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(3), "{role}: {said}");
        assert!(
            said.contains(&format!("'{role}' is stopped")),
            "{role}: {said}"
        );
        assert!(said.contains("--stall-timeout"), "{role}: {said}");
        assert!(!is_running(victim), "{role} is left");
    }
}

#[test]
fn a_participant_by_hand_that_is_stopped_is_named_by_the_others() {
    let session = format!("stopped-{}", std::process::id());
    let timing = [
        "--session",
        &session,
        "--stall-timeout",
        "1",
        "--join-timeout",
        "60",
    ];
    let participant = |verb: &str, more: &[&str]| start(&[&[verb][..], &timing, more].concat());
    let long = ["--seconds", "900"];
    let emulate = participant("emulate", &long);
    let golden = participant("golden", &[]);
    let others = [participant("native", &[]), participant("diff", &long)];
    sleep(Duration::from_secs(4));
    signal("-STOP", golden.id());
    for other in others.into_iter().chain([emulate]) {
        let output = other.wait_with_output().expect("ends");
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(3), "{said}");
        assert!(said.contains("'golden' is stopped"), "{said}");
    }
    signal("-KILL", golden.id());
    golden.wait_with_output().expect("ends");
}

#[test]
fn a_short_pause_is_no_stall() {
    let mut run = start(&[
        "compare",
        "--quiet",
        "--seconds",
        "2",
        "--stall-timeout",
        "60",
    ]);
    let found = await_children(run.id(), 4);
    for (pid, _) in &found {
        signal("-STOP", *pid);
        sleep(Duration::from_millis(100));
        signal("-CONT", *pid);
    }
    assert_eq!(run.wait().expect("ends").code(), Some(0));
}

#[test]
fn compare_waits_as_long_as_it_is_told() {
    for given in ["-1", "nan", "soon"] {
        let output = run(&["compare", "--seconds", "0.2", "--join-timeout", given]);
        assert_eq!(output.status.code(), Some(2), "{given}");
    }
    let output = run(&[
        "compare",
        "--quiet",
        "--seconds",
        "0.2",
        "--join-timeout",
        "0",
    ]);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(3), "{said}");
    assert!(
        said.contains("did not join") && said.contains("--join-timeout"),
        "{said}"
    );
}

#[test]
fn few_file_handles_are_named() {
    let line = format!(
        "ulimit -n 20; exec {} compare --seconds 0.2",
        cardan().display()
    );
    let output = Command::new("sh")
        .args(["-c", &line])
        .output()
        .expect("runs");
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(3), "{said}");
    assert!(
        said.contains("file handles") && said.contains("ulimit -n"),
        "{said}"
    );
}

#[test]
fn full_shared_memory_is_named() {
    // A namespace of its own, so that nobody else loses theirs; the second is open to every user.
    let mount = "mount -t tmpfs -o size=2m tmpfs /dev/shm";
    let line = format!(
        "{mount} && exec {} compare --seconds 0.2",
        cardan().display()
    );
    let within = |namespace: &str, line: &str| {
        let output = Command::new("unshare")
            .args([namespace, "sh", "-c", line])
            .output();
        output.expect("unshare runs")
    };
    let can_mount = |namespace: &&str| within(namespace, mount).status.success();
    let Some(namespace) = ["-m", "-rm"].into_iter().find(can_mount) else {
        return not_run("this machine lets nobody mount in a namespace of his own");
    };
    let output = within(namespace, &line);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(3), "{said}");
    assert!(
        said.contains("/dev/shm") && said.contains("mount -o remount"),
        "{said}"
    );
}

#[test]
fn several_users_do_not_disturb_each_other() {
    let user = Command::new("id").arg("-u").output().expect("id runs");
    if user.stdout != b"0\n" {
        return not_run("only root can be another user");
    }
    let folder = TempDir::new().expect("a folder");
    let program = folder.path().join("cardan");
    // Not by this process: a child that another test starts meanwhile would hold the copy open for writing.
    let copied = Command::new("cp").arg(cardan()).arg(&program).status();
    assert!(copied.expect("cp starts").success());
    let opened = Command::new("chmod")
        .args(["-R", "a+rx"])
        .arg(folder.path())
        .status();
    assert!(opened.expect("chmod runs").success());
    let line = format!(
        "cd / && exec {} compare --quiet --seconds 0.3",
        program.display()
    );
    for _ in 0..2 {
        let own = start(&["compare", "--quiet", "--seconds", "1"]);
        let other = Command::new("su")
            .args(["-s", "/bin/sh", "nobody", "-c", &line])
            .output();
        let other = other.expect("su runs");
        let own = own.wait_with_output().expect("ends");
        let said = stderr(&other);
        assert_eq!(other.status.code(), Some(0), "{said}");
        assert_eq!(own.status.code(), Some(0), "{}", stderr(&own));
    }
}

/// Participants by hand that were asked for different runs: `emulate` with the first, `diff` with the second.
fn asked_differently(name: &str, emulate: &[&str], diff: &[&str]) -> std::process::Output {
    let session = format!("differ-{name}-{}", std::process::id());
    let own = ["--session", &session, "--quiet"];
    let others: Vec<Child> = [
        [&["emulate"][..], &own, emulate].concat(),
        [&["native"][..], &own].concat(),
        [&["golden"][..], &own].concat(),
    ]
    .iter()
    .map(|arguments| start(arguments))
    .collect();
    let output = run(&[&["diff"][..], &own, diff].concat());
    for mut other in others {
        other.wait().expect("ends");
    }
    output
}

#[test]
fn a_run_is_judged_only_by_what_it_was_asked_for() {
    const TUMBLE: &[&str] = &["--seconds", "1"];
    let same = asked_differently("same", TUMBLE, TUMBLE);
    assert_eq!(same.status.code(), Some(0), "{}", stderr(&same));
    let other: [(&str, &[&str], &str); 4] = [
        ("seed", &["--seconds", "1", "--seed", "2"], "--seed"),
        (
            "scenario",
            &["--seconds", "1", "--scenario", "static"],
            "--scenario",
        ),
        ("seconds", &["--seconds", "0.9"], "--seconds"),
        (
            "set",
            &["--seconds", "1", "--set", "controller.averaging=8"],
            "--scenario",
        ),
    ];
    for (name, emulate, option) in other {
        let output = asked_differently(name, emulate, TUMBLE);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{name}: {said}");
        assert!(
            said.contains(option) && said.contains("different runs"),
            "{name}: {said}"
        );
    }
}

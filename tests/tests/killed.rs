//! A participant killed at any moment ends the run by name and leaves nothing behind. Alone in its
//! test program, because it looks at everything that iceoryx2 keeps on this machine.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use cardan_tests::{cardan, stderr};
use rand_chacha::ChaCha8Rng;
use rand_core::{RngCore, SeedableRng};

/// Child processes of `parent` by the verb that they run.
fn child(parent: u32, verb: &str) -> Option<u32> {
    let children = fs::read_to_string(format!("/proc/{parent}/task/{parent}/children")).ok()?;
    children
        .split_whitespace()
        .filter_map(|pid| pid.parse().ok())
        .find(|pid: &u32| {
            let line = fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
            line.split(|&byte| byte == 0).nth(1) == Some(verb.as_bytes())
        })
}

/// What is left of a session in shared memory and in iceoryx2's folder.
fn left_behind(before: &[String]) -> Vec<String> {
    listing()
        .into_iter()
        .filter(|name| !before.contains(name))
        .collect()
}

fn listing() -> Vec<String> {
    let mut names = Vec::new();
    let mut folders = vec![
        Path::new("/dev/shm").to_path_buf(),
        std::env::temp_dir().join("iceoryx2"),
    ];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
            let path = entry.path();
            let name = path.display().to_string();
            if path.is_dir() {
                folders.push(path);
            } else if name.contains("iox2") && !name.ends_with(".global_mgmt") {
                names.push(name);
            }
        }
    }
    names
}

#[test]
fn a_killed_participant_ends_the_run_with_its_name_and_leaves_nothing() {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let roles = [
        ("emulate", "emulated"),
        ("native", "native"),
        ("golden", "golden"),
        ("diff", "diff"),
    ];
    for round in 0..20 {
        let (verb, name) = roles[round % roles.len()];
        let before = listing();
        let run = Command::new(cardan())
            .args(["compare", "--quiet", "--seconds", "300"])
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("starts");
        let parent = run.id();
        let victim = loop {
            if let Some(pid) = child(parent, verb) {
                break pid;
            }
            sleep(Duration::from_millis(1));
        };
        sleep(Duration::from_millis(random.next_u64() % 1500));
        let killed = Instant::now();
        let status = Command::new("kill")
            .args(["-9", &victim.to_string()])
            .status();
        assert!(status.expect("kill runs").success());
        let output = run.wait_with_output().expect("ends");
        let took = killed.elapsed();
        let text = stderr(&output);
        assert_eq!(
            output.status.code(),
            Some(3),
            "round {round}, {name}: {text}"
        );
        assert!(
            text.contains(&format!("'{name}'")),
            "round {round}, {name}: {text}"
        );
        assert!(
            took < Duration::from_secs(2),
            "round {round}, {name}: {took:?} (contract: 2 s)"
        );
        assert_eq!(
            left_behind(&before),
            Vec::<String>::new(),
            "round {round}, {name}"
        );
    }
}

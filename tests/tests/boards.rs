//! The firmware on other processors: programs for Cortex-M0+, Cortex-M4 and RV32IMC, run by QEMU on
//! recorded codes, give the host's bits.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::OnceLock;

use cardan_bench::app::Configuration;
use cardan_bench::attitude::Attitude;
use cardan_bench::image::Firmware;
use cardan_bench::{App, Conversion, Engine, Sink, SinkError, ThirdTilt};
use cardan_firmware::calibration::Settings;
use cardan_scenario::Scenario;
use cardan_spec::{ThirdTilt as Axis, flags};
use cardan_tests::{cardan, run, stderr};
use serde_json::Value;
use tempfile::{TempDir, tempdir};

/// Boards that QEMU runs.
const BOARDS: [&str; 3] = ["cortex-m0plus", "cortex-m4", "rv32imc"];
/// Marks in the recording (`firmware/boards/replay`).
const LATE: u16 = 1 << 15;
const RECEIVED: u16 = 1 << 14;
const THIRD_TILT: u16 = 1 << 13;

/// What a device shows: words in order per node, and messages on the line.
#[derive(Debug, Default, PartialEq, Eq)]
struct Shown {
    words: Vec<(usize, i64)>,
    sent: Vec<Vec<u8>>,
}

#[derive(Default)]
struct Recorder {
    conversions: Vec<Conversion>,
    shown: Shown,
}

impl Sink for Recorder {
    fn conversion(&mut self, conversion: &Conversion) -> Result<(), SinkError> {
        self.conversions.push(*conversion);
        Ok(())
    }

    fn word(&mut self, node: usize, raw: i64, _: u64) -> Result<(), SinkError> {
        self.shown.words.push((node, raw));
        Ok(())
    }

    fn frame(&mut self, _: u64, bytes: &[u8]) -> Result<(), SinkError> {
        self.shown.sent.push(bytes.to_vec());
        Ok(())
    }
}

fn record(mut engine: Box<dyn Engine>, conversions: &[Conversion]) -> Recorder {
    let mut recorder = Recorder::default();
    let mut feed = conversions.iter().copied().map(Ok);
    engine.run(&mut feed, &mut recorder).expect("runs");
    recorder
}

/// Solutions of codes from anywhere, after those of the run: they raise every flag but the board's.
const WILD_SOLUTIONS: u64 = 100;

/// A conversion of a code that no sensor gave.
fn wild(sequence: u64) -> Conversion {
    // Another voltage per solution and channel, all over the range and at its ends, by SplitMix64's
    // output step; the step's own bits move single codes a little.
    let mut z = (sequence / 64 * 4 + sequence % 4).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    let code = match z & 15 {
        0 => 0,
        1 => 1023,
        _ => (z >> 54) as u16 ^ (sequence / 4 % 4) as u16,
    };
    Conversion {
        sequence,
        cycle: 2000 * sequence,
        channel: (sequence % 4) as u8,
        code,
        ideal_volts: f64::NAN,
        direct_code: f64::NAN,
        experienced_code: f64::NAN,
        late: false,
        lost: false,
        third_tilt: (sequence % 64 == 63).then_some(ThirdTilt {
            upside_down: sequence / 64 % 3 == 1,
            truly_upside_down: None,
        }),
    }
}

/// Items of the recording for each solution: what the third tilt axis tells, then the codes.
const SOLUTION_ITEMS: usize = 65;

fn items(conversions: &[Conversion]) -> Vec<u16> {
    let of_solution = |solution: &[Conversion]| {
        let sign = match solution.last().and_then(|last| last.third_tilt) {
            Some(third) if third.upside_down => 0xff,
            _ => 1_u16,
        };
        let codes = solution.iter().map(|conversion| conversion.code);
        [THIRD_TILT | sign]
            .into_iter()
            .chain(codes)
            .collect::<Vec<_>>()
    };
    conversions.chunks(64).flat_map(of_solution).collect()
}

/// A run of the emulated device with wild codes after it, and what the host computes of them.
struct Reference {
    configuration: Configuration,
    items: Vec<u16>,
    shown: Shown,
}

fn reference() -> &'static Reference {
    static REFERENCE: OnceLock<Reference> = OnceLock::new();
    REFERENCE.get_or_init(|| {
        let mut scenario = Scenario::load("vibration").expect("is bundled");
        scenario.sensors.third_tilt = Axis::Comparator;
        let image = Attitude.bundled(true).expect("is bundled");
        let firmware = Firmware::parse("tapped.elf", image).expect("an image");
        let (configuration, mut device) = Attitude
            .emulated(&scenario, 1, 4.0, &firmware)
            .expect("fits");
        let mut emulated = Recorder::default();
        device.run(&mut emulated).expect("runs");
        let mut conversions = emulated.conversions;
        let end = conversions.len() as u64;
        conversions.extend((end..end + WILD_SOLUTIONS * 64).map(wild));
        let native = Attitude.native(&configuration, None).expect("fits");
        let shown = record(native, &conversions).shown;
        Reference {
            items: items(&conversions),
            configuration,
            shown,
        }
    })
}

/// A board's images and what runs them, as `cardan build` says.
struct Board {
    document: Value,
    runner: Vec<String>,
}

impl Board {
    fn image(&self, name: &str) -> &Value {
        let images = self.document["images"].as_array().expect("a list");
        let image = images.iter().find(|image| image["image"] == name);
        image.expect("plain and tapped")
    }

    fn file(&self, name: &str) -> PathBuf {
        self.image(name)["file"].as_str().expect("a path").into()
    }

    /// Runs an image in `folder`, which holds the recording.
    fn run(&self, name: &str, folder: &Path) -> Output {
        let (program, arguments) = self.runner.split_first().expect("a program");
        let mut qemu = Command::new(program);
        qemu.args(arguments)
            .arg(self.file(name))
            .current_dir(folder)
            .stdin(Stdio::null());
        let run = qemu.output();
        run.unwrap_or_else(|error| panic!("{program}: {error}; `cargo xtask test` installs it"))
    }
}

fn text(value: &Value) -> String {
    value.as_str().expect("a text").to_owned()
}

fn board(name: &str) -> &'static Board {
    static BUILT: [OnceLock<Board>; 3] = [const { OnceLock::new() }; 3];
    let index = BOARDS.iter().position(|board| *board == name);
    BUILT[index.expect("a board")].get_or_init(|| {
        let output = run(&["build", "--target", name, "--json", "--quiet"]);
        assert!(output.status.success(), "{}", stderr(&output));
        let document: Value = serde_json::from_slice(&output.stdout).expect("JSON");
        let document = document["targets"][0].clone();
        let runner = document["runner"].as_array().expect("a list");
        Board {
            runner: runner.iter().map(text).collect(),
            document,
        }
    })
}

/// A folder with a recording.
fn recording(configuration: &Configuration, items: &[u16]) -> TempDir {
    let folder = tempdir().expect("a temporary folder");
    let words: &[i32] = &configuration.calibration;
    let settings = Settings {
        words: words.try_into().expect("all words"),
        averaging: configuration.averaging(),
        third_tilt: configuration.third_tilt(),
        uncalibrated: false,
    };
    let mut bytes = settings.image().to_vec();
    bytes.extend(items.iter().flat_map(|item| item.to_le_bytes()));
    fs::write(folder.path().join("replay.in"), bytes).expect("the folder is ours");
    folder
}

/// The results, which must have an end.
fn results(folder: &Path) -> Shown {
    let bytes = fs::read(folder.join("replay.out")).expect("results");
    let mut rest = bytes.as_slice();
    let mut take = |count: usize| {
        let (taken, left) = rest.split_at_checked(count).expect("a whole record");
        rest = left;
        taken.to_vec()
    };
    let mut shown = Shown::default();
    loop {
        let head = take(2);
        match u16::from_le_bytes([head[0], head[1]]) {
            0xffff => {
                let len = take(1)[0];
                shown.sent.push(take(len.into()));
            }
            0xfffe => {
                take(4);
                assert!(rest.is_empty(), "something follows the end");
                return shown;
            }
            node => {
                let raw = take(4).try_into().expect("four bytes");
                shown
                    .words
                    .push((node.into(), i32::from_le_bytes(raw).into()));
            }
        }
    }
}

/// What `name`'s image shows of `items`.
fn shown(name: &str, image: &str, items: &[u16]) -> Shown {
    let folder = recording(&reference().configuration, items);
    let output = board(name).run(image, folder.path());
    assert!(output.status.success(), "{name}: {}", stderr(&output));
    results(folder.path())
}

fn status(frame: &[u8]) -> u16 {
    Attitude.decode_frame(frame).expect("a whole frame").1
}

#[test]
fn the_recording_has_plain_and_flagged_solutions_and_values_of_the_nodes_in_each() {
    let Reference { shown, .. } = reference();
    let run = shown.sent.len() - WILD_SOLUTIONS as usize;
    let flagged = |sent: &[Vec<u8>]| sent.iter().filter(|frame| status(frame) != 0).count();
    let of_run = flagged(&shown.sent[..run]);
    assert!(run >= 400, "{run} solutions");
    assert!(of_run >= 20, "{of_run} flagged");
    assert!(run - of_run >= 100, "{of_run} flagged");
    let all = shown.sent.iter().fold(0, |all, frame| all | status(frame));
    for flag in [
        flags::SATURATION,
        flags::HALF_SPACE,
        flags::DISTURBED,
        flags::DOMAIN,
    ] {
        assert_ne!(all & flag, 0, "status bit {flag:#x} never set");
    }
    let counts = (0..Attitude.nodes().len()).map(|index| {
        shown
            .words
            .iter()
            .filter(|(node, _)| *node == index)
            .count()
    });
    let counts: Vec<usize> = counts.filter(|&count| count > 0).collect();
    // The others are calibration, which is set once.
    assert!(counts.len() >= 60, "{} nodes", counts.len());
    assert!(counts.iter().all(|&count| count >= shown.sent.len()));
}

#[test]
fn every_board_gives_the_bits_of_the_host() {
    let Reference {
        items, shown: host, ..
    } = reference();
    for name in BOARDS {
        let tapped = shown(name, "tapped", items);
        assert_eq!(tapped.words.len(), host.words.len(), "{name}");
        for (number, (board, host)) in tapped.words.iter().zip(&host.words).enumerate() {
            assert_eq!(board, host, "{name}: write {number} (node, raw word)");
        }
        assert_eq!(tapped.sent, host.sent, "{name}");
        let plain = shown(name, "plain", items);
        assert!(plain.words.is_empty(), "{name}: plain images have no taps");
        assert_eq!(plain.sent, host.sent, "{name}");
    }
}

#[test]
fn one_step_of_one_code_is_seen() {
    let Reference {
        items, shown: host, ..
    } = reference();
    let mut items = items.clone();
    let last = items.last_mut().expect("codes");
    *last ^= 1;
    for name in BOARDS {
        let other = shown(name, "tapped", &items);
        assert_ne!(other.words, host.words, "{name}");
        let (before, after) = (&other.sent, &host.sent);
        assert_eq!(
            before[..before.len() - 1],
            after[..after.len() - 1],
            "{name}"
        );
        assert_ne!(before.last(), after.last(), "{name}");
    }
}

#[test]
fn late_conversions_and_commands_reach_the_device() {
    let Reference {
        items, shown: host, ..
    } = reference();
    let mut items = items.clone();
    let end = items.len() - 1;
    items[end - SOLUTION_ITEMS] |= LATE;
    items.insert(end - SOLUTION_ITEMS + 1, RECEIVED | u16::from(b't'));
    for name in BOARDS {
        let sent = shown(name, "plain", &items).sent;
        let [.., late, line] = &sent[..] else {
            panic!("{name}: {} messages", sent.len());
        };
        let [.., in_time, _] = &host.sent[..] else {
            panic!("{} frames", host.sent.len());
        };
        assert_eq!(status(late), status(in_time) | flags::LATE, "{name}");
        let line = String::from_utf8(line.clone()).expect("text");
        let number = host.sent.len() - 1;
        assert!(line.starts_with(&format!("{number} ")), "{name}: {line}");
        assert!(line.ends_with("\r\n"), "{name}: {line}");
    }
}

#[test]
fn a_recording_that_is_absent_or_ends_within_an_item_is_an_error() {
    let Reference {
        configuration,
        items,
        ..
    } = reference();
    for name in BOARDS {
        let absent = tempdir().expect("a temporary folder");
        assert_eq!(
            board(name).run("plain", absent.path()).status.code(),
            Some(1)
        );
        let cut = recording(configuration, &items[..100]);
        let file = cut.path().join("replay.in");
        let mut bytes = fs::read(&file).expect("just written");
        bytes.pop();
        fs::write(&file, bytes).expect("the folder is ours");
        assert_eq!(board(name).run("plain", cut.path()).status.code(), Some(1));
    }
}

#[test]
fn build_says_what_each_board_needs() {
    for name in BOARDS {
        let [plain, tapped] = ["plain", "tapped"].map(|image| board(name).image(image));
        for image in [plain, tapped] {
            let number = |what: &str| {
                let value = &image[what];
                value
                    .as_u64()
                    .unwrap_or_else(|| panic!("{name}: {what}: {value}"))
            };
            let (flash, stack) = (number("flash_bytes"), number("stack_bytes"));
            assert!((6_000..20_000).contains(&flash), "{name}: {flash}");
            assert!(flash < number("flash_size"));
            // At least the averager's sums and a frame, at most what these programs are meant for.
            assert!((300..4096).contains(&stack), "{name}: {stack}");
            assert!(number("ram_bytes") + stack < number("ram_size"));
            assert!(image["solution_cycles"].is_null(), "QEMU counts no cycles");
            assert!(image["cpu_load"].is_null(), "QEMU counts no cycles");
        }
        // The table of node words.
        let words = 4 * Attitude.nodes().len() as u64;
        let ram = |image: &Value| image["ram_bytes"].as_u64().expect("a number");
        assert!(ram(tapped) - ram(plain) >= words, "{name}");
        assert!(board(name).document["toolchain"]["lld"].is_string());
    }
}

#[test]
fn without_qemu_the_stack_is_not_guessed() {
    let name = "cortex-m4";
    board(name);
    let folder = tempdir().expect("a temporary folder");
    for program in ["ld.lld", "cc"] {
        let link = folder.path().join(program);
        std::os::unix::fs::symlink(format!("/usr/bin/{program}"), link).expect("is ours");
    }
    let build = |json: bool| {
        let mut build = Command::new(cardan());
        build
            .args(["build", "--target", name, "--quiet"])
            .args(json.then_some("--json"))
            .env("PATH", folder.path())
            .env("CARGO", env!("CARGO"));
        let output = build.output().expect("starts");
        assert!(output.status.success(), "{}", stderr(&output));
        String::from_utf8(output.stdout).expect("text")
    };
    let document: Value = serde_json::from_str(&build(true)).expect("JSON");
    let target = &document["targets"][0];
    assert!(target["images"][0]["stack_bytes"].is_null());
    assert!(target["images"][0]["flash_bytes"].as_u64() > Some(6_000));
    let remark = text(&target["remarks"][0]);
    assert!(
        remark.contains("qemu-system-arm") && remark.contains("cardan doctor"),
        "{remark}"
    );
    assert!(build(false).contains("cardan doctor"));
}

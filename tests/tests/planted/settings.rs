//! The firmware takes other settings than those that the device has: words of the calibration in each
//! other's places, on host and chip alike, on a unit in which all of them count.

use cardan::rig::Collected;
use cardan_bench::app::App;
use cardan_bench::attitude::Attitude;
use cardan_bench::{Conversion, Sink, SinkError};

use crate::{Fault, Run};

/// What the firmware makes of other settings.
#[derive(Default)]
struct Firmware {
    words: Vec<(usize, i64)>,
    frames: Vec<Vec<u8>>,
}

impl Sink for Firmware {
    fn word(&mut self, node: usize, raw: i64, _: u64) -> Result<(), SinkError> {
        self.words.push((node, raw));
        Ok(())
    }

    fn frame(&mut self, _: u64, bytes: &[u8]) -> Result<(), SinkError> {
        self.frames.push(bytes.to_vec());
        Ok(())
    }
}

/// Host and chip with the calibration's words `a` and `b` exchanged.
fn exchanged(collected: &mut Collected, a: usize, b: usize) {
    let mut configuration = collected.configuration.clone();
    assert_ne!(configuration.calibration[a], configuration.calibration[b]);
    configuration.calibration.swap(a, b);
    let mut engine = Attitude.native(&configuration, None).expect("fits");
    let mut firmware = Firmware::default();
    let conversions: &[Conversion] = &collected.conversions;
    let mut feed = conversions.iter().copied().map(Ok);
    engine.run(&mut feed, &mut firmware).expect("runs");
    collected.native.clear();
    for (node, raw) in firmware.words {
        collected.native.entry(node).or_default().push(raw);
    }
    collected.emulated = collected.native.clone();
    collected.native_frames.clone_from(&firmware.frames);
    collected.emulated_frames = firmware.frames;
}

pub(crate) fn faults() -> Vec<Fault> {
    // In the order of the EEPROM: offsets and matrix of the tilt, offsets and matrix of the field.
    let fault = |name, expected, a, b| {
        Fault::new(name, Run::Misaligned, expected, move |c| {
            exchanged(c, a, b);
        })
    };
    vec![
        fault("tilt offsets exchanged", "node centred", 0, 1),
        fault("tilt gains exchanged", "node tilt_product", 2, 5),
        fault("tilt matrix transposed", "node tilt_product", 3, 4),
        fault("tilt matrix: first row turned", "node tilt_product", 2, 3),
        fault("field offsets exchanged", "node centred", 6, 7),
        fault("field gains exchanged", "node field_product", 8, 11),
        fault("field matrix transposed", "node field_product", 9, 10),
        fault(
            "field matrix: second row turned",
            "node field_product",
            10,
            11,
        ),
        fault("horizontal and vertical field exchanged", "node ", 12, 13),
    ]
}

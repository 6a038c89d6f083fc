//! The attitude recorded as a tape is the firmware: every word of every solution.

use cardan_bench::attitude::AttitudeDatapath;
use cardan_datapath::{DEFAULT_DOMAIN_FLAG, Deployed, Format};
use cardan_firmware::calibration::NOMINAL;
use cardan_firmware::nodes::{NODE_COUNT, NODES};
use cardan_numerics::tape::{NO_NODE, Tape};
use cardan_numerics::trial::{Trial, deployable};
use cardan_numerics::{Algorithm, DeployedRecorder, Steps};
use cardan_spec::ThirdTilt;
use cardan_spec::timing::Averaging;

/// Codes of a device that turns, with steps over the whole range.
fn solutions(third_tilt: ThirdTilt, count: usize) -> Vec<Vec<i32>> {
    let channels = third_tilt.channels() as i32;
    let mut state: u32 = 1;
    let mut solution = |at: usize| {
        // Upside down half of the time.
        let sign = [1, -1][at % 7 % 2];
        let codes = (0..16 * channels).map(|conversion| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let noise = (state >> 24) as i32 % 9 - 4;
            let phase = at as f64 / 90.0 + f64::from(conversion % channels) * 1.3;
            let code = 512.0 + 420.0 * libm::sin(phase);
            (code as i32 + noise).clamp(0, 1023)
        });
        codes.chain([sign]).collect()
    };
    (0..count).map(&mut solution).collect()
}

#[test]
fn trials_in_the_deployed_formats_equal_the_firmware() {
    for third_tilt in ThirdTilt::ALL {
        trials_equal_the_firmware(third_tilt);
    }
}

fn trials_equal_the_firmware(third_tilt: ThirdTilt) {
    let datapath = AttitudeDatapath {
        words: NOMINAL,
        averaging: Averaging::DEFAULT.with(third_tilt),
        third_tilt,
    };
    let steps = solutions(third_tilt, 1200);
    let m = Deployed::new(DeployedRecorder::new(NODE_COUNT));
    let algorithm = Steps {
        datapath: &datapath,
        inputs: &steps,
    };
    let status = algorithm.run(&m);
    let expected = m.tap().take();

    let (tape, inputs) = Tape::record(&datapath, &steps).expect("is steady");
    let formats: Vec<Format> = NODES.iter().map(|node| node.format).collect();
    assert_eq!(deployable(&tape, &formats), Ok(()), "it is deployed");
    let mut trial = Trial::new(&tape, &inputs, DEFAULT_DOMAIN_FLAG);
    trial.run_all(&formats);
    assert_eq!(trial.status(), status);
    let mut found = vec![Vec::new(); NODE_COUNT];
    for step in 0..steps.len() {
        for (index, entry) in tape.body(step).iter().enumerate() {
            if entry.node != NO_NODE && entry.op.is_recorded() {
                found[entry.node as usize].push(match trial.transient().get(step) {
                    Some(words) => words[index].raw,
                    None => trial.column(index).get(step),
                });
            }
        }
    }
    for (node, info) in NODES.iter().enumerate() {
        assert_eq!(found[node], expected.raws[node], "{}", info.name);
    }
    let counts: Vec<u64> = expected.overflows.iter().map(|o| o.count).collect();
    assert_eq!(trial.overflows(), counts);
}

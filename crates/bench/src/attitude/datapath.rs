//! The firmware's algorithm as a sequence of equal steps, one per solution: what is recorded as a
//! tape and tuned.

use cardan_datapath::Arithmetic;
use cardan_firmware::attitude::{self, solve};
use cardan_firmware::averaging::Decimator;
use cardan_firmware::calibration::Calibration;
use cardan_numerics::Datapath;
use cardan_numerics::tape::{Flow, Follower};
use cardan_spec::ThirdTilt;
use cardan_spec::calibration::WORDS;
use cardan_spec::timing::Averaging;
use cardan_units::AdcCode;

use super::words_of;
use crate::app::Configuration;

/// The attitude with these calibration words; a step's inputs are the codes of one period, in the order of
/// conversion, and the sign of gravity along body z where the third tilt axis is at the comparator (1, -1;
/// else 0).
#[derive(Clone, Debug)]
pub struct AttitudeDatapath {
    /// Words of the EEPROM image.
    pub words: [i32; WORDS],
    /// Lengths of averages and periods, and the channels of `third_tilt`.
    pub averaging: Averaging,
    /// The third tilt axis.
    pub third_tilt: ThirdTilt,
}

/// Calibration, averager and what solutions leave to each other.
pub struct State<M: Arithmetic> {
    calibration: Calibration<M>,
    decimator: Decimator<M>,
    state: attitude::State<M>,
}

impl Datapath for AttitudeDatapath {
    type State<M: Arithmetic> = State<M>;

    fn start<M: Arithmetic>(&self, m: &M) -> State<M> {
        let mut decimator = Decimator::new(m, self.averaging);
        // The warm-up is ignored before it reaches the arithmetic.
        for _ in 0..self.averaging.warm_up_conversions() {
            decimator.push(m, AdcCode(0));
        }
        State {
            calibration: Calibration::new(m, &self.words, self.third_tilt),
            decimator,
            state: attitude::State::new(m, self.averaging),
        }
    }

    fn step<M: Arithmetic>(&self, m: &M, state: &mut State<M>, inputs: &[i32]) {
        let Some((&sign, codes)) = inputs.split_last() else {
            return;
        };
        for &code in codes {
            // Codes have ten bits.
            let code = AdcCode(code as u16);
            if let Some(averages) = state.decimator.push(m, code) {
                let (calibration, memory) = (&state.calibration, &mut state.state);
                solve(m, calibration, memory, &averages, sign.signum() as i8);
            }
        }
    }
}

/// Solutions of a rehearsal: which codes they are of makes no difference to the data flow.
const SOLUTIONS: i32 = 8;
/// Solutions looked at beyond them; nothing in the algorithm looks back farther.
const AHEAD: usize = 64;

/// The algorithm of a device so configured, to be followed solution by solution.
pub(super) fn follower(
    configuration: &Configuration,
) -> Result<Follower<AttitudeDatapath>, String> {
    let averaging = configuration.averaging();
    let datapath = AttitudeDatapath {
        words: words_of(configuration),
        averaging,
        third_tilt: configuration.third_tilt(),
    };
    let conversions = averaging.conversions() as i32;
    let step = |at: i32| -> Vec<i32> {
        let codes = (0..conversions).map(|k| (341 * at + 127 * k) % 1024);
        codes.chain([1]).collect()
    };
    let steps: Vec<Vec<i32>> = (0..SOLUTIONS).map(step).collect();
    Follower::new(datapath, &steps, AHEAD).map_err(|error| error.to_string())
}

/// Which nodes' values enter which.
pub(super) fn flow(configuration: &Configuration) -> Result<Flow, String> {
    Ok(follower(configuration)?.tape().flow())
}

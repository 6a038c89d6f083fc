//! The firmware's algorithm as a sequence of equal steps, one per solution: what is recorded as a
//! tape and tuned.

use cardan_datapath::Arithmetic;
use cardan_firmware::attitude::{self, solve};
use cardan_firmware::averaging::Decimator;
use cardan_firmware::calibration::Calibration;
use cardan_numerics::Datapath;
use cardan_spec::ThirdTilt;
use cardan_spec::calibration::WORDS;
use cardan_spec::timing::Averaging;
use cardan_units::AdcCode;

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

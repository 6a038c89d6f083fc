//! The firmware's algorithm as a sequence of equal steps, one per solution: what is recorded as a
//! tape and tuned.

use cardan_datapath::Arithmetic;
use cardan_firmware::attitude::{self, solve};
use cardan_firmware::averaging::Averager;
use cardan_firmware::calibration::Calibration;
use cardan_numerics::Datapath;
use cardan_spec::CHANNELS;
use cardan_spec::calibration::WORDS;
use cardan_spec::timing::{AVERAGING, WARM_UP_SOLUTIONS};
use cardan_units::AdcCode;

/// The attitude with these calibration words; a step's inputs are the codes of one solution, in the
/// order of conversion.
#[derive(Clone, Debug)]
pub struct AttitudeDatapath {
    /// Words of the EEPROM image.
    pub words: [i32; WORDS],
}

/// Calibration, averager and what solutions leave to each other.
pub struct State<M: Arithmetic> {
    calibration: Calibration<M>,
    averager: Averager<M>,
    state: attitude::State<M>,
}

impl Datapath for AttitudeDatapath {
    type State<M: Arithmetic> = State<M>;

    fn start<M: Arithmetic>(&self, m: &M) -> State<M> {
        let mut averager = Averager::new(m);
        // The warm-up is ignored before it reaches the arithmetic.
        for _ in 0..WARM_UP_SOLUTIONS * AVERAGING * CHANNELS {
            averager.push(m, AdcCode(0));
        }
        State {
            calibration: Calibration::new(m, &self.words),
            averager,
            state: attitude::State::new(m),
        }
    }

    fn step<M: Arithmetic>(&self, m: &M, state: &mut State<M>, inputs: &[i32]) {
        for &code in inputs {
            // Codes have ten bits.
            let code = AdcCode(code as u16);
            if let Some(sums) = state.averager.push(m, code) {
                solve(m, &state.calibration, &mut state.state, &sums);
            }
        }
    }
}

//! A 32-tap FIR low-pass: a Hann window of unit sum.

use cardan_datapath::{Arithmetic, Constant, Table, Value};
use cardan_numerics::Datapath;

use crate::nodes::{FirCoefficient, FirInput, FirOutput, FirProduct, FirSum};

/// Taps.
const TAPS: usize = 32;

struct Zero;
impl Constant for Zero {
    const VALUE: f64 = 0.0;
}

/// sin^2(pi (k + 1) / 33) / 16.5, symmetric.
struct Window;
impl Table for Window {
    const VALUES: &'static [f64] = &[
        0.000_547_615_234,
        0.002_170_668_696,
        0.004_810_499_005,
        0.008_371_695_815,
        0.012_725_548_195,
        0.017_714_696_576,
        0.023_158_820_136,
        0.028_861_154_066,
        0.034_615_601_160,
        0.040_214_180_707,
        0.045_454_545_455,
        0.050_147_294_968,
        0.054_122_821_053,
        0.057_237_437_838,
        0.059_378_574_958,
        0.060_468_846_139,
        0.060_468_846_139,
        0.059_378_574_958,
        0.057_237_437_838,
        0.054_122_821_053,
        0.050_147_294_968,
        0.045_454_545_455,
        0.040_214_180_707,
        0.034_615_601_160,
        0.028_861_154_066,
        0.023_158_820_136,
        0.017_714_696_576,
        0.012_725_548_195,
        0.008_371_695_815,
        0.004_810_499_005,
        0.002_170_668_696,
        0.000_547_615_234,
    ];
}

/// The filter.
#[derive(Clone, Copy, Debug)]
pub struct Fir;

/// The last inputs, in a ring.
pub struct State<M: Arithmetic> {
    inputs: [Value<M, FirInput>; TAPS],
    newest: usize,
}

impl Datapath for Fir {
    type State<M: Arithmetic> = State<M>;

    fn start<M: Arithmetic>(&self, m: &M) -> State<M> {
        State {
            inputs: [m.constant::<FirInput, Zero>(); TAPS],
            newest: 0,
        }
    }

    fn step<M: Arithmetic>(&self, m: &M, state: &mut State<M>, inputs: &[i32]) {
        state.newest = (state.newest + 1) % TAPS;
        state.inputs[state.newest] = m.input::<FirInput, 15>(inputs[0]);
        let mut sum = m.constant::<FirSum, Zero>();
        for tap in 0..TAPS {
            let x = state.inputs[(state.newest + TAPS - tap) % TAPS];
            let product: Value<M, FirProduct> = m.mul(x, m.entry::<FirCoefficient, Window>(tap));
            sum = m.add(sum, product);
        }
        let _: Value<M, FirOutput> = m.shift::<FirOutput, FirSum, 0>(sum);
    }
}

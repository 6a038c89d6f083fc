//! A second-order low-pass in direct form 1: y = b0 x + b1 x1 + b2 x2 - a1 y1 - a2 y2.

use cardan_datapath::{Arithmetic, Constant, Value};
use cardan_numerics::Datapath;

use crate::nodes::{BiquadCoefficient, BiquadInput, BiquadOutput, BiquadProduct, BiquadSum};

macro_rules! coefficients {
    ($($name:ident = $value:expr;)*) => {$(
        struct $name;
        impl Constant for $name {
            const VALUE: f64 = $value;
        }
    )*};
}
// Butterworth, corner at a tenth of the sample rate.
coefficients! {
    Zero = 0.0;
    B0 = 0.067_455_273_889_071_9;
    B1 = 0.134_910_547_778_143_8;
    B2 = 0.067_455_273_889_071_9;
    A1 = -1.142_980_502_539_9;
    A2 = 0.412_801_598_096_188;
}

/// The filter.
#[derive(Clone, Copy, Debug)]
pub struct Biquad;

/// The last two inputs and outputs.
pub struct State<M: Arithmetic> {
    inputs: [Value<M, BiquadInput>; 2],
    outputs: [Value<M, BiquadOutput>; 2],
}

impl Datapath for Biquad {
    type State<M: Arithmetic> = State<M>;

    fn start<M: Arithmetic>(&self, m: &M) -> State<M> {
        State {
            inputs: [m.constant::<BiquadInput, Zero>(); 2],
            outputs: [m.constant::<BiquadOutput, Zero>(); 2],
        }
    }

    fn step<M: Arithmetic>(&self, m: &M, state: &mut State<M>, inputs: &[i32]) {
        let x: Value<M, BiquadInput> = m.input::<BiquadInput, 15>(inputs[0]);
        let [x1, x2] = state.inputs;
        let [y1, y2] = state.outputs;
        let p0: Value<M, BiquadProduct> = m.mul(x, m.constant::<BiquadCoefficient, B0>());
        let p1: Value<M, BiquadProduct> = m.mul(x1, m.constant::<BiquadCoefficient, B1>());
        let p2: Value<M, BiquadProduct> = m.mul(x2, m.constant::<BiquadCoefficient, B2>());
        let q1: Value<M, BiquadProduct> = m.mul(y1, m.constant::<BiquadCoefficient, A1>());
        let q2: Value<M, BiquadProduct> = m.mul(y2, m.constant::<BiquadCoefficient, A2>());
        let sum: Value<M, BiquadSum> = m.add(p0, p1);
        let sum: Value<M, BiquadSum> = m.add(sum, p2);
        let sum: Value<M, BiquadSum> = m.sub(sum, q1);
        let sum: Value<M, BiquadSum> = m.sub(sum, q2);
        let y: Value<M, BiquadOutput> = m.shift::<BiquadOutput, BiquadSum, 0>(sum);
        state.inputs = [x, x1];
        state.outputs = [y, y1];
    }
}

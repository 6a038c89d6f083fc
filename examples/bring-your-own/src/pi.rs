//! A PI controller with limits: the integrator stands still at the actuator's ends (no wind-up).

use cardan_datapath::{Arithmetic, Constant, Node, Value};
use cardan_numerics::Datapath;

use crate::nodes::{
    PiError, PiGain, PiIntegral, PiMeasured, PiOutput, PiProportional, PiStep, PiSum,
};

macro_rules! constants {
    ($($name:ident = $value:expr;)*) => {$(
        struct $name;
        impl Constant for $name {
            const VALUE: f64 = $value;
        }
    )*};
}
constants! {
    Zero = 0.0;
    SetPoint = 1.5;
    Proportional = 0.8;
    Integral = 0.05;
    Highest = 5.0;
    Lowest = -5.0;
}

/// The controller; its input is the measured voltage in units of 2^-12 V.
#[derive(Clone, Copy, Debug)]
pub struct Pi;

/// `value` between the actuator's ends.
fn limited<M: Arithmetic, N: Node, A: Node>(m: &M, value: Value<M, A>) -> Value<M, N> {
    let highest = m.constant::<PiOutput, Highest>();
    let lowest = m.constant::<PiOutput, Lowest>();
    let below: Value<M, N> = m.select(m.less(highest, value), highest, value);
    m.select(m.less(below, lowest), lowest, below)
}

impl Datapath for Pi {
    type State<M: Arithmetic> = Value<M, PiIntegral>;

    fn start<M: Arithmetic>(&self, m: &M) -> Value<M, PiIntegral> {
        m.constant::<PiIntegral, Zero>()
    }

    fn step<M: Arithmetic>(&self, m: &M, state: &mut Value<M, PiIntegral>, inputs: &[i32]) {
        let measured: Value<M, PiMeasured> = m.input::<PiMeasured, 12>(inputs[0]);
        let set_point = m.constant::<PiMeasured, SetPoint>();
        let error: Value<M, PiError> = m.sub(set_point, measured);
        let proportional: Value<M, PiProportional> =
            m.mul(error, m.constant::<PiGain, Proportional>());
        let step: Value<M, PiStep> = m.mul(error, m.constant::<PiGain, Integral>());
        let moved: Value<M, PiIntegral> = m.add(*state, step);
        *state = limited(m, moved);
        let sum: Value<M, PiSum> = m.add(proportional, *state);
        let _: Value<M, PiOutput> = limited(m, sum);
    }
}

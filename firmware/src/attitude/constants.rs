//! The constants of the solution.

use cardan_datapath::Constant;
use cardan_spec::flags::UNREST_MOST;
use cardan_spec::{ACCELERATION_LIMIT, DOMAIN_MARGIN, FIELD_RESIDUAL_LIMIT, INCONSISTENCY_LIMIT};
use cardan_spec::{HALF_SPACE_LEAST_DOWN_SQUARE, HALF_SPACE_LEAST_SUM, YAW_LEAST_EAST_SQUARE};

macro_rules! constants {
    ($($name:ident = $value:expr;)*) => {$(
        pub(super) struct $name;
        impl Constant for $name {
            const VALUE: f64 = $value;
        }
    )*};
}
constants! {
    Zero = 0.0;
    Unity = 1.0;
    MinusUnity = -1.0;
    DomainLimit = 1.0 + DOMAIN_MARGIN;
    OppositeDomainLimit = -(1.0 + DOMAIN_MARGIN);
    LeastEast = YAW_LEAST_EAST_SQUARE;
    LeastDown = HALF_SPACE_LEAST_DOWN_SQUARE;
    LeastVertical = HALF_SPACE_LEAST_SUM;
    ResidualLimit = FIELD_RESIDUAL_LIMIT;
    InconsistencyLimit = INCONSISTENCY_LIMIT;
    AccelerationLimit = ACCELERATION_LIMIT;
    OppositeAccelerationLimit = -ACCELERATION_LIMIT;
    MostUnrest = UNREST_MOST;
}

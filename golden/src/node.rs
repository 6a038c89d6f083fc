//! Indices of the shared nodes in [`cardan_spec::nodes::SHARED`], found at compile time by name.

use cardan_spec::nodes::{self, SHARED, SharedNode};

/// Index of `node` in [`SHARED`]; a node that is not there stops the build.
#[must_use]
pub const fn index_of(node: &SharedNode) -> usize {
    let mut index = 0;
    while index < SHARED.len() {
        if same(SHARED[index].name, node.name) {
            return index;
        }
        index += 1;
    }
    panic!("the node is not in cardan_spec::nodes::SHARED");
}

const fn same(left: &str, right: &str) -> bool {
    let (left, right) = (left.as_bytes(), right.as_bytes());
    if left.len() != right.len() {
        return false;
    }
    let mut index = 0;
    while index < left.len() {
        if left[index] != right[index] {
            return false;
        }
        index += 1;
    }
    true
}

macro_rules! indices {
    ($($name:ident),* $(,)?) => {
        $(
            #[doc = concat!("Index of [`cardan_spec::nodes::", stringify!($name), "`].")]
            pub const $name: usize = index_of(&nodes::$name);
        )*
    };
}

indices!(
    SAMPLE,
    ACCUMULATOR,
    MEAN,
    AVERAGE,
    TILT_X,
    TILT_Y,
    TILT_Z,
    FIELD_X,
    FIELD_Y,
    GRAVITY_X,
    GRAVITY_Y,
    COS_1,
    COS_2,
    DOWN,
    HEADING_COS_1,
    HEADING_SIN_2,
    YAW_1,
    YAW_2,
    WEIGHT_1,
    YAW,
    PITCH,
    ROLL,
    DIP_PRODUCT,
    FIELD_Z_SQUARE,
    HEADING_SQUARE,
    INCONSISTENCY,
    ACCELERATION,
);

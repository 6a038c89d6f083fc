//! A device without converter: readings in, angles and status out; and attitudes as matrices.

use std::cell::RefCell;
use std::rc::Rc;

use cardan_datapath::{Arithmetic, Deployed, Overflow, Tap, Value};
use cardan_firmware::attitude::{State, solve};
use cardan_firmware::averaging::Averages;
use cardan_firmware::calibration::Calibration;
use cardan_firmware::nodes::{Average, NODES};
use cardan_spec::calibration::{FRAC, WORDS};
use cardan_spec::timing::Averaging;
use cardan_spec::{MOST_CHANNELS, ThirdTilt};

/// Body components of north, east and down: rows are body axes, columns the reference's.
pub(crate) type Matrix = [[f64; 3]; 3];

/// The Earth's field over its length.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Field {
    pub(crate) horizontal: f64,
    pub(crate) vertical: f64,
}

/// A field of whole numbers near the reference site's.
pub(crate) const SITE: Field = Field {
    horizontal: 0.6,
    vertical: 0.8,
};

impl Field {
    pub(crate) fn inclined(degrees: f64) -> Self {
        let (vertical, horizontal) = degrees.to_radians().sin_cos();
        Self {
            horizontal,
            vertical,
        }
    }
}

/// Gravity along body x, y, z in g, field along body x and y over its length.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Readings {
    pub(crate) tilt: [f64; 3],
    pub(crate) field: [f64; 2],
}

impl Readings {
    /// A specific force of another length.
    pub(crate) fn force(&mut self, length: f64) {
        self.tilt = self.tilt.map(|t| t * length);
    }

    /// The field along body z.
    pub(crate) fn z_field(&self, truth: &Matrix, field: Field) -> f64 {
        field.horizontal * truth[2][0] + field.vertical * truth[2][2]
    }
}

/// The attitude of set 1's angles in degrees: turns about x, y and z one after the other, from the body
/// inwards.
pub(crate) fn attitude(yaw: f64, pitch: f64, roll: f64) -> Matrix {
    let [(sy, cy), (sp, cp), (sr, cr)] = [yaw, pitch, roll].map(|a| a.to_radians().sin_cos());
    let about_z = [[cy, sy, 0.0], [-sy, cy, 0.0], [0.0, 0.0, 1.0]];
    let about_y = [[cp, 0.0, -sp], [0.0, 1.0, 0.0], [sp, 0.0, cp]];
    let about_x = [[1.0, 0.0, 0.0], [0.0, cr, sr], [0.0, -sr, cr]];
    product(&about_x, &product(&about_y, &about_z))
}

fn product(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|row| {
        std::array::from_fn(|column| (0..3).map(|k| a[row][k] * b[k][column]).sum())
    })
}

/// An attitude whose body z has these components along north and down.
pub(crate) fn with_z(north: f64, down: f64) -> Matrix {
    let east = (1.0 - north * north - down * down).max(0.0).sqrt();
    let z = [north, east, down];
    let x = unit(cross([0.3, -0.5, 0.8], z));
    [x, cross(z, x), z]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3])
}

fn unit(v: [f64; 3]) -> [f64; 3] {
    let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
    v.map(|x| x / length)
}

/// What sensors at rest read.
pub(crate) fn ideal(truth: &Matrix, field: Field) -> Readings {
    let along = |row: usize| field.horizontal * truth[row][0] + field.vertical * truth[row][2];
    Readings {
        tilt: [0, 1, 2].map(|row| truth[row][2]),
        field: [along(0), along(1)],
    }
}

/// A solution in degrees.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Solution {
    pub(crate) yaw: f64,
    pub(crate) pitch: f64,
    pub(crate) roll: f64,
    pub(crate) flags: u16,
}

/// The angle of the rotation between a solution and the truth.
pub(crate) fn error_degrees(solution: &Solution, truth: &Matrix) -> f64 {
    let found = attitude(solution.yaw, solution.pitch, solution.roll);
    let chord: f64 = (0..9)
        .map(|at| (found[at / 3][at % 3] - truth[at / 3][at % 3]).powi(2))
        .sum();
    // The Frobenius norm of the difference is 2 sqrt(2) times the sine of half the angle.
    2.0 * (chord / 8.0).sqrt().min(1.0).asin().to_degrees()
}

/// Counts saturations by node.
#[derive(Clone, Default)]
struct Counter(Rc<RefCell<Vec<usize>>>);

impl Tap for Counter {
    fn write(&self, _: usize, _: i64) {}
    fn overflow(&self, index: usize) {
        self.0.borrow_mut().push(index);
    }
}

/// The solver of a device.
pub(crate) struct Device {
    m: Deployed<Counter>,
    calibration: Calibration<Deployed<Counter>>,
    state: State<Deployed<Counter>>,
    third: ThirdTilt,
    counter: Counter,
}

/// Full scale of the tilt channels in g, negative as the reading at rest is.
const TILT: f64 = -1.2;
/// Full scale of the field channels over the field's length.
const FULL_FIELD: f64 = 1.3;

impl Device {
    pub(crate) fn new(field: Field, third: ThirdTilt, averaging: Averaging) -> Self {
        let counter = Counter::default();
        let m = Deployed::new(counter.clone());
        let mut values = [0.0; WORDS];
        values[2] = TILT;
        values[5] = TILT;
        values[8] = FULL_FIELD;
        values[11] = FULL_FIELD;
        values[12] = field.horizontal;
        values[13] = field.vertical;
        values[14] = 1.0 / field.horizontal;
        values[16] = TILT;
        let words = values.map(|value| (value * f64::from(1_u32 << FRAC)).round() as i32);
        let calibration = Calibration::new(&m, &words, third);
        let state = State::new(&m, averaging);
        Self {
            m,
            calibration,
            state,
            third,
            counter,
        }
    }

    pub(crate) fn set_upright(&mut self) {
        self.state.set_upright(&self.m);
    }

    pub(crate) fn solve(&mut self, readings: &Readings) -> Solution {
        self.solve_with(readings, false)
    }

    /// The same where a code stood at either end of the scale.
    pub(crate) fn solve_clipped(&mut self, readings: &Readings) -> Solution {
        self.solve_with(readings, true)
    }

    fn solve_with(&mut self, readings: &Readings, clipped: bool) -> Solution {
        let [t1, t2, t3] = readings.tilt.map(|t| t / TILT);
        let [b1, b2] = readings.field.map(|b| b / FULL_FIELD);
        let third = if self.third == ThirdTilt::Measured {
            t3
        } else {
            0.0
        };
        let word = |share: f64| {
            assert!(share.abs() < 1.0, "{share} of full scale");
            Value::new(<Average as cardan_datapath::Node>::Word::from_bits(
                (share * 32768.0).round() as i16,
            ))
        };
        let values: [f64; MOST_CHANNELS] = [t1, t2, b1, b2, third];
        let averages = Averages {
            values: values.map(word),
            clipped,
            late: false,
        };
        let sign = if readings.tilt[2] < 0.0 { -1 } else { 1 };
        let (m, state) = (&self.m, &mut self.state);
        let angles = solve(m, &self.calibration, state, &averages, sign);
        let degrees = |raw: i16| f64::from(raw) / 32768.0 * 180.0;
        Solution {
            yaw: degrees(angles.yaw.word().to_bits()),
            pitch: degrees(angles.pitch.word().to_bits()),
            roll: degrees(angles.roll.word().to_bits()),
            flags: m.take_status(),
        }
    }

    /// Nodes that were saturated so far, by name.
    pub(crate) fn saturated(&self) -> String {
        let names = self.counter.0.borrow();
        let saturating = names
            .iter()
            .filter(|&&index| NODES[index].format.overflow == Overflow::Saturate);
        saturating
            .map(|&index| NODES[index].name)
            .collect::<Vec<_>>()
            .join(" ")
    }
}

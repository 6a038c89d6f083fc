//! What is computed on the host and on the target alike, and must come to the same.
//!
//! The host's results are committed in `expected.in`; a test on the host sees to it that they are
//! the host's results indeed, the board's tests compare the target's with them.

use cardan_datapath::fixed::traits::Fixed;
use cardan_datapath::{Arithmetic, Container, Deployed, Node, Silent, Value};
use cardan_firmware::averaging::{Averages, Decimator};
use cardan_firmware::calibration::{NOMINAL, Settings};
use cardan_firmware::device::Solver;
use cardan_firmware::frame::{Frame, crc16};
use cardan_firmware::nodes::{
    Accumulator, Block, Centred, Cos1, CosRoll, Down, Excess, HeadingCos1, InverseHorizontal,
    InverseSum, InverseTerm, LevelCos, LevelX, One, Radicand, Square, TiltGain, TiltProduct, TiltX,
    TiltY, Weight1, YawCorrection, YawDifference,
};
use cardan_spec::ThirdTilt;
use cardan_spec::calibration::LEN;
use cardan_spec::timing::{Averaging, BLOCK_CONVERSIONS, WARM_UP_BLOCKS};
use cardan_units::AdcCode;

/// Conversions of a solution.
const CONVERSIONS: usize = BLOCK_CONVERSIONS;
/// Solutions that are computed.
pub(crate) const SOLUTIONS: usize = 12;
/// Operations per kernel.
const OPERATIONS: usize = 500;

// In flash: the controller's RAM holds better things.
#[cfg_attr(target_arch = "avr", unsafe(link_section = ".progmem.data.codes"))]
static CODES: [[u16; CONVERSIONS]; SOLUTIONS] = include!("codes.in");

/// A code of [`CODES`].
#[cfg(not(target_arch = "avr"))]
fn code(solution: usize, index: usize) -> u16 {
    CODES[solution][index]
}

/// A code of [`CODES`], from program memory.
#[cfg(target_arch = "avr")]
fn code(solution: usize, index: usize) -> u16 {
    let address = &raw const CODES[solution][index];
    let (low, high): (u8, u8);
    // SAFETY: LPM reads two bytes of the table, which lies in flash.
    unsafe {
        core::arch::asm!(
            "lpm {low}, Z+",
            "lpm {high}, Z",
            low = out(reg) low,
            high = out(reg) high,
            inout("Z") address => _,
            options(pure, readonly, nostack, preserves_flags),
        );
    }
    u16::from_le_bytes([low, high])
}

/// Results: checksums over all words of a kernel, and whole frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Results {
    /// Products of 16-bit words.
    pub(crate) products: u16,
    /// Products of longer words.
    pub(crate) long_products: u16,
    /// Quotients, zero divisors among them.
    pub(crate) quotients: u16,
    /// Square roots, negative arguments among them.
    pub(crate) roots: u16,
    /// Sums, differences, shifts, limits.
    pub(crate) sums: u16,
    /// One frame per solution.
    pub(crate) frames: [Frame; SOLUTIONS],
}

/// The host's results.
pub(crate) const EXPECTED: Results = include!("expected.in");

/// Pseudo-random words: xorshift, period 2^32 - 1.
struct Words(u32);

impl Words {
    fn new() -> Self {
        Self(0x2545_f491)
    }

    /// A raw word of node `N`, of any magnitude.
    fn raw<N: Node>(&mut self) -> i32 {
        let mut next = || {
            self.0 ^= self.0 << 13;
            self.0 ^= self.0 >> 17;
            self.0 ^= self.0 << 5;
            self.0 as i32
        };
        // Small and large, and now and then 0.
        let magnitude = next() as u32 % N::FORMAT.word;
        next() >> (32 - N::FORMAT.word) >> magnitude
    }

    /// A value of node `N`.
    fn value<N: Node>(&mut self) -> Value<Deployed<Silent>, N> {
        let raw = self.raw::<N>();
        let bits = <<N::Word as Fixed>::Bits as Container>::from_i64(i64::from(raw));
        Value::new(N::Word::from_bits(bits))
    }
}

/// A checksum over raw words.
struct Checksum([u8; 6]);

impl Checksum {
    fn new() -> Self {
        Self([0; 6])
    }

    fn add<N: Node>(&mut self, value: Value<Deployed<Silent>, N>) {
        let word = value.word().to_bits().to_i32();
        self.0[..4].copy_from_slice(&word.to_le_bytes());
        let crc = crc16(&self.0);
        self.0[4..].copy_from_slice(&crc.to_le_bytes());
    }

    fn get(&self) -> u16 {
        u16::from_le_bytes([self.0[4], self.0[5]])
    }
}

fn checksum(mut operation: impl FnMut(&Deployed<Silent>, &mut Words, &mut Checksum)) -> u16 {
    let (m, mut words, mut sum) = (Deployed::new(Silent), Words::new(), Checksum::new());
    for _ in 0..OPERATIONS {
        operation(&m, &mut words, &mut sum);
    }
    sum.get()
}

/// Products of 16-bit words.
#[inline(never)]
pub(crate) fn products() -> u16 {
    checksum(|m, words, sum| {
        let product = m.mul::<TiltProduct, TiltGain, Centred>(words.value(), words.value());
        sum.add(product);
        sum.add(m.mul::<Square, TiltX, TiltX>(words.value(), words.value()));
        sum.add(m.mul::<LevelCos, LevelX, InverseHorizontal>(words.value(), words.value()));
        sum.add(m.mul::<InverseTerm, InverseSum, Excess>(words.value(), words.value()));
    })
}

/// Products of longer words.
#[inline(never)]
pub(crate) fn long_products() -> u16 {
    checksum(|m, words, sum| {
        sum.add(m.mul::<YawCorrection, Weight1, YawDifference>(words.value(), words.value()));
        sum.add(m.mul::<HeadingCos1, CosRoll, HeadingCos1>(words.value(), words.value()));
    })
}

/// Quotients, zero divisors among them.
#[inline(never)]
pub(crate) fn quotients() -> u16 {
    checksum(|m, words, sum| {
        sum.add(m.div::<HeadingCos1, LevelCos, Cos1>(words.value(), words.value()));
        sum.add(m.div::<CosRoll, Down, Cos1>(words.value(), words.value()));
    })
}

/// Square roots, negative arguments among them.
#[inline(never)]
pub(crate) fn roots() -> u16 {
    checksum(|m, words, sum| {
        sum.add(m.sqrt::<Cos1, Radicand>(words.value()));
        sum.add(m.sqrt::<Down, Radicand>(words.value()));
    })
}

/// Sums, differences, shifts, scales, limits.
#[inline(never)]
pub(crate) fn sums() -> u16 {
    checksum(|m, words, sum| {
        let (a, b) = (words.value::<TiltX>(), words.value::<TiltY>());
        sum.add(m.add::<TiltX, _, _>(a, b));
        sum.add(m.sub::<One, _, _>(a, b));
        sum.add(m.shift::<Centred, _, 3>(a));
        // The averages' powers, and one beyond at either end.
        let power = words.raw::<One>().rem_euclid(15) - 22;
        sum.add(m.scale::<Block, Accumulator, -21, -9>(words.value(), power));
        sum.add(m.neg::<TiltY, _>(a));
        sum.add(m.abs::<Cos1, _>(a));
        sum.add(m.select::<TiltX, _, _>(m.less(a, b), a, b));
    })
}

/// Computes all solutions in order, from codes to frames; returns false at the first that
/// `is_good` refuses.
#[inline(never)]
pub(crate) fn solutions(mut is_good: impl FnMut(usize, &Frame) -> bool) -> bool {
    let settings = Settings::from_image(&eeprom());
    let mut solver = Solver::new(Silent, &settings);
    let m = Deployed::new(Silent);
    let mut decimator = Decimator::new(&m, settings.averaging);
    for _ in 0..WARM_UP_BLOCKS * CONVERSIONS {
        if decimator.push(&m, AdcCode(1023)).is_some() {
            return false;
        }
    }
    for number in 0..SOLUTIONS {
        let mut complete: Option<Averages<_>> = None;
        for index in 0..CONVERSIONS {
            if complete.is_some() {
                return false;
            }
            complete = decimator.push(&m, AdcCode(code(number, index)));
        }
        match complete {
            Some(averages) if is_good(number, &solver.solve(&averages, 0)) => {}
            _ => return false,
        }
    }
    true
}

/// Valid settings.
pub(crate) const SETTINGS: Settings = Settings {
    words: NOMINAL,
    averaging: Averaging::DEFAULT,
    third_tilt: ThirdTilt::Absent,
    uncalibrated: false,
};

/// Their image.
pub(crate) fn eeprom() -> [u8; LEN] {
    SETTINGS.image()
}

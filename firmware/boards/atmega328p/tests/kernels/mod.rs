//! The kernels in assembly against their definition, both on the target: all pairs of edges, and
//! pseudo-random pairs of all magnitudes, close to each other, and with tiny divisors.

use core::hint::black_box;

use cardan_datapath::kernel::{avr, portable};

const EDGES: [i16; 12] =
    [0, 1, -1, 2, -2, 32767, -32768, -32767, 16384, -16384, 16383, 8192];

const PAIRS: u16 = 4000;

pub fn equal_their_definition() -> bool {
    let mut seed: u32 = 12345;
    let mut random = || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (seed >> 16) as i16
    };
    EDGES.iter().all(|&a| EDGES.iter().all(|&b| pair(a, b)))
        && (0..PAIRS).all(|number| {
            let (a, b) = (random(), random());
            match number % 8 {
                1 => pair(a >> 4, b),
                2 => pair(a, b >> 4),
                3 => pair(a >> 9, b >> 8),
                4 => pair(a, a.wrapping_add(b >> 12)),
                5 => pair(a, b >> 13),
                6 => pair(a, (a / 2).wrapping_add(b >> 12)),
                _ => pair(a, b),
            }
        })
}

fn pair(a: i16, b: i16) -> bool {
    let (a, b) = (black_box(a), black_box(b));
    words(a, b) && wide(i32::from(a) << 16 | i32::from(b as u16))
}

fn words(a: i16, b: i16) -> bool {
    avr::add16(a, b) == portable::add16(a, b)
        && avr::sub16(a, b) == portable::sub16(a, b)
        && avr::neg16(a) == portable::neg16(a)
        && avr::abs16(a) == portable::abs16(a)
        && avr::multiply16(a, b) == portable::multiply16(a, b)
        && avr::multiply31(a, b) == portable::multiply31(a, b)
        && avr::multiply_round14(a, b) == portable::multiply_round14(a, b)
        && avr::multiply_round15(a, b) == portable::multiply_round15(a, b)
        && avr::multiply_round16(a, b) == portable::multiply_round16(a, b)
        && (b == 0
            || avr::divide14(a, b) == portable::divide14(a, b)
                && avr::divide15(a, b) == portable::divide15(a, b))
}

fn wide(raw: i32) -> bool {
    avr::round14(raw) == portable::round14(raw)
        && avr::round15(raw) == portable::round15(raw)
        && avr::square_root16(raw as u32) == portable::square_root16(raw as u32)
        && avr::square_root16(raw as u32 >> 2) == portable::square_root16(raw as u32 >> 2)
}

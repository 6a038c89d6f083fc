//! Random flash never panics: every word sequence, every peripheral register.

use cardan_emulator::{ATMEGA328P, Environment, Fuses, Machine, Stop};
use proptest::prelude::*;

/// An environment with inputs that never rest.
struct Noise(u64);

impl Environment for Noise {
    fn pin_level(&mut self, cycle: u64, pin: cardan_emulator::Pin) -> Option<bool> {
        Some((cycle >> 4).wrapping_mul(pin.index() as u64 + 3) & 4 != 0)
    }

    fn analog(&mut self, cycle: u64, _input: cardan_emulator::AnalogInput) -> f64 {
        (cycle % 500) as f64 / 100.0
    }

    fn uart_rx(&mut self, cycle: u64) -> Option<cardan_emulator::SerialByte> {
        self.0 += 1;
        (self.0 < 50).then_some(cardan_emulator::SerialByte {
            start_cycle: cycle + 100,
            byte: self.0 as u8,
            ninth: self.0.is_multiple_of(3),
        })
    }

    fn next_input(&self, cycle: u64) -> Option<u64> {
        Some(cycle + 37)
    }
}

/// Words biased towards accesses to I/O registers.
fn word() -> impl Strategy<Value = Vec<u16>> {
    prop_oneof![
        3 => any::<u16>().prop_map(|w| vec![w]),
        3 => (0u16..16, any::<u8>(), 0x20u16..0x100).prop_map(|(d, value, address)| {
            let ldi = 0xE000 | d << 4 | u16::from(value & 0xF0) << 4 | u16::from(value & 15);
            vec![ldi, 0x9300 | d << 4, address]
        }),
        1 => (0u16..32, 0x20u16..0x100).prop_map(|(d, address)| vec![0x9000 | d << 4, address]),
        1 => Just(vec![0x9478]),
        1 => Just(vec![0x9588]),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    #[test]
    fn random_programs_never_panic_and_always_get_on(
        items in prop::collection::vec(word(), 1..300), high in any::<u8>(),
    ) {
        let words = items.concat();
        let mut machine = Machine::new(&ATMEGA328P, 8_000_000);
        machine.write_flash(0, &words);
        // A second copy at the boot section, from which SPM works.
        machine.write_flash(0x3800, &words);
        machine.set_fuses(Fuses { high, ..Fuses::default() });
        let mut again = machine.clone();
        let stop = machine.run(&mut Noise(0), 200_000);
        prop_assert!(stop != Stop::Limit || machine.cycle() >= 200_000);
        // The same program in the same world comes to the same.
        prop_assert_eq!(again.run(&mut Noise(0), 200_000), stop);
        prop_assert!(again == machine);
    }
}

//! What interrupt handlers damage is found alike by both engines.

#[path = "../../tests/common/mod.rs"]
mod common;

use cardan_emulator::{Machine, Unconnected};
use cardan_translator::{Limits, Translator};

/// Timer0 interrupts every 256 cycles; every third time its handler spoils a register and SREG.
fn machine() -> Machine {
    common::program(
        "damage_engines",
        "vector 16, isr
         start: set TIMSK0, 1
         set TCCR0B, 1
         ldi r22, 3
         sei
      1: ldi r24, 3
         ldi r25, 40
      2: add r24, r25
         adc r23, r24
         dec r25
         brne 2b
         rjmp 1b
      isr: push r20
         in r20, _SFR_IO_ADDR(SREG)
         push r20
         lds r20, 0x200
         inc r20
         cp r20, r22
         brne 3f
         clr r20
         com r24
         pop r21
         push r20
      3: sts 0x200, r20
         pop r20
         out _SFR_IO_ADDR(SREG), r20
         pop r20
         reti",
    )
}

#[test]
fn both_engines_find_the_same_damage() {
    let mut interpreted = machine();
    interpreted.run(&mut Unconnected, 3_000_000);
    let damage = interpreted.interrupt_damage();
    assert_eq!(damage.len(), 1);
    let counted = interpreted.statistics().vectors[16];
    assert!(counted.damaged * 3 <= counted.returns + 2 && counted.damaged > 1000);
    for threshold in [0, 1, 50] {
        let limits = Limits {
            threshold,
            ..Limits::default()
        };
        let mut engine = Translator::with_limits(limits).expect("a code generator for this host");
        let mut translated = machine();
        translated.run_with(&mut engine, &mut Unconnected, 3_000_000);
        assert!(engine.work().entries > 1000, "little was translated");
        assert_eq!(translated.interrupt_damage(), damage);
        assert!(translated == interpreted);
    }
}

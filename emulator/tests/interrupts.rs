//! What interrupt handlers leave behind: registers and SREG at RETI against those at the entry.

mod common;

use cardan_emulator::{Machine, ReportKind, Stop, Unconnected, VectorStatistics};
use common::program;

const TIMER0_OVF: usize = 16;
const TIMER1_COMPA: usize = 11;

/// A program that Timer0 interrupts every 256 cycles, while `main` runs in a loop.
fn interrupted(name: &str, main: &str, handler: &str) -> Machine {
    let source = format!(
        "vector {TIMER0_OVF}, isr
         start: set TIMSK0, 1
         set TCCR0B, 1
         sei
      1: {main}
         rjmp 1b
      isr: {handler}"
    );
    let mut machine = program(name, &source);
    assert_eq!(machine.run(&mut Unconnected, 20_000), Stop::Limit);
    machine
}

fn statistics(machine: &Machine, vector: usize) -> VectorStatistics {
    machine.statistics().vectors[vector]
}

#[test]
fn a_handler_that_changes_only_sreg_is_reported_with_the_bits() {
    // INC sets V, clears N and Z at 0x80, so that S is set; C and H stay.
    let mut machine = interrupted(
        "damage_sreg",
        "sec\n ldi r20, 1\n and r20, r20",
        "push r20
         ldi r20, 0x7e
         subi r20, 0xff
         inc r20
         pop r20
         reti",
    );
    let [damage] = machine.interrupt_damage() else {
        panic!("{:?}", machine.interrupt_damage())
    };
    assert_eq!((damage.vector, damage.name), (TIMER0_OVF, "TIMER0_OVF"));
    assert_eq!(damage.registers().count(), 0);
    assert_eq!(damage.registers_ever, 0);
    assert_ne!(damage.sreg() & 0x08, 0, "V");
    assert_eq!(damage.sreg() & 0x80, 0, "I is set by RETI itself");
    assert_eq!(damage.sreg_ever & damage.sreg(), damage.sreg());
    assert!(damage.entry_cycle < damage.cycle);
    assert!(machine.disassemble_at(damage.pc).contains("reti"));
    let counted = statistics(&machine, TIMER0_OVF);
    assert!(counted.count > 70, "{counted:?}");
    assert_eq!(counted.damaged, counted.returns);
    assert_eq!(damage.count, counted.damaged);
    assert!(damage.to_string().contains("SREG"), "{damage}");
    // The report comes once, however long the program runs.
    machine.run(&mut Unconnected, 40_000);
    let kinds: Vec<ReportKind> = machine.reports().iter().map(|report| report.kind).collect();
    let [
        ReportKind::InterruptDamage {
            vector, registers, ..
        },
    ] = kinds[..]
    else {
        panic!("{kinds:?}")
    };
    assert_eq!((vector, registers), ("TIMER0_OVF", 0));
    assert!(machine.reports()[0].to_string().contains("SREG"));
}

#[test]
fn a_handler_that_changes_only_r24_is_reported_with_both_values() {
    let machine = interrupted("damage_r24", "ldi r24, 3", "ldi r24, 0x5a\n reti");
    let [damage] = machine.interrupt_damage() else {
        panic!("{:?}", machine.interrupt_damage())
    };
    assert_eq!(damage.registers().collect::<Vec<_>>(), [(24, 3, 0x5A)]);
    assert_eq!((damage.sreg(), damage.sreg_ever), (0, 0));
    assert_eq!(damage.registers_ever, 1 << 24);
    assert_eq!(damage.count, statistics(&machine, TIMER0_OVF).returns);
    // The interrupted instruction is one of the loop: LDI at 0x50, RJMP at 0x52.
    let place = machine.disassemble_at(damage.interrupted_pc);
    assert!(place.contains("ldi") || place.contains("rjmp"), "{place}");
    assert!(damage.to_string().contains("r24 0x03 -> 0x5a"), "{damage}");
}

#[test]
fn a_handler_that_saves_what_it_uses_is_not_reported() {
    let machine = interrupted(
        "damage_none",
        "inc r24\n adc r25, r24\n push r24\n pop r23",
        "push r24
         in r24, _SFR_IO_ADDR(SREG)
         push r24
         inc r24
         eor r25, r24
         eor r25, r24
         pop r24
         out _SFR_IO_ADDR(SREG), r24
         pop r24
         reti",
    );
    assert_eq!(machine.interrupt_damage(), []);
    assert_eq!(machine.reports(), []);
    let counted = statistics(&machine, TIMER0_OVF);
    assert!(counted.returns > 70 && counted.damaged == 0, "{counted:?}");
    assert!(counted.count - counted.returns <= 1);
}

/// Timer0's handler lets others in; Timer1's comes every 301 cycles.
fn nested(name: &str, inner: &str) -> Machine {
    let source = format!(
        "vector {TIMER1_COMPA}, inner
         vector {TIMER0_OVF}, outer
         start: set TIMSK0, 1
         set TIMSK1, 2
         set16 OCR1AL, 300
         set TCCR1B, 0x09
         set TCCR0B, 1
         ldi r21, 0
         sei
      1: inc r24
         rjmp 1b
      outer: push r24
         in r24, _SFR_IO_ADDR(SREG)
         push r24
         ldi r21, 1
         sei
         nops 100
         cli
         ldi r21, 0
         pop r24
         out _SFR_IO_ADDR(SREG), r24
         pop r24
         reti
      inner: {inner}
         reti"
    );
    let mut machine = program(name, &source);
    assert_eq!(machine.run(&mut Unconnected, 200_000), Stop::Limit);
    machine
}

#[test]
fn nested_interrupts_are_compared_each_with_what_it_interrupted() {
    // Counts in r19, which nobody else may: kept in memory instead.
    let source = "push r19
         in r19, _SFR_IO_ADDR(SREG)
         push r19
         lds r19, 0x200
         add r19, r21
         sts 0x200, r19
         pop r19
         out _SFR_IO_ADDR(SREG), r19
         pop r19";
    let machine = nested("nested_clean", source);
    assert_ne!(machine.data()[0x200], 0, "one came inside the other");
    assert_eq!(machine.interrupt_damage(), []);
    for vector in [TIMER0_OVF, TIMER1_COMPA] {
        let counted = statistics(&machine, vector);
        assert!(counted.returns > 100, "{counted:?}");
        assert!(counted.count - counted.returns <= 1, "{counted:?}");
    }
}

#[test]
fn of_nested_interrupts_the_one_that_does_the_damage_comes_first() {
    let machine = nested("nested_damage", "com r18");
    let damage = machine.interrupt_damage();
    assert_eq!(damage[0].name, "TIMER1_COMPA");
    let counted = statistics(&machine, TIMER1_COMPA);
    assert_eq!(counted.damaged, counted.returns);
    // Timer0's handler gives r18 back as it found it where none came inside of it.
    let outer = statistics(&machine, TIMER0_OVF);
    assert!(
        0 < outer.damaged && outer.damaged < outer.returns,
        "{outer:?}"
    );
    assert_eq!(damage[1].registers_ever, 1 << 18);
}

/// Two tasks with stacks of their own; the tick, every 256 cycles, saves everything and goes on with
/// the other one. The second is begun by a RETI to an address that no interrupt has pushed.
fn tasks(name: &str, restore: &str) -> Machine {
    let source = format!(
        ".macro save
            push r0
            in r0, _SFR_IO_ADDR(SREG)
            push r0
            .irp n, 1,2,3,4,5,6,7,8,9,10,11,12,13,14,15,16,17,18,19,20,21,22,23,24,25,26,27,28,29,30,31
            push r\\n
            .endr
         .endm
         .macro restore
            .irp n, 31,30,29,28,27,26,25,24,23,22,21,20,19,18,17,16,15,14,13,12,11,10,9,8,7,6,5,4,3,2,1
            pop r\\n
            .endr
            pop r0
            out _SFR_IO_ADDR(SREG), r0
            pop r0
         .endm
         vector {TIMER0_OVF}, tick
         start:
            ldi r16, 0x04
            out _SFR_IO_ADDR(SPH), r16
            ldi r16, 0xff
            out _SFR_IO_ADDR(SPL), r16
            ldi r16, lo8(pm(second))
            push r16
            ldi r16, hi8(pm(second))
            push r16
            clr r16
            .rept 33
            push r16
            .endr
            in r16, _SFR_IO_ADDR(SPL)
            sts 0x200, r16
            in r16, _SFR_IO_ADDR(SPH)
            sts 0x201, r16
            ldi r16, 0x08
            out _SFR_IO_ADDR(SPH), r16
            ldi r16, 0xff
            out _SFR_IO_ADDR(SPL), r16
            set TIMSK0, 1
            set TCCR0B, 1
            sei
         first: adiw r24, 1
            sts 0x202, r25
            rjmp first
         second: subi r20, 7
            sbc r21, r20
            call third
            sts 0x203, r22
            rjmp second
         third: inc r22
            ret
         tick: save
            in r18, _SFR_IO_ADDR(SPL)
            in r19, _SFR_IO_ADDR(SPH)
            lds r16, 0x200
            lds r17, 0x201
            sts 0x200, r18
            sts 0x201, r19
            out _SFR_IO_ADDR(SPL), r16
            out _SFR_IO_ADDR(SPH), r17
            restore
            {restore}
            reti"
    );
    let mut machine = program(name, &source);
    assert_eq!(machine.run(&mut Unconnected, 400_000), Stop::Limit);
    assert!(machine.data()[0x202] > 10 && machine.data()[0x203] > 0);
    machine
}

#[test]
fn an_operating_system_may_return_to_another_task() {
    let machine = tasks("tasks", "");
    assert_eq!(machine.interrupt_damage(), []);
    let counted = statistics(&machine, TIMER0_OVF);
    // All but the start of the second task, and the two tasks that are interrupted at the end.
    assert!(counted.returns > 1000, "{counted:?}");
    assert!(counted.count - counted.returns <= 3, "{counted:?}");
}

#[test]
fn a_context_switch_that_loses_a_register_is_reported() {
    // Each task finds r22 as the other one has left it.
    let machine = tasks("tasks_damaged", "lds r22, 0x203");
    let damage = machine.interrupt_damage();
    assert_eq!(damage.len(), 1);
    assert_eq!(damage[0].registers_ever, 1 << 22);
    assert!(damage[0].count > 100);
}

#[test]
fn a_handler_that_never_returns_is_compared_with_nothing() {
    let machine = interrupted("damage_endless", "inc r24", "sei\n 2: com r18\n rjmp 2b");
    assert_eq!(machine.interrupt_damage(), []);
    let counted = statistics(&machine, TIMER0_OVF);
    // Each interrupts the one before.
    assert!(counted.count > 50 && counted.returns == 0, "{counted:?}");
}

#[test]
fn a_handler_left_by_ret_or_with_another_return_address_is_compared_with_nothing() {
    let by_ret = "com r18\n sei\n ret";
    // Gives up where it was and begins the loop anew.
    let elsewhere = "pop r16\n pop r16\n ldi r16, lo8(pm(again))\n push r16
         ldi r16, hi8(pm(again))\n push r16\n com r18\n reti";
    for (name, handler) in [("damage_ret", by_ret), ("damage_elsewhere", elsewhere)] {
        let main = "rjmp 3f\n again: inc r25\n 3: inc r24";
        let machine = interrupted(name, main, handler);
        assert_eq!(machine.interrupt_damage(), [], "{name}");
        let counted = statistics(&machine, TIMER0_OVF);
        assert!(counted.count > 70 && counted.returns == 0, "{counted:?}");
    }
}

#[test]
fn a_reti_without_an_interrupt_is_compared_with_nothing() {
    // An idiom to enable interrupts, here also inside of a handler.
    let machine = interrupted(
        "damage_idiom",
        "inc r24\n cli\n rcall enable\n inc r23",
        "push r24
         in r24, _SFR_IO_ADDR(SREG)
         rcall enable
         out _SFR_IO_ADDR(SREG), r24
         cli
         pop r24
      enable: reti",
    );
    assert_eq!(machine.interrupt_damage(), []);
    assert!(statistics(&machine, TIMER0_OVF).returns > 70);
}

#[test]
fn a_longjmp_out_of_a_handler_is_compared_with_nothing() {
    let mut machine = common::compiled(
        "damage_longjmp",
        "#include <avr/interrupt.h>
         #include <avr/io.h>
         #include <setjmp.h>
         jmp_buf out;
         volatile unsigned char jumps, rounds;
         ISR(TIMER0_OVF_vect) { if (++rounds % 3 == 0) longjmp(out, 1); }
         ISR(TIMER1_COMPA_vect) { rounds++; }
         int main(void) {
             TIMSK0 = 1; TCCR0B = 1;
             OCR1A = 777; TIMSK1 = 2; TCCR1B = 9;
             if (setjmp(out)) jumps++;
             sei();
             for (volatile unsigned char i = 0;; i++) {}
         }",
    );
    assert_eq!(machine.run(&mut Unconnected, 1_000_000), Stop::Limit);
    assert_eq!(machine.interrupt_damage(), []);
    let counted = statistics(&machine, TIMER0_OVF);
    assert!(counted.count > counted.returns + 1000, "{counted:?}");
    assert!(counted.returns > 1000, "{counted:?}");
}

#[test]
fn handlers_of_a_compiler_are_clean_and_naked_ones_that_save_too_little_are_not() {
    let source = |handler: &str| {
        format!(
            "#include <avr/interrupt.h>
             #include <avr/io.h>
             volatile unsigned long sum;
             volatile unsigned char ticks;
             {handler}
             int main(void) {{
                 TIMSK0 = 1; TCCR0B = 1;
                 sei();
                 for (unsigned i = 0;; i++) sum += i * 77UL % 13;
             }}"
        )
    };
    let cases = [
        ("clean", "ISR(TIMER0_OVF_vect) { ticks++; sum ^= 1; }", false),
        (
            "naked",
            "ISR(TIMER0_OVF_vect, ISR_NAKED) {
                __asm__(\"push r24\\n lds r24, ticks\\n inc r24\\n sts ticks, r24\\n pop r24\\n reti\");
             }",
            true,
        ),
    ];
    for (name, handler, is_damaged) in cases {
        let mut machine = common::compiled(&format!("damage_{name}"), &source(handler));
        assert_eq!(machine.run(&mut Unconnected, 500_000), Stop::Limit);
        assert!(statistics(&machine, TIMER0_OVF).returns > 1000, "{name}");
        let damage = machine.interrupt_damage();
        assert_eq!(damage.len(), usize::from(is_damaged), "{name}: {damage:?}");
        assert!(
            damage
                .iter()
                .all(|damage| damage.registers_ever == 0 && damage.sreg_ever != 0)
        );
    }
}

//! The converter's reference by REFS1:0 (data sheet, table 24-3), each with a voltage of its own.

mod common;

use cardan_emulator::{AnalogInput, Machine, ReportKind, Stop, Supply};
use common::{Bench, program};

/// AVCC, AREF and the bandgap all differ from each other and from their defaults.
const SUPPLY: Supply = Supply {
    avcc_volts: 4.75,
    aref_volts: 2.048,
    bandgap_volts: 1.085,
};
/// Voltage of the inputs.
const VOLTS: f64 = 0.7;

/// Converts channel 2 with each of the ADMUX values in turn, without an end.
fn machine(name: &str, muxes: [u8; 4]) -> Machine {
    let conversions = muxes.map(|mux| {
        format!(
            "set ADMUX, {mux}
             set ADCSRA, 0xc2
          2: lds r18, ADCSRA
             sbrc r18, 6
             rjmp 2b\n"
        )
    });
    program(
        name,
        &format!("start:\n 1:\n{}\n rjmp 1b", conversions.concat()),
    )
}

fn bench() -> Bench {
    Bench {
        volts: Some(|_, _: AnalogInput| VOLTS),
        ..Bench::default()
    }
}

/// floor(V * 1024 / Vref), section 24.7.
fn code(reference_volts: f64) -> u16 {
    (VOLTS * 1024.0 / reference_volts) as u16
}

#[test]
fn each_setting_of_refs_takes_its_own_voltage() {
    let mut machine = machine("references", [0x02, 0x42, 0xC2, 0x02]);
    machine.set_supply(SUPPLY);
    let mut bench = bench();
    assert_eq!(machine.run(&mut bench, 5_000), Stop::Limit);
    let expected = [2.048, 4.75, 1.085, 2.048];
    assert!(bench.conversions.len() >= expected.len());
    for (conversion, volts) in bench.conversions.iter().zip(expected) {
        assert_eq!(conversion.reference_volts, volts);
        assert_eq!(conversion.code, code(volts), "{conversion:?}");
    }
}

#[test]
fn a_program_that_takes_another_reference_than_meant_gets_other_codes() {
    // With the defaults AREF and AVCC are equal, and a program that mistakes one for the other is
    // right by luck; apart by 2 % they give codes that differ.
    let codes = |supply: Option<Supply>, mux: u8| {
        let mut machine = machine(&format!("references_{mux}"), [mux; 4]);
        if let Some(supply) = supply {
            machine.set_supply(supply);
        }
        let mut bench = bench();
        machine.run(&mut bench, 2_000);
        bench.conversions[0].code
    };
    assert_eq!(codes(None, 0x02), codes(None, 0x42));
    let apart = Supply {
        aref_volts: 4.9,
        ..Supply::default()
    };
    assert_eq!(codes(Some(apart), 0x02), code(4.9));
    assert_eq!(codes(Some(apart), 0x42), code(5.0));
    assert_ne!(code(4.9), code(5.0));
}

#[test]
fn the_voltage_of_a_reference_may_change_between_runs() {
    let mut machine = machine("references_change", [0x02; 4]);
    let mut bench = bench();
    let mut counts = Vec::new();
    for (round, volts) in [5.0, 2.5, 1.25].into_iter().enumerate() {
        machine.set_supply(Supply {
            aref_volts: volts,
            ..machine.supply()
        });
        let before = bench.conversions.len();
        machine.run(&mut bench, 3_000 * (round as u64 + 1));
        let new = &bench.conversions[before..];
        assert!(
            new.iter()
                .all(|c| c.reference_volts == volts || c.hold_cycle < 3_000 * round as u64)
        );
        counts.push(new.last().map(|conversion| conversion.code));
    }
    assert_eq!(counts, [5.0, 2.5, 1.25].map(|volts| Some(code(volts))));
}

#[test]
fn the_reference_is_locked_with_the_multiplexer_from_the_start_of_a_conversion() {
    // ADMUX changes after the first ADC clock edge (at 128 cycles per clock) of a conversion.
    let mut machine = program(
        "references_locked",
        "start: set ADMUX, 0x02
         set ADCSRA, 0xc7
         nops 140
         set ADMUX, 0xc2
      1: lds r18, ADCSRA
         sbrc r18, 6
         rjmp 1b
         set ADCSRA, 0xc7
      2: lds r18, ADCSRA
         sbrc r18, 6
         rjmp 2b
         break",
    );
    machine.set_supply(SUPPLY);
    let mut bench = bench();
    assert_eq!(machine.run(&mut bench, 50_000), Stop::Break);
    let volts: Vec<f64> = bench
        .conversions
        .iter()
        .map(|c| c.reference_volts)
        .collect();
    assert_eq!(volts, [2.048, 1.085]);
}

#[test]
fn the_reserved_setting_of_refs_is_reported() {
    let mut machine = machine("references_reserved", [0x82, 0x02, 0x42, 0xC2]);
    machine.run(&mut bench(), 5_000);
    let kinds: Vec<_> = machine.reports().iter().map(|report| report.kind).collect();
    assert_eq!(kinds, [ReportKind::ReservedSetting]);
}

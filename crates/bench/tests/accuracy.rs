//! The figures that the design must reach, on the emulated chip, with fewer attitudes than
//! `cardan accuracy` takes by default.

use cardan_bench::accuracy::{Case, measure};

fn case(averaging: usize) -> Case {
    Case {
        attitudes: 2000,
        seed: 7,
        most_tilt_deg: 60.0,
        averaging,
        noise_lsb: [0.5; 2],
    }
}

#[test]
fn one_conversion_is_within_the_figures_and_near_the_cramer_rao_bound() {
    let found = measure(&case(1)).expect("runs");
    assert_eq!(found.native_mismatches, 0);
    let emulated = found.emulated;
    assert!(
        emulated.rms <= 0.30 && emulated.p99 <= 0.8 && emulated.max <= 1.5,
        "{found:?}"
    );
    assert!(emulated.rms <= 1.1 * found.cramer_rao_rms, "{found:?}");
    assert!(found.rounding.rms <= 0.1 * found.golden.rms, "{found:?}");
    // Either set alone has dead spots, which the weights take out.
    assert!(found.set_1.rms > 2.0 * emulated.rms && found.set_2.rms > 2.0 * emulated.rms);
}

#[test]
fn sixty_four_conversions_are_within_the_figures_and_rounding_takes_a_fifth_at_most() {
    let found = measure(&case(64)).expect("runs");
    assert_eq!(found.native_mismatches, 0);
    assert!(
        found.emulated.rms <= 0.05 && found.emulated.max <= 0.25,
        "{found:?}"
    );
    assert!(
        found.emulated.rms <= 1.1 * found.cramer_rao_rms,
        "{found:?}"
    );
    assert!(found.rounding.rms <= 0.2 * found.golden.rms, "{found:?}");
}

#[test]
fn a_length_that_the_device_has_not_is_refused() {
    for averaging in [0, 3, 8192] {
        assert!(
            measure(&case(averaging))
                .unwrap_err()
                .contains("powers of two")
        );
    }
}

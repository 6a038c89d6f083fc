//! The third tilt axis at the analog comparator: AIN0 (PD6) its channel, AIN1 (PD7) mid supply.

use avr_device::atmega328p::Peripherals;

/// The sign of gravity along body z now, as the solver takes it: 1 upright, -1 upside down (the channel
/// above mid supply); 0 where it is not `fitted`, and then nothing touches it. (It is on since reset.)
pub fn sign(fitted: bool) -> i8 {
    if !fitted {
        return 0;
    }
    // SAFETY: only the main loop touches the comparator.
    let comparator = unsafe { Peripherals::steal() }.AC;
    if comparator.acsr().read().aco().bit_is_set() { -1 } else { 1 }
}

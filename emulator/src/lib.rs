//! Cycle-accurate emulator of an 8-bit AVR microcontroller (ATmega328P).

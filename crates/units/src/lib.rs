//! Volts, ADC codes, MCU cycles and angles as types that carry their scale.

//! The breadboard: wires scenario, sensors, front end, emulator, firmware and golden model.

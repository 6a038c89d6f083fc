//! Waveform generation modes and clock selections of the timers, as tables.
//!
//! Source: data sheet tables 15-8 (Timer0), 16-4 (Timer1), 18-8 (Timer2) and the clock select
//! tables 15-9, 16-5, 18-9.

/// How the counter moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Shape {
    Normal,
    Ctc,
    Fast,
    /// Phase correct: compare registers update at TOP.
    Phase,
    /// Phase and frequency correct: compare registers update at BOTTOM.
    PhaseFrequency,
}

/// The highest value of the counting sequence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Top {
    Fixed(u16),
    OcrA,
    Icr,
}

/// One waveform generation mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Mode {
    pub(crate) shape: Shape,
    pub(crate) top: Top,
    /// COMnA = 1 toggles OCnA in this PWM mode instead of disconnecting it.
    pub(crate) toggle_a: bool,
}

impl Mode {
    pub(crate) fn is_pwm(self) -> bool {
        !matches!(self.shape, Shape::Normal | Shape::Ctc)
    }

    pub(crate) fn is_phase(self) -> bool {
        matches!(self.shape, Shape::Phase | Shape::PhaseFrequency)
    }
}

const fn mode(shape: Shape, top: Top, toggle_a: bool) -> Option<Mode> {
    Some(Mode {
        shape,
        top,
        toggle_a,
    })
}

/// Modes of the 8-bit timers by WGM2:0; `None` is reserved.
pub(crate) const MODES_8: [Option<Mode>; 8] = [
    mode(Shape::Normal, Top::Fixed(0xFF), false),
    mode(Shape::Phase, Top::Fixed(0xFF), false),
    mode(Shape::Ctc, Top::OcrA, false),
    mode(Shape::Fast, Top::Fixed(0xFF), false),
    None,
    mode(Shape::Phase, Top::OcrA, true),
    None,
    mode(Shape::Fast, Top::OcrA, true),
];

/// Modes of the 16-bit timer by WGM3:0; `None` is reserved.
pub(crate) const MODES_16: [Option<Mode>; 16] = [
    mode(Shape::Normal, Top::Fixed(0xFFFF), false),
    mode(Shape::Phase, Top::Fixed(0xFF), false),
    mode(Shape::Phase, Top::Fixed(0x1FF), false),
    mode(Shape::Phase, Top::Fixed(0x3FF), false),
    mode(Shape::Ctc, Top::OcrA, false),
    mode(Shape::Fast, Top::Fixed(0xFF), false),
    mode(Shape::Fast, Top::Fixed(0x1FF), false),
    mode(Shape::Fast, Top::Fixed(0x3FF), false),
    mode(Shape::PhaseFrequency, Top::Icr, false),
    mode(Shape::PhaseFrequency, Top::OcrA, true),
    mode(Shape::Phase, Top::Icr, false),
    mode(Shape::Phase, Top::OcrA, true),
    mode(Shape::Ctc, Top::Icr, false),
    None,
    mode(Shape::Fast, Top::Icr, true),
    mode(Shape::Fast, Top::OcrA, true),
];

/// Clock of a timer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Clock {
    Stopped,
    /// The I/O clock divided by `2^shift`.
    Divided(u8),
    /// Edges of the external clock pin; true: rising.
    External(bool),
}

/// Clock select CS2:0 of Timer0 and Timer1.
pub(crate) const CLOCKS_SYNC: [Clock; 8] = [
    Clock::Stopped,
    Clock::Divided(0),
    Clock::Divided(3),
    Clock::Divided(6),
    Clock::Divided(8),
    Clock::Divided(10),
    Clock::External(false),
    Clock::External(true),
];

/// Clock select CS2:0 of Timer2.
pub(crate) const CLOCKS_T2: [Clock; 8] = [
    Clock::Stopped,
    Clock::Divided(0),
    Clock::Divided(3),
    Clock::Divided(5),
    Clock::Divided(6),
    Clock::Divided(7),
    Clock::Divided(8),
    Clock::Divided(10),
];

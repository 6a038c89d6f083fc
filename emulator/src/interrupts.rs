//! Interrupt requests, priorities and latency statistics (data sheet sections 7.7 and 12).

/// Vector numbers of the ATmega48/88/168/328 family.
pub(crate) mod vector {
    pub(crate) const INT0: usize = 1;
    pub(crate) const INT1: usize = 2;
    pub(crate) const PCINT0: usize = 3;
    pub(crate) const PCINT2: usize = 5;
    pub(crate) const WDT: usize = 6;
    pub(crate) const TIMER2_COMPA: usize = 7;
    pub(crate) const TIMER2_COMPB: usize = 8;
    pub(crate) const TIMER2_OVF: usize = 9;
    pub(crate) const TIMER1_CAPT: usize = 10;
    pub(crate) const TIMER1_COMPA: usize = 11;
    pub(crate) const TIMER1_COMPB: usize = 12;
    pub(crate) const TIMER1_OVF: usize = 13;
    pub(crate) const TIMER0_COMPA: usize = 14;
    pub(crate) const TIMER0_COMPB: usize = 15;
    pub(crate) const TIMER0_OVF: usize = 16;
    pub(crate) const SPI_STC: usize = 17;
    pub(crate) const USART_RX: usize = 18;
    pub(crate) const USART_UDRE: usize = 19;
    pub(crate) const USART_TX: usize = 20;
    pub(crate) const ADC: usize = 21;
    pub(crate) const EE_READY: usize = 22;
    pub(crate) const ANALOG_COMP: usize = 23;
    pub(crate) const TWI: usize = 24;
    pub(crate) const SPM_READY: usize = 25;
    pub(crate) const COUNT: usize = 26;
}

/// Statistics of one vector.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct VectorStatistics {
    /// Times taken.
    pub count: u64,
    /// Worst latency: cycles from flag and enable being set to the first cycle of the entry.
    pub latency_max: u64,
    /// Returns by RETI to what was interrupted: registers and SREG were compared with those at the
    /// entry. Fewer than `count` where handlers leave in another way, or have not yet returned.
    pub returns: u64,
    /// Returns among them with other registers or another SREG; see
    /// [`crate::Machine::interrupt_damage`].
    pub damaged: u64,
}

/// Requests of all vectors: bit n is vector n.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Interrupts {
    pending: u32,
    since: [u64; vector::COUNT],
    pub(crate) statistics: [VectorStatistics; vector::COUNT],
}

impl Interrupts {
    pub(crate) fn new() -> Interrupts {
        Interrupts {
            pending: 0,
            since: [0; vector::COUNT],
            statistics: [VectorStatistics::default(); vector::COUNT],
        }
    }

    /// Withdraws all requests (reset).
    pub(crate) fn clear(&mut self) {
        self.pending = 0;
    }

    /// Sets or withdraws the request of `vector` at cycle `at`.
    #[inline]
    pub(crate) fn request(&mut self, vector: usize, requested: bool, at: u64) {
        let bit = 1 << vector;
        if !requested {
            self.pending &= !bit;
        } else if self.pending & bit == 0 {
            self.pending |= bit;
            self.since[vector] = at;
        }
    }

    #[inline]
    pub(crate) fn any(&self) -> bool {
        self.pending != 0
    }

    #[inline]
    pub(crate) fn pending(&self) -> u32 {
        self.pending
    }

    /// The vector of highest priority that is requested.
    pub(crate) fn highest(&self) -> Option<usize> {
        (self.pending != 0).then(|| self.pending.trailing_zeros() as usize)
    }

    /// Notes that the entry to `vector` begins at cycle `at`; returns the latency.
    pub(crate) fn enter(&mut self, vector: usize, at: u64) -> u64 {
        let latency = at.saturating_sub(self.since[vector]);
        let statistics = &mut self.statistics[vector];
        statistics.count += 1;
        statistics.latency_max = statistics.latency_max.max(latency);
        // A level request that stays is a new one from here on.
        self.since[vector] = at;
        latency
    }
}

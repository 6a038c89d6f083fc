//! SPI master (data sheet section 18). Slave mode is not modelled and refused.

const SPIE: u8 = 0x80;
const SPE: u8 = 0x40;
const DORD: u8 = 0x20;
const MSTR: u8 = 0x10;
const CPOL: u8 = 0x08;
const CPHA: u8 = 0x04;
const SPIF: u8 = 0x80;
const WCOL: u8 = 0x40;
const SPI2X: u8 = 0x01;
/// Clock edges of a byte.
const EDGES: u8 = 16;

/// A byte under way.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Transfer {
    out: u8,
    input: u8,
    /// Clock edges done.
    edges: u8,
    next: u64,
    half_period: u64,
}

/// SPI registers and shift register.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Spi {
    control: u8,
    double: u8,
    flag: bool,
    collision: bool,
    /// SPSR was read with the flag set: the next access to SPDR clears it.
    status_read: bool,
    received: u8,
    transfer: Option<Transfer>,
    data_level: bool,
}

impl Spi {
    pub(crate) fn is_master(&self) -> bool {
        self.control & (SPE | MSTR) == SPE | MSTR
    }

    pub(crate) fn is_slave(&self) -> bool {
        self.control & (SPE | MSTR) == SPE
    }

    pub(crate) fn is_busy(&self) -> bool {
        self.transfer.is_some()
    }

    pub(crate) fn requests(&self) -> bool {
        self.flag && self.control & SPIE != 0
    }

    pub(crate) fn clear_flag(&mut self) {
        self.flag = false;
    }

    pub(crate) fn next_event(&self) -> Option<u64> {
        self.transfer.map(|transfer| transfer.next)
    }

    /// Levels of SCK and MOSI.
    pub(crate) fn outputs(&self) -> (bool, bool) {
        let edges = self.transfer.map_or(0, |transfer| transfer.edges);
        let idle = self.control & CPOL != 0;
        (idle != (edges % 2 == 1), self.data_level)
    }

    /// Bits in the order of the wire: the first one in the most significant place.
    fn wire_order(&self, byte: u8) -> u8 {
        if self.control & DORD != 0 {
            byte.reverse_bits()
        } else {
            byte
        }
    }

    /// SPI clock period in cycles.
    fn period(&self) -> u64 {
        let divisor = [4, 16, 64, 128][usize::from(self.control & 3)];
        if self.double & SPI2X != 0 {
            divisor / 2
        } else {
            divisor
        }
    }

    /// One clock edge. Returns whether the byte is complete.
    pub(crate) fn step(&mut self) -> bool {
        let Some(mut transfer) = self.transfer else {
            return false;
        };
        transfer.edges += 1;
        transfer.next += transfer.half_period;
        if transfer.edges == EDGES {
            self.received = transfer.input;
            self.flag = true;
            self.status_read = false;
            self.transfer = None;
            return true;
        }
        // With CPHA = 0 the data changes on trailing edges, else on leading ones.
        let is_trailing = transfer.edges % 2 == 0;
        if is_trailing != (self.control & CPHA != 0) {
            let bit = 7 - transfer.edges / 2;
            self.data_level = self.wire_order(transfer.out) >> bit & 1 != 0;
        }
        self.transfer = Some(transfer);
        false
    }

    pub(crate) fn read_control(&self) -> u8 {
        self.control
    }

    /// SPCR. A mode fault (SS driven low from outside) clears MSTR and sets the flag.
    pub(crate) fn write_control(&mut self, value: u8, is_selected: bool) {
        self.control = value;
        if value & SPE == 0 {
            self.transfer = None;
        }
        self.check_mode_fault(is_selected);
    }

    pub(crate) fn check_mode_fault(&mut self, is_selected: bool) {
        if self.is_master() && is_selected {
            self.control &= !MSTR;
            self.flag = true;
        }
    }

    pub(crate) fn read_status(&mut self) -> u8 {
        self.status_read = true;
        let flag = if self.flag { SPIF } else { 0 };
        let collision = if self.collision { WCOL } else { 0 };
        flag | collision | self.double
    }

    pub(crate) fn write_status(&mut self, value: u8) {
        self.double = value & SPI2X;
    }

    fn touch_data(&mut self) {
        if std::mem::take(&mut self.status_read) {
            self.flag = false;
            self.collision = false;
        }
    }

    pub(crate) fn read_data(&mut self) -> u8 {
        self.touch_data();
        self.received
    }

    /// SPDR with effect at cycle `at`; `exchange` gives the byte on MISO for the one on MOSI.
    pub(crate) fn write_data(&mut self, value: u8, at: u64, exchange: impl FnOnce(u8) -> u8) {
        self.touch_data();
        if self.transfer.is_some() {
            self.collision = true;
            return;
        }
        if !self.is_master() {
            return;
        }
        let half_period = self.period() / 2;
        let input = exchange(value);
        if self.control & CPHA == 0 {
            self.data_level = self.wire_order(value) & 0x80 != 0;
        }
        self.transfer = Some(Transfer {
            out: value,
            input,
            edges: 0,
            next: at + half_period,
            half_period,
        });
    }

    /// The clock stood still for `cycles`.
    pub(crate) fn shift(&mut self, cycles: u64) {
        if let Some(transfer) = &mut self.transfer {
            transfer.next += cycles;
        }
    }
}

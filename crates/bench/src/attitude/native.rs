//! The firmware on the host: the deployed arithmetic, and any other over the same algorithm.

use std::cell::RefCell;
use std::rc::Rc;

use cardan_datapath::{Arithmetic, Deployed, Tap};
use cardan_firmware::averaging::Decimator;
use cardan_firmware::calibration::Settings;
use cardan_firmware::device::Solver;
use cardan_firmware::nodes::NODE_COUNT;
use cardan_units::AdcCode;

use super::sign;
use crate::engine::{Conversion, Engine, EngineError, Sink, Summary};

/// Collects writes until the engine passes them on.
#[derive(Clone, Debug, Default)]
struct Buffer {
    writes: Rc<RefCell<Vec<(usize, i64)>>>,
    overflows: Rc<RefCell<Vec<u64>>>,
}

impl Tap for Buffer {
    fn write(&self, index: usize, raw: i64) {
        self.writes.borrow_mut().push((index, raw));
    }

    fn overflow(&self, index: usize) {
        if let Some(count) = self.overflows.borrow_mut().get_mut(index) {
            *count += 1;
        }
    }
}

/// The firmware crate itself, in its deployed formats.
pub(super) struct NativeEngine {
    buffer: Buffer,
    m: Deployed<Buffer>,
    decimator: Decimator<Deployed<Buffer>>,
    solver: Solver<Buffer>,
}

impl NativeEngine {
    pub(super) fn new(settings: &Settings) -> Self {
        let buffer = Buffer::default();
        buffer.overflows.borrow_mut().resize(NODE_COUNT, 0);
        let m = Deployed::new(buffer.clone());
        let decimator = Decimator::new(&m, settings.averaging);
        let settings = Settings::from_image(&settings.image());
        let solver = Solver::new(buffer.clone(), &settings);
        Self {
            buffer,
            m,
            decimator,
            solver,
        }
    }

    fn pass_on(&self, cycle: u64, sink: &mut dyn Sink) -> Result<(), EngineError> {
        for (node, raw) in self.buffer.writes.borrow_mut().drain(..) {
            sink.word(node, raw, cycle)?;
        }
        Ok(())
    }
}

impl Engine for NativeEngine {
    fn conversion(
        &mut self,
        conversion: &Conversion,
        sink: &mut dyn Sink,
    ) -> Result<(), EngineError> {
        let averages = self.decimator.push(&self.m, AdcCode(conversion.code));
        let frame = averages.map(|averages| self.solver.solve(&averages, sign(conversion)));
        self.pass_on(conversion.cycle, sink)?;
        if let Some(frame) = frame {
            sink.frame(conversion.cycle, &frame.encode())?;
            // The averager's arithmetic keeps no status of its own: only the solver's is sent.
            let _ = self.m.take_status();
        }
        Ok(())
    }

    fn summary(&self) -> Summary {
        Summary {
            overflows: self.buffer.overflows.borrow().clone(),
            ..Summary::default()
        }
    }
}

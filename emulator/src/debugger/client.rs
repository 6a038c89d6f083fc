//! What the client may ask of the chip: the requests of the protocol, as `gdbstub` has them.

use std::convert::Infallible;

use gdbstub::common::{Pid, Signal};
use gdbstub::target::ext::base::BaseOps;
use gdbstub::target::ext::base::single_register_access::{
    SingleRegisterAccess, SingleRegisterAccessOps,
};
use gdbstub::target::ext::base::singlethread::{
    SingleThreadBase, SingleThreadRangeStepping, SingleThreadRangeSteppingOps, SingleThreadResume,
    SingleThreadResumeOps, SingleThreadSingleStep, SingleThreadSingleStepOps,
};
use gdbstub::target::ext::breakpoints::{
    Breakpoints, BreakpointsOps, HwBreakpoint, HwBreakpointOps, HwWatchpoint, HwWatchpointOps,
    SwBreakpoint, SwBreakpointOps, WatchKind,
};
use gdbstub::target::ext::extended_mode::{
    Args, AttachKind, ExtendedMode, ExtendedModeOps, ShouldTerminate,
};
use gdbstub::target::ext::monitor_cmd::{ConsoleOutput, MonitorCmd, MonitorCmdOps};
use gdbstub::target::{Target, TargetError, TargetResult};

use super::architecture::{Avr, AvrRegisters, Register};
use super::chip::{Chip, Plan};
use super::memory::{DATA, NoMemory};
use crate::environment::Environment;
use crate::traps::{Access, Watch};

/// EFAULT: what a debugger shows as "cannot access memory".
const BAD_ADDRESS: u8 = 14;
/// EINVAL.
const INVALID: u8 = 22;

impl From<NoMemory> for TargetError<Infallible> {
    fn from(_: NoMemory) -> Self {
        TargetError::Errno(BAD_ADDRESS)
    }
}

impl<E: Environment> Target for Chip<E> {
    type Arch = Avr;
    type Error = Infallible;

    fn base_ops(&mut self) -> BaseOps<'_, Avr, Infallible> {
        BaseOps::SingleThread(self)
    }

    /// Simple clients do not know run-length encoding, and packets are short.
    fn use_rle(&self) -> bool {
        false
    }

    fn support_breakpoints(&mut self) -> Option<BreakpointsOps<'_, Self>> {
        Some(self)
    }

    fn support_monitor_cmd(&mut self) -> Option<MonitorCmdOps<'_, Self>> {
        Some(self)
    }

    fn support_extended_mode(&mut self) -> Option<ExtendedModeOps<'_, Self>> {
        Some(self)
    }
}

impl<E: Environment> SingleThreadBase for Chip<E> {
    fn read_registers(&mut self, registers: &mut AvrRegisters) -> TargetResult<(), Self> {
        registers.general.copy_from_slice(self.machine.registers());
        registers.sreg = self.machine.sreg();
        registers.sp = self.machine.sp();
        registers.pc = self.machine.pc();
        Ok(())
    }

    fn write_registers(&mut self, registers: &AvrRegisters) -> TargetResult<(), Self> {
        self.machine.data_mut()[..32].copy_from_slice(&registers.general);
        self.machine.set_sreg(registers.sreg);
        self.machine.set_sp(registers.sp);
        self.move_to(registers.pc);
        Ok(())
    }

    fn support_single_register_access(&mut self) -> Option<SingleRegisterAccessOps<'_, (), Self>> {
        Some(self)
    }

    fn read_addrs(&mut self, start: u32, data: &mut [u8]) -> TargetResult<usize, Self> {
        Ok(self.read_memory(start, data)?)
    }

    fn write_addrs(&mut self, start: u32, data: &[u8]) -> TargetResult<(), Self> {
        Ok(self.write_memory(start, data)?)
    }

    fn support_resume(&mut self) -> Option<SingleThreadResumeOps<'_, Self>> {
        Some(self)
    }
}

impl<E: Environment> Chip<E> {
    fn move_to(&mut self, pc: u32) {
        if pc != self.machine.pc() {
            self.machine.set_pc(pc);
            self.moved();
        }
    }
}

impl<E: Environment> SingleRegisterAccess<()> for Chip<E> {
    fn read_register(
        &mut self,
        (): (),
        register: Register,
        buffer: &mut [u8],
    ) -> TargetResult<usize, Self> {
        let (sp, pc) = (
            self.machine.sp().to_le_bytes(),
            self.machine.pc().to_le_bytes(),
        );
        let value: &[u8] = match register {
            Register::General(number) => &[self.machine.registers()[usize::from(number)]],
            Register::Sreg => &[self.machine.sreg()],
            Register::Sp => &sp,
            Register::Pc => &pc,
        };
        let buffer = buffer.get_mut(..value.len()).ok_or(TargetError::NonFatal)?;
        buffer.copy_from_slice(value);
        Ok(value.len())
    }

    fn write_register(
        &mut self,
        (): (),
        register: Register,
        value: &[u8],
    ) -> TargetResult<(), Self> {
        match (register, value) {
            (Register::General(number), &[value]) => {
                self.machine.data_mut()[usize::from(number)] = value;
            }
            (Register::Sreg, &[value]) => self.machine.set_sreg(value),
            (Register::Sp, &[low, high]) => self.machine.set_sp(u16::from_le_bytes([low, high])),
            (Register::Pc, &[a, b, c, d]) => self.move_to(u32::from_le_bytes([a, b, c, d])),
            _ => return Err(TargetError::Errno(INVALID)),
        }
        Ok(())
    }
}

impl<E: Environment> SingleThreadResume for Chip<E> {
    /// Signals mean nothing to the chip.
    fn resume(&mut self, _signal: Option<Signal>) -> Result<(), Infallible> {
        Chip::resume(self, Plan::Continue);
        Ok(())
    }

    fn support_single_step(&mut self) -> Option<SingleThreadSingleStepOps<'_, Self>> {
        Some(self)
    }

    fn support_range_step(&mut self) -> Option<SingleThreadRangeSteppingOps<'_, Self>> {
        Some(self)
    }
}

impl<E: Environment> SingleThreadSingleStep for Chip<E> {
    fn step(&mut self, _signal: Option<Signal>) -> Result<(), Infallible> {
        Chip::resume(self, Plan::Step);
        Ok(())
    }
}

impl<E: Environment> SingleThreadRangeStepping for Chip<E> {
    fn resume_range_step(&mut self, start: u32, end: u32) -> Result<(), Infallible> {
        Chip::resume(self, Plan::Leave(start..end));
        Ok(())
    }
}

impl<E: Environment> Breakpoints for Chip<E> {
    fn support_sw_breakpoint(&mut self) -> Option<SwBreakpointOps<'_, Self>> {
        Some(self)
    }

    fn support_hw_breakpoint(&mut self) -> Option<HwBreakpointOps<'_, Self>> {
        Some(self)
    }

    fn support_hw_watchpoint(&mut self) -> Option<HwWatchpointOps<'_, Self>> {
        Some(self)
    }
}

impl<E: Environment> Chip<E> {
    /// Both kinds are the same here: no word of flash changes.
    fn breakpoint(&mut self, address: u32, is_set: bool) -> bool {
        let is_there = ((address / 2) as usize) < self.machine.flash().len();
        if is_there {
            self.machine
                .core
                .set_breakpoint((address / 2) as u16, is_set);
        }
        is_there
    }
}

impl<E: Environment> SwBreakpoint for Chip<E> {
    fn add_sw_breakpoint(&mut self, address: u32, _kind: usize) -> TargetResult<bool, Self> {
        Ok(self.breakpoint(address, true))
    }

    fn remove_sw_breakpoint(&mut self, address: u32, _kind: usize) -> TargetResult<bool, Self> {
        Ok(self.breakpoint(address, false))
    }
}

impl<E: Environment> HwBreakpoint for Chip<E> {
    fn add_hw_breakpoint(&mut self, address: u32, _kind: usize) -> TargetResult<bool, Self> {
        Ok(self.breakpoint(address, true))
    }

    fn remove_hw_breakpoint(&mut self, address: u32, _kind: usize) -> TargetResult<bool, Self> {
        Ok(self.breakpoint(address, false))
    }
}

impl<E: Environment> HwWatchpoint for Chip<E> {
    fn add_hw_watchpoint(
        &mut self,
        address: u32,
        bytes: u32,
        kind: WatchKind,
    ) -> TargetResult<bool, Self> {
        let watch = watch(address, bytes, kind);
        Ok(watch.is_some_and(|watch| self.machine.add_watch(watch)))
    }

    fn remove_hw_watchpoint(
        &mut self,
        address: u32,
        bytes: u32,
        kind: WatchKind,
    ) -> TargetResult<bool, Self> {
        let watch = watch(address, bytes, kind);
        Ok(watch.is_some_and(|watch| self.machine.remove_watch(&watch)))
    }
}

/// A watchpoint on the data space; other memories do not change by themselves.
fn watch(address: u32, bytes: u32, kind: WatchKind) -> Option<Watch> {
    let start = address.checked_sub(DATA.start)?;
    let end = start.checked_add(bytes)?;
    Some(Watch {
        addresses: u16::try_from(start).ok()?..u16::try_from(end).ok()?,
        access: match kind {
            WatchKind::Write => Access::Write,
            WatchKind::Read => Access::Read,
            WatchKind::ReadWrite => Access::Any,
        },
    })
}

impl<E: Environment> MonitorCmd for Chip<E> {
    fn handle_monitor_cmd(
        &mut self,
        command: &[u8],
        mut out: ConsoleOutput<'_>,
    ) -> Result<(), Infallible> {
        let answer = self.monitor(&String::from_utf8_lossy(command));
        out.write_raw(answer.as_bytes());
        Ok(())
    }
}

/// The run was started for the debugger and ends with it, unless it detaches. `run` in GDB resets
/// the chip.
impl<E: Environment> ExtendedMode for Chip<E> {
    fn run(&mut self, _file: Option<&[u8]>, _arguments: Args<'_, '_>) -> TargetResult<Pid, Self> {
        self.reset();
        Ok(Pid::MIN)
    }

    fn attach(&mut self, _pid: Pid) -> TargetResult<(), Self> {
        Err(TargetError::NonFatal)
    }

    fn query_if_attached(&mut self, _pid: Pid) -> TargetResult<AttachKind, Self> {
        Ok(AttachKind::Run)
    }

    fn kill(&mut self, _pid: Option<Pid>) -> TargetResult<ShouldTerminate, Self> {
        Ok(ShouldTerminate::Yes)
    }

    fn restart(&mut self) -> Result<(), Infallible> {
        self.reset();
        Ok(())
    }
}

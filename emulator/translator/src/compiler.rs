//! The compiler: regions to host code, with Cranelift.

use cardan_emulator::engine::Core;
use cranelift_codegen::Context;
use cranelift_codegen::control::ControlPlane;
use cranelift_codegen::ir::{AbiParam, Function, Signature, UserFuncName, types};
use cranelift_codegen::isa::OwnedTargetIsa;
use cranelift_codegen::settings::{self, Configurable};
use cranelift_frontend::{FunctionBuilder, FunctionBuilderContext};

use crate::code::HostCode;
use crate::lower::lower;
use crate::region::Region;

/// Cranelift, set up for this host.
pub(crate) struct Compiler {
    isa: OwnedTargetIsa,
    context: Context,
    builder: FunctionBuilderContext,
}

impl Compiler {
    /// Nothing on hosts for which Cranelift has no code generator.
    pub(crate) fn new() -> Option<Compiler> {
        let mut flags = settings::builder();
        for (name, value) in [
            ("opt_level", "speed"),
            ("enable_probestack", "false"),
            ("unwind_info", "false"),
            (
                "enable_verifier",
                if cfg!(debug_assertions) {
                    "true"
                } else {
                    "false"
                },
            ),
        ] {
            flags.set(name, value).ok()?;
        }
        let isa = cranelift_native::builder().ok()?;
        let isa = isa.finish(settings::Flags::new(flags)).ok()?;
        Some(Compiler {
            isa,
            context: Context::new(),
            builder: FunctionBuilderContext::new(),
        })
    }

    /// Host code of a region; nothing if Cranelift or the host refuse it (the region is then
    /// interpreted).
    pub(crate) fn compile(&mut self, region: &Region, core: &Core) -> Option<HostCode> {
        let mut signature = Signature::new(self.isa.default_call_conv());
        let pointer = AbiParam::new(self.isa.pointer_type());
        signature.params.extend([pointer; 3]);
        signature.params.push(AbiParam::new(types::I32));
        signature.returns.push(AbiParam::new(types::I32));
        self.context.clear();
        self.context.func = Function::with_name_signature(UserFuncName::default(), signature);
        let mut builder = FunctionBuilder::new(&mut self.context.func, &mut self.builder);
        lower(region, core, &mut builder);
        builder.finalize(self.isa.frontend_config());
        let compiled = self
            .context
            .compile(&*self.isa, &mut ControlPlane::default())
            .ok()?;
        // The code calls nothing and refers to nothing outside itself.
        if !compiled.buffer.relocs().is_empty() {
            return None;
        }
        HostCode::new(compiled.code_buffer()).ok()
    }
}

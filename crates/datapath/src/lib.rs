//! Node, Arithmetic and the deployed arithmetic: what users write their own algorithms against.
//!
//! An algorithm is written once, generic over an [`Arithmetic`]. Each intermediate value is a
//! [`Value`] that belongs to a named [`Node`]; the node's type carries name, unit and deployed
//! [`Format`]. Which numbers flow is the arithmetic's business: [`Deployed`] computes with the
//! nodes' `fixed` types (the firmware itself, same bits on every target); the crate `numerics`
//! holds the others.
//!
//! ```
//! use cardan_datapath::{Arithmetic, Deployed, Format, Node, Overflow, Rounding, Silent, Value};
//! use fixed::types::extra::U14;
//!
//! #[derive(Clone, Copy)]
//! struct Input;
//! impl Node for Input {
//!     const INDEX: usize = 0;
//!     const NAME: &'static str = "input";
//!     const UNIT: &'static str = "g";
//!     const FORMAT: Format = Format::new(16, 14, Rounding::Floor, Overflow::Saturate);
//!     type Word = fixed::FixedI16<U14>;
//! }
//! #[derive(Clone, Copy)]
//! struct Square;
//! impl Node for Square {
//!     const INDEX: usize = 1;
//!     const NAME: &'static str = "square";
//!     const UNIT: &'static str = "g2";
//!     const FORMAT: Format = Format::new(16, 12, Rounding::NearestUp, Overflow::Saturate);
//!     type Word = fixed::FixedI16<fixed::types::extra::U12>;
//! }
//!
//! fn square<M: Arithmetic>(m: &M, x: Value<M, Input>) -> Value<M, Square> {
//!     m.mul(x, x)
//! }
//!
//! let m = Deployed::new(Silent);
//! let x = m.input::<Input, 14>(3 << 13); // 1.5
//! assert_eq!(square(&m, x).word(), 2.25);
//! ```
#![no_std]
#![cfg_attr(target_arch = "avr", feature(asm_experimental_arch))]
#[cfg(feature = "codegen")]
extern crate std;

mod arithmetic;
#[cfg(doctest)]
mod build_errors;
#[cfg(feature = "codegen")]
pub mod codegen;
mod container;
mod deployed;
mod format;
#[doc(hidden)]
pub mod kernel;
mod quantised;
pub mod rounding;
mod tap;
#[cfg(feature = "codegen")]
pub mod wordlengths;

pub use arithmetic::{Arithmetic, Constant, Node, Table, Value};
pub use container::Container;
pub use deployed::{DEFAULT_DOMAIN_FLAG, Deployed};
pub use fixed;
pub use format::{
    Format, NodeInfo, Overflow, Rounding, format_table, format_table_len, table_hash,
};
pub use tap::{Silent, Tap};

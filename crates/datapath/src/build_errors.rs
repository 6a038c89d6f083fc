//! What the deployed arithmetic refuses to build, as documentation tests. Each is the accepted
//! program below with other formats.
//!
//! ```
//! use cardan_datapath::{Arithmetic, Deployed, Format, Node, Overflow, Rounding, Silent, Value};
//! use cardan_datapath::fixed::{FixedI64, types::extra::{U20, U40}};
//! # #[derive(Clone, Copy)]
//! struct A;
//! impl Node for A {
//!     const INDEX: usize = 0;
//!     const NAME: &'static str = "a";
//!     const UNIT: &'static str = "1";
//!     const FORMAT: Format = Format::new(32, 20, Rounding::Floor, Overflow::Wrap);
//!     type Word = FixedI64<U20>;
//! }
//! let m = Deployed::new(Silent);
//! let a = m.input::<A, 20>(1);
//! let product: Value<_, A> = m.mul(a, a);
//! let negative: Value<_, A> = m.neg(a);
//! ```
//!
//! A product beyond 64 bits:
//!
//! ```compile_fail
//! use cardan_datapath::{Arithmetic, Deployed, Format, Node, Overflow, Rounding, Silent, Value};
//! use cardan_datapath::fixed::{FixedI64, types::extra::{U20, U40}};
//! # #[derive(Clone, Copy)]
//! struct A;
//! impl Node for A {
//!     const INDEX: usize = 0;
//!     const NAME: &'static str = "a";
//!     const UNIT: &'static str = "1";
//!     const FORMAT: Format = Format::new(33, 20, Rounding::Floor, Overflow::Wrap);
//!     type Word = FixedI64<U20>;
//! }
//! let m = Deployed::new(Silent);
//! let a = m.input::<A, 20>(1);
//! let product: Value<_, A> = m.mul(a, a);
//! ```
//!
//! A negation beyond 64 bits once it has the fractional bits of its node:
//!
//! ```compile_fail
//! use cardan_datapath::{Arithmetic, Deployed, Format, Node, Overflow, Rounding, Silent, Value};
//! use cardan_datapath::fixed::{FixedI64, types::extra::{U20, U40}};
//! # #[derive(Clone, Copy)]
//! struct A;
//! impl Node for A {
//!     const INDEX: usize = 0;
//!     const NAME: &'static str = "a";
//!     const UNIT: &'static str = "1";
//!     const FORMAT: Format = Format::new(60, 20, Rounding::Floor, Overflow::Wrap);
//!     type Word = FixedI64<U20>;
//! }
//! # #[derive(Clone, Copy)]
//! struct B;
//! impl Node for B {
//!     const INDEX: usize = 1;
//!     const NAME: &'static str = "b";
//!     const UNIT: &'static str = "1";
//!     const FORMAT: Format = Format::new(60, 40, Rounding::Floor, Overflow::Wrap);
//!     type Word = FixedI64<U40>;
//! }
//! let m = Deployed::new(Silent);
//! let a = m.input::<A, 20>(1);
//! let negative: Value<_, B> = m.neg(a);
//! ```
//!
//! A `fixed` type whose resolution is not the format's:
//!
//! ```compile_fail
//! use cardan_datapath::{Arithmetic, Deployed, Format, Node, Overflow, Rounding, Silent, Value};
//! use cardan_datapath::fixed::{FixedI64, types::extra::{U20, U40}};
//! # #[derive(Clone, Copy)]
//! struct A;
//! impl Node for A {
//!     const INDEX: usize = 0;
//!     const NAME: &'static str = "a";
//!     const UNIT: &'static str = "1";
//!     const FORMAT: Format = Format::new(32, 20, Rounding::Floor, Overflow::Wrap);
//!     type Word = FixedI64<U40>;
//! }
//! let m = Deployed::new(Silent);
//! let a = m.input::<A, 20>(1);
//! ```

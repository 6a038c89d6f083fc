//! The other arithmetics over the same algorithm: run-time formats, real, and any mixture.
//!
//! [`Mixed`] gives every node a run-time format or none. With the deployed formats it equals
//! [`cardan_datapath::Deployed`] bit for bit; with none it is the real interpretation; with the
//! first k nodes quantised it tells what share of the rounding error each node brings.
//!
//! A [`Datapath`] is recorded once as a [`tape::Tape`]; [`trial::Trial`] then tries
//! formats on it without recompiling, at the speed of compiled code.
//!
//! An algorithm that is to run over several arithmetics implements [`Algorithm`]:
//!
//! ```
//! use cardan_datapath::{Arithmetic, Format, Node, NodeInfo, Overflow, Rounding};
//! use cardan_numerics::{Algorithm, Formats, record};
//!
//! #[derive(Clone, Copy)]
//! struct Third;
//! impl Node for Third {
//!     const INDEX: usize = 0;
//!     const NAME: &'static str = "third";
//!     const UNIT: &'static str = "1";
//!     const FORMAT: Format = Format::new(8, 4, Rounding::NearestUp, Overflow::Saturate);
//!     type Word = cardan_datapath::fixed::FixedI8<cardan_datapath::fixed::types::extra::U4>;
//! }
//!
//! struct Divide;
//! impl Algorithm for Divide {
//!     type Output = u16;
//!     fn run<M: Arithmetic>(&self, m: &M) -> u16 {
//!         let one = m.input::<Third, 0>(1);
//!         let three = m.input::<Third, 0>(3);
//!         m.div::<Third, _, _>(one, three);
//!         m.take_status()
//!     }
//! }
//!
//! let nodes = [NodeInfo { name: "third", unit: "1", meaning: "", format: Third::FORMAT }];
//! let (_, deployed) = record(&Divide, &Formats::deployed(&nodes).unwrap());
//! let (status, real) = record(&Divide, &Formats::real(1));
//! assert_eq!(deployed.raws[0], [16, 48, 5]);
//! assert_eq!(real.values[0], [1.0, 3.0, 1.0 / 3.0]);
//! assert_eq!(status, 0);
//! ```

mod algorithm;
mod exact;
mod formats;
mod mixed;
mod recorder;
mod step;
pub mod tape;
pub mod trial;

pub use algorithm::{Algorithm, Steps, record};
pub use exact::Word;
pub use formats::{Formats, FormatsError};
pub use mixed::{Mixed, Number, Observer, Trap};
pub use recorder::{DeployedRecorder, Overflows, Recorder, Recording};
pub use step::Datapath;

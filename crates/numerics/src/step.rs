//! An algorithm as a sequence of equal steps: what tuning works on.

use cardan_datapath::Arithmetic;

/// An algorithm that does the same in every step (one per sample, or per solution).
///
/// A step branches only through [`Arithmetic::select`] and loops a fixed number of times. What one
/// step leaves to the next lies in `State`, as values and truths of the arithmetic; plain Rust
/// counters may stand there too as long as the steps become equal in the end (a ring buffer's index,
/// "this is the first step").
///
/// ```
/// use cardan_datapath::{Arithmetic, Constant, Node, Value};
/// use cardan_numerics::Datapath;
///
/// /// y += (x - y) / 4, for nodes of the user's own.
/// struct LowPass<X, Y, D>(std::marker::PhantomData<(X, Y, D)>);
/// struct Zero;
/// impl Constant for Zero {
///     const VALUE: f64 = 0.0;
/// }
/// impl<X: Node, Y: Node, D: Node> Datapath for LowPass<X, Y, D> {
///     type State<M: Arithmetic> = Value<M, Y>;
///     fn start<M: Arithmetic>(&self, m: &M) -> Value<M, Y> {
///         m.constant::<Y, Zero>()
///     }
///     fn step<M: Arithmetic>(&self, m: &M, y: &mut Value<M, Y>, inputs: &[i32]) {
///         let x: Value<M, X> = m.input::<X, 15>(inputs[0]);
///         let difference: Value<M, D> = m.sub(x, *y);
///         let quarter: Value<M, D> = m.shift::<D, D, -2>(difference);
///         *y = m.add(*y, quarter);
///     }
/// }
/// ```
pub trait Datapath {
    /// What a step leaves to the next.
    type State<M: Arithmetic>;

    /// Before the first step: settings, and the state to begin with.
    fn start<M: Arithmetic>(&self, m: &M) -> Self::State<M>;

    /// One step on its inputs from outside.
    fn step<M: Arithmetic>(&self, m: &M, state: &mut Self::State<M>, inputs: &[i32]);
}

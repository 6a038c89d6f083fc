//! What a recording is held to: long delay lines and late changes are recorded as what they are, and
//! what changes with an input or over and over again is refused.

mod common;

use cardan_datapath::{Arithmetic, Constant, DEFAULT_DOMAIN_FLAG, Format, Table, Value};
use cardan_numerics::tape::{Follower, Inputs, Op, Ref, Tape, TraceError};
use cardan_numerics::trial::Trial;
use cardan_numerics::{Algorithm, Datapath, Formats, Steps, record};
use common::{At, NODES, columns, deployed, infos};

struct Zero;
impl Constant for Zero {
    const VALUE: f64 = 0.0;
}
struct Half;
impl Constant for Half {
    const VALUE: f64 = 0.5;
}
struct Two;
impl Table for Two {
    const VALUES: &'static [f64] = &[0.25, 0.75];
}
struct Other;
impl Table for Other {
    const VALUES: &'static [f64] = &[0.25, 0.5];
}

/// y = x + y[delay steps ago] / 2, the delay line behind a pointer, or not.
struct Comb {
    delay: usize,
}

impl Datapath for Comb {
    type State<M: Arithmetic> = (Vec<Value<M, At<1>>>, usize);

    fn start<M: Arithmetic>(&self, m: &M) -> Self::State<M> {
        (vec![m.constant::<At<1>, Zero>(); self.delay], 0)
    }

    fn step<M: Arithmetic>(&self, m: &M, state: &mut Self::State<M>, inputs: &[i32]) {
        let x: Value<M, At<0>> = m.input::<At<0>, 8>(inputs[0]);
        let half: Value<M, At<2>> = m.mul(state.0[state.1], m.constant::<At<3>, Half>());
        let y: Value<M, At<1>> = m.add(x, half);
        state.0[state.1] = y;
        state.1 = (state.1 + 1) % self.delay;
    }
}

/// The oldest of the last 6000 inputs, which lie in the state itself.
struct Long;

impl Datapath for Long {
    type State<M: Arithmetic> = ([Value<M, At<0>>; 6000], usize);

    fn start<M: Arithmetic>(&self, m: &M) -> Self::State<M> {
        ([m.constant::<At<0>, Zero>(); 6000], 0)
    }

    fn step<M: Arithmetic>(&self, m: &M, state: &mut Self::State<M>, inputs: &[i32]) {
        let _: Value<M, At<1>> = m.shift::<At<1>, At<0>, 0>(state.0[state.1]);
        state.0[state.1] = m.input::<At<0>, 8>(inputs[0]);
        state.1 = (state.1 + 1) % 6000;
    }
}

/// Does one thing or another, by a plain number: the step's, or its input.
struct Change {
    what: What,
    /// True where the changed thing is done.
    when: fn(step: usize, input: i32) -> bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum What {
    Operand,
    Entry,
    Table,
    Parameter,
    Power,
    Flags,
    Frac,
    Node,
    Operation,
    Count,
    Truth,
    Delay,
    OperandNode,
}

const ALL: [What; 13] = [
    What::Operand,
    What::Entry,
    What::Table,
    What::Parameter,
    What::Power,
    What::Flags,
    What::Frac,
    What::Node,
    What::Operation,
    What::Count,
    What::Truth,
    What::Delay,
    What::OperandNode,
];

struct ChangeState<M: Arithmetic> {
    step: usize,
    last: [Value<M, At<0>>; 2],
    /// Two nodes that take turns at the first operation of a step.
    odd: Option<Value<M, At<9>>>,
    even: Option<Value<M, At<10>>>,
}

impl Datapath for Change {
    type State<M: Arithmetic> = ChangeState<M>;

    fn start<M: Arithmetic>(&self, m: &M) -> ChangeState<M> {
        ChangeState {
            step: 0,
            last: [m.constant::<At<0>, Zero>(); 2],
            odd: None,
            even: None,
        }
    }

    fn step<M: Arithmetic>(&self, m: &M, state: &mut ChangeState<M>, inputs: &[i32]) {
        let is_on = (self.when)(state.step, inputs[0]);
        let is = |what: What| self.what == what && is_on;
        if self.what == What::OperandNode {
            let seven = m.parameter::<At<3>, 4>(7);
            if let Some(odd) = state.odd.take() {
                let _: Value<M, At<5>> = m.neg(odd);
            } else if let Some(even) = state.even.take() {
                let _: Value<M, At<5>> = m.neg(even);
            } else {
                let _: Value<M, At<5>> = m.neg(seven);
            }
        }
        let x: Value<M, At<0>> = if is(What::Frac) {
            m.input::<At<0>, 9>(inputs[0])
        } else {
            m.input::<At<0>, 8>(inputs[0])
        };
        if self.what == What::OperandNode {
            if is_on {
                state.odd = Some(m.shift::<At<9>, At<0>, 0>(x));
            } else {
                state.even = Some(m.shift::<At<10>, At<0>, 0>(x));
            }
        }
        let [one, two] = [
            m.shift::<At<1>, At<0>, -1>(x),
            m.shift::<At<1>, At<0>, -2>(x),
        ];
        let operand = if is(What::Operand) { one } else { two };
        let entry: Value<M, At<3>> = m.entry::<At<3>, Two>(usize::from(is(What::Entry)));
        let looked: Value<M, At<4>> = if is(What::Table) {
            m.lookup::<At<4>, At<0>, Other>(x)
        } else {
            m.lookup::<At<4>, At<0>, Two>(x)
        };
        let setting: Value<M, At<3>> = m.parameter::<At<3>, 4>(7 + i32::from(is(What::Parameter)));
        let product: Value<M, At<5>> = m.mul(operand, entry);
        let scaled: Value<M, At<6>> =
            m.scale::<At<6>, At<5>, -4, 4>(product, -i32::from(is(What::Power)));
        let below = m.negative(scaled);
        m.raise(if is(What::Flags) { 2 } else { 1 }, below);
        if is(What::Node) {
            let _: Value<M, At<7>> = m.neg(looked);
        } else {
            let _: Value<M, At<8>> = m.neg(looked);
        }
        if is(What::Operation) {
            let _: Value<M, At<7>> = m.add(setting, scaled);
        } else {
            let _: Value<M, At<7>> = m.sub(setting, scaled);
        }
        if is(What::Count) {
            let _: Value<M, At<7>> = m.abs(scaled);
        }
        if self.what == What::Truth {
            let truth = if is_on { m.truth(true) } else { m.not(below) };
            m.raise(4, truth);
        }
        let held = state.last[usize::from(is(What::Delay))];
        let _: Value<M, At<15>> = m.add(held, looked);
        state.last = [x, state.last[0]];
        state.step += 1;
    }
}

fn noise(count: usize) -> Vec<Vec<i32>> {
    let mut state = 1_u32;
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        vec![(state >> 20) as i32 - 2048]
    };
    (0..count).map(|_| next()).collect()
}

/// Every word of a trial, start-up steps included, is that of the algorithm.
fn assert_words<A: Datapath>(algorithm: &A, steps: &[Vec<i32>]) -> Tape {
    let (tape, inputs) = Tape::record(algorithm, steps).expect("is recorded");
    assert_trial(algorithm, steps, &tape, &inputs);
    tape
}

fn assert_trial<A: Datapath>(
    algorithm: &A,
    steps: &[Vec<i32>],
    tape: &Tape,
    inputs: &cardan_numerics::tape::Inputs,
) {
    let formats: Vec<Format> = (deployed().into_iter().enumerate())
        // No two alike, so that another node shows.
        .map(|(node, format)| Format {
            frac: format.frac - node as u32 % 5,
            ..format
        })
        .collect();
    let run = Steps {
        datapath: algorithm,
        inputs: steps,
    };
    let (status, expected) = record(
        &run,
        &Formats::deployed(&infos(&formats)).expect("is computable"),
    );
    let mut trial = Trial::new(tape, inputs, DEFAULT_DOMAIN_FLAG);
    trial.run_all(&formats);
    assert_eq!(trial.status(), status);
    let raws = columns(tape, inputs, &trial, NODES);
    assert_eq!(raws, expected.raws);
}

#[test]
fn a_delay_line_of_any_length_is_recorded_as_one() {
    for delay in [1, 15, 16, 17, 64, 1000, 3000] {
        let tape = assert_words(&Comb { delay }, &noise(2 * delay + 50));
        assert_eq!(tape.transient.len(), delay, "{delay}");
        let back = Ref::Ago {
            steps: delay as u32,
            index: 3,
        };
        assert!(
            tape.steady
                .iter()
                .any(|entry| matches!(entry.op, Op::Mul(a, _) if a == back)),
            "{delay}: {:?}",
            tape.steady
        );
    }
}

/// The steps are followed beyond the data, so that short data do not hide what comes later.
#[test]
fn a_delay_line_longer_than_the_data_is_recorded_as_one() {
    for delay in [16, 64, 1000, 3000] {
        let tape = assert_words(&Comb { delay }, &noise(10));
        assert_eq!(tape.transient.len(), delay, "{delay}");
        assert_eq!(tape.memory(), delay);
    }
    let (tape, _) = Tape::record(&Long, &noise(10)).expect("is recorded");
    assert_eq!(tape.memory(), 6000);
}

#[test]
fn what_changes_once_is_a_start_up() {
    for what in ALL {
        let change = Change {
            what,
            when: |step, _| step >= 100,
        };
        let tape = assert_words(&change, &noise(400));
        let settled = match what {
            // Read one step after it is written.
            What::OperandNode => 101,
            _ => 100,
        };
        assert_eq!(tape.transient.len(), settled, "{what:?}");
    }
}

#[test]
fn what_changes_with_an_input_is_refused() {
    let quiet = |count: usize, loud: usize| -> Vec<Vec<i32>> {
        let at = |step: usize| {
            vec![if step == loud {
                900
            } else {
                (step % 50) as i32
            }]
        };
        (0..count).map(at).collect()
    };
    for what in ALL {
        let change = Change {
            what,
            when: |_, input| input > 500,
        };
        // At the very beginning, in the middle, and in the last step.
        for loud in [0, 3, 150, 299] {
            let found = Tape::record(&change, &quiet(300, loud));
            let error = found.map(|(tape, _)| tape.transient.len()).unwrap_err();
            assert!(
                matches!(error, TraceError::OtherPath { .. }),
                "{what:?} at {loud}: {error}"
            );
        }
        assert_words(&change, &quiet(300, 300));
    }
}

#[test]
fn what_changes_over_and_over_is_refused() {
    for what in ALL {
        for when in [
            (|step, _| step % 2 == 1) as fn(usize, i32) -> bool,
            |step, _| step % 64 == 63,
            |step, _| step % 1000 == 999,
        ] {
            let found = Tape::record(&Change { what, when }, &noise(400));
            let error = found.map(|(tape, _)| tape.transient.len()).unwrap_err();
            assert!(
                matches!(error, TraceError::OtherPath { .. }),
                "{what:?}: {error}"
            );
        }
    }
}

/// The words that nodes take of a run that ends within the start-up.
#[test]
fn a_run_may_end_within_the_start_up() {
    let change = Change {
        what: What::Power,
        when: |step, _| step >= 100,
    };
    for count in [1, 50, 100, 101] {
        assert_words(&change, &noise(count));
    }
    let none: [Vec<i32>; 0] = [];
    assert_eq!(Tape::record(&change, &none).unwrap_err(), TraceError::Empty);
    let run = Steps {
        datapath: &change,
        inputs: &none,
    };
    assert!(
        run.run(&cardan_numerics::Mixed::new(
            &Formats::real(NODES),
            cardan_datapath::Silent
        ))
        .is_empty()
    );
}

/// Adds the ports of one step; one that was not used is 0.
fn add<T: Copy + Default>(all: &mut Vec<Vec<T>>, taken: &[Vec<T>], steps: usize) {
    if all.len() < taken.len() {
        all.resize(taken.len(), vec![T::default(); steps]);
    }
    for (at, series) in all.iter_mut().enumerate() {
        series.push(taken.get(at).map_or(T::default(), |port| port[0]));
    }
}

/// What `algorithm`, rehearsed on `rehearsal`, takes in each of `steps`; or why it is refused.
fn follow<A: Datapath>(
    algorithm: A,
    rehearsal: &[Vec<i32>],
    steps: &[Vec<i32>],
) -> Result<Inputs, TraceError> {
    let mut follower = Follower::new(algorithm, rehearsal, 4096)?;
    let mut all = Inputs::default();
    for step in steps {
        let taken = follower.step(step)?;
        add(&mut all.raws, &taken.raws, all.steps);
        add(&mut all.truths, &taken.truths, all.steps);
        all.steps += taken.steps;
    }
    Ok(all)
}

#[test]
fn a_followed_algorithm_takes_what_a_recorded_one_takes() {
    for delay in [1, 16, 1000] {
        let steps = noise(2 * delay + 50);
        let (_, recorded) = Tape::record(&Comb { delay }, &steps).expect("is recorded");
        let followed = follow(Comb { delay }, &noise(3), &steps).expect("is followed");
        assert_eq!(followed, recorded, "{delay}");
    }
    let steps = noise(400);
    for what in ALL {
        let change = || Change {
            what,
            when: |step, _| step >= 100,
        };
        let (_, recorded) = Tape::record(&change(), &steps).expect("is recorded");
        let followed = follow(change(), &noise(3), &steps).expect("is followed");
        assert_eq!(followed, recorded, "{what:?}");
    }
}

/// The rehearsal does not see it: it is found in the step that does it.
#[test]
fn what_changes_with_an_input_is_refused_while_it_is_followed() {
    for what in ALL {
        for loud in [0, 3, 150, 299] {
            let mut steps = vec![vec![100]; 300];
            steps[loud] = vec![900];
            let change = Change {
                what,
                when: |_, input| input > 500,
            };
            match follow(change, &[vec![0], vec![100]], &steps) {
                Err(TraceError::OtherPath { step, .. }) => {
                    // What a step leaves to the next shows there.
                    assert!(
                        (loud..=loud + 1).contains(&step),
                        "{what:?}: {step}, {loud}"
                    );
                }
                // Both delays find the same constant before the first step.
                Ok(_) if what == What::Delay && loud == 0 => {}
                other => panic!("{what:?} at {loud}: {other:?}"),
            }
        }
    }
}

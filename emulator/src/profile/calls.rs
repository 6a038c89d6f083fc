//! Who called whom: a tree of call paths, followed by the stack pointer.
//!
//! An activation is alive as long as its return address lies on the stack, so whatever way a
//! program leaves a function (a return, a `longjmp`, an epilogue that is shared between functions)
//! ends exactly the activations whose return addresses it gave up. A jump into another function is
//! shown as a call without a return address, until control comes back or the activation ends.

/// Most call paths that are told apart; deeper ones count for their caller.
const MOST_NODES: usize = 1 << 16;

/// A function by its number, or an origin of control.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Label(u16);

impl Label {
    pub(super) const ASLEEP: Label = Label(0xFF00);
    pub(super) const HALTED: Label = Label(0xFF01);
    const FIRST_VECTOR: u16 = 0xF000;

    fn vector(vector: usize) -> Label {
        Label(Label::FIRST_VECTOR + vector as u16)
    }

    /// The vector, if it is one; vector 0 is the program itself.
    pub(super) fn as_vector(self) -> Option<usize> {
        let vector = usize::from(self.0.checked_sub(Label::FIRST_VECTOR)?);
        (vector < 0xF00).then_some(vector)
    }

    /// The number of the function, if it is one.
    pub(super) fn as_function(self) -> Option<usize> {
        (self.0 < Label::FIRST_VECTOR).then_some(usize::from(self.0))
    }
}

/// A call path: a label and, through the parents, its callers.
#[derive(Clone, Debug)]
pub(super) struct Node {
    pub(super) label: Label,
    /// `None` for an origin of control.
    pub(super) parent: Option<usize>,
    pub(super) cycles: u64,
    first_child: Option<usize>,
    next_sibling: Option<usize>,
}

/// How control came to an instruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Transfer {
    /// By a jump, or one instruction after another.
    Jump,
    /// By the call at `pc`; `sp` is the stack pointer before it.
    Call { pc: u16, sp: u16 },
    /// By a return.
    Return,
}

/// What began an activation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Origin {
    Reset,
    Call,
    Interrupt { vector: usize, begin: u64 },
}

#[derive(Clone, Debug)]
struct Activation {
    origin: Origin,
    /// Stack pointer when it will have returned.
    return_sp: u32,
    /// The path it was called from.
    base: usize,
    /// Where it is now: `base`, or a function below.
    node: usize,
}

/// The tree, and where control is in it.
#[derive(Clone, Debug)]
pub(super) struct Calls {
    pub(super) nodes: Vec<Node>,
    activations: Vec<Activation>,
    /// How many of them are interrupts.
    interrupts: usize,
    /// First word of each function.
    starts: Vec<u16>,
    /// How often each function was entered; the last one counts for code without a name.
    pub(super) entered: Vec<u64>,
    /// Path that the cycles since `since` belong to.
    current: usize,
    since: u64,
    /// Some paths were too many to be told apart.
    pub(super) is_cut: bool,
}

impl Calls {
    pub(super) fn new(starts: Vec<u16>) -> Calls {
        let mut calls = Calls {
            nodes: Vec::new(),
            activations: Vec::new(),
            interrupts: 0,
            entered: vec![0; starts.len() + 1],
            starts,
            current: 0,
            since: 0,
            is_cut: false,
        };
        calls.begin();
        calls.current = calls.activations[0].node;
        calls
    }

    /// Nothing is active but the program itself.
    fn begin(&mut self) {
        let root = self.root(Label::vector(0));
        self.activations.clear();
        self.interrupts = 0;
        self.activations.push(Activation {
            origin: Origin::Reset,
            return_sp: u32::MAX,
            base: root,
            node: root,
        });
    }

    /// The chip is reset.
    pub(super) fn reset(&mut self, cycle: u64) {
        self.settle(cycle);
        self.begin();
    }

    /// The cycles so far belong to the current path.
    pub(super) fn settle(&mut self, cycle: u64) {
        self.nodes[self.current].cycles += cycle.saturating_sub(self.since);
        self.since = cycle;
    }

    fn switch(&mut self, node: usize, cycle: u64) {
        self.settle(cycle);
        self.current = node;
    }

    /// Control rests.
    pub(super) fn pause(&mut self, label: Label, cycle: u64) {
        let node = self.root(label);
        self.switch(node, cycle);
    }

    /// Control has come to `pc` in `function`; `sp` is the stack pointer there. Returns the
    /// interrupts that ended on the way, with the cycles of their beginning.
    pub(super) fn arrive(
        &mut self,
        transfer: Transfer,
        function: u16,
        pc: u16,
        sp: u16,
        cycle: u64,
    ) -> Vec<(usize, u64)> {
        let is_start = self.starts.get(usize::from(function)) == Some(&pc);
        let ended = match transfer {
            Transfer::Call { pc: from, sp } if is_start || pc.wrapping_sub(from) > 2 => {
                let ended = self.prune(sp);
                let caller = self.top().node;
                self.activations.push(Activation {
                    origin: Origin::Call,
                    return_sp: u32::from(sp),
                    base: caller,
                    node: caller,
                });
                let node = self.child(caller, Label(function));
                self.top().node = node;
                self.enter(function);
                ended
            }
            // A call of the next instruction only makes room on the stack.
            _ => {
                let ended = self.prune(sp);
                self.go_to(function, is_start && transfer == Transfer::Jump);
                ended
            }
        };
        let node = self.top().node;
        self.switch(node, cycle);
        ended
    }

    /// The interrupt `vector` begins; `sp` is the stack pointer before it. Returns the interrupts
    /// that had ended unnoticed.
    pub(super) fn interrupt(&mut self, vector: usize, sp: u16, cycle: u64) -> Vec<(usize, u64)> {
        let ended = self.prune(sp);
        let root = self.root(Label::vector(vector));
        self.interrupts += 1;
        self.activations.push(Activation {
            origin: Origin::Interrupt {
                vector,
                begin: cycle,
            },
            return_sp: u32::from(sp),
            base: root,
            node: root,
        });
        self.switch(root, cycle);
        ended
    }

    /// Whether an interrupt is being served.
    pub(super) fn is_interrupted(&self) -> bool {
        self.interrupts > 0
    }

    /// The labels from the program itself to the innermost function, through interrupts.
    pub(super) fn path(&self) -> Vec<Label> {
        let mut path = Vec::new();
        for activation in self.activations.iter().rev() {
            let mut node = Some(activation.node);
            // The base of a call is the place of its caller, which comes next.
            let base = match activation.origin {
                Origin::Call => Some(activation.base),
                _ => None,
            };
            while let Some(at) = node.filter(|&at| Some(at) != base) {
                path.push(self.nodes[at].label);
                node = self.nodes[at].parent;
            }
        }
        path.reverse();
        path
    }

    /// The innermost activation; the program itself never ends.
    fn top(&mut self) -> &mut Activation {
        let last = self.activations.len() - 1;
        &mut self.activations[last]
    }

    /// Ends the activations whose return address no longer lies on the stack.
    fn prune(&mut self, sp: u16) -> Vec<(usize, u64)> {
        let mut ended = Vec::new();
        while self.activations.len() > 1 && u32::from(sp) + 2 > self.top().return_sp {
            if let Some(Activation {
                origin: Origin::Interrupt { vector, begin },
                ..
            }) = self.activations.pop()
            {
                self.interrupts -= 1;
                ended.push((vector, begin));
            }
        }
        ended
    }

    /// Within the innermost activation, control has gone to `function`.
    fn go_to(&mut self, function: u16, is_start: bool) {
        let Activation {
            origin, base, node, ..
        } = *self.top();
        let label = Label(function);
        let mut known = node;
        while known != base {
            if self.nodes[known].label == label {
                self.top().node = known;
                return;
            }
            match self.nodes[known].parent {
                Some(parent) => known = parent,
                None => break,
            }
        }
        // Nothing called the program itself, so nothing waits for it to come back; and the table
        // of vectors leads to the interrupt's function.
        let is_led = match origin {
            Origin::Reset => true,
            Origin::Interrupt { .. } => self.is_table(node),
            Origin::Call => false,
        };
        let from = if is_led { base } else { node };
        self.top().node = self.child(from, label);
        if is_start {
            self.enter(function);
        }
    }

    /// Whether the path ends in the table of vectors.
    fn is_table(&self, node: usize) -> bool {
        let function = self.nodes[node].label.as_function();
        function.is_some_and(|number| self.starts.get(number) == Some(&0))
    }

    fn enter(&mut self, function: u16) {
        if let Some(count) = self.entered.get_mut(usize::from(function)) {
            *count += 1;
        }
    }

    /// The path `parent`, then `label`.
    fn child(&mut self, parent: usize, label: Label) -> usize {
        let mut next = self.nodes[parent].first_child;
        while let Some(node) = next {
            if self.nodes[node].label == label {
                return node;
            }
            next = self.nodes[node].next_sibling;
        }
        if self.nodes.len() >= MOST_NODES {
            self.is_cut = true;
            return parent;
        }
        let next_sibling = self.nodes[parent].first_child;
        let node = self.add(label, Some(parent), next_sibling);
        self.nodes[parent].first_child = Some(node);
        node
    }

    fn root(&mut self, label: Label) -> usize {
        let mut nodes = self.nodes.iter();
        let known = nodes.position(|node| node.label == label && node.parent.is_none());
        known.unwrap_or_else(|| self.add(label, None, None))
    }

    fn add(&mut self, label: Label, parent: Option<usize>, next_sibling: Option<usize>) -> usize {
        self.nodes.push(Node {
            label,
            parent,
            cycles: 0,
            first_child: None,
            next_sibling,
        });
        self.nodes.len() - 1
    }
}

//! Removes what killed participants leave behind, and touches nothing of anyone alive.

use iceoryx2::node::{Node, NodeState, NodeView};
use iceoryx2::prelude::{CallbackProgression, ipc};

use crate::session_id::SessionId;
use crate::transport::{config, node_prefix};

/// Removes everything that dead participants of a session left in shared memory and in iceoryx2's
/// folder. Call it when all its participants have been reaped.
pub fn cleanup(session: &SessionId) {
    crate::quieten();
    remove_dead_nodes(session);
}

pub(crate) struct Remains;
impl Remains {
    pub(crate) fn begin() -> Self {
        Self
    }
}
pub(crate) fn sweep(session: &SessionId, _: &Remains, _pids: &[u32]) {
    cleanup(session)
}

/// Lets iceoryx2 clean up behind the session's dead nodes.
pub(crate) fn remove_dead_nodes(session: &SessionId) {
    let prefix = node_prefix(session);
    let mut dead = Vec::new();
    let _ = Node::<ipc::Service>::list(&config(), |state| {
        if let NodeState::Dead(node) = state {
            let details = node.details().as_ref();
            if details.is_some_and(|details| details.name().as_str().starts_with(&prefix)) {
                dead.push(node);
            }
        }
        CallbackProgression::Continue
    });
    for node in dead {
        let _ = node.try_remove_stale_resources();
    }
}

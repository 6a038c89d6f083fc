//! Removes what killed participants leave behind, and touches nothing of anyone alive.
//!
//! iceoryx2 cleans up behind dead nodes. A process that is killed while it creates its node or a
//! service leaves pieces that iceoryx2 does not attribute to any node; those are found here by the
//! process id and time that iceoryx2 puts into every name, and by the names of the session's
//! services. Shared memory can be listed on Linux only; elsewhere such pieces stay.

use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use iceoryx2::config::Config;
use iceoryx2::node::{DeadNodeView, Node, NodeState, NodeView};
use iceoryx2::prelude::{CallbackProgression, MessagingPattern, Service, ServiceName, ipc};
use iceoryx2::service::service_hash::ServiceHash;
use iceoryx2::unique_id_generator::unique_system_id::UniqueSystemId;

use crate::error::LinkError;
use crate::resources::SHARED_MEMORY;
use crate::role::Role;
use crate::session_id::SessionId;
use crate::stream::{Stream, Visitor, for_each};
use crate::transport::{NODE_PREFIX, config, service_text};

/// How long another process may take that is cleaning up the same node.
const PATIENCE: Duration = Duration::from_millis(500);

/// Far longer than the creation of a segment takes.
const CREATION_TIME: Duration = Duration::from_secs(1);

/// Removes everything that dead participants of a session left in shared memory and in iceoryx2's
/// folder. For participants that were started by hand; a [`Supervisor`](crate::Supervisor) does it
/// by itself, and knows its children's process ids: without them, what was killed in the first or
/// last milliseconds of its life can leave a few small files.
pub fn cleanup(session: &SessionId) {
    crate::quieten();
    sweep(session, &BTreeSet::new());
}

/// A process that is known to be gone, or the part of a name that tells which process made it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Owner {
    /// Process id as iceoryx2 sees it, outside of any container.
    pub(crate) pid: i32,
}

impl Owner {
    /// The maker of something that iceoryx2 named by this id.
    pub(crate) fn of(id: u128) -> Self {
        Self {
            pid: UniqueSystemId::from(id).pid().value(),
        }
    }

    /// A running child of this process.
    pub(crate) fn of_child(pid: u32) -> Self {
        let status = fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
        let outer = status.lines().find_map(|line| line.strip_prefix("NSpid:"));
        let outer = outer.and_then(|pids| pids.split_whitespace().next()?.parse().ok());
        Self {
            pid: outer.unwrap_or(pid as i32),
        }
    }
}

/// Cleans up behind the session's dead nodes, and behind `gone`, which must have been reaped.
pub(crate) fn sweep(session: &SessionId, gone: &BTreeSet<Owner>) {
    let config = config();
    let mut nodes = cardan_nodes(&config);
    nodes.retain(|(of, _)| of == session.as_str());
    let any_alive = nodes.iter().any(|(_, node)| node.is_none());
    let dead: Vec<_> = nodes.into_iter().filter_map(|(_, node)| node).collect();
    let mut gone = gone.clone();
    gone.extend(dead.iter().map(|node| Owner::of(node.id().value())));
    // A number that is in use again belongs to somebody else by now.
    gone.retain(|owner| !Path::new(&format!("/proc/{}", owner.pid)).exists());
    remove_unfinished(&gone);
    for node in dead {
        // What cannot be removed this way is removed below.
        let _ = node.blocking_remove_stale_resources(PATIENCE);
    }
    if any_alive {
        return;
    }
    let root = PathBuf::from(config.global.root_path().to_string());
    for path in owned(Path::new(SHARED_MEMORY), &gone) {
        remove(&path);
    }
    for path in owned(&PathBuf::from(config.global.node_dir().to_string()), &gone) {
        remove(&path);
    }
    let services = root.join(config.global.service.directory.to_string());
    remove_services(&services, session, &gone);
}

/// Removes what sessions left of which nobody is alive any more, because they were killed together
/// with their supervisor.
pub(crate) fn heal() {
    let config = config();
    let nodes = cardan_nodes(&config);
    let alive: BTreeSet<_> = nodes
        .iter()
        .filter(|(_, node)| node.is_none())
        .map(|(session, _)| session)
        .collect();
    let orphans = nodes.iter().filter(|(session, _)| !alive.contains(session));
    for node in orphans.filter_map(|(_, node)| node.clone()) {
        remove_unfinished(&BTreeSet::from([Owner::of(node.id().value())]));
        // One that another process is removing is as good as removed.
        let _ = node.try_remove_stale_resources();
    }
    remove_stillborn(&config);
}

/// Removes nodes whose process was killed before iceoryx2 could watch it: their details are there,
/// and tell that the node is of this product, but even after a while iceoryx2 does not list it.
fn remove_stillborn(config: &Config) {
    let root = PathBuf::from(config.global.node_dir().to_string());
    let Ok(entries) = fs::read_dir(&root) else {
        return;
    };
    let prefix = config.global.prefix.to_string();
    let candidates: Vec<_> = entries
        .flatten()
        .filter(|entry| is_old_and_ours(entry, &prefix))
        .collect();
    if candidates.is_empty() {
        return;
    }
    let mut listed = BTreeSet::new();
    let complete = Node::<ipc::Service>::list(config, |state| {
        listed.insert(state.node_id().value());
        CallbackProgression::Continue
    });
    for entry in candidates {
        let name = entry.file_name().to_string_lossy().into_owned();
        let is_listed = name.parse().is_ok_and(|id: u128| listed.contains(&id));
        if complete.is_ok() && !is_listed {
            for part in ["", "_owner_lock", "_context"] {
                remove(&root.join(format!("{prefix}{name}.node_monitor{part}")));
            }
            remove(&entry.path());
        }
    }
}

fn is_old_and_ours(folder: &fs::DirEntry, prefix: &str) -> bool {
    let details = folder.path().join(format!("{prefix}node.details"));
    let text = fs::read_to_string(&details).unwrap_or_default();
    let made = fs::metadata(&details).and_then(|meta| meta.modified());
    let age = made.ok().and_then(|made| made.elapsed().ok());
    text.contains(&format!("name = \"{NODE_PREFIX}")) && age > Some(CREATION_TIME)
}

/// All participants of all sessions of this user: the session, and the node if it is dead.
fn cardan_nodes(config: &Config) -> Vec<(String, Option<DeadNodeView<ipc::Service>>)> {
    let session = |view: &dyn NodeView| {
        let name = view.details().as_ref()?.name().to_string();
        Some(
            name.strip_prefix(NODE_PREFIX)?
                .split('/')
                .next()?
                .to_owned(),
        )
    };
    let mut nodes = Vec::new();
    // A list that breaks off leaves nodes for the next clean-up.
    let _ = Node::<ipc::Service>::list(config, |state| {
        let found = match state {
            NodeState::Dead(node) => session(&node).map(|session| (session, Some(node))),
            NodeState::Alive(node) => session(&node).map(|session| (session, None)),
            NodeState::Inaccessible(_) | NodeState::Undefined(_) => None,
        };
        nodes.extend(found);
        CallbackProgression::Continue
    });
    nodes
}

/// Removes shared memory that one of `gone` was creating when it was killed. iceoryx2 0.10 waits
/// for ever for a segment without a size, so this also frees those who wait for one.
pub(crate) fn remove_unfinished(gone: &BTreeSet<Owner>) {
    for path in owned(Path::new(SHARED_MEMORY), gone) {
        if is_unfinished(&path) {
            remove(&path);
        }
    }
}

/// Waits until iceoryx2's own management segment, if somebody is creating it, is finished; removes
/// it if its creator was killed meanwhile, since no node could ever be created again.
pub(crate) fn await_management() {
    const PERIOD: Duration = Duration::from_millis(5);
    // That of another user cannot be removed; iceoryx2 will say so.
    let rounds = 2 * CREATION_TIME.as_millis() / PERIOD.as_millis();
    for _ in 0..rounds {
        let Some((path, age)) = unfinished_management() else {
            return;
        };
        if age > CREATION_TIME {
            remove(&path);
        }
        std::thread::sleep(PERIOD);
    }
}

/// An unfinished management segment and its age.
fn unfinished_management() -> Option<(PathBuf, Duration)> {
    let paths = fs::read_dir(SHARED_MEMORY)
        .ok()?
        .flatten()
        .map(|entry| entry.path());
    let prefix = config().global.prefix.to_string();
    let mut segments = paths.filter(|path| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with(&prefix) && name.ends_with(".global_mgmt")
    });
    let path = segments.find(|path| is_unfinished(path))?;
    let age = fs::metadata(&path).ok()?.modified().ok()?.elapsed().ok()?;
    Some((path, age))
}

/// iceoryx2 makes a segment readable as the last step of its creation.
fn is_unfinished(path: &Path) -> bool {
    const OWNER_READ: u32 = 0o400;
    fs::metadata(path).is_ok_and(|meta| meta.permissions().mode() & OWNER_READ == 0)
}

/// The entries of a folder that were made by one of `gone`.
fn owned(folder: &Path, gone: &BTreeSet<Owner>) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(folder) else {
        return Vec::new();
    };
    let is_owned = |entry: &fs::DirEntry| {
        let ids = entry.file_name().to_str().map(ids_in).unwrap_or_default();
        ids.iter().any(|&id| gone.contains(&Owner::of(id)))
    };
    entries
        .flatten()
        .filter(is_owned)
        .map(|entry| entry.path())
        .collect()
}

/// The iceoryx2 ids in a file name: `iox2_ID.node_monitor`, `iox2_HASH_ID.data`,
/// `iox2_HASH_ID_ID.connection`, or a folder `ID`. A hash is too long to be an id.
fn ids_in(name: &str) -> Vec<u128> {
    let stem = name.split('.').next().unwrap_or(name);
    let is_ours = stem.starts_with("iox2_") || stem == name;
    let numbers = stem.split('_').filter_map(|part| part.parse().ok());
    if is_ours {
        numbers.collect()
    } else {
        Vec::new()
    }
}

/// Removes the descriptions of the session's services that one of `gone` made. They are named by
/// a hash alone; who made one stands in it, unless it is torn.
fn remove_services(folder: &Path, session: &SessionId, gone: &BTreeSet<Owner>) {
    struct Remove<'a>(&'a Path, &'a SessionId, &'a BTreeSet<Owner>);

    impl Visitor for Remove<'_> {
        fn visit<S: Stream>(&mut self, _: S) -> Result<(), LinkError> {
            let Self(folder, session, gone) = *self;
            for file in S::WRITERS
                .iter()
                .filter_map(|&writer| description::<S>(session, writer))
            {
                let path = folder.join(file);
                let Ok(text) = fs::read_to_string(&path) else {
                    continue;
                };
                let is_torn = maker(&text).is_none() && !gone.is_empty();
                if is_torn || maker(&text).is_some_and(|maker| gone.contains(&maker)) {
                    remove(&path);
                }
            }
            Ok(())
        }
    }

    // The visitor itself cannot fail.
    let _ = for_each(&mut Remove(folder, session, gone));
}

/// The process that made a service, from the upper half of the service's id in its description.
fn maker(description: &str) -> Option<Owner> {
    let upper = description
        .lines()
        .find_map(|line| line.strip_prefix("unique_value = "))?;
    Some(Owner::of(
        u128::from(upper.trim().parse::<u64>().ok()?) << 64,
    ))
}

/// Name of the file in which iceoryx2 describes a service.
fn description<S: Stream>(session: &SessionId, writer: Role) -> Option<String> {
    type Hasher = <ipc::Service as Service>::ServiceNameHasher;
    let name = ServiceName::new(&service_text::<S>(session, writer)).ok()?;
    let hash = ServiceHash::new::<Hasher>(&name, MessagingPattern::PublishSubscribe);
    Some(format!(
        "{}{}.service",
        config().global.prefix,
        hash.as_str()
    ))
}

fn remove(path: &Path) {
    // Gone already, or of another user: neither is ours to remove.
    let _ = if path.is_dir() {
        fs::remove_dir_all(path)
    } else {
        fs::remove_file(path)
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    const HASH: &str = "0354a209029e7d094a819e2d4030ea331e6caaf0";

    #[test]
    fn ids_are_found_in_every_kind_of_name_and_hashes_are_not_taken_for_one() {
        assert_eq!(ids_in("iox2_11.node_monitor_context"), [11]);
        assert_eq!(ids_in(&format!("iox2_{HASH}_12.data")), [12]);
        assert_eq!(ids_in(&format!("iox2_{HASH}_13_14.connection")), [13, 14]);
        assert_eq!(ids_in("15"), [15]);
        let digits = "9".repeat(40);
        assert_eq!(ids_in(&format!("iox2_{digits}_16.dynamic")), [16]);
        assert_eq!(ids_in(&format!("iox2_{HASH}_node.0_10_0.global_mgmt")), []);
        assert_eq!(ids_in("other_17.data"), []);
    }

    #[test]
    fn a_description_tells_who_made_the_service_unless_it_is_torn() {
        let text = "[unique_service_id]\npayload_value = 7\nunique_value = 38654730640\n";
        assert_eq!(maker(text), Some(Owner { pid: 24976 }));
        assert_eq!(maker(&text[..40]), None);
        assert_eq!(maker(""), None);
    }

    #[test]
    fn an_id_tells_the_process_that_made_it() {
        let id = UniqueSystemId::new().expect("the clock runs");
        let me = Owner::of_child(std::process::id());
        assert_eq!(Owner::of(id.value()), me);
    }
}

//! iceoryx2 behind two small traits, the same for processes and for threads of one process.

use std::sync::Arc;
use std::time::Duration;

use iceoryx2::config::Config;
use iceoryx2::node::{NodeState, NodeView};
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::port::{BackpressureAction, BackpressureInfo};
use iceoryx2::prelude::*;
use iceoryx2::service::builder::publish_subscribe::PublishSubscribeOpenError;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory as PubSub;

use crate::error::LinkError;
use crate::place;
use crate::record::{Header, Record};
use crate::role::Role;
use crate::session_id::SessionId;
use crate::stream::Stream;

/// Where the participants are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Transport {
    /// In processes of their own: shared memory.
    #[default]
    Processes,
    /// In threads of this process: the same code on process-local memory.
    InProcess,
}

/// Sizes of one stream's buffers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Capacity {
    /// Records per slice.
    pub(crate) batch: usize,
    /// Slices that wait per reader before the writer must wait.
    pub(crate) batches: usize,
}

/// The writing end of a stream.
pub(crate) trait OutPort<T> {
    /// Sends one slice to every reader and returns how many took it. Waits while a buffer is full,
    /// unless the session's `gives_up` says so.
    fn send(&self, header: Header, records: &[T]) -> Result<usize, LinkError>;
    /// Number of readers that are announced at present.
    fn readers(&self) -> usize;
}

/// The reading end of a stream.
pub(crate) trait InPort<T> {
    /// The next slice, if one is there.
    fn receive(&self) -> Result<Option<(Header, Vec<T>)>, LinkError>;
    /// Connects to the writer; false while there is none.
    fn connect(&self) -> Result<bool, LinkError>;
}

/// A participant as iceoryx2 sees it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Peer {
    pub(crate) role: Role,
    /// iceoryx2's id of the node.
    pub(crate) node: u128,
    pub(crate) alive: bool,
}

/// One participant's access to iceoryx2: a node under a name that tells session and role.
pub(crate) enum Domain {
    Processes(Node<ipc::Service>),
    InProcess(Node<local::Service>),
}

/// Says whether a writer that waits for a full buffer should give up.
pub(crate) type GivesUp = Arc<dyn Fn() -> bool + Send + Sync>;

impl Domain {
    pub(crate) fn new(
        transport: Transport,
        session: &SessionId,
        role: Role,
    ) -> Result<Self, LinkError> {
        match transport {
            Transport::Processes => new_node(session, role).map(Self::Processes),
            Transport::InProcess => new_node(session, role).map(Self::InProcess),
        }
    }

    pub(crate) fn out_port<S: Stream>(
        &self,
        (session, role): (&SessionId, Role),
        capacity: Capacity,
        gives_up: GivesUp,
    ) -> Result<Box<dyn OutPort<S::Record>>, LinkError> {
        let name = service_name::<S>(session, role)?;
        let writer = (session, role);
        Ok(match self {
            Self::Processes(node) => Box::new(Out::<_, S::Record>::new(
                node, &name, writer, capacity, gives_up,
            )?),
            Self::InProcess(node) => Box::new(Out::<_, S::Record>::new(
                node, &name, writer, capacity, gives_up,
            )?),
        })
    }

    /// `None` while the writer has not created the stream.
    pub(crate) fn in_port<S: Stream>(
        &self,
        session: &SessionId,
        writer: Role,
    ) -> Result<Option<Box<dyn InPort<S::Record>>>, LinkError> {
        fn boxed<V: Service + 'static, T: Record>(port: In<V, T>) -> Box<dyn InPort<T>> {
            Box::new(port)
        }
        let name = service_name::<S>(session, writer)?;
        match self {
            Self::Processes(node) => Ok(In::open(node, &name)?.map(boxed)),
            Self::InProcess(node) => Ok(In::open(node, &name)?.map(boxed)),
        }
    }
}

/// The participants of a session that iceoryx2 knows, alive or dead.
pub(crate) fn peers(transport: Transport, session: &SessionId) -> Result<Vec<Peer>, LinkError> {
    match transport {
        Transport::Processes => list_peers::<ipc::Service>(session),
        Transport::InProcess => list_peers::<local::Service>(session),
    }
}

/// iceoryx2's settings: the defaults (so that every session of a user uses one root path and prefix),
/// but participants do not clean up behind others on their own account. That would hide a death
/// from those who have to notice it, and be cut short when the supervisor ends the run.
pub(crate) fn config() -> Config {
    let mut config = Config::default();
    config.global.node.cleanup_dead_nodes_on_creation = false;
    config.global.node.cleanup_dead_nodes_on_destruction = false;
    config.global.service.cleanup_dead_nodes_on_open = false;
    // A creator that was killed half-way must not hold up the others for long.
    config.global.creation_timeout = Duration::from_millis(250);
    place::settle(&mut config);
    config
}

/// Prefix of the node names of a session.
pub(crate) fn node_prefix(session: &SessionId) -> String {
    format!("{NODE_PREFIX}{session}/")
}

/// Prefix of the node names of all sessions.
pub(crate) const NODE_PREFIX: &str = "cardan/";

/// Name of the service that carries a stream.
pub(crate) fn service_text<S: Stream>(session: &SessionId, writer: Role) -> String {
    format!("{}{writer}/{}", node_prefix(session), S::NAME)
}

fn new_node<V: Service>(session: &SessionId, role: Role) -> Result<Node<V>, LinkError> {
    let name = format!("{}{role}", node_prefix(session));
    let failed = |cause: &dyn std::fmt::Debug| LinkError::transport("creating a node", cause);
    NodeBuilder::new()
        .name(&NodeName::new(&name).map_err(|e| failed(&e))?)
        .config(&config())
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<V>()
        .map_err(|e| failed(&e))
}

fn service_name<S: Stream>(session: &SessionId, writer: Role) -> Result<ServiceName, LinkError> {
    ServiceName::new(&service_text::<S>(session, writer))
        .map_err(|e| LinkError::transport("naming a service", e))
}

fn list_peers<V: Service>(session: &SessionId) -> Result<Vec<Peer>, LinkError> {
    let prefix = node_prefix(session);
    let mut peers = Vec::new();
    let mut note = |details: &Option<iceoryx2::node::NodeDetails>, node: u128, alive: bool| {
        let name = details.as_ref().map(|details| details.name().as_str());
        let role = name.and_then(|name| name.strip_prefix(&prefix)?.parse().ok());
        peers.extend(role.map(|role| Peer { role, node, alive }));
    };
    Node::<V>::list(&config(), |state| {
        match &state {
            NodeState::Alive(view) => note(view.details(), view.id().value(), true),
            NodeState::Dead(view) => note(view.details(), view.id().value(), false),
            // Of other users, or in the middle of being made or removed.
            NodeState::Inaccessible(_) | NodeState::Undefined(_) => {}
        }
        CallbackProgression::Continue
    })
    .map_err(|e| LinkError::transport("listing participants", e))?;
    Ok(peers)
}

struct Out<V: Service + 'static, T: Record> {
    service: PubSub<V, [T], Header>,
    publisher: Publisher<V, [T], Header>,
}

impl<V: Service + 'static, T: Record> Out<V, T> {
    fn new(
        node: &Node<V>,
        name: &ServiceName,
        (session, role): (&SessionId, Role),
        capacity: Capacity,
        gives_up: GivesUp,
    ) -> Result<Self, LinkError> {
        use iceoryx2::port::publisher::PublisherCreateError::ExceedsMaxSupportedPublishers;
        let service = node
            .service_builder(name)
            .publish_subscribe::<[T]>()
            .user_header::<Header>()
            .enable_safe_overflow(false)
            .history_size(0)
            .subscriber_max_buffer_size(capacity.batches)
            .subscriber_max_borrowed_samples(1)
            .max_publishers(1)
            .max_subscribers(Role::ALL.len())
            .max_nodes(2 * Role::ALL.len())
            .open_or_create()
            .map_err(|e| LinkError::transport(format!("creating {name}"), e))?;
        let publisher = service
            .publisher_builder()
            .initial_max_slice_len(capacity.batch)
            .max_loaned_samples(1)
            .set_backpressure_handler(move |info| wait_or_give_up(info, &gives_up))
            .create()
            .map_err(|e| match e {
                ExceedsMaxSupportedPublishers => LinkError::RoleTaken {
                    role,
                    session: session.to_string(),
                },
                e => LinkError::transport(format!("publishing {name}"), e),
            })?;
        Ok(Self { service, publisher })
    }
}

/// Called again and again while a reader's buffer is full.
fn wait_or_give_up(info: &BackpressureInfo, gives_up: &GivesUp) -> BackpressureAction {
    if gives_up() {
        return BackpressureAction::DiscardDataAndFail;
    }
    std::thread::sleep(pause(info.retries));
    BackpressureAction::Retry
}

/// How long to sleep before the n-th look: 20 us at first, 1 ms at most.
pub(crate) fn pause(retries: u64) -> Duration {
    Duration::from_micros((20 * (retries + 1)).min(1000))
}

impl<V: Service + 'static, T: Record> OutPort<T> for Out<V, T> {
    fn send(&self, header: Header, records: &[T]) -> Result<usize, LinkError> {
        let loan = self.publisher.loan_slice_uninit(records.len());
        let loan = loan.map_err(|e| LinkError::transport("borrowing shared memory", e))?;
        let mut sample = loan.write_from_slice(records);
        *sample.user_header_mut() = header;
        sample
            .send()
            .map_err(|e| LinkError::transport("sending", e))
    }

    fn readers(&self) -> usize {
        self.service.dynamic_config().number_of_subscribers()
    }
}

struct In<V: Service + 'static, T: Record> {
    service: PubSub<V, [T], Header>,
    subscriber: Subscriber<V, [T], Header>,
}

impl<V: Service + 'static, T: Record> In<V, T> {
    fn open(node: &Node<V>, name: &ServiceName) -> Result<Option<Self>, LinkError> {
        use PublishSubscribeOpenError as Error;
        let opened = node
            .service_builder(name)
            .publish_subscribe::<[T]>()
            .user_header::<Header>()
            .open();
        let service = match opened {
            Ok(service) => service,
            Err(Error::DoesNotExist | Error::HangsInCreation | Error::IsMarkedForDestruction) => {
                return Ok(None);
            }
            Err(e) => return Err(LinkError::transport(format!("opening {name}"), e)),
        };
        let subscriber = service
            .subscriber_builder()
            .create()
            .map_err(|e| LinkError::transport(format!("subscribing to {name}"), e))?;
        Ok(Some(Self {
            service,
            subscriber,
        }))
    }
}

impl<V: Service + 'static, T: Record> InPort<T> for In<V, T> {
    fn receive(&self) -> Result<Option<(Header, Vec<T>)>, LinkError> {
        let sample = self.subscriber.receive();
        let sample = sample.map_err(|e| LinkError::transport("receiving", e))?;
        Ok(sample.map(|sample| (*sample.user_header(), sample.payload().to_vec())))
    }

    fn connect(&self) -> Result<bool, LinkError> {
        let updated = self.subscriber.update_connections();
        updated.map_err(|e| LinkError::transport("connecting", e))?;
        Ok(self.service.dynamic_config().number_of_publishers() == 1)
    }
}

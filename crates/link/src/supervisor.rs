//! Starts participants as child processes, notices who dies first, and leaves nothing behind.
//!
//! Each child's standard input is a pipe that the supervisor holds open and never writes to: when
//! the supervisor dies, the kernel closes it and the child ends itself.

use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, ChildStderr, ChildStdin, ChildStdout, Command, ExitStatus, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::cleanup::{Owner, await_management, heal, sweep};
use crate::error::{Death, LinkError};
use crate::options::STALL_TIMEOUT;
use crate::resources::{self, is_stopped};
use crate::role::Role;
use crate::session_id::SessionId;

/// Environment variable by which a child knows that it is supervised.
pub(crate) const SUPERVISED: &str = "CARDAN_SUPERVISED";

/// Time between two looks at the children.
const PERIOD: Duration = Duration::from_millis(5);

/// A child that reports the death of another may be reaped before that other; wait this long for
/// the true culprit.
const BLAME_TIME: Duration = Duration::from_millis(300);

/// Time that children get to leave by themselves before they are killed.
const GRACE: Duration = Duration::from_millis(600);

/// Exit code of a participant that lost a peer.
const EXIT_DIED: i32 = 3;

/// What ends a process that writes to shared memory when there is none left.
const SIGBUS: i32 = 7;

/// Bytes of standard error that are kept.
const TAIL: usize = 64 * 1024;

/// Lines of it that an error quotes.
const QUOTED_LINES: usize = 12;

/// One child process to be started.
#[derive(Debug)]
pub struct Participant {
    /// Its part.
    pub role: Role,
    /// How to start it. The supervisor takes over its standard input and standard error.
    pub command: Command,
    /// Exit codes of a run that is complete, whatever its verdict.
    pub completes_with: Vec<i32>,
    /// Pass its standard error on, beside keeping its tail.
    pub forward_stderr: bool,
    /// Keep its standard output; else it goes wherever `command` says.
    pub capture_stdout: bool,
}

impl Participant {
    /// A participant that completes with exit code 0, silently.
    #[must_use]
    pub fn new(role: Role, command: Command) -> Self {
        Self {
            role,
            command,
            completes_with: vec![0],
            forward_stderr: false,
            capture_stdout: false,
        }
    }
}

/// Makes a child of `command` end when this process does, however that ends, as long as its standard
/// input, which is a pipe now, is held open. For children that are no participants of a session.
pub fn supervise(command: &mut Command) {
    command.env(SUPERVISED, "1").stdin(Stdio::piped());
}

/// How a child process ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// It returned this exit code.
    Exit(i32),
    /// It was ended by this signal.
    Signal(i32),
}

impl Ending {
    fn of(status: ExitStatus) -> Self {
        status
            .code()
            .map_or_else(|| Self::Signal(status.signal().unwrap_or(0)), Self::Exit)
    }

    /// Who is more likely the cause when several ended: a killed one before one that failed, and
    /// that before one that only reports the loss of a peer.
    const fn blame(self) -> u8 {
        match self {
            Self::Signal(_) => 2,
            Self::Exit(EXIT_DIED) => 0,
            Self::Exit(_) => 1,
        }
    }
}

impl std::fmt::Display for Ending {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Exit(code) => write!(f, "ended with exit code {code}"),
            Self::Signal(9) => f.write_str("was killed (SIGKILL)"),
            Self::Signal(SIGBUS) => f.write_str(
                "was ended by SIGBUS: shared memory (/dev/shm) ran full; mend: make room there",
            ),
            Self::Signal(signal) => write!(f, "was ended by signal {signal}"),
        }
    }
}

/// A child process that completed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finished {
    /// Its part.
    pub role: Role,
    /// Its exit code, one of [`Participant::completes_with`].
    pub code: i32,
    /// Its standard output if that was captured.
    pub stdout: Vec<u8>,
    /// The last kilobytes of its standard error.
    pub stderr: String,
}

/// Why a session of child processes did not complete.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SupervisorError {
    /// A process could not be started.
    #[error("participant '{role}' could not start: {cause}")]
    CouldNotStart {
        /// Its part.
        role: Role,
        /// The system's reason.
        cause: String,
    },
    /// A process ended before the session was complete.
    #[error("participant '{role}' {how}{}", quoted(stderr))]
    ParticipantDied {
        /// Its part.
        role: Role,
        /// How it ended.
        how: Ending,
        /// The last kilobytes of its standard error.
        stderr: String,
    },
    /// A process was stopped by a signal and did not go on in time.
    #[error("participant '{role}' {}", Death::Stopped)]
    Stopped {
        /// Its part.
        role: Role,
    },
    /// The system has not what a session needs.
    #[error(transparent)]
    Resources(LinkError),
}

impl SupervisorError {
    /// Exit code of the command line's contract: 2 if the participant refused its input, else 3.
    #[must_use]
    pub const fn exit_code(&self) -> i32 {
        match self {
            Self::ParticipantDied {
                how: Ending::Exit(2),
                ..
            } => 2,
            _ => 3,
        }
    }
}

fn quoted(stderr: &str) -> String {
    let lines: Vec<_> = stderr.trim().lines().collect();
    let last = lines[lines.len().saturating_sub(QUOTED_LINES)..].join("\n");
    if last.is_empty() {
        String::new()
    } else {
        format!("; it said: {last}")
    }
}

/// A running child.
struct Running {
    role: Role,
    child: Child,
    owner: Owner,
    completes_with: Vec<i32>,
    stdin: Option<ChildStdin>,
    stdout: Option<JoinHandle<Vec<u8>>>,
    stderr: Option<JoinHandle<String>>,
    ending: Option<Ending>,
    /// Since when it is seen to be stopped.
    stopped: Option<Instant>,
}

impl Running {
    /// True if it is stopped, and has been for as long as that.
    fn is_stalled(&mut self, timeout: Duration) -> bool {
        if self.ending.is_some() || !is_stopped(self.child.id()) {
            self.stopped = None;
            return false;
        }
        self.stopped.get_or_insert_with(Instant::now).elapsed() >= timeout
    }

    fn start(participant: Participant) -> Result<Self, SupervisorError> {
        let Participant {
            role,
            mut command,
            completes_with,
            forward_stderr,
            capture_stdout,
        } = participant;
        command
            .env(SUPERVISED, "1")
            .stdin(Stdio::piped())
            .stderr(Stdio::piped());
        // An interrupt from the terminal ends the supervisor alone; its children then leave in
        // good order.
        command.process_group(0);
        if capture_stdout {
            command.stdout(Stdio::piped());
        }
        let mut child = command.spawn().map_err(|cause| {
            let program = command.get_program().to_string_lossy();
            SupervisorError::CouldNotStart {
                role,
                cause: format!("{program}: {cause}"),
            }
        })?;
        let stdout = child.stdout.take().filter(|_| capture_stdout);
        Ok(Self {
            role,
            completes_with,
            stdin: child.stdin.take(),
            stdout: stdout.map(|pipe| std::thread::spawn(move || read_all(pipe))),
            stderr: child
                .stderr
                .take()
                .map(|pipe| std::thread::spawn(move || read_tail(pipe, forward_stderr))),
            owner: Owner::of_child(child.id()),
            child,
            ending: None,
            stopped: None,
        })
    }

    /// Looks whether the child has ended; true if it has.
    fn poll(&mut self) -> bool {
        if self.ending.is_none() {
            // Waiting for one's own child fails only when it is gone already.
            let status = self
                .child
                .try_wait()
                .unwrap_or(Some(ExitStatus::from_raw(0)));
            self.ending = status.map(Ending::of);
        }
        self.ending.is_some()
    }

    /// How it failed, if it did.
    fn failure(&self) -> Option<Ending> {
        self.ending.filter(
            |ending| !matches!(ending, Ending::Exit(code) if self.completes_with.contains(code)),
        )
    }

    fn stderr(&mut self) -> String {
        self.stderr
            .take()
            .and_then(|thread| thread.join().ok())
            .unwrap_or_default()
    }

    fn finished(mut self) -> Finished {
        let code = match self.ending {
            Some(Ending::Exit(code)) => code,
            _ => EXIT_DIED,
        };
        let stdout = self.stdout.take().and_then(|thread| thread.join().ok());
        Finished {
            role: self.role,
            code,
            stdout: stdout.unwrap_or_default(),
            stderr: self.stderr(),
        }
    }
}

fn read_all(mut pipe: ChildStdout) -> Vec<u8> {
    let mut bytes = Vec::new();
    // A pipe that breaks ends what can be known.
    let _ = pipe.read_to_end(&mut bytes);
    bytes
}

fn read_tail(pipe: ChildStderr, forward: bool) -> String {
    let mut pipe = BufReader::new(pipe);
    let (mut tail, mut line) = (Vec::new(), Vec::new());
    while matches!(pipe.read_until(b'\n', &mut line), Ok(1..)) {
        if forward {
            // Nobody reads our own standard error: nothing to be done about it.
            let _ = std::io::stderr().write_all(&line);
        }
        tail.append(&mut line);
        let surplus = tail.len().saturating_sub(TAIL);
        tail.drain(..surplus);
    }
    String::from_utf8_lossy(&tail).into_owned()
}

/// A set of running child processes. Dropping it ends them and cleans up.
pub struct Supervisor {
    session: SessionId,
    children: Vec<Running>,
    stall_timeout: Duration,
}

impl Supervisor {
    /// Starts all participants.
    ///
    /// # Errors
    /// [`SupervisorError::CouldNotStart`]; those already started are ended again.
    pub fn start(
        session: &SessionId,
        participants: Vec<Participant>,
    ) -> Result<Self, SupervisorError> {
        crate::quieten();
        resources::check().map_err(SupervisorError::Resources)?;
        await_management();
        heal();
        let mut supervisor = Self {
            session: session.clone(),
            children: Vec::new(),
            stall_timeout: STALL_TIMEOUT,
        };
        for participant in participants {
            supervisor.children.push(Running::start(participant)?);
        }
        Ok(supervisor)
    }

    /// How long a child may be stopped by a signal, instead of 30 s.
    #[must_use]
    pub const fn stall_timeout(mut self, timeout: Duration) -> Self {
        self.stall_timeout = timeout;
        self
    }

    /// The process id of a participant.
    #[must_use]
    pub fn pid(&self, role: Role) -> Option<u32> {
        self.children
            .iter()
            .find(|running| running.role == role)
            .map(|r| r.child.id())
    }

    /// Waits until all have completed, or until the first one fails; in that case ends the others.
    /// Either way nothing of the session is left when it returns.
    ///
    /// # Errors
    /// [`SupervisorError::ParticipantDied`] names the first that failed.
    pub fn wait(mut self) -> Result<Vec<Finished>, SupervisorError> {
        let mut blame_until = None;
        loop {
            let running = self.poll();
            let culprit = self.culprit();
            let until = *blame_until.get_or_insert_with(|| Instant::now() + BLAME_TIME);
            match culprit {
                Some((at, how)) if how.blame() > 0 || Instant::now() >= until || !running => {
                    return Err(self.died(at, how));
                }
                Some(_) => {}
                None if !running => break,
                None => blame_until = None,
            }
            let timeout = self.stall_timeout;
            let mut children = self.children.iter_mut();
            if let Some(role) =
                children.find_map(|child| child.is_stalled(timeout).then_some(child.role))
            {
                self.end();
                return Err(SupervisorError::Stopped { role });
            }
            std::thread::sleep(PERIOD);
        }
        self.clean();
        Ok(std::mem::take(&mut self.children)
            .into_iter()
            .map(Running::finished)
            .collect())
    }

    /// True while some child is running.
    fn poll(&mut self) -> bool {
        self.children
            .iter_mut()
            .fold(false, |any, child| any | !child.poll())
    }

    /// The failed child that most likely caused the others to fail.
    fn culprit(&self) -> Option<(usize, Ending)> {
        let failed = self.children.iter().enumerate();
        let failed = failed.filter_map(|(at, child)| Some((at, child.failure()?)));
        failed.rev().max_by_key(|(_, ending)| ending.blame())
    }

    /// Ends the others, now that the child at index `at` has failed.
    fn died(&mut self, at: usize, how: Ending) -> SupervisorError {
        self.end();
        let child = &mut self.children[at];
        let (role, stderr) = (child.role, child.stderr());
        SupervisorError::ParticipantDied { role, how, stderr }
    }

    /// Ends and reaps all children, then cleans up.
    fn end(&mut self) {
        self.children
            .iter_mut()
            .for_each(|child| drop(child.stdin.take()));
        let start = Instant::now();
        while self.poll() && start.elapsed() < GRACE {
            std::thread::sleep(PERIOD);
        }
        for running in self
            .children
            .iter_mut()
            .filter(|running| running.ending.is_none())
        {
            // Killing fails only for one that has just ended; both ways there is one to reap.
            let _ = running.child.kill();
            running.ending = running.child.wait().ok().map(Ending::of);
        }
        self.clean();
    }

    fn clean(&self) {
        sweep(
            &self.session,
            &self.children.iter().map(|running| running.owner).collect(),
        );
    }
}

impl Drop for Supervisor {
    fn drop(&mut self) {
        if self.children.iter().any(|child| child.ending.is_none()) {
            self.end();
        }
    }
}

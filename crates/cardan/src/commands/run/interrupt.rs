//! Ctrl-C, and whoever else asks the run to end: it ends in good order, with its files complete up
//! to then, and afterwards as the signal would have ended it.

use std::sync::atomic::{AtomicBool, AtomicI32, Ordering};
use std::sync::{Arc, OnceLock};

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::{flag, low_level};

static CAME: OnceLock<[(i32, Arc<AtomicBool>); 2]> = OnceLock::new();
static FIRST: AtomicI32 = AtomicI32::new(0);

/// Takes signals from now on; a second one ends the process at once.
pub(super) fn listen() {
    CAME.get_or_init(|| {
        [SIGINT, SIGTERM].map(|signal| {
            let came = Arc::new(AtomicBool::new(false));
            // The system refuses only signals that cannot be caught.
            let _ = flag::register_conditional_default(signal, Arc::clone(&came));
            let _ = flag::register(signal, Arc::clone(&came));
            (signal, came)
        })
    });
}

/// Whether the run is to end.
pub(super) fn came() -> bool {
    let Some(signals) = CAME.get() else {
        return false;
    };
    let found = signals
        .iter()
        .find(|(_, came)| came.load(Ordering::Relaxed));
    if let Some(&(signal, _)) = found {
        FIRST.store(signal, Ordering::Relaxed);
    }
    found.is_some()
}

/// Ends the process as the signal would have, if one came.
pub(super) fn end_as_asked() {
    let signal = FIRST.load(Ordering::Relaxed);
    if signal != 0 {
        // What it refuses to do leaves us where we are: the run is complete.
        let _ = low_level::emulate_default_handler(signal);
    }
}

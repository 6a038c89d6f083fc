//! What can go wrong with the board: parameters that give no design, calls out of order.

/// The front end cannot do what it is asked.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// Parameters that each are admissible give no working board together.
    #[error("scenario key {key}: {message}")]
    Design {
        /// The key or keys to change.
        key: String,
        /// What is wrong and what is expected.
        message: String,
    },
    /// An edge or a reading lies before what has been computed already.
    #[error("the front end is at cycle {reached}, but was given an event at cycle {cycle}")]
    OutOfOrder {
        /// The late event.
        cycle: u64,
        /// What has been computed or pushed.
        reached: u64,
    },
}

impl Error {
    pub(crate) fn design(key: &str, message: &str) -> Self {
        Error::Design {
            key: key.into(),
            message: message.into(),
        }
    }
}

//! Frames of the protocol: `$body#checksum`, acknowledgements, the interrupt byte.
//!
//! `gdbstub` ends a session at the first damaged or unknown packet; here they are sorted out before
//! it sees them, as the protocol describes: damaged ones are asked for again, a reply that did not
//! arrive is repeated.

use super::PACKET_BYTES;

/// Bytes around a body.
pub(super) const OVERHEAD: usize = 4;
/// The client interrupts the program.
const INTERRUPT: u8 = 3;

/// What has come in.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Frame {
    /// A packet whose checksum is right, or the interrupt byte.
    Good(Vec<u8>),
    /// A packet that was damaged on its way, or is too long.
    Damaged,
    /// The client did not understand the last reply.
    Repeat,
}

/// Collects frames; remembers what a repetition needs.
#[derive(Debug, Default)]
pub(super) struct Framing {
    frame: Vec<u8>,
    /// Bytes of the checksum still to come, after `#`.
    checksum_left: Option<u8>,
    /// The client wants no acknowledgements.
    is_unacknowledged: bool,
    last_reply: Vec<u8>,
}

impl Framing {
    /// Takes a byte from the client.
    pub(super) fn take(&mut self, byte: u8) -> Option<Frame> {
        if self.frame.is_empty() {
            return match byte {
                b'$' => {
                    self.frame.push(byte);
                    None
                }
                INTERRUPT => Some(Frame::Good(vec![byte])),
                b'-' if !self.is_unacknowledged => Some(Frame::Repeat),
                // Acknowledgements, and noise between packets.
                _ => None,
            };
        }
        if self.frame.len() < PACKET_BYTES + OVERHEAD {
            self.frame.push(byte);
        }
        self.checksum_left = match self.checksum_left {
            None if byte == b'#' => Some(2),
            None if byte == b'$' => {
                // A `$` within a body is escaped: this is the next packet, the one before was cut.
                self.frame = vec![byte];
                None
            }
            None => None,
            Some(2) => Some(1),
            Some(_) => return Some(self.complete()),
        };
        None
    }

    fn complete(&mut self) -> Frame {
        self.checksum_left = None;
        let frame = std::mem::take(&mut self.frame);
        let body = frame
            .len()
            .checked_sub(OVERHEAD)
            .map(|size| &frame[1..=size]);
        let sent = frame.last_chunk().and_then(|digits: &[u8; 2]| {
            let text = std::str::from_utf8(digits).ok()?;
            u8::from_str_radix(text, 16).ok()
        });
        match body {
            Some(body) if sent == Some(checksum(body)) => {
                self.is_unacknowledged |= body == b"QStartNoAckMode";
                Frame::Good(frame)
            }
            _ => Frame::Damaged,
        }
    }

    /// Remembers a reply.
    pub(super) fn keep_reply(&mut self, reply: &[u8]) {
        self.last_reply = reply.to_vec();
    }

    /// The reply to be repeated.
    pub(super) fn last_reply(&self) -> &[u8] {
        &self.last_reply
    }

    /// The reply to a packet that is not understood.
    pub(super) fn refusal(&mut self) -> Vec<u8> {
        // The protocol's machine starts anew and acknowledges from here on, which does no harm.
        let mut reply = b"+$E01#".to_vec();
        reply.extend(format!("{:02x}", checksum(b"E01")).bytes());
        self.last_reply.clone_from(&reply);
        reply
    }
}

fn checksum(body: &[u8]) -> u8 {
    body.iter().fold(0, |sum, byte| sum.wrapping_add(*byte))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames(bytes: &[u8]) -> Vec<Frame> {
        let mut framing = Framing::default();
        bytes
            .iter()
            .filter_map(|&byte| framing.take(byte))
            .collect()
    }

    #[test]
    fn packets_are_cut_out_of_noise() {
        let found = frames(b"+noise$g#67+\x03$?#3f");
        let good = |bytes: &[u8]| Frame::Good(bytes.to_vec());
        assert_eq!(found, [good(b"$g#67"), good(b"\x03"), good(b"$?#3f")]);
    }

    #[test]
    fn damage_is_noticed_and_a_cut_packet_gives_way_to_the_next() {
        assert_eq!(frames(b"$g#68"), [Frame::Damaged]);
        assert_eq!(frames(b"$g#xy-"), [Frame::Damaged, Frame::Repeat]);
        assert_eq!(frames(b"$m0,4$g#67"), [Frame::Good(b"$g#67".to_vec())]);
        let long = [&b"$"[..], &[b'a'; 2 * PACKET_BYTES], b"#00"].concat();
        assert_eq!(frames(&long), [Frame::Damaged]);
    }
}

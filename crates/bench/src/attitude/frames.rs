//! Frames off the wire, as the golden side reads them, and what they carry.

use super::tuning::rotation_error;
use cardan_golden::frame::{Frame, FrameError, decode as decode_golden};
use cardan_outputs::{Combined, Group, Member, Message, Outputs, Quantity, Shown, StatusBit};
use cardan_spec::frame::FRAC;
use cardan_spec::nodes::{AVERAGE, PITCH, ROLL, SharedNode, YAW};
use cardan_spec::timing::Averaging;
use cardan_spec::{CHANNELS, Channel, MOST_CHANNELS, flags};

/// Names of the averages, in the order of the frame.
const AVERAGES: [&str; CHANNELS] = [
    "average_tilt_x",
    "average_tilt_y",
    "average_field_x",
    "average_field_y",
];

/// A whole frame.
pub(super) fn decode_frame(bytes: &[u8]) -> Result<Frame, FrameError> {
    decode_golden(bytes)
}

/// A frame as a message with the quantities of [`outputs`].
pub(super) fn decode(bytes: &[u8]) -> Result<Message, String> {
    let frame = decode_frame(bytes).map_err(|error| error.to_string())?;
    Ok(Message {
        sequence: frame.sequence.into(),
        values: (frame.averages.into_iter())
            .chain(frame.angles)
            .chain(frame.tilt_z)
            .collect(),
        status: frame.status.into(),
    })
}

/// What a frame carries; the third tilt axis comes last, where it is measured.
pub(super) fn outputs(averaging: Averaging) -> Outputs {
    let step = 1.0 / f64::from(1_u32 << FRAC);
    let quantity = |name: &str, node: &SharedNode, write: usize| Quantity {
        name: name.to_owned(),
        node: node.name.to_owned(),
        write,
        unit: node.unit.to_owned(),
        period: None,
        step,
        in_flagged: true,
    };
    let angle = |node: &SharedNode| Quantity {
        period: Some(2.0),
        in_flagged: false,
        ..quantity(node.name, node, 0)
    };
    let averages = AVERAGES.iter().enumerate();
    let averages = averages.map(|(write, name)| quantity(name, &AVERAGE, write));
    let is_measured = averaging.channels() == MOST_CHANNELS;
    let tilt_z = is_measured.then(|| quantity("average_tilt_z", &AVERAGE, Channel::TiltZ as usize));
    Outputs {
        quantities: averages
            .chain([&YAW, &PITCH, &ROLL].map(angle))
            .chain(tilt_z)
            .collect(),
        status: flags::NAMES
            .iter()
            .map(|&(mask, name)| StatusBit {
                name: name.to_owned(),
                mask: mask.into(),
            })
            .collect(),
        sequence_modulus: 1 << 16,
        group: Some(group()),
    }
}

/// The attitude, which is followed along the chain.
pub(super) fn group() -> Group {
    let member = |node: &SharedNode| Member {
        name: node.name.to_owned(),
        node: node.name.to_owned(),
        scale: 180.0,
        period: Some(2.0),
    };
    Group {
        key: "attitude".to_owned(),
        title: "Attitude".to_owned(),
        note: "Angles of set 1 (Z-Y-X); total is the angle of the rotation between two attitudes. \
               Solutions that the firmware flags are shown and counted apart; models do not judge them."
            .to_owned(),
        member: "angle".to_owned(),
        unit: Shown {
            suffix: "deg".into(),
            symbol: "°".into(),
            words: "degrees".into(),
        },
        members: [&YAW, &PITCH, &ROLL].map(member).to_vec(),
        combined: Some(Combined {
            name: "total".to_owned(),
            what: "rotation".to_owned(),
            error: rotation_error,
        }),
    }
}

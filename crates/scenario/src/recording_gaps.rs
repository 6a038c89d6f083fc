//! Gaps of a recording: times without a sample, across which nobody knows the motion.

use crate::recording_file::Row;

/// Seconds after which the device has forgotten a gap: its low-pass filters of 28 and 50 Hz.
const FORGOTTEN_S: f64 = 0.1;

/// A time without a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Gap {
    from_s: f64,
    to_s: f64,
    /// Line of the file after which nothing comes.
    line: u64,
}

/// All longer than `longest_s`, in order.
pub(crate) fn find(rows: &[Row], longest_s: f64) -> Vec<Gap> {
    let pairs = rows.windows(2);
    let long = pairs.filter(|pair| pair[1].t_s - pair[0].t_s > longest_s);
    long.map(|pair| Gap {
        from_s: pair[0].t_s,
        to_s: pair[1].t_s,
        line: pair[0].line,
    })
    .collect()
}

/// Whether one of them lies between these instants, or is not yet forgotten.
pub(crate) fn touch(gaps: &[Gap], from_s: f64, to_s: f64) -> bool {
    let first = gaps.partition_point(|gap| gap.to_s + FORGOTTEN_S <= from_s);
    gaps.get(first).is_some_and(|gap| gap.from_s < to_s)
}

/// The gaps in words, with the first and the longest of them; none if there are none.
pub(crate) fn remark(gaps: &[Gap], longest_s: f64) -> Option<String> {
    let length = |gap: &Gap| gap.to_s - gap.from_s;
    let longest = gaps.iter().max_by(|a, b| length(a).total_cmp(&length(b)))?;
    let total: f64 = gaps.iter().map(length).sum();
    Some(format!(
        "the recording has {} {} of more than {longest_s:.4} s, {total:.3} s in all, the longest of {:.3} s \
         after line {} ({:.3} s); solutions that see one are not compared with the truth \
         (motion.recording.longest_gap_s)",
        gaps.len(),
        if gaps.len() == 1 { "gap" } else { "gaps" },
        length(longest),
        longest.line,
        longest.from_s,
    ))
}

/// The same for the report: key, value, how.
pub(crate) fn note(gaps: &[Gap], longest_s: f64) -> Option<(&'static str, String, String)> {
    let how = remark(gaps, longest_s)?;
    let value = format!("{longest_s:.4} s");
    Some(("motion.recording.longest_gap_s", value, how))
}

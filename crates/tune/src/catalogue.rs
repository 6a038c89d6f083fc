//! Names, and what was probably meant by one that does not exist.

/// The known name most like `name`, if any is like it.
pub(crate) fn suggestion<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    const LEAST_SIMILARITY: f64 = 0.7;
    let scored = known.map(|known| (strsim::jaro_winkler(name, known), known));
    scored
        .filter(|(score, _)| *score >= LEAST_SIMILARITY)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, known)| known)
}

/// The end of a message on an unknown name.
pub(crate) fn mend<'a>(name: &str, known: impl Iterator<Item = &'a str> + Clone) -> String {
    let list: Vec<&str> = known.clone().collect();
    let list = list.join(", ");
    match suggestion(name, known) {
        Some(meant) => format!("did you mean '{meant}'? Known are: {list}"),
        None => format!("known are: {list}"),
    }
}

//! Numbers as people read them.

/// Three significant digits, with an exponent only where plain digits would be long.
#[must_use]
pub fn number(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    if !value.is_finite() {
        return "undefined".to_owned();
    }
    // The exponent after rounding, so that 0.9999 becomes 1.00 and not 1.000.
    let scientific = format!("{value:.2e}");
    let exponent: i32 = scientific
        .rsplit_once('e')
        .and_then(|(_, exponent)| exponent.parse().ok())
        .unwrap_or(0);
    if !(-4..6).contains(&exponent) {
        return scientific;
    }
    let decimals = (2 - exponent).max(0) as usize;
    format!("{value:.decimals$}")
}

/// [`number`], or a dash where the value is undefined.
#[must_use]
pub fn optional(value: Option<f64>) -> String {
    value.map_or_else(|| "–".to_owned(), number)
}

/// A fraction as a percentage with few digits.
#[must_use]
pub fn percent(fraction: f64) -> String {
    if fraction != 0.0 && fraction.abs() < 0.1 {
        format!("{:.1} %", 100.0 * fraction)
    } else {
        format!("{:.0} %", 100.0 * fraction)
    }
}

/// A count with thousands set apart by commas.
#[must_use]
pub fn count(value: u64) -> String {
    let digits = value.to_string();
    let mut out = String::with_capacity(digits.len() + digits.len() / 3);
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

/// Bytes as hexadecimal digits, two each.
#[must_use]
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_three_digits_and_counts_are_grouped() {
        for (value, text) in [
            (0.0, "0"),
            (1.0, "1.00"),
            (-0.012345, "-0.0123"),
            (12345.6, "12346"),
            (0.999_96, "1.00"),
            (1.5e-7, "1.50e-7"),
            (f64::NAN, "undefined"),
        ] {
            assert_eq!(number(value), text);
        }
        for (value, text) in [(7, "7"), (1234, "1,234"), (1_234_567, "1,234,567")] {
            assert_eq!(count(value), text);
        }
        assert_eq!(hex(&[0, 0xAB]), "00ab");
        assert_eq!(percent(0.012), "1.2 %");
        assert_eq!(percent(0.72), "72 %");
    }
}

//! Sizes in bytes as people write them.

use std::fmt;

/// Parses `8MiB`, `64M`, `1GiB`, `4096`; K, M and G are binary, alone and with `iB`. `8MB` has 8,000,000 bytes.
///
/// # Errors
/// A sentence on the accepted forms.
pub fn parse_size(text: &str) -> Result<u64, String> {
    let trimmed = text.trim();
    let split = trimmed.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(trimmed.len());
    let (number, unit) = trimmed.split_at(split);
    let unit = unit.trim().to_ascii_lowercase();
    let step = if unit.len() == 2 { 1000.0_f64 } else { 1024.0 };
    let steps = match unit.as_str() {
        "" | "b" => 0,
        "k" | "kb" | "kib" => 1,
        "m" | "mb" | "mib" => 2,
        "g" | "gb" | "gib" => 3,
        "t" | "tb" | "tib" => 4,
        _ => return Err(format!("'{text}' is not a size; write for example 8MiB, 64M or 1GiB")),
    };
    let value: f64 =
        number.parse().map_err(|_| format!("'{text}' is not a size; write for example 8MiB, 64M or 1GiB"))?;
    let bytes = value * step.powi(steps);
    if !(1.0..1e18).contains(&bytes) {
        return Err(format!("'{text}' is out of range for a size"));
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked to lie in 1..1e18")]
    Ok(bytes as u64)
}

/// A byte count for people: `8.0 MiB`.
#[derive(Clone, Copy, Debug)]
pub struct Bytes(
    /// Number of bytes.
    pub u64,
);

impl fmt::Display for Bytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut value = self.0 as f64;
        let mut unit = "B";
        for next in ["KiB", "MiB", "GiB", "TiB"] {
            if value < 1024.0 {
                break;
            }
            value /= 1024.0;
            unit = next;
        }
        if unit == "B" { write!(f, "{} B", self.0) } else { write!(f, "{value:.2} {unit}") }
    }
}

/// A byte count in the syntax of [`parse_size`], rounded up: `6784KiB`, `8MiB`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SizeArgument(
    /// Number of bytes.
    pub u64,
);

impl fmt::Display for SizeArgument {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0.div_ceil(1 << 10) {
            kib if kib.is_multiple_of(1 << 20) => write!(f, "{}GiB", kib >> 20),
            kib if kib.is_multiple_of(1 << 10) => write!(f, "{}MiB", kib >> 10),
            kib => write!(f, "{kib}KiB"),
        }
    }
}

/// A byte count as it was typed: not rounded, in the greatest unit that divides it.
#[derive(Clone, Copy, Debug)]
pub struct ExactSize(
    /// Number of bytes.
    pub u64,
);

impl fmt::Display for ExactSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0 > 0 && self.0.is_multiple_of(1 << 10) {
            return SizeArgument(self.0).fmt(f);
        }
        self.0.fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_parse_in_the_units_that_are_written() {
        assert_eq!(parse_size("8MiB"), Ok(8 << 20));
        assert_eq!(parse_size("64M"), Ok(64 << 20));
        assert_eq!(parse_size("1GiB"), Ok(1 << 30));
        assert_eq!(parse_size("1.5k"), Ok(1536));
        assert_eq!(parse_size("4096"), Ok(4096));
        assert_eq!(parse_size("8MB"), Ok(8_000_000));
        assert_eq!(parse_size("1.5 kB"), Ok(1500));
        for bad in ["", "MiB", "8 parsecs", "-1", "0", "1e400", "nan"] {
            assert!(parse_size(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn sizes_for_the_command_line_are_read_back_and_never_less() {
        for (bytes, text) in [(8 << 20, "8MiB"), (1 << 30, "1GiB"), (6_946_817, "6785KiB"), (1, "1KiB")] {
            assert_eq!(SizeArgument(bytes).to_string(), text);
            assert!(parse_size(text).unwrap() >= bytes);
        }
        for (bytes, text) in [(1, "1"), (1025, "1025"), (2048, "2KiB"), (8 << 20, "8MiB")] {
            assert_eq!(ExactSize(bytes).to_string(), text);
            assert_eq!(parse_size(text), Ok(bytes));
        }
    }
}

//! Numbers for people, with their significant digits only. JSON has them in full.

use std::fmt;

/// Digits of a number that is not whole.
const DIGITS: i32 = 6;

/// A number shown with at most six digits; whole numbers below 10^15 are shown in full.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Short(pub f64);

impl fmt::Display for Short {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let value = self.0;
        if !value.is_finite() || (value.fract() == 0.0 && value.abs() < 1e15) {
            return write!(f, "{value}");
        }
        write_rounded(f, value, DIGITS - 1 - power(value))
    }
}

/// A measured number, shown with four digits, and with all digits before the point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rounded(pub f64);

impl fmt::Display for Rounded {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let places = (3 - power(self.0)).max(0);
        if self.0.is_finite() && places <= 12 {
            write_rounded(f, self.0, places)
        } else {
            Short(self.0).fmt(f)
        }
    }
}

/// A number and its error, rounded to the same place: the error to two digits.
#[derive(Clone, Copy, Debug)]
pub(crate) struct WithError {
    pub value: f64,
    pub error: f64,
}

impl fmt::Display for WithError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { value, error } = *self;
        if !(error > 0.0 && error.is_finite() && value.is_finite()) {
            return Short(value).fmt(f);
        }
        let places = 1 - power(error);
        write_rounded(f, value, places)?;
        f.write_str(" ± ")?;
        write_rounded(f, error, places)
    }
}

/// A count and its noun, which has its plural unless the count is 1: of nouns in -y after a consonant, -f and regular ones.
#[derive(Clone, Copy, Debug)]
pub struct Count<N>(
    /// The count.
    pub N,
    /// The noun's singular.
    pub &'static str,
);

impl<N: fmt::Display + PartialEq + From<u8>> fmt::Display for Count<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(count, noun) = self;
        let ends = [("y", "ies"), ("f", "ves"), ("", "s")];
        let plural = ends.iter().find_map(|(end, ends)| Some((noun.strip_suffix(end)?, *ends)));
        let (stem, end) = plural.filter(|_| *count != N::from(1)).unwrap_or((noun, ""));
        write!(f, "{count} {stem}{end}")
    }
}

/// A title of a name and a size: the sides of the box around the model, in mm, to three digits or whole ones.
pub(crate) fn size_title(name: impl fmt::Display, support: impl Fn([f64; 3]) -> f64) -> String {
    let side = |axis: usize| {
        let mut direction = [0.0; 3];
        direction[axis] = 1.0;
        let mm = support(direction) + support(direction.map(|c| -c));
        let unit = if mm > 0.0 { 10_f64.powf(mm.log10().floor() - 2.0).min(1.0) } else { 1.0 };
        Short((mm / unit).round() * unit).to_string()
    };
    format!("{name} · {} × {} × {} mm", side(0), side(1), side(2))
}

/// A number rounded to a thousandth of the power of ten of a range, for marks along it.
pub(crate) fn mark(value: f64, range: f64) -> Short {
    let unit = 10_f64.powi((3 - power(range)).clamp(-300, 300));
    let rounded = (value * unit).round() / unit;
    Short(if rounded.is_finite() { rounded + 0.0 } else { value })
}

/// Power of ten of the first digit.
fn power(value: f64) -> i32 {
    let text = format!("{value:e}");
    text.split_once('e').and_then(|(_, power)| power.parse().ok()).unwrap_or(0)
}

/// Writes a number rounded to a place after (or, below 0, before) the decimal point, without zeros at the end.
fn write_rounded(f: &mut fmt::Formatter<'_>, value: f64, places: i32) -> fmt::Result {
    if !(-12..=12).contains(&places) {
        return write!(f, "{value:.0$e}", usize::try_from(DIGITS - 1).unwrap_or(0));
    }
    if places <= 0 {
        let unit = 10_f64.powi(-places);
        return write!(f, "{:.0}", (value / unit).round() * unit);
    }
    let text = format!("{value:.0$}", usize::try_from(places).unwrap_or(0));
    f.write_str(text.trim_end_matches('0').trim_end_matches('.'))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn titles_state_sizes_to_three_digits_or_whole_millimetres() {
        let sides = [1234.5, 4.1239, 0.048_82];
        let support = |d: [f64; 3]| d.iter().zip(sides).map(|(d, side)| d.max(0.0) * side).sum();
        assert_eq!(size_title("a", support), "a · 1235 × 4.12 × 0.0488 mm");
        assert_eq!(size_title("a", |d: [f64; 3]| 155.159 / 2.0 * d[0].abs()), "a · 155 × 0 × 0 mm");
    }

    #[test]
    fn measured_numbers_have_four_digits_and_all_before_the_point() {
        let numbers = [0.002_969_64, -1.234_56, 12_345.6, 100.0, 0.0, 1e-20, f64::INFINITY];
        let texts = numbers.map(|number| Rounded(number).to_string());
        assert_eq!(
            texts,
            ["0.00297", "-1.235", "12346", "100", "0", "1.00000e-20", "inf"].map(str::to_owned)
        );
    }

    #[test]
    fn marks_have_the_digits_of_their_range() {
        let marks = [
            (39.9997, 39.9997),
            (29.999_775, 39.9997),
            (37.5, 150.0),
            (-0.025, 0.1),
            (-1e-9, 4.0),
            (1234.56, 1234.56),
        ];
        let texts = marks.map(|(value, range)| mark(value, range).to_string());
        assert_eq!(texts, ["40", "30", "37.5", "-0.025", "0", "1235"].map(str::to_owned));
    }

    #[test]
    fn numbers_have_the_digits_that_mean_something() {
        for (value, text) in [
            (471.435_653_235_652_47, "471.436"),
            (0.488_281_25, "0.488281"),
            (-1024.0, "-1024"),
            (0.1 + 0.2, "0.3"),
            (1e9, "1000000000"),
            (123_456_789.25, "123457000"),
            (1.0e-20, "1.00000e-20"),
            (f64::INFINITY, "inf"),
        ] {
            assert_eq!(Short(value).to_string(), text);
        }
        let both = |value, error| WithError { value, error }.to_string();
        assert_eq!(both(2_827.433_388, 61.83), "2827 ± 62");
        assert_eq!(both(14_137.166, 1234.5), "14100 ± 1200");
        assert_eq!(both(0.012_346, 0.000_67), "0.01235 ± 0.00067");
        assert_eq!(both(5.0, 0.0), "5");
        for (count, noun, text) in [
            (0, "pore", "0 pores"),
            (1, "label", "1 label"),
            (2, "larger leaf", "2 larger leaves"),
            (1, "body", "1 body"),
            (3, "body", "3 bodies"),
        ] {
            assert_eq!(Count(count, noun).to_string(), text);
        }
    }
}

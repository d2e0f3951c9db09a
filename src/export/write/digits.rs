//! Numbers as text, several times as fast as by formatting: the same text, or another one of equal value.

/// Powers of ten by which a single can be multiplied without rounding, in doubles.
const TENS: [f64; 10] = [1.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9];
/// Limit from which numbers are left to formatting.
const LARGE: f32 = 1e7;

/// Appends a whole number.
pub(super) fn whole(out: &mut Vec<u8>, mut number: u64) {
    let mut digits = [0; 20];
    let mut at = digits.len();
    loop {
        at -= 1;
        digits[at] = b'0' + u8::try_from(number % 10).unwrap_or(0);
        number /= 10;
        if number == 0 {
            break;
        }
    }
    out.extend_from_slice(&digits[at..]);
}

/// Appends a number given in units of its last decimal, with `decimals` digits behind the point; 0 for a whole number.
fn parts(out: &mut Vec<u8>, negative: bool, parts: u64, decimals: usize) {
    if negative {
        out.push(b'-');
    }
    let unit = 10_u64.pow(u32::try_from(decimals).unwrap_or(0));
    whole(out, parts / unit);
    if decimals > 0 {
        out.push(b'.');
        let start = out.len();
        whole(out, unit + parts % unit);
        // The leading 1 kept the places of zeros.
        out.remove(start);
    }
}

/// Appends the fewest decimals that are read back as this number.
pub(super) fn shortest(out: &mut Vec<u8>, number: f32) {
    let size = number.abs();
    if size < LARGE {
        for (decimals, tens) in TENS.iter().enumerate() {
            let rounded = (f64::from(size) * tens).round();
            #[expect(clippy::cast_possible_truncation, reason = "whether it is the same is asked")]
            let read = (rounded / tens) as f32;
            if read == size {
                #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "below 2^54")]
                return parts(out, number.is_sign_negative(), rounded as u64, decimals);
            }
        }
    }
    out.extend_from_slice(number.to_string().as_bytes());
}

/// Appends a number with four decimals.
pub(super) fn four_decimals(out: &mut Vec<u8>, number: f32) {
    if number.abs() < LARGE {
        let rounded = (f64::from(number.abs()) * TENS[4]).round_ties_even();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "below 2^37")]
        parts(out, number.is_sign_negative(), rounded as u64, 4);
    } else {
        out.extend_from_slice(format!("{number:.4}").as_bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    fn text(write: impl Fn(&mut Vec<u8>)) -> String {
        let mut out = Vec::new();
        write(&mut out);
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn numbers_are_the_text_that_formatting_makes() {
        let mut random = Random(5);
        let odd = [0.0, -0.0, 1.0, -1.5, 0.03125, 0.1, 16_777_216.0, 1e-7, 3.4e38, -9_999_999.5, 0.000_05];
        let numbers = std::iter::repeat_with(|| {
            let scale = random.pick(&[1e-6, 0.01, 1.0, 100.0, 1e5]);
            (random.below(1_u32 << 24) as f32 / 8_388_608.0 - 1.0) * scale
        });
        for number in odd.into_iter().chain(numbers.take(20_000)) {
            let shortest = text(|out| shortest(out, number));
            assert_eq!(shortest.parse::<f32>().unwrap().to_bits(), number.to_bits(), "{shortest}");
            assert!(shortest.len() <= number.to_string().len(), "{shortest} {number}");
            assert_eq!(text(|out| four_decimals(out, number)), format!("{number:.4}"));
        }
        for number in [0, 9, 10, 4_294_967_296, u64::MAX] {
            assert_eq!(text(|out| whole(out, number)), number.to_string());
        }
    }
}

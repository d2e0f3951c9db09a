//! Sines and cosines that are the same on every machine: the system's differ in the last bit, and pictures would, too.

/// Sine and cosine of at most some 90 degrees, by their series.
pub(crate) fn sin_cos_series(degrees: f64) -> [f64; 2] {
    let x = degrees * (std::f64::consts::PI / 180.0);
    let (mut sin, mut cos, mut term) = (0.0, 0.0, 1.0);
    for i in 0..32_u32 {
        let signed = if i % 4 < 2 { term } else { -term };
        if i % 2 == 0 {
            cos += signed;
        } else {
            sin += signed;
        }
        term *= x / f64::from(i + 1);
    }
    [sin, cos]
}

/// Sine and cosine of any finite angle; of multiples of 90 degrees exact.
pub(crate) fn sin_cos_deg(degrees: f64) -> [f64; 2] {
    let turns = degrees % 360.0;
    let quarters = (turns / 90.0).round();
    let [sin, cos] = sin_cos_series(turns - 90.0 * quarters);
    #[expect(clippy::cast_possible_truncation, reason = "-4 to 4")]
    match (quarters as i32).rem_euclid(4) {
        0 => [sin, cos],
        1 => [cos, -sin],
        2 => [-sin, -cos],
        _ => [-cos, sin],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sines_and_cosines_are_right_and_quarter_turns_exact() {
        for tenth in -9000..9000_i32 {
            let degrees = f64::from(tenth) / 10.0;
            let [sin, cos] = sin_cos_deg(degrees);
            let (s, c) = degrees.to_radians().sin_cos();
            assert!((sin - s).abs() < 1e-14 && (cos - c).abs() < 1e-14, "{degrees}: {sin} {cos}");
        }
        for (degrees, want) in [
            (0.0, [0.0, 1.0]),
            (90.0, [1.0, 0.0]),
            (-90.0, [-1.0, 0.0]),
            (180.0, [0.0, -1.0]),
            (720.0, [0.0, 1.0]),
        ] {
            assert_eq!(sin_cos_deg(degrees).map(|v| v + 0.0), want);
        }
    }
}

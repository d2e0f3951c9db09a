//! Normals in other numbers of bits than the format's 16: the same octahedral map, the same precise rounding.

/// The direction that a code of this many bits stands for: of the four codes around it the nearest one.
pub(super) fn rounded(normal: [f64; 3], bits: u32) -> [f64; 3] {
    let scale = f64::from((1_u32 << (bits / 2 - 1)) - 1);
    let size: f64 = normal.iter().map(|c| c.abs()).sum();
    let n = normal.map(|c| c / size);
    let sign = |v: f64| if v < 0.0 { -1.0 } else { 1.0 };
    let [u, v] = if n[2] < 0.0 {
        [(1.0 - n[1].abs()) * sign(n[0]), (1.0 - n[0].abs()) * sign(n[1])]
    } else {
        [n[0], n[1]]
    };
    let mut best = ([0.0; 3], f64::NEG_INFINITY);
    for corner in 0..4 {
        let at = |c: f64, up: bool| {
            ((c * scale).floor() + if up { 1.0 } else { 0.0 }).clamp(-scale, scale) / scale
        };
        let (a, b) = (at(u, corner & 1 == 1), at(v, corner & 2 == 2));
        let z = 1.0 - a.abs() - b.abs();
        let found =
            if z < 0.0 { [(1.0 - b.abs()) * sign(a), (1.0 - a.abs()) * sign(b), z] } else { [a, b, z] };
        let length = found.iter().map(|c| c * c).sum::<f64>().sqrt();
        let cosine = (0..3).map(|i| found[i] * n[i]).sum::<f64>() / length;
        if cosine > best.1 {
            best = (found, cosine);
        }
    }
    best.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::normal;
    use crate::random::Random;

    #[test]
    fn sixteen_bits_are_those_of_the_format_and_more_are_truer() {
        let mut random = Random(2);
        for _ in 0..20_000 {
            let n: [f64; 3] = [0; 3].map(|_: i32| f64::from(random.below(2001_u32)) - 1000.0);
            if n == [0.0; 3] {
                continue;
            }
            let length = n.iter().map(|c| c * c).sum::<f64>().sqrt();
            let cosine = |v: [f64; 3]| {
                let size = v.iter().map(|c| c * c).sum::<f64>().sqrt();
                (0..3).map(|i| v[i] * n[i]).sum::<f64>() / (size * length)
            };
            #[expect(clippy::cast_possible_truncation, reason = "single precision")]
            let stored = normal::decode(normal::encode(n.map(|c| c as f32))).map(f64::from);
            assert!((cosine(rounded(n, 16)) - cosine(stored)).abs() < 1e-6, "{n:?}");
            assert!(cosine(rounded(n, 24)) > 1.0 - 3e-7 && cosine(rounded(n, 12)) > 0.9989, "{n:?}");
        }
    }
}

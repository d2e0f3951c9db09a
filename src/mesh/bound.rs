//! Lower bounds of eight distances from triangles at once, in single precision: farther triangles need not be asked.

/// Number of distances computed at a time.
pub(super) const LANES: usize = 8;

/// Squared distances of the origin from triangles, given by their first corner and the edges to the others: at most by
/// a step too large. Zero for slivers.
#[inline(always)]
pub(super) fn at_least(t: &[[f32; LANES]; 9]) -> [f32; LANES] {
    let mut out = [0.0; LANES];
    for lane in 0..LANES {
        let at = |k: usize| [t[k][lane], t[k + 1][lane], t[k + 2][lane]];
        let (a, b, c) = (at(0), at(3), at(6));
        let dot = |p: [f32; 3], q: [f32; 3]| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
        let (bb, bc, cc) = (dot(b, b), dot(b, c), dot(c, c));
        let (ab, ac) = (-dot(a, b), -dot(a, c));
        let unit = |s: f32| {
            let s = if s > 0.0 { s } else { 0.0 };
            if s < 1.0 { s } else { 1.0 }
        };
        let square = |p: [f32; 3]| dot(p, p);
        // Places along both edges from the first corner, and along the third.
        let (s, u) = (unit(ab / (bb + 0.5)), unit(ac / (cc + 0.5)));
        let d = [c[0] - b[0], c[1] - b[1], c[2] - b[2]];
        let e = [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
        let v = unit(-dot(e, d) / (square(d) + 0.5));
        let along =
            |p: [f32; 3], s: f32, q: [f32; 3]| square([p[0] + s * q[0], p[1] + s * q[1], p[2] + s * q[2]]);
        let (one, other, third) = (along(a, s, b), along(a, u, c), along(e, v, d));
        let least = if one < other { one } else { other };
        let least = if third < least { third } else { least };
        // Within all three edges the plane is nearest.
        let n = [b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]];
        let (nn, height) = (square(n), dot(n, a));
        let (v, w) = (cc * ab - bc * ac, bb * ac - bc * ab);
        let inside = (v >= 0.0) & (w >= 0.0) & (v + w <= bb * cc - bc * bc);
        let plane = height * height / (nn + 1e-3);
        let least = if inside & (plane < least) { plane } else { least };
        let sliver = nn < 1e-4 * bb * cc;
        out[lane] = if sliver { 0.0 } else { least };
    }
    out
}

#[cfg(test)]
mod tests {
    use super::super::lattice::Triangle;
    use super::super::nearest::{Facet, Nearest};
    use super::*;

    #[test]
    fn bounds_are_near_to_the_distance_and_hardly_beyond_it() {
        let mut state = 5_u32;
        let mut next = |n: u32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            i32::try_from((state >> 9) % n).unwrap()
        };
        let (mut near, mut all) = (0, 0);
        for round in 0..20_000 {
            // Very small triangles and slivers are among them.
            let size = [5000, 300, 7, 5000][round % 4];
            let mut ways: [i32; 6] = std::array::from_fn(|_| next(size) - next(size));
            if round % 16 == 3 {
                ways = std::array::from_fn(|k| if k < 3 { ways[k] } else { ways[k - 3] / 2 + next(3) });
            }
            let a: [i32; 3] = std::array::from_fn(|_| next(16_000) - 8000);
            let t: Triangle = std::array::from_fn(|k| if k < 3 { a[k] } else { a[k % 3] + ways[k - 3] });
            let Some(facet) = Facet::new(&t) else { continue };
            let mut best = Nearest::within(1e12);
            best.offer(&facet, [0.0; 3]);
            let corners =
                std::array::from_fn(|k| [if k < 3 { a[k] as f32 } else { ways[k - 3] as f32 }; LANES]);
            let (got, want) = (f64::from(at_least(&corners)[round % LANES]).sqrt(), best.distance());
            assert!(got <= want + 1.5, "{t:?}: {got} {want}");
            near += u32::from(got > want - 1.0);
            all += 1;
        }
        assert!(all > 19_000 && near > all / 10 * 9, "{near} of {all}");
    }
}

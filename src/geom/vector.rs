//! Vectors of three numbers, and the nearest point of a triangle to another point.

/// Scalar product.
#[inline(always)]
pub(crate) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Vector product.
#[inline(always)]
pub(crate) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// `a + s b`.
#[inline(always)]
pub(crate) fn add_scaled(a: [f64; 3], s: f64, b: [f64; 3]) -> [f64; 3] {
    [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]]
}

/// Position of the nearest point on a triangle.
pub(crate) enum Nearest {
    /// On an edge or a corner: weights of the second and the third corner.
    Border([f64; 2]),
    /// Within: areas opposite the corners.
    Face([f64; 3]),
}

/// The point of a triangle nearest to another one (Ericson 2005, 5.1.5), from the products of the edges from the first
/// corner with the vector to that point, and with each other.
#[inline(always)]
pub(crate) fn nearest_on_triangle([d1, d2]: [f64; 2], [abab, abac, acac]: [f64; 3]) -> Nearest {
    if d1 <= 0.0 && d2 <= 0.0 {
        return Nearest::Border([0.0, 0.0]);
    }
    let (d3, d4) = (d1 - abab, d2 - abac);
    if d3 >= 0.0 && d4 <= d3 {
        return Nearest::Border([1.0, 0.0]);
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return Nearest::Border([d1 / abab, 0.0]);
    }
    let (d5, d6) = (d1 - abac, d2 - acac);
    if d6 >= 0.0 && d5 <= d6 {
        return Nearest::Border([0.0, 1.0]);
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return Nearest::Border([0.0, d2 / acac]);
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return Nearest::Border([1.0 - w, w]);
    }
    Nearest::Face([va, vb, vc])
}

//! The 256 cases of eight samples inside or outside, and the surface's patches in a cube between them.
//!
//! A corner of a cube has bit 0, 1, 2 set for the high side along x, y, z; a case has bit i set if corner i is inside.
//! Edge `4 a + i` runs along axis a; bit 0 and 1 of i are set for the high side along the two other axes, the lower of
//! these first. Where a face has inside corners on a diagonal only, they are kept apart: the inside is connected
//! through faces of voxels, as in marching cubes with one rule for all faces (Montani, Scateni, Scopigno 1994), so that
//! the patches of neighbouring cubes fit together.
#![expect(clippy::cast_possible_truncation, reason = "256 cases of 12 edges")]

/// No patch passes through this edge.
pub(super) const NO_PATCH: u8 = u8::MAX;

/// Most patches of a cube.
const MAX_PATCHES: usize = 4;

/// Edges of a cube.
pub(super) const EDGES: usize = 12;

/// The surface within a cube: the patch that crosses each edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Case {
    pub(super) patch_of: [u8; EDGES],
    pub(super) patches: u8,
}

/// The other two axes, the lower first.
pub(super) const fn others(axis: usize) -> [usize; 2] {
    match axis {
        0 => [1, 2],
        1 => [0, 2],
        _ => [0, 1],
    }
}

/// The corners at the low and the high end of an edge.
pub(super) const fn ends(edge: usize) -> [usize; 2] {
    let (axis, at) = (edge / 4, edge % 4);
    let [b, c] = others(axis);
    let low = (at & 1) << b | (at >> 1) << c;
    [low, low | 1 << axis]
}

/// [`ends`] of all edges.
pub(super) static ENDS: [[usize; 2]; EDGES] = {
    let mut all = [[0; 2]; EDGES];
    let mut edge = 0;
    while edge < EDGES {
        all[edge] = ends(edge);
        edge += 1;
    }
    all
};

/// The edge along `axis` that begins or ends in `corner`.
pub(super) const fn edge_at(corner: usize, axis: usize) -> usize {
    let [b, c] = others(axis);
    4 * axis + (corner >> b & 1) + 2 * (corner >> c & 1)
}

pub(super) const fn is_inside(case: u8, corner: usize) -> bool {
    case >> corner & 1 == 1
}

/// True if the surface crosses the edge.
pub(super) const fn is_crossed(case: u8, edge: usize) -> bool {
    let [low, high] = ends(edge);
    is_inside(case, low) != is_inside(case, high)
}

/// The corners of a face: `side` 0 or 1 along `axis`.
pub(super) const fn face(axis: usize, side: usize) -> [usize; 4] {
    let [b, c] = others(axis);
    let first = side << axis;
    [first, first | 1 << b, first | 1 << c, first | 1 << b | 1 << c]
}

/// True for a face with inside corners on one diagonal, and outside corners on the other.
pub(super) const fn is_ambiguous(case: u8, axis: usize, side: usize) -> bool {
    let [p, q, r, s] = face(axis, side);
    is_inside(case, p) == is_inside(case, s)
        && is_inside(case, q) == is_inside(case, r)
        && is_inside(case, p) != is_inside(case, q)
}

pub(super) static CASES: [Case; 256] = all();

pub(super) const fn all() -> [Case; 256] {
    let mut cases = [Case { patch_of: [NO_PATCH; EDGES], patches: 0 }; 256];
    let mut case = 0;
    while case < 256 {
        cases[case] = patches(case as u8);
        case += 1;
    }
    cases
}

/// Patches of a case: edges that the surface joins within a face belong to the same patch.
const fn patches(case: u8) -> Case {
    let mut patch_of = [NO_PATCH; EDGES];
    let mut edge = 0;
    while edge < EDGES {
        if is_crossed(case, edge) {
            patch_of[edge] = edge as u8;
        }
        edge += 1;
    }
    let mut face_number = 0;
    while face_number < 6 {
        let (axis, side) = (face_number / 2, face_number % 2);
        let corners = face(axis, side);
        let [b, c] = others(axis);
        let ambiguous = is_ambiguous(case, axis, side);
        // Each inside corner of an ambiguous face joins the two crossed edges that meet in it; other faces join all
        // their crossed edges.
        let mut at = 0;
        while at < 4 {
            let corner = corners[at];
            if ambiguous {
                if is_inside(case, corner) {
                    patch_of = joined(patch_of, edge_at(corner, b), edge_at(corner, c));
                }
            } else {
                // The edges of the face: along b and c at this corner, and at the opposite one.
                let opposite = corner ^ (1 << b) ^ (1 << c);
                patch_of = joined(patch_of, edge_at(corner, b), edge_at(corner, c));
                patch_of = joined(patch_of, edge_at(corner, b), edge_at(opposite, b));
                patch_of = joined(patch_of, edge_at(corner, c), edge_at(opposite, c));
            }
            at += 1;
        }
        face_number += 1;
    }
    numbered(patch_of)
}

/// Merges two crossed edges into one patch; other edges are ignored.
pub(super) const fn joined(mut patch_of: [u8; EDGES], a: usize, b: usize) -> [u8; EDGES] {
    let (from, to) = (patch_of[a], patch_of[b]);
    if from == NO_PATCH || to == NO_PATCH {
        return patch_of;
    }
    let mut edge = 0;
    while edge < EDGES {
        if patch_of[edge] == from {
            patch_of[edge] = to;
        }
        edge += 1;
    }
    patch_of
}

/// Numbers patches from 0 on, in the order of their first edges.
pub(super) const fn numbered(names: [u8; EDGES]) -> Case {
    let mut patch_of = [NO_PATCH; EDGES];
    let mut patches = 0;
    let mut edge = 0;
    while edge < EDGES {
        if names[edge] != NO_PATCH && patch_of[edge] == NO_PATCH {
            let mut other = edge;
            while other < EDGES {
                if names[other] == names[edge] {
                    patch_of[other] = patches;
                }
                other += 1;
            }
            patches += 1;
        }
        edge += 1;
    }
    Case { patch_of, patches }
}

/// The edges that a patch crosses.
#[derive(Clone, Copy, Debug)]
pub(super) struct Crossed {
    pub(super) count: u8,
    /// Edges along each axis: bit i for edge `4 a + i`.
    pub(super) along: [u8; 3],
    /// Sum of the low ends of the edges, from the cube's middle, in halves of an edge.
    pub(super) ends: [i8; 3],
}

/// Crossed edges of the patches of every case.
pub(super) static CROSSED: [[Crossed; MAX_PATCHES]; 256] = all_crossed();

const fn all_crossed() -> [[Crossed; MAX_PATCHES]; 256] {
    let cases = all();
    let mut crossed = [[Crossed { count: 0, along: [0; 3], ends: [0; 3] }; MAX_PATCHES]; 256];
    let mut case = 0;
    while case < 256 {
        let mut edge = 0;
        while edge < EDGES {
            let patch = cases[case].patch_of[edge];
            if patch != NO_PATCH {
                let mut found = crossed[case][patch as usize];
                found.count += 1;
                found.along[edge / 4] |= 1 << (edge % 4);
                let mut axis = 0;
                while axis < 3 {
                    found.ends[axis] += if ends(edge)[0] >> axis & 1 == 1 { 1 } else { -1 };
                    axis += 1;
                }
                crossed[case][patch as usize] = found;
            }
            edge += 1;
        }
        case += 1;
    }
    crossed
}

/// The axes along which the high face of a case is ambiguous, as bits.
pub(super) static AMBIGUOUS_HIGH: [u8; 256] = {
    let mut high = [0; 256];
    let mut case = 0;
    while case < 256 {
        let mut axis = 0;
        while axis < 3 {
            high[case] |= (is_ambiguous(case as u8, axis, 1) as u8) << axis;
            axis += 1;
        }
        case += 1;
    }
    high
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_cases_have_their_patches() {
        assert_eq!(CASES[0].patches, 0);
        assert_eq!(CASES[255].patches, 0);
        assert_eq!(CASES[1].patches, 1);
        // Two corners on the diagonal of a face, or of the cube, are apart.
        assert_eq!(CASES[0b0000_1001].patches, 2);
        assert_eq!(CASES[0b1000_0001].patches, 2);
        // Every second corner.
        assert_eq!(CASES[0b0110_1001].patches, 4);
        // Two outside corners on the diagonal of a face: the inside is kept apart there, and joined around.
        assert_eq!(CASES[0b1111_0110].patches, 1);
        // A slab.
        assert_eq!(CASES[0b0000_1111].patches, 1);
    }
}

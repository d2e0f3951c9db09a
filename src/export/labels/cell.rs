//! A cell between eight labelled samples: its labels, and the sheets in which each label's surface passes through it.
//!
//! Every edge between two labels is crossed by one polygon, which is part of the surface of both. Where a face between
//! two cells has four crossed edges and a label on a diagonal, four polygons meet in the line that joins the cells'
//! corners. They are joined in pairs, around two opposite samples of the face, and each pair has a knot of its own on
//! that line, moved towards its sample: so all labels see the same pairs, and every edge of each label has two
//! polygons.

use crate::export::cases::{
    Case, EDGES, NO_PATCH, all, edge_at, ends, face, is_ambiguous, joined, numbered, others,
};
use crate::format::CornerLabels;

/// The corners of a face (`side` of `axis`) around which pairs of polygons are joined by knots; `None` where at most
/// two polygons of a label meet. Where the corners of each diagonal have equal labels, the diagonal of the lower number
/// is connected: unlabelled corners before all.
#[inline(always)]
pub(super) fn knots(corners: &CornerLabels, axis: usize, side: usize) -> Option<[usize; 2]> {
    let [p, q, r, s] = face(axis, side);
    let (a, b, c, d) = (corners[p], corners[q], corners[r], corners[s]);
    if a == b || b == d || d == c || c == a {
        return None;
    }
    match (a == d, b == c) {
        (true, true) => Some(if a < b { [q, r] } else { [p, s] }),
        (true, false) => Some([q, r]),
        (false, true) => Some([p, s]),
        (false, false) => None,
    }
}

/// The corners that have a label, as bits.
#[inline(always)]
pub(super) fn mask(corners: &CornerLabels, label: u16) -> u8 {
    corners.iter().enumerate().fold(0, |mask, (i, corner)| mask | u8::from(*corner == label) << i)
}

/// True for cases of one sheet without a face that could be joined in two ways.
#[expect(clippy::cast_possible_truncation, reason = "256 cases")]
static IS_PLAIN: [bool; 256] = {
    let all = all();
    let mut plain = [false; 256];
    let mut case = 0;
    while case < 256 {
        let mut side = 0;
        let mut ambiguous = false;
        while side < 6 {
            ambiguous |= is_ambiguous(case as u8, side / 2, side % 2);
            side += 1;
        }
        plain[case] = all[case].patches == 1 && !ambiguous;
        case += 1;
    }
    plain
};

/// The sheets of a label's surface: the sheet that each crossed edge belongs to.
pub(super) fn sheets(corners: &CornerLabels, label: u16) -> Option<Case> {
    let mask = mask(corners, label);
    if IS_PLAIN[usize::from(mask)] {
        return None;
    }
    let mut sheet_of = [NO_PATCH; EDGES];
    for (edge, sheet) in (0..).zip(&mut sheet_of) {
        let [low, high] = ends(usize::from(edge)).map(|corner| corners[corner] == label);
        if low != high {
            *sheet = edge;
        }
    }
    for (axis, side) in (0..3).flat_map(|axis| [(axis, 0), (axis, 1)]) {
        let [b, c] = others(axis);
        if let Some(around) = knots(corners, axis, side) {
            for corner in around {
                sheet_of = joined(sheet_of, edge_at(corner, b), edge_at(corner, c));
            }
            continue;
        }
        for corner in face(axis, side) {
            let opposite = corner ^ 1 << b ^ 1 << c;
            sheet_of = joined(sheet_of, edge_at(corner, b), edge_at(corner, c));
            sheet_of = joined(sheet_of, edge_at(corner, b), edge_at(opposite, b));
            sheet_of = joined(sheet_of, edge_at(corner, c), edge_at(opposite, c));
        }
    }
    Some(numbered(sheet_of))
}

/// The distinct labels of a cell, without 0; and their number.
#[inline(always)]
pub(super) fn distinct(corners: &CornerLabels) -> ([u16; 8], usize) {
    let (mut found, mut count) = ([0; 8], 0);
    for label in corners {
        if *label != 0 && !found[..count].contains(label) {
            found[count] = *label;
            count += 1;
        }
    }
    (found, count)
}

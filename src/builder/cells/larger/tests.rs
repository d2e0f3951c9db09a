use super::*;
use crate::format::cell::Plane;

/// Cells of a field at its samples, described by the plane of its gradient, or by their corners.
#[derive(Default)]
struct Cells {
    words: Vec<u64>,
    codes: Vec<[u8; 2]>,
    offsets: Vec<u8>,
    corners: Vec<(u16, [i8; CORNERS])>,
    sides: Vec<u8>,
    places: Vec<[usize; 3]>,
}

/// Positive inside.
type Field<'a> = dyn Fn([f64; 3]) -> f64 + 'a;

fn sample(field: &Field<'_>, [x, y, z]: [usize; 3]) -> f64 {
    field([x, y, z].map(|c| f64::from(u32::try_from(c).unwrap())))
}

impl Cells {
    fn new(field: &Field<'_>) -> Self {
        let mut cells = Self { words: vec![0; WORDS], ..Self::default() };
        for code in 0..CELLS {
            let place = morton::decode(code as u64).map(|c| c as usize);
            let depth: [f64; CORNERS] =
                std::array::from_fn(|c| sample(field, std::array::from_fn(|a| place[a] + (c >> a & 1))));
            let sides = (0..CORNERS).filter(|c| depth[*c] >= 0.0).fold(0_u8, |m, c| m | 1 << c);
            if matches!(sides, 0 | 255) {
                continue;
            }
            cells.words[code / 64] |= 1 << (code % 64);
            cells.describe(sides, &depth);
            cells.places.push(place);
        }
        cells
    }

    fn describe(&mut self, sides: u8, depth: &[f64; CORNERS]) {
        let slope: [f64; 3] = std::array::from_fn(|a| {
            (0..CORNERS).map(|c| if c >> a & 1 == 1 { -depth[c] } else { depth[c] }).sum()
        });
        let code = super::super::corner::encode(slope).unwrap_or(0);
        let n = normal::decode_l1(code);
        let (mut sum, mut count) = (0.0, 0.0);
        for (p, q) in EDGES {
            if (sides >> p ^ sides >> q) & 1 == 1 {
                let t = depth[p] / (depth[p] - depth[q]);
                let (a, b) = (f64::from(at_corner(n, p)), f64::from(at_corner(n, q)));
                (sum, count) = (sum + a + t * (b - a), count + 1.0);
            }
        }
        let corners = |inside: bool| (0..CORNERS).filter(move |c| (sides >> c & 1 == 1) == inside);
        let highest = corners(true).map(|c| at_corner(n, c)).max().unwrap();
        let lowest = corners(false).map(|c| at_corner(n, c)).min().unwrap();
        let offset = ((sum / count).round() as i32).clamp(-127, 127).max(highest);
        self.codes.push(code.to_le_bytes());
        self.sides.push(sides);
        if offset > lowest + 20 {
            let most = depth.iter().fold(0.0_f64, |m, d| m.max(d.abs()));
            let corners = std::array::from_fn(|c| {
                let size = (depth[c].abs() / most * 127.0).round().clamp(1.0, 127.0) as i8;
                if sides >> c & 1 == 1 { size } else { -size }
            });
            self.corners.push((u16::try_from(self.offsets.len()).unwrap(), corners));
            self.offsets.push(HAS_CORNERS.cast_unsigned());
        } else {
            self.offsets.push((offset as i8).cast_unsigned());
        }
    }

    fn brick(&self) -> FineBrick<'_> {
        FineBrick {
            words: self.words[..].try_into().unwrap(),
            codes: &self.codes,
            offsets: &self.offsets,
            corners: &self.corners,
            sides: &self.sides,
        }
    }
}

/// Crossings of a cell, and the other corners of its polygon, by plain division, in cells of the brick.
fn crossings(cells: &Cells, cell: usize) -> Vec<[f64; 3]> {
    let offset = cells.offsets[cell].cast_signed();
    let code = u16::from_le_bytes(cells.codes[cell]);
    let corners = cells.corners.iter().find(|(at, _)| usize::from(*at) == cell).map(|(_, corners)| corners);
    let value = |u: [f64; 3]| match corners {
        Some(corners) => (0..CORNERS)
            .map(|c| {
                let part = |a: usize| 0.5 * (1.0 + if c >> a & 1 == 1 { u[a] } else { -u[a] });
                -f64::from(corners[c]) * part(0) * part(1) * part(2)
            })
            .sum::<f64>(),
        None => {
            let n = Plane::new(code, offset).normal;
            (0..3).map(|a| f64::from(n[a]) * u[a]).sum::<f64>() - f64::from(offset)
        }
    };
    let mut found = Vec::new();
    for (p, q) in EDGES {
        let (p_in, q_in) = (cells.sides[cell] >> p & 1 == 1, cells.sides[cell] >> q & 1 == 1);
        let u = |c: usize| -> [f64; 3] { std::array::from_fn(|a| if c >> a & 1 == 1 { 1.0 } else { -1.0 }) };
        // The plane of a cell may lie between two outside corners.
        if p_in == q_in && (value(u(p)) <= 0.0) == (value(u(q)) <= 0.0) {
            continue;
        }
        let p_in = p_in && !q_in || p_in == q_in && value(u(p)) <= 0.0;
        let (from, to) = if p_in { (u(p), u(q)) } else { (u(q), u(p)) };
        let (a, b) = (value(from), value(to));
        let t = if b > 0.0 { -a / (b - a) } else { 1.0 };
        found.push(std::array::from_fn(|i| {
            cells.places[cell][i] as f64 + 0.5 * (1.0 + from[i] + t * (to[i] - from[i]))
        }));
    }
    found
}

/// Checks the guarantees of a brick's leaves; returns their number and the number of cells that stay.
fn check(field: &Field<'_>, error: f64, spacing: [f64; 3]) -> (usize, usize) {
    let cells = Cells::new(field);
    let (bound, brick) = (Bound::new(error, spacing), cells.brick());
    let mut joiner = Joiner::new(bound, 6);
    joiner.join(&brick);
    let states = joiner.states.clone();
    joiner.join(&brick);
    assert_eq!(states, joiner.states);

    let finest = spacing.into_iter().fold(f64::INFINITY, f64::min);
    let side = spacing.map(|s| s / finest);
    let mut covered = vec![0_u32; cells.codes.len()];
    joiner.for_each_run(&brick, |run| run.for_each(|cell| covered[cell] += 1));
    let stay = covered.iter().filter(|n| **n == 1).count();
    let mut leaves = 0;
    for e in 1..=LEVELS {
        joiner.for_each_kept(e, |at, kept| {
            let ModelNode::Leaf(leaf) = kept else { return };
            leaves += 1;
            let low = morton::decode((at as u64) << (3 * e)).map(|c| c as usize);
            let edge = 1_usize << e;
            let plane = Plane::new(leaf.code, leaf.offset);
            let n = plane.normal.map(f64::from);
            let length = (0..3).map(|a| (n[a] / side[a]).powi(2)).sum::<f64>().sqrt();
            // Distance in front of the plane, in voxels of the finest spacing.
            let ahead = |p: [f64; 3]| {
                let u: [f64; 3] = std::array::from_fn(|a| 2.0 * (p[a] - low[a] as f64) / edge as f64 - 1.0);
                let value = (0..3).map(|a| n[a] * u[a]).sum::<f64>() - f64::from(leaf.offset);
                value * 0.5 * edge as f64 / length
            };
            // Every inside sample in the box is behind, not only corners of cells; no outside corner of it is deeper.
            for i in 0..(edge + 1).pow(3) {
                let step = [i % (edge + 1), i / (edge + 1) % (edge + 1), i / (edge + 1).pow(2)];
                let at: [usize; 3] = std::array::from_fn(|a| low[a] + step[a]);
                let off = ahead(at.map(|c| c as f64));
                if sample(field, at) >= 0.0 {
                    assert!(off <= 1e-9, "{at:?} {off}");
                } else if step.iter().all(|c| *c == 0 || *c == edge) {
                    assert!(off >= -error - 1e-9, "{at:?} {off}");
                }
            }
            for (cell, place) in cells.places.iter().enumerate() {
                if (0..3).all(|a| (low[a]..low[a] + edge).contains(&place[a])) {
                    covered[cell] += 1;
                    for crossing in crossings(&cells, cell) {
                        assert!(ahead(crossing).abs() <= error + 1e-4, "{crossing:?} {}", ahead(crossing));
                    }
                }
            }
        });
    }
    assert!(covered.iter().all(|n| *n == 1), "every cell is in one leaf, or stays");
    let mut distances = Distances::new(error);
    joiner.measure(&brick, &mut distances);
    let [rms, p99, most] = distances.rms_p99_most();
    assert!(rms <= p99.max(error) && p99 <= most && most <= BETWEEN * error + 1e-4, "{rms} {p99} {most}");
    (leaves, stay)
}

fn ball(p: [f64; 3]) -> f64 {
    27.3 - p.iter().map(|c| (c + 3.7).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn leaves_are_within_the_bound_and_leave_no_inside_sample_in_front() {
    let noise = |p: [f64; 3]| {
        let code = p.iter().fold(7_u64, |h, c| (h ^ c.to_bits()).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 3);
        (code % 1000) as f64 / 1000.0
    };
    let flat = |p: [f64; 3]| 14.1 - 0.3 * p[0] - 0.2 * p[1] - 0.5 * p[2];
    let rough = |p: [f64; 3]| ball(p) + 0.15 * noise(p);
    let sheet = |p: [f64; 3]| 1.1 - (p[2] - 12.3 - 0.1 * p[0]).abs();
    let wedge = |p: [f64; 3]| (10.2 - p[0] + 0.3 * p[1]).min(20.1 - 0.9 * p[1] - 0.1 * p[2]);
    let static_noise = |p: [f64; 3]| noise(p) - 0.5;
    let cases: [(&str, &Field<'_>, bool); 6] = [
        ("flat", &flat, true),
        ("ball", &ball, true),
        ("rough", &rough, false),
        ("sheet", &sheet, false),
        ("wedge", &wedge, false),
        ("noise", &static_noise, false),
    ];
    for (name, field, is_smooth) in cases {
        for spacing in [[1.0; 3], [0.5, 0.5, 1.3]] {
            for error in [0.05, 0.1, 0.5, 1.0] {
                let (leaves, stay) = check(field, error, spacing);
                assert!(!is_smooth || error < 0.1 || leaves > 10 * stay, "{name} {error}: {leaves}, {stay}");
                assert!(name != "noise" || stay > leaves, "{name} {error}: {leaves}, {stay}");
            }
        }
    }
}

#[test]
fn a_plane_becomes_few_leaves_and_the_root_of_a_small_grid_none() {
    let cells = Cells::new(&|p| 15.5 - p[2]);
    let brick = cells.brick();
    for (depth, edges) in [(6, 5), (5, 4), (2, 1), (1, 0)] {
        let mut joiner = Joiner::new(Bound::new(0.1, [1.0; 3]), depth);
        joiner.join(&brick);
        let mut largest = 0;
        for e in 1..=LEVELS {
            joiner.for_each_kept(e, |_, kept| {
                if let ModelNode::Leaf(_) = kept {
                    largest = largest.max(e);
                }
            });
        }
        assert_eq!(largest, edges, "depth {depth}");
    }
}

#[test]
fn sides_of_a_box_follow_from_its_children() {
    // One child, with the box's middle inside: all others are inside.
    let mut children = [None; 8];
    children[2] = Some(0b0010_0000 | 0b0000_0010);
    assert_eq!(sides_of(&children), 0b1111_1011);
    children[2] = Some(0b0000_0100);
    assert_eq!(sides_of(&children), 0b0000_0100);
}

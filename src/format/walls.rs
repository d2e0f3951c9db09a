//! Cells between labels (SPEC 4.12): planes that separate the samples of a cell, and the label of each part.

use super::cell::{CORNERS, Plane, at_corner};
use super::normal;

/// Labels of the samples of a cell, by corner; 0 for background.
pub(crate) type CornerLabels = [u16; CORNERS];

/// Bytes of the item of a cell that one plane does not separate: the labels of its corners, and a second plane.
pub(crate) const WALL_BYTES: usize = 20;
/// Position of the second plane: offsets of both planes, then the code of its normal.
const SECOND: usize = 2 * CORNERS;
/// Mark of a cell divided into octants, instead of the first plane's offset.
const OCTANTS: i8 = i8::MIN;
/// The offset of a plane between two labels from its stored form, which is one more, and so odd, where a label lies on
/// either side.
#[inline(always)]
pub(crate) fn wall_offset(stored: i8) -> i8 {
    stored & !1
}

/// Most planes of a cell.
const MAX_PLANES: usize = 3;

/// The walls between the labels of a cell: up to three planes, and the label on each of their sides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Walls {
    planes: [Plane; MAX_PLANES],
    count: usize,
    /// Labels, indexed by the mask of planes that a point is in front of.
    labels: [u16; CORNERS],
}

/// Item of a cell with more than two labels, or with two that no plane separates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct WallItem {
    pub(crate) labels: CornerLabels,
    /// Offset of the first plane, and the second plane, which divides the front of the first.
    pub(crate) planes: Option<(i8, u16, i8)>,
}

impl WallItem {
    pub(crate) fn to_bytes(self) -> [u8; WALL_BYTES] {
        let mut bytes = [0; WALL_BYTES];
        for (to, label) in bytes.as_chunks_mut().0.iter_mut().zip(self.labels) {
            *to = label.to_le_bytes();
        }
        let (first, code, second) = self.planes.unwrap_or((OCTANTS, 0, 0));
        let [low, high] = code.to_le_bytes();
        bytes[SECOND..].copy_from_slice(&[first.cast_unsigned(), second.cast_unsigned(), low, high]);
        bytes
    }

    pub(crate) fn parse(bytes: &[u8; WALL_BYTES]) -> Self {
        let labels = std::array::from_fn(|c| u16::from_le_bytes([bytes[2 * c], bytes[2 * c + 1]]));
        let [first, second] = [bytes[SECOND], bytes[SECOND + 1]].map(u8::cast_signed);
        let code = u16::from_le_bytes([bytes[SECOND + 2], bytes[SECOND + 3]]);
        Self { labels, planes: (first != OCTANTS).then_some((first, code, second)) }
    }

    /// True for an item that is impossible with any normal of the cell (SPEC I14).
    pub(crate) fn is_illegal(bytes: &[u8; WALL_BYTES]) -> bool {
        let Self { labels, planes } = Self::parse(bytes);
        labels.iter().all(|label| *label == labels[0])
            || match planes {
                None => bytes[SECOND + 1..] != [0; 3],
                Some((first, _, second)) => {
                    first % 2 != 0
                        || second % 2 != 0
                        || second == i8::MIN
                        || bytes[SECOND + 2..].contains(&0x80)
                }
            }
    }

    /// The item of one label alone, with background around it.
    fn alone(self, label: u16) -> Self {
        Self { labels: self.labels.map(|other| if other == label { label } else { 0 }), ..self }
    }

    /// Values at the corners of a cell of one label, above 0 in it; their interpolation follows its walls. `code` is the
    /// cell's normal.
    #[expect(clippy::cast_possible_truncation, reason = "limited to the size of an offset")]
    pub(crate) fn values(&self, code: u16) -> [i8; CORNERS] {
        let Some((first, second, offset)) = self.planes else {
            return self.labels.map(|label| if label > 0 { 1 } else { -1 });
        };
        let parts = Walls::of_item(code, self);
        let [behind, near, far] = [0b00, 0b01, 0b11].map(|part| parts.label(part) > 0);
        let planes = [Plane::new(code, first), Plane::new(second, offset)];
        std::array::from_fn(|corner| {
            let [first, second] = planes.map(|plane| at_corner(plane.normal, corner) - plane.offset);
            let front = match (near, far) {
                (true, true) => i32::from(u8::MAX),
                (false, false) => -i32::from(u8::MAX),
                (is_near, _) => {
                    if is_near {
                        -second
                    } else {
                        second
                    }
                }
            };
            let value = if behind { front.max(-first) } else { front.min(first) };
            // Distances are odd; halves keep their sign.
            ((value + value.signum()) / 2).clamp(-127, 127) as i8
        })
    }

    /// The greatest and the least label, as stored instead of a pair.
    pub(crate) fn pair(&self) -> [u16; 2] {
        let ends = |(low, high): (u16, u16), label: &u16| (low.min(*label), high.max(*label));
        let (low, high) = self.labels.iter().fold((u16::MAX, 0), ends);
        [high, low]
    }
}

/// Stored form of a cell between labels: the code of its normal, its offset, and its item if it has one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct WallCode {
    pub(crate) code: u16,
    pub(crate) offset: i8,
    pub(crate) item: Option<WallItem>,
}

impl WallCode {
    /// The distinct labels of the cell in rising order, without 0; `pair` holds the labels behind and in front of a
    /// plane.
    pub(crate) fn labels(&self, [behind, front]: [u16; 2]) -> impl Iterator<Item = u16> {
        let mut all = self.item.map_or([front, behind, 0, 0, 0, 0, 0, 0], |item| item.labels);
        all.sort_unstable();
        let mut last = 0;
        all.into_iter().filter(move |label| std::mem::replace(&mut last, *label) != *label)
    }

    /// The same cell for one of its labels alone, with the same walls: the label is behind the plane. `behind` is the
    /// label behind the plane of this cell.
    pub(crate) fn alone(&self, label: u16, behind: u16) -> Self {
        let Some(item) = self.item.map(|item| item.alone(label)) else {
            let plane = Self { offset: wall_offset(self.offset), ..*self };
            return if behind == label { plane } else { plane.turned() };
        };
        let Some((first, ..)) = item.planes else { return Self { item: Some(item), ..*self } };
        // The second plane may no longer separate anything.
        let walls = Walls::of_item(self.code, &item);
        let [behind, near, far] = [0b00, 0b01, 0b11].map(|part| walls.label(part));
        let plane = Self { offset: first, item: None, ..*self };
        match (near == far, behind == label) {
            (false, _) => Self { item: Some(item), ..*self },
            (true, true) => plane,
            (true, false) => plane.turned(),
        }
    }

    /// The same plane, turned.
    fn turned(self) -> Self {
        Self { code: normal::negated(self.code), offset: self.offset.saturating_neg(), item: self.item }
    }
}

impl Walls {
    /// Walls of two labels, behind a plane and in front of it.
    #[inline]
    pub(crate) fn of_pair(plane: Plane, [behind, front]: [u16; 2]) -> Self {
        let mut labels = [behind; CORNERS];
        labels[1] = front;
        Self { planes: [plane; MAX_PLANES], count: 1, labels }
    }

    /// The walls of the item of a cell with this normal.
    pub(crate) fn of_item(code: u16, item: &WallItem) -> Self {
        let Some((first, second, offset)) = item.planes else {
            // Octants have the label of the nearest corner.
            let planes = std::array::from_fn(|a| {
                let mut normal = [0; 3];
                normal[a] = normal::SCALE;
                Plane { normal, offset: 0 }
            });
            return Self { planes, count: MAX_PLANES, labels: item.labels };
        };
        let (first, second) = (Plane::new(code, first), Plane::new(second, offset));
        let mut labels = [0; CORNERS];
        let is_front = |plane: &Plane, corner| at_corner(plane.normal, corner) > plane.offset;
        for (corner, label) in item.labels.iter().enumerate() {
            let part = usize::from(is_front(&first, corner)) | usize::from(is_front(&second, corner)) << 1;
            // Behind the first plane the second one has no effect.
            labels[if part == 2 { 0 } else { part }] = *label;
        }
        labels[2] = labels[0];
        Self { planes: [first, second, second], count: 2, labels }
    }

    /// True if a part has such a label.
    pub(crate) fn holds(&self, is_such: impl Fn(u16) -> bool) -> bool {
        self.labels.iter().any(|label| is_such(*label))
    }

    /// The planes; labels only change at them.
    #[inline]
    pub fn planes(&self) -> &[Plane] {
        self.planes.get(..self.count).unwrap_or_default()
    }

    /// The label of a part: bit i of `fronts` is set in front of plane i.
    #[inline]
    pub(crate) fn label(&self, fronts: usize) -> u16 {
        self.labels[fronts % CORNERS]
    }

    /// The label of a corner.
    #[inline]
    pub fn corner(&self, corner: usize) -> u16 {
        self.label(self.corner_fronts(corner))
    }

    /// Mask of the planes that a corner is in front of.
    #[inline]
    pub(crate) fn corner_fronts(&self, corner: usize) -> usize {
        let front = |plane: &Plane| usize::from(at_corner(plane.normal, corner) > plane.offset);
        self.planes().iter().enumerate().fold(0, |fronts, (i, plane)| fronts | front(plane) << i)
    }

    /// True if corners lie behind the first plane, and in front of it on both sides of a second one, so that all parts
    /// have a label.
    pub(crate) fn has_all_parts(&self) -> bool {
        let parts = (0..CORNERS).fold(0_u32, |parts, corner| parts | 1 << self.corner_fronts(corner));
        self.count != 2 || (parts & 0b0101 != 0 && parts & 0b1010 == 0b1010)
    }

    /// The label of a point in the cell's own coordinates (-1..=1).
    pub fn at(&self, u: [f64; 3]) -> u16 {
        self.label(self.fronts(u))
    }

    /// Crossings of a line from a point with the planes, in multiples of `way`, rising.
    pub(crate) fn crossings(&self, u: [f64; 3], way: [f64; 3]) -> Vec<f64> {
        let along = |plane: &Plane| (0..3).map(|a| f64::from(plane.normal[a]) * way[a]).sum::<f64>();
        let mut found: Vec<f64> = self.planes().iter().map(|plane| -ahead(plane, u) / along(plane)).collect();
        found.retain(|t| t.is_finite());
        found.sort_by(f64::total_cmp);
        found
    }

    /// Mask of the planes that a point is in front of.
    fn fronts(&self, u: [f64; 3]) -> usize {
        let front = |plane: &Plane| usize::from(ahead(plane, u) > 0.0);
        self.planes().iter().enumerate().fold(0, |fronts, (i, plane)| fronts | front(plane) << i)
    }

    /// The wall that a ray in this direction meets at a point: the label behind the wall along the ray, and the
    /// direction out of that label, of any length. Points are at most `near` off the wall, in the cell's coordinates.
    pub fn met(&self, u: [f64; 3], direction: [f64; 3], near: f64) -> (u16, [f64; 3]) {
        let along =
            |plane: &Plane, v: [f64; 3]| (0..3).map(|a| f64::from(plane.normal[a]) * v[a]).sum::<f64>();
        let length = |plane: &Plane| along(plane, plane.normal.map(f64::from)).sqrt();
        let is_near = |plane: &Plane| ahead(plane, u).abs() <= near * length(plane);
        let on = |(i, plane): (usize, &Plane)| {
            let is_ahead = if is_near(plane) { along(plane, direction) > 0.0 } else { ahead(plane, u) > 0.0 };
            usize::from(is_ahead) << i
        };
        let fronts = self.planes().iter().enumerate().map(on).fold(0, |fronts, bit| fronts | bit);
        let label = self.label(fronts);
        // The nearest of the planes with another label on their other side.
        let walls = self.planes().iter().enumerate().filter(|(i, _)| self.label(fronts ^ (1 << i)) != label);
        let distance = |plane: &Plane| ahead(plane, u).abs() / length(plane);
        let nearest = walls.min_by(|(_, a), (_, b)| distance(a).total_cmp(&distance(b)));
        let normal = nearest.map_or([0.0; 3], |(i, plane)| {
            let sign = if fronts >> i & 1 == 1 { -1.0 } else { 1.0 };
            plane.normal.map(|n| sign * f64::from(n))
        });
        (label, normal)
    }
}

/// Signed distance of a point in front of a plane, times the normal's length.
fn ahead(plane: &Plane, u: [f64; 3]) -> f64 {
    (0..3).map(|a| f64::from(plane.normal[a]) * u[a]).sum::<f64>() - f64::from(plane.offset)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every point of a cell has the label in the cell of that label alone, and background in the others.
    #[test]
    fn a_label_alone_has_its_part_of_a_cell() {
        let code = normal::encode([0.6, -0.3, 0.5]);
        let (first, second) = (Plane::new(code, -20), normal::encode([-0.2, 0.9, 0.4]));
        let front = |plane: &Plane, corner| at_corner(plane.normal, corner) > plane.offset;
        for [a, b, c] in [[7, 3, 0], [3, 7, 9], [0, 7, 3], [7, 3, 7], [7, 7, 3], [7, 0, 0]] {
            let part = |corner| match (front(&first, corner), front(&Plane::new(second, 10), corner)) {
                (false, _) => a,
                (true, false) => b,
                (true, true) => c,
            };
            let item = WallItem { labels: std::array::from_fn(part), planes: Some((-20, second, 10)) };
            let octants = WallItem { labels: [a, b, c, 5, a, 5, b, c], planes: None };
            for item in [Some(item), Some(octants), None] {
                let [a, b] = if item.is_none() && a < b { [b, a] } else { [a, b] };
                if item.is_none() && a == b {
                    continue;
                }
                let offset = if item.is_some() { i8::MIN } else { -20 + i8::from(b > 0) };
                let whole = WallCode { code, offset, item };
                let walls = |cell: &WallCode, pair| match &cell.item {
                    Some(item) => Walls::of_item(cell.code, item),
                    None => Walls::of_pair(Plane::new(cell.code, wall_offset(cell.offset)), pair),
                };
                let labels: Vec<u16> = whole.labels([a, b]).collect();
                assert!(
                    labels.is_sorted() && labels.contains(&a.max(b)) && !labels.contains(&0),
                    "{labels:?}"
                );
                for label in labels {
                    let alone = whole.alone(label, a);
                    assert!(alone.offset == i8::MIN || alone.offset % 2 == 0, "{alone:?}");
                    assert_eq!(alone.offset == i8::MIN, alone.item.is_some());
                    for i in 0..9_u32.pow(3) {
                        let u = [i % 9, i / 9 % 9, i / 81].map(|c| f64::from(c) / 4.0 - 1.0 + 1e-3);
                        let due = if walls(&whole, [a, b]).at(u) == label { label } else { 0 };
                        assert_eq!(walls(&alone, [label, 0]).at(u), due, "{whole:?} {alone:?} {u:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn items_come_back_and_part_their_corners() {
        let x = normal::encode([1.0, 0.0, 0.0]);
        let y = normal::encode([0.0, 1.0, 0.0]);
        // 7 at low x; in the rest 3 at low y, background at high y.
        let labels = [7, 3, 7, 0, 7, 3, 7, 0];
        let two = WallItem { labels, planes: Some((-20, y, 10)) };
        let octants = WallItem { labels: [1, 2, 3, 4, 5, 6, 7, 65_535], planes: None };
        for item in [two, octants] {
            let bytes = item.to_bytes();
            assert!(!WallItem::is_illegal(&bytes));
            assert_eq!(WallItem::parse(&bytes), item);
            let walls = Walls::of_item(x, &item);
            for (corner, label) in item.labels.iter().enumerate() {
                assert_eq!(walls.corner(corner), *label);
                let u = std::array::from_fn(|a| if corner >> a & 1 == 1 { 1.0 } else { -1.0 });
                assert_eq!(walls.at(u), *label);
            }
        }
        assert_eq!((two.pair(), octants.pair()), ([7, 0], [65_535, 1]));
        let walls = Walls::of_item(x, &two);
        // From the front of both planes into 7, and from 3 out into background.
        let at = f64::from(-20_i8) / 127.0;
        assert_eq!(walls.met([at, 0.5, 0.0], [-1.0, 0.0, 0.0], 1e-9), (7, [127.0, 0.0, 0.0]));
        assert_eq!(walls.met([at, 0.5, 0.0], [1.0, 0.0, 0.0], 1e-9), (0, [-127.0, 0.0, 0.0]));
        let at = 10.0 / 127.0;
        assert_eq!(walls.met([0.5, at, 0.0], [0.0, -1.0, 0.0], 1e-9), (3, [0.0, 127.0, 0.0]));
        for (at, byte) in [(16, 1), (17, 0x80), (17, 3), (19, 0x80)] {
            let mut wrong = two.to_bytes();
            wrong[at] = byte;
            assert!(WallItem::is_illegal(&wrong), "{at} {byte}");
        }
        assert!(WallItem::is_illegal(&WallItem { labels: [5; 8], planes: None }.to_bytes()));
    }
}

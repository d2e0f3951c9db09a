//! The path of a ray through the children of a box: path byte and order of visits (the paper, 3.2, 3.3).
//!
//! Children are numbered u + 2 v + 4 w in the walk's frame, so that bit i of a byte is child 2^i of the paper. The ray
//! runs upwards along all three axes there: the lowest bit first is front to back.

use super::line::MainAxis;

/// Quadrants of floor, middle and ceiling along one axis, in halves of the box from its low side: -1, 0, 1 or 2, where
/// the outer two stand for everything outside. From one to the next they grow by at most 1.
pub(crate) type Halves = [i8; 3];

/// Mask of the halves of the box between two halves.
#[inline]
fn between(from: i8, to: i8) -> usize {
    let bit = |half: i8| match half {
        0 => 1,
        1 => 2,
        _ => 0,
    };
    bit(from) | bit(to)
}

/// Quadrants of a storey with u in a set of halves, and with v in it.
const BY_U: [u8; 4] = [0, 0b0101, 0b1010, 0b1111];
const BY_V: [u8; 4] = [0, 0b0011, 0b1100, 0b1111];

/// The children that a ray passes, widened so that each shares a face with a previous one: where both coordinates
/// change within a storey, all four of its quadrants (the paper, 3.3).
///
/// `u` and `v` are the halves of floor, middle and ceiling.
#[inline]
pub(crate) fn path_byte(u: Halves, v: Halves) -> u8 {
    let storey = |i: usize| BY_U[between(u[i], u[i + 1])] & BY_V[between(v[i], v[i + 1])];
    storey(0) | storey(1) << 4
}

/// An infobyte in the walk's frame: bit i is set if child i there is not empty.
#[inline]
pub(crate) fn infobyte_in_frame(infobyte: u8, axis: MainAxis) -> u8 {
    IN_FRAME[axis.frame_number() % FRAMES][usize::from(infobyte)]
}

/// Octant of the grid that is child `child` of the walk's frame.
#[inline]
pub(crate) fn octant_in_grid(child: u32, axis: MainAxis) -> u32 {
    u32::from(OCTANTS[axis.frame_number() % FRAMES][child as usize % 8])
}

/// Three main axes, eight mirrorings.
const FRAMES: usize = 24;

/// Octants of the grid by frame and child.
const OCTANTS: [[u8; 8]; FRAMES] = {
    let mut table = [[0; 8]; FRAMES];
    let mut frame = 0;
    while frame < FRAMES {
        let (main, mirrored) = (frame / 8, frame % 8);
        let mut child = 0;
        while child < 8 {
            let (u, v, w) = (child & 1, child >> 1 & 1, child >> 2);
            let octant = u << ((main + 1) % 3) | v << ((main + 2) % 3) | w << main;
            #[expect(clippy::cast_possible_truncation, reason = "three bits")]
            {
                table[frame][child] = (octant ^ mirrored) as u8;
            }
            child += 1;
        }
        frame += 1;
    }
    table
};

/// Infobytes in the walk's frame, by frame and infobyte: 6 KiB.
static IN_FRAME: [[u8; 256]; FRAMES] = {
    let mut table = [[0; 256]; FRAMES];
    let mut frame = 0;
    while frame < FRAMES {
        let mut infobyte = 0;
        while infobyte < 256 {
            let mut child = 0;
            while child < 8 {
                if infobyte >> OCTANTS[frame][child] & 1 == 1 {
                    table[frame][infobyte] |= 1 << child;
                }
                child += 1;
            }
            infobyte += 1;
        }
        frame += 1;
    }
    table
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_example_of_the_paper() {
        // Floor in quadrant 00, middle in 01, ceiling in 11: x = 1001b, y = 0111b at depth 1 is the middle.
        let (x, y) = (0b1001_u8, 0b0111_u8);
        let middle = [x >> 3 & 1, y >> 3 & 1].map(u8::cast_signed);
        let (u, v) = ([0, middle[0], 1], [0, middle[1], 1]);
        let path = path_byte(u, v);
        assert_eq!(path, 0b1010_0011, "1 / 2 / 32 / 128");
        assert_eq!(path & 0b0011_0101, 0b0010_0001, "1 and 32; the paper prints a digit less");
    }

    #[test]
    fn a_path_that_would_touch_by_an_edge_is_widened() {
        // 1 / 16 / 128 becomes 1 / 16 / 32 / 64 / 128 (the paper, 3.3).
        assert_eq!(path_byte([0, 0, 1], [0, 0, 1]), 0b1111_0001);
        // Every path is connected by faces, and complete: children along every sequence of halves.
        let steps = [[0, 0, 0], [0, 0, 1], [0, 1, 1], [1, 1, 1]];
        let mut by_edges = 0;
        for u in steps {
            for v in steps {
                let path = path_byte(u, v);
                let child =
                    |i: usize, storey: u32| u32::from((u[i] | v[i] << 1).cast_unsigned()) | storey << 2;
                let line = [child(0, 0), child(1, 0), child(1, 1), child(2, 1)];
                for pair in line.windows(2) {
                    assert!(path >> pair[0] & path >> pair[1] & 1 == 1);
                    by_edges += u32::from((pair[0] ^ pair[1]).count_ones() == 2);
                }
                let mut reached = 1_u8 << line[0];
                for _ in 0..8 {
                    for c in (0..8).filter(|c| path >> c & 1 == 1) {
                        let near = (0..3).any(|a| reached >> (c ^ 1 << a) & 1 == 1);
                        reached |= u8::from(near) << c;
                    }
                }
                assert_eq!(reached, path, "{u:?} {v:?}");
            }
        }
        assert_eq!(by_edges, 2, "both coordinates change in the lower storey, or in the upper one");
    }

    #[test]
    fn what_lies_beside_the_box_adds_nothing() {
        assert_eq!(path_byte([-1, -1, 0], [0, 0, 0]), 0b0001_0000);
        assert_eq!(path_byte([-1, 0, 0], [1, 2, 2]), 0b0000_0100);
        assert_eq!(path_byte([2, 2, 2], [0, 0, 1]), 0);
        assert_eq!(path_byte([-1, -1, -1], [-1, 0, 1]), 0);
    }

    #[test]
    fn infobytes_and_octants_turn_together() {
        for x in [-1, 1] {
            for y in [-1, 1] {
                for z in [-1, 1] {
                    for main in 0..3 {
                        let mut d = [x, y, z];
                        d[main] *= 2;
                        let axis = MainAxis::of(d);
                        for infobyte in 0..=255_u8 {
                            let turned = infobyte_in_frame(infobyte, axis);
                            for child in 0..8 {
                                let octant = octant_in_grid(child, axis);
                                assert_eq!(turned >> child & 1, infobyte >> octant & 1);
                            }
                        }
                        // Child 0 is the octant that the ray comes from.
                        let from = (0..3).fold(0, |o, a| o | u32::from(d[a] < 0) << a);
                        assert_eq!(octant_in_grid(0, axis), from);
                        assert_eq!(octant_in_grid(4, axis), from ^ 1 << main);
                    }
                }
            }
        }
    }
}

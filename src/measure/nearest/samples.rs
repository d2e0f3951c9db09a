//! The places that stand for cells: their facets' centroids, a block of cells at once.

use super::{Facet, OctreeBox, Surface};
use crate::cpu::{Kernel, Lanes, dispatch};

/// Cells of a block.
pub(crate) const BLOCK: usize = 64;

/// A place of the surface, in the frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Sample {
    pub(crate) point: [f64; 3],
    /// Unit vector out of the surface.
    pub(crate) normal: [f64; 3],
    /// Area of the surface that it stands for, in mm2.
    pub(crate) area: f64,
}

/// A block of cells with planes, as a structure of arrays.
struct Block {
    len: usize,
    /// Middle of the cell, and numbers of the plane.
    middle: [[f64; BLOCK]; 3],
    normal: [[i32; BLOCK]; 3],
    offset: [f64; BLOCK],
    /// Half edges of a cell, and these in a mm.
    half: [f64; 3],
    per_mm: [f64; 3],
    unit: [[f64; BLOCK]; 3],
    point: [[f64; BLOCK]; 3],
    area: [f64; BLOCK],
}

struct SectionKernel<'a>(&'a mut Block);

impl Kernel for SectionKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self, _: impl Lanes) {
        let b = self.0;
        for i in 0..b.len.next_multiple_of(4).min(BLOCK) {
            let facet = b.facet(i);
            let (area, point) = facet.section_by_heights();
            b.area[i] = area;
            (b.unit[0][i], b.unit[1][i], b.unit[2][i]) = (facet.normal[0], facet.normal[1], facet.normal[2]);
            (b.point[0][i], b.point[1][i], b.point[2][i]) = (point[0], point[1], point[2]);
        }
    }
}

impl Block {
    #[inline(always)]
    fn facet(&self, i: usize) -> Facet {
        let middle = [self.middle[0][i], self.middle[1][i], self.middle[2][i]];
        let normal = [self.normal[0][i], self.normal[1][i], self.normal[2][i]];
        Facet::new(middle, [self.half, self.per_mm], normal, self.offset[i])
    }
}

impl Surface<'_> {
    /// The place that stands for a cell: the centroid of its facet, of several the largest one, with the area of them all;
    /// the middle of a cell without any.
    pub(crate) fn sample(&self, place: OctreeBox) -> Sample {
        let (mut sample, mut largest) = (Sample::default(), -1.0);
        self.facets(place, |_, facet| {
            let (area, point) = facet.section();
            sample.area += area;
            if area > largest {
                (largest, sample.point, sample.normal) = (area, point, facet.normal);
            }
        });
        if largest < 0.0 {
            sample.point = self.middle(place.low, place.level).0;
        }
        sample
    }

    /// The same of up to [`BLOCK`] cells by their numbers and indices. Cost: a fourth of one after the other.
    pub(crate) fn samples(
        &self,
        cells: impl Iterator<Item = (u64, [u32; 3])> + Clone,
        samples: &mut [Sample; BLOCK],
    ) {
        let mut block = Block {
            len: 0,
            middle: [[0.0; BLOCK]; 3],
            normal: [[1; BLOCK]; 3],
            offset: [0.0; BLOCK],
            half: self.space.spacing.map(|s| 0.5 * s),
            per_mm: self.space.per_mm.map(|c| 2.0 * c),
            unit: [[0.0; BLOCK]; 3],
            point: [[0.0; BLOCK]; 3],
            area: [0.0; BLOCK],
        };
        let mut planes = 0_u64;
        for (i, (number, cell)) in cells.clone().take(BLOCK).enumerate() {
            block.len = i + 1;
            let Some(plane) = self.cells.plane(number) else { continue };
            planes |= 1 << i;
            let (middle, _) = self.middle(cell, 0);
            for (all, of) in block.middle.iter_mut().zip(middle) {
                all[i] = of;
            }
            for (all, of) in block.normal.iter_mut().zip(plane.normal) {
                all[i] = of;
            }
            block.offset[i] = plane.offset.into();
        }
        dispatch(SectionKernel(&mut block));
        for (i, (sample, (number, cell))) in samples.iter_mut().zip(cells).enumerate() {
            let of = |v: &[[f64; BLOCK]; 3]| [v[0][i], v[1][i], v[2][i]];
            *sample = if planes >> i & 1 == 0 || block.area[i].is_nan() {
                self.sample(self.cell_place(number, cell))
            } else {
                Sample { point: of(&block.point), normal: of(&block.unit), area: block.area[i] }
            };
        }
    }
}

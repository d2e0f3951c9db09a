//! Scenes for the traversal and picture tests: solids by formula, their skins, and cube symmetries.
#![allow(
    unreachable_pub,
    clippy::cast_possible_truncation,
    reason = "shared by test files, each uses its part"
)]

use infobyte::format::normal;
use infobyte::geom::{Dims, morton};
use infobyte::load::ModelView;

use super::memory_tree::MemoryTree;
use infobyte::render::reference::BitVolume;
use infobyte::render::selfcheck::Random;

/// A set of skin voxels, as an octree and as plain bits.
pub struct Scene {
    pub name: String,
    pub dims: Dims,
    pub cells: Vec<[u32; 3]>,
    pub tree: MemoryTree,
    pub bits: BitVolume,
}

impl Scene {
    pub fn new(name: impl Into<String>, dims: [u32; 3], cells: Vec<[u32; 3]>) -> Self {
        let dims = Dims::new(dims[0], dims[1], dims[2]).unwrap();
        let codes: Vec<u64> = cells.iter().map(|[x, y, z]| morton::encode(*x, *y, *z)).collect();
        let tree = MemoryTree::new(dims, &codes).unwrap();
        let mut bits = BitVolume::new(dims.depth()).unwrap();
        cells.iter().for_each(|cell| bits.set(*cell));
        Self { name: name.into(), dims, cells, tree, bits }
    }

    /// Every voxel that the predicate chooses.
    pub fn set(name: impl Into<String>, dims: [u32; 3], chosen: impl FnMut([u32; 3]) -> bool) -> Self {
        let mut chosen = chosen;
        let cells = all_cells(dims).filter(|c| chosen(*c)).collect();
        Self::new(name, dims, cells)
    }

    /// The thin skin of a solid: inside voxels with a face neighbour that is not inside.
    pub fn skin(name: impl Into<String>, dims: [u32; 3], inside: impl Fn([u32; 3]) -> bool) -> Self {
        let open = |cell: [u32; 3]| {
            (0..3).any(|a| beyond(cell, a, dims).iter().any(|n| n.is_none_or(|n| !inside(n))))
        };
        let cells = all_cells(dims).filter(|c| inside(*c) && open(*c)).collect();
        Self::new(name, dims, cells)
    }

    /// Gives each voxel, and each node of 4 cells and more, the normal of a direction field.
    pub fn with_normals(mut self, outward: impl Fn([f64; 3]) -> [f64; 3]) -> Self {
        let code = |low: [u32; 3], edge: u32| {
            let centre = low.map(|c| f64::from(c) + f64::from(edge) / 2.0);
            normal::encode(outward(centre).map(|v| v as f32))
        };
        let voxels = self.tree.voxels().iter().map(|m| code(morton::decode(*m), 1)).collect();
        let depth = self.dims.depth();
        let mut nodes = Vec::new();
        for level in (2..=depth).rev() {
            let mut codes: Vec<u64> = self.tree.voxels().iter().map(|m| m >> (3 * level)).collect();
            codes.dedup();
            nodes.extend(codes.iter().map(|m| code(morton::decode(m << (3 * level)), 1 << level)));
        }
        self.tree = self.tree.clone().with_normals(voxels).unwrap().with_node_normals(nodes);
        self
    }
}

/// The neighbours below and above along an axis; `None` outside the volume.
fn beyond(cell: [u32; 3], axis: usize, dims: [u32; 3]) -> [Option<[u32; 3]>; 2] {
    let with = |v: u32| {
        let mut next = cell;
        next[axis] = v;
        next
    };
    let c = cell[axis];
    [c.checked_sub(1).map(with), (c + 1 < dims[axis]).then(|| with(c + 1))]
}

pub fn all_cells(dims: [u32; 3]) -> impl Iterator<Item = [u32; 3]> {
    (0..dims[2]).flat_map(move |z| (0..dims[1]).flat_map(move |y| (0..dims[0]).map(move |x| [x, y, z])))
}

/// Cell centre relative to the middle of an n-cube, in units of n.
fn centred(cell: [u32; 3], n: u32) -> [f64; 3] {
    cell.map(|c| (f64::from(c) + 0.5) / f64::from(n) - 0.5)
}

pub fn in_ball(cell: [u32; 3], n: u32) -> bool {
    centred(cell, n).iter().map(|v| v * v).sum::<f64>() < 0.43 * 0.43
}

pub fn in_torus(cell: [u32; 3], n: u32) -> bool {
    let [x, y, z] = centred(cell, n);
    let ring = (x * x + y * y).sqrt() - 0.3;
    ring * ring + z * z < 0.13 * 0.13
}

pub fn in_gyroid(cell: [u32; 3], n: u32) -> bool {
    let [x, y, z] = centred(cell, n).map(|v| v * 12.0);
    x.sin() * y.cos() + y.sin() * z.cos() + z.sin() * x.cos() > 0.0
}

/// One voxel thick plane `a . c = offset`, by the axis that `a` runs along most: 26-connected, 6-separating.
pub fn plane(name: String, n: u32, a: [f64; 3]) -> Scene {
    let main = (0..3).fold(0, |best, i| if a[i].abs() > a[best].abs() { i } else { best });
    Scene::set(name, [n; 3], |cell| {
        let side: f64 = (0..3).map(|i| a[i] * centred(cell, n)[i] * f64::from(n)).sum();
        side >= -0.5 * a[main].abs() && side < 0.5 * a[main].abs()
    })
}

pub fn noise(name: &str, dims: [u32; 3], density: f64, seed: u64) -> Scene {
    let mut random = Random::new(seed);
    Scene::set(name, dims, |_| random.unit() < density)
}

/// The 48 symmetries of the cube: an axis permutation, then mirrors.
#[derive(Clone, Copy, Debug)]
pub struct Symmetry {
    pub from: [usize; 3],
    pub mirror: [bool; 3],
}

impl Symmetry {
    pub fn all() -> impl Iterator<Item = Self> {
        let permutations = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
        permutations
            .into_iter()
            .flat_map(|from| (0..8).map(move |m| Self { from, mirror: [m & 1 == 1, m & 2 == 2, m & 4 == 4] }))
    }

    /// Does it make left hands of right ones?
    pub fn is_odd(self) -> bool {
        let swaps = (0..3).filter(|i| self.from[*i] > self.from[(i + 1) % 3]).count();
        let mirrors = self.mirror.iter().filter(|mirror| **mirror).count();
        (swaps + mirrors) % 2 == 0
    }

    pub fn cell(self, cell: [u32; 3], side: u32) -> [u32; 3] {
        std::array::from_fn(|i| {
            let c = cell[self.from[i]];
            if self.mirror[i] { side - 1 - c } else { c }
        })
    }

    pub fn point(self, point: [f64; 3], side: f64) -> [f64; 3] {
        std::array::from_fn(|i| {
            let p = point[self.from[i]];
            if self.mirror[i] { side - p } else { p }
        })
    }

    pub fn vector(self, vector: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|i| {
            let v = vector[self.from[i]];
            if self.mirror[i] { -v } else { v }
        })
    }
}

/// Structure of a damaged file: infobytes and a rank directory that fit neither each other nor the grid.
pub(crate) struct Garbage {
    infobytes: Vec<u8>,
    directory: Vec<u8>,
}

impl Garbage {
    /// Bytes that a seed gives. Nearly all nodes of even seeds are full, and lead to empty ones in the end.
    pub(crate) fn new(seed: u64) -> Self {
        let mut random = Random::new(seed);
        let infobytes: Vec<u8> = (0..9_000 + seed % 500)
            .map(|_| {
                let bits = random.bits();
                let [a, b, ..] = bits.to_le_bytes();
                if seed.is_multiple_of(2) { u8::from(!bits.is_multiple_of(16)) * 255 } else { a & b }
            })
            .collect();
        // Every fourth sends all nodes far away; the others lead from node to node, in circles, too.
        let most = if seed % 4 == 3 { u64::MAX } else { 9_000 };
        let supers = infobytes.len().div_ceil(8192);
        let mut directory: Vec<u8> = (0..supers).flat_map(|_| (random.bits() % most).to_le_bytes()).collect();
        for _ in 0..infobytes.len().div_ceil(32) {
            directory.extend(u16::try_from(random.bits() % 9_000).unwrap().to_le_bytes());
        }
        Self { infobytes, directory }
    }

    /// The bytes as the structure of a model of this depth.
    pub(crate) fn view(&self, depth: u32) -> ModelView<'_> {
        ModelView::over(depth, u64::MAX, &self.infobytes, &self.directory)
    }
}

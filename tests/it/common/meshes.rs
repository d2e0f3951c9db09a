//! Test bodies, files of them, and a slow exact counter of their voxels.
//!
//! The counter is a second way to the same definition: every voxel centre, moved by (-e, e^2, e^3), against every
//! triangle, with one row at a time and wide integers; it shares no code with the program.
#![allow(clippy::cast_possible_truncation, reason = "coordinates of small bodies")]

use std::collections::BTreeSet;
use std::fmt::Write;

/// Lattice steps of a voxel.
pub(crate) const STEPS: i64 = 4096;

/// Vertices in lattice steps, and triangles of them.
#[derive(Clone, Debug, Default)]
pub(crate) struct Body {
    pub(crate) vertices: Vec<[i64; 3]>,
    pub(crate) faces: Vec<[usize; 3]>,
}

impl Body {
    /// Vertices in voxels.
    pub(crate) fn new(vertices: &[[f64; 3]], faces: &[[usize; 3]]) -> Self {
        let lattice = |c: f64| (c * STEPS as f64).round() as i64;
        Self { vertices: vertices.iter().map(|v| v.map(lattice)).collect(), faces: faces.to_vec() }
    }

    /// A box between two corners.
    pub(crate) fn cuboid(low: [f64; 3], high: [f64; 3]) -> Self {
        let vertices: Vec<[f64; 3]> =
            (0..8).map(|i| std::array::from_fn(|a| if i >> a & 1 == 1 { high[a] } else { low[a] })).collect();
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let faces: Vec<[usize; 3]> =
            quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
        Self::new(&vertices, &faces)
    }

    /// A corner of the space.
    pub(crate) fn tetrahedron(side: f64) -> Self {
        let corners = [[0.0; 3], [side, 0.0, 0.0], [0.0, side, 0.0], [0.0, 0.0, side]];
        Self::new(&corners, &[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    }

    /// An octahedron.
    pub(crate) fn octahedron(center: [f64; 3], radius: f64) -> Self {
        let vertices: Vec<[f64; 3]> = (0..6)
            .map(|i| {
                let mut v = center;
                v[i / 2] += if i % 2 == 0 { radius } else { -radius };
                v
            })
            .collect();
        let faces = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
        Self::new(&vertices, &faces)
    }

    /// A sphere of `8 * 4^steps` triangles.
    pub(crate) fn sphere(center: [f64; 3], radius: f64, steps: u32) -> Self {
        let unit = Self::octahedron([0.0; 3], 1.0);
        let mut vertices: Vec<[f64; 3]> =
            unit.vertices.iter().map(|v| v.map(|c| c as f64 / STEPS as f64)).collect();
        let mut faces = unit.faces;
        for _ in 0..steps {
            let mut middles = std::collections::BTreeMap::new();
            let mut finer = Vec::new();
            for [a, b, c] in faces {
                let mut middle = |p: usize, q: usize| {
                    *middles.entry((p.min(q), p.max(q))).or_insert_with(|| {
                        let m: [f64; 3] = std::array::from_fn(|k| vertices[p][k] + vertices[q][k]);
                        let length = m.iter().map(|c| c * c).sum::<f64>().sqrt();
                        vertices.push(m.map(|c| c / length));
                        vertices.len() - 1
                    })
                };
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                finer.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
            }
            faces = finer;
        }
        let placed: Vec<[f64; 3]> =
            vertices.iter().map(|v| std::array::from_fn(|k| center[k] + radius * v[k])).collect();
        Self::new(&placed, &faces)
    }

    /// Both bodies.
    pub(crate) fn with(mut self, other: &Self) -> Self {
        let first = self.vertices.len();
        self.vertices.extend(&other.vertices);
        self.faces.extend(other.faces.iter().map(|f| f.map(|v| v + first)));
        self
    }

    /// The same with every face turned over.
    pub(crate) fn reversed(mut self) -> Self {
        self.faces.iter_mut().for_each(|f| f.swap(1, 2));
        self
    }

    /// Every triangle cut into four; vertices at even lattice points stay on the lattice.
    pub(crate) fn refined(&self) -> Self {
        let mut out = Self { vertices: self.vertices.clone(), faces: Vec::new() };
        for [a, b, c] in &self.faces {
            let mut middle = |p: usize, q: usize| {
                let m = std::array::from_fn(|k| (self.vertices[p][k] + self.vertices[q][k]) / 2);
                out.vertices.push(m);
                out.vertices.len() - 1
            };
            let (ab, bc, ca) = (middle(*a, *b), middle(*b, *c), middle(*c, *a));
            out.faces.extend([[*a, ab, ca], [*b, bc, ab], [*c, ca, bc], [ab, bc, ca]]);
        }
        out
    }

    /// Lattice points rounded to multiples, so that halves are on the lattice.
    pub(crate) fn snapped(mut self, multiple: i64) -> Self {
        let snap = |c: i64| (c as f64 / multiple as f64).round() as i64 * multiple;
        self.vertices.iter_mut().for_each(|v| *v = v.map(snap));
        self
    }

    pub(crate) fn triangles(&self) -> impl Iterator<Item = [[i64; 3]; 3]> + '_ {
        self.faces.iter().map(|f| f.map(|v| self.vertices[v]))
    }

    fn single(c: i64) -> f32 {
        (c as f64 / STEPS as f64) as f32
    }

    pub(crate) fn stl(&self) -> Vec<u8> {
        let mut out = vec![0; 80];
        out.extend(u32::try_from(self.faces.len()).unwrap().to_le_bytes());
        for t in self.triangles() {
            out.extend([0; 12]);
            t.iter().flatten().for_each(|c| out.extend(Self::single(*c).to_le_bytes()));
            out.extend([0; 2]);
        }
        out
    }

    pub(crate) fn stl_text(&self) -> Vec<u8> {
        let mut out = String::from("solid a body\n");
        for t in self.triangles() {
            out += "facet normal 0 0 0\n outer loop\n";
            for v in t {
                let [x, y, z] = v.map(Self::single);
                writeln!(out, "  vertex {x} {y} {z}").unwrap();
            }
            out += " endloop\nendfacet\n";
        }
        (out + "endsolid a body\n").into_bytes()
    }

    /// PLY in one of its three forms: `ascii`, `binary_little_endian`, `binary_big_endian`.
    pub(crate) fn ply(&self, form: &str) -> Vec<u8> {
        let mut out = format!(
            "ply\nformat {form} 1.0\ncomment a body\nelement vertex {}\nproperty uchar flags\nproperty float x\nproperty float y\nproperty float z\nelement face {}\nproperty list uchar int vertex_indices\nproperty short group\nend_header\n",
            self.vertices.len(),
            self.faces.len()
        )
        .into_bytes();
        let big = form == "binary_big_endian";
        let four = |mut bytes: [u8; 4]| {
            if big {
                bytes.reverse();
            }
            bytes
        };
        for v in &self.vertices {
            let v = v.map(Self::single);
            if form == "ascii" {
                out.extend(format!("7 {} {} {}\n", v[0], v[1], v[2]).bytes());
            } else {
                out.push(7);
                v.iter().for_each(|c| out.extend(four(c.to_le_bytes())));
            }
        }
        for f in &self.faces {
            if form == "ascii" {
                out.extend(format!("3 {} {} {} 9\n", f[0], f[1], f[2]).bytes());
            } else {
                out.push(3);
                f.iter().for_each(|v| out.extend(four(u32::try_from(*v).unwrap().to_le_bytes())));
                out.extend([9, 9]);
            }
        }
        out
    }

    pub(crate) fn obj(&self) -> Vec<u8> {
        let mut out = String::from("# a body\nmtllib none.mtl\no body\n");
        for v in &self.vertices {
            let [x, y, z] = v.map(Self::single);
            writeln!(out, "v {x} {y} {z}").unwrap();
        }
        out += "vn 0 0 1\nusemtl none\ns off\n";
        for (at, f) in self.faces.iter().enumerate() {
            if at % 2 == 0 {
                writeln!(out, "f {}//1 {}//1 {}//1", f[0] + 1, f[1] + 1, f[2] + 1).unwrap();
            } else {
                let back = f.map(|v| v as i64 - self.vertices.len() as i64);
                writeln!(out, "f {} {} {}", back[0], back[1], back[2]).unwrap();
            }
        }
        out.into_bytes()
    }

    pub(crate) fn off(&self) -> Vec<u8> {
        let mut out = format!("OFF\n# a body\n{} {} 0\n", self.vertices.len(), self.faces.len());
        for v in &self.vertices {
            let [x, y, z] = v.map(Self::single);
            writeln!(out, "{x} {y} {z}").unwrap();
        }
        for f in &self.faces {
            writeln!(out, "3 {} {} {}", f[0], f[1], f[2]).unwrap();
        }
        out.into_bytes()
    }

    /// Sums of signed crossings before every voxel of a grid, by the definition.
    pub(crate) fn winding(&self, [nx, ny, nz]: [i64; 3]) -> Vec<i32> {
        let mut sums = vec![0; usize::try_from(nx * ny * nz).unwrap()];
        // Scaled, so that e^2 and e^3 are numbers: far below what lattice distances can tell apart.
        let scale = 1_i128 << 40;
        let far = |c: i64| i128::from(c) * scale;
        for t in self.triangles() {
            let low: [i64; 3] = std::array::from_fn(|a| t.iter().map(|v| v[a]).min().unwrap());
            let high: [i64; 3] = std::array::from_fn(|a| t.iter().map(|v| v[a]).max().unwrap());
            let rows =
                |a: usize, n: i64| (low[a] / STEPS - 1).max(0)..(high[a].div_euclid(STEPS) + 2).clamp(0, n);
            for z in rows(2, nz) {
                for y in rows(1, ny) {
                    let moved = [far(y * STEPS + STEPS / 2) + (1 << 20), far(z * STEPS + STEPS / 2) + 1];
                    let side = |p: [i64; 3], q: [i64; 3]| {
                        (far(q[1]) - far(p[1])) * (moved[1] - far(p[2]))
                            - (far(q[2]) - far(p[2])) * (moved[0] - far(p[1]))
                    };
                    let sides = [side(t[1], t[2]), side(t[2], t[0]), side(t[0], t[1])];
                    let sign = if sides.iter().all(|s| *s > 0) {
                        1
                    } else if sides.iter().all(|s| *s < 0) {
                        -1
                    } else {
                        continue;
                    };
                    // The crossing of the row that was not moved; a centre, moved by -e, must be beyond it.
                    let centre = [y * STEPS + STEPS / 2, z * STEPS + STEPS / 2].map(i128::from);
                    let weight = |p: [i64; 3], q: [i64; 3]| {
                        let [p, q] = [p, q].map(|v| v.map(i128::from));
                        (q[1] - p[1]) * (centre[1] - p[2]) - (q[2] - p[2]) * (centre[0] - p[1])
                    };
                    let weights = [weight(t[1], t[2]), weight(t[2], t[0]), weight(t[0], t[1])];
                    let area: i128 = weights.iter().sum();
                    let sum: i128 = weights.iter().zip(t).map(|(w, v)| w * i128::from(v[0])).sum();
                    for x in 0..nx {
                        let at = i128::from(x * STEPS + STEPS / 2) * area;
                        if (area > 0 && at > sum) || (area < 0 && at < sum) {
                            sums[usize::try_from((z * ny + y) * nx + x).unwrap()] += sign;
                        }
                    }
                }
            }
        }
        sums
    }
}

/// Voxels with a face neighbour that is not inside.
pub(crate) fn skin(inside: &dyn Fn([i64; 3]) -> bool, [nx, ny, nz]: [i64; 3]) -> BTreeSet<[u32; 3]> {
    let all = (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])));
    all.filter(|p| {
        inside(*p)
            && (0..3).any(|a| {
                [-1, 1].into_iter().any(|d| {
                    let mut q = *p;
                    q[a] += d;
                    !inside(q)
                })
            })
    })
    .map(|p| p.map(|c| u32::try_from(c).unwrap()))
    .collect()
}

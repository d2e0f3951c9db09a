//! The rigid motion that brings one surface closest to another: point to plane, round after round.
//!
//! Each round moves samples of one surface by the step that makes their heights over the planes of their nearest facets
//! least (Chen and Medioni 1992), weighted by area. From the second round on samples farther than three times the distance
//! of 68 % of them are left out. A direction in which the heights hardly change, such as the rotation of a ball, is free: it is
//! held, and named.

use crate::fault::{Fault, unfit};
use crate::geom::{Affine, cross, dot};

use super::nearest::{OctreeBox, Query, Sample, Search};

/// Fewest samples.
const MIN_SAMPLES: usize = 1000;

/// Greatest number of rounds.
const MAX_ROUNDS: u32 = 50;

/// A direction is free where its part of all heights' change is less than this.
const FREE: f64 = 0.01;

/// A round that moves no sample by more than this many voxels is the last.
const STILL: f64 = 1e-6;

/// How far samples may be, as a multiple of the distance of 68 % of them.
const CUT: f64 = 3.0;

/// A motion, and how good it is.
#[derive(Clone, Debug)]
pub(crate) struct Fit {
    pub(crate) placement: Affine,
    pub(crate) rounds: u32,
    /// Root mean square distances before and after, in mm.
    pub(crate) rms: [f64; 2],
    /// Directions that were held, in words.
    pub(crate) free: Vec<String>,
}

/// A sample and its counterpart.
struct Pair {
    at: [f64; 3],
    normal: [f64; 3],
    /// Height over the counterpart's plane, and distance.
    height: f64,
    distance: f64,
    area: f64,
}

/// Fits samples of one surface (in its mm) to another one, from a first placement on; `None` if it is stopped, which is asked
/// before each sample.
///
/// Memory: 200 bytes a sample. Cost: some ten rounds of a few microseconds a sample.
///
/// # Errors
/// There are too few samples, the surfaces determine no direction, or what is left is more than `most_mm`.
pub(crate) fn fit(
    samples: &[Sample],
    first: Affine,
    search: &mut Search<'_>,
    most_mm: f64,
    is_stopped: &mut dyn FnMut() -> bool,
) -> Result<Option<Fit>, Fault> {
    if samples.len() < MIN_SAMPLES {
        return Err(unfit!(
            "has only {} cells to be fitted by, and {MIN_SAMPLES} are needed; build it finer, or place it by hand",
            samples.len()
        ));
    }
    let mut seeds: Vec<Option<OctreeBox>> = vec![None; samples.len()];
    let mut fit = Fit { placement: first, rounds: 0, rms: [0.0; 2], free: Vec::new() };
    let finest = search.surface.space.finest;
    loop {
        let Some(mut pairs) = pairs(samples, &fit.placement, &mut seeds, (search, is_stopped)) else {
            return Ok(None);
        };
        let all = rms(&pairs);
        if fit.rounds == 0 {
            fit.rms[0] = all;
        } else {
            cut(&mut pairs);
        }
        fit.rms[1] = rms(&pairs);
        if pairs.len() < MIN_SAMPLES {
            return Err(apart(fit.rms[1]));
        }
        let (step, free) = step(&pairs);
        if free.len() == 6 {
            return Err(unfit!("has a surface that determines no direction of the fit; place it by hand"));
        }
        fit.free = free;
        fit.placement = step.motion.after(&fit.placement);
        fit.rounds += 1;
        if step.moves < STILL * finest || fit.rounds == MAX_ROUNDS {
            break;
        }
    }
    if fit.rms[1] > most_mm { Err(apart(fit.rms[1])) } else { Ok(Some(fit)) }
}

fn apart(rms: f64) -> Fault {
    unfit!(
        "is {rms:.3} mm (RMS) from the nominal after the fit, which has not found how it lies; turn it to within 30 degrees \
         of that first, by a placement, or give a larger radius"
    )
}

/// Samples with a counterpart that is not turned away; `None` if `is_stopped` says so.
fn pairs(
    samples: &[Sample],
    placement: &Affine,
    seeds: &mut [Option<OctreeBox>],
    (search, is_stopped): (&mut Search<'_>, &mut dyn FnMut() -> bool),
) -> Option<Vec<Pair>> {
    let space = search.surface.space;
    let mut pairs = Vec::with_capacity(samples.len());
    for (sample, seed) in samples.iter().zip(seeds) {
        if is_stopped() {
            return None;
        }
        let at = placement.apply(sample.point);
        let normal = space.direction_to_frame(placement.apply_vector(sample.normal));
        search.start_at(*seed);
        let point = space.to_frame(at);
        let Some(found) = search.nearest(point, &Query::ANY) else { continue };
        *seed = Some(found.place);
        if dot(found.normal, normal) < 0.0 || search.surface.is_border(found.point) {
            continue;
        }
        let apart: [f64; 3] = std::array::from_fn(|a| point[a] - found.point[a]);
        pairs.push(Pair {
            at,
            normal: space.direction_to_world(found.normal),
            height: dot(apart, found.normal),
            distance: found.distance(),
            area: sample.area,
        });
    }
    Some(pairs)
}

fn rms(pairs: &[Pair]) -> f64 {
    let [area, square] = pairs.iter().fold([0.0; 2], |[area, square], pair| {
        [area + pair.area, square + pair.area * pair.distance * pair.distance]
    });
    if area > 0.0 { (square / area).sqrt() } else { 0.0 }
}

/// Leaves out pairs that are much farther than most.
fn cut(pairs: &mut Vec<Pair>) {
    let mut distances: Vec<f64> = pairs.iter().map(|pair| pair.distance).collect();
    distances.sort_by(f64::total_cmp);
    let most = distances.get(distances.len() * 68 / 100).map_or(0.0, |distance| CUT * distance);
    pairs.retain(|pair| pair.distance <= most);
}

/// A small motion.
struct Step {
    motion: Affine,
    /// About how far it moves samples, in mm.
    moves: f64,
}

/// The step that makes the heights least, and the directions that it held.
fn step(pairs: &[Pair]) -> (Step, Vec<String>) {
    let area: f64 = pairs.iter().map(|pair| pair.area).sum();
    let mean = |of: &dyn Fn(&Pair) -> f64| pairs.iter().map(|pair| pair.area * of(pair)).sum::<f64>() / area;
    let middle = [0, 1, 2].map(|a| mean(&|pair| pair.at[a]));
    let from = |pair: &Pair| -> [f64; 3] { std::array::from_fn(|a| pair.at[a] - middle[a]) };
    // Turns are measured by the length that they move a sample at this distance.
    let reach = mean(&|pair| dot(from(pair), from(pair))).sqrt().max(f64::MIN_POSITIVE);
    let (mut matrix, mut right) = ([[0.0; 6]; 6], [0.0; 6]);
    for pair in pairs {
        let turn = cross(from(pair), pair.normal).map(|c| c / reach);
        let row = [turn[0], turn[1], turn[2], pair.normal[0], pair.normal[1], pair.normal[2]];
        for i in 0..6 {
            for j in 0..6 {
                matrix[i][j] += pair.area * row[i] * row[j];
            }
            right[i] -= pair.area * row[i] * pair.height;
        }
    }
    let trace: f64 = (0..6).map(|i| matrix[i][i]).sum();
    let mut free = Vec::new();
    let mut motion = [0.0; 6];
    for (value, direction) in eigen(matrix) {
        if value < FREE * trace {
            free.push(name(&direction));
            continue;
        }
        let along = (0..6).map(|i| direction[i] * right[i]).sum::<f64>() / value;
        (0..6).for_each(|i| motion[i] += along * direction[i]);
    }
    let moves = motion.iter().map(|c| c * c).sum::<f64>().sqrt();
    let [a, b, c, x, y, z] = motion;
    let turned = turn([a, b, c].map(|c| c / reach));
    let mut rows = [[0.0; 4]; 3];
    for (i, (row, turned)) in rows.iter_mut().zip(turned).enumerate() {
        row[..3].copy_from_slice(&turned);
        row[3] = middle[i] - dot(turned, middle) + [x, y, z][i];
    }
    (Step { motion: Affine { rows }, moves }, free)
}

/// The rotation of a vector: about it, by its length (Rodrigues).
fn turn(vector: [f64; 3]) -> [[f64; 3]; 3] {
    let angle = dot(vector, vector).sqrt();
    let axis = if angle > 0.0 { vector.map(|c| c / angle) } else { [0.0, 0.0, 1.0] };
    let (sin, cos) = angle.sin_cos();
    let image = |e: [f64; 3]| -> [f64; 3] {
        let (across, along) = (cross(axis, e), dot(axis, e));
        std::array::from_fn(|a| cos * e[a] + sin * across[a] + (1.0 - cos) * along * axis[a])
    };
    let columns = [image([1.0, 0.0, 0.0]), image([0.0, 1.0, 0.0]), image([0.0, 0.0, 1.0])];
    std::array::from_fn(|row| columns.map(|column| column[row]))
}

/// A direction of motion in words.
fn name(direction: &[f64; 6]) -> String {
    let [turn, shift] =
        [[direction[0], direction[1], direction[2]], [direction[3], direction[4], direction[5]]];
    let is_turn = dot(turn, turn) >= dot(shift, shift);
    let main = if is_turn { turn } else { shift };
    // One sign for both directions of an axis.
    let largest = main.iter().fold(0.0_f64, |most, c| if c.abs() > most.abs() + 1e-9 { *c } else { most });
    let [x, y, z] = main.map(|c| c / (dot(main, main).sqrt() * largest.signum()) + 0.0);
    let what = if is_turn { "rotation about" } else { "translation along" };
    format!("{what} ({x:.2}, {y:.2}, {z:.2})")
}

/// Eigenvalues and unit eigenvectors of a symmetric matrix, the greatest first (Jacobi's rotations).
fn eigen(mut m: [[f64; 6]; 6]) -> [(f64, [f64; 6]); 6] {
    let mut vectors: [[f64; 6]; 6] =
        std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))));
    for _ in 0..30 {
        for (p, q) in (0..6).flat_map(|p| (p + 1..6).map(move |q| (p, q))) {
            if m[p][q].abs() <= f64::EPSILON * (m[p][p] * m[q][q]).abs().sqrt() {
                continue;
            }
            let theta = (m[q][q] - m[p][p]) / (2.0 * m[p][q]);
            let t = 1.0_f64.copysign(theta) / (theta.abs() + theta.hypot(1.0));
            let c = 1.0 / t.hypot(1.0);
            let s = t * c;
            for row in &mut m {
                (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
            }
            for k in 0..6 {
                (m[p][k], m[q][k]) = (c * m[p][k] - s * m[q][k], s * m[p][k] + c * m[q][k]);
                (vectors[p][k], vectors[q][k]) =
                    (c * vectors[p][k] - s * vectors[q][k], s * vectors[p][k] + c * vectors[q][k]);
            }
        }
    }
    let mut all: [(f64, [f64; 6]); 6] = std::array::from_fn(|i| (m[i][i], vectors[i]));
    crate::order::by(&mut all, |a, b| b.0.total_cmp(&a.0));
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eigenvectors_are_those_of_the_matrix() {
        let m: [[f64; 6]; 6] = std::array::from_fn(|i| {
            std::array::from_fn(|j| 1.0 / (i + j + 1) as f64 + if i == j { i as f64 } else { 0.0 })
        });
        let found = eigen(m);
        assert!(found.windows(2).all(|pair| pair[0].0 >= pair[1].0));
        for (value, vector) in found {
            for (row, v) in m.iter().zip(vector) {
                let image: f64 = row.iter().zip(vector).map(|(a, b)| a * b).sum();
                assert!((image - value * v).abs() < 1e-12);
            }
        }
        assert_eq!(name(&[0.0, 0.0, -1.0, 0.1, 0.0, 0.0]), "rotation about (0.00, 0.00, 1.00)");
    }
}

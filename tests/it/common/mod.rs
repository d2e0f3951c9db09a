//! What several tests need: small models in memory here, the rest in files by subject.
#![expect(clippy::cast_possible_truncation, reason = "numbers here are small by construction")]

pub(crate) mod assembled;
pub(crate) mod bodies;
pub(crate) mod command;
pub(crate) mod compress;
pub(crate) mod containers;
pub(crate) mod counting;
pub(crate) mod data;
pub(crate) mod dicom;
pub(crate) mod forged;
pub(crate) mod formats;
pub(crate) mod frames;
pub(crate) mod memory_tree;
pub(crate) mod meshes;
pub(crate) mod models;
pub(crate) mod oracle;
pub(crate) mod random;
pub(crate) mod scenes;
pub(crate) mod schema;
#[allow(unused_imports, reason = "each program uses its own part")]
pub(crate) mod system;
pub(crate) mod tempfile;
pub(crate) mod traverse;
pub(crate) mod vectors;
pub(crate) mod volume;

use random::Random;

use assembled::{AssembledVoxel, OptionalSections, assemble, plain_metadata};
use infobyte::format::{Metadata, SourceMeta, normal};

/// How many times as much is tried as in a usual run, where random rays, volumes and bytes are: `INFOBYTE_LONG`, or 1.
pub(crate) fn long() -> u32 {
    std::env::var("INFOBYTE_LONG").ok().map_or(1, |n| n.parse().expect("INFOBYTE_LONG is a number of times"))
}

/// Pairs of a cap and a number of threads: each cap, each number, and half of their pairs; all of them with
/// `INFOBYTE_LONG`, as `scripts/long.sh` sets it.
pub(crate) fn caps_and_threads<'a, C: Copy>(caps: &[C], threads: &[&'a str]) -> Vec<(C, &'a str)> {
    let is_line = caps.len().min(threads.len()) == 1;
    let mut pairs = Vec::new();
    for (i, cap) in caps.iter().enumerate() {
        let some = threads.iter().enumerate().filter(|(k, _)| (i + k) % 2 == 0 || is_line || long() > 1);
        pairs.extend(some.map(|(_, count)| (*cap, *count)));
    }
    pairs
}

/// Normals and coarse means, no values.
pub(crate) const NORMALS: OptionalSections = OptionalSections { normal: true, value_bytes: 0, lod: true };

/// Everything that an assembled file can have.
pub(crate) const FULL: OptionalSections = OptionalSections { normal: true, value_bytes: 2, lod: true };

/// Metadata of a volume with unit spacing, inside from 1 on.
pub(crate) fn metadata(dims: [u32; 3], channels: OptionalSections) -> Metadata {
    Metadata {
        source: SourceMeta { format: "raw".into(), kind: "e.raw".into(), files: 1, bytes: 6 },
        ..plain_metadata(dims, channels)
    }
}

/// A shell of a ball with rough normals, in a box of `dims`.
pub(crate) fn shell(dims: [u32; 3], channels: OptionalSections, seed: u64) -> Vec<u8> {
    let mut random = Random(seed);
    shell_of(dims, channels, |n| random.below(n))
}

/// The same with numbers from elsewhere: `below(n)` gives the next one below `n`.
pub(crate) fn shell_of(
    dims: [u32; 3],
    channels: OptionalSections,
    mut below: impl FnMut(u64) -> u64,
) -> Vec<u8> {
    let center = dims.map(|n| f64::from(n) / 2.0 - 0.5);
    let radius = dims.map(f64::from).into_iter().fold(f64::INFINITY, f64::min) / 2.0 - 1.0;
    let mut voxels = Vec::new();
    for z in 0..dims[2] {
        for y in 0..dims[1] {
            for x in 0..dims[0] {
                let d = [0, 1, 2].map(|a| f64::from([x, y, z][a]) - center[a]);
                let length = d.iter().map(|c| c * c).sum::<f64>().sqrt();
                if (length - radius).abs() < 0.6 {
                    let rough = d.map(|c| (c + below(100) as f64 / 100.0 - 0.5) as f32);
                    voxels.push(AssembledVoxel {
                        cell: [x, y, z],
                        normal: normal::encode(rough),
                        value: below(1 << (8 * channels.value_bytes)) as u16,
                    });
                }
            }
        }
    }
    assemble(&metadata(dims, channels), &voxels, channels)
}

/// The two opposite corners of a small box, or its only voxel.
pub(crate) fn corner(dims: [u32; 3], channels: OptionalSections) -> Vec<u8> {
    let voxel = |cell, direction, value| AssembledVoxel { cell, normal: normal::encode(direction), value };
    let mut voxels = vec![voxel([0; 3], [-1.0, 0.0, 0.0], 3)];
    if dims != [1, 1, 1] {
        voxels.push(voxel(dims.map(|n| n - 1), [0.0, 0.5, -1.0], 200));
    }
    assemble(&metadata(dims, channels), &voxels, channels)
}

//! 3MF (3MF Consortium, Core 1.3 with the production and materials extensions): an archive with a text of vertices
//! and triangles.
//!
//! The text is read once as a stream; vertices, triangles and colours wait in scratch files, objects with their
//! parts in memory. Objects are placed anew in every pass. Units of the file become millimetres; the z axis is up.
//!
//! | part | what it holds |
//! |---|---|
//! | `model` | the text |
//! | `archive` | the texts of the archive |
//! | `marked` | objects and parts that slicers mark as not to be printed |

mod archive;
mod marked;
mod model;

use std::collections::BTreeMap;

use super::appearance::{Appearance, Material, NO_MATERIAL};
use super::gltf::{MAX_TRIANGLES, MAX_TRIANGLES_PER_BYTE};
use super::stop::{EachLook, Stop, finite};
use super::stream::{Stream, numbers};
use super::vertex_looks::single;
use super::vertices::{FEW_PAGES, PAGES, Pages, Vertices};
use super::{Limits, Summary};
use crate::geom::Affine;
use crate::mesh::read::stop::{bad_index, bad_reference, bad_transform, recursion, too_many_triangles};
use crate::platform::PositionalFile;

/// Bytes of a triangle in its file: corners, and with looks the values at these and their meaning.
const RECORD: usize = 12;
const LOOKED: usize = 28;
/// Marks a triangle without values; others have colours, or places in the texture of this number.
const PLAIN: u32 = u32::MAX;
const COLORED: u32 = u32::MAX - 1;
/// Greatest depth of objects in objects.
const MAX_DEPTH: usize = 64;

/// Receives first vertex, vertices, first triangle and triangles of a mesh, and its placement.
type EachMesh<'a> = dyn FnMut([u64; 4], &Affine) -> Result<(), Stop> + 'a;

/// An object by its number, in the text of this number.
type Key = (u32, u32);

#[derive(Clone, Debug)]
enum Object {
    /// First vertex, vertices, first triangle, triangles.
    Mesh([u64; 4]),
    Parts(Vec<Instance>),
}

/// An object in its place.
#[derive(Clone, Copy, Debug)]
struct Instance {
    key: Key,
    at: Affine,
}

/// The content of the texts of an archive.
struct Contents {
    vertices: Vertices,
    triangles: PositionalFile,
    values: Vertices,
    objects: BTreeMap<Key, Object>,
    items: Vec<Instance>,
    materials: Vec<Material>,
    lacks: Vec<String>,
}

pub(super) struct ThreeMf {
    contents: Contents,
    looks: bool,
}

/// Looks at the list of the archive alone.
pub(super) fn check(file: &PositionalFile, bytes: u64) -> Result<(), Stop> {
    archive::root(file, bytes).map(drop)
}

pub(super) fn open(
    file: PositionalFile,
    bytes: u64,
    limits: &Limits<'_>,
) -> Result<(ThreeMf, Summary), Stop> {
    let (mut contents, held_bytes, inflated) = archive::read(file, bytes, limits)?;
    let materials = std::mem::take(&mut contents.materials);
    let lacks = std::mem::take(&mut contents.lacks);
    let looks = [contents.values.count > 0 || !materials.is_empty(), false];
    let open = ThreeMf { contents, looks: limits.colors };
    let parts = open.check(inflated)?;
    Ok((open, Summary { materials, lacks, held_bytes, parts, looks, ..Summary::default() }))
}

impl ThreeMf {
    /// Counts triangles as often as objects hold them; returns the number of meshes that are built.
    fn check(&self, inflated: u64) -> Result<u64, Stop> {
        let most = MAX_TRIANGLES + inflated.saturating_mul(MAX_TRIANGLES_PER_BYTE);
        let (mut all, mut parts) = (0_u64, 0);
        self.walk(&mut |[.., triangles], _| {
            parts += u64::from(triangles > 0);
            // An empty object costs time, too.
            all = all.saturating_add(triangles.max(1));
            if all > most { Err(too_many_triangles(most).into()) } else { Ok(()) }
        })?;
        Ok(parts)
    }

    /// Calls `each` with every mesh that is built and its affine.
    fn walk(&self, each: &mut EachMesh<'_>) -> Result<(), Stop> {
        let mut steps = 0_u64;
        for item in &self.contents.items {
            // The remaining parts of each object on the way.
            let mut way: Vec<(&[Instance], Affine)> = vec![(std::slice::from_ref(item), IDENTITY)];
            while let Some((left, parent)) = way.last_mut() {
                let Some((first, rest)) = left.split_first() else {
                    way.pop();
                    continue;
                };
                *left = rest;
                let at = parent.after(&first.at);
                if !at.rows.iter().flatten().all(|v| v.is_finite()) {
                    return Err(bad_transform().into());
                }
                steps += 1;
                if steps > MAX_TRIANGLES {
                    return Err(too_many_triangles(MAX_TRIANGLES).into());
                }
                let object = self.contents.objects.get(&first.key);
                match object.ok_or_else(|| bad_reference("an object"))? {
                    Object::Mesh(runs) => each(*runs, &at)?,
                    Object::Parts(parts) => {
                        if way.len() >= MAX_DEPTH {
                            return Err(recursion().into());
                        }
                        way.push((parts, at));
                    }
                }
            }
        }
        Ok(())
    }

    /// Calls `each` with every triangle, in millimetres.
    pub(super) fn for_each(&self, each: &mut EachLook<'_>) -> Result<(), Stop> {
        let Contents { vertices, values, triangles, .. } = &self.contents;
        let mut points = Pages::new(vertices, PAGES);
        let mut looks = Pages::new(values, FEW_PAGES);
        let mut faces = 0;
        let mut next_part = 0_u32;
        let record = if self.looks { LOOKED } else { RECORD } as u64;
        self.walk(&mut |[first, count, from, triangle_count], placed| {
            let part = next_part;
            next_part = next_part.saturating_add(u32::from(triangle_count > 0));
            let mut stream = Stream::new(triangles, from * record);
            let mirrored = placed.determinant() < 0.0;
            for _ in 0..triangle_count {
                let corners: [u8; RECORD] = stream.take()?;
                let mut t: [u32; 3] = numbers(&corners);
                let mut look = Appearance { part, ..Appearance::NONE };
                let mut of = [0; 3];
                if self.looks {
                    let more: [u8; LOOKED - RECORD] = stream.take()?;
                    let values: [u32; 4] = numbers(&more);
                    [of[0], of[1], of[2], look.material] = values;
                }
                if mirrored {
                    t.swap(1, 2);
                    of.swap(1, 2);
                }
                let mut at = [[0.0; 3]; 3];
                for (out, corner) in at.iter_mut().zip(t) {
                    if u64::from(corner) >= count {
                        return Err(bad_index(faces + 1, count).into());
                    }
                    *out = placed.apply(points.get(first + u64::from(corner), faces)?);
                }
                faces += 1;
                finite(&at, faces)?;
                let kind = std::mem::replace(&mut look.material, NO_MATERIAL);
                if kind != PLAIN && self.looks {
                    let mut three = [[0.0_f32; 3]; 3];
                    for (out, value) in three.iter_mut().zip(of) {
                        *out = single(looks.get(value.into(), faces)?);
                    }
                    if kind == COLORED {
                        look.colors = Some(three);
                    } else {
                        look.material = kind;
                        look.places = Some(three.map(|[u, v, _]| [u, v]));
                    }
                }
                each(&at, &look)?;
            }
            Ok(())
        })
    }
}

const IDENTITY: Affine = Affine { rows: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]] };

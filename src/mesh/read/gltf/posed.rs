//! Meshes that nodes do not merely place: bent by the joints of a skin, or placed many times.

use std::collections::{BTreeMap, BTreeSet};

use super::super::Limits;
use super::super::stop::Stop;
use super::super::vertices::Spool;
use super::buffers::{Items, item, out_of_range};
use super::json::{Instancing, Node, Primitive, Shape};
use super::{Gltf, IDENTITY, cofactors, turned_place};
use crate::geom::Affine;
use crate::mesh::read::stop::bad_transform;

/// Memory of a joint: its place in the scene, and its matrix.
const JOINT_BYTES: u64 = 256;

/// Vertices of a primitive of a node, bent by its skin, in millimetres.
pub(super) struct Bent {
    pub(super) positions: Items,
    pub(super) normals: Option<Items>,
    /// True if the joints mirror it.
    pub(super) mirrored: bool,
}

/// Bent primitives, by numbers of nodes, and of primitives of their meshes.
pub(super) type BentMeshes = BTreeMap<(usize, usize), Bent>;

/// Places of the copies of a mesh (EXT_mesh_gpu_instancing).
pub(super) struct Copies {
    parts: [Option<Items>; 3],
    pub(super) count: u64,
}

impl Copies {
    /// Copies of a node's mesh; a single one, if nothing else is stated. A skin places the mesh itself.
    pub(super) fn of(gltf: &Gltf, node: &Node) -> Result<Self, Stop> {
        let single = Self { parts: [None, None, None], count: 1 };
        let Some(Instancing { attributes }) = &node.extensions.instancing else { return Ok(single) };
        if node.skin.is_some() {
            return Ok(single);
        }
        let mut copies = single;
        let stated = [attributes.translation, attributes.rotation, attributes.scale];
        let shapes = [Shape::Three, Shape::Four, Shape::Three];
        for ((at, shape), part) in stated.into_iter().zip(shapes).zip(&mut copies.parts) {
            let Some(at) = at else { continue };
            let items = gltf.buffers.items(&gltf.described, at)?;
            if items.shape != shape {
                return Err(out_of_range("an accessor"));
            }
            copies.count = items.count;
            *part = Some(items);
        }
        if copies.parts.iter().flatten().any(|items| items.count != copies.count) {
            return Err(out_of_range("an accessor"));
        }
        Ok(copies)
    }

    /// Affine of a copy within the node.
    pub(super) fn place(&self, at: u64) -> Result<Affine, Stop> {
        let get = |part: usize| self.parts[part].as_ref().map(|items| items.at(at)).transpose();
        let [translation, rotation, scale] = [get(0)?, get(1)?, get(2)?];
        let place = turned_place(
            translation.map(|[x, y, z, _]| [x, y, z]),
            rotation,
            scale.map(|[x, y, z, _]| [x, y, z]),
        )?;
        if place.rows.iter().flatten().all(|v| v.is_finite()) {
            Ok(place)
        } else {
            Err(bad_transform().into())
        }
    }
}

/// Bends every mesh of a node with a skin into scratch files, as the scene poses its joints at rest.
pub(super) fn bent_meshes(gltf: &Gltf, limits: &Limits<'_>) -> Result<BentMeshes, Stop> {
    let root = &gltf.described.root;
    let mut skinned = Vec::new();
    let mut wanted = BTreeSet::new();
    let mut needed_bytes = gltf.described.held_bytes;
    gltf.walk(&mut |node, at, placed| {
        if let (Some(_), Some(skin)) = (node.mesh, node.skin) {
            let joints = &item(&root.skins, skin, "a skin or a joint")?.joints;
            needed_bytes += JOINT_BYTES * joints.len() as u64;
            let allowed_bytes = limits.most_bytes;
            if needed_bytes > allowed_bytes {
                return Err(Stop::Memory { needed_bytes, allowed_bytes });
            }
            wanted.extend(joints.iter().copied());
            skinned.push((at, *placed));
        }
        Ok(())
    })?;
    let mut places = BTreeMap::new();
    if !skinned.is_empty() {
        gltf.walk_all(&mut |_, at, placed, _| {
            if let Some(at) = u32::try_from(at).ok().filter(|at| wanted.contains(at)) {
                places.insert(at, *placed);
            }
            Ok(())
        })?;
    }
    let mut bent = BentMeshes::new();
    for (at, placed) in skinned {
        let node = item(&root.nodes, u32::try_from(at).unwrap_or(u32::MAX), "a node")?;
        let (Some(mesh), Some(skin)) = (node.mesh, node.skin) else { continue };
        let skin = item(&root.skins, skin, "a skin or a joint")?;
        let inverse =
            skin.inverse_bind_matrices.map(|at| gltf.buffers.matrices(&gltf.described, at)).transpose()?;
        let joint = |(number, node): (usize, &u32)| {
            let place: &Affine = places.get(node).ok_or_else(|| out_of_range("a node"))?;
            let Some(inverse) = &inverse else { return Ok(*place) };
            Ok::<_, Stop>(place.after(inverse.get(number).ok_or_else(|| out_of_range("a skin or a joint"))?))
        };
        let joints = skin.joints.iter().enumerate().map(joint).collect::<Result<Vec<Affine>, Stop>>()?;
        for (number, primitive) in item(&root.meshes, mesh, "a mesh")?.primitives.iter().enumerate() {
            if let Some(vertices) = bend(gltf, primitive, &joints, &placed, limits)? {
                bent.insert((at, number), vertices);
            }
        }
    }
    Ok(bent)
}

/// Every vertex as its joints place it, by their weights; `None` for a primitive without weights.
fn bend(
    gltf: &Gltf,
    primitive: &Primitive,
    joints: &[Affine],
    placed: &Affine,
    limits: &Limits<'_>,
) -> Result<Option<Bent>, Stop> {
    let Some(prepared) = gltf.prepared(primitive)? else { return Ok(None) };
    let of = &primitive.attributes;
    let mut sets = Vec::new();
    for set in [(of.joints_0, of.weights_0), (of.joints_1, of.weights_1)] {
        let (Some(numbers), Some(weights)) = set else { continue };
        let [numbers, weights] =
            [gltf.buffers.items(&gltf.described, numbers)?, gltf.buffers.items(&gltf.described, weights)?];
        for items in [&numbers, &weights] {
            if items.shape != Shape::Four || items.count < prepared.positions.count {
                return Err(out_of_range("an accessor"));
            }
        }
        sets.push((numbers, weights));
    }
    if sets.is_empty() {
        return Ok(None);
    }
    let mut positions = Spool::new(limits.scratch);
    let mut normals = prepared.normals.is_some().then(|| Spool::new(limits.scratch));
    for vertex in 0..prepared.positions.count {
        let (mut sum, mut rows) = (0.0, [[0.0; 4]; 3]);
        for (numbers, weights) in &sets {
            for (number, weight) in numbers.at(vertex)?.into_iter().zip(weights.at(vertex)?) {
                if weight == 0.0 {
                    continue;
                }
                #[expect(clippy::cast_possible_truncation, reason = "16 bits, or refused")]
                let joint = joints.get(number as usize).ok_or_else(|| out_of_range("a skin or a joint"))?;
                sum += weight;
                for (out, from) in rows.as_flattened_mut().iter_mut().zip(joint.rows.as_flattened()) {
                    *out += weight * from;
                }
            }
        }
        let at = if sum == 0.0 { *placed } else { Affine { rows: rows.map(|row| row.map(|c| c / sum)) } };
        let [x, y, z, _] = prepared.positions.at(vertex)?;
        positions.vertex(at.apply([x, y, z]))?;
        if let (Some(spool), Some(items)) = (&mut normals, &prepared.normals) {
            let [x, y, z, _] = items.at(vertex)?;
            spool.vertex(cofactors(&at, at.determinant() < 0.0).apply_vector([x, y, z]))?;
        }
    }
    Ok(Some(Bent {
        positions: Items::written(positions)?,
        normals: normals.map(Items::written).transpose()?,
        mirrored: joints.first().unwrap_or(&IDENTITY).determinant() < 0.0,
    }))
}

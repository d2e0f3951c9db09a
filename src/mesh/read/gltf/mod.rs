//! glTF 2.0 (Khronos), binary or as text with its buffers next to it or within.
//!
//! The description is held in memory, as far as it fits; vertices and corners of triangles are read in place from the
//! buffers. Nodes are walked anew in every pass. Metres with the y axis up become millimetres of the patient's axes
//! with the head up, the inverse of the export of models: x, -z, y.
//!
//! | part | what it holds |
//! |---|---|
//! | `json` | the description |
//! | `buffers` | bytes and items |
//! | `looks` | materials and textures |
//! | `posed` | skins at rest, and meshes with several copies |

mod buffers;
mod json;
mod looks;
mod posed;

use std::path::Path;
use std::sync::Arc;

use super::appearance::{Appearance, Material, NO_MATERIAL};
use super::stop::{EachLook, Stop, UNPLACED, finite};
use super::stream::{Stream, mark};
use super::text::Fan;
use super::vertex_looks::single;
use super::vertices::{FEW_PAGES, Number, PAGES, Pages};
use super::{Limits, Summary};
use crate::fault::{Fault, bad};
use crate::geom::Affine;
use crate::mesh::read::stop::{
    bad_transform, buffer_lies, gltf_version, recursion, too_many_triangles, unread_extension,
};
use crate::platform::PositionalFile;
use crate::text::Count;
use buffers::{Buffers, Items, Resolver, Section, item, out_of_range};
use json::{Described, Mesh, Node, Primitive, Shape};
use posed::{BentMeshes, Copies, bent_meshes};

/// Most triangles of a file, which may be much smaller than its model, and more for each of its bytes.
pub(super) const MAX_TRIANGLES: u64 = 1 << 23;
pub(super) const MAX_TRIANGLES_PER_BYTE: u64 = 4;
/// Metres with y up to millimetres with z up.
const UPRIGHT: Affine =
    Affine { rows: [[1000.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1000.0, 0.0], [0.0, 1000.0, 0.0, 0.0]] };
const IDENTITY: Affine = Affine { rows: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]] };

pub(super) struct Gltf {
    described: Described,
    buffers: Buffers,
    bent: BentMeshes,
    with_looks: bool,
    with_colors: bool,
}

/// True if it begins like a binary file.
pub(super) fn is_binary(head: &[u8]) -> bool {
    head.starts_with(b"glTF")
}

/// Rule by which the corners of a primitive make triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mode {
    Triangles,
    Strip,
    Fan,
}

/// A primitive and its items.
struct PrimitiveItems {
    mode: Mode,
    positions: Items,
    indices: Option<Items>,
    normals: Option<Items>,
    colors: Option<Items>,
    places: Option<Items>,
    material: u32,
    /// True if its triangles are mirrored before they are placed.
    mirrored: bool,
}

impl PrimitiveItems {
    fn corners(&self) -> u64 {
        self.indices.as_ref().map_or(self.positions.count, |i| i.count)
    }

    fn triangles(&self) -> u64 {
        if self.mode == Mode::Triangles { self.corners() / 3 } else { self.corners().saturating_sub(2) }
    }
}

/// Description and binary part of a binary file: offset and length of each.
type Chunks = ((u64, u64), Option<(u64, u64)>);

/// Finds the chunks (section 4).
fn chunks(file: &PositionalFile, bytes: u64) -> Result<Chunks, Stop> {
    let mut stream = Stream::new(file, 0);
    let four = |raw: [u8; 4]| u64::from(u32::from_le_bytes(raw));
    let _magic: [u8; 4] = stream.take()?;
    let version = four(stream.take()?);
    if version != 2 {
        return Err(gltf_version(&version.to_string()).into());
    }
    let stated = four(stream.take()?);
    let length = four(stream.take()?);
    let kind: [u8; 4] = stream.take()?;
    if stated > bytes {
        return Err(buffer_lies(stated, bytes).into());
    }
    if kind != *b"JSON" || 20 + length > stated {
        return Err(out_of_range("a chunk"));
    }
    let mut at = 20 + length;
    let json = (20, length);
    while at + 8 <= stated {
        let mut stream = Stream::new(file, at);
        let length = four(stream.take()?);
        let kind: [u8; 4] = stream.take()?;
        at += 8;
        if at + length > stated {
            return Err(out_of_range("a chunk"));
        }
        if kind == *b"BIN\0" {
            return Ok((json, Some((at, length))));
        }
        at += length;
    }
    Ok((json, None))
}

const DRACO: &str = "is compressed with Draco, which is not read; export it without compression";
const MESHOPT: &str = "is compressed with meshopt, which is not read; export it without compression";
const BASIS: &str = "has KTX2 textures, which are not read; write them as PNG or JPEG";

/// Refuses files that need an unknown extension.
fn check_extensions(required: &[String]) -> Result<(), Stop> {
    for name in required {
        let fault = match name.as_str() {
            "KHR_mesh_quantization"
            | "KHR_texture_transform"
            | "KHR_lights_punctual"
            | "KHR_node_visibility"
            | "EXT_mesh_gpu_instancing" => continue,
            "KHR_draco_mesh_compression" => bad!("{DRACO}"),
            "EXT_meshopt_compression" | "KHR_meshopt_compression" => bad!("{MESHOPT}"),
            "KHR_texture_basisu" => bad!("{BASIS}"),
            _ if name.starts_with("KHR_materials_") => continue,
            _ => unread_extension(&name.chars().take(64).collect::<String>()),
        };
        return Err(fault.into());
    }
    Ok(())
}

pub(super) fn open(
    file: PositionalFile,
    bytes: u64,
    path: &Path,
    limits: &Limits<'_>,
) -> Result<(Gltf, Summary), Stop> {
    let head = super::stream::head(&file).map_err(Stop::Read)?;
    mark(&head)?;
    let (json, binary) = if is_binary(&head) { chunks(&file, bytes)? } else { ((0, bytes), None) };
    let described = json::read(&file, json.0, json.1, limits)?;
    check_extensions(&described.root.extensions_required)?;
    let own = Arc::new(file);
    let binary = binary.map(|(offset, bytes)| Section { file: own.clone(), offset, bytes });
    let mut resolver = Resolver { path, own, binary, limits, files: Vec::new(), decoded: None };
    let buffers = Buffers::open(&described, &mut resolver)?;
    let materials =
        if limits.colors { looks::materials(&described, &buffers, &mut resolver)? } else { Vec::new() };
    let all: u64 = described.root.buffers.iter().map(|b| b.byte_length).fold(bytes, u64::saturating_add);
    let held_bytes = described.held_bytes;
    let bent = BentMeshes::new();
    let mut open = Gltf { described, buffers, bent, with_looks: limits.looks, with_colors: limits.colors };
    let (parts, morphs) = open.check(all)?;
    open.bent = bent_meshes(&open, limits)?;
    let mut lacks = Vec::new();
    if morphs {
        lacks.push(
            "has morph targets with weights, which are not applied; the shape without them was built"
                .to_owned(),
        );
    }
    let hidden = open.described.root.nodes.iter().filter(|node| node.is_hidden()).count();
    if hidden > 0 {
        let count = Count(hidden, "hidden node");
        lacks.push(format!("has {count} (KHR_node_visibility), left out with the nodes below"));
    }
    let plain = |m: &Material| m.color == [1.0; 3] && m.texture.is_none();
    let primitives = || open.described.root.meshes.iter().flat_map(|mesh| &mesh.primitives);
    for primitive in primitives() {
        let textured = |m: u32| materials.get(m as usize).is_some_and(|m| m.texture.is_some());
        if primitive.material.is_some_and(textured)
            && open.prepared(primitive)?.is_some_and(|items| items.places.is_none())
            && limits.looks
        {
            lacks.push(UNPLACED.to_owned());
            break;
        }
    }
    let colored = primitives().any(|p| p.attributes.color.is_some());
    let smooth = primitives().any(|p| p.attributes.normal.is_some());
    // Materials are looked into only where colours are wanted.
    let painted =
        if limits.colors { !materials.iter().all(plain) } else { !open.described.root.materials.is_empty() };
    let looks = [colored || painted, smooth];
    let files = resolver.files;
    Ok((open, Summary { materials, files, lacks, held_bytes, parts, looks }))
}

/// Takes a node, its number and affine, and true if it is hidden.
type EachNode<'a> = dyn FnMut(&Node, usize, &Affine, bool) -> Result<(), Stop> + 'a;

impl Gltf {
    /// Checks every mesh once, counts triangles, and returns the number of nodes with a mesh, and true if weights would
    /// move one of these to another shape.
    fn check(&self, bytes: u64) -> Result<(u64, bool), Stop> {
        let most = MAX_TRIANGLES + bytes.saturating_mul(MAX_TRIANGLES_PER_BYTE);
        let mut counts = Vec::with_capacity(self.described.root.meshes.len());
        for mesh in &self.described.root.meshes {
            let mut count = 0_u64;
            for primitive in &mesh.primitives {
                count += self.prepared(primitive)?.map_or(0, |p| p.triangles());
            }
            counts.push(count);
        }
        let mut seen = vec![false; self.described.root.nodes.len()];
        let (mut all, mut parts, mut morphs) = (0_u64, 0, false);
        self.walk_all(&mut |node, at, _, is_hidden| {
            // A node has one parent at most, so that nodes form no circle.
            if std::mem::replace(&mut seen[at], true) {
                return Err(recursion().into());
            }
            if let Some(mesh) = node.mesh.filter(|_| !is_hidden) {
                let (triangles, copies) = (*item(&counts, mesh, "a mesh")?, Copies::of(self, node)?.count);
                // A copy of nothing costs time, too.
                all = all.saturating_add(if copies == 1 {
                    triangles
                } else {
                    triangles.max(1).saturating_mul(copies)
                });
                parts += 1;
                let mesh = item(&self.described.root.meshes, mesh, "a mesh")?;
                let weights = node.weights.as_ref().or(mesh.weights.as_ref());
                let moved = weights.is_some_and(|weights| weights.iter().any(|weight| *weight != 0.0));
                morphs |= moved && mesh.primitives.iter().any(|primitive| !primitive.targets.is_empty());
            }
            if all > most {
                return Err(too_many_triangles(most).into());
            }
            Ok(())
        })?;
        Ok((parts, morphs))
    }

    /// Calls `each` with every node of the scene that is not hidden, and its affine.
    fn walk(&self, each: &mut dyn FnMut(&Node, usize, &Affine) -> Result<(), Stop>) -> Result<(), Stop> {
        self.walk_all(&mut |node, at, placed, is_hidden| {
            if is_hidden { Ok(()) } else { each(node, at, placed) }
        })
    }

    /// Calls `each` with every node of the scene, its affine, and true if it or one above is hidden.
    fn walk_all(&self, each: &mut EachNode<'_>) -> Result<(), Stop> {
        let root = &self.described.root;
        let roots: Vec<u32> = match (root.scene, root.scenes.first()) {
            (Some(at), _) => item(&root.scenes, at, "a scene")?.nodes.clone(),
            (None, Some(first)) => first.nodes.clone(),
            (None, None) => {
                let children: std::collections::BTreeSet<u32> =
                    root.nodes.iter().flat_map(|n| n.children.iter().copied()).collect();
                (0..root.nodes.len() as u64)
                    .filter_map(|at| u32::try_from(at).ok())
                    .filter(|at| !children.contains(at))
                    .collect()
            }
        };
        let mut stack: Vec<_> = roots.into_iter().rev().map(|at| (at, UPRIGHT, false)).collect();
        while let Some((at, parent, hidden)) = stack.pop() {
            let node = item(&root.nodes, at, "a node")?;
            let own = parent.after(&own_place(node)?);
            if !own.rows.iter().flatten().all(|v| v.is_finite()) {
                return Err(bad_transform().into());
            }
            let hidden = hidden || node.is_hidden();
            each(node, at as usize, &own, hidden)?;
            stack.extend(node.children.iter().rev().map(|child| (*child, own, hidden)));
        }
        Ok(())
    }

    /// The items of a primitive; `None` if it is not made of triangles.
    fn prepared(&self, primitive: &Primitive) -> Result<Option<PrimitiveItems>, Stop> {
        let mode = match primitive.mode {
            None | Some(4) => Mode::Triangles,
            Some(5) => Mode::Strip,
            Some(6) => Mode::Fan,
            Some(0..=3) => return Ok(None),
            Some(_) => return Err(out_of_range("a mesh")),
        };
        let items = |at| self.buffers.items(&self.described, at);
        let Some(position) = primitive.attributes.position else { return Ok(None) };
        let accessor = item(&self.described.root.accessors, position, "an accessor")?;
        if primitive.extensions.draco.is_some() && accessor.buffer_view.is_none() {
            return Err(bad!("{DRACO}").into());
        }
        let positions = items(position)?;
        let indices = primitive.indices.map(items).transpose()?;
        let whole = |i: &Items| {
            i.shape == Shape::Scalar && matches!(i.number, Number::U8 | Number::U16 | Number::U32)
        };
        if positions.shape != Shape::Three
            || indices.as_ref().is_some_and(|i| !whole(i) || i.stride != i.number.bytes())
        {
            return Err(out_of_range("an accessor"));
        }
        let mut prepared = PrimitiveItems {
            mode,
            positions,
            indices,
            normals: None,
            colors: None,
            places: None,
            material: NO_MATERIAL,
            mirrored: false,
        };
        if self.with_looks {
            let count = prepared.positions.count;
            let fitting = |at: Option<u32>, shapes: &[Shape]| {
                at.map(items).transpose().map(|found| {
                    found.filter(|i| shapes.contains(&i.shape) && i.count >= count && i.number != Number::U32)
                })
            };
            let attributes = &primitive.attributes;
            prepared.normals = fitting(attributes.normal, &[Shape::Three])?;
            prepared.colors = fitting(attributes.color, &[Shape::Three, Shape::Four])?;
            if let Some(at) = primitive.material.filter(|_| self.with_colors) {
                item(&self.described.root.materials, at, "a material")?;
                prepared.material = at;
                let set = looks::texcoord(&self.described, at);
                let set = [attributes.texcoord_0, attributes.texcoord_1].get(set as usize).copied().flatten();
                prepared.places = fitting(set, &[Shape::Two])?;
            }
        }
        Ok(Some(prepared))
    }

    /// Calls `each` with every triangle, in millimetres.
    pub(super) fn for_each(&self, each: &mut EachLook<'_>) -> Result<(), Stop> {
        let mut faces = 0;
        let mut next_part = 0_u32;
        self.walk(&mut |node, number, placed| {
            let Some(at) = node.mesh else { return Ok(()) };
            let part = next_part;
            next_part = next_part.saturating_add(1);
            let each: &mut EachLook<'_> = &mut |t, look| each(t, &Appearance { part, ..*look });
            let mesh: &Mesh = item(&self.described.root.meshes, at, "a mesh")?;
            let copies = Copies::of(self, node)?;
            for copy in 0..copies.count {
                let placed = placed.after(&copies.place(copy)?);
                for (at, primitive) in mesh.primitives.iter().enumerate() {
                    let Some(mut prepared) = self.prepared(primitive)? else { continue };
                    let Some(bent) = self.bent.get(&(number, at)) else {
                        primitive_triangles(&prepared, &placed, &mut faces, each)?;
                        continue;
                    };
                    prepared.positions = bent.positions.clone();
                    prepared.normals = bent.normals.clone();
                    prepared.mirrored = bent.mirrored;
                    primitive_triangles(&prepared, &IDENTITY, &mut faces, each)?;
                }
            }
            Ok(())
        })
    }
}

/// Transform of a node into its parent's space (glTF 2.0, section 3.5.3).
///
/// # Errors
/// A matrix and parts of one, a matrix that is not affine, or a rotation that is not a unit quaternion.
fn own_place(node: &Node) -> Result<Affine, Fault> {
    let Some(m) = &node.matrix else { return turned_place(node.translation, node.rotation, node.scale) };
    if node.translation.is_some() || node.rotation.is_some() || node.scale.is_some() {
        return Err(bad!(
            "places a part by a matrix and by translation, rotation or scale; keep one of them"
        ));
    }
    if [m[3], m[7], m[11], m[15]] != [0.0, 0.0, 0.0, 1.0] {
        return Err(bad!("places a part by a matrix whose last row is not 0, 0, 0, 1; repair the file"));
    }
    Ok(Affine { rows: std::array::from_fn(|r| std::array::from_fn(|c| m[4 * c + r])) })
}

/// Transform from translation, rotation as a quaternion, and scale.
///
/// # Errors
/// The quaternion's length is off by more than quantisation to 8 bits explains.
fn turned_place(
    t: Option<[f64; 3]>,
    rotation: Option<[f64; 4]>,
    s: Option<[f64; 3]>,
) -> Result<Affine, Fault> {
    let mut q = rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
    let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
    if length.is_nan() || (length - 1.0).abs() > 0.05 {
        return Err(bad!(
            "turns a part by a quaternion of length {length:.3}, which must be 1; repair the file"
        ));
    }
    // Rounding to single precision is left as it is.
    if (length - 1.0).abs() > 1e-6 {
        q = q.map(|v| v / length);
    }
    let [x, y, z, w] = q;
    let (s, t) = (s.unwrap_or([1.0; 3]), t.unwrap_or([0.0; 3]));
    let turned = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ];
    Ok(Affine {
        rows: std::array::from_fn(|r| {
            std::array::from_fn(|c| if c < 3 { turned[r][c] * s[c] } else { t[r] })
        }),
    })
}

/// The whole numbers of corners, one after the other.
enum Corners<'a> {
    Stored(Stream<'a>, Number),
    Counted(u64),
}

impl Corners<'_> {
    fn next(&mut self) -> Result<u64, Stop> {
        Ok(match self {
            Self::Stored(stream, Number::U8) => {
                let [b] = stream.take()?;
                b.into()
            }
            Self::Stored(stream, Number::U16) => u16::from_le_bytes(stream.take()?).into(),
            Self::Stored(stream, _) => u32::from_le_bytes(stream.take()?).into(),
            Self::Counted(at) => {
                *at += 1;
                *at - 1
            }
        })
    }
}

struct Attribute<'a> {
    pages: Pages<'a>,
    scale: f64,
}

impl Attribute<'_> {
    fn corners(&mut self, [a, b, c]: [u32; 3], face: u64) -> Result<[[f64; 3]; 3], Stop> {
        let mut get = |at: u32| Ok::<_, Stop>(self.pages.get(at.into(), face)?.map(|v| v * self.scale));
        Ok([get(a)?, get(b)?, get(c)?])
    }
}

fn primitive_triangles(
    prepared: &PrimitiveItems,
    placed: &Affine,
    faces: &mut u64,
    each: &mut EachLook<'_>,
) -> Result<(), Stop> {
    let vertices = prepared.positions.vertices()?;
    let attributes = [&prepared.normals, &prepared.colors, &prepared.places];
    let mut stored = [None, None, None];
    for (out, items) in stored.iter_mut().zip(attributes) {
        *out = items.as_ref().map(|items| Ok::<_, Stop>((items.vertices()?, items.scale))).transpose()?;
    }
    let [mut normals, mut colors, mut places] = stored.each_ref().map(|at| at.as_ref().map(attribute));
    let mut positions = Attribute { pages: Pages::new(&vertices, PAGES), scale: prepared.positions.scale };
    let mut corners = match &prepared.indices {
        Some(i) => Corners::Stored(Stream::new(&i.run.file, i.run.offset), i.number),
        None => Corners::Counted(0),
    };
    // Mirrored triangles are turned around, as the standard asks (3.7.4).
    let mirrored = placed.determinant() < 0.0;
    let upright = cofactors(placed, mirrored);
    let mut emit = |mut t: [u32; 3]| -> Result<(), Stop> {
        if mirrored != prepared.mirrored {
            t.swap(1, 2);
        }
        let points = positions.corners(t, *faces)?.map(|p| placed.apply(p));
        *faces += 1;
        finite(&points, *faces)?;
        let mut look = Appearance { material: prepared.material, ..Appearance::NONE };
        if let Some(normals) = &mut normals {
            look.normals = Some(normals.corners(t, *faces)?.map(|n| single(upright.apply_vector(n))));
        }
        if let Some(colors) = &mut colors {
            look.colors = Some(colors.corners(t, *faces)?.map(single));
        }
        if let Some(places) = &mut places {
            look.places = Some(places.corners(t, *faces)?.map(single).map(|[u, v, _]| [u, v]));
        }
        each(&points, &look)
    };
    let whole = |at: u64| u32::try_from(at).unwrap_or(u32::MAX);
    match prepared.mode {
        Mode::Triangles => {
            for _ in 0..prepared.triangles() {
                let t = [corners.next()?, corners.next()?, corners.next()?];
                emit(t.map(whole))?;
            }
        }
        Mode::Fan | Mode::Strip => {
            let mut fan = if prepared.mode == Mode::Strip { Fan::strip() } else { Fan::new() };
            for _ in 0..prepared.corners() {
                if let Some(t) = fan.next(whole(corners.next()?)) {
                    emit(t)?;
                }
            }
        }
    }
    Ok(())
}

fn attribute((vertices, scale): &(super::vertices::Vertices, f64)) -> Attribute<'_> {
    Attribute { pages: Pages::new(vertices, FEW_PAGES), scale: *scale }
}

/// The transform of normals when points are placed: the cofactors, negative for a mirror.
pub(super) fn cofactors(placed: &Affine, mirrored: bool) -> Affine {
    let m = &placed.rows;
    let sign = if mirrored { -1.0 } else { 1.0 };
    let rows = std::array::from_fn(|r| {
        let (r1, r2) = ((r + 1) % 3, (r + 2) % 3);
        std::array::from_fn(|c| {
            if c == 3 {
                return 0.0;
            }
            let (c1, c2) = ((c + 1) % 3, (c + 2) % 3);
            sign * (m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1])
        })
    });
    Affine { rows }
}

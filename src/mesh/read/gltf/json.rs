//! The description of a glTF file (Khronos glTF 2.0, section 5), as far as it concerns triangles and their looks.
//!
//! Data written into it are not copied: only the place of such a string is kept.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde::de::IgnoredAny;

use super::super::Limits;
use super::super::stop::Stop;
use super::super::stream::{Stream, mark};
use crate::fault::bad;
use crate::mesh::read::stop::{bad_text, cut_short, gltf_version};
use crate::platform::PositionalFile;
use crate::text::shown;

/// Most memory of an object of the description, and of an item of a list.
const OBJECT_BYTES: u64 = 320;
const ITEM_BYTES: u64 = 16;

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Root {
    pub(super) asset: Asset,
    pub(super) scene: Option<u32>,
    #[serde(default)]
    pub(super) scenes: Vec<Scene>,
    #[serde(default)]
    pub(super) nodes: Vec<Node>,
    #[serde(default)]
    pub(super) meshes: Vec<Mesh>,
    #[serde(default)]
    pub(super) accessors: Vec<Accessor>,
    #[serde(default)]
    pub(super) buffer_views: Vec<BufferView>,
    #[serde(default)]
    pub(super) buffers: Vec<Buffer>,
    #[serde(default)]
    pub(super) materials: Vec<Material>,
    #[serde(default)]
    pub(super) textures: Vec<Texture>,
    #[serde(default)]
    pub(super) images: Vec<Image>,
    #[serde(default)]
    pub(super) samplers: Vec<Sampler>,
    #[serde(default)]
    pub(super) skins: Vec<Skin>,
    #[serde(default)]
    pub(super) extensions_required: Vec<String>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Asset {
    pub(super) version: String,
    /// Version that a reader needs, where the file states one.
    pub(super) min_version: Option<String>,
}

#[derive(Debug, Deserialize)]
pub(super) struct Scene {
    #[serde(default)]
    pub(super) nodes: Vec<u32>,
}

#[derive(Debug, Deserialize)]
pub(super) struct Node {
    #[serde(default)]
    pub(super) children: Vec<u32>,
    pub(super) mesh: Option<u32>,
    pub(super) matrix: Option<Box<[f64; 16]>>,
    pub(super) translation: Option<[f64; 3]>,
    pub(super) rotation: Option<[f64; 4]>,
    pub(super) scale: Option<[f64; 3]>,
    pub(super) skin: Option<u32>,
    pub(super) weights: Option<Vec<f64>>,
    #[serde(default)]
    pub(super) extensions: NodeExtensions,
}

impl Node {
    /// True if it is hidden, along with the nodes below.
    pub(super) fn is_hidden(&self) -> bool {
        self.extensions.visibility.as_ref().is_some_and(|stated| !stated.visible)
    }
}

#[derive(Debug, Default, Deserialize)]
pub(super) struct NodeExtensions {
    #[serde(rename = "EXT_mesh_gpu_instancing")]
    pub(super) instancing: Option<Instancing>,
    #[serde(rename = "KHR_node_visibility")]
    pub(super) visibility: Option<Visibility>,
}

#[derive(Debug, Deserialize)]
pub(super) struct Visibility {
    #[serde(default = "visible")]
    pub(super) visible: bool,
}

fn visible() -> bool {
    true
}

#[derive(Debug, Deserialize)]
pub(super) struct Instancing {
    #[serde(default)]
    pub(super) attributes: InstanceAttributes,
}

#[derive(Debug, Default, Deserialize)]
pub(super) struct InstanceAttributes {
    #[serde(rename = "TRANSLATION")]
    pub(super) translation: Option<u32>,
    #[serde(rename = "ROTATION")]
    pub(super) rotation: Option<u32>,
    #[serde(rename = "SCALE")]
    pub(super) scale: Option<u32>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Skin {
    pub(super) joints: Vec<u32>,
    pub(super) inverse_bind_matrices: Option<u32>,
}

#[derive(Debug, Deserialize)]
pub(super) struct Mesh {
    #[serde(default)]
    pub(super) primitives: Vec<Primitive>,
    pub(super) weights: Option<Vec<f64>>,
}

#[derive(Debug, Deserialize)]
pub(super) struct Primitive {
    pub(super) attributes: Attributes,
    pub(super) indices: Option<u32>,
    pub(super) material: Option<u32>,
    pub(super) mode: Option<u32>,
    /// Shapes that it may be moved to.
    #[serde(default)]
    pub(super) targets: Vec<IgnoredAny>,
    #[serde(default)]
    pub(super) extensions: PrimitiveExtensions,
}

#[derive(Debug, Default, Deserialize)]
pub(super) struct PrimitiveExtensions {
    #[serde(rename = "KHR_draco_mesh_compression")]
    pub(super) draco: Option<IgnoredAny>,
}

#[derive(Debug, Deserialize)]
pub(super) struct Attributes {
    #[serde(rename = "POSITION")]
    pub(super) position: Option<u32>,
    #[serde(rename = "NORMAL")]
    pub(super) normal: Option<u32>,
    #[serde(rename = "COLOR_0")]
    pub(super) color: Option<u32>,
    #[serde(rename = "TEXCOORD_0")]
    pub(super) texcoord_0: Option<u32>,
    #[serde(rename = "TEXCOORD_1")]
    pub(super) texcoord_1: Option<u32>,
    #[serde(rename = "JOINTS_0")]
    pub(super) joints_0: Option<u32>,
    #[serde(rename = "WEIGHTS_0")]
    pub(super) weights_0: Option<u32>,
    #[serde(rename = "JOINTS_1")]
    pub(super) joints_1: Option<u32>,
    #[serde(rename = "WEIGHTS_1")]
    pub(super) weights_1: Option<u32>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    pub(super) buffer_view: Option<u32>,
    #[serde(default)]
    pub(super) byte_offset: u64,
    pub(super) component_type: u32,
    #[serde(default)]
    pub(super) normalized: bool,
    pub(super) count: u64,
    #[serde(rename = "type")]
    pub(super) shape: Shape,
    pub(super) sparse: Option<IgnoredAny>,
}

#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
pub(super) enum Shape {
    #[serde(rename = "SCALAR")]
    Scalar,
    #[serde(rename = "VEC2")]
    Two,
    #[serde(rename = "VEC3")]
    Three,
    #[serde(rename = "VEC4")]
    Four,
    #[serde(rename = "MAT4")]
    Matrix,
    #[serde(other)]
    Other,
}

impl Shape {
    /// Numbers of an item; `None` for matrices and unknown shapes.
    pub(super) fn parts(self) -> Option<u64> {
        match self {
            Self::Scalar => Some(1),
            Self::Two => Some(2),
            Self::Three => Some(3),
            Self::Four => Some(4),
            Self::Matrix | Self::Other => None,
        }
    }
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct BufferView {
    pub(super) buffer: u32,
    #[serde(default)]
    pub(super) byte_offset: u64,
    pub(super) byte_length: u64,
    pub(super) byte_stride: Option<u64>,
    #[serde(default)]
    pub(super) extensions: ViewExtensions,
}

#[derive(Debug, Default, Deserialize)]
pub(super) struct ViewExtensions {
    #[serde(rename = "EXT_meshopt_compression", alias = "KHR_meshopt_compression")]
    pub(super) meshopt: Option<IgnoredAny>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer {
    pub(super) uri: Option<String>,
    pub(super) byte_length: u64,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Material {
    #[serde(default)]
    pub(super) pbr_metallic_roughness: Surface,
    #[serde(default)]
    extensions: MaterialExtensions,
}

impl Material {
    /// What gives the base colour.
    pub(super) fn surface(&self) -> &Surface {
        self.extensions.glossy.as_ref().unwrap_or(&self.pbr_metallic_roughness)
    }
}

#[derive(Debug, Default, Deserialize)]
struct MaterialExtensions {
    #[serde(rename = "KHR_materials_pbrSpecularGlossiness")]
    glossy: Option<Surface>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Surface {
    #[serde(alias = "diffuseFactor")]
    pub(super) base_color_factor: Option<[f32; 4]>,
    #[serde(alias = "diffuseTexture")]
    pub(super) base_color_texture: Option<TextureUse>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct TextureUse {
    pub(super) index: u32,
    #[serde(default)]
    pub(super) tex_coord: u32,
    #[serde(default)]
    pub(super) extensions: UseExtensions,
}

#[derive(Debug, Default, Deserialize)]
pub(super) struct UseExtensions {
    #[serde(rename = "KHR_texture_transform")]
    pub(super) transform: Option<TextureTransform>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct TextureTransform {
    pub(super) offset: Option<[f32; 2]>,
    pub(super) rotation: Option<f32>,
    pub(super) scale: Option<[f32; 2]>,
    pub(super) tex_coord: Option<u32>,
}

#[derive(Debug, Deserialize)]
pub(super) struct Texture {
    pub(super) source: Option<u32>,
    pub(super) sampler: Option<u32>,
    #[serde(default)]
    pub(super) extensions: TextureExtensions,
}

/// Images of kinds outside the standard.
#[derive(Debug, Default, Deserialize)]
pub(super) struct TextureExtensions {
    #[serde(rename = "KHR_texture_basisu")]
    pub(super) basis: Option<IgnoredAny>,
    #[serde(rename = "EXT_texture_webp")]
    pub(super) webp: Option<IgnoredAny>,
    #[serde(rename = "EXT_texture_avif")]
    pub(super) avif: Option<IgnoredAny>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Image {
    pub(super) uri: Option<String>,
    pub(super) buffer_view: Option<u32>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Sampler {
    pub(super) wrap_s: Option<u32>,
    pub(super) wrap_t: Option<u32>,
}

/// Location of the characters of a `data:` string in the file, without the quotes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Embedded {
    pub(super) offset: u64,
    pub(super) bytes: u64,
}

/// A description with the strings of data that stand in it; a URI `data:7` means the seventh of these.
pub(super) struct Described {
    pub(super) root: Root,
    pub(super) embedded: Vec<Embedded>,
    pub(super) held_bytes: u64,
}

/// Reads a description of `bytes` bytes from `offset` on.
///
/// # Errors
/// It does not describe glTF 2, or takes more memory than there is.
pub(super) fn read(
    file: &PositionalFile,
    offset: u64,
    bytes: u64,
    limits: &Limits<'_>,
) -> Result<Described, Stop> {
    let (text, embedded, held_bytes) = condensed(file, offset, bytes, limits)?;
    // Unknown parts nest as deep as the crate allows: 128 levels.
    let text = text.get(mark(&text)?..).unwrap_or_default();
    let root: Root = serde_json::from_slice(text).map_err(|e| match e.line() {
        // The error has no line.
        0 => cut_short(),
        _ if is_version_1(text) => gltf_version("1"),
        line => bad_text(line as u64),
    })?;
    if root.asset.version.split('.').next() != Some("2") {
        return Err(gltf_version(&root.asset.version.chars().take(16).collect::<String>()).into());
    }
    if let Some(least) = root.asset.min_version.as_deref().filter(|least| !is_at_most_2_0(least)) {
        let least: String = least.chars().take(16).collect();
        return Err(bad!(
            "needs a reader of glTF {} (asset.minVersion), and 2.0 is read; write it as glTF 2.0",
            shown(&least)
        )
        .into());
    }
    Ok(Described { root, embedded, held_bytes })
}

fn is_at_most_2_0(version: &str) -> bool {
    let parts = version.split_once('.').map(|(major, minor)| (major.parse::<u32>(), minor.parse::<u32>()));
    matches!(parts, Some((Ok(major), Ok(minor))) if (major, minor) <= (2, 0))
}

/// True for glTF 1, which has objects with names where version 2 has lists, and need not state its version.
fn is_version_1(text: &[u8]) -> bool {
    #[derive(Deserialize)]
    struct Stating {
        asset: StatedVersion,
    }
    #[derive(Deserialize)]
    struct StatedVersion {
        version: serde_json::Value,
    }
    #[derive(Deserialize)]
    struct Named {
        #[serde(rename = "meshes")]
        _meshes: BTreeMap<String, IgnoredAny>,
    }
    let stated = serde_json::from_slice::<Stating>(text).map(|stating| stating.asset.version.to_string());
    stated.is_ok_and(|version| version.trim_matches('"').starts_with('1'))
        || serde_json::from_slice::<Named>(text).is_ok()
}

/// The text without the content of `data:` strings.
fn condensed(
    file: &PositionalFile,
    offset: u64,
    bytes: u64,
    limits: &Limits<'_>,
) -> Result<(Vec<u8>, Vec<Embedded>, u64), Stop> {
    const DATA: &[u8] = b"data:";
    let mut stream = Stream::new(file, offset);
    let (mut text, mut embedded) = (Vec::new(), Vec::<Embedded>::new());
    let mut needed = 0_u64;
    // Bytes of text given up for lack of memory; the memory for all of it is still counted.
    let mut given_up = 0;
    // Bytes since the quote that began the string; `None` between strings.
    let mut within: Option<u64> = None;
    let mut data = false;
    let mut escaped = false;
    for at in 0..bytes {
        let [byte] = stream.take()?;
        if let Some(length) = within {
            let ends = byte == b'"' && !escaped;
            escaped = byte == b'\\' && !escaped;
            within = if ends { None } else { Some(length + 1) };
            if data && !ends {
                continue;
            }
            if data {
                let start = offset + at - length;
                let number = embedded.len().to_string();
                embedded.push(Embedded { offset: start, bytes: length });
                needed += OBJECT_BYTES;
                text.extend(number.bytes());
            }
            text.push(byte);
            data = !ends && length + 1 == DATA.len() as u64 && text.ends_with(b"\"data:");
        } else {
            needed += match byte {
                b'{' | b'[' => OBJECT_BYTES,
                b',' => ITEM_BYTES,
                _ => 0,
            };
            if byte == b'"' {
                within = Some(0);
            }
            text.push(byte);
        }
        // Twice: strings are copied.
        if needed + 2 * (text.len() + given_up) as u64 > limits.most_bytes && text.len() > 64 {
            given_up += text.len() - DATA.len() - 1;
            text.drain(..text.len() - DATA.len() - 1);
            embedded.clear();
        }
    }
    let held_bytes = needed + 2 * (text.len() + given_up) as u64;
    if held_bytes > limits.most_bytes {
        return Err(Stop::Memory { needed_bytes: held_bytes, allowed_bytes: limits.most_bytes });
    }
    Ok((text, embedded, held_bytes))
}

//! Materials of glTF: the base colour, which is a factor in linear light times a texture (Khronos, 3.9.2).

use std::sync::Arc;

use super::super::appearance::{Image, Material, Texture, UNPLACED, Wrap};
use super::super::stop::Stop;
use super::buffers::{Buffers, Resolver, item, out_of_range};
use super::json::{Described, TextureExtensions, TextureUse};
use crate::fault::bad;

/// Set of coordinates of a material's texture.
pub(super) fn texcoord(described: &Described, material: u32) -> u32 {
    let material = described.root.materials.get(material as usize);
    let used = material.and_then(|m| m.surface().base_color_texture.as_ref());
    used.map_or(0, |used| {
        let moved = used.extensions.transform.as_ref().and_then(|t| t.tex_coord);
        moved.unwrap_or(used.tex_coord)
    })
}

pub(super) fn materials(
    described: &Described,
    buffers: &Buffers,
    resolver: &mut Resolver<'_>,
) -> Result<Vec<Material>, Stop> {
    let mut images: Vec<Option<Arc<Image>>> = vec![None; described.root.images.len()];
    let mut all = Vec::with_capacity(described.root.materials.len());
    for material in &described.root.materials {
        let surface = material.surface();
        let [r, g, b, _] = surface.base_color_factor.unwrap_or([1.0; 4]);
        let texture = match &surface.base_color_texture {
            Some(used) => Some(texture(used, described, buffers, resolver, &mut images)?),
            None => None,
        };
        all.push(Material { color: [r, g, b].map(|c| c.clamp(0.0, 1.0)), texture });
    }
    Ok(all)
}

fn texture(
    used: &TextureUse,
    described: &Described,
    buffers: &Buffers,
    resolver: &mut Resolver<'_>,
    images: &mut [Option<Arc<Image>>],
) -> Result<Texture, Stop> {
    let texture = item(&described.root.textures, used.index, "a texture")?;
    // The image is named by an extension only.
    let Some(source) = texture.source else {
        let TextureExtensions { basis, webp, avif } = &texture.extensions;
        let kinds = [(basis, "KTX2"), (webp, "WebP"), (avif, "AVIF")];
        let kind = kinds.iter().find(|(there, _)| there.is_some()).map(|(_, kind)| *kind);
        let kind = kind.ok_or_else(|| out_of_range("an image"))?;
        return Err(bad!("has {kind} textures, which are not read; write them as PNG or JPEG").into());
    };
    let at = source as usize;
    let known = images.get(at).ok_or_else(|| out_of_range("an image"))?;
    let image = match known {
        Some(image) => image.clone(),
        None => {
            let stated = item(&described.root.images, source, "an image")?;
            let name = format!("image {}", source + 1);
            let image = match (&stated.uri, stated.buffer_view) {
                (_, Some(view)) => buffers.image(described, view, name)?,
                (Some(uri), None) => {
                    let run = resolver.section(uri, described)?;
                    Image { name, file: run.file, offset: run.offset, bytes: run.bytes }
                }
                (None, None) => return Err(out_of_range("an image")),
            };
            let image = Arc::new(image);
            images[at] = Some(image.clone());
            image
        }
    };
    let sampler = texture.sampler.map(|at| item(&described.root.samplers, at, "a texture")).transpose()?;
    let wrap = |code: Option<u32>| match code {
        Some(33_071) => Wrap::Clamp,
        Some(33_648) => Wrap::Mirror,
        _ => Wrap::Repeat,
    };
    let placed = used.extensions.transform.as_ref().map_or(UNPLACED, |t| {
        let (sin, cos) = t.rotation.unwrap_or(0.0).sin_cos();
        let [su, sv] = t.scale.unwrap_or([1.0; 2]);
        let [ou, ov] = t.offset.unwrap_or([0.0; 2]);
        [[cos * su, sin * sv, ou], [-sin * su, cos * sv, ov]]
    });
    Ok(Texture {
        image,
        wraps: [wrap(sampler.and_then(|s| s.wrap_s)), wrap(sampler.and_then(|s| s.wrap_t))],
        upwards: false,
        placed,
    })
}

//! Reads the text of a scene into checked values.

use crate::fault::{Fault, bad};
use crate::geom::{Affine, add_scaled, dot};
use crate::render::ambient::MAX_RAYS;
use crate::render::{NamedView, Samples, Shading};
use crate::text::shown;

use super::checked::{Checked, FAR};
use super::clip::{Clip, CutPlane};
use super::describe::{
    AmbientKeys, CameraKeys, ChannelName, ClipKeys, Description, LabelKey, LightKeys, LightName,
    MaterialKeys, ModelKeys, PivotKey, ScaleKey,
};
use super::fault::{Key, Table};
use super::labels::{LabelPick, LabelRule};
use super::light::{Ambient, Light, LightKind};
use super::material::{Coloring, Material, PRESETS};
use super::place::Placement;
use super::spec::{Scene, SceneCamera, SceneModel, StatedPlacement};

/// Longest text in bytes.
pub const MAX_BYTES: u64 = 1 << 20;
/// Most models, and most lights.
pub(crate) const MAX_MODELS: usize = 4096;
/// See [`MAX_MODELS`].
pub(crate) const MAX_LIGHTS: usize = 64;
/// Most planes that cut one model.
const MAX_PLANES: usize = 64;
/// Default number of reflections and refractions of a line.
const BOUNCES: u32 = 8;
const MAX_BOUNCES: u32 = 64;
const MAX_SAMPLES: u32 = 8;
const MAX_EXPONENT: u32 = 100_000;
/// Most colours of a transfer function.
const MAX_COLORS: usize = 256;

/// A material and the source of its colour.
type Substance = (Material, Coloring);

/// Reads the text of a scene.
///
/// # Errors
/// The first fault in the text.
pub(crate) fn read(text: &str) -> Result<Scene, Fault> {
    let description: Description = toml::from_str(text).map_err(|fault| {
        let number = |start| 1 + text.bytes().take(start).filter(|b| *b == b'\n').count();
        let line = fault.span().map_or_else(String::new, |span| format!("line {}: ", number(span.start)));
        bad!("{line}{}; SCENES.md lists every key", shown(fault.message()))
    })?;
    scene(&description)
}

fn scene(keys: &Description) -> Result<Scene, Fault> {
    let top = Checked(Table::Top);
    if keys.model.is_empty() {
        return Err(bad!("names no model; add a table [[model]] with file = \"MODEL.oct\""));
    }
    top.few("model", keys.model.len(), MAX_MODELS)?;
    top.few("light", keys.light.len(), MAX_LIGHTS)?;
    let materials = keys.material.iter().map(|(name, keys)| Ok((name.as_str(), substance(name, keys)?)));
    let materials: Vec<(&str, Substance)> = materials.collect::<Result<_, Fault>>()?;
    let all = clip(Table::Clip, &keys.clip)?;
    let models = (1..).zip(&keys.model).map(|(number, keys)| model(number, keys, &materials, &all));
    let lights = (1..).zip(&keys.light).map(|(number, keys)| light(number, keys));
    let mut lights: Vec<Light> = lights.collect::<Result<_, _>>()?;
    let has_light = !lights.is_empty() || keys.ambient != AmbientKeys::default();
    if lights.is_empty() {
        lights = Light::usual();
    }
    Ok(Scene {
        size: keys.size,
        background: keys.background.as_deref().map(|text| top.color("background", text)).transpose()?,
        bounces: top.whole("bounces", keys.bounces, BOUNCES, [0, MAX_BOUNCES])?,
        samples: keys.samples.map(|_| samples(&top, keys)).transpose()?,
        camera: camera(&keys.camera)?,
        shading: (!has_light).then_some(Shading::Soft),
        ambient: ambient(&keys.ambient)?,
        lights,
        models: models.collect::<Result<_, _>>()?,
    })
}

/// Rays of a pixel, from the number along each of its sides.
fn samples(top: &Checked, keys: &Description) -> Result<Samples, Fault> {
    Ok(match top.whole("samples", keys.samples, 1, [1, MAX_SAMPLES])? {
        1 => Samples::One,
        2 => Samples::Four,
        3 | 4 => Samples::Sixteen,
        _ => Samples::SixtyFour,
    })
}

fn camera(keys: &CameraKeys) -> Result<SceneCamera, Fault> {
    let on = Checked(Table::Camera);
    let view =
        |text: &str| text.parse().map_err(|_| on.unknown("view", text, NamedView::ALL.map(NamedView::name)));
    let projection =
        |text: &str| text.parse().map_err(|_| on.unknown("projection", text, ["parallel", "perspective"]));
    on.not_both("view", keys.view.is_some() && keys.eye.is_some(), "eye")?;
    let eye = match (keys.eye, keys.look_at) {
        // The camera itself refuses infinite or equal points.
        (Some(eye), Some(look_at)) => Some([eye, look_at]),
        (None, None) => None,
        (Some(_), None) => return Err(on.needs("eye", "look_at")),
        (None, Some(_)) => return Err(on.needs("look_at", "eye")),
    };
    if keys.up.is_some() && eye.is_none() {
        return Err(on.needs("up", "eye"));
    }
    Ok(SceneCamera {
        view: keys.view.as_deref().map(view).transpose()?,
        eye,
        up: keys.up,
        projection: keys.projection.as_deref().map(projection).transpose()?,
        fov_deg: keys.fov,
        near_mm: keys.near.map_or(Ok(0.0), |v| on.number("near", v, [0.0, FAR]))?,
    })
}

fn ambient(keys: &AmbientKeys) -> Result<Ambient, Fault> {
    let on = Checked(Table::Ambient);
    Ok(Ambient {
        color: on.light(keys.color.as_deref(), keys.strength, 0.1)?,
        rays: on.whole("rays", keys.rays, 0, [0, MAX_RAYS])?,
        reach_mm: keys.reach.map_or(Ok(f64::INFINITY), |v| on.number("reach", v, [0.0, FAR]))?,
    })
}

fn light(number: usize, keys: &LightKeys) -> Result<Light, Fault> {
    let on = Checked(Table::Light(number));
    on.not_both("at", keys.at.is_some() && keys.kind != LightName::Point, "kind")?;
    on.not_both("from", keys.from.is_some() && keys.kind != LightName::Directional, "kind")?;
    let kind = match keys.kind {
        LightName::Head => LightKind::Head,
        LightName::Key => LightKind::Key,
        LightName::Directional => {
            let from = keys.from.ok_or_else(|| on.needs("kind", "from"))?;
            LightKind::Directional { towards: on.direction("from", from)? }
        }
        LightName::Point => {
            LightKind::Point { at: on.point("at", keys.at.ok_or_else(|| on.needs("kind", "at"))?)? }
        }
    };
    Ok(Light {
        kind,
        color: on.light(keys.color.as_deref(), keys.strength, 0.9)?,
        shadows: keys.shadows.unwrap_or(!matches!(keys.kind, LightName::Head | LightName::Key)),
    })
}

fn substance(name: &str, keys: &MaterialKeys) -> Result<Substance, Fault> {
    let on = Checked(Table::Material(name.to_owned()));
    let material = material(&on, keys)?;
    let by_preset = keys.preset.as_deref().map_or(Coloring::Own, Coloring::preset);
    on.not_both("colors", keys.colors.is_some() && keys.channel == Some(ChannelName::Color), "channel")?;
    on.not_both("colors", keys.colors.is_some() && keys.channel == Some(ChannelName::None), "channel")?;
    let colors = |given: &[(f64, String)]| {
        on.few("colors", given.len(), MAX_COLORS)?;
        let one = |(value, text): &(f64, String)| {
            Ok((on.number("colors", *value, [-FAR, FAR])?, on.color("colors", text)?))
        };
        let all: Vec<(f64, [f64; 3])> = given.iter().map(one).collect::<Result<_, Fault>>()?;
        if all.is_sorted_by(|a, b| a.0 < b.0) && !all.is_empty() {
            Ok(all)
        } else {
            Err(bad!(
                "{}: needs numbers that rise, each with its colour, as in [[-100, \"#e2b484\"], [400, \"#f0e8d8\"]]",
                on.key("colors")
            ))
        }
    };
    let coloring = match (keys.channel, keys.colors.as_deref()) {
        (None, None) => by_preset,
        (None, Some(_)) if by_preset == Coloring::Own => return Err(on.needs("colors", "channel")),
        (Some(ChannelName::None), _) => Coloring::Own,
        (Some(ChannelName::Color), _) => Coloring::Stored,
        (Some(ChannelName::Value), None) if by_preset != Coloring::Own => by_preset,
        (Some(ChannelName::Value | ChannelName::Material), None) => return Err(on.needs("channel", "colors")),
        (None | Some(ChannelName::Value), Some(given)) => Coloring::Values(colors(given)?),
        (Some(ChannelName::Material), Some(given)) => {
            let label = |(number, color): (f64, [f64; 3])| {
                let number = on.number("colors", number, [0.0, 255.0])?;
                if number.fract() != 0.0 {
                    return Err(bad!(
                        "{}: {number} is not a label; labels are whole numbers from 0 to 255",
                        on.key("colors")
                    ));
                }
                #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 255")]
                Ok((number as u8, color))
            };
            Coloring::Labels(colors(given)?.into_iter().map(label).collect::<Result<_, Fault>>()?)
        }
    };
    Ok((material, coloring))
}

fn material(on: &Checked, keys: &MaterialKeys) -> Result<Material, Fault> {
    let base = match keys.preset.as_deref() {
        None => Material::default(),
        Some(preset) => Material::preset(preset)
            .ok_or_else(|| on.unknown("preset", preset, PRESETS.iter().map(|(name, _)| *name)))?,
    };
    Ok(Material {
        color: keys.color.as_deref().map_or(Ok(base.color), |text| on.color("color", text))?,
        diffuse: on.part("diffuse", keys.diffuse, base.diffuse)?,
        specular: on.part("specular", keys.specular, base.specular)?,
        exponent: on.whole("exponent", keys.exponent, base.exponent, [1, MAX_EXPONENT])?,
        mirror: on.part("mirror", keys.mirror, base.mirror)?,
        clear: on.part("clear", keys.clear, base.clear)?,
        index: keys.index.map_or(Ok(base.index), |v| on.number("index", v, [0.1, 10.0]))?,
    })
}

fn clip(table: Table, keys: &ClipKeys) -> Result<Clip, Fault> {
    let on = Checked(table);
    on.few("planes", keys.planes.len(), MAX_PLANES)?;
    let cap = keys.cap.as_deref().map(|text| on.color("cap", text)).transpose()?;
    let mut planes = Vec::new();
    if let Some([low, high]) = keys.within {
        for axis in 0..3 {
            let (low, high) = (on.point("box", low)?[axis], on.point("box", high)?[axis]);
            if low >= high {
                return Err(bad!(
                    "{}: holds nothing; write the low corner first, as in [[-50, -50, 0], [50, 50, 90]]",
                    on.key("box")
                ));
            }
            let mut normal = [0.0; 3];
            normal[axis] = 1.0;
            planes.push(CutPlane { normal, limit: high, cap });
            planes.push(CutPlane { normal: normal.map(|c| -c + 0.0), limit: -low, cap });
        }
    }
    for [x, y, z, limit] in &keys.planes {
        let normal = on.direction("planes", [*x, *y, *z])?;
        // The distance is measured in lengths of the written vector.
        let length = dot([*x, *y, *z], [*x, *y, *z]).sqrt();
        planes.push(CutPlane { normal, limit: on.number("planes", *limit, [-FAR, FAR])? / length, cap });
    }
    Ok(Clip::new(planes))
}

fn model(
    number: usize,
    keys: &ModelKeys,
    materials: &[(&str, Substance)],
    all: &Clip,
) -> Result<SceneModel, Fault> {
    let on = Checked(Table::Model(number));
    let (material, coloring) = match keys.material.as_deref() {
        None => Substance::default(),
        Some(name) => {
            let own = materials.iter().find(|(own, _)| *own == name).map(|(_, own)| own.clone());
            let preset = || Material::preset(name).map(|material| (material, Coloring::preset(name)));
            let known = || materials.iter().map(|(own, _)| *own).chain(PRESETS.iter().map(|(name, _)| *name));
            own.or_else(preset).ok_or_else(|| on.unknown("material", name, known()))?
        }
    };
    Ok(SceneModel {
        file: keys.file.clone().into(),
        material,
        coloring,
        place: place(&on, keys)?,
        clip: clip(Table::ModelClip(number), &keys.clip)?.and(all),
        framed: keys.framed.unwrap_or(true),
        labels: labels(&on, keys)?,
    })
}

fn labels(on: &Checked, keys: &ModelKeys) -> Result<Vec<LabelRule>, Fault> {
    let pick = |name, text: &str| text.parse::<LabelPick>().map_err(|told| bad!("{}: {told}", on.key(name)));
    let mut rules = Vec::new();
    let mut add = |name, key: &LabelKey, opacity| {
        let labels = match key {
            LabelKey::Number(number) => LabelPick::Numbers([*number; 2]),
            LabelKey::Text(text) => pick(name, text)?,
        };
        rules.push(LabelRule { labels, opacity });
        Ok::<_, Fault>(())
    };
    if let Some(only) = &keys.only {
        add("only", &LabelKey::Text("all".into()), 0.0)?;
        only.iter().try_for_each(|key| add("only", key, 1.0))?;
    }
    for (text, opacity) in &keys.opacity {
        let opacity = on.part("opacity", Some(*opacity), 1.0)?;
        add("opacity", &LabelKey::Text(text.clone()), opacity)?;
    }
    keys.hide.iter().try_for_each(|key| add("hide", key, 0.0))?;
    on.few("opacity", rules.len(), MAX_COLORS)?;
    Ok(rules)
}

/// Fault of a placement without a volume.
pub(crate) fn flat(key: &Key) -> Fault {
    bad!(
        "{key}: leaves the model without a volume; choose factors that are not 0, or rows that are not parallel"
    )
}

fn place(on: &Checked, keys: &ModelKeys) -> Result<StatedPlacement, Fault> {
    if let Some(rows) = keys.place {
        for (name, given) in [
            ("scale", keys.scale.is_some()),
            ("turn", keys.turn.is_some()),
            ("pivot", keys.pivot.is_some()),
            ("move", keys.moved.is_some()),
            ("at", keys.at.is_some()),
        ] {
            on.not_both(name, given, "place")?;
        }
        rows.iter().flatten().try_for_each(|v| on.number("place", *v, [-FAR, FAR]).map(|_| ()))?;
        let affine = Affine { rows };
        return affine.inverse().map(|_| StatedPlacement::Map(affine)).ok_or_else(|| flat(&on.key("place")));
    }
    on.not_both("at", keys.at.is_some() && keys.moved.is_some(), "move")?;
    let scale = match keys.scale {
        None => [1.0; 3],
        Some(ScaleKey::All(factor)) => [factor; 3],
        Some(ScaleKey::Each(factors)) => factors,
    };
    let scale = on.point("scale", scale)?;
    let turn_deg = on.point("turn", keys.turn.unwrap_or([0.0; 3]))?;
    let moved = keys.at.is_none();
    let at = match keys.at {
        Some(at) => on.point("at", at)?,
        None => on.point("move", keys.moved.unwrap_or([0.0; 3]))?,
    };
    let placement = Placement { scale, turn_deg, pivot: [0.0; 3], at };
    if placement.affine().inverse().is_none() {
        return Err(flat(&on.key("scale")));
    }
    match &keys.pivot {
        None => Ok(StatedPlacement::Middle { placement, moved }),
        Some(PivotKey::Named(name)) => match name.as_str() {
            "middle" => Ok(StatedPlacement::Middle { placement, moved }),
            "origin" => Ok(StatedPlacement::About(placement)),
            _ => Err(on.unknown("pivot", name, ["middle", "origin"])),
        },
        Some(PivotKey::Point(pivot)) => {
            let pivot = on.point("pivot", *pivot)?;
            let at = if moved { add_scaled(pivot, 1.0, at) } else { at };
            Ok(StatedPlacement::About(Placement { pivot, at, ..placement }))
        }
    }
}

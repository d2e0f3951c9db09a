//! The text of a scene: its keys as written, before they are checked. `SCENES.md` documents them.

use std::collections::BTreeMap;

use serde::de::{DeserializeOwned, Error};
use serde::{Deserialize, Deserializer};

/// A list of exactly `N` numbers: TOML's reader ignores any that follow.
fn exact<'de, D: Deserializer<'de>, T: DeserializeOwned, const N: usize>(
    from: D,
) -> Result<[T; N], D::Error> {
    let given = Vec::<T>::deserialize(from)?;
    let count = given.len();
    given.try_into().map_err(|_| D::Error::custom(format!("{N} numbers belong here, not {count}")))
}

/// [`exact`] for a key that may be absent.
fn some<'de, D: Deserializer<'de>, T: DeserializeOwned, const N: usize>(
    from: D,
) -> Result<Option<[T; N]>, D::Error> {
    exact(from).map(Some)
}

/// A row of a list of lists.
#[derive(Deserialize)]
#[serde(transparent)]
struct Row<const N: usize>(#[serde(deserialize_with = "exact")] [f64; N]);

/// A list of lists of `N` numbers each.
fn rows<'de, D: Deserializer<'de>, const N: usize>(from: D) -> Result<Vec<[f64; N]>, D::Error> {
    Ok(Vec::<Row<N>>::deserialize(from)?.into_iter().map(|row| row.0).collect())
}

/// [`rows`] for a key that may be absent, with `M` lists.
fn some_rows<'de, D: Deserializer<'de>, const N: usize, const M: usize>(
    from: D,
) -> Result<Option<[[f64; N]; M]>, D::Error> {
    let given = rows(from)?;
    let count = given.len();
    let rows =
        given.try_into().map_err(|_| D::Error::custom(format!("{M} lists belong here, not {count}")))?;
    Ok(Some(rows))
}

/// The whole text.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Description {
    #[serde(default, deserialize_with = "some")]
    pub(super) size: Option<[u32; 2]>,
    pub(super) background: Option<String>,
    pub(super) bounces: Option<u32>,
    pub(super) samples: Option<u32>,
    #[serde(default)]
    pub(super) camera: CameraKeys,
    #[serde(default)]
    pub(super) ambient: AmbientKeys,
    #[serde(default)]
    pub(super) clip: ClipKeys,
    #[serde(default)]
    pub(super) light: Vec<LightKeys>,
    #[serde(default)]
    pub(super) model: Vec<ModelKeys>,
    #[serde(default)]
    pub(super) material: BTreeMap<String, MaterialKeys>,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CameraKeys {
    pub(super) view: Option<String>,
    #[serde(default, deserialize_with = "some")]
    pub(super) eye: Option<[f64; 3]>,
    #[serde(default, deserialize_with = "some")]
    pub(super) look_at: Option<[f64; 3]>,
    #[serde(default, deserialize_with = "some")]
    pub(super) up: Option<[f64; 3]>,
    pub(super) projection: Option<String>,
    pub(super) fov: Option<f64>,
    pub(super) near: Option<f64>,
}

#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AmbientKeys {
    pub(super) color: Option<String>,
    pub(super) strength: Option<f64>,
    pub(super) rays: Option<u32>,
    pub(super) reach: Option<f64>,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ClipKeys {
    #[serde(rename = "box", default, deserialize_with = "some_rows")]
    pub(super) within: Option<[[f64; 3]; 2]>,
    #[serde(default, deserialize_with = "rows")]
    pub(super) planes: Vec<[f64; 4]>,
    pub(super) cap: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum LightName {
    Head,
    Key,
    Directional,
    Point,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LightKeys {
    pub(super) kind: LightName,
    #[serde(default, deserialize_with = "some")]
    pub(super) from: Option<[f64; 3]>,
    #[serde(default, deserialize_with = "some")]
    pub(super) at: Option<[f64; 3]>,
    pub(super) color: Option<String>,
    pub(super) strength: Option<f64>,
    pub(super) shadows: Option<bool>,
}

/// A point of a model that scaling and turning leave in place.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged, expecting = "a pivot is a name or three numbers")]
pub(super) enum PivotKey {
    Named(String),
    Point(#[serde(deserialize_with = "exact")] [f64; 3]),
}

/// One factor, or one for each axis.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(untagged, expecting = "a scale is one number or three")]
pub(super) enum ScaleKey {
    All(f64),
    Each(#[serde(deserialize_with = "exact")] [f64; 3]),
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ModelKeys {
    pub(super) file: String,
    pub(super) material: Option<String>,
    pub(super) scale: Option<ScaleKey>,
    #[serde(default, deserialize_with = "some")]
    pub(super) turn: Option<[f64; 3]>,
    pub(super) pivot: Option<PivotKey>,
    #[serde(rename = "move", default, deserialize_with = "some")]
    pub(super) moved: Option<[f64; 3]>,
    #[serde(default, deserialize_with = "some")]
    pub(super) at: Option<[f64; 3]>,
    #[serde(default, deserialize_with = "some_rows")]
    pub(super) place: Option<[[f64; 4]; 3]>,
    pub(super) framed: Option<bool>,
    #[serde(default)]
    pub(super) clip: ClipKeys,
    pub(super) only: Option<Vec<LabelKey>>,
    #[serde(default)]
    pub(super) hide: Vec<LabelKey>,
    #[serde(default)]
    pub(super) opacity: BTreeMap<String, f64>,
}

/// A label by its number or name, or a range.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged, expecting = "a label is a number or text")]
pub(super) enum LabelKey {
    Number(u16),
    Text(String),
}

/// A channel as the source of colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum ChannelName {
    /// No channel, overriding a preset's.
    None,
    Color,
    Value,
    Material,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MaterialKeys {
    pub(super) preset: Option<String>,
    pub(super) channel: Option<ChannelName>,
    pub(super) colors: Option<Vec<(f64, String)>>,
    pub(super) color: Option<String>,
    pub(super) diffuse: Option<f64>,
    pub(super) specular: Option<f64>,
    pub(super) exponent: Option<u32>,
    pub(super) mirror: Option<f64>,
    pub(super) clear: Option<f64>,
    pub(super) index: Option<f64>,
}

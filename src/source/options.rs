//! Choices of the caller on how volumes are opened.

use std::path::PathBuf;

use super::RawOptions;
use crate::volume::{Overlap, Placement};

/// Choices that volumes leave to their reader.
#[derive(Clone, Debug, Default, PartialEq, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OpenOptions {
    /// Layout of headerless files; without it they are not volumes.
    #[serde(skip)]
    pub raw: Option<RawOptions>,
    /// Treatment of missing slices of a series.
    pub gaps: GapPolicy,
    /// Number of the volume that [`fn@crate::discovery::open`] takes, counted from 1 over all volumes of a
    /// [`Catalogue`](crate::discovery::Catalogue) in its order, refused ones included; the largest if none is chosen.
    pub volume: Option<usize>,
    /// Places on the axes before z of an array in chunks (OME-Zarr, Zarr), by their names and counted from 0: moment
    /// and channel, `t` and `c`. An axis without a name has its number. Then that is the only volume of the array.
    pub index: Vec<(String, u64)>,
    /// Folder of the results (canonical), which is not searched.
    pub skip: Option<PathBuf>,
    /// Spacing and directions in place of the files' own; [`OpenOptions::raw`] has a placement of its own.
    pub placement: Placement,
    /// Memory for putting the images of one series in order; `None` for no bound. A small file can hold very many
    /// frames.
    pub opening_bytes: Option<u64>,
    /// True to read data of a header or a side-car that a symbolic link leads out of its folder to, and to search
    /// linked folders. The sender of a header could then have any file of the disk read.
    pub follow_links: bool,
    /// True to take all of very many volumes that are alike, such as the moments of one series; otherwise only the
    /// first.
    pub all_volumes: bool,
    /// The label of voxels in several masks, to take several volumes of one grid together as the masks of a map of
    /// labels; `None` to take each by itself.
    pub masks: Option<Overlap>,
    /// True to name labels as somebody typed it in, where a code is stated, too. Such names may identify a patient.
    pub keep_names: bool,
    /// True to take triangle meshes and trees of solids, too, when folders are searched. They are not volumes: the
    /// caller chooses the grid on which they are built.
    pub meshes: bool,
}

/// Treatment of missing slices of a series.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum GapPolicy {
    /// Refuse the series, and say where.
    #[default]
    Error,
    /// Keep the true geometry: a missing slice is interpolated between its neighbours.
    Fill,
    /// Use the slices as if they were evenly spaced; the warning states the resulting error of the geometry.
    Keep,
}

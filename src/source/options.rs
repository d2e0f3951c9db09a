//! Choices of the caller on how volumes are opened.

use std::path::PathBuf;

use super::RawOptions;
use crate::volume::{Overlap, Placement};

/// How volumes are read, where they leave a choice.
#[derive(Clone, Debug, Default, PartialEq, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OpenOptions {
    /// Layout of headerless files; without it they are not volumes.
    #[serde(skip)]
    pub raw: Option<RawOptions>,
    /// Treatment of missing slices of a series.
    pub gaps: GapPolicy,
    /// Which of several volumes [`fn@crate::discovery::open`] takes, counted from 1 over all volumes of a [`Catalogue`](crate::discovery::Catalogue)
    /// in its order, refused ones included; the largest if none is chosen.
    pub volume: Option<usize>,
    /// Places on the axes before z of an array in chunks (OME-Zarr, Zarr), by their names and counted from 0: moment and
    /// channel, `t` and `c`. An axis without a name has its number. Then that is the only volume of the array.
    pub index: Vec<(String, u64)>,
    /// A folder (canonical) that is not searched: that of the results.
    pub skip: Option<PathBuf>,
    /// Spacing and directions that come before what the files state; of [`OpenOptions::raw`] its own count.
    pub placement: Placement,
    /// Memory that putting the images of one series in order may take; not bounded if nothing is said. A
    /// small file can hold very many frames.
    pub opening_bytes: Option<u64>,
    /// May a header or a side-car name data that a symbolic link leads out of its folder to, and are linked folders
    /// searched? Who sent a header could else have any file of the disk read.
    pub follow_links: bool,
    /// Are all of very many volumes taken that are alike, such as the moments of one series, or only the first?
    pub all_volumes: bool,
    /// Are several volumes of one grid taken together, as the masks of a map of labels? Then this says whose a voxel of
    /// several masks is.
    pub masks: Option<Overlap>,
    /// Are labels named as somebody typed it in, where a code is stated, too? Such names may identify a patient.
    pub keep_names: bool,
    /// Are triangle meshes and trees of solids taken, too, when folders are searched? They are not volumes: who takes them
    /// says on which grid they are built.
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
    /// Use the slices as if they were evenly spaced; the geometry is wrong by what the warning says.
    Keep,
}

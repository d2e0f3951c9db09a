//! The metadata record (SPEC 4.4); the encoding is private to this module.

use serde::{Deserialize, Serialize};

use super::error::{FormatError, damaged};
use crate::geom::Dims;

/// Longest metadata section.
pub(crate) const METADATA_LIMIT: usize = 1 << 20;

/// Origin of the voxels.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct SourceMeta {
    /// Kind of source: dicom, raw, nrrd, mesh, csg, synthetic, ...
    pub format: String,
    /// The kind of image and its processing; never the name of the input.
    pub kind: String,
    /// Number of files read.
    pub files: u64,
    /// Bytes of the volume as a raw file.
    pub bytes: u64,
}

impl SourceMeta {
    /// True for formats whose axes are a patient's.
    pub(crate) fn is_patient(&self) -> bool {
        matches!(self.format.as_str(), "dicom" | "nifti" | "nrrd" | "metaimage")
    }
}

/// Method that chose the range.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum SelectionKind {
    /// `value >= lo`, given by the user.
    Iso,
    /// `lo <= value <= hi`, given by the user.
    Range,
    /// `value >= lo`, found by Otsu's method.
    Otsu,
}

/// Range of the inside values, in physical units: `lo <= value <= hi`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Selection {
    /// Method that chose it.
    pub kind: SelectionKind,
    /// Lowest inside value.
    pub lo: f64,
    /// Highest inside value; infinite for iso and Otsu.
    pub hi: f64,
}

/// Data of a file besides structure and channels.
#[derive(Clone, Debug, PartialEq)]
pub struct Metadata {
    /// Writer and version.
    pub program: String,
    /// Origin.
    pub source: SourceMeta,
    /// Size in voxels.
    pub dims: [u32; 3],
    /// Sample type code (SPEC 4.4).
    pub scalar: u8,
    /// Distance between neighbours in mm.
    pub spacing_mm: [f64; 3],
    /// Voxel index to LPS mm, three rows of four.
    pub affine: [[f64; 4]; 3],
    /// Slope and intercept of the rescale.
    pub rescale: [f64; 2],
    /// Selection of the inside values.
    pub selection: Selection,
    /// Connectivity of the skin: 26 or 6.
    pub connectivity: u8,
    /// Estimator of the normals; empty without them.
    pub gradient: String,
    /// Scale and offset of stored values.
    pub value_scale: [f64; 2],
    /// Bound on the distance of larger leaves from the surface, and measured distances; only with larger leaves (SPEC
    /// 4.9).
    pub error: Option<ErrorBound>,
    /// Noise of the volume; only with a steepness (SPEC 4.14).
    pub noise: Option<Noise>,
}

/// Noise of a volume, in its physical units: basis of the uncertainty of a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Noise {
    /// Standard deviation of the samples inside; 0 where it could not be measured.
    pub inside: f64,
    /// Standard deviation of the samples outside; 0 where it could not be measured.
    pub outside: f64,
    /// Correlation of neighbouring samples along x, y, z.
    pub correlation: [f64; 3],
    /// Change of values per mm across the surface of the least steep cell; 0 if there is none.
    pub steepness: f64,
}

impl Noise {
    /// Length of the record in bytes.
    const BYTES: usize = 48;

    fn to_bytes(self) -> impl Iterator<Item = u8> {
        let [x, y, z] = self.correlation;
        [self.inside, self.outside, x, y, z, self.steepness].into_iter().flat_map(f64::to_le_bytes)
    }

    fn parse(bytes: &[u8; Self::BYTES]) -> Self {
        let [inside, outside, x, y, z, steepness] =
            std::array::from_fn(|i| f64::from_le_bytes(std::array::from_fn(|k| bytes[8 * i + k])));
        Self { inside, outside, correlation: [x, y, z], steepness }
    }

    /// True if all numbers are in their ranges.
    pub(crate) fn is_sound(&self) -> bool {
        let is_size = |v: f64| (0.0..f64::INFINITY).contains(&v);
        let parts = self.correlation.iter().all(|part| (0.0..1.0).contains(part));
        parts && [self.inside, self.outside, self.steepness].into_iter().all(is_size)
    }
}

/// Bound on the distance of larger leaves from the cells that they replace, and measured distances, in voxels of the
/// finest spacing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ErrorBound {
    /// Bound on the distance of every crossing of a cell's edge from the leaf.
    pub bound: f64,
    /// Root mean square of the distances of all crossings; crossings of cells that stayed count as 0.
    pub rms: f64,
    /// 99th percentile of the distances.
    pub p99: f64,
    /// Greatest distance; also covers the ends of leaves, measured from the nearest cell's surface.
    pub most: f64,
}

impl ErrorBound {
    /// Length of the record in bytes.
    const BYTES: usize = 32;

    fn to_bytes(self) -> impl Iterator<Item = u8> {
        [self.bound, self.rms, self.p99, self.most].into_iter().flat_map(f64::to_le_bytes)
    }

    fn parse(bytes: &[u8; Self::BYTES]) -> Self {
        let [bound, rms, p99, most] =
            std::array::from_fn(|i| f64::from_le_bytes(std::array::from_fn(|k| bytes[8 * i + k])));
        Self { bound, rms, p99, most }
    }

    /// True if all numbers are in their ranges.
    pub(crate) fn is_sound(&self) -> bool {
        let rising = [0.0, self.rms, self.most, f64::MAX];
        self.bound > 0.0
            && self.bound <= 1.0
            && rising.is_sorted()
            && self.p99 >= 0.0
            && self.p99 <= self.most
    }
}

/// The record field by field, as SPEC 4.4 lists it.
#[derive(Serialize, Deserialize)]
struct Wire {
    program: String,
    source: SourceMeta,
    dims: [u32; 3],
    scalar: u8,
    spacing_mm: [f64; 3],
    affine: [[f64; 4]; 3],
    rescale: [f64; 2],
    selection: (u8, f64, f64),
    connectivity: u8,
    gradient: String,
    value_scale: [f64; 2],
}

/// Marks around the viewpoints in [`SourceMeta::kind`] of a model that keeps only its visible part.
const SEEN_FROM: [&str; 2] = [" [visible-from ", "]"];

impl Metadata {
    /// Notes that the model keeps only the part visible from these viewpoints, behind the name of the source, like all
    /// processing of a volume.
    pub(crate) fn note_seen_from(&mut self, places: &str) {
        let [before, behind] = SEEN_FROM;
        self.source.kind.push_str(&format!("{before}{places}{behind}"));
    }

    /// Viewpoints of a model that keeps only its visible part; `None` for a whole model. Such a model does not
    /// determine the inside.
    pub(crate) fn seen_from(&self) -> Option<&str> {
        let [before, behind] = SEEN_FROM;
        self.source.kind.strip_suffix(behind)?.rsplit_once(before).map(|(_, places)| places)
    }

    /// The record of a solid without samples: voxels of 1 mm, as for a volume that is 1 inside and 0 outside.
    pub fn of_grid(dims: Dims, kind: &str) -> Self {
        Self {
            program: String::new(),
            source: SourceMeta { format: "solid".into(), kind: kind.into(), files: 0, bytes: 0 },
            dims: dims.to_array(),
            scalar: 0,
            spacing_mm: [1.0; 3],
            affine: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
            rescale: [1.0, 0.0],
            selection: Selection { kind: SelectionKind::Iso, lo: 1.0, hi: f64::INFINITY },
            connectivity: 26,
            gradient: String::new(),
            value_scale: [0.0, 0.0],
            error: None,
            noise: None,
        }
    }

    /// Bytes of the record.
    ///
    /// # Errors
    /// Strings are so long that the record passes `METADATA_LIMIT`.
    pub fn to_bytes(&self) -> Result<Vec<u8>, FormatError> {
        let wire = Wire {
            program: self.program.clone(),
            source: self.source.clone(),
            dims: self.dims,
            scalar: self.scalar,
            spacing_mm: self.spacing_mm,
            affine: self.affine,
            rescale: self.rescale,
            selection: (self.selection.kind as u8, self.selection.lo, self.selection.hi),
            connectivity: self.connectivity,
            gradient: self.gradient.clone(),
            value_scale: self.value_scale,
        };
        let config = bincode::config::standard().with_little_endian().with_fixed_int_encoding();
        let mut bytes =
            bincode::serde::encode_to_vec(wire, config).map_err(|_| damaged("metadata cannot be written"))?;
        bytes.extend(self.error.into_iter().flat_map(ErrorBound::to_bytes));
        bytes.extend(self.noise.into_iter().flat_map(Noise::to_bytes));
        if bytes.len() > METADATA_LIMIT {
            return Err(damaged("metadata is longer than 1 MiB"));
        }
        Ok(bytes)
    }

    /// Reads a record that must fill `bytes` exactly.
    ///
    /// # Errors
    /// Lengths that do not fit, unknown codes, values out of range, bytes left over.
    pub(crate) fn parse(bytes: &[u8]) -> Result<Self, FormatError> {
        let config = bincode::config::standard()
            .with_little_endian()
            .with_fixed_int_encoding()
            .with_limit::<METADATA_LIMIT>();
        let (wire, used): (Wire, usize) = bincode::serde::decode_from_slice(bytes, config)
            .map_err(|_| damaged("metadata cannot be read"))?;
        // The records that follow are distinguished by their lengths.
        let rest = bytes.get(used..).unwrap_or_default();
        let (error, left) = match rest.split_first_chunk() {
            Some((record, left)) if rest.len() != Noise::BYTES => (Some(ErrorBound::parse(record)), left),
            _ => (None, rest),
        };
        let noise = <&[u8; Noise::BYTES]>::try_from(left).ok().map(Noise::parse);
        if noise.is_some_and(|noise| !noise.is_sound()) {
            return Err(damaged("metadata states noise that cannot be"));
        }
        if noise.is_none() && !left.is_empty() {
            return Err(damaged("metadata has bytes left over"));
        }
        let kind = match wire.selection.0 {
            0 => SelectionKind::Iso,
            1 => SelectionKind::Range,
            2 => SelectionKind::Otsu,
            code => return Err(damaged(format_args!("selection kind {code} is unknown"))),
        };
        if wire.scalar > 7 || !matches!(wire.connectivity, 6 | 26) {
            return Err(damaged("metadata names an unknown sample type or connectivity"));
        }
        let finite =
            wire.affine.iter().flatten().chain(&wire.spacing_mm).chain(&wire.rescale).all(|v| v.is_finite());
        if !finite || wire.spacing_mm.iter().any(|s| *s <= 0.0) {
            return Err(damaged("metadata has a geometry that is not finite and positive"));
        }
        Ok(Self {
            program: wire.program,
            source: wire.source,
            dims: wire.dims,
            scalar: wire.scalar,
            spacing_mm: wire.spacing_mm,
            affine: wire.affine,
            rescale: wire.rescale,
            selection: Selection { kind, lo: wire.selection.1, hi: wire.selection.2 },
            connectivity: wire.connectivity,
            gradient: wire.gradient,
            value_scale: wire.value_scale,
            error,
            noise,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Metadata {
        Metadata {
            program: "infobyte 0".into(),
            source: SourceMeta { format: "raw".into(), kind: "volume".into(), files: 1, bytes: 8 },
            dims: [2, 2, 2],
            scalar: 2,
            spacing_mm: [1.0, 1.0, 2.0],
            affine: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 2.0, 0.0]],
            rescale: [1.0, -1024.0],
            selection: Selection { kind: SelectionKind::Iso, lo: 500.0, hi: f64::INFINITY },
            connectivity: 26,
            gradient: "gauss5".into(),
            value_scale: [0.0, 0.0],
            error: None,
            noise: None,
        }
    }

    #[test]
    fn a_record_round_trips_and_refuses_every_cut_and_every_surplus() {
        let bytes = sample().to_bytes().unwrap();
        assert_eq!(Metadata::parse(&bytes).unwrap(), sample());
        for len in 0..bytes.len() {
            assert!(Metadata::parse(&bytes[..len]).is_err(), "cut at {len}");
        }
        let mut longer = bytes;
        longer.push(0);
        assert!(Metadata::parse(&longer).is_err());
    }
}

//! Origin of a volume as a model records it: the kind of image and its treatments, never its name.

use std::fmt;
use std::ops::Range;

/// Origin of a volume: the record in a model, and the name in messages.
///
/// Its text ([`fmt::Display`]) goes into the metadata of the model: the kind of image and its treatments. It is made of
/// the typed fields alone, so that no name of a file, a folder or a person can get there.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SourceDescription {
    /// Kind of source: `raw`, `dicom`, `synthetic`, ...
    pub format: String,
    /// Name of the input in messages. It may identify a patient, and is never written into a model.
    pub name: String,
    /// The kind of image, as far as the input states it.
    pub kind: ImageKind,
    /// Treatments of the volume, in order.
    pub treatments: Vec<Treatment>,
    /// Labels that the input states; names may come from names of files.
    pub labels: Vec<StatedLabel>,
    /// Number of files read.
    pub files: u64,
    /// Bytes of voxel data.
    pub bytes: u64,
}

/// A label as an input states it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StatedLabel {
    /// Its number in the volume.
    pub number: u16,
    /// Its name: the meaning of a code or of a class; may be empty.
    pub name: String,
    /// Another name, which somebody typed in where there is a code, too. It may identify a patient, and is written into
    /// a model only if that is asked for.
    pub typed: String,
    /// Its colour (sRGB), if one is stated.
    pub color: Option<[u8; 3]>,
}

/// Kinds of images.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum ImageKind {
    /// The input states no kind.
    #[default]
    Unstated,
    /// A part of a series of images.
    Series {
        /// Kind of images: `CT image`, `segmentation`, ...
        object: String,
        /// Number of the series in its study.
        number: Option<i32>,
        /// Volume of the series, for example `echo 2`; or empty.
        part: String,
    },
    /// A synthetic object, by its name.
    Synthetic(&'static str),
}

/// The kind of image with parts of voxels as values.
pub(crate) const FRACTIONAL: &str = "fractional segmentation";

impl ImageKind {
    /// True if the values are parts of voxels.
    pub(crate) fn is_fractional(&self) -> bool {
        matches!(self, Self::Series { object, .. } if object == FRACTIONAL)
    }
}

impl fmt::Display for ImageKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unstated => f.write_str("volume"),
            Self::Synthetic(name) => f.write_str(name),
            Self::Series { object, number, part } => {
                f.write_str(object)?;
                if let Some(number) = number {
                    write!(f, ", series {number}")?;
                }
                if !part.is_empty() {
                    write!(f, ", {part}")?;
                }
                Ok(())
            }
        }
    }
}

/// Treatment of a volume before its model was built.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Treatment {
    /// The input states another spacing.
    SpacingReplaced,
    /// The input states other directions.
    DirectionsReplaced,
    /// A part was cut out: voxel indices along x, y, z, the ends not included.
    Crop([Range<u32>; 3]),
    /// Labels as one mask, 1 inside and 0 outside, and their number.
    Mask(usize),
    /// Reduction by this factor along each axis.
    Downsample(u32),
    /// Cleaning of its occupancy, in these steps.
    Cleaned(Vec<String>),
}

impl fmt::Display for Treatment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::SpacingReplaced => f.write_str("spacing replaced"),
            Self::DirectionsReplaced => f.write_str("directions replaced"),
            Self::Crop([x, y, z]) => write!(f, "roi {x:?},{y:?},{z:?}"),
            Self::Mask(labels) => write!(f, "mask of {labels} labels"),
            Self::Downsample(factor) => write!(f, "downsample {factor}"),
            Self::Cleaned(steps) => f.write_str(&steps.join("; ")),
        }
    }
}

impl fmt::Display for SourceDescription {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.kind.fmt(f)?;
        self.treatments.iter().try_for_each(|treatment| write!(f, " [{treatment}]"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_text_is_made_of_kind_and_treatments_and_holds_no_name() {
        let mut description = SourceDescription { name: "Somebody.nrrd".into(), ..Default::default() };
        assert_eq!(description.to_string(), "volume");
        description.treatments = vec![
            Treatment::Crop([0..4, 1..5, 2..6]),
            Treatment::Downsample(2),
            Treatment::Cleaned(vec!["close 1".into(), "keep-largest 1".into()]),
        ];
        let series =
            |number, part: &str| ImageKind::Series { object: "MR image".into(), number, part: part.into() };
        description.kind = series(Some(12), "echo 2");
        let text = description.to_string();
        assert_eq!(
            text,
            "MR image, series 12, echo 2 [roi 0..4,1..5,2..6] [downsample 2] [close 1; keep-largest 1]"
        );
        assert_eq!(series(None, "").to_string(), "MR image");
    }
}

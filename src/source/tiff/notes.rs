//! Fields that ImageJ and OME write into the description of a TIFF file.

use crate::fault::{Fault, bad};
use crate::source::header::unit_mm;

/// The fields of a description.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Notes {
    /// Pictures that ImageJ wrote side by side behind one directory.
    pub(super) images: u64,
    /// Distance in mm of neighbours along x, y, z.
    pub(super) spacing_mm: Option<[f64; 3]>,
    /// Why the pictures do not form a volume.
    pub(super) refused: Option<Fault>,
}

impl Notes {
    /// Reads a description; `resolution` is pixels per unit along x and y.
    pub(super) fn read(description: &str, resolution: [Option<f64>; 2]) -> Self {
        if description.starts_with("ImageJ=") {
            return Self::image_j(description, resolution);
        }
        match description.split_once("<Pixels").and_then(|(_, rest)| rest.split_once('>')) {
            Some((pixels, _)) if description.contains("<OME") => Self::ome(pixels),
            _ => Self { images: 1, ..Self::default() },
        }
    }

    /// Lines of `key=value`.
    fn image_j(description: &str, resolution: [Option<f64>; 2]) -> Self {
        let value = |key: &str| {
            let mut lines = description.lines().filter_map(|line| line.split_once('='));
            lines.find(|(k, _)| *k == key).map(|(_, v)| v.trim())
        };
        let count = |key: &str| value(key).and_then(|v| v.parse::<u64>().ok()).unwrap_or(1);
        let several = ["channels", "frames"].into_iter().map(|of| (of, count(of))).find(|(_, n)| *n > 1);
        let refused = several.map(|(of, count)| {
            bad!("is an ImageJ hyperstack of {count} {of}; save one of them as a stack of its own")
        });
        let spacing = |mm: f64| {
            let depth = value("spacing").and_then(|v| v.parse::<f64>().ok()).map_or(1.0, f64::abs);
            let across = resolution[0].or(resolution[1])?;
            let down = resolution[1].unwrap_or(across);
            sound([mm / across, mm / down, mm * depth])
        };
        let spacing_mm = value("unit").and_then(unit_mm).and_then(spacing);
        Self { images: count("images"), spacing_mm, refused }
    }

    /// Attributes of the first `Pixels` element.
    fn ome(pixels: &str) -> Self {
        let value = |key: &str| {
            let (_, rest) = pixels.split_once(&format!(" {key}=\""))?;
            rest.split_once('"').map(|(value, _)| value)
        };
        let count = |key: &str| value(key).and_then(|v| v.parse::<u64>().ok()).unwrap_or(1);
        let several =
            [("SizeC", "channels"), ("SizeT", "time points")].into_iter().find(|(k, _)| count(k) > 1);
        let refused = several.map(|(key, of)| {
            bad!("is an OME file of {} {of}; save one of them as a stack of its own", count(key))
        });
        let length = |axis: &str| {
            let size: f64 = value(&format!("PhysicalSize{axis}"))?.parse().ok()?;
            let unit = value(&format!("PhysicalSize{axis}Unit"));
            // The schema's own default is the micrometre.
            Some(size * unit.map_or(Some(1e-3), unit_mm)?)
        };
        let (x, y) = (length("X"), length("Y"));
        let spacing_mm = x.zip(y).and_then(|(x, y)| sound([x, y, length("Z").unwrap_or(x)]));
        Self { images: 1, spacing_mm, refused }
    }
}

fn sound(spacing: [f64; 3]) -> Option<[f64; 3]> {
    spacing.iter().all(|s| s.is_finite() && *s > 0.0).then_some(spacing)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn image_j_tells_spacing_in_its_unit() {
        let text = "ImageJ=1.53t\nimages=40\nslices=40\nunit=micron\nspacing=-2.5\nloop=false\n";
        let notes = Notes::read(text, [Some(2.0), Some(4.0)]);
        assert_eq!((notes.images, &notes.refused), (40, &None));
        let spacing = notes.spacing_mm.unwrap();
        for (got, want) in spacing.into_iter().zip([0.0005, 0.00025, 0.0025]) {
            assert!((got - want).abs() < 1e-15, "{spacing:?}");
        }
        assert_eq!(Notes::read("ImageJ=1\nunit=pixel\n", [Some(1.0); 2]).spacing_mm, None);
        assert_eq!(Notes::read("ImageJ=1\nunit=mm\n", [None; 2]).spacing_mm, None);
        for text in ["ImageJ=1\nimages=6\nchannels=2\nslices=3\n", "ImageJ=1\nimages=6\nframes=6\n"] {
            let refused = Notes::read(text, [None; 2]).refused.unwrap();
            assert!(refused.text.contains("hyperstack"), "{refused}");
        }
    }

    #[test]
    fn ome_tells_spacing_and_what_is_no_volume() {
        let text = "<?xml?><OME><Image><Pixels BigEndian=\"false\" PhysicalSizeX=\"0.5\" PhysicalSizeY=\"0.25\" PhysicalSizeYUnit=\"mm\" PhysicalSizeZ=\"3\" SizeC=\"1\" SizeZ=\"9\"><TiffData/></Pixels></Image></OME>";
        assert_eq!(Notes::read(text, [None; 2]).spacing_mm, Some([0.0005, 0.25, 0.003]));
        let channels = text.replace("SizeC=\"1\"", "SizeC=\"3\"");
        let fault = bad!("is an OME file of {} channels; save one of them as a stack of its own", 3);
        assert_eq!(Notes::read(&channels, [None; 2]).refused, Some(fault));
        assert_eq!(
            Notes::read("<OME><Pixels PhysicalSizeX=\"nan\" PhysicalSizeY=\"1\">", [None; 2]).spacing_mm,
            None
        );
        assert_eq!(Notes::read("a photograph", [Some(72.0); 2]), Notes { images: 1, ..Notes::default() });
    }
}

//! Fields that ImageJ, OME and tifffile write into the description of a TIFF file.

use serde_json::Value;

use crate::fault::{Fault, bad};
use crate::source::header::{number, unit_mm};

/// ImageJ's numbers of calibration by a straight line, and of none.
const STRAIGHT_LINE: u8 = 0;
const UNCALIBRATED: u8 = 20;

/// Keys of ImageJ's lines that are read.
const IMAGE_J_KEYS: [&str; 11] =
    ["images", "channels", "frames", "slices", "unit", "yunit", "zunit", "spacing", "cf", "c0", "c1"];

/// Most volumes of one file.
const MAX_VOLUMES: usize = 2048;

/// The fields of a description.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Notes {
    /// Pictures that are written side by side behind one directory.
    pub(super) images: u64,
    /// Distance in mm of neighbours along x, y, z.
    pub(super) spacing_mm: Option<[f64; 3]>,
    /// True if only the distance of slices is not stated.
    pub(super) lacks_depth: bool,
    /// A unit of length that is stated and not known, so that the spacing is not either.
    pub(super) unknown_unit: Option<String>,
    /// Name and length of each axis that pages follow each other along, the slowest first; empty where pages are
    /// slices.
    pub(super) axes: Vec<(char, u64)>,
    /// True if more pages may follow, of other images.
    pub(super) more_images: bool,
    /// Slope and intercept of values of 8 and 16 bits, as ImageJ calibrates them.
    pub(super) calibration: Option<[f64; 2]>,
}

impl Notes {
    /// Reads a description; `resolution` is pixels per unit along x and y, `size` the columns and rows of a page.
    ///
    /// # Errors
    /// It states something else where a number belongs, or larger numbers than a volume has.
    pub(super) fn read(
        description: &str,
        resolution: [Option<f64>; 2],
        size: [u64; 2],
    ) -> Result<Self, Fault> {
        let description = description.trim_start_matches('\u{feff}');
        if description.starts_with("ImageJ=") {
            return Self::image_j(description, resolution);
        }
        // As tifffile wrote it before it wrote JSON.
        let early = description.strip_prefix("shape=(").and_then(|sides| sides.split_once(')'));
        let early = early.map(|(sides, _)| format!("{{\"shape\": [{}]}}", sides.trim_end_matches(',')));
        let description = early.as_deref().unwrap_or(description);
        if description.starts_with('{') {
            match serde_json::from_slice::<Value>(description.as_bytes()) {
                Ok(shaped) if shaped.get("shape").is_some() => {
                    return Self::shaped(&shaped["shape"], &shaped, size);
                }
                Err(_) if description.contains("\"shape\"") => {
                    return Err(bad!(
                        "its description states a shape, and cannot be parsed as JSON; save it again"
                    ));
                }
                _ => {}
            }
        }
        match description.split_once("<Pixels").and_then(|(_, rest)| rest.split_once('>')) {
            Some((pixels, rest)) if description.contains("<OME") => Self::ome(pixels, rest, size),
            _ => Ok(Self { images: 1, ..Self::default() }),
        }
    }

    /// Lines of `key=value`.
    fn image_j(description: &str, resolution: [Option<f64>; 2]) -> Result<Self, Fault> {
        let value = |key: &str| {
            let mut lines = description.lines().filter_map(|line| line.split_once('='));
            lines.find(|(k, _)| *k == key).map(|(_, v)| v.trim())
        };
        let count = |key: &str| value(key).map_or(Ok(1), |v| number::<u64>(key, v));
        stated_once(description)?;
        let images = count("images")?;
        let [channels, frames, slices] = [count("channels")?, count("frames")?, count("slices")?];
        let several = channels.saturating_mul(frames);
        let mut axes = Vec::new();
        if several > 1 {
            if slices == 1 {
                let (of, count) = if frames > 1 { ("frames", frames) } else { ("channels", channels) };
                return Err(bad!(
                    "is an ImageJ hyperstack of {count} {of} without slices; save one of them as a stack of its own"
                ));
            }
            axes = vec![('T', frames), ('Z', slices), ('C', channels)];
        } else if images > 1 {
            axes = vec![('Z', images)];
        }
        let of_length = |key: &str| value(key).filter(|unit| !matches!(*unit, "" | "pixel" | "pixels"));
        let unit = of_length("unit");
        // Units of y and z are stated where they are others than that of x.
        for key in ["yunit", "zunit"] {
            let (own, of_x) = (value(key).unwrap_or(""), value("unit").unwrap_or("nothing"));
            let is_other = of_length(key).and_then(unit_mm) != unit.and_then(unit_mm);
            if !own.is_empty() && own != of_x && is_other {
                return Err(bad!(
                    "its description states the unit `{of_x}`, and `{own}` for another axis ({key}); save it in one unit"
                ));
            }
        }
        if unit.and_then(unit_mm).is_some() && resolution.contains(&Some(f64::INFINITY)) {
            return Err(bad!(
                "its resolution is a number over 0, which makes no spacing; save it again, or leave the resolution out"
            ));
        }
        let depth = value("spacing").map(|v| number::<f64>("spacing", v)).transpose()?;
        if let Some(depth) = depth.filter(|depth| images > 1 && !depth.is_normal()) {
            return Err(bad!("its description states slices {depth} apart (spacing); save it again"));
        }
        let spacing = |mm: f64| {
            let across = resolution[0].or(resolution[1])?;
            let down = resolution[1].unwrap_or(across);
            sound([mm / across, mm / down, mm * depth.map_or(1.0, f64::abs)])
        };
        let spacing_mm = unit.and_then(unit_mm).and_then(spacing);
        let lacks_depth = spacing_mm.is_some() && depth.is_none();
        let unknown_unit = unit.filter(|unit| unit_mm(unit).is_none()).map(str::to_owned);
        let mut calibration = None;
        let function = value("cf").map(|v| number::<u8>("cf", v)).transpose()?.filter(|f| *f != UNCALIBRATED);
        if let Some(function) = function {
            if function != STRAIGHT_LINE {
                return Err(bad!(
                    "its description calibrates values by ImageJ's function {function} (cf), and a straight line alone is read; save it without calibration"
                ));
            }
            let [slope, intercept] = ["c1", "c0"].map(|key| number::<f64>(key, value(key).unwrap_or("")));
            let line = [slope?, intercept?];
            if line[0] == 0.0 || !line.iter().all(|number| number.is_finite()) {
                return Err(bad!(
                    "its description calibrates values by {line:?}, which makes no numbers; save it again"
                ));
            }
            calibration = Some(line);
        }
        Ok(Self { images, spacing_mm, lacks_depth, unknown_unit, axes, more_images: false, calibration })
    }

    /// Reads the shape of an array, as tifffile and napari write it: the last two sides are the page's.
    fn shaped(shape: &Value, all: &Value, [columns, rows]: [u64; 2]) -> Result<Self, Fault> {
        let wrong =
            || bad!("its description states the shape {shape}, whose last sides are not those of a page");
        let sides = shape.as_array().ok_or_else(wrong)?;
        let sides: Option<Vec<u64>> = sides.iter().map(Value::as_u64).collect();
        let mut sides = sides.ok_or_else(wrong)?;
        let mut names: Vec<char> = all.get("axes").and_then(Value::as_str).unwrap_or("").chars().collect();
        if names.len() != sides.len() {
            names = vec!['?'; sides.len()];
        }
        // Grey values may have an axis of their own.
        if sides.len() > 2 && sides.last() == Some(&1) && !sides.ends_with(&[rows, columns]) {
            sides.pop();
        }
        let pages = sides.strip_suffix(&[rows, columns]).ok_or_else(wrong)?;
        let mut axes: Vec<(char, u64)> =
            names.iter().copied().zip(pages.iter().copied()).filter(|(_, side)| *side != 1).collect();
        let images = axes.iter().fold(1_u64, |all, (_, side)| all.saturating_mul(*side));
        let truncated = all.get("truncated").and_then(Value::as_bool) == Some(true);
        // The slowest axes except z are volumes; without names, z is the fastest.
        if !axes.iter().any(|(name, _)| *name == 'Z')
            && let Some(last) = axes.last_mut()
        {
            if let Some(kind) = [('T', "times"), ('C', "channels")].iter().find(|(name, _)| *name == last.0) {
                return Err(bad!(
                    "is an array of {} {} without slices (axes); save one of them as a stack of its own",
                    last.1,
                    kind.1
                ));
            }
            last.0 = 'Z';
        }
        Ok(Self { images: if truncated { images } else { 1 }, axes, more_images: true, ..Self::default() })
    }

    /// Attributes of the first `Pixels` element, and the text after it.
    fn ome(pixels: &str, rest: &str, size: [u64; 2]) -> Result<Self, Fault> {
        let value = |key: &str| attribute(pixels, key);
        let count = |key: &str| value(key).map_or(Ok(1), |v| number::<u64>(key, v));
        let [z, c, t] = [count("SizeZ")?, count("SizeC")?, count("SizeT")?];
        for (key, due) in ["SizeX", "SizeY"].into_iter().zip(size) {
            if value(key).is_some() && count(key)? != due {
                return Err(bad!(
                    "its description states {} for {key}, and its pages have {due}; save it again",
                    count(key)?
                ));
            }
        }
        let more_images = rest.contains("<Pixels");
        let mut axes = Vec::new();
        if c.saturating_mul(t) > 1 || more_images || value("SizeZ").is_some() {
            let order = value("DimensionOrder").unwrap_or("XYZCT");
            let faster = order.strip_prefix("XY").filter(|rest| is_order(rest));
            let faster = faster.ok_or_else(|| {
                bad!(
                    "its description states the DimensionOrder `{}`, not an order of axes",
                    order.escape_debug()
                )
            })?;
            axes = faster
                .chars()
                .rev()
                .map(|name| {
                    (
                        name,
                        match name {
                            'Z' => z,
                            'C' => c,
                            _ => t,
                        },
                    )
                })
                .collect();
            if c.saturating_mul(t) > 1 && z == 1 {
                return Err(bad!(
                    "is an OME file of {c} channels and {t} time points without slices; save one of them as a stack of its own"
                ));
            }
            if !in_order(rest.split("<Pixels").next().unwrap_or(rest), &axes)? {
                return Err(bad!(
                    "is an OME file whose pages follow each other in another order than it states (TiffData); save it again"
                ));
            }
        }
        let mut unknown_unit = None;
        let mut length = |axis: &str| {
            let key = format!("PhysicalSize{axis}");
            let Some(size) = value(&key).map(|v| number::<f64>(&key, v)).transpose()? else {
                return Ok(None);
            };
            let unit = value(&format!("PhysicalSize{axis}Unit"));
            // The schema's own default is the micrometre.
            let mm = unit.map_or(Some(1e-3), unit_mm);
            unknown_unit = unit.filter(|_| mm.is_none()).map(str::to_owned).or(unknown_unit.take());
            Ok::<_, Fault>(mm.map(|mm| size * mm))
        };
        let (x, y, depth) = (length("X")?, length("Y")?, length("Z")?);
        let spacing_mm = x.zip(y).and_then(|(x, y)| sound([x, y, depth.unwrap_or(x)]));
        let lacks_depth = spacing_mm.is_some() && depth.is_none();
        Ok(Self { images: 1, spacing_mm, lacks_depth, unknown_unit, axes, more_images, calibration: None })
    }

    /// The pages of each volume, for a file of `pages` pages; `None` where all of them are the slices of one.
    ///
    /// # Errors
    /// The axes make another number of pages.
    pub(super) fn volumes(&self, pages: usize) -> Result<Option<Vec<Vec<usize>>>, Fault> {
        let all = self
            .axes
            .iter()
            .try_fold(1_usize, |all, (_, side)| all.checked_mul(usize::try_from(*side).ok()?));
        let images = match all.filter(|all| *all > 0) {
            Some(1) if self.more_images => return Ok(None),
            _ if self.axes.is_empty() => return Ok(None),
            Some(all) if all == pages || self.more_images && pages.is_multiple_of(all) => pages / all,
            _ => {
                let axes: Vec<String> =
                    self.axes.iter().map(|(name, side)| format!("{name} {side}")).collect();
                return Err(bad!(
                    "its description states axes that its {pages} pages do not make: {}; save it again",
                    axes.join(", ")
                ));
            }
        };
        let (mut step, mut depth) = (1_usize, (1, 1));
        let mut steps = Vec::new();
        for (name, side) in self.axes.iter().rev() {
            let side = usize::try_from(*side).unwrap_or(usize::MAX);
            if *name == 'Z' {
                depth = (side, step)
            } else {
                steps.push((side, step))
            }
            step = step.saturating_mul(side);
        }
        // The first page of each volume, then all pages of it.
        let mut firsts: Vec<usize> = (0..images).map(|image| image * (pages / images)).collect();
        for (side, step) in steps.into_iter().rev() {
            firsts =
                firsts.into_iter().flat_map(|first| (0..side).map(move |at| first + at * step)).collect();
        }
        if firsts.len() < 2 && pages == depth.0 {
            return Ok(None);
        }
        if firsts.len() > MAX_VOLUMES {
            return Err(bad!(
                "holds {} volumes, and 1 to {MAX_VOLUMES} are read; split the file",
                firsts.len()
            ));
        }
        Ok(Some(
            firsts.into_iter().map(|first| (0..depth.0).map(|z| first + z * depth.1).collect()).collect(),
        ))
    }
}

/// Refuses a line of ImageJ's that is there twice, with different values.
fn stated_once(description: &str) -> Result<(), Fault> {
    let lines = || description.lines().filter_map(|line| line.split_once('='));
    for key in IMAGE_J_KEYS {
        let mut own = lines().filter(|(name, _)| *name == key).map(|(_, value)| value.trim());
        let Some(first) = own.next() else { continue };
        if let Some(other) = own.find(|other| *other != first) {
            return Err(bad!(
                "its description states `{}` and `{}` for {key}; remove the wrong line",
                first.escape_debug(),
                other.escape_debug()
            ));
        }
    }
    Ok(())
}

/// True for the letters of the three axes behind X and Y, each once.
fn is_order(axes: &str) -> bool {
    axes.len() == 3 && ['Z', 'C', 'T'].iter().all(|axis| axes.contains(*axis))
}

/// The value of an attribute of XML, in either kind of quotes.
fn attribute<'a>(element: &'a str, key: &str) -> Option<&'a str> {
    element.match_indices(key).find_map(|(at, _)| {
        let (before, behind) = (&element[..at], &element[at + key.len()..]);
        let value = behind.trim_start().strip_prefix('=')?.trim_start();
        let quote =
            value.chars().next().filter(|c| before.ends_with(char::is_whitespace) && "\"'".contains(*c))?;
        value[1..].split_once(quote).map(|(value, _)| value)
    })
}

/// True if the elements `TiffData` give pages in the order of the axes, as far as they give places.
fn in_order(text: &str, axes: &[(char, u64)]) -> Result<bool, Fault> {
    for element in text.split("<TiffData").skip(1).filter_map(|rest| rest.split_once('>')).map(|(own, _)| own)
    {
        let at = |key: &str| attribute(element, key).map(|v| number::<u64>(key, v)).transpose();
        let (page, mut place) = (at("IFD")?, 0_u64);
        for (name, side) in axes {
            place = place.saturating_mul(*side).saturating_add(at(&format!("First{name}"))?.unwrap_or(0));
        }
        if page.is_some_and(|page| page != place) {
            return Ok(false);
        }
    }
    Ok(true)
}

fn sound(spacing: [f64; 3]) -> Option<[f64; 3]> {
    spacing.iter().all(|s| s.is_finite() && *s > 0.0).then_some(spacing)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, resolution: [Option<f64>; 2]) -> Notes {
        Notes::read(text, resolution, [8, 6]).unwrap()
    }

    #[test]
    fn image_j_tells_spacing_in_its_unit() {
        let text = "ImageJ=1.53t\nimages=40\nslices=40\nunit=micron\nspacing=-2.5\nloop=false\n";
        let notes = read(text, [Some(2.0), Some(4.0)]);
        assert_eq!((notes.images, notes.lacks_depth, notes.volumes(40)), (40, false, Ok(None)));
        let spacing = notes.spacing_mm.unwrap();
        for (got, want) in spacing.into_iter().zip([0.0005, 0.00025, 0.0025]) {
            assert!((got - want).abs() < 1e-15, "{spacing:?}");
        }
        assert!(read("ImageJ=1\nunit=micron\n", [Some(2.0); 2]).lacks_depth);
        assert_eq!(read("ImageJ=1\nunit=pixel\n", [Some(1.0); 2]).spacing_mm, None);
        assert_eq!(read("ImageJ=1\nunit=mm\n", [None; 2]).spacing_mm, None);
        let unknown = ["pixel", "furlong"].map(|unit| read(&format!("ImageJ=1\nunit={unit}\n"), [None; 2]));
        assert_eq!(unknown.map(|notes| notes.unknown_unit), [None, Some("furlong".to_owned())]);
        for (text, words) in [
            ("ImageJ=1\nimages=6\nframes=6\n", "hyperstack"),
            ("ImageJ=1\nunit=mm\nspacing=2,5\n", "`2,5` for spacing"),
            ("ImageJ=1\nimages=6\nunit=mm\nspacing=nan\n", "slices NaN apart"),
            ("ImageJ=1\nimages=6\nunit=mm\nspacing=0\n", "slices 0 apart"),
            ("ImageJ=1\nunit=mm\nspacing=2\nspacing=3\n", "states `2` and `3` for spacing"),
            ("ImageJ=1\nimages=6\nunit=micron\nzunit=nm\n", "`nm` for another axis (zunit)"),
            ("ImageJ=1\nimages=6\nunit=micron\nyunit=pixel\n", "`pixel` for another axis (yunit)"),
            ("ImageJ=1\nimages=6\nchannels=two\n", "`two` for channels"),
            ("ImageJ=1\nimages=6\nslices=six\n", "`six` for slices"),
            ("ImageJ=1\ncf=0\nc0=-1024,0\nc1=1\n", "`-1024,0` for c0"),
            ("ImageJ=1\ncf=0\nc0=5\n", "`` for c1"),
            ("ImageJ=1\ncf=0\nc0=5\nc1=0\n", "calibrates values by [0.0, 5.0]"),
            ("{\"shape\": [5, 6, 8], ", "cannot be parsed as JSON"),
            ("{\"shape\": [5, 6, 8], \"axes\": \"TYX\"}", "5 times without slices"),
            ("{\"shape\": [2, 5, 6, 8], \"axes\": \"TCYX\"}", "5 channels without slices"),
            ("<OME><Pixels SizeC=\"2\" SizeZ=\"3\" DimensionOrder=\"ZYXCT\">", "`ZYXCT`"),
            ("<OME><Pixels SizeC=\"2\" SizeZ=\"3\" DimensionOrder=\"XYZ\">", "`XYZ`"),
        ] {
            let refused = Notes::read(text, [None; 2], [8, 6]).unwrap_err();
            assert!(refused.text.contains(words), "{refused}");
        }
    }

    #[test]
    fn ome_tells_spacing_and_numbers_that_are_none() {
        let text = "<?xml?><OME><Image><Pixels BigEndian=\"false\" PhysicalSizeX=\"0.5\" PhysicalSizeY=\"0.25\" PhysicalSizeYUnit=\"mm\" PhysicalSizeZ=\"3\" SizeC=\"1\" SizeZ=\"9\"><TiffData/></Pixels></Image></OME>";
        assert_eq!(read(text, [None; 2]).spacing_mm, Some([0.0005, 0.25, 0.003]));
        assert!(read(&text.replace("PhysicalSizeZ", "x"), [None; 2]).lacks_depth);
        // XML allows other white space and quotation marks.
        for (from, to) in [(" PhysicalSizeX=", "\n\tPhysicalSizeX = "), ("\"0.25\"", "'0.25'")] {
            assert_eq!(read(&text.replace(from, to), [None; 2]), read(text, [None; 2]), "{to}");
        }
        let furlongs = read(&text.replace("\"mm\"", "\"furlong\""), [None; 2]);
        assert_eq!((furlongs.spacing_mm, furlongs.unknown_unit.as_deref()), (None, Some("furlong")));
        for (from, to, field) in
            [("\"0.25\"", "\"0,25\"", "PhysicalSizeY"), ("SizeC=\"1\"", "SizeC=\"one\"", "SizeC")]
        {
            let refused = Notes::read(&text.replace(from, to), [None; 2], [8, 6]).unwrap_err();
            assert!(refused.text.contains(field), "{refused}");
        }
        assert_eq!(
            read("<OME><Pixels PhysicalSizeX=\"nan\" PhysicalSizeY=\"1\">", [None; 2]).spacing_mm,
            None
        );
        assert_eq!(read("a photograph", [Some(72.0); 2]), Notes { images: 1, ..Notes::default() });
    }

    #[test]
    fn pages_of_several_axes_are_volumes_along_z() {
        let ome = |order: &str, more: &str| {
            format!(
                "<OME><Image><Pixels DimensionOrder=\"{order}\" SizeZ=\"3\" SizeC=\"2\" SizeT=\"1\" >{more}</Pixels></Image></OME>"
            )
        };
        let cases: [(&str, usize, &[&[usize]]); 10] = [
            (r#"{"shape": [2, 3, 6, 8]}"#, 6, &[&[0, 1, 2], &[3, 4, 5]]),
            ("shape=(2, 3, 6, 8)", 6, &[&[0, 1, 2], &[3, 4, 5]]),
            (r#"{"shape": [3, 2, 6, 8], "axes": "ZCYX"}"#, 6, &[&[0, 2, 4], &[1, 3, 5]]),
            (r#"{"shape": [1, 3, 6, 8, 1]}"#, 3, &[]),
            (r#"{"shape": [6, 8]}"#, 5, &[]),
            (r#"{"shape": [2, 6, 8]}"#, 4, &[&[0, 1], &[2, 3]]),
            (
                "ImageJ=1\nimages=8\nchannels=2\nslices=2\nframes=2\n",
                8,
                &[&[0, 2], &[1, 3], &[4, 6], &[5, 7]],
            ),
            (&ome("XYZCT", ""), 6, &[&[0, 1, 2], &[3, 4, 5]]),
            (&ome("XYCZT", "<TiffData FirstZ=\"1\" FirstC=\"1\" IFD=\"3\"/>"), 6, &[&[0, 2, 4], &[1, 3, 5]]),
            ("ImageJ=1\nimages=4\nslices=4\n", 4, &[]),
        ];
        for (text, pages, due) in cases {
            let due: Vec<Vec<usize>> = due.iter().map(|pages| pages.to_vec()).collect();
            let found = read(text, [None; 2]).volumes(pages);
            assert_eq!(found, Ok(Some(due).filter(|due| !due.is_empty())), "{text}");
        }
        for (text, pages) in [
            (r#"{"shape": [2, 3, 6, 8]}"#, 7),
            ("ImageJ=1\nimages=8\nchannels=2\nslices=2\nframes=2\n", 7),
            ("ImageJ=1\nimages=7\nslices=7\n", 5),
            ("ImageJ=1\nimages=4\nslices=4\n", 5),
            (&ome("XYZCT", ""), 5),
        ] {
            assert!(read(text, [None; 2]).volumes(pages).is_err(), "{text}");
        }
        for text in [
            r#"{"shape": [2, 3, 7, 8]}"#,
            r#"{"shape": [2, "3", 6, 8]}"#,
            &ome("XYZCT", "<TiffData FirstC=\"1\" IFD=\"1\"/>"),
        ] {
            assert!(Notes::read(text, [None; 2], [8, 6]).is_err(), "{text}");
        }
    }
}

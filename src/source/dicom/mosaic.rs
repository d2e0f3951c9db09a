//! Siemens mosaics: one picture that holds the slices of a volume as tiles.
//!
//! ```text
//!   tile 0 | tile 1 | tile 2        as many tiles in a row as in a column: the square root of the number
//!   tile 3 | tile 4 | tile 5        of slices, rounded up; what is left over at the end is empty
//!   tile 6 |        |
//! ```
//!
//! Image Type says that a picture is one; how many slices it holds, and on which side of a slice the next
//! one lies, are only in private elements (see [`super::csa`]). The stated position is that of the first
//! pixel of a picture as large as all tiles together with the first slice in its centre, so that of the
//! first slice lies half the difference of the sizes further along the rows and down the columns.
//!
//! An enhanced image has frames of its own and is no mosaic, whatever it says.

use super::csa::{self, Csa};
use super::deflated::Inflated;
use super::element::Parser;
use super::frames::FrameGeometry;
use super::group::{Shared, Slice};
use super::header::{DicomHeader, Tag, text};
use super::series::{Layer, Refusal, Stack, directions, dot, pixel_spacing};
use super::syntax::TransferSyntax;
use super::window::ReadAt;
use crate::geom::Affine;
use crate::volume::Endian;

/// Private creators of the blocks that matter.
const MR_HEADER: &str = "SIEMENS MR HEADER";
const CSA_HEADER: &str = "SIEMENS CSA HEADER";

/// Cosine of the largest angle between the stated normal and that of the image: they are the same but for
/// rounding, and one that is not belongs to another image.
const PARALLEL: f64 = 0.99;

/// What private elements of the main dataset say of a mosaic.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Private {
    mr_block: Option<u8>,
    csa_block: Option<u8>,
    /// (0019,xx0A) Number of Images in Mosaic.
    pub images: Option<u32>,
}

/// Block and element of a private tag of a group, if it is one.
fn private(tag: Tag, group: u32) -> Option<(u8, u8)> {
    let [high, low, block, element] = tag.to_be_bytes();
    (u32::from(u16::from_be_bytes([high, low])) == group && block >= 0x10).then_some((block, element))
}

/// Block that this element reserves in a group, if it is a private creator.
fn reserved(tag: Tag, group: u32) -> Option<u8> {
    let [high, low, zero, block] = tag.to_be_bytes();
    (u32::from(u16::from_be_bytes([high, low])) == group && zero == 0 && block >= 0x10).then_some(block)
}

impl Private {
    /// Does [`Private::keep`] look at this tag?
    pub(super) fn wants(tag: Tag) -> bool {
        reserved(tag, 0x0019).or(reserved(tag, 0x0029)).is_some()
            || private(tag, 0x0019).is_some_and(|(_, element)| element == 0x0a)
    }

    /// Takes over one element, if it is one that matters.
    pub(super) fn keep(&mut self, tag: Tag, value: &[u8], endian: Endian) {
        if let Some(block) = reserved(tag, 0x0019).filter(|_| text(value) == MR_HEADER) {
            self.mr_block.get_or_insert(block);
        } else if let Some(block) = reserved(tag, 0x0029).filter(|_| text(value) == CSA_HEADER) {
            self.csa_block.get_or_insert(block);
        } else if private(tag, 0x0019)
            .is_some_and(|(block, element)| Some(block) == self.mr_block && element == 0x0a)
        {
            self.images = match *value {
                [a, b] if endian == Endian::Big => Some(u16::from_be_bytes([a, b]).into()),
                [a, b] => Some(u16::from_le_bytes([a, b]).into()),
                _ => text(value).parse().ok(),
            };
        }
    }

    /// Is this the header that [`super::csa`] reads?
    pub(super) fn is_csa(&self, tag: Tag) -> bool {
        private(tag, 0x0029).is_some_and(|(block, element)| Some(block) == self.csa_block && element == 0x10)
    }
}

/// How the slices of a volume lie in a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mosaic {
    /// Tiles in a row, and in a column.
    pub(super) across: u32,
    /// Slices; never more than tiles.
    pub(super) slices: u32,
    /// Distance of neighbouring slices.
    pub(super) distance_mm: f64,
    /// Do slices follow each other against the normal, rows x columns?
    pub(super) backwards: bool,
}

/// A mosaic, and what has to be said of it.
#[derive(Debug)]
pub(super) struct Found {
    pub(super) mosaic: Mosaic,
    /// Size of a tile: columns and rows.
    pub(super) size: [u32; 2],
    pub(super) warnings: Vec<String>,
}

/// Is the image a mosaic?
pub(super) fn is_one(header: &DicomHeader) -> bool {
    let enhanced = header.places.frame_groups.is_some() || header.places.shared_groups.is_some();
    !enhanced && header.image_type.split('\\').any(|part| part.trim() == "MOSAIC")
}

/// How the slices lie in an image that [`is_one`]; in words why that is not known.
pub(super) fn look<R: ReadAt + ?Sized>(input: &R, header: &DicomHeader) -> Result<Found, String> {
    let refuse = |reason: String| Err(format!("a Siemens mosaic {reason}"));
    if header.frames.is_some_and(|frames| frames != Ok(1)) {
        return refuse("of several frames cannot be read".into());
    }
    let mut warnings = Vec::new();
    let (csa, fault) = match private_header(input, header) {
        Ok(csa) => (csa, None),
        Err(reason) => (Csa::default(), Some(reason)),
    };
    let stated = |images: Option<u32>| images.filter(|n| *n > 0);
    let slices = match (stated(csa.images), stated(header.private.images)) {
        (Some(a), Some(b)) if a != b => {
            return refuse(format!("whose private elements state {a} slices, and {b} in another place"));
        }
        (Some(slices), _) | (None, Some(slices)) => slices,
        (None, None) => {
            let why = fault.map_or_else(String::new, |reason| format!(" (it cannot be read: {reason})"));
            return refuse(format!(
                "does not state the number of its slices, which only the private header (0029,1010) has{why}; \
                 give the original files, or convert them on the scanner"
            ));
        }
    };
    let across = slices.isqrt() + u32::from(slices.isqrt().pow(2) < slices);
    let [columns, rows] = [header.columns, header.rows].map(|side| u32::from(side.unwrap_or(0)));
    if columns == 0 || rows == 0 || columns % across != 0 || rows % across != 0 {
        return refuse(format!(
            "of {slices} slices has {across} x {across} tiles, and its {columns} x {rows} pixels cannot be \
             divided so"
        ));
    }
    let positive = |mm: Option<f64>| mm.filter(|mm| *mm > 0.0);
    let distance_mm = positive(header.spacing_between).or_else(|| {
        let thickness = positive(header.slice_thickness);
        warnings.push(match thickness {
            Some(mm) => {
                format!("the mosaic states no spacing between slices; their thickness, {mm} mm, is taken")
            }
            None => "the mosaic states no spacing between slices, and no thickness; 1 mm is assumed".into(),
        });
        thickness
    });
    let normal = header.orientation.and_then(directions).map(|(.., normal)| normal);
    let backwards = match (csa.normal, normal) {
        (Some(stated), Some(normal)) => {
            let cosine = dot(stated, normal);
            if cosine.abs() < PARALLEL {
                return refuse(
                    "states a slice normal in its private header that is not perpendicular to its rows and columns"
                        .into(),
                );
            }
            cosine < 0.0
        }
        (None, Some(_)) if slices > 1 => {
            let why = fault
                .map_or_else(String::new, |reason| format!(" (its private header cannot be read: {reason})"));
            warnings.push(format!(
                "the mosaic does not state in which direction its slices follow each other{why}; rows x columns is \
                 assumed"
            ));
            false
        }
        _ => false,
    };
    let mosaic = Mosaic { across, slices, distance_mm: distance_mm.unwrap_or(1.0), backwards };
    Ok(Found { mosaic, size: [columns / across, rows / across], warnings })
}

/// The private header, if there is one.
fn private_header<R: ReadAt + ?Sized>(input: &R, header: &DicomHeader) -> Result<Csa, String> {
    let Some(at) = header.places.csa else { return Ok(Csa::default()) };
    if header.transfer_syntax == TransferSyntax::Deflated {
        let inflated = Inflated::new(input, header.dataset).map_err(|e| e.to_string())?;
        return read_csa(&inflated, header, at);
    }
    read_csa(input, header, at)
}

fn read_csa<R: ReadAt + ?Sized>(input: &R, header: &DicomHeader, at: u64) -> Result<Csa, String> {
    let mut parser = Parser::new(input).map_err(|e| e.to_string())?;
    let element = parser.element(at, header.encoding).map_err(|e| e.to_string())?;
    let end = parser.end(&element, at).map_err(|e| e.to_string())?;
    csa::read(&mut parser.window, element.value_at, end - element.value_at)
}

impl Found {
    /// Geometry of the first slice, from that of the picture.
    pub(super) fn first_slice(&self, mut picture: FrameGeometry) -> FrameGeometry {
        let axes = picture.orientation.and_then(directions);
        if let (Some(position), Some((row, column, _))) = (picture.position, axes) {
            let [dy, dx] = picture.pixel_spacing.filter(|[a, b]| *a > 0.0 && *b > 0.0).unwrap_or([1.0; 2]);
            let more = f64::from(self.mosaic.across - 1) / 2.0;
            let [right, down] = [0, 1].map(|i| more * self.size.map(f64::from)[i] * [dx, dy][i]);
            picture.position = Some([0, 1, 2].map(|i| position[i] + right * row[i] + down * column[i]));
        }
        picture
    }
}

/// The volume of one mosaic, the `index`-th image of a group.
pub(super) fn assemble(
    shared: &Shared,
    mosaic: &Mosaic,
    index: usize,
    slice: &Slice,
) -> Result<Stack, Refusal> {
    let mut warnings = Vec::new();
    let [dx, dy] = pixel_spacing(shared, &mut warnings);
    let dz = mosaic.distance_mm;
    let tiles = 0..mosaic.slices;
    let Some((axes, first)) = shared.orientation.zip(slice.position()) else {
        warnings.push(format!(
            "the mosaic states no position: its slices are taken in their order, {dz} mm apart, placed at the origin"
        ));
        let layers = tiles.map(|tile| Layer::Tile(index, tile)).collect();
        return Ok(Stack { layers, affine: Affine::from_spacing([dx, dy, dz]), warnings });
    };
    let (row, column, normal) = directions(axes).ok_or_else(|| {
        Refusal::Other("the image orientation is not two perpendicular unit vectors".into())
    })?;
    let last = mosaic.slices.saturating_sub(1);
    let before = if mosaic.backwards { dz * f64::from(last) } else { 0.0 };
    let rows =
        [0, 1, 2].map(|i| [row[i] * dx, column[i] * dy, normal[i] * dz, first[i] - before * normal[i]]);
    let affine = Affine { rows };
    if affine.inverse().is_none() {
        return Err(Refusal::Other("the positions do not span a volume".into()));
    }
    let tile = |tile: u32| Layer::Tile(index, if mosaic.backwards { last - tile } else { tile });
    Ok(Stack { layers: tiles.map(tile).collect(), affine, warnings })
}

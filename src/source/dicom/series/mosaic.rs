//! Mosaics: one picture that holds the slices of a volume as tiles. Siemens mosaics are read; those of other vendors
//! are refused by name, as pictures of tiles must not become slices.
//!
//! ```text
//!   tile 0 | tile 1 | tile 2        as many tiles in a row as in a column: the square root of the number
//!   tile 3 | tile 4 | tile 5        of slices, rounded up; what is left over at the end is empty
//!   tile 6 |        |
//! ```
//!
//! Image Type marks a mosaic; the number of its slices, and the side of a slice on which the next one lies, are only in
//! private elements (see [`crate::source::dicom::parse::csa`]). The stated position is the first pixel of a picture as
//! large as all tiles together with the first slice in its centre, so that the first slice's first pixel lies half the
//! difference of the sizes further along the rows and down the columns.
//!
//! An enhanced image has frames of its own and is never a mosaic, even if it claims to be one.

use super::assemble::{Layer, Stack};
use super::axes::directions;
use crate::fault::{Fault, unfit};
use crate::geom::{Affine, dot};
use crate::source::dicom::image::describe::Obstacle;
use crate::source::dicom::parse::csa::{self, Csa, CsaFault};
use crate::source::dicom::parse::deflated::InflateReader;
use crate::source::dicom::parse::element::Parser;
use crate::source::dicom::parse::frames::FrameGeometry;
use crate::source::dicom::parse::header::DicomHeader;
use crate::source::dicom::parse::syntax::TransferSyntax;
use crate::source::dicom::parse::window::ReadAt;
use crate::volume::Note;

/// Least cosine between the stated normal and the image's: they differ by rounding only, and a normal that differs more
/// belongs to another image.
const PARALLEL: f64 = 0.99;

/// Arrangement of the slices of a volume in a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Mosaic {
    /// Tiles in a row, and in a column.
    pub(crate) across: u32,
    /// Slices; never more than tiles.
    pub(crate) slices: u32,
    /// Distance of neighbouring slices.
    pub(crate) distance_mm: f64,
    /// True if slices follow each other against the normal, rows x columns.
    pub(crate) backwards: bool,
}

/// A mosaic, the size of its tiles, and notes.
pub(crate) struct MosaicLayout {
    pub(crate) mosaic: Mosaic,
    /// Size of a tile: columns and rows.
    pub(crate) size: [u32; 2],
    pub(crate) notes: Vec<Note>,
}

/// True for a mosaic, of whichever vendor.
pub(crate) fn is_one(header: &DicomHeader) -> bool {
    let enhanced = header.offsets.frame_groups.is_some() || header.offsets.shared_groups.is_some();
    !enhanced && (header.image_type.split('\\').any(|part| part.trim() == "MOSAIC") || is_frame_set(header))
}

/// True for tiles in one picture as United Imaging lays them: the image type names a frame set, or a private sequence
/// lists its frames. The place of each tile is in that sequence only.
fn is_frame_set(header: &DicomHeader) -> bool {
    (header.offsets.frame_set.is_some() && header.modality == "MR")
        || header.image_type.split('\\').any(|part| part.split('_').any(|word| word.trim() == "VFRAME"))
}

/// Arrangement of the slices in an image that [`is_one`]; or the reason why it is unknown.
pub(crate) fn look<R: ReadAt + ?Sized>(input: &R, header: &DicomHeader) -> Result<MosaicLayout, Obstacle> {
    if header.frames.as_ref().is_some_and(|frames| *frames != Ok(1)) {
        return Err(Obstacle::new("a Siemens mosaic of several frames cannot be read"));
    }
    if is_frame_set(header) {
        return Err(Obstacle::new(
            "a frame set of United Imaging (VFRAME) holds its slices as tiles of one picture, which is not read; export it with one file for each slice",
        ));
    }
    let mut notes = Vec::new();
    let (csa, fault) = match private_header(input, header) {
        Ok(csa) => (csa, None),
        Err(fault) => (Csa::default(), Some(fault)),
    };
    let stated = |images: Option<u32>| images.filter(|n| *n > 0);
    let slices = match (stated(csa.images), stated(header.private.images)) {
        (Some(a), Some(b)) if a != b => {
            return Err(Obstacle::new(format!(
                "a Siemens mosaic whose private elements state {a} slices, and {b} in another place"
            )));
        }
        (Some(slices), _) | (None, Some(slices)) => slices,
        (None, None) => {
            return Err(Obstacle::new(format!(
                "a Siemens mosaic does not state the number of its slices, which only the private header (0029,1010) has{}; give the original files, or convert them on the scanner",
                fault.map_or_else(String::new, |fault| format!(" (it cannot be read: {fault})"))
            )));
        }
    };
    let across = slices.isqrt() + u32::from(slices.isqrt().pow(2) < slices);
    let [columns, rows] = [header.columns, header.rows].map(|side| u32::from(side.unwrap_or(0)));
    if columns == 0 || rows == 0 || columns % across != 0 || rows % across != 0 {
        return Err(Obstacle::new(format!(
            "a Siemens mosaic of {slices} slices has {across} x {across} tiles, and its {columns} x {rows} pixels cannot be divided so"
        )));
    }
    let positive = |mm: Option<f64>| mm.filter(|mm| *mm > 0.0);
    let distance_mm = positive(header.spacing_between).or_else(|| {
        let thickness = positive(header.slice_thickness);
        notes.push(match thickness {
            Some(mm) => Note::new(format!(
                "the mosaic states no spacing between slices; their thickness, {mm} mm, is taken"
            )),
            None => Note::spacing(
                "the mosaic states no spacing between slices, and no thickness; 1 mm is assumed",
            ),
        });
        thickness
    });
    let normal = header.orientation.and_then(directions).map(|(.., normal)| normal);
    let backwards = match (csa.normal, normal) {
        (Some(stated), Some(normal)) => {
            let cosine = dot(stated, normal);
            if cosine.abs() < PARALLEL {
                return Err(Obstacle::new(
                    "a Siemens mosaic states a slice normal in its private header that is not perpendicular to its rows and columns",
                ));
            }
            cosine < 0.0
        }
        (None, Some(_)) if slices > 1 => {
            notes.push(Note::new(format!("the mosaic does not state in which direction its slices follow each other{}; rows x columns is assumed", fault.map_or_else(String::new, |fault| format!(" (its private header cannot be read: {fault})")))));
            false
        }
        _ => false,
    };
    let mosaic = Mosaic { across, slices, distance_mm: distance_mm.unwrap_or(1.0), backwards };
    Ok(MosaicLayout { mosaic, size: [columns / across, rows / across], notes })
}

/// The private header, if there is one.
fn private_header<R: ReadAt + ?Sized>(input: &R, header: &DicomHeader) -> Result<Csa, CsaFault> {
    let Some(at) = header.offsets.csa else { return Ok(Csa::default()) };
    if header.transfer_syntax == TransferSyntax::Deflated {
        let inflated = InflateReader::new(input, header.dataset)?;
        return read_csa(&inflated, header, at);
    }
    read_csa(input, header, at)
}

fn read_csa<R: ReadAt + ?Sized>(input: &R, header: &DicomHeader, at: u64) -> Result<Csa, CsaFault> {
    let mut parser = Parser::new(input)?;
    let element = parser.element(at, header.encoding)?;
    let end = parser.end(&element, at)?;
    csa::read(&mut parser.window, element.value_at, end - element.value_at)
}

impl MosaicLayout {
    /// Geometry of the first slice, from the picture's.
    pub(crate) fn first_slice(&self, mut picture: FrameGeometry) -> FrameGeometry {
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

/// The volume of one mosaic, the `index`-th image of a group: pixels `dx` and `dy` apart, directions and
/// position of the first slice where both are stated.
pub(crate) fn assemble(
    mosaic: &Mosaic,
    index: usize,
    [dx, dy]: [f64; 2],
    place: Option<([f64; 6], [f64; 3])>,
    mut notes: Vec<Note>,
) -> Result<Stack, Fault> {
    let dz = mosaic.distance_mm;
    let tiles = 0..mosaic.slices;
    let Some((axes, first)) = place else {
        notes.push(Note::new(format!("the mosaic states no position: its slices are taken in their order, {dz} mm apart, placed at the origin")));
        let layers = tiles.map(|tile| Layer::Tile(index, tile)).collect();
        return Ok(Stack { layers, affine: Affine::from_spacing([dx, dy, dz]), notes });
    };
    let (row, column, normal) =
        directions(axes).ok_or(unfit!("the image orientation is not two perpendicular unit vectors"))?;
    let last = mosaic.slices.saturating_sub(1);
    let before = if mosaic.backwards { dz * f64::from(last) } else { 0.0 };
    let rows =
        [0, 1, 2].map(|i| [row[i] * dx, column[i] * dy, normal[i] * dz, first[i] - before * normal[i]]);
    let affine = Affine { rows };
    if affine.inverse().is_none() {
        return Err(unfit!("the positions do not span a volume"));
    }
    let tile = |tile: u32| Layer::Tile(index, if mosaic.backwards { last - tile } else { tile });
    Ok(Stack { layers: tiles.map(tile).collect(), affine, notes })
}

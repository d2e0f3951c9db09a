//! Marker segments of a codestream (ISO/IEC 15444-1 Annex A), and the box around it (Annex I).

use std::ops::Range;

use super::MAX_LEVELS;
use super::allowance::Allowance;
use super::geometry::Rect;
use crate::codec::{CodecError, damaged, unsupported};

const SOC: u16 = 0xFF4F;
const SIZ: u16 = 0xFF51;
const COD: u16 = 0xFF52;
const COC: u16 = 0xFF53;
const QCD: u16 = 0xFF5C;
const QCC: u16 = 0xFF5D;
const RGN: u16 = 0xFF5E;
const POC: u16 = 0xFF5F;
const PPM: u16 = 0xFF60;
const PPT: u16 = 0xFF61;
const SOT: u16 = 0xFF90;
const SOD: u16 = 0xFF93;
const EOC: u16 = 0xFFD9;

/// Changes of progression order in one tile; each costs a walk over the tile.
const MAX_PROGRESSIONS: usize = 32;

/// Sub-bands of a component: one of the lowest resolution, three of each other.
const MAX_BANDS: usize = 3 * MAX_LEVELS + 1;

/// Reads big-endian fields in order; past the end is damage.
struct Fields<'a> {
    bytes: &'a [u8],
}

impl<'a> Fields<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], CodecError> {
        let (head, tail) =
            self.bytes.split_at_checked(count).ok_or_else(|| damaged("a header ends early"))?;
        self.bytes = tail;
        Ok(head)
    }

    fn u8(&mut self) -> Result<u8, CodecError> {
        Ok(self.take(1)?[0])
    }

    fn u16(&mut self) -> Result<u16, CodecError> {
        let bytes = self.take(2)?;
        Ok(u16::from_be_bytes([bytes[0], bytes[1]]))
    }

    fn u32(&mut self) -> Result<u32, CodecError> {
        let bytes = self.take(4)?;
        Ok(u32::from_be_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
    }

    /// A component's number: one byte, or two where there are more than 256.
    fn component(&mut self) -> Result<usize, CodecError> {
        // More than 255 components are refused with the size, so it is always one byte.
        self.u8().map(usize::from)
    }
}

/// One marker segment: its marker, its parameters, and the offset of the next segment.
fn segment(codestream: &[u8], at: usize) -> Result<(u16, Fields<'_>, usize), CodecError> {
    let mut fields = Fields { bytes: codestream.get(at..).unwrap_or_default() };
    let marker = fields.u16()?;
    if marker < 0xFF00 {
        return Err(damaged("a marker is expected in a header, and there is none"));
    }
    if marker == SOD || marker == EOC || marker == SOC {
        return Ok((marker, Fields { bytes: &[] }, at + 2));
    }
    let length = usize::from(fields.u16()?);
    let body = length.checked_sub(2).ok_or_else(|| damaged("a marker segment has no length"))?;
    Ok((marker, Fields { bytes: fields.take(body)? }, at + 2 + length))
}

/// The codestream in `bytes`: all of them, or the contents of a JP2 file's box.
pub(super) fn find_codestream(bytes: &[u8]) -> Result<&[u8], CodecError> {
    if bytes.starts_with(&[0xFF, 0x4F]) {
        return Ok(bytes);
    }
    let mut rest = bytes;
    if rest.get(4..8) != Some(b"jP  ".as_slice()) {
        return Err(damaged("it starts like neither a JPEG 2000 codestream nor a JP2 file"));
    }
    while !rest.is_empty() {
        let mut fields = Fields { bytes: rest };
        let mut length = u64::from(fields.u32()?);
        let kind = fields.take(4)?;
        if length == 1 {
            length = u64::from(fields.u32()?) << 32 | u64::from(fields.u32()?);
        }
        let head = rest.len() - fields.bytes.len();
        // A last box may leave its length open, and a cut one reaches as far as there are bytes.
        let end = if length == 0 {
            rest.len()
        } else {
            usize::try_from(length).unwrap_or(usize::MAX).min(rest.len())
        };
        let body = rest.get(head..end).ok_or_else(|| damaged("a JP2 box is shorter than its head"))?;
        match kind {
            b"jp2c" => return Ok(body),
            b"jp2h" if body.windows(4).any(|kind| kind == b"pclr") => return Err(unsupported("a palette")),
            _ => rest = &rest[end..],
        }
    }
    Err(damaged("the JP2 file holds no codestream"))
}

/// The SIZ segment: image and tiles on the reference grid.
pub(super) struct ImageSize {
    pub(super) x0: u32,
    pub(super) y0: u32,
    pub(super) x1: u32,
    pub(super) y1: u32,
    tile_x0: u32,
    tile_y0: u32,
    tile_width: u32,
    tile_height: u32,
    pub(super) components: u8,
    pub(super) precision: u8,
    pub(super) signed: bool,
}

impl ImageSize {
    /// Parses the start of a codestream; also returns the offset of the next segment.
    pub(super) fn parse(codestream: &[u8]) -> Result<(Self, usize), CodecError> {
        let (marker, _, at) = segment(codestream, 0)?;
        let (next, mut fields, end) = segment(codestream, at)?;
        if marker != SOC || next != SIZ {
            return Err(damaged("the codestream does not begin with its size"));
        }
        let _capabilities = fields.u16()?;
        let [x1, y1, x0, y0] = [fields.u32()?, fields.u32()?, fields.u32()?, fields.u32()?];
        let [tile_width, tile_height, tile_x0, tile_y0] =
            [fields.u32()?, fields.u32()?, fields.u32()?, fields.u32()?];
        let count = fields.u16()?;
        if x1 <= x0 || y1 <= y0 || count == 0 || tile_width == 0 || tile_height == 0 {
            return Err(damaged("the image is empty"));
        }
        // Keeps sums of coordinates within 32 bits.
        if x1 > i32::MAX.unsigned_abs() || y1 > i32::MAX.unsigned_abs() {
            return Err(unsupported("a side of more than 2147483647 pixels"));
        }
        let reaches = |tile: u32, size: u32, image: u32| {
            tile <= image && u64::from(tile) + u64::from(size) > image.into()
        };
        if !reaches(tile_x0, tile_width, x0) || !reaches(tile_y0, tile_height, y0) {
            return Err(damaged("the first tile holds nothing of the image"));
        }
        let components = u8::try_from(count).map_err(|_| unsupported("more than 255 components"))?;
        let mut first = None;
        for _ in 0..components {
            let [depth, dx, dy] = [fields.u8()?, fields.u8()?, fields.u8()?];
            if dx != 1 || dy != 1 {
                return Err(unsupported("subsampled components"));
            }
            if *first.get_or_insert(depth) != depth {
                return Err(unsupported("components of different precision or sign"));
            }
        }
        let depth = first.unwrap_or(0);
        let precision = (depth & 0x7F) + 1;
        if precision > 38 {
            return Err(damaged("a precision of more than 38 bits"));
        }
        let signed = depth & 0x80 != 0;
        let size =
            Self { x0, y0, x1, y1, tile_x0, tile_y0, tile_width, tile_height, components, precision, signed };
        if u64::from(size.tile_columns()) * u64::from(size.tile_rows()) > 65535 {
            return Err(damaged("more than 65535 tiles"));
        }
        Ok((size, end))
    }

    pub(super) fn tile_columns(&self) -> u32 {
        (self.x1 - self.tile_x0).div_ceil(self.tile_width)
    }

    pub(super) fn tile_rows(&self) -> u32 {
        (self.y1 - self.tile_y0).div_ceil(self.tile_height)
    }

    /// The part of the image that a tile covers; never empty.
    pub(super) fn tile(&self, column: u32, row: u32) -> Rect {
        let side = |first: u32, size: u32, index: u32, least: u32, most: u32| {
            let start = u64::from(first) + u64::from(size) * u64::from(index);
            let within = |place: u64| u32::try_from(place.min(most.into())).unwrap_or(most).max(least);
            (within(start), within(start + u64::from(size)))
        };
        let (x0, x1) = side(self.tile_x0, self.tile_width, column, self.x0, self.x1);
        let (y0, y1) = side(self.tile_y0, self.tile_height, row, self.y0, self.y1);
        Rect { x0, y0, x1, y1 }
    }
}

/// Coding of one component (COD or COC, QCD or QCC, RGN).
#[derive(Clone)]
pub(super) struct Coding {
    /// Resolution levels above the lowest.
    pub(super) levels: u8,
    pub(super) block_width_log2: u8,
    pub(super) block_height_log2: u8,
    /// Code-block style flags, see `block`.
    pub(super) style: u8,
    pub(super) reversible: bool,
    /// Log2 of the precincts' width (low four bits) and height, by resolution.
    pub(super) precincts: [u8; MAX_LEVELS + 1],
    /// Shift of the coefficients of the region of interest.
    pub(super) roi_shift: u8,
    guard_bits: u8,
    derived: bool,
    /// Exponent (upper five bits) and mantissa of each sub-band's step.
    steps: [u16; MAX_BANDS],
    step_count: u8,
    /// Set by a segment for this component alone, which a general one does not override.
    own_coding: bool,
    own_steps: bool,
}

impl Coding {
    /// Exponent and mantissa of the quantisation step of a sub-band (E.1): `band` is 0 for the lowest one,
    /// then three for each resolution.
    pub(super) fn step(&self, resolution: u8, band: usize) -> Result<(u32, u32), CodecError> {
        let (index, lower) =
            if self.derived { (0, u32::from(resolution.saturating_sub(1))) } else { (band, 0) };
        if index >= usize::from(self.step_count) {
            return Err(damaged("a sub-band has no quantisation step"));
        }
        let step = u32::from(self.steps[index]);
        Ok(((step >> 11).saturating_sub(lower), step & 0x7FF))
    }

    /// Magnitude bit planes of a sub-band with that exponent (E-2).
    pub(super) fn planes(&self, exponent: u32) -> u32 {
        (u32::from(self.guard_bits) + exponent).saturating_sub(1)
    }

    fn read_coding(&mut self, fields: &mut Fields<'_>, custom_precincts: bool) -> Result<(), CodecError> {
        self.levels = fields.u8()?;
        if usize::from(self.levels) > MAX_LEVELS {
            return Err(damaged("more than 32 decomposition levels"));
        }
        let [width, height] = [fields.u8()? & 15, fields.u8()? & 15];
        if width > 8 || height > 8 || width + height > 8 {
            return Err(damaged("code-blocks of more than 4096 samples"));
        }
        (self.block_width_log2, self.block_height_log2) = (width + 2, height + 2);
        self.style = fields.u8()?;
        if self.style & 0x80 != 0 {
            return Err(unsupported("code-blocks of both block coders"));
        }
        self.reversible = match fields.u8()? {
            0 => false,
            1 => true,
            _ => return Err(unsupported("a wavelet transform of Part 2")),
        };
        self.precincts = [0xFF; MAX_LEVELS + 1];
        if custom_precincts {
            for (resolution, precinct) in
                self.precincts.iter_mut().take(usize::from(self.levels) + 1).enumerate()
            {
                *precinct = fields.u8()?;
                if resolution > 0 && (*precinct & 15 == 0 || *precinct >> 4 == 0) {
                    return Err(damaged("a precinct is smaller than a sample"));
                }
            }
        }
        Ok(())
    }

    fn read_steps(&mut self, fields: &mut Fields<'_>) -> Result<(), CodecError> {
        let style = fields.u8()?;
        self.guard_bits = style >> 5;
        self.derived = style & 31 == 1;
        let mut count = 0;
        for step in &mut self.steps {
            if fields.bytes.is_empty() || (self.derived && count == 1) {
                break;
            }
            *step = match style & 31 {
                0 => u16::from(fields.u8()? >> 3) << 11,
                1 | 2 => fields.u16()?,
                _ => return Err(damaged("an unknown quantisation style")),
            };
            count += 1;
        }
        self.step_count = count;
        Ok(())
    }
}

/// One progression of packets (COD, or an entry of POC): bounds are exclusive at the end.
#[derive(Clone, Debug)]
pub(super) struct Progression {
    /// 0 LRCP, 1 RLCP, 2 RPCL, 3 PCRL, 4 CPRL.
    pub(super) order: u8,
    pub(super) layers: u16,
    pub(super) resolutions: Range<u8>,
    pub(super) components: Range<u8>,
}

/// Decoding parameters of the main header, or of a tile's headers.
#[derive(Clone, Default)]
pub(super) struct Parameters {
    order: u8,
    pub(super) layers: u16,
    pub(super) component_transform: bool,
    /// Packets may be preceded by SOP segments; their headers may be followed by EPH.
    pub(super) packet_starts: bool,
    pub(super) header_ends: bool,
    coding: Vec<Coding>,
    changes: Vec<Progression>,
    seen_coding: bool,
    seen_steps: bool,
}

impl Parameters {
    pub(super) fn bytes(components: u8) -> u64 {
        let progressions = MAX_PROGRESSIONS * size_of::<Progression>();
        (usize::from(components) * size_of::<Coding>() + progressions + size_of::<Self>()) as u64
    }

    /// Parses the main header from `at`; also returns the offset of the first tile-part.
    pub(super) fn parse_main(
        codestream: &[u8],
        mut at: usize,
        components: u8,
    ) -> Result<(Self, usize), CodecError> {
        let coding = Coding {
            levels: 0,
            block_width_log2: 6,
            block_height_log2: 6,
            style: 0,
            reversible: true,
            precincts: [0xFF; MAX_LEVELS + 1],
            roi_shift: 0,
            guard_bits: 0,
            derived: false,
            steps: [0; MAX_BANDS],
            step_count: 0,
            own_coding: false,
            own_steps: false,
        };
        let coding = vec![coding; usize::from(components)];
        let mut parameters = Self { layers: 1, coding, ..Self::default() };
        loop {
            let (marker, fields, next) = segment(codestream, at)?;
            match marker {
                SOT => break,
                SOD | EOC => return Err(damaged("the main header is followed by no tile")),
                _ => parameters.read(marker, fields)?,
            }
            at = next;
        }
        if !parameters.seen_coding || !parameters.seen_steps {
            return Err(damaged("the main header lacks the coding style or the quantisation"));
        }
        Ok((parameters, at))
    }

    /// These parameters, overridden by the headers of a tile's parts.
    pub(super) fn of_tile(
        &self,
        codestream: &[u8],
        parts: &[TilePart],
        components: u8,
    ) -> Result<Self, CodecError> {
        let mut own = self.clone();
        debug_assert_eq!(own.coding.len(), usize::from(components));
        for coding in &mut own.coding {
            (coding.own_coding, coding.own_steps) = (false, false);
        }
        let mut changed = false;
        for part in parts {
            let mut at = part.header as usize;
            loop {
                let (marker, fields, next) = segment(codestream, at)?;
                if marker == SOD {
                    break;
                }
                // A tile's changes of progression replace those of the main header.
                if marker == POC && !changed {
                    own.changes.clear();
                    changed = true;
                }
                own.read(marker, fields)?;
                at = next;
            }
        }
        Ok(own)
    }

    pub(super) fn component(&self, component: usize) -> Result<&Coding, CodecError> {
        self.coding.get(component).ok_or_else(|| damaged("a component is not described"))
    }

    pub(super) fn progressions(&self) -> Vec<Progression> {
        if !self.changes.is_empty() {
            return self.changes.clone();
        }
        let components = u8::try_from(self.coding.len()).unwrap_or(u8::MAX);
        vec![Progression {
            order: self.order,
            layers: self.layers,
            resolutions: 0..33,
            components: 0..components,
        }]
    }

    fn read(&mut self, marker: u16, mut fields: Fields<'_>) -> Result<(), CodecError> {
        match marker {
            COD => {
                let flags = fields.u8()?;
                (self.packet_starts, self.header_ends) = (flags & 2 != 0, flags & 4 != 0);
                self.order = fields.u8()?;
                self.layers = fields.u16()?;
                if self.order > 4 || self.layers == 0 {
                    return Err(damaged("an unknown progression order, or no layer"));
                }
                self.component_transform = match fields.u8()? {
                    0 => false,
                    1 => true,
                    _ => return Err(unsupported("a component transform of Part 2")),
                };
                let mut general = self.component(0)?.clone();
                general.read_coding(&mut fields, flags & 1 != 0)?;
                for coding in self.coding.iter_mut().filter(|coding| !coding.own_coding) {
                    coding.levels = general.levels;
                    coding.block_width_log2 = general.block_width_log2;
                    coding.block_height_log2 = general.block_height_log2;
                    coding.style = general.style;
                    coding.reversible = general.reversible;
                    coding.precincts = general.precincts;
                }
                self.seen_coding = true;
            }
            COC => {
                let coding = self.named(&mut fields)?;
                let flags = fields.u8()?;
                coding.read_coding(&mut fields, flags & 1 != 0)?;
                coding.own_coding = true;
            }
            QCD => {
                let mut general = self.component(0)?.clone();
                general.read_steps(&mut fields)?;
                for coding in self.coding.iter_mut().filter(|coding| !coding.own_steps) {
                    coding.guard_bits = general.guard_bits;
                    coding.derived = general.derived;
                    coding.steps = general.steps;
                    coding.step_count = general.step_count;
                }
                self.seen_steps = true;
            }
            QCC => {
                let coding = self.named(&mut fields)?;
                coding.read_steps(&mut fields)?;
                coding.own_steps = true;
            }
            RGN => {
                let coding = self.named(&mut fields)?;
                let _style = fields.u8()?;
                coding.roi_shift = fields.u8()?;
            }
            POC => self.read_changes(&mut fields)?,
            PPM | PPT => return Err(unsupported("packed packet headers")),
            // Lengths, comments, capabilities and registration are not needed for decoding.
            _ => {}
        }
        Ok(())
    }

    fn named(&mut self, fields: &mut Fields<'_>) -> Result<&mut Coding, CodecError> {
        let component = fields.component()?;
        self.coding.get_mut(component).ok_or_else(|| damaged("a header is for a component that is not there"))
    }

    fn read_changes(&mut self, fields: &mut Fields<'_>) -> Result<(), CodecError> {
        while !fields.bytes.is_empty() {
            let [first_resolution, first_component] = [fields.u8()?, fields.u8()?];
            let layers = fields.u16()?;
            let [end_resolution, end_component, order] = [fields.u8()?, fields.u8()?, fields.u8()?];
            if order > 4 || self.changes.len() >= MAX_PROGRESSIONS {
                return Err(damaged("an unknown progression order, or more than 32 changes of it"));
            }
            // A zero for the last component means 256.
            let end_component = if end_component == 0 { u8::MAX } else { end_component };
            let count = u8::try_from(self.coding.len()).unwrap_or(u8::MAX);
            self.changes.push(Progression {
                order,
                layers: layers.min(self.layers),
                resolutions: first_resolution..end_resolution.min(33),
                components: first_component..end_component.min(count),
            });
        }
        Ok(())
    }
}

pub(super) struct TilePart {
    tile: u32,
    /// Offset of the segments after SOT.
    header: u32,
    /// Range of the packets in the codestream.
    pub(super) body: Range<u32>,
}

/// The parts of all tiles, by tile, in order of appearance.
pub(super) struct TileParts {
    parts: Vec<TilePart>,
}

impl TileParts {
    /// Finds all tile-parts from `at` on.
    pub(super) fn index(
        codestream: &[u8],
        mut at: usize,
        size: &ImageSize,
        allowance: &mut Allowance,
    ) -> Result<Self, CodecError> {
        let tiles = size.tile_columns() * size.tile_rows();
        let mut parts: Vec<TilePart> = Vec::new();
        let place = |at: usize| u32::try_from(at).map_err(|_| unsupported("a codestream of more than 4 GiB"));
        // A missing end of codestream is harmless; so are bytes after it.
        while codestream.len().saturating_sub(at) >= 12 {
            let start = at;
            let (marker, mut fields, next) = segment(codestream, at)?;
            if marker == EOC {
                break;
            }
            if marker != SOT {
                return Err(damaged("a tile-part is expected, and there is none"));
            }
            let tile = u32::from(fields.u16()?);
            let length = fields.u32()? as usize;
            if tile >= tiles {
                return Err(damaged("a tile is outside the image"));
            }
            at = next;
            let body = loop {
                let (marker, _, next) = segment(codestream, at)?;
                if marker == SOD {
                    break next;
                }
                if marker == SOT || marker == EOC {
                    return Err(damaged("a tile-part has no data"));
                }
                at = next;
            };
            // Length 0: up to the end of the codestream. An excessive length is cut: missing packets are noticed.
            let end = if length == 0 {
                codestream.len()
            } else {
                start.saturating_add(length).min(codestream.len())
            };
            if end < body {
                return Err(damaged("a tile-part is shorter than its header"));
            }
            allowance
                .push(&mut parts, TilePart { tile, header: place(next)?, body: place(body)?..place(end)? })?;
            at = end;
        }
        // Stable, so parts of a tile keep their order.
        allowance.reserve(parts.len() as u64 * size_of::<TilePart>() as u64)?;
        crate::order::by_key(&mut parts, |part| part.tile);
        allowance.release(parts.len() as u64 * size_of::<TilePart>() as u64);
        Ok(Self { parts })
    }

    /// The parts of one tile; empty if it is missing.
    pub(super) fn of(&self, tile: u32) -> &[TilePart] {
        let start = self.parts.partition_point(|part| part.tile < tile);
        let end = self.parts.partition_point(|part| part.tile <= tile);
        self.parts.get(start..end).unwrap_or_default()
    }
}

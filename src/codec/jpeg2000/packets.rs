//! Packets (ISO/IEC 15444-1 B.9 to B.12): the bytes of each code-block.

use std::ops::ControlFlow;

use super::MAX_PLANES;
use super::allowance::Allowance;
use super::geometry::{Grid, Orientation, TileLayout};
use super::header::{Parameters, TilePart};
use super::progression;
use crate::codec::{CodecError, damaged, unsupported};

/// Code-block styles (Table A.19).
pub(super) mod style {
    /// Lower bit planes are partly raw bits.
    pub(in super::super) const BYPASS: u8 = 1;
    /// Contexts start afresh at each pass.
    pub(in super::super) const RESET: u8 = 2;
    /// Every pass is a segment of its own.
    pub(in super::super) const TERMINATE: u8 = 4;
    /// Contexts do not look at the stripe below.
    pub(in super::super) const CAUSAL: u8 = 8;
    /// Cleanup passes end with four known symbols.
    pub(in super::super) const SYMBOLS: u8 = 32;
    /// High-throughput block coder (15444-15).
    pub(in super::super) const HIGH_THROUGHPUT: u8 = 64;
}

/// End of a list of pieces.
const NONE: u32 = u32::MAX;

/// Part of a segment of a code-block: some of its bytes.
struct Piece {
    start: u32,
    length: u32,
    next: u32,
    passes: u8,
}

#[derive(Clone)]
pub(super) struct Block {
    /// Position in the tile's area.
    pub(super) x: u32,
    pub(super) y: u32,
    pub(super) width: u16,
    pub(super) height: u16,
    /// Coding passes in all packets so far.
    pub(super) passes: u8,
    /// Bit planes that are zero, from the top.
    pub(super) zero_planes: u8,
    /// Bits of a length field, without the bits that its number of passes adds.
    length_bits: u8,
    /// Passes in the segment that is being filled.
    segment_passes: u8,
    first: u32,
    last: u32,
}

/// A node of both tag trees of a sub-band in a precinct: inclusion and zero bit planes.
#[derive(Clone)]
struct Node {
    layer: u16,
    layer_known: bool,
    planes: u8,
    planes_known: bool,
}

/// Code-blocks and trees of one sub-band in one precinct.
pub(super) struct BlockGroup {
    first_block: u32,
    first_node: u32,
}

/// State of a tile while its packets are read.
pub(super) struct Tile {
    pub(super) layout: TileLayout,
    /// Layers read, by precinct.
    layers: Vec<u16>,
    first_group: Vec<u32>,
    groups: Vec<BlockGroup>,
    blocks: Vec<Block>,
    nodes: Vec<Node>,
    pieces: Vec<Piece>,
}

/// Sizes of the levels of a tag tree, from the leaves to the root.
fn tree_levels(grid: &Grid) -> impl Iterator<Item = (u32, u32)> {
    let mut next = (grid.blocks() > 0).then_some((grid.across, grid.down));
    std::iter::from_fn(move || {
        let level = next?;
        next = (level != (1, 1)).then(|| (level.0.div_ceil(2), level.1.div_ceil(2)));
        Some(level)
    })
}

fn number(count: usize) -> Result<u32, CodecError> {
    u32::try_from(count).map_err(|_| damaged("too many code-blocks"))
}

impl Tile {
    /// Prepares all code-blocks, after their number is checked against the allowance.
    pub(super) fn new(layout: TileLayout, allowance: &mut Allowance) -> Result<Self, CodecError> {
        let (mut groups, mut blocks, mut nodes) = (0usize, 0usize, 0usize);
        // Each precinct has a sample of the image at least, and each code-block one of a sub-band.
        each_grid(&layout, |_, _, grid| {
            groups += 1;
            blocks += grid.blocks();
            nodes += tree_levels(grid).map(|(across, down)| across as usize * down as usize).sum::<usize>();
            Ok(())
        })?;
        let mut tile = Self {
            layers: allowance.filled(layout.precincts, 0)?,
            first_group: allowance.room(layout.precincts)?,
            groups: allowance.room(groups)?,
            blocks: allowance.room(blocks)?,
            nodes: allowance
                .filled(nodes, Node { layer: 0, layer_known: false, planes: 0, planes_known: false })?,
            pieces: Vec::new(),
            layout,
        };
        let mut first_node = 0;
        each_grid(&tile.layout, |precinct, _, grid| {
            if tile.first_group.len() == precinct {
                tile.first_group.push(number(tile.groups.len())?);
            }
            tile.groups.push(BlockGroup {
                first_block: number(tile.blocks.len())?,
                first_node: number(first_node)?,
            });
            first_node +=
                tree_levels(grid).map(|(across, down)| across as usize * down as usize).sum::<usize>();
            for row in 0..grid.down {
                for column in 0..grid.across {
                    let (x, y, width, height) = grid.block(column, row);
                    tile.blocks.push(Block {
                        x,
                        y,
                        width,
                        height,
                        passes: 0,
                        zero_planes: 0,
                        length_bits: 3,
                        segment_passes: 0,
                        first: NONE,
                        last: NONE,
                    });
                }
            }
            Ok(())
        })?;
        Ok(tile)
    }

    /// Returns the tile's memory to the allowance.
    pub(super) fn release(self, allowance: &mut Allowance) {
        self.layout.release(allowance);
        allowance.drop_list(self.layers);
        allowance.drop_list(self.first_group);
        allowance.drop_list(self.groups);
        allowance.drop_list(self.blocks);
        allowance.drop_list(self.nodes);
        allowance.drop_list(self.pieces);
    }

    /// All code-blocks of a component that have any passes, with orientation, bit planes and step of
    /// their sub-bands.
    pub(super) fn coded_blocks(
        &self,
        component: usize,
        mut visit: impl FnMut(&Block, Orientation, u32, f32) -> Result<(), CodecError>,
    ) -> Result<(), CodecError> {
        let Some(layout) = self.layout.components.get(component) else { return Ok(()) };
        for (index, resolution) in layout.resolutions.iter().enumerate() {
            for precinct in 0..resolution.precincts() {
                let first_group = self.first_group[(resolution.first_precinct + precinct) as usize] as usize;
                for (group, (band, grid)) in (first_group..).zip(layout.grids(index, precinct)) {
                    let first = self.groups[group].first_block as usize;
                    for block in &self.blocks[first..first + grid.blocks()] {
                        if block.passes > 0 {
                            visit(block, band.orientation, band.planes, band.step)?;
                        }
                    }
                }
            }
        }
        Ok(())
    }

    /// The pieces of a code-block: bytes and the number of passes that end with them.
    pub(super) fn pieces<'a>(
        &'a self,
        block: &Block,
        codestream: &'a [u8],
    ) -> impl Iterator<Item = (&'a [u8], u8)> {
        let mut at = block.first;
        std::iter::from_fn(move || {
            let piece = self.pieces.get(at as usize)?;
            at = piece.next;
            let start = piece.start as usize;
            let bytes = codestream.get(start..start + piece.length as usize).unwrap_or_default();
            Some((bytes, piece.passes))
        })
    }
}

/// Calls `visit` with the number of each precinct, its place in its resolution, and each sub-band's grid.
fn each_grid(
    layout: &TileLayout,
    mut visit: impl FnMut(usize, u32, &Grid) -> Result<(), CodecError>,
) -> Result<(), CodecError> {
    for component in &layout.components {
        for (index, resolution) in component.resolutions.iter().enumerate() {
            for precinct in 0..resolution.precincts() {
                for (_, grid) in component.grids(index, precinct) {
                    visit((resolution.first_precinct + precinct) as usize, precinct, &grid)?;
                }
            }
        }
    }
    Ok(())
}

/// Most passes of a segment that starts after `passes` passes (Table D.9; 15444-15, 7.2).
pub(super) fn segment_capacity(style: u8, passes: u8) -> u8 {
    if style & style::HIGH_THROUGHPUT != 0 {
        if passes == 0 { 1 } else { u8::MAX }
    } else if style & style::TERMINATE != 0 {
        1
    } else if style & style::BYPASS != 0 {
        match passes {
            0..10 => 10 - passes,
            passes if (passes - 10) % 3 == 0 => 2,
            _ => 1,
        }
    } else {
        u8::MAX
    }
}

/// Bits of packet headers: most significant first, a zero bit after each byte 0xFF.
struct HeaderBits<'a> {
    bytes: &'a [u8],
    at: usize,
    current: u8,
    left: u32,
}

impl HeaderBits<'_> {
    fn bit(&mut self) -> Result<u32, CodecError> {
        if self.left == 0 {
            self.left = if self.current == 0xFF { 7 } else { 8 };
            self.current = *self.bytes.get(self.at).ok_or_else(|| damaged("a packet header ends early"))?;
            self.at += 1;
        }
        self.left -= 1;
        Ok(u32::from(self.current) >> self.left & 1)
    }

    fn bits(&mut self, count: u32) -> Result<u32, CodecError> {
        let mut value = 0;
        for _ in 0..count {
            value = value << 1 | self.bit()?;
        }
        Ok(value)
    }

    /// Offset of the header's end: a last byte 0xFF has its stuffed bit in one more byte.
    fn end(&self) -> usize {
        self.at + usize::from(self.current == 0xFF)
    }

    /// Number of new passes (Table B.4).
    fn passes(&mut self) -> Result<u32, CodecError> {
        for (bits, first) in [(1, 1), (1, 2), (2, 3), (5, 6)] {
            let value = self.bits(bits)?;
            if value != (1 << bits) - 1 {
                return Ok(first + value);
            }
        }
        Ok(37 + self.bits(7)?)
    }
}

pub(super) fn read(
    codestream: &[u8],
    parts: &[TilePart],
    parameters: &Parameters,
    tile: &mut Tile,
    allowance: &mut Allowance,
) -> Result<(), CodecError> {
    let total: u64 = tile.layers.len() as u64 * u64::from(parameters.layers);
    let mut reader =
        Reader { codestream, parts: parts.iter(), at: 0, end: 0, parameters, allowance, read: 0 };
    for progression in parameters.progressions() {
        if reader.read == total {
            break;
        }
        progression::walk(tile, &progression, &mut reader)?;
    }
    // Changes of progression may leave packets out; they would be missing from the image.
    if reader.read < total {
        return Err(damaged("packets are missing"));
    }
    Ok(())
}

/// Reads packets one after the other, from all parts of a tile.
pub(super) struct Reader<'a> {
    codestream: &'a [u8],
    parts: std::slice::Iter<'a, TilePart>,
    at: usize,
    end: usize,
    parameters: &'a Parameters,
    pub(super) allowance: &'a mut Allowance,
    read: u64,
}

impl Reader<'_> {
    /// Reads one packet, unless an earlier progression has read it.
    pub(super) fn packet(
        &mut self,
        tile: &mut Tile,
        at: (u8, u8),
        precinct: u32,
        layer: u16,
    ) -> Result<(), CodecError> {
        let level = tile.layout.resolution(at);
        let precinct_number = (level.first_precinct + precinct) as usize;
        if tile.layers[precinct_number] != layer {
            // Read already, or out of order in a damaged stream: then packets will be missing at the end.
            return Ok(());
        }
        while self.at == self.end {
            let part = self.parts.next().ok_or_else(|| damaged("packets are missing"))?;
            (self.at, self.end) = (part.body.start as usize, part.body.end as usize);
        }
        let bytes = self.codestream.get(..self.end).unwrap_or_default();
        if self.parameters.packet_starts && bytes.get(self.at..self.at + 2) == Some(&[0xFF, 0x91]) {
            self.at += 6;
        }
        let mut bits = HeaderBits { bytes, at: self.at, current: 0, left: 0 };
        let first_piece = tile.pieces.len();
        if bits.bit()? != 0 {
            self.header(&mut bits, tile, at, precinct, layer)?;
        }
        self.at = bits.end();
        if self.parameters.header_ends && bytes.get(self.at..self.at + 2) == Some(&[0xFF, 0x92]) {
            self.at += 2;
        }
        for piece in &mut tile.pieces[first_piece..] {
            piece.start = number(self.at)?;
            self.at = self.at.saturating_add(piece.length as usize);
        }
        if self.at > self.end {
            return Err(damaged("a packet ends early"));
        }
        tile.layers[precinct_number] = layer + 1;
        self.read += 1;
        Ok(())
    }

    /// Reads the header of a packet: the code-blocks that it holds, and their numbers of bytes (B.10).
    fn header(
        &mut self,
        bits: &mut HeaderBits<'_>,
        tile: &mut Tile,
        at: (u8, u8),
        precinct: u32,
        layer: u16,
    ) -> Result<(), CodecError> {
        let (resolution, component) = (usize::from(at.0), usize::from(at.1));
        let coding = self.parameters.component(component)?;
        let (layout, level) = (&tile.layout.components[component], tile.layout.resolution(at));
        let first_group = tile.first_group[(level.first_precinct + precinct) as usize] as usize;
        for (group, (band, grid)) in (first_group..).zip(layout.grids(resolution, precinct)) {
            let BlockGroup { first_block, first_node } = tile.groups[group];
            // A tag tree may pass over all code-blocks with one bit.
            self.allowance.visit(grid.blocks())?;
            for index in 0..grid.blocks() {
                let block = &mut tile.blocks[first_block as usize + index];
                let index = number(index)?;
                let (column, row) = (index % grid.across, index / grid.across);
                let nodes = &mut tile.nodes[first_node as usize..];
                if block.passes > 0 {
                    if bits.bit()? == 0 {
                        continue;
                    }
                } else {
                    if !included(bits, nodes, &grid, column, row, layer)? {
                        continue;
                    }
                    block.zero_planes = zero_planes(bits, nodes, &grid, column, row)?;
                    let coded = band.planes.saturating_sub(block.zero_planes.into());
                    if u32::from(block.zero_planes) > band.planes || coded > MAX_PLANES {
                        return Err(damaged("a code-block has impossible bit planes"));
                    }
                }
                let mut passes = bits.passes()?;
                let most = if coding.style & style::HIGH_THROUGHPUT != 0 { 3 } else { 3 * MAX_PLANES - 2 };
                if u32::from(block.passes) + passes > most {
                    return Err(unsupported("that many coding passes of a code-block"));
                }
                while bits.bit()? != 0 {
                    block.length_bits += 1;
                    if block.length_bits > 32 {
                        return Err(damaged("the length of a code-block is impossible"));
                    }
                }
                while passes > 0 {
                    let start = block.passes - block.segment_passes;
                    let room = u32::from(segment_capacity(coding.style, start) - block.segment_passes);
                    let now = passes.min(room);
                    let length = bits.bits((u32::from(block.length_bits) + now.ilog2()).min(32))?;
                    passes -= now;
                    let now = u8::try_from(now).unwrap_or(u8::MAX);
                    block.passes += now;
                    block.segment_passes =
                        if u32::from(now) == room { 0 } else { block.segment_passes + now };
                    let place = number(tile.pieces.len())?;
                    self.allowance
                        .push(&mut tile.pieces, Piece { start: 0, length, next: NONE, passes: now })?;
                    if block.first == NONE {
                        block.first = place;
                    } else if let Some(last) = tile.pieces.get_mut(block.last as usize) {
                        last.next = place;
                    }
                    block.last = place;
                }
            }
        }
        Ok(())
    }
}

/// Calls `step` with each node from the root to a leaf, until it breaks.
fn descend<B>(
    nodes: &mut [Node],
    grid: &Grid,
    column: u32,
    row: u32,
    mut step: impl FnMut(&mut Node) -> Result<ControlFlow<B>, CodecError>,
) -> Result<Option<B>, CodecError> {
    // At most 17 levels: a side has less than 2^16 code-blocks within a precinct of 2^15.
    let mut path = [0usize; 33];
    let mut depth = 0;
    let mut first = 0usize;
    for (level, (across, down)) in tree_levels(grid).enumerate() {
        let shift = u32::try_from(level).unwrap_or(u32::MAX);
        if let Some(place) = path.get_mut(level) {
            *place = first + (row >> shift) as usize * across as usize + (column >> shift) as usize;
            depth = level + 1;
        }
        first += across as usize * down as usize;
    }
    for &place in path[..depth].iter().rev() {
        if let ControlFlow::Break(result) = step(&mut nodes[place])? {
            return Ok(Some(result));
        }
    }
    Ok(None)
}

/// True if a code-block first appears in this layer. It must not have appeared before.
fn included(
    bits: &mut HeaderBits<'_>,
    nodes: &mut [Node],
    grid: &Grid,
    column: u32,
    row: u32,
    layer: u16,
) -> Result<bool, CodecError> {
    let mut least = 0;
    let excluded = descend(nodes, grid, column, row, |node| {
        // All code-blocks under the node are excluded from every layer below `node.layer`.
        node.layer = node.layer.max(least);
        while !node.layer_known && node.layer <= layer {
            if bits.bit()? == 1 {
                node.layer_known = true;
            } else {
                node.layer += 1;
            }
        }
        least = node.layer;
        Ok(if node.layer > layer { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
    })?;
    Ok(excluded.is_none())
}

/// The number of zero bit planes of a code-block.
fn zero_planes(
    bits: &mut HeaderBits<'_>,
    nodes: &mut [Node],
    grid: &Grid,
    column: u32,
    row: u32,
) -> Result<u8, CodecError> {
    let mut least = 0u8;
    descend(nodes, grid, column, row, |node| {
        node.planes = node.planes.max(least);
        while !node.planes_known {
            if bits.bit()? == 1 {
                node.planes_known = true;
            } else {
                node.planes = node
                    .planes
                    .checked_add(1)
                    .ok_or_else(|| damaged("a code-block has impossible bit planes"))?;
            }
        }
        least = node.planes;
        Ok(ControlFlow::<()>::Continue(()))
    })?;
    Ok(least)
}

//! Bit-plane decoding of code-blocks (ISO/IEC 15444-1 Annex D), and their way into the tile.

use super::allowance::Allowance;
use super::geometry::Orientation;
use super::header::Coding;
use super::mq::{Contexts, Decoder, RUN_LENGTH, RawBits, UNIFORM};
use super::packets::{Block, Tile, segment_capacity, style};
use super::{ht, wavelet};
use crate::codec::CodecError;

/// Most samples of a code-block, by the standard.
const MAX_SAMPLES: usize = 4096;

/// Samples with a border of one all around; largest for the longest code-blocks (4 by 1024).
pub(super) const MAX_BORDERED: usize = (1024 + 2) * (4 + 2);

/// State of a sample: significance of its eight neighbours, signs of the four direct ones, its own flags.
pub(super) mod flag {
    pub(in super::super) const NORTH: u16 = 1;
    pub(in super::super) const SOUTH: u16 = 1 << 1;
    pub(in super::super) const WEST: u16 = 1 << 2;
    pub(in super::super) const EAST: u16 = 1 << 3;
    pub(in super::super) const NORTH_WEST: u16 = 1 << 4;
    pub(in super::super) const NORTH_EAST: u16 = 1 << 5;
    pub(in super::super) const SOUTH_WEST: u16 = 1 << 6;
    pub(in super::super) const SOUTH_EAST: u16 = 1 << 7;
    /// Any neighbour is significant.
    pub(in super::super) const AROUND: u16 = 0xFF;
    /// Signs of the four direct neighbours, in the order of their significance.
    pub(in super::super) const SIGNS: u32 = 8;
    pub(in super::super) const SIGNIFICANT: u16 = 1 << 12;
    /// Coded by the significance pass of this plane.
    pub(in super::super) const VISITED: u16 = 1 << 13;
    pub(in super::super) const REFINED: u16 = 1 << 14;
    pub(in super::super) const NEGATIVE: u16 = 1 << 15;
    /// Mask of the flags outside the next stripe.
    pub(in super::super) const CAUSAL: u16 = !(SOUTH | SOUTH_WEST | SOUTH_EAST | SOUTH << SIGNS);
}

/// Context of significance by neighbours (Table D.1), for the sub-bands low along rows, high along rows
/// only, and high in both directions.
const SIGNIFICANCE: [[u8; 256]; 3] = significance_table();

/// Context of a sign (Table D.3) by the direct neighbours' significance and signs; the top bit flips it.
const SIGN: [u8; 256] = sign_table();

const fn bit(flags: usize, mask: u16) -> u8 {
    if flags & mask as usize != 0 { 1 } else { 0 }
}

const fn significance_table() -> [[u8; 256]; 3] {
    let mut table = [[0; 256]; 3];
    let mut flags = 0;
    while flags < 256 {
        let across = bit(flags, flag::WEST) + bit(flags, flag::EAST);
        let down = bit(flags, flag::NORTH) + bit(flags, flag::SOUTH);
        let diagonal = bit(flags, flag::NORTH_WEST)
            + bit(flags, flag::NORTH_EAST)
            + bit(flags, flag::SOUTH_WEST)
            + bit(flags, flag::SOUTH_EAST);
        table[0][flags] = along(across, down, diagonal);
        table[1][flags] = along(down, across, diagonal);
        let direct = across + down;
        table[2][flags] = match (diagonal, direct) {
            (3.., _) => 8,
            (2, 1..) => 7,
            (2, 0) => 6,
            (1, 2..) => 5,
            (1, 1) => 4,
            (1, 0) => 3,
            (0, 2..) => 2,
            (0, 1) => 1,
            (0, 0) => 0,
        };
        flags += 1;
    }
    table
}

const fn along(first: u8, second: u8, diagonal: u8) -> u8 {
    match (first, second, diagonal) {
        (2.., _, _) => 8,
        (1, 1.., _) => 7,
        (1, 0, 1..) => 6,
        (1, 0, 0) => 5,
        (0, 2.., _) => 4,
        (0, 1, _) => 3,
        (0, 0, 2..) => 2,
        (0, 0, 1) => 1,
        (0, 0, 0) => 0,
    }
}

const fn sign_table() -> [u8; 256] {
    let mut table = [0; 256];
    let mut flags = 0;
    while flags < 256 {
        let across = contribution(flags, flag::WEST) + contribution(flags, flag::EAST);
        let down = contribution(flags, flag::NORTH) + contribution(flags, flag::SOUTH);
        // The table is symmetric: opposite contributions have the same context and a flipped sign.
        let flip = across < 0 || (across == 0 && down < 0);
        let down = if flip { -down } else { down };
        let context = match (across != 0, down) {
            (false, 0) => 9,
            (false, _) => 10,
            (true, ..0) => 11,
            (true, 0) => 12,
            (true, _) => 13,
        };
        table[flags] = context | if flip { 0x80 } else { 0 };
        flags += 1;
    }
    table
}

/// The contribution of a neighbour: nothing, one or minus one. Both neighbours of a direction may add up to two,
/// which counts as one.
const fn contribution(flags: usize, neighbour: u16) -> i8 {
    if flags & neighbour as usize == 0 {
        0
    } else if flags & ((neighbour as usize) << 4) == 0 {
        1
    } else {
        -1
    }
}

/// Room for one code-block.
pub(super) struct Scratch {
    flags: Vec<u16>,
    /// Twice the magnitude, plus one half step where lower bits are not decoded.
    values: Vec<u32>,
    /// The bytes of a segment that is in several pieces.
    bytes: Vec<u8>,
}

impl Scratch {
    pub(super) fn new(allowance: &mut Allowance) -> Result<Self, CodecError> {
        Ok(Self {
            flags: allowance.filled(MAX_BORDERED, 0)?,
            values: allowance.filled(MAX_SAMPLES, 0)?,
            bytes: Vec::new(),
        })
    }
}

/// Decodes all code-blocks of a component into its area, which begins at the first of `samples`, in rows
/// of `stride`: integers, or bit patterns of floats where the component is irreversible.
#[expect(clippy::too_many_arguments, reason = "each is a thing of its own, used once")]
pub(super) fn decode_component(
    codestream: &[u8],
    coding: &Coding,
    tile: &Tile,
    component: usize,
    samples: &mut [i32],
    stride: usize,
    scratch: &mut Scratch,
    allowance: &mut Allowance,
) -> Result<(), CodecError> {
    // Code-blocks that no packet holds are zero; 0.0 has the same bits.
    let (columns, rows) = (tile.layout.rect.width() as usize, tile.layout.rect.height() as usize);
    for row in samples.chunks_mut(stride).take(rows) {
        row[..columns].fill(0);
    }
    tile.coded_blocks(component, |block, orientation, planes, step| {
        let planes = planes.saturating_sub(block.zero_planes.into());
        decode_block(codestream, coding.style, tile, block, orientation, planes, scratch, allowance)?;
        let (width, height) = (usize::from(block.width), usize::from(block.height));
        let border = width + 2;
        for (y, values) in scratch.values[..width * height].chunks_exact(width).enumerate() {
            let start = (block.y as usize + y) * stride + block.x as usize;
            let flags = &scratch.flags[(y + 1) * border + 1..];
            for ((to, &value), flags) in samples[start..start + width].iter_mut().zip(values).zip(flags) {
                let mut value = value;
                // The region of interest lies above all other coefficients (Annex H).
                if coding.roi_shift > 0 && value.checked_shr(u32::from(coding.roi_shift) + 1).unwrap_or(0) > 0
                {
                    value >>= coding.roi_shift;
                }
                let negative = flags & flag::NEGATIVE != 0;
                *to = if coding.reversible {
                    let whole = (value >> 1).cast_signed();
                    if negative { -whole } else { whole }
                } else {
                    let size = value as f32 * 0.5 * step;
                    wavelet::pattern(if negative { -size } else { size })
                };
            }
        }
        Ok(())
    })
}

#[expect(clippy::too_many_arguments, reason = "each is a thing of its own, used once")]
fn decode_block(
    codestream: &[u8],
    style: u8,
    tile: &Tile,
    block: &Block,
    orientation: Orientation,
    planes: u32,
    scratch: &mut Scratch,
    allowance: &mut Allowance,
) -> Result<(), CodecError> {
    let Scratch { flags, values, bytes: joined } = scratch;
    let (width, height) = (usize::from(block.width), usize::from(block.height));
    let mut samples = Samples {
        flags: &mut flags[..(width + 2) * (height + 2)],
        values: &mut values[..width * height],
        width,
        height,
        significance: &SIGNIFICANCE[match orientation {
            Orientation::Ll | Orientation::Lh => 0,
            Orientation::Hl => 1,
            Orientation::Hh => 2,
        }],
        causal: style & style::CAUSAL != 0,
    };
    samples.flags.fill(0);
    samples.values.fill(0);

    let mut contexts = Contexts::new();
    let mut done = 0u8;
    let mut pieces = tile.pieces(block, codestream);
    while done < block.passes {
        // A segment ends with the piece that completes its passes, or with the last piece.
        let capacity = segment_capacity(style, done);
        let Some((mut segment, mut passes)) = pieces.next() else { break };
        if passes < capacity && done + passes < block.passes {
            joined.clear();
            append(joined, segment, allowance)?;
            while passes < capacity && done + passes < block.passes {
                let Some((more, with)) = pieces.next() else { break };
                append(joined, more, allowance)?;
                passes += with;
            }
            segment = joined;
        }
        if style & style::HIGH_THROUGHPUT != 0 {
            ht::decode_segment(segment, done, passes, planes, &mut samples)?;
        } else {
            decode_segment(segment, style, done, passes, planes, &mut contexts, &mut samples);
        }
        done += passes;
    }
    Ok(())
}

fn append(joined: &mut Vec<u8>, bytes: &[u8], allowance: &mut Allowance) -> Result<(), CodecError> {
    let short = (joined.len() + bytes.len()).saturating_sub(joined.capacity());
    if short > 0 {
        let (old, new) = (joined.capacity(), (joined.len() + bytes.len()).max(joined.capacity() * 2));
        allowance.reserve(new as u64)?;
        joined.reserve_exact(new - joined.len());
        allowance.release(old as u64);
    }
    joined.extend_from_slice(bytes);
    Ok(())
}

/// Decodes the passes of one segment; the first is pass `done` of the code-block.
fn decode_segment(
    segment: &[u8],
    style: u8,
    done: u8,
    passes: u8,
    planes: u32,
    contexts: &mut Contexts,
    samples: &mut Samples<'_>,
) {
    let raw = style & style::BYPASS != 0 && done >= 10 && (done - 10) % 3 != 2;
    let mut decoder = Decoder::new(if raw { &[] } else { segment });
    let mut bits = RawBits::new(segment);
    for pass in u32::from(done)..u32::from(done) + u32::from(passes) {
        // The first pass of a code-block is a cleanup pass.
        let Some(plane) = planes.checked_sub(1 + pass.div_ceil(3)) else { break };
        match (pass + 2) % 3 {
            0 if raw => samples.significance_pass(plane, &mut bits),
            0 => samples.significance_pass(plane, &mut Coded { decoder: &mut decoder, contexts }),
            1 if raw => samples.refinement_pass(plane, &mut bits),
            1 => samples.refinement_pass(plane, &mut Coded { decoder: &mut decoder, contexts }),
            _ => {
                samples.cleanup_pass(plane, &mut decoder, contexts);
                if style & style::SYMBOLS != 0 {
                    // 1010: a check symbol that helps to conceal errors.
                    for _ in 0..4 {
                        decoder.decide(contexts, UNIFORM);
                    }
                }
            }
        }
        if style & style::RESET != 0 {
            *contexts = Contexts::new();
        }
    }
}

/// Source of decisions: arithmetic coding, or raw bits.
trait Decisions {
    fn decide(&mut self, context: u8) -> bool;
    /// True for a negative sample. `context` is an entry of [`SIGN`].
    fn negative(&mut self, context: u8) -> bool;
}

struct Coded<'a, 'b> {
    decoder: &'a mut Decoder<'b>,
    contexts: &'a mut Contexts,
}

impl Decisions for Coded<'_, '_> {
    #[inline]
    fn decide(&mut self, context: u8) -> bool {
        self.decoder.decide(self.contexts, usize::from(context))
    }

    #[inline]
    fn negative(&mut self, context: u8) -> bool {
        self.decoder.decide(self.contexts, usize::from(context & 0x7F)) != (context & 0x80 != 0)
    }
}

impl Decisions for RawBits<'_> {
    fn decide(&mut self, _: u8) -> bool {
        self.bit()
    }

    fn negative(&mut self, _: u8) -> bool {
        self.bit()
    }
}

/// The samples of a code-block while it is decoded.
pub(super) struct Samples<'a> {
    /// Flags with a border of one sample all around.
    pub(super) flags: &'a mut [u16],
    pub(super) values: &'a mut [u32],
    pub(super) width: usize,
    pub(super) height: usize,
    significance: &'static [u8; 256],
    causal: bool,
}

impl Samples<'_> {
    /// Index of a sample in the flags.
    pub(super) fn place(&self, x: usize, y: usize) -> usize {
        (y + 1) * (self.width + 2) + x + 1
    }

    /// Flags of a sample as its contexts may see them.
    #[inline]
    pub(super) fn seen(&self, place: usize, y: usize) -> u16 {
        self.flags[place] & if self.causal && y & 3 == 3 { flag::CAUSAL } else { u16::MAX }
    }

    /// Makes a sample significant, and updates its neighbours.
    #[inline]
    pub(super) fn set_significant(&mut self, place: usize, negative: bool) {
        let border = self.width + 2;
        let sign = |direction: u16| direction | if negative { direction << flag::SIGNS } else { 0 };
        let flags = &mut *self.flags;
        flags[place] |= flag::SIGNIFICANT | if negative { flag::NEGATIVE } else { 0 };
        flags[place - 1] |= sign(flag::EAST);
        flags[place + 1] |= sign(flag::WEST);
        flags[place - border] |= sign(flag::SOUTH);
        flags[place + border] |= sign(flag::NORTH);
        flags[place - border - 1] |= flag::SOUTH_EAST;
        flags[place - border + 1] |= flag::SOUTH_WEST;
        flags[place + border - 1] |= flag::NORTH_EAST;
        flags[place + border + 1] |= flag::NORTH_WEST;
    }

    /// Calls `visit` with each sample in the order of a pass: stripes of four rows, column by column.
    #[inline]
    fn scan(&mut self, mut visit: impl FnMut(&mut Self, usize, usize, usize)) {
        for stripe in (0..self.height).step_by(4) {
            for x in 0..self.width {
                for y in stripe..self.height.min(stripe + 4) {
                    visit(self, x, y, self.place(x, y));
                }
            }
        }
    }

    #[inline]
    fn sign_context(seen: u16) -> u8 {
        SIGN[usize::from(seen & 15 | seen >> 4 & 0xF0)]
    }

    /// The significance propagation pass (D.3.1).
    fn significance_pass(&mut self, plane: u32, decisions: &mut impl Decisions) {
        self.scan(|samples, x, y, place| {
            let seen = samples.seen(place, y);
            if seen & flag::SIGNIFICANT != 0 || seen & flag::AROUND == 0 {
                return;
            }
            if decisions.decide(samples.significance[usize::from(seen & flag::AROUND)]) {
                let negative = decisions.negative(Self::sign_context(seen));
                samples.set_significant(place, negative);
                samples.values[y * samples.width + x] = 3 << plane;
            }
            samples.flags[place] |= flag::VISITED;
        });
    }

    /// The magnitude refinement pass (D.3.3).
    fn refinement_pass(&mut self, plane: u32, decisions: &mut impl Decisions) {
        self.scan(|samples, x, y, place| {
            let seen = samples.seen(place, y);
            if seen & (flag::SIGNIFICANT | flag::VISITED) != flag::SIGNIFICANT {
                return;
            }
            let context =
                if seen & flag::REFINED != 0 { 16 } else { 14 + u8::from(seen & flag::AROUND != 0) };
            let value = &mut samples.values[y * samples.width + x];
            // The bit for the middle of the interval becomes the decoded one, with a new middle below.
            if !decisions.decide(context) {
                *value ^= 2 << plane;
            }
            *value |= 1 << plane;
            samples.flags[place] |= flag::REFINED;
        });
    }

    /// The cleanup pass (D.3.4).
    fn cleanup_pass(&mut self, plane: u32, decoder: &mut Decoder<'_>, contexts: &mut Contexts) {
        for stripe in (0..self.height).step_by(4) {
            for x in 0..self.width {
                let end = self.height.min(stripe + 4);
                let mut y = stripe;
                let mut known = false;
                let quiet = |samples: &Self, y: usize| {
                    samples.seen(samples.place(x, y), y) & (flag::AROUND | flag::SIGNIFICANT | flag::VISITED)
                        == 0
                };
                if end == stripe + 4 && (stripe..end).all(|y| quiet(self, y)) {
                    if !decoder.decide(contexts, RUN_LENGTH) {
                        continue;
                    }
                    y += usize::from(decoder.decide(contexts, UNIFORM)) << 1;
                    y += usize::from(decoder.decide(contexts, UNIFORM));
                    known = true;
                }
                while y < end {
                    let place = self.place(x, y);
                    let seen = self.seen(place, y);
                    if seen & (flag::SIGNIFICANT | flag::VISITED) == 0 {
                        let context = self.significance[usize::from(seen & flag::AROUND)];
                        if known || decoder.decide(contexts, usize::from(context)) {
                            let negative = Coded { decoder, contexts }.negative(Self::sign_context(seen));
                            self.set_significant(place, negative);
                            self.values[y * self.width + x] = 3 << plane;
                        }
                    }
                    known = false;
                    self.flags[place] &= !flag::VISITED;
                    y += 1;
                }
            }
        }
    }
}

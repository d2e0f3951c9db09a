//! A plain JPEG encoder for the tests: lossless images of samples, DCT images of given coefficients.

use super::dct::{Block, ZIGZAG};
use crate::random::Random;

/// Code lengths that the tests go through: `counts[n]` codes of n + 1 bits for 17 symbols at least.
pub(super) const FLAT: [u8; 16] = [0, 0, 0, 0, 0, 0, 0, 255, 1, 0, 0, 0, 0, 0, 0, 0];
/// 17 codes of up to 16 bits.
pub(super) const STEEP: [u8; 16] = [1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 3, 1];

/// Bytes of a codestream, with the bits of the scan that is being written.
#[derive(Default)]
pub(super) struct Writer {
    pub(super) bytes: Vec<u8>,
    pending: u64,
    count: u32,
}

fn low_byte(value: u32) -> u8 {
    value.to_le_bytes()[0]
}

impl Writer {
    pub(super) fn new() -> Self {
        Self { bytes: vec![0xFF, 0xD8], ..Self::default() }
    }

    pub(super) fn segment(&mut self, marker: u8, contents: &[u8]) {
        self.bytes.extend([0xFF, marker]);
        self.bytes.extend(u16::try_from(contents.len() + 2).unwrap().to_be_bytes());
        self.bytes.extend(contents);
    }

    /// DHT for both classes of slot 0 with the symbols 0, 1, 2 ...
    pub(super) fn tables(&mut self, counts: &[u8; 16]) {
        let total: u32 = counts.iter().map(|&c| u32::from(c)).sum();
        for class in [0, 0x10] {
            let mut contents = vec![class];
            contents.extend(counts);
            contents.extend((0..total).map(low_byte));
            self.segment(0xC4, &contents);
        }
    }

    pub(super) fn frame(&mut self, sof: u8, precision: u8, size: (u16, u16), factors: &[(u8, u8)]) {
        let mut contents = vec![precision];
        contents.extend(size.1.to_be_bytes());
        contents.extend(size.0.to_be_bytes());
        contents.push(u8::try_from(factors.len()).unwrap());
        for (id, (h, v)) in (10..).zip(factors) {
            contents.extend([id, h << 4 | v, 0]);
        }
        self.segment(sof, &contents);
    }

    pub(super) fn scan(&mut self, components: &[u8], start: u8, end: u8, high: u8, low: u8) {
        let mut contents = vec![u8::try_from(components.len()).unwrap()];
        contents.extend(components.iter().flat_map(|c| [c + 10, 0]));
        contents.extend([start, end, high << 4 | low]);
        self.segment(0xDA, &contents);
    }

    pub(super) fn bits(&mut self, value: u32, count: u32) {
        for i in (0..count).rev() {
            self.pending = self.pending << 1 | u64::from(value >> i & 1);
            self.count += 1;
            if self.count == 8 {
                let byte = self.pending.to_le_bytes()[0];
                self.bytes.push(byte);
                if byte == 0xFF {
                    self.bytes.push(0);
                }
                (self.pending, self.count) = (0, 0);
            }
        }
    }

    /// Fills the last byte of the data with ones.
    pub(super) fn pad(&mut self) {
        while self.count > 0 {
            self.bits(1, 1);
        }
    }

    pub(super) fn restart(&mut self, number: u32) {
        self.pad();
        self.bytes.extend([0xFF, 0xD0 + low_byte(number % 8)]);
    }

    pub(super) fn end(mut self) -> Vec<u8> {
        self.pad();
        self.bytes.extend([0xFF, 0xD9]);
        self.bytes
    }

    /// The code of a symbol in a table made by [`Writer::tables`].
    pub(super) fn symbol(&mut self, counts: &[u8; 16], symbol: u32) {
        let (mut code, mut first) = (0, 0);
        for (length, &count) in (1..).zip(counts) {
            let count = u32::from(count);
            if symbol < first + count {
                return self.bits(code + symbol - first, length);
            }
            (code, first) = ((code + count) << 1, first + count);
        }
        panic!("no code for {symbol}");
    }

    /// The size of a difference, as a symbol below `zeros` zeros, and its bits.
    pub(super) fn signed(&mut self, counts: &[u8; 16], zeros: u32, value: i32) {
        let size = 32 - value.unsigned_abs().leading_zeros();
        self.symbol(counts, zeros << 4 | size);
        let bits = if value < 0 { value - 1 } else { value };
        self.bits(bits.cast_unsigned() & ((1 << size) - 1), size);
    }
}

/// A lossless image.
pub(super) struct Lossless<'a> {
    pub(super) samples: &'a [u16],
    pub(super) columns: usize,
    pub(super) components: usize,
    pub(super) precision: u8,
    pub(super) predictor: u8,
    pub(super) point_transform: u8,
    /// Lines between restarts, or 0.
    pub(super) restart_lines: usize,
    pub(super) counts: [u8; 16],
}

impl Lossless<'_> {
    pub(super) fn header(&self) -> Writer {
        let rows = self.samples.len() / self.columns / self.components;
        let mut out = Writer::new();
        out.segment(0xFE, b"a comment");
        let size = (u16::try_from(self.columns).unwrap(), u16::try_from(rows).unwrap());
        out.frame(0xC3, self.precision, size, &vec![(1, 1); self.components]);
        out.tables(&self.counts);
        if self.restart_lines > 0 {
            let interval = u16::try_from(self.restart_lines * self.columns).unwrap();
            out.segment(0xDD, &interval.to_be_bytes());
        }
        out
    }

    /// One scan of the given components.
    pub(super) fn scan(&self, out: &mut Writer, components: &[u8]) {
        let stride = self.columns * self.components;
        out.scan(components, self.predictor, 0, 0, self.point_transform);
        for (y, line) in self.samples.chunks(stride).enumerate() {
            let restart = self.restart_lines > 0 && y % self.restart_lines == 0 && y > 0;
            if restart {
                out.restart(u32::try_from(y / self.restart_lines - 1).unwrap());
            }
            let first = restart || y == 0;
            for x in 0..self.columns {
                for &component in components {
                    let at = |x: usize, y: usize| {
                        let place = y * stride + x * self.components + usize::from(component);
                        i32::from(self.samples[place] >> self.point_transform)
                    };
                    let predicted = match (x, first, self.predictor) {
                        (0, true, _) => 1 << (self.precision - self.point_transform - 1),
                        (0, false, _) => at(0, y - 1),
                        (_, true, _) | (_, _, 1) => at(x - 1, y),
                        (_, _, 2) => at(x, y - 1),
                        (_, _, 3) => at(x - 1, y - 1),
                        (_, _, 4) => at(x - 1, y) + at(x, y - 1) - at(x - 1, y - 1),
                        (_, _, 5) => at(x - 1, y) + ((at(x, y - 1) - at(x - 1, y - 1)) >> 1),
                        (_, _, 6) => at(x, y - 1) + ((at(x - 1, y) - at(x - 1, y - 1)) >> 1),
                        _ => (at(x - 1, y) + at(x, y - 1)) >> 1,
                    };
                    let value = i32::from(line[x * self.components + usize::from(component)]);
                    let difference = ((value >> self.point_transform) - predicted).rem_euclid(1 << 16);
                    if difference == 1 << 15 {
                        out.symbol(&self.counts, 16);
                    } else if difference > 1 << 15 {
                        out.signed(&self.counts, 0, difference - (1 << 16));
                    } else {
                        out.signed(&self.counts, 0, difference);
                    }
                }
            }
        }
        out.pad();
    }

    /// The whole image in one interleaved scan.
    pub(super) fn encode(&self) -> Vec<u8> {
        let mut out = self.header();
        let all: Vec<u8> = (0..u8::try_from(self.components).unwrap()).collect();
        self.scan(&mut out, &all);
        out.end()
    }
}

/// Coefficients of one component, in rows of blocks that fill whole MCUs.
pub(super) struct Plane {
    pub(super) h: usize,
    pub(super) v: usize,
    pub(super) stride: usize,
    pub(super) blocks: Vec<Block>,
    /// Blocks across and down that a scan of this component alone holds.
    pub(super) alone: (usize, usize),
}

/// A DCT image of given coefficients.
pub(super) struct Dct {
    pub(super) precision: u8,
    pub(super) size: (usize, usize),
    pub(super) planes: Vec<Plane>,
    /// MCUs between restarts, or 0.
    pub(super) restart: usize,
}

impl Dct {
    /// Random coefficients: many zeros, some large values.
    pub(super) fn random(seed: u64, precision: u8, size: (usize, usize), factors: &[(usize, usize)]) -> Self {
        let mut random = Random(seed);
        let h_max = factors.iter().map(|f| f.0).max().unwrap();
        let v_max = factors.iter().map(|f| f.1).max().unwrap();
        let (across, down) = (size.0.div_ceil(8 * h_max), size.1.div_ceil(8 * v_max));
        let plane = |&(h, v): &(usize, usize)| {
            let blocks = (0..across * down * h * v).map(|_| {
                let mut block = [0; 64];
                let range = 1_i32 << precision;
                let mut value = |range: i32| {
                    let v = i32::try_from(random.below(range.cast_unsigned() * 2 + 1)).unwrap() - range;
                    i16::try_from(v).unwrap()
                };
                block[0] = value(range);
                if value(2) != 0 {
                    for _ in 0..value(12).abs() {
                        let at = usize::try_from(value(63).abs()).unwrap();
                        block[at] = if value(1) == 0 { value(3) } else { value(range / 8) };
                    }
                }
                block
            });
            let alone_x = (size.0 * h).div_ceil(h_max).div_ceil(8);
            let alone_y = (size.1 * v).div_ceil(v_max).div_ceil(8);
            Plane { h, v, stride: across * h, blocks: blocks.collect(), alone: (alone_x, alone_y) }
        };
        Self { precision, size, planes: factors.iter().map(plane).collect(), restart: 0 }
    }

    /// Everything before the first scan; all steps of quantisation are 2.
    pub(super) fn header(&self, sof: u8) -> Writer {
        let mut out = Writer::new();
        out.segment(0xE0, b"JFIF");
        let mut steps = vec![0];
        steps.extend([2; 64]);
        out.segment(0xDB, &steps);
        let factors: Vec<(u8, u8)> =
            self.planes.iter().map(|p| (u8::try_from(p.h).unwrap(), u8::try_from(p.v).unwrap())).collect();
        let size = (u16::try_from(self.size.0).unwrap(), u16::try_from(self.size.1).unwrap());
        out.frame(sof, self.precision, size, &factors);
        out.tables(&FLAT);
        if self.restart > 0 {
            out.segment(0xDD, &u16::try_from(self.restart).unwrap().to_be_bytes());
        }
        out
    }

    /// The blocks of a scan, in order: unit, place of the component in the scan, block.
    fn blocks(&self, components: &[u8]) -> Vec<(usize, usize, &Block)> {
        let mut found = Vec::new();
        if let [only] = components {
            let plane = &self.planes[usize::from(*only)];
            for y in 0..plane.alone.1 {
                for x in 0..plane.alone.0 {
                    found.push((found.len(), 0, &plane.blocks[y * plane.stride + x]));
                }
            }
            return found;
        }
        let first = &self.planes[usize::from(components[0])];
        let across = first.stride / first.h;
        for unit in 0..first.blocks.len() / first.h / first.v {
            for (slot, &component) in components.iter().enumerate() {
                let plane = &self.planes[usize::from(component)];
                for y in unit / across * plane.v..(unit / across + 1) * plane.v {
                    for x in unit % across * plane.h..(unit % across + 1) * plane.h {
                        found.push((unit, slot, &plane.blocks[y * plane.stride + x]));
                    }
                }
            }
        }
        found
    }

    /// One scan; sequential if the band is the whole block.
    pub(super) fn scan(&self, out: &mut Writer, components: &[u8], band: (u8, u8), high: u8, low: u8) {
        out.scan(components, band.0, band.1, high, low);
        let mut predicted = [0; 4];
        let mut run = EndedBlocks::default();
        let mut last = 0;
        for (unit, slot, block) in self.blocks(components) {
            if self.restart > 0 && unit % self.restart == 0 && unit != last {
                run.flush(out);
                out.restart(u32::try_from(unit / self.restart - 1).unwrap());
                predicted = [0; 4];
            }
            last = unit;
            let zigzag: [i32; 64] = std::array::from_fn(|k| i32::from(block[usize::from(ZIGZAG[k])]));
            if band.0 == 0 {
                let dc = zigzag[0] >> low;
                if high == 0 {
                    out.signed(&FLAT, 0, dc - predicted[slot]);
                    predicted[slot] = dc;
                } else {
                    out.bits(dc.cast_unsigned() & 1, 1);
                }
            }
            let (start, end) = (usize::from(band.0.max(1)), usize::from(band.1));
            match high {
                _ if end == 0 => {}
                0 => run.first(out, &zigzag, start..=end, low, band.0 > 0),
                _ => run.refine(out, &zigzag, start..=end, low),
            }
        }
        run.flush(out);
        out.pad();
    }
}

/// Blocks whose end is not written yet, with the bits that follow it.
#[derive(Default)]
struct EndedBlocks {
    count: u32,
    bits: Vec<u32>,
}

impl EndedBlocks {
    fn flush(&mut self, out: &mut Writer) {
        if self.count > 0 {
            let class = self.count.ilog2();
            out.symbol(&FLAT, class << 4);
            out.bits(self.count - (1 << class), class);
            self.bits.drain(..).for_each(|bit| out.bits(bit, 1));
            self.count = 0;
        }
    }

    fn first(
        &mut self,
        out: &mut Writer,
        zigzag: &[i32; 64],
        band: std::ops::RangeInclusive<usize>,
        low: u8,
        runs: bool,
    ) {
        let mut zeros = 0;
        for &value in &zigzag[band] {
            let value = value.signum() * (value.abs() >> low);
            if value == 0 {
                zeros += 1;
                continue;
            }
            self.flush(out);
            while zeros > 15 {
                out.symbol(&FLAT, 0xF0);
                zeros -= 16;
            }
            out.signed(&FLAT, zeros, value);
            zeros = 0;
        }
        if zeros > 0 {
            self.count += 1;
            if !runs || self.count == 0x7FFF {
                self.flush(out);
            }
        }
    }

    fn refine(
        &mut self,
        out: &mut Writer,
        zigzag: &[i32; 64],
        band: std::ops::RangeInclusive<usize>,
        low: u8,
    ) {
        let amount = |k: usize| zigzag[k].unsigned_abs() >> low;
        let last_fresh = band.clone().rev().find(|&k| amount(k) == 1).unwrap_or(0);
        let (mut zeros, mut bits) = (0, Vec::new());
        for k in band {
            if amount(k) == 0 {
                zeros += 1;
                continue;
            }
            while zeros > 15 && k <= last_fresh {
                self.flush(out);
                out.symbol(&FLAT, 0xF0);
                bits.drain(..).for_each(|bit| out.bits(bit, 1));
                zeros -= 16;
            }
            if amount(k) > 1 {
                bits.push(amount(k) & 1);
                continue;
            }
            self.flush(out);
            out.symbol(&FLAT, zeros << 4 | 1);
            out.bits(u32::from(zigzag[k] > 0), 1);
            bits.drain(..).for_each(|bit| out.bits(bit, 1));
            zeros = 0;
        }
        if zeros > 0 || !bits.is_empty() {
            self.count += 1;
            self.bits.extend(bits);
        }
    }
}

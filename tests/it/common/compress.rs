//! Compressed bytes for tests, by the libraries' own encoders.
#![allow(dead_code, reason = "each test file uses its own part")]

use std::io::Write as _;

pub(crate) fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

pub(crate) fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

pub(crate) fn bzip2(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// A chunk as C-Blosc 1 packs it: blocks of 1024 bytes, shuffled by bytes or bits, whole or in a part for each byte.
pub(crate) fn blosc(plain: &[u8], size: usize, bits: bool, split: bool) -> Vec<u8> {
    const BLOCK: usize = 1024;
    let flags = (if bits { 4 } else { 1 }) | (if split { 0 } else { 16 }) | 1 << 5;
    let number = |n: usize| u32::try_from(n).unwrap().to_le_bytes();
    let (mut starts, mut body) = (Vec::new(), Vec::new());
    let table = 16 + 4 * plain.len().div_ceil(BLOCK);
    for block in plain.chunks(BLOCK) {
        starts.extend(number(table + body.len()));
        let count = block.len() / size;
        let mut shuffled = vec![0; block.len()];
        for (at, sample) in block.chunks(size).enumerate() {
            for (byte, value) in sample.iter().enumerate() {
                if bits {
                    for bit in 0..8 {
                        shuffled[(byte * 8 + bit) * count / 8 + at / 8] |= (value >> bit & 1) << (at % 8);
                    }
                } else {
                    shuffled[byte * count + at] = *value;
                }
            }
        }
        let parts = if split && block.len() == BLOCK { size } else { 1 };
        for part in shuffled.chunks(block.len() / parts) {
            let packed = lz4_flex::block::compress(part);
            let packed = if packed.len() < part.len() { &packed } else { part };
            body.extend(number(packed.len()));
            body.extend_from_slice(packed);
        }
    }
    let head = [2, 1, flags, u8::try_from(size).unwrap()];
    let lengths = [number(plain.len()), number(BLOCK), number(table + body.len())].concat();
    [&head[..], &lengths, &starts, &body].concat()
}

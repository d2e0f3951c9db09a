//! Codestreams whose files scripts/make_jpeg2000_fixtures.py writes, and plain ones made here.

/// 9 by 7, signed 12 bits: tiles, offsets, two layers, all code-block styles.
pub(super) const EVERYTHING: &[u8] = include_bytes!("vectors/everything.j2c");

/// 9 by 9, three components, 9/7.
pub(super) const IRREVERSIBLE: &[u8] = include_bytes!("vectors/irreversible.j2c");

/// 9 by 7, 16 bits.
pub(super) const HIGH_THROUGHPUT: &[u8] = include_bytes!("vectors/high-throughput.j2c");

/// 11 by 9, 8 bits: a high-throughput code-block of three passes.
pub(super) const THREE_PASSES: &[u8] = include_bytes!("vectors/three-passes.j2c");

/// What OpenJPEG decodes from it.
pub(super) const THREE_PASSES_SAMPLES: &[u8; 99] = include_bytes!("vectors/three-passes.samples");

/// A codestream of one component without decomposition, of 8 bits, in code-blocks of four by four.
pub(super) fn plain_stream(side: u32, tile: u32, layers: u16, parts: &[(u16, Vec<u8>)]) -> Vec<u8> {
    let mut stream = vec![0xFF, 0x4F, 0xFF, 0x51, 0, 41, 0, 0];
    for value in [side, side, 0, 0, tile, tile, 0, 0] {
        stream.extend(value.to_be_bytes());
    }
    stream.extend([0, 1, 7, 1, 1, 0xFF, 0x52, 0, 12, 0, 0]);
    stream.extend(layers.to_be_bytes());
    stream.extend([0, 0, 0, 0, 0, 1, 0xFF, 0x5C, 0, 4, 0x40, 0x40]);
    for (tile, body) in parts {
        stream.extend([0xFF, 0x90, 0, 10]);
        stream.extend(tile.to_be_bytes());
        stream.extend(u32::try_from(body.len() + 14).unwrap().to_be_bytes());
        stream.extend([0, 1, 0xFF, 0x93]);
        stream.extend(body);
    }
    stream.extend([0xFF, 0xD9]);
    stream
}

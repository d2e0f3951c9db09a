//! Any array of small items: differences, byte planes, zstd (SPEC 5.3).

use std::io;

use super::CodingError;

/// Content bytes of a block, rounded down to whole items.
pub(crate) const BLOCK_BYTES: usize = 1 << 16;
/// Longest stored block that is accepted: zstd adds a few bytes to content that it cannot shrink.
pub(crate) const STORED_LIMIT: u32 = 1 << 17;
/// Compression level: the highest whose state stays near one MiB for such blocks. `scripts/wheel.sh` leaves out the
/// compressors of other levels.
const LEVEL: i32 = 9;

/// Content bytes of a full block with items of `item` bytes.
pub(crate) fn block_bytes(item: u8) -> usize {
    BLOCK_BYTES / usize::from(item.max(1)) * usize::from(item.max(1))
}

/// Compresses one block.
///
/// # Errors
/// The compressor failed (out of memory).
pub(crate) fn encode(content: &[u8], item: u8) -> io::Result<Vec<u8>> {
    let item = usize::from(item.max(1));
    let mut planes = Vec::with_capacity(content.len());
    for plane in 0..item {
        let mut before = 0_u8;
        for byte in content.iter().skip(plane).step_by(item) {
            planes.push(byte.wrapping_sub(before));
            before = *byte;
        }
    }
    zstd::bulk::compress(&planes, LEVEL)
}

/// Decompresses one block of `len` content bytes, which the caller has bounded.
///
/// # Errors
/// The bytes are not such a block.
pub(crate) fn decode(stored: &[u8], item: u8, len: usize) -> Result<Vec<u8>, CodingError> {
    let item = usize::from(item.max(1));
    let planes = zstd::bulk::decompress(stored, len)
        .ok()
        .filter(|p| p.len() == len && len.is_multiple_of(item))
        .ok_or(CodingError("a packed block cannot be decoded (SPEC 5.3)"))?;
    let mut content = vec![0; len];
    for (plane, bytes) in planes.chunks_exact((len / item).max(1)).enumerate() {
        let mut before = 0_u8;
        for (slot, difference) in content.iter_mut().skip(plane).step_by(item).zip(bytes) {
            before = before.wrapping_add(*difference);
            *slot = before;
        }
    }
    Ok(content)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_come_back_and_wrong_ones_are_errors() {
        for item in 1..=3_u8 {
            let content: Vec<u8> = (0..3000_u32).map(|i| (i * i / 700).to_le_bytes()[0]).collect();
            let stored = encode(&content, item).unwrap();
            assert_eq!(decode(&stored, item, content.len()).unwrap(), content);
            assert!(decode(&stored, item, content.len() - usize::from(item)).is_err());
            assert!(decode(&stored, item, content.len() + usize::from(item)).is_err());
            assert!(decode(&stored[..stored.len() - 1], item, content.len()).is_err());
        }
        assert!(decode(&[], 1, 10).is_err());
    }
}

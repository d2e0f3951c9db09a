//! An encoder of RLE frames, for the decoder's unit tests.
#![expect(clippy::cast_possible_truncation, reason = "bytes and sizes of small test images")]

use super::{HEADER_BYTES, RleFormat};
use crate::random::Random;

/// Packs a plane: runs of at least two, literals, and now and then a byte that means nothing.
fn packed(plane: &[u8], random: &mut Random) -> Vec<u8> {
    let mut out = Vec::new();
    let mut at = 0;
    while at < plane.len() {
        if random.below(16) == 0 {
            out.push(128);
        }
        let run = plane[at..].iter().take(128).take_while(|&&byte| byte == plane[at]).count();
        if run > 1 {
            out.extend([(257 - run) as u8, plane[at]]);
            at += run;
        } else {
            let most = 1 + random.below(128_usize);
            let pairs = plane[at..].windows(2).position(|pair| pair[0] == pair[1]);
            let count = pairs.unwrap_or(plane.len() - at).clamp(1, most);
            out.push(count as u8 - 1);
            out.extend(&plane[at..at + count]);
            at += count;
        }
    }
    out
}

/// Encodes samples, components side by side; segments are padded to an even length.
pub(super) fn encode(format: &RleFormat, samples: &[u32], random: &mut Random) -> Vec<u8> {
    let (components, bytes) = (usize::from(format.components), u32::from(format.bytes_per_sample));
    let mut out = vec![0; HEADER_BYTES];
    out[0] = format.components * format.bytes_per_sample;
    let mut word = 4;
    for component in 0..components {
        for byte in (0..bytes).rev() {
            let plane: Vec<u8> =
                samples.iter().skip(component).step_by(components).map(|s| (s >> (8 * byte)) as u8).collect();
            let start = (out.len() as u32).to_le_bytes();
            out[word..word + 4].copy_from_slice(&start);
            word += 4;
            out.extend(packed(&plane, random));
            out.extend(vec![0; out.len() % 2]);
        }
    }
    out
}

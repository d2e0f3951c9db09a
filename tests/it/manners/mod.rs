//! What the command is like to live with: pictures that do not mislead, reports that other programs can rely on,
//! standard input and output, names, completions, and sentences that help. If this fails, a user is misled or a
//! script breaks, though every model is right.
//!
//! | file | promise |
//! |---|---|
//! | `pictures` | thin sheets and single slices are lit by the side that is seen; a long picture fails early |
//! | `measures` | area, volume and extent in `info`, with their errors |
//! | `json` | every key of every report is described; errors are objects, too |
//! | `dashes` | `-` is standard input or output, or refused; names that say otherwise are refused |
//! | `folders` | what `scan` says, `batch` does; its options; what it tells |
//! | `manual` | completions, manual pages, examples |
//! | `newcomers` | what users stumbled over on their first day |
//! | `sentences` | messages that once did not help |

use crate::prelude::*;

mod dashes;
mod folders;
mod json;
mod manual;
mod measures;
mod newcomers;
mod pictures;
mod sentences;

/// Writes a raw volume of unsigned 16-bit samples.
fn raw(path: &Path, dims: [u32; 3], value: impl Fn([u32; 3]) -> u16) {
    write_raw(path, dims, |at| value(at).to_le_bytes());
}

/// Builds a raw volume into `NAME.oct` in a folder.
fn built(
    folder: &Path,
    name: &str,
    dims: [u32; 3],
    extra: &[&str],
    value: impl Fn([u32; 3]) -> u16,
) -> PathBuf {
    let (source, model) = (folder.join(format!("{name}.raw")), folder.join(format!("{name}.oct")));
    raw(&source, dims, value);
    let size = dims.map(|n| n.to_string()).join("x");
    let args =
        ["build", &text(&source), "-o", &text(&model), "--dims", &size, "--dtype", "u16", "--iso", "500"];
    let run = oct(&[&args, extra].concat());
    assert_eq!(run.code, 0, "{run:?}");
    model
}

/// A ball in the middle of a volume of this side.
fn ball(side: u32, radius: f64) -> impl Fn([u32; 3]) -> u16 {
    move |p| {
        let middle = f64::from(side) / 2.0 - 0.5;
        let squares: f64 = p.iter().map(|c| (f64::from(*c) - middle) * (f64::from(*c) - middle)).sum();
        // Soft over a voxel, as a scanner's.
        let depth = (radius - squares.sqrt() + 0.5).clamp(0.0, 1.0);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 1000")]
        let value = (depth * 1000.0) as u16;
        value
    }
}

/// Noise of a few per cent that depends on the voxel alone.
fn noise([x, y, z]: [u32; 3]) -> u16 {
    let mut bits = x ^ y << 8 ^ z << 16;
    for _ in 0..3 {
        bits = (bits ^ bits >> 15).wrapping_mul(0x2c1b_3c6d);
    }
    u16::try_from(bits >> 26).unwrap()
}

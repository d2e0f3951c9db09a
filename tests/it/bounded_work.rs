//! Files that hold next to nothing in very many parts cost no more than their bytes do. If this fails, ten megabytes
//! keep a converter busy for as long as whoever sent them likes.

use crate::common::compress;
use crate::prelude::*;

use compress::gzip;

/// Seconds of the processor, whatever else the machine does: far more than it takes, and less than it took.
const ENOUGH: f64 = 0.8;

/// Runs the command; the seconds of the processor that it took, as the shell counts those of its children.
fn timed(args: &[&str]) -> (Run, f64) {
    let mut run = shell("\"$OCT\" \"$@\"; code=$?; times; exit $code", args);
    let at = run.stdout.trim_end().rfind('\n').map_or(0, |at| at + 1);
    let times = run.stdout.split_off(at);
    let seconds = |text: &str| -> f64 {
        let (minutes, rest) = text.split_once('m').unwrap();
        60.0 * minutes.parse::<f64>().unwrap() + rest.trim_end_matches('s').parse::<f64>().unwrap()
    };
    let took = times.split_whitespace().map(seconds).sum();
    (run, took)
}

#[test]
fn empty_members_of_gzip_are_bounded() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.nrrd");
    let head = b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 8 8 8\nencoding: gzip\n\n";
    let samples: Vec<u8> = (0..512).map(|i| if i % 5 == 0 { 200 } else { 1 }).collect();
    let (input, output) = (text(&path), text(&folder.path().join("m.oct")));
    let args = ["build", &input, "-o", &output, "--iso", "100"];
    let build = |stream: Vec<u8>| {
        fs::write(&path, [&head[..], &stream].concat()).unwrap();
        timed(&args)
    };
    let (run, _) = build([gzip(&samples[..100]), gzip(b"").repeat(1000), gzip(&samples[100..])].concat());
    assert_eq!(run.code, 0, "{run:?}");
    let (run, took) = build([gzip(b"").repeat(500_000), gzip(&samples)].concat());
    assert_eq!(run.code, 3, "{run:?}");
    assert!(run.stderr.contains("hold nothing"), "{run:?}");
    assert!(took < ENOUGH, "{took:?}");
}

#[test]
fn empty_fragments_of_dicom_are_bounded() {
    let folder = tempfile::tempdir().unwrap();
    // RLE of 2 x 2 pixels of 16 bits in two segments, each of one run.
    let mut frame = vec![0; 64];
    frame[0] = 2;
    frame[4] = 64;
    frame[8] = 66;
    frame.extend([0xfd, 3, 0xfd, 7]);
    let image = Elements::ct(0.0, 1, [0; 4]);
    let whole = image.encapsulated("1.2.840.10008.1.2.5", &[frame.clone()]);
    let path = folder.path().join("a.dcm");
    let (input, output) = (text(&path), text(&folder.path().join("m.oct")));
    let args = ["build", &input, "-o", &output, "--iso", "-1020"];
    fs::write(&path, &whole).unwrap();
    assert_eq!(timed(&args).0.code, 0);
    // Two million items of no bytes before the delimiter, which closes the file.
    let items = [0xfe, 0xff, 0x00, 0xe0, 0, 0, 0, 0].repeat(2_000_000);
    let (head, end) = whole.split_at(whole.len() - 8);
    for (bytes, closed) in [([head, &items, end].concat(), true), ([head, &items].concat(), false)] {
        fs::write(&path, bytes).unwrap();
        let (run, took) = timed(&args);
        assert!([0, 3].contains(&run.code), "{run:?}");
        assert!(took < ENOUGH, "closed {closed}: {took:?}");
    }
}

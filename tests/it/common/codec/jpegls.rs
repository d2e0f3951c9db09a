//! A JPEG-LS encoder for tests: T.87 annex A followed step by step, without a thought for speed.
//!
//! It shares with the decoder only the coding parameters and the table of run lengths, both checked against
//! the standard's own example.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "samples and sizes of small test images"
)]

use super::parameters::{Parameters, Preset};
use super::scan::RUN_ORDERS;

/// What to encode, and how.
#[derive(Clone, Debug)]
pub(super) struct Options {
    pub(super) columns: usize,
    pub(super) rows: usize,
    pub(super) components: usize,
    pub(super) precision: u8,
    pub(super) near: u8,
    /// All components in one scan, line by line, instead of a scan for each.
    pub(super) by_line: bool,
    pub(super) preset: Option<Preset>,
    /// Lines between restart markers, or 0.
    pub(super) restart_lines: u32,
    /// State the size in a segment of its own.
    pub(super) oversize: bool,
}

impl Options {
    pub(super) fn new(columns: usize, rows: usize, precision: u8, near: u8) -> Options {
        Options {
            columns,
            rows,
            components: 1,
            precision,
            near,
            by_line: false,
            preset: None,
            restart_lines: 0,
            oversize: false,
        }
    }
}

/// Coded bits, with the zero bit after each 0xFF.
#[derive(Default)]
struct Bits {
    bytes: Vec<u8>,
    current: u8,
    free: u32,
}

impl Bits {
    fn new() -> Bits {
        Bits { bytes: Vec::new(), current: 0, free: 8 }
    }

    fn bit(&mut self, bit: bool) {
        self.free -= 1;
        self.current |= u8::from(bit) << self.free;
        if self.free == 0 {
            self.bytes.push(self.current);
            self.free = if self.current == 0xFF { 7 } else { 8 };
            self.current = 0;
        }
    }

    fn bits(&mut self, value: u32, count: u32) {
        for place in (0..count).rev() {
            self.bit(value >> place & 1 == 1);
        }
    }

    fn golomb(&mut self, value: u32, k: u32, limit: u32, error_bits: u32) {
        let zeros = value >> k;
        if zeros < limit - error_bits - 1 {
            (0..zeros).for_each(|_| self.bit(false));
            self.bit(true);
            self.bits(value, k);
        } else {
            (0..limit - error_bits - 1).for_each(|_| self.bit(false));
            self.bit(true);
            self.bits(value - 1, error_bits);
        }
    }

    /// The last byte filled up with zeros; after 0xFF there is always one more byte.
    fn end(&mut self) {
        let whole = if self.bytes.last() == Some(&0xFF) { 7 } else { 8 };
        if self.free < whole || whole == 7 {
            self.bytes.push(self.current);
        }
    }
}

/// Encodes an image given as planes, and gives what a decoder must make of it with the codestream.
pub(super) fn encode(options: &Options, planes: &[Vec<u16>]) -> (Vec<u8>, Vec<Vec<u16>>) {
    assert_eq!(planes.len(), options.components);
    let word = |value: usize| u16::try_from(value).unwrap().to_be_bytes();
    let mut out = vec![0xFF, 0xD8, 0xFF, 0xF7];
    let (rows, columns) = if options.oversize { (0, 0) } else { (options.rows, options.columns) };
    out.extend(word(8 + 3 * options.components));
    out.push(options.precision);
    out.extend(word(rows));
    out.extend(word(columns));
    out.push(options.components as u8);
    for component in 1..=options.components {
        out.extend([component as u8, 0x11, 0]);
    }
    if options.oversize {
        out.extend([0xFF, 0xF8, 0, 12, 4, 4]);
        out.extend((options.rows as u32).to_be_bytes());
        out.extend((options.columns as u32).to_be_bytes());
    }
    if let Some(Preset { maximum, thresholds: [t1, t2, t3], reset }) = options.preset {
        out.extend([0xFF, 0xF8, 0, 13, 1]);
        for value in [maximum, t1, t2, t3, reset] {
            out.extend(word(value as usize));
        }
    }
    if options.restart_lines > 0 {
        out.extend([0xFF, 0xDD, 0, 4]);
        out.extend(word(options.restart_lines as usize));
    }
    let parameters =
        Parameters::new(options.precision, options.near, &options.preset.unwrap_or_default()).unwrap();
    let mut decoded = planes.to_vec();
    let scans: Vec<Vec<usize>> = if options.by_line {
        vec![(0..options.components).collect()]
    } else {
        (0..options.components).map(|component| vec![component]).collect()
    };
    for scan in scans {
        out.extend([0xFF, 0xDA]);
        out.extend(word(6 + 2 * scan.len()));
        out.push(scan.len() as u8);
        for &component in &scan {
            out.extend([component as u8 + 1, 0]);
        }
        out.extend([options.near, u8::from(options.by_line && scan.len() > 1), 0]);
        let interval = if options.restart_lines > 0 { options.restart_lines as usize } else { options.rows };
        for (number, start) in (0..options.rows).step_by(interval).enumerate() {
            if number > 0 {
                out.extend([0xFF, 0xD0 + (number as u8 - 1) % 8]);
            }
            let mut coder = Coder::new(parameters);
            let mut run_index = vec![0; scan.len()];
            for y in start..options.rows.min(start + interval) {
                for (&component, run_index) in scan.iter().zip(&mut run_index) {
                    coder.line(&mut decoded[component], options.columns, start, y, run_index);
                }
            }
            coder.bits.end();
            out.extend(coder.bits.bytes);
        }
    }
    out.extend([0xFF, 0xD9]);
    (out, decoded)
}

/// The variables of T.87 section A.2, by their names there.
struct Coder {
    p: Parameters,
    a: [i32; 367],
    b: [i32; 365],
    c: [i32; 365],
    n: [i32; 367],
    nn: [i32; 2],
    bits: Bits,
}

impl Coder {
    fn new(p: Parameters) -> Coder {
        let a = ((p.range + 32) / 64).max(2);
        Coder { p, a: [a; 367], b: [0; 365], c: [0; 365], n: [1; 367], nn: [0; 2], bits: Bits::new() }
    }

    /// Encodes line `y` of a plane whose lines from `first` on count, and puts the decoded values in it.
    fn line(&mut self, plane: &mut [u16], columns: usize, first: usize, y: usize, run_index: &mut usize) {
        let at = |plane: &[u16], line: isize, x: isize| -> i32 {
            // Beside the image is what is above or below the edge, above it are zeros.
            let rec = |line: isize, x: isize| i32::from(plane[line as usize * columns + x as usize]);
            let first = first as isize;
            match (line - first, x) {
                (..=-1, _) => 0,
                (0, -1) => 0,
                (_, -1) => rec(line - 1, 0),
                (_, x) if x == columns as isize => rec(line, x - 1),
                _ => rec(line, x),
            }
        };
        let y = y as isize;
        let mut x = 0;
        while x < columns as isize {
            let index = y as usize * columns + x as usize;
            let (ra, rb) = (at(plane, y, x - 1), at(plane, y - 1, x));
            // Left of the first line's line above is zero too.
            let rc = at(plane, y - 1, x - 1);
            let rd = at(plane, y - 1, x + 1);
            let gradients = [rd - rb, rb - rc, rc - ra];
            if gradients.iter().any(|d| d.abs() > self.p.near) {
                plane[index] = self.regular(gradients, [ra, rb, rc], i32::from(plane[index])) as u16;
                x += 1;
                continue;
            }
            let mut run = 0;
            while x < columns as isize
                && (i32::from(plane[y as usize * columns + x as usize]) - ra).abs() <= self.p.near
            {
                plane[y as usize * columns + x as usize] = ra as u16;
                run += 1;
                x += 1;
            }
            while run >= 1 << RUN_ORDERS[*run_index] {
                self.bits.bit(true);
                run -= 1 << RUN_ORDERS[*run_index];
                *run_index = (*run_index + 1).min(31);
            }
            if x == columns as isize {
                if run > 0 {
                    self.bits.bit(true);
                }
                break;
            }
            self.bits.bit(false);
            self.bits.bits(run, RUN_ORDERS[*run_index].into());
            let index = y as usize * columns + x as usize;
            let rb = at(plane, y - 1, x);
            plane[index] = self.run_end(ra, rb, i32::from(plane[index]), *run_index) as u16;
            *run_index = run_index.saturating_sub(1);
            x += 1;
        }
    }

    /// Quantises and reduces an error, and gives it with the decoded sample.
    fn error(&self, px: i32, sign: i32, ix: i32) -> (i32, i32) {
        let Parameters { near, maximum, range, .. } = self.p;
        let mut error = (ix - px) * sign;
        if near > 0 {
            error =
                if error > 0 { (near + error) / (2 * near + 1) } else { -((near - error) / (2 * near + 1)) };
        }
        let rx = (px + sign * error * (2 * near + 1)).clamp(0, maximum);
        if error < 0 {
            error += range;
        }
        if error >= (range + 1) / 2 {
            error -= range;
        }
        (error, rx)
    }

    fn regular(&mut self, gradients: [i32; 3], [ra, rb, rc]: [i32; 3], ix: i32) -> i32 {
        let [t1, t2, t3] = self.p.thresholds;
        let near = self.p.near;
        let mut q = gradients.map(|d| match d {
            d if d <= -t3 => -4,
            d if d <= -t2 => -3,
            d if d <= -t1 => -2,
            d if d < -near => -1,
            d if d <= near => 0,
            d if d < t1 => 1,
            d if d < t2 => 2,
            d if d < t3 => 3,
            _ => 4,
        });
        let sign = if q < [0, 0, 0] { -1 } else { 1 };
        if sign < 0 {
            q = q.map(|class: i32| -class);
        }
        let q = (81 * q[0] + 9 * q[1] + q[2]) as usize;
        let px = if rc >= ra.max(rb) {
            ra.min(rb)
        } else if rc <= ra.min(rb) {
            ra.max(rb)
        } else {
            ra + rb - rc
        };
        let px = (px + sign * self.c[q]).clamp(0, self.p.maximum);
        let (error, rx) = self.error(px, sign, ix);
        let k = (0..).find(|&k| self.n[q] << k >= self.a[q]).unwrap();
        let mapped = if near == 0 && k == 0 && 2 * self.b[q] <= -self.n[q] {
            if error >= 0 { 2 * error + 1 } else { -2 * (error + 1) }
        } else if error >= 0 {
            2 * error
        } else {
            -2 * error - 1
        };
        self.bits.golomb(mapped as u32, k, self.p.limit, self.p.error_bits);
        self.b[q] += error * (2 * near + 1);
        self.a[q] += error.abs();
        if self.n[q] == self.p.reset as i32 {
            self.a[q] >>= 1;
            self.b[q] = if self.b[q] >= 0 { self.b[q] >> 1 } else { -((1 - self.b[q]) >> 1) };
            self.n[q] >>= 1;
        }
        self.n[q] += 1;
        if self.b[q] <= -self.n[q] {
            self.b[q] += self.n[q];
            if self.c[q] > -128 {
                self.c[q] -= 1;
            }
            if self.b[q] <= -self.n[q] {
                self.b[q] = -self.n[q] + 1;
            }
        } else if self.b[q] > 0 {
            self.b[q] -= self.n[q];
            if self.c[q] < 127 {
                self.c[q] += 1;
            }
            if self.b[q] > 0 {
                self.b[q] = 0;
            }
        }
        rx
    }

    fn run_end(&mut self, ra: i32, rb: i32, ix: i32, run_index: usize) -> i32 {
        let kind = usize::from((ra - rb).abs() <= self.p.near);
        let px = if kind == 1 { ra } else { rb };
        let sign = if kind == 0 && ra > rb { -1 } else { 1 };
        let (error, rx) = self.error(px, sign, ix);
        let q = 365 + kind;
        let temp = if kind == 0 { self.a[365] } else { self.a[366] + (self.n[366] >> 1) };
        let k = (0..).find(|&k| self.n[q] << k >= temp).unwrap();
        let map = (k == 0 && error > 0 && 2 * self.nn[kind] < self.n[q])
            || (error < 0 && 2 * self.nn[kind] >= self.n[q])
            || (error < 0 && k != 0);
        let mapped = 2 * error.abs() - kind as i32 - i32::from(map);
        let limit = self.p.limit - u32::from(RUN_ORDERS[run_index]) - 1;
        self.bits.golomb(mapped as u32, k, limit, self.p.error_bits);
        if error < 0 {
            self.nn[kind] += 1;
        }
        self.a[q] += (mapped + 1 - kind as i32) >> 1;
        if self.n[q] == self.p.reset as i32 {
            self.a[q] >>= 1;
            self.n[q] >>= 1;
            self.nn[kind] >>= 1;
        }
        self.n[q] += 1;
        rx
    }
}

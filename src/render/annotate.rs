//! Marks in a picture: a scale bar, and the patient's sides.
//!
//! Letters and lines are white with a black border, so that they are read on any ground.

use super::Camera;
use super::font::{self, HIGH, WIDE};
use super::image::Image;
use crate::geom::dot;

/// Pixels of a picture's shorter side for each size of letters.
const SIDE_A_SIZE: u32 = 320;

/// The longest part of a picture's width that the bar takes.
const LONGEST: f64 = 0.25;

/// The letters of the patient's sides: of x, y and z, towards more and towards less.
const SIDES: [[char; 2]; 3] = [['L', 'R'], ['P', 'A'], ['S', 'I']];

/// Cosine between a face of the cube and the line of sight from which on its letter is written.
const FACING: f64 = 0.35;

const WHITE: [u8; 4] = [255; 4];
const BLACK: [u8; 4] = [0, 0, 0, 255];

/// Draws a bar with its length in mm at the bottom left, true at `depth_mm` (everywhere, of a parallel camera), and at
/// the bottom right a cube with the letters of the patient's sides. Pictures under 64 pixels stay as they are.
///
/// The image may be a part of the picture: the rows from the first number on, of a picture of as many as the second.
pub(crate) fn annotate(image: &mut Image, (top, height): (u32, u32), camera: &Camera, depth_mm: f64) {
    let side = image.width.min(height);
    if side < 64 {
        return;
    }
    let size = i64::from(side.div_ceil(SIDE_A_SIZE));
    let mut sheet = Sheet { image, top, height, size };
    sheet.bar(camera, depth_mm);
    sheet.cube(camera, f64::from(side) / 16.0);
}

/// Writes a word at the top left.
pub(crate) fn caption(image: &mut Image, word: &str) {
    let side = image.width.min(image.height);
    if side < 64 {
        return;
    }
    let size = i64::from(side.div_ceil(SIDE_A_SIZE));
    let height = image.height;
    Sheet { image, top: 0, height, size }.text(word, [4 * size, 4 * size]);
}

struct Sheet<'a> {
    image: &'a mut Image,
    /// The picture's row that the image begins at, and the picture's rows.
    top: u32,
    height: u32,
    /// Pixels of a letter's point.
    size: i64,
}

impl Sheet<'_> {
    /// Rows of the picture that are drawn.
    fn rows(&self) -> std::ops::Range<i64> {
        let top = i64::from(self.top);
        top..top + i64::from(self.image.height)
    }

    fn put(&mut self, [x, y]: [i64; 2], color: [u8; 4]) {
        let (width, height) = (i64::from(self.image.width), i64::from(self.image.height));
        let y = y - i64::from(self.top);
        if (0..width).contains(&x) && (0..height).contains(&y) {
            let at = usize::try_from(4 * (y * width + x)).unwrap_or(usize::MAX);
            if let Some(pixel) = at.checked_add(4).and_then(|end| self.image.rgba.get_mut(at..end)) {
                pixel.copy_from_slice(&color);
            }
        }
    }

    fn fill(&mut self, [x, y]: [i64; 2], [wide, high]: [i64; 2], color: [u8; 4]) {
        let rows = self.rows();
        for y in y.max(rows.start)..(y + high).min(rows.end) {
            for x in x..x + wide {
                self.put([x, y], color);
            }
        }
    }

    /// Pixels that a text is wide.
    fn wide(&self, text: &str) -> i64 {
        let letters = i64::try_from(text.chars().count()).unwrap_or(0);
        (letters * (WIDE as i64 + 1) - 1).max(0) * self.size
    }

    /// Text from its top left corner on.
    fn text(&mut self, text: &str, [left, top]: [i64; 2]) {
        let size = self.size;
        for (border, color) in [(size, BLACK), (0, WHITE)] {
            for (number, letter) in (0_i64..).zip(text.chars()) {
                for (row, column) in (0..HIGH).flat_map(|row| (0..WIDE).map(move |column| (row, column))) {
                    if font::is_inked(letter, column, row) {
                        let x = left + (number * (WIDE as i64 + 1) + column as i64) * size;
                        let y = top + row as i64 * size;
                        self.fill([x - border, y - border], [size + 2 * border; 2], color);
                    }
                }
            }
        }
    }

    /// A bar of 1, 2 or 5 times a power of ten of mm.
    #[expect(clippy::cast_possible_truncation, reason = "pixels of a picture")]
    fn bar(&mut self, camera: &Camera, depth_mm: f64) {
        let pixel_mm = camera.pixel_mm(self.height, depth_mm);
        let most_mm = LONGEST * f64::from(self.image.width) * pixel_mm;
        let Some((length_mm, label)) = round_length(most_mm) else { return };
        let size = self.size;
        let pixels = (length_mm / pixel_mm).round() as i64;
        let (left, bottom) = (6 * size, i64::from(self.height) - 6 * size);
        for (border, color) in [(size, BLACK), (0, WHITE)] {
            let across = |x: i64| {
                ([x - border, bottom - 5 * size - border], [size + 2 * border, 5 * size + 2 * border])
            };
            for (at, sides) in [across(left), across(left + pixels - size)] {
                self.fill(at, sides, color);
            }
            let at = [left - border, bottom - 3 * size - border];
            self.fill(at, [pixels + 2 * border, size + 2 * border], color);
        }
        let middle = left + (pixels - self.wide(&label)) / 2;
        self.text(&label, [middle.max(left), bottom - 15 * size]);
    }

    /// A cube of this half edge, as it lies to the camera.
    #[expect(clippy::cast_possible_truncation, reason = "pixels of a picture")]
    fn cube(&mut self, camera: &Camera, half: f64) {
        let [right, up, forward] = camera.axes();
        let reach = 1.8 * half + 4.0 * self.size as f64;
        let middle = [f64::from(self.image.width) - reach, f64::from(self.height) - reach];
        let place = |p: [f64; 3]| [middle[0] + half * dot(p, right), middle[1] - half * dot(p, up)];
        for (axis, letters) in SIDES.into_iter().enumerate() {
            for (letter, sign) in letters.into_iter().zip([1.0, -1.0]) {
                let mut normal = [0.0; 3];
                normal[axis] = sign;
                let facing = -dot(normal, forward);
                if facing <= 0.01 {
                    continue;
                }
                let corner = |a: f64, b: f64| {
                    let mut p = normal;
                    (p[(axis + 1) % 3], p[(axis + 2) % 3]) = (a, b);
                    place(p)
                };
                let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
                self.face(&corners, (70.0 + 110.0 * facing) as u8);
                if facing >= FACING {
                    let at = place(normal);
                    let (wide, high) = (WIDE as i64 * self.size, HIGH as i64 * self.size);
                    let at = [at[0].round() as i64 - wide / 2, at[1].round() as i64 - high / 2];
                    self.text(letter.encode_utf8(&mut [0; 4]), at);
                }
            }
        }
    }

    /// A convex face with a black border.
    #[expect(clippy::cast_possible_truncation, reason = "pixels of a picture")]
    fn face(&mut self, corners: &[[f64; 2]; 4], grey: u8) {
        let drawn = self.rows();
        let range = |a: usize| {
            let all = || corners.iter().map(|c| c[a]);
            let (low, high) = (all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max));
            low.floor() as i64..high.ceil() as i64 + 1
        };
        let area = |a: [f64; 2], b: [f64; 2], p: [f64; 2]| {
            (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
        };
        let turn = area(corners[0], corners[1], corners[2]).signum();
        let rows = range(1);
        for y in rows.start.max(drawn.start)..rows.end.min(drawn.end) {
            for x in range(0) {
                let at = [x as f64 + 0.5, y as f64 + 0.5];
                let within = (0..4).map(|i| {
                    let (a, b) = (corners[i], corners[(i + 1) % 4]);
                    let length = ((b[0] - a[0]) * (b[0] - a[0]) + (b[1] - a[1]) * (b[1] - a[1])).sqrt();
                    turn * area(a, b, at) / length.max(1e-9)
                });
                let within = within.fold(f64::INFINITY, f64::min);
                if within >= 0.0 {
                    let edge = within < self.size as f64;
                    self.put([x, y], if edge { BLACK } else { [grey, grey, grey, 255] });
                }
            }
        }
    }
}

/// The greatest length of 1, 2 or 5 times a power of ten that is not above another, and its name.
fn round_length(most_mm: f64) -> Option<(f64, String)> {
    let mut found = None;
    for power in -3..=6_i32 {
        for digit in [1, 2, 5_u32] {
            // Products and quotients of whole numbers: the same everywhere.
            let ten = 10_u32.pow(power.unsigned_abs());
            let (length, name) = if power < 0 {
                let zeros = "0".repeat(power.unsigned_abs() as usize - 1);
                (f64::from(digit) / f64::from(ten), format!("0.{zeros}{digit}"))
            } else {
                (f64::from(digit) * f64::from(ten), (u64::from(digit) * u64::from(ten)).to_string())
            };
            if length <= most_mm {
                found = Some((length, format!("{name} mm")));
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::{NamedView, Projection, ViewPoint};

    #[test]
    fn bars_are_round_and_no_longer_than_they_may_be() {
        let name = |mm: f64| round_length(mm).map(|(length, name)| (length.to_string(), name));
        let pair = |a: &str, b: &str| Some((a.to_owned(), b.to_owned()));
        assert_eq!(name(63.0), pair("50", "50 mm"));
        assert_eq!(name(5.0), pair("5", "5 mm"));
        assert_eq!(name(0.0199), pair("0.01", "0.01 mm"));
        assert_eq!(name(1e-9), None);
    }

    /// The bar is as long as the millimetres that it names; what is written is letters that there are.
    #[test]
    fn a_picture_is_annotated_to_the_pixel() {
        let support = |d: [f64; 3]| d.iter().map(|c| 100.0 * c.abs()).sum();
        let point = ViewPoint::Named(NamedView::Iso);
        let camera = Camera::new(point, Projection::Parallel, 35.0, 1.0, support).unwrap();
        let mut image = Image {
            width: 400,
            height: 400,
            rgba: vec![0; 400 * 400 * 4],
            depth: None,
            normals: None,
            ids: None,
        };
        annotate(&mut image, (0, 400), &camera, 0.0);
        let pixel_mm = camera.pixel_mm(400, 0.0);
        let row = (400 - 6 * 2 - 3 * 2) as usize;
        let white = (0..200).filter(|x| image.rgba[4 * (row * 400 + x)..][..4] == WHITE).count();
        let mm = white as f64 * pixel_mm;
        assert!((mm - 50.0).abs() < pixel_mm, "{mm}");
        for letter in SIDES.iter().flatten().chain(&['0', '1', '2', '5', '.', 'm']) {
            assert!((0..HIGH).any(|row| font::is_inked(*letter, 2, row) || font::is_inked(*letter, 0, row)));
        }
        for view in NamedView::ALL {
            assert!(
                view.name()
                    .to_uppercase()
                    .chars()
                    .all(|c| (0..HIGH).any(|row| { (0..WIDE).any(|column| font::is_inked(c, column, row)) }))
            );
        }
    }
}

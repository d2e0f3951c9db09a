//! Annotations around a picture, in separate strips that leave the model uncovered.
//!
//! ```text
//! +---------------------------+
//! | title                     |
//! +-------------------+-------+
//! |                   | # one |
//! |  model            | # two |
//! |                   |       |
//! +-------------------+       |
//! | |--50 mm--|  cube |       |
//! +-------------------+-------+
//! ```

use super::Camera;
use super::font::Letters;
use super::image::Image;
use crate::format::{Quantity, ValueColors};
use crate::geom::dot;
use crate::text::{mark, shown};

/// Shorter side in pixels below which a picture has no annotations.
const MIN_SIDE: u32 = 64;

/// Least pixels of an em, and pixels of the picture's height, or of twice its width, for each further pixel of it.
const MIN_EM: f64 = 8.0;
const SIDE_AN_EM: f64 = 80.0;

/// Greatest share of a picture's width for the scale bar, and for a legend.
const LONGEST: f64 = 0.25;
const WIDEST: f64 = 0.35;

/// Heights of the strips, and line height of a legend, in ems.
const BAR_EMS: f64 = 4.0;
const TITLE_EMS: f64 = 2.0;
const LINE_EMS: f64 = 1.5;

/// Height of capitals in ems.
const CAPITAL: f64 = 0.729;

/// Names of the sides of a part and of a patient: for x, y and z, in the positive and in the negative direction.
const SIDES: [[[&str; 2]; 3]; 2] =
    [[["x", "-x"], ["y", "-y"], ["z", "-z"]], [["L", "R"], ["P", "A"], ["S", "I"]]];

/// Least cosine between a face of the cube and the line of sight for its letter to be written on it.
const FACING: f64 = 0.35;

/// Greatest cosine between a face and the line of sight for its letter to be written beside the cube.
const EDGE_ON: f64 = 0.1;

/// Size of such a letter, and distance of its middle from the cube, in ems.
const BESIDE_EMS: f64 = 0.8;
const BESIDE_GAP_EMS: f64 = 0.55;

const DARK: [u8; 3] = [32; 3];
const LIGHT: [u8; 3] = [240; 3];

/// Sizes and colours of the annotations of a picture of these sides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Style {
    em: f64,
    ink: [u8; 3],
    /// Colour of the halo around letters, where the background is unknown.
    halo: Option<[u8; 3]>,
    ground: Option<[u8; 3]>,
}

/// A line of a legend.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Entry {
    /// Colour in sRGB.
    pub(crate) color: [u8; 3],
    pub(crate) name: String,
    /// Replacement for a name with letters that the font lacks.
    pub(crate) plain: String,
}

/// Colour ramp of measured values for a legend.
#[derive(Clone, Debug)]
pub(crate) struct Ramp {
    colors: ValueColors,
    /// Name and unit, and the meaning of the sign.
    lines: Vec<String>,
    tolerance: Option<[f64; 2]>,
}

/// Number of ticks along the bar of a ramp, both ends included.
const TICKS: u32 = 5;

impl Ramp {
    pub(crate) fn new(quantity: &Quantity, colors: ValueColors) -> Self {
        let unit = if quantity.unit.is_empty() { String::new() } else { format!(", {}", quantity.unit) };
        let mut lines = vec![format!("{}{unit}", quantity.name)];
        lines.extend(Some(quantity.sign.clone()).filter(|sign| !sign.is_empty()));
        let lines = lines.iter().map(|line| shown(line).to_string()).collect();
        Self { colors, lines, tolerance: quantity.tolerance }
    }

    /// Labels of the ticks, with their fractions of the bar from its lower end.
    fn ticks(&self) -> impl Iterator<Item = (String, f64)> {
        let [lo, hi] = self.colors.range;
        (0..TICKS).map(move |tick| {
            let part = f64::from(tick) / f64::from(TICKS - 1);
            let value = lo + part * (hi - lo);
            let number = mark(value, hi - lo);
            // Values beyond the ends have the colours of the ends.
            let beyond = match tick {
                0 if lo != 0.0 => "≤ ",
                _ if tick == TICKS - 1 => "≥ ",
                _ => "",
            };
            (format!("{beyond}{number}"), part)
        })
    }
}

impl Style {
    /// The style for a picture of this width and height on a background (sRGB); `None` for one that is too small.
    pub(crate) fn of([width, height]: [u32; 2], ground: Option<[u8; 3]>) -> Option<Self> {
        let side = height.min(2 * width);
        let is_dark = |[r, g, b]: [u8; 3]| 2 * u32::from(r) + 5 * u32::from(g) + u32::from(b) < 8 * 110;
        (width.min(height) >= MIN_SIDE).then(|| Self {
            em: MIN_EM + f64::from(side) / SIDE_AN_EM,
            ink: if ground.is_some_and(is_dark) { LIGHT } else { DARK },
            halo: ground.is_none().then_some([255; 3]),
            ground,
        })
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few hundred pixels")]
    fn pixels(self, ems: f64) -> u32 {
        (ems * self.em).round() as u32
    }

    /// Rows of a title.
    pub(crate) fn title_rows(self) -> u32 {
        self.pixels(TITLE_EMS)
    }

    /// Rows of scale bar and cube.
    pub(crate) fn bar_rows(self) -> u32 {
        self.pixels(BAR_EMS)
    }

    /// Columns of a legend of these entries, in a picture of this width.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most the picture's")]
    pub(crate) fn legend_columns(self, width: u32, entries: &[Entry]) -> u32 {
        let letters = Letters::new(self.em);
        let wide = |entry: &Entry| letters.as_ref().map_or(0.0, |letters| letters.width(entry.text(letters)));
        let names = entries.iter().map(wide).fold(0.0, f64::max);
        (names + 2.5 * self.em).ceil().min(WIDEST * f64::from(width)) as u32
    }

    /// Columns of the legend of these values, in a picture of this width.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most the picture's")]
    pub(crate) fn ramp_columns(self, width: u32, ramp: &Ramp) -> u32 {
        let letters = Letters::new(self.em);
        let wide = |text: &str| letters.as_ref().map_or(0.0, |letters| letters.width(text));
        let lines = ramp.lines.iter().map(|line| wide(line) + self.em);
        let numbers = ramp.ticks().map(|(number, _)| wide(&number) + 2.5 * self.em);
        lines.chain(numbers).fold(0.0, f64::max).ceil().min(WIDEST * f64::from(width)) as u32
    }

    /// A picture with the colour ramp of values on its right, `columns` wide.
    pub(crate) fn ramp(self, picture: &Image, columns: u32, ramp: &Ramp) -> Image {
        let mut sheet = self.strip(picture, columns, picture.height);
        sheet.ramp(ramp);
        picture.beside(&sheet.image)
    }

    /// An empty strip, with the layers of `like`.
    fn strip(self, like: &Image, width: u32, height: u32) -> Sheet {
        let mut image = Image::blank([width, height], like.layers());
        if let Some([r, g, b]) = self.ground {
            image.rgba.as_chunks_mut().0.fill([r, g, b, 255]);
        }
        Sheet { image, style: self }
    }

    /// A strip with a text, with the width and layers of a picture.
    pub(crate) fn title(self, like: &Image, text: &str) -> Image {
        let mut sheet = self.strip(like, like.width, self.title_rows());
        let room = f64::from(like.width) - self.em;
        if let Some(letters) = Letters::new(self.em) {
            let line = f64::from(sheet.image.height) / 2.0 + CAPITAL * self.em / 2.0;
            sheet.text(&letters, &letters.cut(text, room), [0.5 * self.em, line], self.ink);
        }
        sheet.image
    }

    /// A strip with a scale bar in mm, true at `depth_mm` (everywhere, for a parallel camera), and with a cube that
    /// shows the letters of the patient's sides, or else the axes; for a picture by this camera.
    pub(crate) fn bar(
        self,
        like: &Image,
        (camera, is_patient): (&Camera, bool),
        (height, depth_mm): (u32, f64),
    ) -> Image {
        let mut sheet = self.strip(like, like.width, self.bar_rows());
        sheet.bar(camera.pixel_mm(height, depth_mm));
        sheet.cube(camera, SIDES[usize::from(is_patient)]);
        sheet.image
    }

    /// Number of so many entries that fit into the rows of a legend, with a line for the number of the others.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "lines of a picture")]
    pub(crate) fn fitting(self, entries: usize, rows: u32) -> usize {
        let fitting = ((f64::from(rows) - self.em) / (LINE_EMS * self.em)) as usize;
        if entries > fitting { fitting.saturating_sub(1) } else { entries }
    }

    /// A picture with a legend on its right, `columns` wide: as many entries as fit, and the number of the others.
    pub(crate) fn legend(self, picture: &Image, columns: u32, entries: &[Entry]) -> Image {
        let mut sheet = self.strip(picture, columns, picture.height);
        sheet.legend(entries);
        picture.beside(&sheet.image)
    }
}

impl Entry {
    fn text(&self, letters: &Letters) -> &str {
        if letters.knows(&self.name) { &self.name } else { &self.plain }
    }
}

struct Sheet {
    image: Image,
    style: Style,
}

impl Sheet {
    /// Blends a colour over a part of a pixel.
    fn put(&mut self, [x, y]: [i64; 2], color: [u8; 3], part: f32) {
        let (width, height) = (i64::from(self.image.width), i64::from(self.image.height));
        if !((0..width).contains(&x) && (0..height).contains(&y)) || part <= 0.0 {
            return;
        }
        let at = usize::try_from(y * width + x).unwrap_or(usize::MAX);
        let Some(pixel) = self.image.rgba.as_chunks_mut::<4>().0.get_mut(at) else { return };
        let behind = f32::from(pixel[3]) / 255.0 * (1.0 - part);
        let alpha = part + behind;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 255")]
        let mixed =
            |c: usize| ((f32::from(color[c]) * part + f32::from(pixel[c]) * behind) / alpha + 0.5) as u8;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 255")]
        let over = [mixed(0), mixed(1), mixed(2), (alpha * 255.0 + 0.5) as u8];
        *pixel = over;
    }

    fn fill(&mut self, [x, y]: [i64; 2], [wide, high]: [i64; 2], color: [u8; 3]) {
        for at in (y..y + high).flat_map(|y| (x..x + wide).map(move |x| [x, y])) {
            self.put(at, color, 1.0);
        }
    }

    /// Text that begins at x, on the baseline y.
    fn text(&mut self, letters: &Letters, text: &str, [x, y]: [f64; 2], ink: [u8; 3]) {
        if let Some(halo) = self.style.halo {
            let reach = self.style.em / 14.0;
            for (right, down) in (-1..=1).flat_map(|x| (-1..=1).map(move |y| (f64::from(x), f64::from(y)))) {
                let at = [x + reach * right, y + (reach * down).round()];
                letters.cover(text, at, &mut |at, part| self.put(at, halo, part));
            }
        }
        letters.cover(text, [x, y], &mut |at, part| self.put(at, ink, part));
    }

    /// A scale bar of 1, 2 or 5 times a power of ten of mm, with its length above.
    #[expect(clippy::cast_possible_truncation, reason = "pixels of a picture")]
    fn bar(&mut self, pixel_mm: f64) {
        let most_mm = LONGEST * f64::from(self.image.width) * pixel_mm;
        let (Some((length_mm, label)), Some(letters)) = (round_length(most_mm), Letters::new(self.style.em))
        else {
            return;
        };
        let (em, ink) = (self.style.em, self.style.ink);
        let pixels = (length_mm / pixel_mm).round() as i64;
        let (left, line) = ((0.75 * em) as i64, (0.7 * f64::from(self.image.height)) as i64);
        let (thick, tick) = ((em / 8.0).ceil() as i64, (0.4 * em) as i64);
        let parts = [
            ([left, line], [pixels, thick]),
            ([left, line - tick], [thick, 2 * tick + thick]),
            ([left + pixels - thick, line - tick], [thick, 2 * tick + thick]),
        ];
        if let Some(halo) = self.style.halo {
            for ([x, y], [wide, high]) in parts {
                self.fill([x - 1, y - 1], [wide + 2, high + 2], halo);
            }
        }
        for (at, sides) in parts {
            self.fill(at, sides, ink);
        }
        let middle = left as f64 + (pixels as f64 - letters.width(&label)) / 2.0;
        let at = [middle.max(0.75 * em), (line - tick) as f64 - 0.35 * em];
        self.text(&letters, &label, at, ink);
    }

    /// The orientation cube as seen by the camera.
    fn cube(&mut self, camera: &Camera, sides: [[&str; 2]; 3]) {
        let [right, up, forward] = camera.axes();
        // Its diagonal fits the strip.
        let reach = 0.46 * f64::from(self.image.height);
        let half = reach / 3.0_f64.sqrt();
        let middle =
            [f64::from(self.image.width) - reach - 0.25 * self.style.em, f64::from(self.image.height) / 2.0];
        let place = |p: [f64; 3]| [middle[0] + half * dot(p, right), middle[1] - half * dot(p, up)];
        for (axis, letters) in sides.into_iter().enumerate() {
            for (letter, sign) in letters.into_iter().zip([1.0, -1.0]) {
                let mut normal = [0.0; 3];
                normal[axis] = sign;
                let facing = -dot(normal, forward);
                if facing.abs() <= EDGE_ON {
                    let away = 1.0 + BESIDE_GAP_EMS * self.style.em / half;
                    self.letter(letter, BESIDE_EMS * self.style.em, place(normal.map(|c| c * away)));
                }
                if facing <= 0.01 {
                    continue;
                }
                let corner = |a: f64, b: f64| {
                    let mut p = normal;
                    (p[(axis + 1) % 3], p[(axis + 2) % 3]) = (a, b);
                    place(p)
                };
                let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
                self.face(&corners, facing);
                let font = Letters::new(half * (0.6 + 1.1 * facing)).filter(|_| facing >= FACING);
                if let Some(font) = font {
                    let [x, y] = place(normal);
                    let (wide, high) = (font.width(letter), CAPITAL * half * (0.6 + 1.1 * facing));
                    font.cover(letter, [x - wide / 2.0, y + high / 2.0], &mut |at, part| {
                        self.put(at, DARK, part)
                    });
                }
            }
        }
    }

    /// A letter centred at a point.
    fn letter(&mut self, letter: &str, em: f64, [x, y]: [f64; 2]) {
        if let Some(letters) = Letters::new(em) {
            let at = [x - letters.width(letter) / 2.0, y + CAPITAL * em / 2.0];
            self.text(&letters, letter, at, self.style.ink);
        }
    }

    /// A convex face with a dark border.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "pixels of a picture")]
    fn face(&mut self, corners: &[[f64; 2]; 4], facing: f64) {
        let grey = (140.0 + 100.0 * facing) as u8;
        let border = (self.style.em / 12.0).max(1.0);
        let range = |a: usize| {
            let all = || corners.iter().map(|c| c[a]);
            let (low, high) = (all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max));
            low.floor() as i64 - 1..high.ceil() as i64 + 2
        };
        let area = |a: [f64; 2], b: [f64; 2], p: [f64; 2]| {
            (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
        };
        let turn = area(corners[0], corners[1], corners[2]).signum();
        for (x, y) in range(1).flat_map(|y| range(0).map(move |x| (x, y))) {
            let at = [x as f64 + 0.5, y as f64 + 0.5];
            let within = (0..4).map(|i| {
                let (a, b) = (corners[i], corners[(i + 1) % 4]);
                let length = ((b[0] - a[0]) * (b[0] - a[0]) + (b[1] - a[1]) * (b[1] - a[1])).sqrt();
                turn * area(a, b, at) / length.max(1e-9)
            });
            let within = within.fold(f64::INFINITY, f64::min);
            let covered = |edge: f64| (within - edge + 0.5).clamp(0.0, 1.0) as f32;
            self.put([x, y], DARK, covered(0.0));
            self.put([x, y], [grey; 3], covered(border));
        }
    }

    /// A bar with its numbers between name and sign, marks at the tolerance, and the colour of cells without a value.
    #[expect(clippy::cast_possible_truncation, reason = "pixels of a picture")]
    fn ramp(&mut self, ramp: &Ramp) {
        let (em, ink) = (self.style.em, self.style.ink);
        let Some(letters) = Letters::new(em) else { return };
        let line = LINE_EMS * em;
        let (left, room) = (0.5 * em, f64::from(self.image.width) - 0.5 * em);
        for (number, text) in ramp.lines.iter().enumerate() {
            let at = [left, 1.25 * em + number as f64 * line];
            self.text(&letters, &letters.cut(text, room), at, ink);
        }
        let top = (0.75 * em + (ramp.lines.len() as f64 + 0.5) * line).round();
        let bottom = (f64::from(self.image.height) - 3.0 * em).min(top + 24.0 * em).round();
        let (x, wide, high) = (left as i64, em.round() as i64, bottom - top);
        if high < line {
            return;
        }
        self.fill([x - 1, top as i64 - 1], [wide + 2, high as i64 + 2], ink);
        let [lo, hi] = ramp.colors.range;
        let place = |part: f64| (bottom - part * high).round();
        for row in top as i64..bottom as i64 {
            let part = (bottom - row as f64 - 0.5) / high;
            self.fill([x, row], [wide, 1], ramp.colors.at(lo + part * (hi - lo)));
        }
        for limit in ramp.tolerance.into_iter().flatten().filter(|limit| *limit > lo && *limit < hi) {
            self.fill([x - 1, place((limit - lo) / (hi - lo)) as i64], [wide + 2, 2], DARK);
        }
        let mut numbers: Vec<(String, f64)> = ramp.ticks().collect();
        if high < f64::from(TICKS) * em {
            numbers.retain(|(_, part)| *part == 0.0 || *part == 1.0);
        }
        for (number, part) in numbers {
            let y = place(part);
            self.fill([x + wide, y.min(bottom - 1.0) as i64], [(0.3 * em) as i64, 1], ink);
            let text = letters.cut(&number, room - 1.75 * em);
            self.text(&letters, &text, [left + 1.5 * em, y + CAPITAL / 2.0 * em], ink);
        }
        let below = bottom + 1.25 * em;
        self.fill([x - 1, below as i64 - 1], [wide + 2; 2], ink);
        self.fill([x, below as i64], [wide; 2], ValueColors::NONE);
        let at = [left + 1.5 * em, below + (1.0 + CAPITAL) / 2.0 * em];
        self.text(&letters, &letters.cut("none", room - 1.75 * em), at, ink);
    }

    /// Swatches and names from the top.
    #[expect(clippy::cast_possible_truncation, reason = "pixels of a picture")]
    fn legend(&mut self, entries: &[Entry]) {
        let (em, ink) = (self.style.em, self.style.ink);
        let Some(letters) = Letters::new(em) else { return };
        let line = LINE_EMS * em;
        let shown = self.style.fitting(entries.len(), self.image.height);
        let (side, room) = (em.round() as i64, f64::from(self.image.width) - 2.25 * em);
        for (number, entry) in entries.iter().take(shown).enumerate() {
            let top = (0.5 * em + number as f64 * line).round() as i64;
            self.fill([(0.25 * em) as i64, top], [side; 2], ink);
            self.fill([(0.25 * em) as i64 + 1, top + 1], [side - 2; 2], entry.color);
            let name = letters.cut(entry.text(&letters), room);
            self.text(&letters, &name, [1.75 * em, top as f64 + (1.0 + CAPITAL) / 2.0 * em], ink);
        }
        if shown < entries.len() {
            let top = 0.5 * em + shown as f64 * line;
            let more = letters.cut(&format!("and {} more", entries.len() - shown), room + 1.5 * em);
            self.text(&letters, &more, [0.25 * em, top + (1.0 + CAPITAL) / 2.0 * em], ink);
        }
    }
}

/// The greatest length of 1, 2 or 5 times a power of ten that does not exceed `most_mm`, and its name.
fn round_length(most_mm: f64) -> Option<(f64, String)> {
    let mut found = None;
    for power in -3..=6_i32 {
        for digit in [1, 2, 5_u32] {
            // Products and quotients of integers: the same everywhere.
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

    fn blank(width: u32, height: u32) -> Image {
        Image::blank([width, height], [false; 3])
    }

    /// Number of pixels of a strip's row that have exactly this colour.
    fn inked(image: &Image, row: u32, color: [u8; 4]) -> usize {
        let row = image.rgba.as_chunks::<4>().0.chunks(image.width as usize).nth(row as usize).unwrap();
        row.iter().take(200).filter(|pixel| **pixel == color).count()
    }

    /// The bar is as long as the millimetres that it names.
    #[test]
    fn a_bar_is_true_to_the_pixel() {
        let support = |d: [f64; 3]| d.iter().map(|c| 100.0 * c.abs()).sum();
        let point = ViewPoint::Named(NamedView::Iso);
        let camera = Camera::new(point, Projection::Parallel, 35.0, 1.0, support).unwrap();
        for (ground, ink) in [(None, 32), (Some([255; 3]), 32), (Some([0, 0, 90]), 240)] {
            let style = Style::of([400, 400], ground).unwrap();
            let strip = style.bar(&blank(400, 300), (&camera, true), (300, 0.0));
            assert_eq!([strip.width, strip.height], [400, style.bar_rows()]);
            let pixel_mm = camera.pixel_mm(300, 0.0);
            let mm = inked(&strip, strip.height * 7 / 10, [ink, ink, ink, 255]) as f64 * pixel_mm;
            assert!((mm - 100.0).abs() < pixel_mm, "{mm}");
        }
        assert_eq!(Style::of([400, 63], None), None);
    }

    /// The first entries that fit are listed; the rest is counted. The picture itself does not change.
    #[test]
    fn a_legend_lists_what_fits_and_leaves_the_picture_alone() {
        let style = Style::of([256, 200], Some([0; 3])).unwrap();
        let entry =
            |n: u8| Entry { color: [n, 200, 255 - n], name: format!("label {n}"), plain: String::new() };
        let entries: Vec<Entry> = (0..40).map(entry).collect();
        let columns = style.legend_columns(256, &entries);
        assert!((60..90).contains(&columns), "{columns}");
        let mut picture = blank(100, 100);
        picture.rgba.fill(77);
        for (count, shown) in [(3, 3), (5, 5), (6, 4), (40, 4)] {
            let whole = style.legend(&picture, columns, &entries[..count]);
            assert_eq!([whole.width, whole.height], [100 + columns, 100]);
            let swatches = entries.iter().filter(|entry| {
                let [r, g, b] = entry.color;
                whole.rgba.as_chunks::<4>().0.contains(&[r, g, b, 255])
            });
            assert_eq!(swatches.count(), shown, "{count}");
            for row in whole.rgba.chunks(4 * whole.width as usize) {
                assert!(row[..400].iter().all(|byte| *byte == 77));
            }
        }
    }
}

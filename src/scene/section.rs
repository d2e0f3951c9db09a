//! A slice through a scene: the filled cut of a plane, and the line along which it cuts the surface.
//!
//! A line runs in the plane along every row of samples, there and back, which gives its segment in every box of a
//! surface. Between two consecutive segments all is inside or all is outside: lines along all six axes from there
//! decide, as for caps. So a picture needs some lines a row, not some for each pixel.

use std::collections::BTreeSet;
use std::time::Instant;

use rayon::prelude::*;

use crate::cpu::Form;
use crate::geom::{add_scaled, dot};
use crate::render::normals::shading_normal::Line;
use crate::render::shade::Shader;
use crate::render::{NamedView, RenderError};

use super::body::{Body, Instance};
use super::paint::{Counts, PictureSettings, Seen, Taker, Watch};

/// Samples along each side of a pixel, and half width of the cut line in samples.
const SAMPLES: usize = 4;
const REACH: usize = 3;

/// Rows of pixels made together.
const BAND: usize = 8;

/// Linear light of the cut line, on light and on dark backgrounds.
const INK: [f64; 2] = [0.015, 0.85];

/// A plane perpendicular to one of the axes (LPS).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Section {
    /// Axis of the normal: 0, 1, 2 for x, y, z.
    pub axis: usize,
    /// Position on that axis, in mm.
    pub at_mm: f64,
}

impl Section {
    /// View of the slice: axial slices from below, as they are read in radiology.
    pub fn view(self) -> NamedView {
        [NamedView::Left, NamedView::Front, NamedView::Bottom][self.axis.min(2)]
    }
}

/// The lines of a picture in the plane.
struct Plane<'a> {
    look: &'a PictureSettings,
    section: Section,
    bodies: Vec<Body<'a>>,
    /// Least coordinate of all cut bodies along the rows, in mm, with a margin; and their extent from there.
    start_mm: f64,
    length_mm: f64,
    ink: f64,
    shader: Shader,
    watch: Watch<'a>,
}

/// Paints a slice part by part; the camera of `look` is parallel and looks along the section's axis.
///
/// Memory: a part of 2^17 pixels or 8 rows, and for every thread 304 bytes for each column. Time: two lines for each of
/// four rows a pixel, each of which finds all boxes of the surface on its way.
///
/// # Errors
/// Errors of `take`.
pub(super) fn slice(
    parts: &[Instance<'_>],
    look: &PictureSettings,
    section: Section,
    watch: Watch<'_>,
    take: Taker<'_>,
) -> Result<(Counts, BTreeSet<Seen>), RenderError> {
    let [right, ..] = look.camera.axes();
    let ends = |direction| parts.iter().map(|part| part.support(direction)).fold(f64::NEG_INFINITY, f64::max);
    let (low, high) = (-ends(right.map(|c| -c)), ends(right));
    let is_dark = look.background.is_some_and(|[r, g, b]| r + 3.0 * g + b < 0.8);
    let margin = 0.01 * (high - low).max(1e-3);
    let plane = Plane {
        look,
        section,
        bodies: parts.iter().map(|part| Body::of(part, Form::best(), look.smoothing, 0)).collect(),
        start_mm: low - margin,
        length_mm: high - low + 2.0 * margin,
        ink: INK[usize::from(is_dark)],
        shader: Shader::new(),
        watch,
    };
    let start = Instant::now();
    let width = look.width as usize;
    let rows = (look.band_pixels() / width.max(1) / BAND).max(1) * BAND;
    let (mut all, mut top) = ((Counts::default(), BTreeSet::new()), 0);
    while top < look.height as usize {
        #[expect(clippy::cast_possible_truncation, reason = "at most the picture's rows")]
        let mut part = look.blank(rows.min(look.height as usize - top) as u32);
        let bands = part.rgba.par_chunks_mut(width * BAND * 4).enumerate();
        let done = bands.map(|(number, rgba)| plane.band(top + number * BAND, rgba));
        all = joined(all, done.reduce(Default::default, joined));
        watch.part(part.height)?;
        top += rows;
        take(&mut part)?;
    }
    all.0.trace = start.elapsed();
    Ok(all)
}

/// Joins the counts of two bands, and their visible items.
fn joined(one: (Counts, BTreeSet<Seen>), other: (Counts, BTreeSet<Seen>)) -> (Counts, BTreeSet<Seen>) {
    let mut seen = one.1;
    seen.extend(other.1);
    (one.0.plus(other.0), seen)
}

/// Samples of some rows: 0, or 1 plus the index of its filling in `kinds`.
struct Samples {
    width: usize,
    kinds: Vec<(Seen, [f64; 3])>,
    items: Vec<u16>,
}

impl Samples {
    fn kind(&mut self, key: Seen, color: [f64; 3]) -> u16 {
        let at = self.kinds.iter().position(|(known, _)| *known == key);
        let at = at.unwrap_or_else(|| {
            self.kinds.push((key, color));
            self.kinds.len() - 1
        });
        u16::try_from(at + 1).unwrap_or(u16::MAX)
    }

    /// The samples of a row between two positions, measured in samples.
    fn range(&self, row: usize, [from, to]: [f64; 2]) -> std::ops::Range<usize> {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the row")]
        let [from, to] = [from, to].map(|at| (at - 0.5).ceil().clamp(0.0, self.width as f64) as usize);
        row * self.width + from..row * self.width + to.max(from)
    }

    /// True for a sample on the cut line.
    fn is_cut(&self, x: usize, y: usize) -> bool {
        let at = y * self.width + x;
        let own = self.items[at];
        let other = |at: Option<usize>| at.and_then(|at| self.items.get(at)).is_some_and(|item| *item != own);
        other(at.checked_sub(REACH).filter(|_| x >= REACH))
            || other(Some(at + REACH).filter(|_| x + REACH < self.width))
            || other(at.checked_sub(REACH * self.width))
            || other(Some(at + REACH * self.width))
    }
}

impl Plane<'_> {
    /// Paints the rows of a band that begins at row `top` of the picture.
    fn band(&self, top: usize, rgba: &mut [u8]) -> (Counts, BTreeSet<Seen>) {
        let columns = self.look.width as usize;
        let width = columns * SAMPLES;
        let rows = rgba.len() / 4 / columns.max(1) * SAMPLES + 2 * REACH;
        let items = vec![0; width * rows];
        let mut samples = Samples { width, kinds: Vec::new(), items };
        let mut counts = Counts::default();
        for row in 0..rows {
            self.row((top * SAMPLES + row) as f64 - REACH as f64, row, &mut samples, &mut counts);
            if self.watch.ends() {
                break;
            }
        }
        let mut seen = BTreeSet::new();
        for (number, out) in rgba.as_chunks_mut::<4>().0.iter_mut().enumerate() {
            let (left, above) = (number % columns * SAMPLES, number / columns * SAMPLES + REACH);
            let (mut sum, mut hits) = ([0.0; 3], 0.0);
            for (x, y) in (0..SAMPLES * SAMPLES).map(|i| (left + i % SAMPLES, above + i / SAMPLES)) {
                let kind = usize::from(samples.items[y * width + x]).checked_sub(1);
                let color = match kind.and_then(|kind| samples.kinds.get(kind)) {
                    _ if samples.is_cut(x, y) => [self.ink; 3],
                    Some((key, color)) => {
                        seen.insert(*key);
                        *color
                    }
                    None => continue,
                };
                (sum, hits) = (add_scaled(sum, 1.0, color), hits + 1.0);
            }
            *out = self.shader.pixel(sum, hits, (SAMPLES * SAMPLES) as f64);
        }
        (counts, seen)
    }

    /// Fills a row of samples, `y` samples below the picture's top.
    fn row(&self, y: f64, row: usize, samples: &mut Samples, counts: &mut Counts) {
        let [right, _, forward] = self.look.camera.axes();
        let high = f64::from(self.look.height) * SAMPLES as f64;
        let along = (high - 2.0 * (y + 0.5)) / high;
        let [left, end] = [-1.0, 1.0].map(|x| self.look.camera.ray(x, along).0);
        let axis = self.section.axis;
        let depth = (self.section.at_mm - left[axis]) / forward[axis];
        let first_mm = dot(left, right);
        let origin = add_scaled(add_scaled(left, depth, forward), self.start_mm - first_mm, right);
        let sample_mm = (dot(end, right) - first_mm) / samples.width as f64;
        let place = |t: f64| (t + self.start_mm - first_mm) / sample_mm;
        for (number, body) in self.bodies.iter().enumerate() {
            counts.rays += 1;
            self.fill((number, body), (origin, right), row, samples, &place, counts);
        }
    }

    /// Fills the segments of a line within a body.
    fn fill(
        &self,
        (number, body): (usize, &Body<'_>),
        line: Line,
        row: usize,
        samples: &mut Samples,
        place: &dyn Fn(f64) -> f64,
        counts: &mut Counts,
    ) {
        let Some(span) = body.part.clip.span(line, [0.0, f64::INFINITY], None) else { return };
        let mut put = |[from, to]: [f64; 2], label: u16| {
            let color = body.part.label_color(label).unwrap_or(body.part.material.color);
            let kind = samples.kind((number, label), color);
            let range = samples.range(row, [place(from.max(span.enter)), place(to.min(span.leave))]);
            samples.items[range].fill(kind);
        };
        if body.has_walls() {
            let runs = body.runs(line);
            counts.hits += runs.len() as u64;
            runs.into_iter().for_each(|(run, label)| put(run, label));
            return;
        }
        let found = body.stretches(line, self.length_mm);
        counts.hits += found.len() as u64;
        for (at, stretch) in found.iter().enumerate() {
            put([stretch.hit.t, stretch.leave], 0);
            if let Some(next) = found.get(at + 1).filter(|next| next.hit.t > stretch.leave)
                && body.between(line, stretch, next).is_some()
            {
                put([stretch.leave, next.hit.t], 0);
            }
        }
    }
}

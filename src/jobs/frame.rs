//! Surroundings of a picture apart from its scale bar: a title, and the labels that are seen.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::format::Label;

use crate::render::Image;
use crate::render::annotate::{Entry, Ramp, Style};
use crate::scene::Seen;
use crate::text::shown;

/// A title, a legend, and the size of the picture within.
pub(super) struct Frame {
    /// Width and height, title and legend included.
    size: [u32; 2],
    style: Option<Style>,
    /// Colour behind the picture.
    ground: Option<[u8; 3]>,
    title: Option<String>,
    /// Entries of the legend, the largest first; `None` for no legend.
    legend: Option<Vec<(Seen, Entry)>>,
    /// The colours of values, in place of labels.
    ramp: Option<Ramp>,
    columns: u32,
    /// Most labels that the legend of a picture had no room for.
    unlisted: AtomicUsize,
}

impl Frame {
    /// A frame that fills this size, around a picture on a background (sRGB).
    pub(super) fn new(
        size: [u32; 2],
        ground: Option<[u8; 3]>,
        title: Option<String>,
        legend: Option<Vec<(Seen, Entry)>>,
        ramp: Option<Ramp>,
    ) -> Self {
        let style = Style::of(size, ground);
        let entries: Vec<Entry> = legend.iter().flatten().map(|(_, entry)| entry.clone()).collect();
        let columns = match (style, &ramp) {
            (Some(style), Some(ramp)) => style.ramp_columns(size[0], ramp),
            (Some(style), None) if !entries.is_empty() => style.legend_columns(size[0], &entries),
            _ => 0,
        };
        let (legend, ramp) = (legend.filter(|_| columns > 0), ramp.filter(|_| columns > 0));
        Self { size, style, ground, title, legend, ramp, columns, unlisted: AtomicUsize::new(0) }
    }

    /// Width and height of the picture without title and legend.
    pub(super) fn inner(&self) -> [u32; 2] {
        let rows = self.style.filter(|_| self.title.is_some()).map_or(0, Style::title_rows);
        [self.size[0] - self.columns, self.size[1] - rows]
    }

    /// Width and height, title and legend included.
    pub(super) fn size(&self) -> [u32; 2] {
        self.size
    }

    /// True if the picture has to be finished before any row can be written.
    pub(super) fn has_legend(&self) -> bool {
        self.legend.is_some() || self.ramp.is_some()
    }

    /// Most labels that the legend of a picture had no room for.
    pub(super) fn unlisted(&self) -> usize {
        self.unlisted.load(Ordering::Relaxed)
    }

    /// The strip above a picture with these layers.
    pub(super) fn title(&self, like: &Image) -> Option<Image> {
        Some(self.style?.title(like, self.title.as_deref()?))
    }

    /// A picture with its title and the labels that are seen; `None` for all.
    pub(super) fn around(&self, mut image: Image, seen: Option<&BTreeSet<Seen>>) -> Image {
        if let (Some(style), Some(ramp)) = (self.style, &self.ramp) {
            image = style.ramp(&image, self.columns, ramp);
        } else if let (Some(style), Some(legend)) = (self.style, &self.legend) {
            let is_seen = |key: &Seen| seen.is_none_or(|seen| seen.contains(key));
            let entries: Vec<Entry> =
                legend.iter().filter(|(key, _)| is_seen(key)).map(|(_, entry)| entry.clone()).collect();
            let unlisted = entries.len() - style.fitting(entries.len(), image.height);
            self.unlisted.fetch_max(unlisted, Ordering::Relaxed);
            image = style.legend(&image, self.columns, &entries);
        }
        captioned(self.title(&image), image)
    }

    /// A part of the picture with a caption of its own; `take` makes it in the size that the caption leaves.
    pub(super) fn with_caption<E>(
        &self,
        size: [u32; 2],
        caption: &str,
        take: impl FnOnce([u32; 2]) -> Result<Image, E>,
    ) -> Result<Image, E> {
        let Some(style) = Style::of(size, self.ground) else { return take(size) };
        let image = take([size[0], size[1] - style.title_rows()])?;
        Ok(captioned(Some(style.title(&image, caption)), image))
    }
}

/// A picture below a strip.
fn captioned(strip: Option<Image>, image: Image) -> Image {
    let Some(mut whole) = strip else { return image };
    whole.append(&image);
    whole
}

/// Legend entries of the labels of a model, the largest first; `model` is its number among the models of the picture.
pub(super) fn label_entries<'a>(model: usize, labels: impl Iterator<Item = &'a Label>) -> Vec<(Seen, Entry)> {
    let mut labels: Vec<&Label> = labels.collect();
    crate::order::by_key(&mut labels, |label| std::cmp::Reverse(label.voxels));
    let entry = |label: &Label| {
        let plain = format!("label {}", label.number);
        let name = if label.name.is_empty() { plain.clone() } else { shown(&label.name).to_string() };
        Entry { color: label.color, name, plain }
    };
    labels.into_iter().map(|label| ((model, label.number), entry(label))).collect()
}

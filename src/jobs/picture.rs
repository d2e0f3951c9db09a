//! `oct render` and `oct thumbnail`: a model or a scene on disk into pictures on disk.

use std::collections::BTreeSet;
use std::path::Path;

use serde::Serialize;

use super::frame::Frame;
use super::open_model::open_model;
use super::picture_memory::PictureMemory;
use super::picture_set::{self, FrameNames, PictureSet};
use super::render::{Bodies, RenderReport, RenderRequest, paint_parts, paint_whole, thumbnail_within};
use super::scene::OpenScene;
use crate::budget::{mapped_rss_bytes, peak_rss_bytes};
use crate::error::Error;
use crate::fault::usage;
#[cfg(feature = "python")]
use crate::load::Model;
use crate::progress::Progress;
use crate::render::image::{ImageFile, PngLayer, PngRows};
use crate::render::{Image, RenderError};
use crate::scene::Seen;
use crate::text::{data, shown, size_title};

/// Paths of the pictures of one call, and their layout.
#[derive(Clone, Copy, Debug)]
pub struct Outputs<'a> {
    /// The colours.
    pub image: &'a Path,
    /// The depth image, if one is wanted.
    pub depth: Option<&'a Path>,
    /// The normal image, if one is wanted.
    pub normals: Option<&'a Path>,
    /// The image of the numbers of boxes, if one is wanted.
    pub ids: Option<&'a Path>,
    /// Number and arrangement of the pictures in `image`; other images exist for a single picture only.
    pub shots: PictureSet,
    /// Text above the picture; an empty one stands for the name of the file and the size of what is shown of its model,
    /// before cuts.
    pub title: Option<&'a str>,
    /// True to list the visible labels on the picture's right; of a scene also its models without labels.
    pub legend: bool,
}

/// Destination of the colours.
pub(super) enum Target {
    /// Into one file.
    File(ImageFile),
    /// Files of these names, of which the first has been begun.
    Frames(FrameNames, ImageFile),
}

/// Files of pictures that have been begun.
pub(super) struct Layers {
    pub(super) image: Target,
    others: Vec<(ImageFile, PngLayer)>,
}

impl<'a> Outputs<'a> {
    /// Outputs of the colours alone.
    pub fn of(image: &'a Path) -> Self {
        Self {
            image,
            depth: None,
            normals: None,
            ids: None,
            shots: PictureSet::One,
            title: None,
            legend: false,
        }
    }

    /// All paths that are named.
    pub(super) fn all(&self) -> Vec<&'a Path> {
        [Some(self.image), self.depth, self.normals, self.ids].into_iter().flatten().collect()
    }

    /// Names of the frames and their number, for frames in several files.
    fn frames(&self) -> Option<(FrameNames, u32)> {
        match self.shots {
            PictureSet::Turntable(count) => Some((FrameNames::of(self.image)?, count)),
            _ => None,
        }
    }

    /// Refuses outputs that are the input or the same file.
    pub(super) fn refuse_clash(&self, input: &Path) -> Result<(), Error> {
        match self.frames() {
            Some((names, count)) => {
                (0..count).try_for_each(|number| refuse_clash(input, &[&names.file(number)]))
            }
            None => refuse_clash(input, &self.all()),
        }
    }

    /// Begins the files: a folder that cannot be written is reported before the work is done.
    pub(super) fn create(&self) -> Result<Layers, Error> {
        let image = match self.frames() {
            Some((names, _)) => names.begin()?,
            None => Target::File(ImageFile::create(self.image)?),
        };
        let named =
            [(self.depth, PngLayer::Depth), (self.normals, PngLayer::Normals), (self.ids, PngLayer::Ids)];
        let begin =
            |(path, layer): (Option<&Path>, _)| Some(ImageFile::create(path?).map(|file| (file, layer)));
        Ok(Layers { image, others: named.into_iter().filter_map(begin).collect::<Result<_, _>>()? })
    }
}

impl Layers {
    /// Writes a finished picture.
    pub(super) fn write(self, image: &Image) -> Result<(), Error> {
        let mut rows = self.begin([image.width, image.height])?;
        rows.put(image)?;
        rows.finish()
    }

    /// Begins pictures of this size, to be written in bands of rows.
    pub(super) fn begin(self, size: [u32; 2]) -> Result<LayerRows, Error> {
        // Frames of a turntable are written one by one.
        let (Target::File(image) | Target::Frames(_, image)) = self.image;
        let all = std::iter::once((image, PngLayer::Color)).chain(self.others);
        let begun = all.map(|(file, layer)| PngRows::begin(file, layer, size));
        Ok(LayerRows(begun.collect::<Result<_, _>>()?))
    }
}

/// Pictures with some of their rows written.
pub(super) struct LayerRows(Vec<PngRows>);

impl LayerRows {
    /// Writes more rows.
    pub(super) fn put(&mut self, part: &Image) -> Result<(), RenderError> {
        self.0.iter_mut().try_for_each(|rows| rows.put(part))
    }

    /// Commits the files.
    pub(super) fn finish(self) -> Result<(), Error> {
        Ok(self.0.into_iter().try_for_each(PngRows::finish)?)
    }
}

/// Renders the model or the scene at `path` to what is named in `outputs`.
///
/// The files are begun before the picture is: a folder that cannot be written is reported at once. One picture is made and
/// written band by band and is never held as a whole; several, and those with a legend, are held one at a time.
///
/// # Errors
/// The scene is wrong, a model cannot be used, the camera makes no sense, or a picture cannot be written.
pub fn render_file(
    path: &Path,
    outputs: &Outputs<'_>,
    request: &RenderRequest,
    progress: &dyn Progress,
) -> Result<RenderReport, Error> {
    outputs.refuse_clash(path)?;
    let scene = OpenScene::open(path, request)?;
    scene.paths().iter().try_for_each(|model| outputs.refuse_clash(model))?;
    let layers = outputs.create()?;
    let request = RenderRequest {
        depth: outputs.depth.is_some(),
        normals: outputs.normals.is_some(),
        ids: outputs.ids.is_some(),
        ..request.clone()
    };
    let begin = request.point.or(scene.view());
    scene.with((&request, outputs.legend), |bodies| {
        let whole = bodies.size(&request);
        let frame = frame_of(bodies, path, outputs, &request);
        let request = RenderRequest { size: Some(frame.inner()), ..request.clone() };
        let give_back = || scene.give_back();
        let held_pixels = outputs.shots.held_pixels(whole, frame.has_legend());
        let pages = (scene.bytes(), &give_back as &(dyn Fn() + Sync));
        let relief = PictureMemory::new(request.memory_bytes, request.threads, held_pixels, pages);
        let mut report = if outputs.shots == PictureSet::One && !frame.has_legend() {
            let mut rows = layers.begin(whole)?;
            let mut begun = false;
            let mut take = |part: &Image| {
                let title = if std::mem::replace(&mut begun, true) { None } else { frame.title(part) };
                title.map_or(Ok(()), |title| rows.put(&title))?;
                rows.put(part)
            };
            let (report, _) = paint_parts(bodies, &request, progress, &relief, &mut take)?;
            scene.check_unchanged()?;
            rows.finish()?;
            report
        } else {
            let mut report: Option<RenderReport> = None;
            picture_set::write(outputs.shots, layers, &frame, begin, progress, |shot, seen, progress| {
                let (size, point) = (Some(shot.size), shot.point.or(request.point));
                let request = RenderRequest { size, point, ..request.clone() };
                let (image, own, shown) = paint_whole(bodies, &request, progress, &relief)?;
                scene.check_unchanged()?;
                seen.extend(shown_of(bodies, &request, shown));
                report = Some(report.take().map_or(own.clone(), |all| all.and(&own)));
                Ok(image)
            })?;
            report.unwrap_or_default()
        };
        [report.width, report.height] = whole;
        report.unlisted = frame.unlisted();
        report.bytes_touched = if relief.gave_back() { None } else { scene.bytes_touched() };
        Ok(report)
    })
}

/// A picture in memory, with title and legend as in `outputs`, whose `image` is the model's path.
///
/// # Errors
/// The camera makes no sense, the plane of a slice does not meet the model, or the model has no labels for a legend.
#[cfg(feature = "python")]
pub(crate) fn framed<D: AsRef<[u8]>>(
    model: &Model<D>,
    outputs: &Outputs<'_>,
    request: &RenderRequest,
    progress: &dyn Progress,
) -> Result<Image, Error> {
    super::scene::with_model(outputs.image, model, (request, outputs.legend), |bodies| {
        let frame = frame_of(bodies, outputs.image, outputs, request);
        let request = RenderRequest { size: Some(frame.inner()), ..request.clone() };
        let (image, _, seen) = paint_whole(bodies, &request, progress, &PictureMemory::none())?;
        Ok(frame.around(image, Some(&shown_of(bodies, &request, seen))))
    })
}

/// Legend entries to show: the labels seen, or all where coarse boxes hold several labels.
fn shown_of(bodies: &Bodies<'_>, request: &RenderRequest, seen: BTreeSet<Seen>) -> BTreeSet<Seen> {
    match &bodies.legend {
        Some(legend) if request.lod && request.section.is_none() => {
            legend.iter().map(|(key, _)| *key).collect()
        }
        _ => seen,
    }
}

/// Title and legend around a picture.
fn frame_of(bodies: &Bodies<'_>, path: &Path, outputs: &Outputs<'_>, request: &RenderRequest) -> Frame {
    let support = |direction| {
        let all = bodies.parts.iter().map(|part| part.support_of_inside(direction));
        let most = all.fold(f64::NEG_INFINITY, f64::max);
        if most.is_finite() { most } else { bodies.support(direction) }
    };
    let title = match outputs.title {
        Some("") => {
            let is_cut = request.section.is_some() || bodies.parts.iter().any(|part| !part.clip.is_empty());
            let uncut = if is_cut { " (uncut)" } else { "" };
            Some(size_title(shown(path.file_stem().unwrap_or_default()), support) + uncut)
        }
        title => title.map(|text| shown(text).to_string()),
    };
    let (size, ground) = (bodies.size(request), bodies.ground(request));
    Frame::new(size, ground, title, bodies.legend.clone(), bodies.ramp.clone())
}

/// Writes a square thumbnail of the model at `model` to `output`.
///
/// # Errors
/// The model cannot be used, or the picture cannot be written.
pub fn thumbnail_file(model: &Path, output: &Path, size: u32, threads: usize) -> Result<RenderReport, Error> {
    thumbnail_within_pages(model, output, (size, threads), u64::MAX)
}

/// [`thumbnail_file`] with so many bytes of the model's pages in the process, and the growth in one step of each
/// thread.
pub(super) fn thumbnail_within_pages(
    model: &Path,
    output: &Path,
    (size, threads): (u32, usize),
    pages_bytes: u64,
) -> Result<RenderReport, Error> {
    refuse_clash(model, &[output])?;
    let path = model;
    let model = open_model(path)?;
    let output = ImageFile::create(output)?;
    let give_back = || model.give_back();
    let relief = PictureMemory::of_pages(pages_bytes, threads, (model.bytes(), &give_back));
    let space = (model.dims(), &model.affine());
    let (image, mut report) = thumbnail_within(&model.view(), space, (size, threads), &relief)?;
    report.bytes_touched = if relief.gave_back() { None } else { mapped_rss_bytes(model.bytes()) };
    model.check_unchanged(path)?;
    image.write_layer_to(output, PngLayer::Color)?;
    Ok(report)
}

/// A picture, or several, of a model or a scene, in files.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct PictureReport {
    /// Input as named on the command line; several separated by blanks; `-` for standard input.
    pub input: String,
    /// Output as named on the command line.
    pub output: String,
    /// Size, rays and times.
    #[serde(flatten)]
    pub picture: RenderReport,
    /// Sentences about the input: assumptions, parts left out, oddities.
    pub warnings: Vec<String>,
    /// Peak resident memory of the process.
    pub peak_rss_bytes: u64,
}

impl PictureReport {
    /// The report of a finished picture.
    pub fn new(input: &Path, output: &Path, picture: RenderReport, warnings: Vec<String>) -> Self {
        let (input, output) = (data(input), data(output));
        Self { input, output, picture, warnings, peak_rss_bytes: peak_rss_bytes() }
    }
}

/// Refuses outputs that would replace the model or another picture of the same call.
pub(super) fn refuse_clash(model: &Path, outputs: &[&Path]) -> Result<(), Error> {
    let same = |a: &Path, b: &Path| {
        a == b || matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
    };
    for (at, output) in outputs.iter().enumerate() {
        if same(output, model) {
            let fault = usage!("is the model and would be replaced by a picture; name another file");
            return Err(fault.at(*output).into());
        }
        if outputs[..at].iter().any(|other| same(output, other)) {
            let fault = usage!("two pictures would be written to it; name another file for one of them");
            return Err(fault.at(*output).into());
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_do_not_replace_the_model_or_each_other() {
        let clash = |outputs: &[&str]| {
            let outputs: Vec<&Path> = outputs.iter().map(Path::new).collect();
            refuse_clash(Path::new("m.oct"), &outputs).is_err()
        };
        assert!(clash(&["m.oct"]) && clash(&["a.png", "m.oct"]) && clash(&["a.png", "a.png"]));
        assert!(!clash(&["a.png", "b.png", "c.png"]));
    }
}

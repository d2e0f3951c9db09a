//! `oct render` and `oct thumbnail`: a model on disk into pictures on disk.

use std::path::Path;

use serde::Serialize;

use super::frame::{Frame, label_entries, seen_labels, size_title};
use super::opened::open_model;
use super::relief::Relief;
use super::render::{RenderReport, RenderRequest, render_view_parts, render_view_relieved, thumbnail};
use super::shots::{self, FrameNames, Shots};
use crate::budget::{mapped_rss_bytes, peak_rss_bytes};
use crate::error::{Error, UsageError};
use crate::load::Model;
use crate::progress::Progress;
use crate::render::image::{ImageFile, PngLayer, PngRows};
use crate::render::{GridSpace, Image, RenderError};
use crate::text::{data, shown};

/// Where the pictures of one call go.
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
    /// How many pictures `image` holds; there are no other images of several.
    pub shots: Shots,
    /// A text above the picture; an empty one for the name of the file and the size of what it shows.
    pub title: Option<&'a str>,
    /// List the labels that are seen on the picture's right; of a scene also its models without labels.
    pub legend: bool,
}

/// Where the colours go.
pub(super) enum Target {
    /// Into one file.
    File(ImageFile),
    /// Into files of these names, of which the first is begun.
    Frames(FrameNames, ImageFile),
}

/// Pictures that are begun.
pub(super) struct Layers {
    pub(super) image: Target,
    depth: Option<ImageFile>,
    normals: Option<ImageFile>,
    ids: Option<ImageFile>,
}

impl<'a> Outputs<'a> {
    /// The colours alone.
    pub fn of(image: &'a Path) -> Self {
        Self { image, depth: None, normals: None, ids: None, shots: Shots::One, title: None, legend: false }
    }

    /// All that are named.
    pub(super) fn all(&self) -> Vec<&'a Path> {
        [Some(self.image), self.depth, self.normals, self.ids].into_iter().flatten().collect()
    }

    /// The title of a picture of something with this support.
    pub(super) fn title_of(&self, path: &Path, support: impl Fn([f64; 3]) -> f64) -> Option<String> {
        match self.title {
            Some("") => Some(size_title(path.file_stem().unwrap_or_default(), support)),
            title => title.map(|text| shown(text).to_string()),
        }
    }

    /// Names of the frames, if there are several files of them.
    fn frames(&self) -> Option<(FrameNames, u32)> {
        match self.shots {
            Shots::Turntable(count) => Some((FrameNames::of(self.image)?, count)),
            _ => None,
        }
    }

    /// Refuses names that are the input's, or each other's.
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
        Ok(Layers {
            image: match self.frames() {
                Some((names, _)) => names.begin()?,
                None => Target::File(ImageFile::create(self.image)?),
            },
            depth: self.depth.map(ImageFile::create).transpose()?,
            normals: self.normals.map(ImageFile::create).transpose()?,
            ids: self.ids.map(ImageFile::create).transpose()?,
        })
    }
}

impl Layers {
    /// Writes a picture that is finished.
    pub(super) fn write(self, image: &Image) -> Result<(), Error> {
        let mut rows = self.begin([image.width, image.height])?;
        rows.put(image)?;
        rows.finish()
    }

    /// Begins pictures of this size.
    pub(super) fn begin(self, size: [u32; 2]) -> Result<LayerRows, Error> {
        // Frames of a turntable are written one by one.
        let (Target::File(image) | Target::Frames(_, image)) = self.image;
        let named = [
            (Some(image), PngLayer::Color),
            (self.depth, PngLayer::Depth),
            (self.normals, PngLayer::Normals),
            (self.ids, PngLayer::Ids),
        ];
        let begin =
            |(file, layer): (Option<ImageFile>, _)| file.map(|file| PngRows::begin(file, layer, size));
        Ok(LayerRows(named.into_iter().filter_map(begin).collect::<Result<_, _>>()?))
    }
}

/// Pictures of which some rows are written.
pub(super) struct LayerRows(Vec<PngRows>);

impl LayerRows {
    /// Writes some more.
    pub(super) fn put(&mut self, part: &Image) -> Result<(), RenderError> {
        self.0.iter_mut().try_for_each(|rows| rows.put(part))
    }

    /// Puts the files in their places.
    pub(super) fn finish(self) -> Result<(), Error> {
        Ok(self.0.into_iter().try_for_each(PngRows::finish)?)
    }
}

/// Renders the model at `model` to what is named in `outputs`.
///
/// The files are begun before the picture is: a folder that cannot be written is reported at once. One picture is made and
/// written band by band and is never held as a whole; several are held one at a time.
///
/// # Errors
/// The model cannot be used, the camera makes no sense, or a picture cannot be written.
pub fn render_file(
    model: &Path,
    outputs: &Outputs<'_>,
    request: &RenderRequest,
    progress: &dyn Progress,
) -> Result<RenderReport, Error> {
    outputs.refuse_clash(model)?;
    let path = model;
    let model = open_model(path)?;
    let layers = outputs.create()?;
    let request = RenderRequest {
        depth: outputs.depth.is_some(),
        normals: outputs.normals.is_some(),
        ids: outputs.ids.is_some() || outputs.legend,
        ..*request
    };
    let (view, dims, affine) = (model.view(), model.dims(), model.affine());
    let whole = [request.width, request.height];
    crate::render::picture::check_size(whole[0], whole[1])?;
    let frame = frame_of(&model, path, outputs, &request)?;
    let size = frame.inner();
    let request = RenderRequest { width: size[0], height: size[1], ..request };
    let give_back = || model.give_back();
    let held_pixels = outputs.shots.held_pixels(whole, frame.has_legend());
    let pages = (model.bytes().len() as u64, &give_back as &(dyn Fn() + Sync));
    let relief = Relief::new(request.memory_bytes, request.threads, held_pixels, pages);
    let touched = || if relief.gave_back() { None } else { mapped_rss_bytes(model.bytes()) };
    let mut report = if outputs.shots == Shots::One && !frame.has_legend() {
        let mut rows = layers.begin(whole)?;
        let mut begun = false;
        let mut take = |part: &Image| {
            let title = if std::mem::replace(&mut begun, true) { None } else { frame.title(part) };
            title.map_or(Ok(()), |title| rows.put(&title))?;
            rows.put(part)
        };
        let report = render_view_parts(&view, dims, &affine, &request, progress, &relief, &mut take)?;
        model.check_unchanged(path)?;
        rows.finish()?;
        report
    } else {
        let mut report: Option<RenderReport> = None;
        shots::write(
            outputs.shots,
            layers,
            &frame,
            Some(request.point),
            progress,
            |shot, seen, progress| {
                let ([width, height], point) = (shot.size, shot.point.unwrap_or(request.point));
                let request = RenderRequest { width, height, point, ..request };
                let (image, own) = render_view_relieved(&view, dims, &affine, &request, progress, &relief)?;
                model.check_unchanged(path)?;
                match request.lod {
                    // Coarse boxes have several.
                    true => seen.extend(model.frame().labels.iter().map(|label| (0, label.number))),
                    false => seen_labels(&image, seen),
                }
                report = Some(report.take().map_or(own.clone(), |all| all.and(&own)));
                Ok(image)
            },
        )?;
        report.unwrap_or_default()
    };
    [report.width, report.height] = whole;
    report.bytes_touched = touched();
    Ok(report)
}

/// A picture in memory, with title and legend as `outputs` says, whose `image` is the model's path.
///
/// # Errors
/// The camera makes no sense, or the model has no labels for a legend.
#[cfg(feature = "python")]
pub(crate) fn framed<D: AsRef<[u8]>>(
    model: &Model<D>,
    outputs: &Outputs<'_>,
    request: &RenderRequest,
    progress: &dyn Progress,
) -> Result<Image, Error> {
    crate::render::picture::check_size(request.width, request.height)?;
    let frame = frame_of(model, outputs.image, outputs, request)?;
    let [width, height] = frame.inner();
    let request = RenderRequest { width, height, ids: outputs.legend, ..*request };
    let view = model.view();
    let (image, _) =
        super::render::render_view_watched(&view, model.dims(), &model.affine(), &request, progress)?;
    let mut seen = std::collections::BTreeSet::new();
    seen_labels(&image, &mut seen);
    // Coarse boxes have several labels.
    Ok(frame.around(image, Some(&seen).filter(|_| !request.lod)))
}

/// What is written around the picture of a model.
fn frame_of<D: AsRef<[u8]>>(
    model: &Model<D>,
    path: &Path,
    outputs: &Outputs<'_>,
    request: &RenderRequest,
) -> Result<Frame, Error> {
    let labels = &model.frame().labels;
    if outputs.legend && labels.is_empty() {
        return Err(UsageError::NoLegend { path: path.to_path_buf() }.into());
    }
    let space = GridSpace::new(model.dims(), &model.affine())?;
    let title = outputs.title_of(path, |direction| space.support(&model.view(), direction));
    let legend = outputs.legend.then(|| label_entries(0, labels.iter()));
    Ok(Frame::new([request.width, request.height], request.background, title, legend))
}

/// Writes a square thumbnail of the model at `model` to `output`.
///
/// # Errors
/// The model cannot be used, or the picture cannot be written.
pub fn thumbnail_file(model: &Path, output: &Path, size: u32, threads: usize) -> Result<RenderReport, Error> {
    refuse_clash(model, &[output])?;
    let path = model;
    let model = open_model(path)?;
    let output = ImageFile::create(output)?;
    let (image, mut report) = thumbnail(&model.view(), model.dims(), &model.affine(), size, threads)?;
    report.bytes_touched = mapped_rss_bytes(model.bytes());
    model.check_unchanged(path)?;
    image.write_layer_to(output, PngLayer::Color)?;
    Ok(report)
}

/// A picture, or several, of a model or a scene, in files.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct PictureReport<R> {
    /// Input as named on the command line; several separated by blanks; `-` for standard input.
    pub input: String,
    /// Output as named on the command line.
    pub output: String,
    /// Size, rays and times.
    #[serde(flatten)]
    pub picture: R,
    /// Sentences about the input: assumptions, parts left out, oddities.
    pub warnings: Vec<String>,
    /// Peak resident memory of the process.
    pub peak_rss_bytes: u64,
}

impl<R> PictureReport<R> {
    /// The report of a picture that is finished now.
    pub fn new(input: &Path, output: &Path, picture: R, warnings: Vec<String>) -> Self {
        let (input, output) = (data(input), data(output));
        Self { input, output, picture, warnings, peak_rss_bytes: peak_rss_bytes() }
    }
}

/// A picture never takes the place of the model, nor of another picture of the same call.
pub(super) fn refuse_clash(model: &Path, outputs: &[&Path]) -> Result<(), Error> {
    let same = |a: &Path, b: &Path| {
        a == b || matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
    };
    for (at, output) in outputs.iter().enumerate() {
        if same(output, model) {
            return Err(UsageError::ReplacesModel { path: output.to_path_buf() }.into());
        }
        if outputs[..at].iter().any(|other| same(output, other)) {
            return Err(UsageError::NamedTwice { path: output.to_path_buf() }.into());
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

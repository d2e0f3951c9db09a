//! Several pictures of one call: six sides on a sheet; a turntable in one file or in many.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use super::frame::Frame;
use super::picture::{Layers, Target};
use crate::error::Error;
use crate::progress::Progress;
use crate::render::image::{ImageFile, PngLayer};
use crate::render::{Image, NamedView, ViewPoint};
use crate::scene::Seen;

/// Number and arrangement of the pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PictureSet {
    /// One picture.
    #[default]
    One,
    /// Six sides on one sheet.
    Contact,
    /// So many pictures, all around: an animated PNG, or a GIF by the output's name; or a file for each, where the
    /// output is a folder, ends with a slash, or has a number's place in its name, as `turn-%03d.png` has.
    Turntable(u32),
}

/// Names of the frames of a turntable.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum FrameNames {
    /// `0000.png` and so on in a folder.
    In(PathBuf),
    /// A number between the parts of a name, of at least so many digits.
    Numbered { folder: PathBuf, before: String, digits: usize, after: String },
}

/// Digits of a frame's number in a folder: there are at most 3600 of them.
const DIGITS: usize = 4;

impl FrameNames {
    /// Names by an output; `None` for a single file.
    pub(super) fn of(output: &Path) -> Option<Self> {
        if output.as_os_str().as_encoded_bytes().ends_with(b"/") || output.is_dir() {
            return Some(Self::In(output.to_path_buf()));
        }
        let name = output.file_name()?.to_str()?;
        let (before, rest) = name.split_once('%')?;
        let (digits, after) = rest.split_once('d')?;
        let digits = match digits.strip_prefix('0') {
            Some(digits) => digits.parse().ok().filter(|digits| *digits < 10)?,
            None if digits.is_empty() => 1,
            None => return None,
        };
        let folder = output.parent().map(Path::to_path_buf).unwrap_or_default();
        Some(Self::Numbered { folder, before: before.into(), digits, after: after.into() })
    }

    /// The file of a frame, counted from 0.
    pub(super) fn file(&self, number: u32) -> PathBuf {
        match self {
            Self::In(folder) => folder.join(format!("{number:0DIGITS$}.png")),
            Self::Numbered { folder, before, digits, after } => {
                folder.join(format!("{before}{number:0digits$}{after}"))
            }
        }
    }

    /// Makes the folder, whose parent must exist.
    fn make_folder(&self) -> Result<(), Error> {
        match self {
            Self::In(folder) if !folder.is_dir() => {
                fs::create_dir(folder).map_err(|cause| Error::Output { path: folder.clone(), cause })
            }
            _ => Ok(()),
        }
    }

    /// Begins the first frame, so that a folder that cannot be written is reported at once.
    pub(super) fn begin(self) -> Result<Target, Error> {
        self.make_folder()?;
        let first = ImageFile::create(&self.file(0))?;
        Ok(Target::Frames(self, first))
    }
}

/// The sides on a sheet, row by row.
const SHEET: [[NamedView; 3]; 2] = [
    [NamedView::Front, NamedView::Left, NamedView::Top],
    [NamedView::Back, NamedView::Right, NamedView::Bottom],
];

/// Milliseconds of a whole turn.
const TURN_MS: u32 = 6000;

impl PictureSet {
    /// Pixels of whole pictures that are in memory at a time, for pictures of this size.
    pub(super) fn held_pixels(self, [width, height]: [u32; 2], legend: bool) -> u64 {
        let one = u64::from(width) * u64::from(height);
        // Numbers of boxes are held, too, and the picture again with the legend.
        let labelled = if legend { 5 * one } else { 0 };
        labelled
            + match self {
                // Made and written in bands.
                Self::One => 0,
                // A picture, and its compressed form, which is no larger.
                Self::Turntable(_) => 2 * one,
                // The sheet, and one side of it.
                Self::Contact => one + one / 6,
            }
    }

    /// Rows of all pictures, for pictures of so many rows.
    fn rows(self, height: u32) -> u64 {
        match self {
            Self::One => height.into(),
            Self::Contact => 6 * u64::from((height / 2).max(1)),
            Self::Turntable(count) => u64::from(count) * u64::from(height),
        }
    }
}

/// A watcher that counts several pictures as one piece of work.
struct Several<'a>(&'a dyn Progress);

impl Progress for Several<'_> {
    fn stage(&self, _: &'static str, _: u64) {}

    fn advance(&self, steps: u64) {
        self.0.advance(steps);
    }

    fn stopped(&self) -> bool {
        self.0.stopped()
    }
}

/// One picture: the position of the camera, unless it is the usual one, and the size.
pub(super) struct Shot {
    pub(super) point: Option<ViewPoint>,
    pub(super) size: [u32; 2],
}

/// Makes the pictures of one call and writes them; `take` makes one. A turntable begins at the named view.
pub(super) fn write(
    shots: PictureSet,
    layers: Layers,
    frame: &Frame,
    begin: Option<ViewPoint>,
    progress: &dyn Progress,
    mut take: impl FnMut(&Shot, &mut BTreeSet<Seen>, &dyn Progress) -> Result<Image, Error>,
) -> Result<(), Error> {
    let size = frame.inner();
    progress.stage("render", shots.rows(size[1]));
    let several = Several(progress);
    let mut seen = BTreeSet::new();
    if shots == PictureSet::One {
        let image = take(&Shot { point: None, size }, &mut seen, progress)?;
        return layers.write(&frame.around(image, Some(&seen)));
    }
    let mut at = |point, size| take(&Shot { point: Some(point), size }, &mut seen, &several);
    match shots {
        PictureSet::One | PictureSet::Contact => {
            let sheet = sheet(size, |view, size| {
                let point = ViewPoint::Named(view);
                frame.with_caption(size, view.name(), |size| at(point, size))
            })?;
            layers.write(&frame.around(sheet, Some(&seen)))
        }
        PictureSet::Turntable(count) => {
            let view = match begin {
                Some(ViewPoint::Named(view)) => view,
                _ => NamedView::Front,
            };
            let place = |number: u32| {
                let degrees = 360.0 * f64::from(number) / f64::from(count);
                ViewPoint::Turned { view, degrees }
            };
            // All labels: the visible ones would change from picture to picture.
            let mut picture = |number| Ok(frame.around(at(place(number), size)?, None));
            match layers.image {
                Target::File(file) => Image::write_frames_to(file, frame.size(), count, TURN_MS, picture),
                Target::Frames(names, first) => {
                    let mut begun = Some(first);
                    for number in 0..count {
                        let image: Image = picture(number)?;
                        let file = begun.take().map_or_else(|| ImageFile::create(&names.file(number)), Ok)?;
                        image.write_layer_to(file, PngLayer::Color)?;
                    }
                    Ok(())
                }
            }
        }
    }
}

/// Six sides of a subject on a sheet of this size; `take` makes a picture.
fn sheet(
    [width, height]: [u32; 2],
    mut take: impl FnMut(NamedView, [u32; 2]) -> Result<Image, Error>,
) -> Result<Image, Error> {
    let size @ [wide, high] = [(width / 3).max(1), (height / 2).max(1)];
    let (width, height) = (width.max(3), height.max(2));
    let mut sheet = Image::blank([width, height], [false; 3]);
    for (down, views) in SHEET.into_iter().enumerate() {
        for (across, view) in views.into_iter().enumerate() {
            let image = take(view, size)?;
            for (y, row) in image.rgba.chunks(wide as usize * 4).enumerate() {
                let at = ((down * high as usize + y) * width as usize + across * wide as usize) * 4;
                if let Some(out) = sheet.rgba.get_mut(at..at + row.len()) {
                    out.copy_from_slice(row);
                }
            }
        }
    }
    Ok(sheet)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_go_into_a_folder_or_where_a_number_has_its_place() {
        let file = |output: &str, number| FrameNames::of(Path::new(output)).map(|names| names.file(number));
        let named = |name: &str| Some(PathBuf::from(name));
        assert_eq!(file("new/", 7), named("new/0007.png"));
        assert_eq!(file("a/turn-%03d.png", 7), named("a/turn-007.png"));
        assert_eq!(file("%d.png", 12), named("12.png"));
        let here = tempfile::tempdir().unwrap();
        assert_eq!(FrameNames::of(here.path()).unwrap().file(0), here.path().join("0000.png"));
        for one in ["turn.png", "100%.png", "50%off.d", "%3d.png", "%0x3d.png", "a%d/b.png", "-"] {
            assert_eq!(file(one, 1), None, "{one}");
        }
    }
}

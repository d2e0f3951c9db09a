//! Several pictures in one file: six sides on a sheet, or a turntable.

use super::picture::Layers;
use crate::error::Error;
use crate::progress::Progress;
use crate::render::annotate::caption;
use crate::render::image::ImageFile;
use crate::render::{Image, NamedView, ViewPoint};

/// Which pictures are made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Shots {
    /// One.
    #[default]
    One,
    /// Six sides on one sheet.
    Contact,
    /// So many, all around, as an animated PNG.
    Turntable(u32),
}

/// The sides on a sheet, row by row.
const SHEET: [[NamedView; 3]; 2] = [
    [NamedView::Front, NamedView::Left, NamedView::Top],
    [NamedView::Back, NamedView::Right, NamedView::Bottom],
];

/// Milliseconds of a whole turn.
const TURN_MS: u32 = 6000;

impl Shots {
    /// Rows of all pictures, where one has so many.
    fn rows(self, height: u32) -> u64 {
        match self {
            Self::One => height.into(),
            Self::Contact => 6 * u64::from((height / 2).max(1)),
            Self::Turntable(count) => u64::from(count) * u64::from(height),
        }
    }
}

/// A watcher of several pictures as of one piece of work.
struct Several<'a>(&'a dyn Progress);

impl Progress for Several<'_> {
    fn stage(&self, _: &'static str, _: u64) {}

    fn advance(&self, steps: u64) {
        self.0.advance(steps);
    }
}

/// What is asked of one picture: where the camera stands, if it does not stand where it would; and the size.
pub(super) struct Shot {
    pub(super) point: Option<ViewPoint>,
    pub(super) size: [u32; 2],
}

/// Makes the pictures of one call and writes them; `take` makes one. A turntable begins at the view named.
pub(super) fn write(
    shots: Shots,
    layers: Layers,
    size: [u32; 2],
    begin: Option<ViewPoint>,
    progress: &dyn Progress,
    mut take: impl FnMut(&Shot, &dyn Progress) -> Result<Image, Error>,
) -> Result<(), Error> {
    progress.stage("render", shots.rows(size[1]));
    let several = Several(progress);
    let mut at = |point, size| take(&Shot { point: Some(point), size }, &several);
    match shots {
        Shots::One => layers.write(&take(&Shot { point: None, size }, progress)?),
        Shots::Contact => layers.write(&sheet(size, at)?),
        Shots::Turntable(count) => {
            let view = match begin {
                Some(ViewPoint::Named(view)) => view,
                _ => NamedView::Front,
            };
            turntable(layers.image, size, count, view, &mut at)
        }
    }
}

/// Six sides of one thing on a sheet of this size; `take` makes a picture.
fn sheet(
    [width, height]: [u32; 2],
    mut take: impl FnMut(ViewPoint, [u32; 2]) -> Result<Image, Error>,
) -> Result<Image, Error> {
    let size @ [wide, high] = [(width / 3).max(1), (height / 2).max(1)];
    let (width, height) = (width.max(3), height.max(2));
    let bytes = width as usize * height as usize * 4;
    let mut sheet = Image { width, height, rgba: vec![0; bytes], depth: None, normals: None, ids: None };
    for (down, views) in SHEET.into_iter().enumerate() {
        for (across, view) in views.into_iter().enumerate() {
            let mut image = take(ViewPoint::Named(view), size)?;
            caption(&mut image, &view.name().to_uppercase());
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

/// All around one thing, from a named view on; `take` makes a picture.
fn turntable(
    file: ImageFile,
    size: [u32; 2],
    count: u32,
    view: NamedView,
    mut take: impl FnMut(ViewPoint, [u32; 2]) -> Result<Image, Error>,
) -> Result<(), Error> {
    let each_ms = u16::try_from(TURN_MS / count.max(1)).unwrap_or(u16::MAX).max(1);
    Image::write_frames_to(file, size, count, each_ms, |number| {
        let degrees = 360.0 * f64::from(number) / f64::from(count);
        take(ViewPoint::Turned { view, degrees }, size)
    })
}

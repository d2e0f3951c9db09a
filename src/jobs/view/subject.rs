//! The model or scene in view: its page, and pictures of it.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::Refused;
use crate::error::Error;
use crate::jobs::export::{STILL, still};
use crate::jobs::open_model::open_model;
use crate::jobs::render::RenderRequest;
use crate::jobs::scene::{OpenScene, is_scene, picture_of};
use crate::jobs::verify::verify_unless_packed;
use crate::load::Model;
use crate::page::{self, Shown, Transport};
use crate::progress::Silent;
use crate::render::{GridSpace, Image, Projection, ViewPoint};
use crate::scene::LabelRule;
use crate::text::data;

/// Most pixels along a side of a picture, and in all: as many as the largest screens have.
const MAX_SIDE: u32 = 4096;
const MAX_PIXELS: u32 = 1 << 23;

/// Kind of a subject.
enum What {
    Model(Box<Model>),
    Scene(Box<OpenScene>),
}

/// A model or a scene, open.
pub(super) struct Subject {
    path: PathBuf,
    what: What,
}

impl Subject {
    /// Opens a model or a scene, and checks a model's every byte.
    ///
    /// # Errors
    /// It is not what its name says, or damaged.
    pub(super) fn open(path: &Path) -> Result<Self, Error> {
        let what = if is_scene(path) {
            What::Scene(Box::new(OpenScene::open(path, &RenderRequest::default())?))
        } else {
            verify_unless_packed(path)?;
            What::Model(Box::new(open_model(path)?))
        };
        Ok(Self { path: path.to_path_buf(), what })
    }

    /// The picture of a camera as [`picture`] reads it, as a PNG.
    pub(super) fn picture(&self, camera: &str) -> Result<Vec<u8>, Refused> {
        let wrong = || Refused::because(400, "not a camera");
        let mut request = picture(camera).ok_or_else(wrong)?;
        let image = match &self.what {
            What::Scene(scene) => {
                request.labels.clear();
                scene.picture(&request)
            }
            What::Model(model) => picture_of(&self.path, model, &request, &Silent).map(|(image, _)| image),
        };
        self.check_unchanged()?;
        png(&image.map_err(|_| wrong())?)
    }

    /// A picture of so many pixels a side, as a PNG.
    pub(super) fn still(&self, side: u32) -> Result<Vec<u8>, Refused> {
        let failed = |error: Error| Refused::because(500, error);
        let still = match &self.what {
            What::Model(model) => still(model, side, &[], &Silent).map_err(failed),
            What::Scene(scene) => {
                let request = RenderRequest { size: Some([side; 2]), threads: 1, ..RenderRequest::default() };
                scene.picture(&request).map_err(failed).and_then(|image| png(&image))
            }
        };
        self.check_unchanged()?;
        still
    }

    /// Writes its page.
    pub(super) fn write_page(&self, out: &mut dyn Write) -> Result<(), Refused> {
        let failed = |error: Error| Refused::because(500, error);
        let picture = self.still(STILL)?;
        let title = self.path.file_stem().map_or_else(String::new, |stem| data(Path::new(stem)));
        match &self.what {
            What::Model(model) => {
                let space =
                    GridSpace::new(model.dims(), &model.affine()).map_err(|error| failed(error.into()))?;
                let is_large = model.header().file_bytes > page::MAX_BYTES
                    || model.frame().labels.len() > page::MAX_LABELS;
                let way = if is_large { Transport::Pictures } else { Transport::Served };
                page::write(&Shown::Model(model, &space, String::new()), &title, &picture, way, out)?;
            }
            What::Scene(scene) => {
                let shown = Shown::<&[u8]>::Scene(scene.extent().map_err(failed)?, scene.start());
                page::write(&shown, &title, &picture, Transport::Pictures, out)?;
            }
        }
        self.check_unchanged()
    }

    /// # Errors
    /// Its file was changed since it was opened.
    pub(super) fn check_unchanged(&self) -> Result<(), Refused> {
        let changed = |error| Refused::because(410, Error::from(error));
        match &self.what {
            What::Model(model) => model.check_unchanged(&self.path).map_err(changed),
            // A scene checks its own files.
            What::Scene(_) => Ok(()),
        }
    }
}

fn png(image: &Image) -> Result<Vec<u8>, Refused> {
    let mut png = Vec::new();
    image.write_png_to(&mut png)?;
    Ok(png)
}

/// The picture of an address such as `f=0,1,0&u=0,0,1&t=0,0,0&h=120&p=1&w=640&s=480`: view in the page's format, width
/// and height, and `x=5,7..20` for hidden labels; `None` for an invalid one.
fn picture(text: &str) -> Option<RenderRequest> {
    let value = |name: &str| text.split('&').find_map(|part| part.strip_prefix(name)?.strip_prefix('='));
    let point = |name| -> Option<[f64; 3]> {
        let numbers: Vec<f64> = value(name)?.split(',').map(str::parse).collect::<Result<_, _>>().ok()?;
        numbers.try_into().ok()
    };
    let side = |name| value(name)?.parse::<u32>().ok().filter(|side| (1..=MAX_SIDE).contains(side));
    let (forward, up, target) = (point("f")?, point("u")?, point("t")?);
    let half: f64 = value("h")?.parse().ok()?;
    let (width, height) = (side("w")?, side("s")?);
    if width * height > MAX_PIXELS {
        return None;
    }
    let length = forward.iter().map(|c| c * c).sum::<f64>().sqrt();
    let distance = half / (page::FOV_DEG / 2.0).to_radians().tan();
    let eye = std::array::from_fn(|a| target[a] - distance * forward[a] / length);
    let is_perspective = value("p") == Some("1");
    let hide = |text: &str| Some(LabelRule { labels: text.parse().ok()?, opacity: 0.0 });
    let labels = value("x").map_or(Some(Vec::new()), |text| text.split(',').map(hide).collect())?;
    Some(RenderRequest {
        size: Some([width, height]),
        point: Some(ViewPoint::Free { eye, look_at: target, up: Some(up) }),
        projection: Some(if is_perspective { Projection::Perspective } else { Projection::Parallel }),
        fov_deg: Some(page::FOV_DEG),
        labels,
        ..RenderRequest::default()
    })
}

//! A volume that is computed where it is read: a gyroid, as a function of the position. Nothing of it is ever stored.
//!
//! `cargo run --release --example function [FOLDER]` writes `gyroid.oct` and `gyroid.png`.

use std::ops::Range;
use std::path::{Path, PathBuf};

use infobyte::volume::{SourceDescription, SourceError};
use infobyte::{
    Affine, BuildOptions, Dims, Error, Model, RenderRequest, Rescale, ScalarType, Threshold, VolumeInfo,
    VolumeSource,
};

/// Voxels along each axis.
const SIDE: u32 = 192;
/// Distance of voxels in mm.
const SPACING_MM: f64 = 0.25;

/// A gyroid of 16 mm within a ball; above 0 is inside.
fn depth([x, y, z]: [f64; 3]) -> f64 {
    let middle = f64::from(SIDE) * SPACING_MM / 2.0;
    let [a, b, c] = [x, y, z].map(|mm| mm * std::f64::consts::TAU / 16.0);
    let wall = 0.4 - (a.sin() * b.cos() + b.sin() * c.cos() + c.sin() * a.cos()).abs();
    let ball = 0.95 * middle - [x, y, z].map(|mm| (mm - middle).powi(2)).iter().sum::<f64>().sqrt();
    wall.min(ball)
}

struct Gyroid(VolumeInfo);

impl Gyroid {
    fn new(dims: Dims) -> Self {
        Self(VolumeInfo {
            dims,
            scalar: ScalarType::F32,
            rescale: Rescale::IDENTITY,
            spacing_mm: [SPACING_MM; 3],
            affine: Affine::from_spacing([SPACING_MM; 3]),
            description: SourceDescription { name: "gyroid".into(), ..SourceDescription::default() },
            notes: Vec::new(),
        })
    }
}

impl VolumeSource for Gyroid {
    fn info(&self) -> &VolumeInfo {
        &self.0
    }

    fn read_rows(
        &self,
        z: u32,
        rows: Range<u32>,
        cols: Range<u32>,
        out: &mut [u8],
    ) -> Result<(), SourceError> {
        let voxels = rows.flat_map(|y| cols.clone().map(move |x| [x, y, z]));
        for (voxel, out) in voxels.zip(out.chunks_exact_mut(4)) {
            #[expect(clippy::cast_possible_truncation, reason = "samples of 32 bits")]
            let sample = depth(voxel.map(|i| f64::from(i) * SPACING_MM)) as f32;
            out.copy_from_slice(bytemuck::bytes_of(&sample));
        }
        Ok(())
    }
}

fn main() -> Result<(), Error> {
    let folder = PathBuf::from(std::env::args_os().nth(1).unwrap_or_else(|| ".".into()));
    make(&folder)
}

/// Builds the model in a folder, and makes a picture of it.
pub(crate) fn make(folder: &Path) -> Result<(), Error> {
    let gyroid = Gyroid::new(Dims::new(SIDE, SIDE, SIDE).expect("sides of 1 to 65536"));
    let options = BuildOptions { threshold: Threshold::Iso(0.0), ..BuildOptions::default() };
    let report = infobyte::build(&gyroid, &options, folder.join("gyroid.oct"))?;
    println!("{} skin voxels in {} bytes", report.skin_voxels, report.file_bytes);

    let model = Model::open(folder.join("gyroid.oct"))?;
    let (image, report) = infobyte::render(&model, &RenderRequest::default())?;
    image.write_png(folder.join("gyroid.png"))?;
    println!("{} of {} pixels show it", report.hits, u64::from(image.width) * u64::from(image.height));
    Ok(())
}

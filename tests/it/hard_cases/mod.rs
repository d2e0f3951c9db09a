//! The numerical hard cases, each by a name: what would break, and who shipped that bug before.
//!
//! Would break: everything that is easy to get wrong and seldom met. The list grew from what was seen to fail in other
//! programs (issue trackers are named as `project #number`) and from what the definitions leave to decide.
//!
//! | file | cases |
//! |---|---|
//! | `rays` | what a ray may be, in every symmetry of the cube |
//! | `values` | samples and thresholds: NaN, infinity, extremes, ties |
//! | `shapes` | what a volume may hold: plates, single voxels, all signs around a corner |
//! | `places` | affines: tiny, huge, oblique, mirrored, nearly flat |
//! | `cameras` | where a picture may be taken from |
//!
//! `cargo test --test it -- --nocapture all_cases_are_told` prints the list. With
//! INFOBYTE_LONG=N so many times as many rays and volumes are tried.

#![expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "numbers here are made to fit")]

use crate::prelude::*;

mod cameras;
mod places;
pub(crate) mod rays;
mod shapes;
mod values;

/// A case as the list tells it.
pub(crate) struct Told {
    pub(crate) name: &'static str,
    /// What would break.
    pub(crate) breaks: &'static str,
    /// Where the bug was seen.
    pub(crate) shipped: &'static str,
}

/// Makes a test of each case, and the list of a file.
macro_rules! hard_cases {
    ($($name:ident: $breaks:literal, $shipped:literal => $body:block)*) => {
        pub(crate) const TOLD: &[$crate::hard_cases::Told] =
            &[$($crate::hard_cases::Told { name: stringify!($name), breaks: $breaks, shipped: $shipped }),*];
        $(
            #[doc = $breaks]
            #[test]
            fn $name() $body
        )*
    };
}
pub(crate) use hard_cases;

#[test]
fn all_cases_are_told() {
    let bugs = rays::BUGS.iter().map(|bug| Told { name: bug.name, breaks: bug.breaks, shipped: bug.shipped });
    let others = [values::TOLD, shapes::TOLD, places::TOLD, cameras::TOLD];
    let listed = others.into_iter().flatten().map(|t| Told { ..*t });
    let mut names = BTreeSet::new();
    for case in bugs.chain(listed) {
        assert!(names.insert(case.name), "{} is there twice", case.name);
        assert!(case.breaks.len() > 20 && !case.shipped.is_empty(), "{} is not told", case.name);
        println!("{}: {} Seen: {}.", case.name.replace('_', " "), case.breaks, case.shipped);
    }
    assert!(names.len() >= 50, "{} cases", names.len());
}

/// A finished model in memory, checked.
pub(crate) struct Built {
    pub(crate) bytes: Vec<u8>,
    pub(crate) report: BuildReport,
}

impl Built {
    pub(crate) fn model(&self) -> Model<&[u8]> {
        Model::from_bytes(&self.bytes[..]).unwrap()
    }

    /// All skin voxels with their normals, where there are some.
    pub(crate) fn voxels(&self) -> Vec<([u32; 3], Option<[f64; 3]>)> {
        let model = self.model();
        let normal =
            |voxel| Some(infobyte::format::normal::decode(model.voxel_normal(voxel)?).map(f64::from));
        finest(&model).into_iter().map(|(at, voxel)| (at, normal(voxel))).collect()
    }

    pub(crate) fn cells(&self) -> BTreeSet<[u32; 3]> {
        self.voxels().into_iter().map(|(at, _)| at).collect()
    }
}

/// Builds a model with normals, and checks every invariant of the file.
pub(crate) fn build(volume: &dyn VolumeSource, threshold: Threshold) -> Result<Built, BuildError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.oct");
    let options = BuildOptions { threshold, threads: 2, ..skin_options() };
    match infobyte::build(volume, &options, &path) {
        Ok(report) => {
            let bytes = std::fs::read(&path).unwrap();
            verify(&bytes[..]).unwrap();
            Ok(Built { bytes, report })
        }
        Err(infobyte::Error::Build(error)) => {
            assert!(!path.exists(), "a refusal leaves nothing behind");
            Err(error)
        }
        Err(other) => panic!("{other}"),
    }
}

/// The skin by plain loops: inside voxels with a face neighbour that is not, or at the volume's faces.
pub(crate) fn skin(dims: [u32; 3], inside: impl Fn([u32; 3]) -> bool) -> BTreeSet<[u32; 3]> {
    let open = |at: [u32; 3]| {
        (0..3).any(|a| {
            let beside = |c: u32| {
                let mut next = at;
                next[a] = c;
                next
            };
            at[a] == 0 || at[a] + 1 == dims[a] || !inside(beside(at[a] - 1)) || !inside(beside(at[a] + 1))
        })
    };
    scenes::all_cells(dims).filter(|at| inside(*at) && open(*at)).collect()
}

/// A volume in memory with a rescale of its own.
pub(crate) struct Rescaled<T>(pub(crate) infobyte::Voxels<T>, infobyte::VolumeInfo);

impl<T: infobyte::volume::Scalar> Rescaled<T> {
    pub(crate) fn new(voxels: infobyte::Voxels<T>, rescale: Rescale) -> Self {
        let info = infobyte::VolumeInfo { rescale, ..voxels.info().clone() };
        Self(voxels, info)
    }
}

impl<T: infobyte::volume::Scalar> VolumeSource for Rescaled<T> {
    fn info(&self) -> &infobyte::VolumeInfo {
        &self.1
    }

    fn read_rows(
        &self,
        z: u32,
        rows: std::ops::Range<u32>,
        cols: std::ops::Range<u32>,
        out: &mut [u8],
    ) -> Result<(), infobyte::volume::SourceError> {
        self.0.read_rows(z, rows, cols, out)
    }
}

//! Why a picture cannot be made, as values; the sentences are written in `jobs`.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

use super::ray::BadRay;
use crate::exit::ExitKind;

/// A picture that cannot be made or written.
#[non_exhaustive]
#[derive(Debug, Error)]
pub enum RenderError {
    /// The camera makes no sense.
    Camera(CameraFault),
    /// A ray makes no sense.
    Ray(BadRay),
    /// One of many rays makes no sense.
    RayAt {
        /// Its number, from 0.
        index: usize,
        /// What is wrong with it.
        fault: BadRay,
    },
    /// There are not as many directions, or places for answers, as origins.
    RayCount {
        /// Origins.
        rays: usize,
        /// Directions, or answers.
        others: usize,
    },
    /// A picture without pixels, or with too many.
    Size {
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
        /// Longest side.
        most_side: u32,
        /// Most pixels.
        most_pixels: u64,
    },
    /// The picture was made without this layer.
    NoLayer(Layer),
    /// Threads cannot be started.
    Threads {
        /// How many.
        threads: usize,
        /// The system's reason.
        #[source]
        cause: io::Error,
    },
    /// The grid is too deep to be compared cell by cell.
    TooDeep {
        /// Its depth.
        depth: u32,
        /// The greatest depth that can be.
        most: u32,
    },
    /// Discrete rays meet voxels, and the model has cells with a surface within.
    DiscreteCells,
    /// The model's affine cannot be inverted.
    SingularAffine,
    /// The memory allowed is too little for the picture.
    Memory {
        /// Bytes allowed.
        limit_bytes: u64,
        /// The fewest that do.
        minimum_bytes: u64,
    },
    /// The image cannot be written.
    Write {
        /// The image.
        path: PathBuf,
        /// The system's reason.
        #[source]
        cause: io::Error,
    },
}

/// What is wrong with a camera.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CameraFault {
    /// The field of view is out of range.
    FieldOfView {
        /// Degrees asked for.
        degrees: f64,
        /// Least degrees.
        least: f64,
        /// Most degrees.
        most: f64,
    },
    /// A coordinate is not a finite number.
    NotFinite,
    /// The eye is in the point that it looks at.
    EyeInTarget,
    /// The eye and the point that it looks at are farther apart than numbers go.
    TooFar,
    /// The up direction has no length.
    UpWithoutLength,
    /// The up direction is along the line of sight.
    UpAlongSight,
}

impl From<CameraFault> for RenderError {
    fn from(fault: CameraFault) -> Self {
        Self::Camera(fault)
    }
}

impl From<BadRay> for RenderError {
    fn from(fault: BadRay) -> Self {
        Self::Ray(fault)
    }
}

/// What a picture may hold besides its colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layer {
    /// Depth.
    Depth,
    /// World normals.
    Normals,
    /// Numbers of boxes.
    Ids,
}

impl RenderError {
    /// Exit kind.
    pub fn kind(&self) -> ExitKind {
        match self {
            Self::Camera(_)
            | Self::Ray(_)
            | Self::RayAt { .. }
            | Self::RayCount { .. }
            | Self::Size { .. }
            | Self::NoLayer(_)
            | Self::DiscreteCells
            | Self::Threads { .. }
            | Self::TooDeep { .. } => ExitKind::Usage,
            Self::SingularAffine => ExitKind::Input,
            Self::Memory { .. } => ExitKind::Budget,
            Self::Write { .. } => ExitKind::Io,
        }
    }
}

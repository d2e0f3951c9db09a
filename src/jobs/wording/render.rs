//! Why a picture cannot be made.

use std::fmt;

use super::foreign::shown;
use super::system::writing;
use crate::budget::{ExactSize, SizeArgument};
use crate::render::ray::BadRay;
use crate::render::{CameraFault, Layer, RenderError};

impl fmt::Display for BadRay {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NotFinite => "the ray has a coordinate that is not a finite number",
            Self::NoDirection => "the ray has no direction",
            Self::TooDeep => "the grid is deeper than 16 levels",
        })
    }
}

impl fmt::Display for RenderError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Camera(fault) => fault.fmt(f),
            Self::Ray(fault) => fault.fmt(f),
            Self::RayAt { index, fault } => write!(f, "ray {index} (from 0): {fault}"),
            Self::RayCount { rays, others } => write!(
                f,
                "{rays} origins and {others} directions or answers; give as many of each"
            ),
            Self::Size { width, height, most_side, most_pixels } => write!(
                f,
                "a picture of {width}x{height} is not possible; choose sides of 1 to {most_side} and at most {most_pixels} pixels"
            ),
            Self::NoLayer(layer) => {
                let name = match layer {
                    Layer::Depth => "depth",
                    Layer::Normals => "normals",
                    Layer::Ids => "numbers of boxes",
                };
                write!(f, "the picture was made without {name}; ask for it")
            }
            Self::Threads { threads, cause } => {
                write!(f, "{threads} threads cannot be started ({cause}); choose fewer")
            }
            Self::TooDeep { depth, most } => write!(
                f,
                "a grid of 2^{depth} cells a side is too large to be compared cell by cell; choose a model of at most 2^{most}"
            ),
            Self::DiscreteCells => f.write_str(
                "discrete rays meet voxels, and this model has cells with a surface within; leave --traversal exact, or build it with --surface skin",
            ),
            Self::Memory { limit_bytes, minimum_bytes } => write!(
                f,
                "--memory {} is too small for this picture; the smallest that works is --memory {}",
                ExactSize(*limit_bytes),
                SizeArgument(*minimum_bytes)
            ),
            Self::SingularAffine => f.write_str(
                "the model's axes are (nearly) parallel, so it has no volume to look at; check its spacing and orientation",
            ),
            Self::Write { path, cause } => write!(
                f,
                "{}: cannot be written ({cause}); {}",
                shown(path),
                writing(cause)
            ),
        }
    }
}

impl fmt::Display for CameraFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::FieldOfView { degrees, least, most } => {
                return write!(f, "the field of view is {degrees} degrees; choose {least} to {most}");
            }
            Self::NotFinite => "a camera coordinate is not a finite number",
            Self::EyeInTarget => {
                "the eye is in the point that it looks at; move one of them (--eye, --look-at)"
            }
            Self::TooFar => {
                "the eye is too far from the point that it looks at for any picture; give both in mm, near the model (--eye, --look-at)"
            }
            Self::UpWithoutLength => "the up direction has no length; give another (--up)",
            Self::UpAlongSight => "the up direction is along the line of sight; give another (--up)",
        })
    }
}

//! Subjects of models.

use std::path::PathBuf;

use crate::volume::VolumeSource;

/// Subject of a model: a volume, a mesh or a tree.
///
/// Opened by [`Subject::open`], or found by a [`Catalogue`](crate::discovery::Catalogue).
#[derive(Debug)]
pub enum Subject {
    /// A volume, not prepared yet.
    Volume(Box<dyn VolumeSource>),
    /// A triangle mesh, in one file or in several, which are parts of it.
    Mesh(Vec<PathBuf>),
    /// The text of a tree of solids.
    Tree(PathBuf),
}

/// The cases of [`Subject`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SubjectKind {
    /// Samples on a grid of their own.
    Volume,
    /// A triangle mesh.
    Mesh,
    /// A tree of solids.
    Tree,
}

impl Subject {
    /// Kind of the subject.
    pub fn kind(&self) -> SubjectKind {
        match self {
            Self::Volume(_) => SubjectKind::Volume,
            Self::Mesh(_) => SubjectKind::Mesh,
            Self::Tree(_) => SubjectKind::Tree,
        }
    }

    /// The volume.
    pub fn volume(&self) -> Option<&dyn VolumeSource> {
        match self {
            Self::Volume(volume) => Some(&**volume),
            Self::Mesh(_) | Self::Tree(_) => None,
        }
    }

    /// The volume.
    pub fn into_volume(self) -> Option<Box<dyn VolumeSource>> {
        match self {
            Self::Volume(volume) => Some(volume),
            Self::Mesh(_) | Self::Tree(_) => None,
        }
    }

    /// The subject with another volume in place of its own; meshes and trees stay unchanged.
    ///
    /// # Errors
    /// The errors of `change`.
    pub(crate) fn map_volume<E>(
        self,
        change: impl FnOnce(Box<dyn VolumeSource>) -> Result<Box<dyn VolumeSource>, E>,
    ) -> Result<Self, E> {
        match self {
            Self::Volume(volume) => change(volume).map(Self::Volume),
            other @ (Self::Mesh(_) | Self::Tree(_)) => Ok(other),
        }
    }
}

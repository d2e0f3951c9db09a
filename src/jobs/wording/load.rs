//! Why a file cannot be opened as a model.

use std::fmt;
use std::path::Path;

use super::foreign::shown;
use super::system::reading;
use crate::format::FormatError;
use crate::load::{LoadError, NotRegular};

impl fmt::Display for LoadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unreadable { path, cause } => write!(
                f,
                "{}: cannot be read ({cause}); {}",
                shown(path),
                reading(cause, "check that it exists and that you may read it")
            ),
            Self::Changed { path } => write!(
                f,
                "{}: was changed while it was in use, so that nothing was made of it; start again once it is complete",
                shown(path)
            ),
            Self::Format { path, cause: FormatError::BadMagic } if instead(path).is_some() => {
                write!(f, "{}: {}", shown(path), instead(path).unwrap_or_default())
            }
            Self::Format { path, cause } => write!(f, "{}: {cause}", shown(path)),
        }
    }
}

/// What to do with a file of another kind, by its name.
fn instead(path: &Path) -> Option<&'static str> {
    let name = path.extension()?.to_str()?.to_ascii_lowercase();
    Some(match name.as_str() {
        "csg" => {
            "is a tree of solids, not a model; build it first, with `oct build TREE.csg -o MODEL.oct --grid 256`"
        }
        "stl" | "ply" | "obj" | "off" | "gltf" | "glb" | "3mf" => {
            "is a mesh, not a model; build it first, with `oct build MESH -o MODEL.oct --grid 256`"
        }
        "toml" => "is not a model; a scene is shown by `oct render` alone, and is not a part of another one",
        _ => return None,
    })
}

impl fmt::Display for NotRegular {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("it is not a regular file")
    }
}

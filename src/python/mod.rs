//! The module `infobyte._infobyte` of the Python package: thin calls, whose defaults, names and documentation are in
//! Python, next to this file.
//!
//! | file | content |
//! |---|---|
//! | `failure` | errors of the library as exceptions |
//! | `watch` | a job on a thread of its own, while the caller's looks at signals and calls `progress` |
//! | `options` | options of builds and pictures, which come as JSON |
//! | `samples` | samples in a file, read by position |
//! | `jobs` | builds, packing, checking, exports, comparisons |
//! | `handle` | an open model: pictures, voxels, triangles |
//! | `rays` | many rays at once, on threads |
//! | `infobyte/`, `tests/` | the package, and its tests |

mod failure;
mod handle;
mod jobs;
mod options;
mod rays;
mod samples;
mod watch;

use pyo3::prelude::*;

use crate::text::spell;

/// Names of options and functions of the Python package that differ from the library's.
const OTHERWISE: [(&str, &str); 17] = [
    ("GridChoice::Voxel", "voxel"),
    ("Threshold::Iso", "iso"),
    ("Threshold::Range", "range"),
    ("label_names", "names"),
    ("origin_mm", "origin"),
    ("scalar", "dtype"),
    ("spacing_mm", "spacing"),
    ("unit_mm", "unit"),
    ("build", "infobyte.build"),
    ("jobs::build(INPUT)", "infobyte.build(INPUT, 'MODEL.oct')"),
    ("jobs::export::export_each", "only"),
    ("jobs::info", "Model.info"),
    ("jobs::pack::unpack", "infobyte.unpack"),
    ("jobs::scan", "oct scan"),
    ("jobs::picture", "infobyte.render_scene"),
    ("jobs::verify", "infobyte.verify"),
    ("jobs::view", "oct view"),
];

fn spelled(name: &str) -> String {
    let known = OTHERWISE.iter().find(|(of, _)| *of == name);
    known.map_or(name, |(_, python)| python).to_owned()
}

#[pymodule]
fn _infobyte(module: &Bound<'_, PyModule>) -> PyResult<()> {
    spell(spelled);
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<handle::Handle>()?;
    module.add_function(wrap_pyfunction!(jobs::check_name, module)?)?;
    module.add_function(wrap_pyfunction!(jobs::build_files, module)?)?;
    module.add_function(wrap_pyfunction!(jobs::build_array, module)?)?;
    module.add_function(wrap_pyfunction!(jobs::build_stored, module)?)?;
    module.add_function(wrap_pyfunction!(jobs::repack, module)?)?;
    module.add_function(wrap_pyfunction!(jobs::verify, module)?)?;
    module.add_function(wrap_pyfunction!(jobs::pores, module)?)?;
    module.add_function(wrap_pyfunction!(jobs::export, module)?)?;
    module.add_function(wrap_pyfunction!(jobs::compare, module)?)?;
    module.add_function(wrap_pyfunction!(jobs::thickness, module)?)?;
    module.add_function(wrap_pyfunction!(jobs::render_scene, module)?)?;
    module.add_function(wrap_pyfunction!(options::size, module)?)?;
    Ok(())
}

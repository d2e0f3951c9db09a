//! What was asked for, as far as results depend on it.

use serde_json::{Value, json};

use super::{BatchRequest, fnv};
use crate::builder::{Connectivity, Threshold};
use crate::format::Channel;
use crate::source::OpenOptions;

/// One number for everything in the request that the bytes of results depend on.
pub(super) fn options_fingerprint(request: &BatchRequest) -> String {
    let b = &request.build;
    // Which volumes are taken changes none of them.
    let how = OpenOptions { all_volumes: false, follow_links: false, ..request.how.clone() };
    let text = format!(
        "{:?} {:?} {:?} {:?} {} {} {} {how:?} {:?} {:?}",
        b.threshold,
        b.volume_surface(),
        b.connectivity,
        b.channels,
        b.gradient,
        b.lod,
        request.thumbnails,
        request.clean,
        request.grid.mesh()
    );
    format!("{:016x}", fnv(text.as_bytes()))
}

/// The same for people.
pub(super) fn options_told(request: &BatchRequest) -> Value {
    let b = &request.build;
    json!({
        "threshold": match b.threshold {
            Threshold::Iso(lo) => json!({ "iso": lo }),
            Threshold::Range(lo, hi) => json!({ "range": [lo, hi] }),
            Threshold::Otsu => json!("otsu"),
            Threshold::Chosen(selection) => json!({ "range": [selection.lo, selection.hi] }),
        },
        "surface": b.volume_surface().name(),
        "connectivity": if b.connectivity == Connectivity::Thick6 { 6 } else { 26 },
        "channels": b.channels.iter().map(Channel::name).collect::<Vec<_>>(),
        "gradient": b.gradient.name(),
        "gaps": format!("{:?}", request.how.gaps).to_lowercase(),
        "cleaning": request.clean.operations(),
        "lod": b.lod,
        "spacing_mm": request.how.placement.spacing_mm,
        "orientation": request.how.placement.orientation.map(|o| o.to_string()),
        "modalities": request.modalities,
        "series": request.series,
        "thumbnails": request.thumbnails,
        "thumbnails_of_all": request.thumbnails_of_all,
        "min_slices": request.min_slices,
    })
}

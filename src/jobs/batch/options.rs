//! The options of a request on which results depend.

use super::{BatchRequest, fnv};
use crate::source::OpenOptions;

/// One number for everything in the request that the bytes of results depend on.
pub(super) fn options_fingerprint(request: &BatchRequest) -> String {
    let b = &request.build;
    // The selection of volumes changes none of them.
    let how = OpenOptions { all_volumes: false, follow_links: false, ..request.how.clone() };
    let text = format!(
        "{:?} {} {:?} {:?} {:?} {:?} {:?} {} {} {how:?} {:?} {:?}",
        b.threshold,
        request.find_labels,
        b.surface,
        b.error,
        b.connectivity,
        b.channels,
        b.gradient,
        b.lod,
        request.thumbnails,
        request.clean,
        request.grid.stated()
    );
    format!("{:016x}", fnv(text.as_bytes()))
}

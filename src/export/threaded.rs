//! Triangles in memory, made on a thread of their own while the caller's thread finds the samples of the next slices.
//!
//! ```text
//! caller: skin, where all else lies, samples inside --Slice--> other thread: vertices, polygons
//!                                                   <--spare--
//! ```
//!
//! The mesh is the same as from one thread, byte for byte. Memory: up to four more slices.

use std::io;
use std::sync::mpsc::{Receiver, SyncSender, channel, sync_channel};
use std::thread::{Builder, scope};

use super::bits::Bits;
use super::dual::{Mesher, Surface};
use super::patch::Layer;
use super::sample_signs::{Extent, Item};
use super::vertex_color::Lights;
use crate::interior::Rows;
use crate::load::{ModelView, NodeView};
use crate::render::GridSpace;

/// Slices in the queue.
const WAITING: usize = 2;

/// A slice of samples, and its skin: voxels of the slice itself, or cells of the layer below it.
struct Slice {
    items: Rows<Item>,
    samples: Bits,
}

/// Sender of slices.
pub(super) struct Slices {
    extent: Extent,
    to: SyncSender<Slice>,
    spares: Receiver<Slice>,
}

impl Slices {
    /// Sends a slice, and leaves a used one, with any content, in its place. Slices after an error are dropped.
    pub(super) fn send(&self, items: &mut Rows<Item>, samples: &mut Bits) {
        let empty = || {
            let samples = Bits::new(self.extent.width, self.extent.height);
            Slice { items: Rows::default(), samples }
        };
        let mut slice = self.spares.try_recv().unwrap_or_else(|_| empty());
        std::mem::swap(&mut slice.items, items);
        std::mem::swap(&mut slice.samples, samples);
        // The other thread returns the reason for its end.
        let _ = self.to.send(slice);
    }
}

/// Sources of vertices.
#[derive(Clone, Copy)]
pub(super) struct Ground<'a> {
    pub(super) view: &'a ModelView<'a>,
    pub(super) space: &'a GridSpace,
    pub(super) extent: Extent,
}

impl Ground<'_> {
    /// Makes triangles of the slices that `sweep` sends; returns none if `sweep` fails or returns `None`.
    ///
    /// # Errors
    /// The error of `sweep`; then errors of [`Mesher::layer`], or the thread does not start.
    pub(super) fn mesh<E: From<io::Error>>(
        self,
        mesher: Mesher<'_>,
        lights: Option<Lights>,
        sweep: impl FnOnce(Slices) -> Result<Option<()>, E>,
    ) -> Result<Option<Surface>, E> {
        scope(|scope| {
            let (to, slices) = sync_channel(WAITING);
            let (back, spares) = channel();
            let made = Builder::new().spawn_scoped(scope, move || {
                self.layers(mesher, lights, &slices, |spare| back.send(spare))
            })?;
            let swept = sweep(Slices { extent: self.extent, to, spares });
            let made = made.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            match swept? {
                Some(()) => Ok(Some(made?)),
                None => Ok(None),
            }
        })
    }

    fn layers<T>(
        self,
        mut mesher: Mesher<'_>,
        lights: Option<Lights>,
        slices: &Receiver<Slice>,
        done: impl Fn(Slice) -> T,
    ) -> io::Result<Surface> {
        let Self { view, space, extent } = self;
        let is_cells = view.cells().is_some();
        let height = if is_cells { extent.height - 1 } else { extent.height };
        let Ok(mut before) = slices.recv() else { return Ok(mesher.finish()) };
        for (slice, z) in slices.iter().zip(1..) {
            let items = [if is_cells { &slice.items } else { &before.items }, &slice.items];
            let mut layer = Layer { view, space, items, lights: lights.as_ref(), at: (0, 0) };
            mesher.layer([&before.samples, &slice.samples], &mut layer, height, z)?;
            done(std::mem::replace(&mut before, slice));
        }
        Ok(mesher.finish())
    }
}

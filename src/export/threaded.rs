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
    /// Table of colours, if the model has colours.
    pub(super) lights: Option<&'a Lights>,
}

impl Ground<'_> {
    /// Makes the triangles between two slices of samples, the upper of which has number `z`; `items` as in [`Layer`].
    ///
    /// # Errors
    /// Errors of [`Mesher::layer`].
    pub(super) fn layer(
        &self,
        mesher: &mut Mesher<'_>,
        samples: [&Bits; 2],
        items: [&Rows<Item>; 2],
        z: u32,
    ) -> io::Result<()> {
        let Self { view, space, extent, lights } = *self;
        let height = extent.height - usize::from(view.cells().is_some());
        mesher.layer(samples, &mut Layer { view, space, items, lights, at: (0, 0) }, height, z)
    }

    /// Makes triangles of the slices that `sweep` sends; returns none if `sweep` fails or returns `None`.
    ///
    /// # Errors
    /// The error of `sweep`; then errors of [`Mesher::layer`], or the thread does not start.
    pub(super) fn mesh<T, E: From<io::Error>>(
        &self,
        mesher: Mesher<'_>,
        sweep: impl FnOnce(Slices) -> Result<Option<T>, E>,
    ) -> Result<Option<Surface>, E> {
        scope(|scope| {
            let (to, slices) = sync_channel(WAITING);
            let (back, spares) = channel();
            let made = Builder::new()
                .spawn_scoped(scope, move || self.layers(mesher, &slices, |spare| back.send(spare)))?;
            let swept = sweep(Slices { extent: self.extent, to, spares });
            let made = made.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            swept?.map(|_| made.map_err(E::from)).transpose()
        })
    }

    fn layers<T>(
        &self,
        mut mesher: Mesher<'_>,
        slices: &Receiver<Slice>,
        done: impl Fn(Slice) -> T,
    ) -> io::Result<Surface> {
        let Ok(mut before) = slices.recv() else { return Ok(mesher.finish()) };
        for (slice, z) in slices.iter().zip(1..) {
            let below = if self.view.cells().is_some() { &slice.items } else { &before.items };
            self.layer(&mut mesher, [&before.samples, &slice.samples], [below, &slice.items], z)?;
            done(std::mem::replace(&mut before, slice));
        }
        Ok(mesher.finish())
    }
}

//! A finished `.oct` opened for use: checked cheaply, then read in place.

use std::io::{self, Read};
use std::ops::Range;
use std::path::{Path, PathBuf};

use crate::format::{
    Channel, ColorMap, FormatError, Header, LabelItems, Metadata, SectionEntry, SectionKind, SurfaceKind,
    ValueColors, Walls, cell::Plane, rank,
};
use crate::budget::resident_bytes;
use crate::geom::{Affine, BoxIndex, Dims, NodeIndex, VoxelIndex};
use crate::load::LoadFault;
use crate::platform::PositionalFile;

use super::frame::Frame;
use super::map::{FileIdentity, Mapping};
use super::stream::{Fault, ReadAt};
use super::voxels::StoredVoxels;
use super::{BrickCodes, CellItems, LeafItems, LoadError, NodeView};

/// Resident memory beyond which pages of models are given back.
const MANY_BYTES: u64 = 27 << 18;

/// An `.oct` that is not packed, over any bytes: a [`Mapping`] in use, a `Vec<u8>` in tests.
///
/// Opening reads only the header, the section table, the metadata and the level table (SPEC I1 to I7), so its cost does
/// not depend on the size of the model. The contents of the large sections are not trusted: every accessor is safe on
/// any bytes. [`super::verify()`] checks them all.
#[derive(Debug)]
pub struct Model<D = Mapping> {
    data: D,
    frame: Frame,
    places: Places,
    /// The mapped file; `None` for a model in memory.
    origin: Option<Origin>,
}

/// Ranges in the file of the sections of a view; empty for absent ones.
#[derive(Clone, Debug)]
struct Places {
    nodes: Range<usize>,
    rank: Range<usize>,
    normals: Option<Range<usize>>,
    node_normals: Option<Range<usize>>,
    colors: Option<Range<usize>>,
    labels: Option<Range<usize>>,
    /// Offsets, corners and their directory, of a model of cells.
    cells: Option<[Range<usize>; 3]>,
    /// Normals, offsets and directory of larger leaves.
    leaves: Option<[Range<usize>; 3]>,
}

/// The file that a model is mapped from, kept open so that a change of its bytes can be noticed.
#[derive(Debug)]
struct Origin {
    path: PathBuf,
    file: PositionalFile,
    then: FileIdentity,
}

/// Files up to this length are read by [`Model::open`], not mapped.
const SMALL_BYTES: u64 = 1 << 20;

impl Model<Mapping> {
    /// Opens a file: one of at most 1 MiB is read into memory, a larger one is mapped.
    ///
    /// A mapping reads the file in place, so opening is cheap whatever its size. Other programs can still change the file:
    ///
    /// | change to a mapped file | effect on the model |
    /// |---|---|
    /// | it is replaced under its name, as every output of this program does, or removed | nothing: the old bytes stay |
    /// | it is overwritten in place | any answer is possible, but no panic; jobs end with an error ([`Model::check_unchanged`]) |
    /// | it is cut short | the same, unless the job is reading: then the system ends the process (SIGBUS) |
    ///
    /// Jobs are [`crate::render()`], [`crate::triangles`], and [`RayCaster::new`], [`first_hits`] and [`any_hit`]: they compare
    /// length and time of change before they start and when they are done. Single rays and voxels are not checked. If
    /// others may write to the file, use [`Model::read`], which avoids all of this.
    ///
    /// [`RayCaster::new`]: crate::RayCaster::new
    /// [`first_hits`]: crate::RayCaster::first_hits
    /// [`any_hit`]: crate::RayCaster::any_hit
    ///
    /// # Errors
    /// [`LoadError`] with the path: unreadable, foreign, damaged, newer, or packed; a small file that is written to
    /// meanwhile.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, LoadError> {
        let path = path.as_ref();
        let is_small = std::fs::metadata(path).is_ok_and(|meta| meta.is_file() && meta.len() <= SMALL_BYTES);
        if is_small {
            let Model { data, frame, places, .. } = Model::read(path)?;
            return Ok(Self { data: Mapping::read(data), frame, places, origin: None });
        }
        Self::map(path)
    }

    /// Opens and maps a file of any length.
    ///
    /// # Errors
    /// The errors of [`Model::open`].
    pub(crate) fn map(path: &Path) -> Result<Self, LoadError> {
        let open = || -> Result<Self, Fault> {
            let file = PositionalFile::open(path)?;
            let then = FileIdentity::of(&file)?;
            // Ordinary reads first, so that only models are mapped.
            let frame = Frame::read(&file)?;
            frame.refuse_packed()?;
            let model = Self::assemble(Mapping::of(&file)?, frame)?;
            Ok(Self { origin: Some(Origin { path: path.to_path_buf(), file, then }), ..model })
        };
        open().map_err(|fault| fault.at(path))
    }

    /// Releases the pages of the file that were read from the process; see [`Mapping::give_back`].
    pub fn give_back(&self) {
        self.data.give_back();
    }

    /// Releases the pages of models if much memory is resident.
    pub(crate) fn give_back_many(models: &[&Self]) {
        if !models.is_empty() && resident_bytes() > MANY_BYTES {
            models.iter().for_each(|model| model.give_back());
        }
    }
}

impl Model<Vec<u8>> {
    /// Reads a whole file into memory: later writes to the file, or its truncation, do not affect the model, whereas
    /// truncating the file of a [`Mapping`] kills the process.
    ///
    /// Memory: the length of the file. For a model in memory already: [`Model::from_bytes`].
    ///
    /// # Errors
    /// The errors of [`Model::open`], and [`LoadError`] for a file that is written to meanwhile.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, LoadError> {
        let path = path.as_ref();
        let read = || -> Result<Option<Self>, Fault> {
            let file = PositionalFile::open(path)?;
            let then = FileIdentity::of(&file)?;
            // Ensures that only models are read whole.
            let frame = Frame::read(&file)?;
            frame.refuse_packed()?;
            let mut bytes = Vec::new();
            let len = usize::try_from(frame.header.file_bytes).unwrap_or(usize::MAX);
            bytes.try_reserve_exact(len).map_err(io::Error::from)?;
            file.onwards(0).take(frame.header.file_bytes).read_to_end(&mut bytes)?;
            if FileIdentity::of(&file)? != then {
                return Ok(None);
            }
            Ok(Some(Self::assemble(bytes, frame)?))
        };
        let model = read().map_err(|fault| fault.at(path))?;
        model.ok_or_else(|| LoadError::from(LoadFault::Changed { path: path.to_path_buf() }))
    }
}

impl<D: AsRef<[u8]>> Model<D> {
    /// Opens a model that is in memory.
    ///
    /// # Errors
    /// The first rule that is broken.
    pub fn from_bytes(data: D) -> Result<Self, FormatError> {
        let frame = match Frame::read(data.as_ref()) {
            Ok(frame) => frame,
            Err(Fault::Format(cause)) => return Err(cause),
            // Memory ends early only where a length was not checked: at least one more byte was needed.
            Err(Fault::Io(_)) => {
                let got = data.as_ref().len() as u64;
                return Err(FormatError::Truncated { expected: got + 1, got });
            }
        };
        frame.refuse_packed()?;
        Self::assemble(data, frame)
    }

    fn assemble(data: D, frame: Frame) -> Result<Self, FormatError> {
        let len = data.as_ref().len();
        // The mapping is shorter than the frame states if the file was truncated in between.
        if len as u64 != frame.header.file_bytes {
            return Err(FormatError::Truncated { expected: frame.header.file_bytes, got: len as u64 });
        }
        let range = |kind| {
            frame.section(kind).and_then(|e| {
                let (start, end) = (usize::try_from(e.offset).ok()?, usize::try_from(e.end()).ok()?);
                (start <= end && end <= len).then_some(start..end)
            })
        };
        let of_voxels = |channel| range(SectionKind::Voxels(channel));
        let places = Places {
            nodes: range(SectionKind::Nodes).ok_or(FormatError::MissingSection(SectionKind::Nodes))?,
            rank: range(SectionKind::Rank).ok_or(FormatError::MissingSection(SectionKind::Rank))?,
            normals: of_voxels(Channel::Normal),
            node_normals: range(SectionKind::Means(Channel::Normal)),
            colors: of_voxels(Channel::Color),
            labels: of_voxels(Channel::Label),
            cells: (frame.surface() == SurfaceKind::Cells).then(|| {
                let corner_rank = range(SectionKind::CornerRank);
                [of_voxels(Channel::Offset), of_voxels(Channel::Corners), corner_rank]
                    .map(Option::unwrap_or_default)
            }),
            leaves: frame.header.leaves.then(|| {
                [SectionKind::LeafNormals, SectionKind::LeafOffsets, SectionKind::LeafRank]
                    .map(|kind| range(kind).unwrap_or_default())
            }),
        };
        Ok(Self { data, frame, places, origin: None })
    }

    /// Checks that the mapped file has not changed since it was opened. Call this before keeping results: a file that
    /// was overwritten in place meanwhile was neither the old model nor the new one. A model in memory is always
    /// unchanged. `path` is the name in the error.
    ///
    /// # Errors
    /// [`LoadError`], or the operating system refused.
    pub fn check_unchanged(&self, path: &Path) -> Result<(), LoadError> {
        self.origin.as_ref().map_or(Ok(()), |origin| origin.then.check(&origin.file, path))
    }

    /// Runs a job between two such checks. In a changed file the job may fail for any reason: the change is then
    /// reported instead.
    ///
    /// # Errors
    /// The model has changed since it was opened; the job's own errors.
    pub(crate) fn unchanged_during<T, E: From<LoadError>>(
        &self,
        job: impl FnOnce() -> Result<T, E>,
    ) -> Result<T, E> {
        let check = || self.origin.as_ref().map_or(Ok(()), |origin| self.check_unchanged(&origin.path));
        check()?;
        let done = job();
        check()?;
        done
    }

    /// The header.
    pub fn header(&self) -> &Header {
        &self.frame.header
    }

    /// Header, table, metadata and levels together.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// The metadata.
    pub fn metadata(&self) -> &Metadata {
        &self.frame.metadata
    }

    /// Size in boxes of the finest level, see [`Frame::dims`].
    pub fn dims(&self) -> Dims {
        self.frame.dims()
    }

    /// Index of a box of the finest level to LPS mm, see [`Frame::affine`].
    pub fn affine(&self) -> Affine {
        self.frame.affine()
    }

    /// The section table.
    pub fn sections(&self) -> &[SectionEntry] {
        &self.frame.sections
    }

    /// The whole file.
    pub fn bytes(&self) -> &[u8] {
        self.data.as_ref()
    }

    /// The bytes of a section, if the file has it.
    pub fn section_bytes(&self, kind: SectionKind) -> Option<&[u8]> {
        let e = self.frame.section(kind)?;
        self.bytes().get(usize::try_from(e.offset).ok()?..usize::try_from(e.end()).ok()?)
    }

    /// First node of every depth 0..L, then N.
    pub fn levels(&self) -> &[u64] {
        &self.frame.levels
    }

    /// Items of a channel, one per voxel, if the model has it.
    pub fn items(&self, channel: Channel) -> Option<Items<'_>> {
        self.items_of(SectionKind::Voxels(channel))
    }

    /// Means of a channel, one per node with an edge of 4 cells or more, if the model has them.
    pub fn means(&self, channel: Channel) -> Option<Items<'_>> {
        self.items_of(SectionKind::Means(channel))
    }

    fn items_of(&self, kind: SectionKind) -> Option<Items<'_>> {
        let item_bytes = self.frame.section(kind)?.item_bytes;
        Some(Items { bytes: self.section_bytes(kind)?, item_bytes: usize::from(item_bytes.max(1)) })
    }

    /// Stored value of a voxel (SPEC 4.7), if the model has values and the voxel exists.
    pub fn value(&self, voxel: VoxelIndex) -> Option<u16> {
        match *self.items(Channel::Value)?.get(voxel.get())? {
            [value] => Some(u16::from(value)),
            [low, high] => Some(u16::from_le_bytes([low, high])),
            _ => None,
        }
    }

    /// The borrowed view that loops should use: its slices are resolved once.
    pub fn view(&self) -> ModelView<'_> {
        let bytes = self.bytes();
        let part = |range: &Range<usize>| bytes.get(range.clone()).unwrap_or_default();
        let codes = |range: &Option<Range<usize>>| range.as_ref().map(|range| part(range).as_chunks::<2>().0);
        let Places { nodes, rank, normals, node_normals, colors, labels, cells, leaves } = &self.places;
        let normal_codes = normals.as_ref().map(part).unwrap_or_default();
        ModelView {
            depth: self.frame.header.dims.depth(),
            boxes: self.frame.header.nodes + self.frame.header.voxels,
            voxels: self.frame.header.voxels,
            nodes: part(nodes),
            rank: part(rank),
            normals: codes(normals),
            cells: cells.as_ref().map(|[offsets, corners, corner_rank]| {
                let items = CellItems::new(normal_codes, part(offsets), part(corners), part(corner_rank));
                if self.frame.header.walls { items.between_labels() } else { items }
            }),
            leaves: leaves.as_ref().map(|[normals, offsets, directory]| {
                LeafItems::new(part(normals), part(offsets), part(directory))
            }),
            node_normals: codes(node_normals),
            colors: colors.as_ref().map(|range| part(range).as_chunks::<3>().0),
            labels: labels
                .as_ref()
                .map(|range| LabelItems::new(part(range), self.frame.header.voxels, &self.frame.labels)),
            values: self.frame.quantity.as_ref().and_then(|quantity| {
                let items = self.section_bytes(SectionKind::Voxels(Channel::Value))?.as_chunks().0;
                Some((items, ValueColors::new(quantity, self.metadata().value_scale, None, None)))
            }),
        }
    }

    /// [`Model::view`] for measuring: the only label of a model is its solid.
    pub(crate) fn solid_view(&self) -> ModelView<'_> {
        let mut view = self.view();
        if self.frame.labels.len() == 1 {
            view.cells = view.cells.map(CellItems::of_one_label);
        }
        view
    }

    /// [`Model::view`], with measured values in another colour map or range.
    pub(crate) fn view_in_colors(&self, map: Option<ColorMap>, range: Option<[f64; 2]>) -> ModelView<'_> {
        let mut view = self.view();
        if let (Some((_, colors)), Some(quantity)) = (&mut view.values, &self.frame.quantity) {
            *colors = ValueColors::new(quantity, self.metadata().value_scale, map, range);
        }
        view
    }

    /// The skin voxels or cells, in the order of the file.
    ///
    /// Cost: some ten nanoseconds each; memory: none. Safe on any bytes, and ends after the number of voxels in the
    /// header.
    ///
    /// ```
    /// # fn main() -> Result<(), infobyte::Error> {
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/v1.0-mapped.oct");
    /// let model = infobyte::Model::open(path)?;
    /// for found in model.voxels() {
    ///     let [x, y, z] = model.affine().apply(found.voxel.map(f64::from));
    ///     println!("{} at {x}, {y}, {z} mm, normal {:?}", found.number, found.normal);
    /// }
    /// assert_eq!(model.voxels().count() as u64, model.header().voxels);
    /// # Ok(())
    /// # }
    /// ```
    pub fn voxels(&self) -> StoredVoxels<'_> {
        let scale = self.frame.metadata.value_scale;
        StoredVoxels::new(self.view(), self.levels(), &self.affine(), self.items(Channel::Value), scale)
    }
}

/// The items of one section, by number.
#[derive(Clone, Copy, Debug)]
pub struct Items<'a> {
    bytes: &'a [u8],
    item_bytes: usize,
}

impl<'a> Items<'a> {
    /// Bytes of an item.
    pub fn item_bytes(&self) -> usize {
        self.item_bytes
    }

    /// All items one after the other.
    pub fn bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// One item (little-endian), or `None` beyond the last.
    pub fn get(&self, at: u64) -> Option<&'a [u8]> {
        let start = usize::try_from(at).ok()?.checked_mul(self.item_bytes)?;
        self.bytes.get(start..start.checked_add(self.item_bytes)?)
    }
}

/// A model's structure and channels as plain slices: the input of every kernel.
#[derive(Clone, Copy, Debug)]
pub struct ModelView<'a> {
    depth: u32,
    boxes: u64,
    voxels: u64,
    nodes: &'a [u8],
    rank: &'a [u8],
    normals: Option<&'a [[u8; 2]]>,
    node_normals: Option<&'a [[u8; 2]]>,
    cells: Option<CellItems<'a>>,
    leaves: Option<LeafItems<'a>>,
    colors: Option<&'a [[u8; 3]]>,
    labels: Option<LabelItems<'a>>,
    /// Measured values, and their colours.
    values: Option<(&'a [[u8; 2]], ValueColors)>,
}

impl<'a> ModelView<'a> {
    /// A structure without items: depth, number of skin voxels, infobytes and rank directory (SPEC 4.4, 4.5). Any bytes
    /// are safe, even wrong ones.
    pub fn over(depth: u32, voxels: u64, infobytes: &'a [u8], directory: &'a [u8]) -> Self {
        Self {
            depth,
            boxes: (infobytes.len() as u64).saturating_add(voxels).min(u64::MAX - 1),
            voxels,
            nodes: infobytes,
            rank: directory,
            normals: None,
            node_normals: None,
            cells: None,
            leaves: None,
            colors: None,
            labels: None,
            values: None,
        }
    }

    /// The same view with normal codes (SPEC 4.6, little-endian) of voxels and of nodes.
    #[must_use]
    pub fn with_normals(self, normals: Option<&'a [[u8; 2]]>, node_normals: Option<&'a [[u8; 2]]>) -> Self {
        Self { normals, node_normals, ..self }
    }

    /// Infobytes of the eight nodes from `node` on, the first in the lowest byte.
    #[inline(always)]
    pub(crate) fn infobytes(&self, node: NodeIndex) -> u64 {
        let rest = node.index().and_then(|at| self.nodes.get(at..)).unwrap_or(&[]);
        match rest.first_chunk() {
            Some(bytes) => u64::from_le_bytes(*bytes),
            None => rest.iter().rev().fold(0, |word, byte| word << 8 | u64::from(*byte)),
        }
    }

    /// True if a stored value of 0 means no value.
    pub(crate) fn has_quantity(&self) -> bool {
        self.values.is_some()
    }

    /// The colours of measured values; `None` for a model that does not show them.
    pub(crate) fn value_colors(&self) -> Option<&ValueColors> {
        self.values.as_ref().filter(|_| self.labels.is_none()).map(|(_, colors)| colors)
    }

    /// True if some nodes are larger leaves.
    #[inline(always)]
    pub(crate) fn has_leaves(&self) -> bool {
        self.leaves.is_some()
    }

    /// The labels of the cells, if the model has them.
    #[inline]
    pub fn labels(&self) -> Option<LabelItems<'a>> {
        self.labels
    }

    /// The walls between the labels of a cell (SPEC 4.12); `None` for other models. Any bytes are safe.
    pub fn walls(&self, cell: u64) -> Option<Walls> {
        let cells = self.cells.filter(CellItems::has_walls)?;
        Some(match cells.wall(cell) {
            Some(plane) => Walls::of_pair(plane, self.labels?.pair(cell).unwrap_or([u16::MAX, 0])),
            None => Walls::of_item(cells.code(cell), &cells.wall_item(cell)),
        })
    }

    /// True for a model without boxes of the surface.
    #[inline(always)]
    pub(crate) fn is_empty(&self) -> bool {
        self.voxels == 0 && self.leaves.is_none()
    }

    /// True if a node is a larger leaf.
    #[inline(always)]
    pub(crate) fn is_leaf(&self, node: NodeIndex) -> bool {
        self.leaves.is_some() && node.index().and_then(|at| self.nodes.get(at)) == Some(&0)
    }

    /// The plane of a larger leaf, in the coordinates of its box.
    #[inline]
    pub fn leaf_plane(&self, node: NodeIndex) -> Plane {
        let (code, offset) = self.leaf_items(node);
        Plane::new(code, offset)
    }

    /// Code of a larger leaf's normal, and offset of its plane.
    #[inline(always)]
    pub(crate) fn leaf_items(&self, node: NodeIndex) -> (u16, i8) {
        let at = node.index().unwrap_or(usize::MAX);
        self.leaves.map_or((0, i8::MAX), |leaves| leaves.of(self.nodes, at))
    }

    /// Appends the planes of larger leaves that are siblings, from `node` on, to the planes of `fine` cells.
    #[inline(always)]
    pub(crate) fn append_leaves(
        &self,
        node: NodeIndex,
        fine_and_count: (usize, usize),
        room: &mut BrickCodes,
    ) {
        if let Some(leaves) = self.leaves {
            leaves.append(self.nodes, node.index().unwrap_or(usize::MAX), fine_and_count, room);
        }
    }

    /// Memory that queries about a node read, for prefetch hints.
    #[inline(always)]
    pub(crate) fn sources(&self, node: NodeIndex) -> [&[u8]; 2] {
        let at = node.index().unwrap_or(usize::MAX);
        [
            self.nodes.get(at..).unwrap_or(&[]),
            self.rank.get(rank::block_entry(self.nodes.len(), at)..).unwrap_or(&[]),
        ]
    }

    /// Normal codes of a voxel, of the four before it and of the four after it in file order; `None` if one of them is
    /// missing.
    #[inline]
    pub(crate) fn voxel_normals_near(&self, voxel: VoxelIndex) -> Option<[u16; 9]> {
        codes_near(self.normals, voxel.index())
    }

    /// Normal codes around a node with an edge of 4 cells or more, like [`Self::voxel_normals_near`].
    #[inline]
    pub(crate) fn node_normals_near(&self, node: NodeIndex) -> Option<[u16; 9]> {
        codes_near(self.node_normals, node.index())
    }
}

#[inline]
fn code(codes: Option<&[[u8; 2]]>, at: Option<usize>) -> Option<u16> {
    codes?.get(at?).map(|c| u16::from_le_bytes(*c))
}

#[inline]
fn codes_near(codes: Option<&[[u8; 2]]>, at: Option<usize>) -> Option<[u16; 9]> {
    let near = codes?.get(at?.checked_sub(4)?..)?.first_chunk::<9>()?;
    Some(near.map(u16::from_le_bytes))
}

// Always inlined: a traversal compiled for more instructions would otherwise call these without them.
impl NodeView for ModelView<'_> {
    fn depth(&self) -> u32 {
        self.depth
    }

    fn node_count(&self) -> u64 {
        self.nodes.len() as u64
    }

    fn voxel_count(&self) -> u64 {
        self.voxels
    }

    #[inline(always)]
    fn infobyte(&self, node: NodeIndex) -> u8 {
        node.index().and_then(|at| self.nodes.get(at)).copied().unwrap_or(0)
    }

    #[inline(always)]
    fn first_child(&self, node: NodeIndex) -> BoxIndex {
        // A wrong directory may state any rank; limited to the number of boxes, sums cannot overflow.
        BoxIndex::new(rank::rank(self.nodes, self.rank, node.get()).min(self.boxes) + 1)
    }

    #[inline]
    fn voxel_normal(&self, voxel: VoxelIndex) -> Option<u16> {
        code(self.normals, voxel.index())
    }

    #[inline]
    fn node_normal(&self, node: NodeIndex) -> Option<u16> {
        code(self.node_normals, node.index())
    }

    #[inline]
    fn voxel_color(&self, voxel: VoxelIndex) -> Option<[u8; 3]> {
        match self.labels {
            None => match &self.values {
                Some((items, colors)) => {
                    items.get(voxel.index()?).map(|item| colors.color(u16::from_le_bytes(*item)))
                }
                None => self.colors?.get(voxel.index()?).copied(),
            },
            Some(labels) => labels.label(voxel.get()).map(|label| label.color),
        }
    }

    #[inline]
    fn cells(&self) -> Option<CellItems<'_>> {
        self.cells
    }
}

/// Methods that forward to a model's view.
macro_rules! by_view {
    ($(fn $name:ident(&self $(, $index:ident: $t:ty)?) -> $out:ty;)*) => {$(
        #[inline]
        fn $name(&self $(, $index: $t)?) -> $out {
            self.view().$name($($index)?)
        }
    )*};
}

impl<D: AsRef<[u8]> + Sync> NodeView for Model<D> {
    by_view! {
        fn depth(&self) -> u32;
        fn node_count(&self) -> u64;
        fn voxel_count(&self) -> u64;
        fn infobyte(&self, node: NodeIndex) -> u8;
        fn first_child(&self, node: NodeIndex) -> BoxIndex;
        fn voxel_normal(&self, voxel: VoxelIndex) -> Option<u16>;
        fn node_normal(&self, node: NodeIndex) -> Option<u16>;
        fn voxel_color(&self, voxel: VoxelIndex) -> Option<[u8; 3]>;
    }

    fn cells(&self) -> Option<CellItems<'_>> {
        self.view().cells
    }
}

impl<D: AsRef<[u8]> + Sync> ReadAt for Model<D> {
    fn byte_len(&self) -> io::Result<u64> {
        Ok(self.bytes().len() as u64)
    }

    fn read_at(&self, out: &mut [u8], offset: u64) -> io::Result<()> {
        self.bytes().read_at(out, offset)
    }
}

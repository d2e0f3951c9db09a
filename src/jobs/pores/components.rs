//! Connected samples of one label, followed from slice to slice: pores are outside and enclosed by the surface, bodies
//! are inside.
//!
//! Outside, samples are connected through their six faces, inside also through edges and corners, so that a wall of one
//! sample keeps two pores apart. A component is complete with the first slice that has none of its samples; the
//! components that end with a slice are returned in the order of their first samples.
//!
//! Memory: the runs of two slices, and the components that reach the last of them.

use crate::export::{LayerCell, RegionFrame, RegionSlice, Run};
use crate::interior::Rows;

/// Kind of the components.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sought {
    /// Outside, enclosed.
    Pores,
    /// Inside, one label each.
    Bodies,
}

/// A component, in voxels of the volume.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Component {
    /// Label of its samples, 0 outside.
    pub(super) label: u16,
    pub(super) samples: u64,
    /// Sum of the samples' coordinates.
    pub(super) sums: [i128; 3],
    /// Least and greatest coordinates of its samples.
    pub(super) range: [[i64; 3]; 2],
    /// Area of the surface around it.
    pub(super) area: f64,
    /// Index of its first sample in the order of slices and rows.
    first: u64,
    /// Component that it was joined with, or itself.
    parent: u32,
    /// Number among all components so far.
    pub(super) serial: u32,
    /// True if it reaches the border of the swept samples.
    is_outer: bool,
    /// True if it has samples in the last slice.
    is_live: bool,
}

impl Component {
    fn join(&mut self, other: &Self) {
        self.samples += other.samples;
        self.area += other.area;
        self.first = self.first.min(other.first);
        self.is_outer |= other.is_outer;
        for axis in 0..3 {
            self.sums[axis] += other.sums[axis];
            self.range[0][axis] = self.range[0][axis].min(other.range[0][axis]);
            self.range[1][axis] = self.range[1][axis].max(other.range[1][axis]);
        }
    }
}

/// Samples of a row that belong to a component.
#[derive(Clone, Copy, Debug)]
struct ComponentRun {
    start: u32,
    end: u32,
    component: u32,
}

/// The components of the slices so far.
pub(super) struct Components {
    sought: Sought,
    frame: RegionFrame,
    slice: u32,
    before: Rows<ComponentRun>,
    now: Rows<ComponentRun>,
    components: Vec<Component>,
    /// Components that touch the present run.
    touched: Vec<u32>,
    /// Samples inside so far.
    pub(super) solid: u64,
    /// True if cells outside are noted.
    is_noting: bool,
    /// The cells of the last slice with the components that they bound.
    pub(super) noted: Vec<Noted>,
    /// Serial number of the component that each was joined with, or its own.
    pub(super) parents: Vec<u32>,
}

/// A cell, and a component outside that has a corner of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Noted {
    pub(super) serial: u32,
    pub(super) number: u64,
    pub(super) cell: [u32; 3],
}

/// A label, and the area of the surface that a cell adds to its samples.
pub(super) type Side = (u16, f64);

/// Calls back with the areas of a cell.
pub(super) type SidesOf<'a> = dyn Fn(&LayerCell, &mut dyn FnMut(Side)) + 'a;

impl Components {
    pub(super) fn new(sought: Sought, frame: RegionFrame, is_noting: bool) -> Self {
        let (before, now) = (Rows::default(), Rows::default());
        Self {
            sought,
            frame,
            slice: 0,
            before,
            now,
            components: Vec::new(),
            touched: Vec::new(),
            solid: 0,
            is_noting,
            noted: Vec::new(),
            parents: Vec::new(),
        }
    }

    /// Takes the next slice; `sides` are the areas of a cell's surface by label. Returns the components that ended.
    pub(super) fn slice(&mut self, slice: &RegionSlice, sides: &SidesOf<'_>) -> Vec<Component> {
        self.now.clear();
        self.noted.clear();
        for row in 0..self.frame.height {
            self.row(slice, row);
        }
        for cell in &slice.cells {
            sides(cell, &mut |side| self.add_area(cell, side));
        }
        let done = self.settle();
        std::mem::swap(&mut self.before, &mut self.now);
        self.slice += 1;
        done
    }

    /// The components that reach the last slice. Those outside reach the border.
    pub(super) fn finish(&mut self) -> Vec<Component> {
        self.now.clear();
        self.settle()
    }

    /// Takes the runs of a row.
    fn row(&mut self, slice: &RegionSlice, row: usize) {
        for run in slice.runs.row(row) {
            if run.label != 0 {
                self.solid += u64::from(run.end - run.start);
            }
            if (run.label == 0) == (self.sought == Sought::Pores) {
                let component = self.connect(run, row);
                self.now.push(ComponentRun { start: run.start, end: run.end, component });
            }
        }
        self.now.end_row();
    }

    /// A new component of one run.
    fn alone(&self, run: &Run, row: usize) -> Component {
        let RegionFrame { origin, width, height, slices } = self.frame;
        let (first, count) = (origin[0] + i64::from(run.start), i64::from(run.end - run.start));
        let [y, z] = [origin[1] + row as i64, origin[2] + i64::from(self.slice)];
        let along = i128::from(2 * first + count - 1) * i128::from(count) / 2;
        let before = u64::from(self.slice) * height as u64 + row as u64;
        let at_side = row == 0 || row + 1 == height || self.slice == 0 || self.slice + 1 >= slices;
        Component {
            label: run.label,
            samples: u64::from(run.end - run.start),
            sums: [along, i128::from(y) * i128::from(count), i128::from(z) * i128::from(count)],
            range: [[first, y, z], [first + count - 1, y, z]],
            area: 0.0,
            first: before * u64::from(width) + u64::from(run.start),
            parent: 0,
            serial: 0,
            is_outer: at_side || run.start == 0 || run.end == width,
            is_live: true,
        }
    }

    /// Joins the components that touch a run; without any, makes a new one. Returns its index.
    #[expect(clippy::cast_possible_truncation, reason = "at most a component for each run of two slices")]
    fn connect(&mut self, run: &Run, row: usize) -> u32 {
        // Faces connect samples.
        let touched = |parts: &[ComponentRun], into: &mut Vec<u32>| {
            let from = parts.partition_point(|other| other.end <= run.start);
            let touching = parts[from..].iter().take_while(|other| other.start < run.end);
            into.extend(touching.map(|other| other.component));
        };
        let mut others = std::mem::take(&mut self.touched);
        if let Some(above) = row.checked_sub(1) {
            touched(self.now.row(above), &mut others);
        }
        touched(self.before.row(row), &mut others);
        let alone = self.alone(run, row);
        let mut found = None;
        for other in others.drain(..) {
            let other = self.root(other);
            if self.components[other as usize].label == run.label {
                found = Some(found.map_or(other, |found| self.join(found, other)));
            }
        }
        self.touched = others;
        if let Some(found) = found {
            self.components[found as usize].join(&alone);
            return found;
        }
        let number = self.components.len() as u32;
        let serial = self.parents.len() as u32;
        if self.is_noting {
            self.parents.push(serial);
        }
        self.components.push(Component { parent: number, serial, ..alone });
        number
    }

    /// Joins two components; returns the remaining one.
    fn join(&mut self, one: u32, other: u32) -> u32 {
        let (kept, joined) = (one.min(other), one.max(other));
        if kept != joined {
            let other = self.components[joined as usize];
            self.components[kept as usize].join(&other);
            self.components[joined as usize].parent = kept;
            if self.is_noting {
                let (elder, other) = (self.components[kept as usize].serial, other.serial);
                self.parents[elder.max(other) as usize] = elder.min(other);
                self.components[kept as usize].serial = elder.min(other);
            }
        }
        kept
    }

    fn root(&mut self, mut at: u32) -> u32 {
        // A parent is smaller, so this ends.
        loop {
            let parent = self.components[at as usize].parent;
            if parent == at {
                return at;
            }
            let above = self.components[parent as usize].parent;
            self.components[at as usize].parent = above;
            at = above;
        }
    }

    /// Adds a side of a cell to the components of the cell's corners with its label. Several components share it.
    fn add_area(&mut self, cell: &LayerCell, (label, area): Side) {
        if (label == 0) != (self.sought == Sought::Pores) {
            return;
        }
        let mut found = [0; 8];
        let mut count = 0;
        let rows = [cell.row.wrapping_sub(1), cell.row];
        let slices = [&self.before, &self.now].into_iter();
        for parts in slices.flat_map(|slice| rows.map(|row| slice.row(row))) {
            let from = parts.partition_point(|part| part.end < cell.x);
            for x in [cell.x.wrapping_sub(1), cell.x] {
                if let Some(part) =
                    parts[from..].iter().find(|part| part.end > x).filter(|part| part.start <= x)
                {
                    found[count] = part.component;
                    count += 1;
                }
            }
        }
        let mut of_label = 0;
        for at in 0..count {
            let root = self.root(found[at]);
            if self.components[root as usize].label == label {
                found[of_label] = root;
                of_label += 1;
            }
        }
        if self.is_noting {
            let RegionFrame { origin: [x, y, z], .. } = self.frame;
            let low = [x + i64::from(cell.x), y + cell.row as i64, z + i64::from(self.slice)];
            let low = low.map(|c| u32::try_from(c).unwrap_or(0));
            for (at, root) in found[..of_label].iter().enumerate() {
                if !found[..at].contains(root) {
                    let serial = self.components[*root as usize].serial;
                    self.noted.push(Noted { serial, number: cell.number, cell: low });
                }
            }
        }
        for root in &found[..of_label] {
            self.components[*root as usize].area += area / of_label as f64;
        }
    }

    /// Removes the components without a sample in this slice, and renumbers the others.
    #[expect(clippy::cast_possible_truncation, reason = "at most a component for each run of two slices")]
    fn settle(&mut self) -> Vec<Component> {
        self.components.iter_mut().for_each(|component| component.is_live = false);
        let mut parts = std::mem::take(&mut self.now);
        for part in parts.items_mut() {
            part.component = self.root(part.component);
            self.components[part.component as usize].is_live = true;
        }
        let (mut live, mut done) = (Vec::new(), Vec::new());
        let mut names = vec![0; self.components.len()];
        for (at, component) in self.components.iter().enumerate() {
            if component.is_live {
                names[at] = live.len() as u32;
                live.push(Component { parent: live.len() as u32, ..*component });
            } else if component.parent as usize == at && !(component.is_outer && self.sought == Sought::Pores)
            {
                done.push(*component);
            }
        }
        parts.items_mut().iter_mut().for_each(|part| part.component = names[part.component as usize]);
        (self.now, self.components) = (parts, live);
        done.sort_unstable_by_key(|component| component.first);
        done
    }
}

//! Components outside the skin, followed from slice to slice.
//!
//! Memory: two slices of runs, and the components that reach the last of them. A sweep that keeps the fates of all
//! components, for a second one that needs them, takes 5 bytes more for each component that ever existed.

use super::{Enclosed, Outward, Rows, Side, SkinVoxel};
use crate::load::ModelView;

/// Agreement of the normals around a component from which it is deep inside, or outside: the sum of their components
/// towards it over the sum of the absolute ones. Around a cavity in a wall one voxel thick they cancel.
const AGREE: f64 = 0.3;

/// Voxels between two skin voxels of a row, or between one and the border: from `start` up to `end`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Run {
    pub(crate) start: u32,
    pub(crate) end: u32,
    component: u32,
}

/// A skin voxel of a row.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SkinItem {
    pub(crate) x: u32,
    /// Normal in voxels; zeros for none.
    outward: [f32; 3],
}

/// One slice: skin and runs, row by row, in coordinates from one voxel before the first skin voxel on.
#[derive(Debug, Default)]
pub(crate) struct Slice {
    pub(crate) skin: Rows<SkinItem>,
    pub(crate) runs: Rows<Run>,
}

/// A connected component of voxels that are not skin.
#[derive(Clone, Copy, Debug, Default)]
struct Component {
    /// Component that it was joined with, or itself.
    parent: u32,
    /// Name for the whole sweep, once a slice is done.
    name: Option<u32>,
    outer: bool,
    voxels: u64,
    /// Sum of the components of the normals around it towards it, and the sum of their absolute values.
    toward: f64,
    size: f64,
}

/// Fate of every component of a sweep: the component that it is joined with later, and its side.
#[derive(Debug, Default)]
pub(crate) struct ComponentSides {
    parents: Vec<u32>,
    sides: Vec<Option<Side>>,
    /// Undecided voxels.
    pub(crate) unknown: u64,
}

impl ComponentSides {
    fn root(&self, mut name: u32) -> u32 {
        // A name's parent is smaller, so this ends.
        while let Some(parent) = self.parents.get(name as usize).filter(|parent| **parent < name) {
            name = *parent;
        }
        name
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        if let Some(parent) = self.parents.get_mut(a.max(b) as usize) {
            *parent = a.min(b);
        }
    }

    fn settle(&mut self, name: u32, side: Side) {
        let root = self.root(name) as usize;
        if let Some(known) = self.sides.get_mut(root) {
            *known = Some(side);
        }
    }

    /// Resolves every name's side, so that no chain of parents is followed later.
    fn flatten(&mut self) {
        for name in 0..self.parents.len() {
            // Parents are smaller, so they are resolved already.
            let parent = self.parents[name] as usize;
            self.sides[name] = self.sides.get(parent).copied().flatten();
        }
        self.parents = Vec::new();
    }
}

/// Follows the components from slice to slice; components that end only leave their numbers of voxels.
pub(crate) struct Sweep {
    low: [u32; 2],
    width: u32,
    height: usize,
    outward: Outward,
    before: Slice,
    components: Vec<Component>,
    names: u32,
    /// Fates that are written.
    kept: Option<ComponentSides>,
    /// Fates of an earlier sweep, which are read.
    known: Option<ComponentSides>,
    found: Enclosed,
    begun: bool,
}

impl Sweep {
    /// A sweep over the slices of a box, from the one before its first to the one behind its last.
    pub(crate) fn new([low, end]: [[u32; 3]; 2], outward: Outward) -> Self {
        Self {
            low: [low[0], low[1]],
            width: end[0] - low[0] + 2,
            height: (end[1] - low[1] + 2) as usize,
            outward,
            before: Slice::default(),
            components: Vec::new(),
            names: 0,
            kept: None,
            known: None,
            found: Enclosed::default(),
            begun: false,
        }
    }

    /// The sweep, keeping the fate of every component.
    pub(crate) fn keeping_fates(self) -> Self {
        Self { kept: Some(ComponentSides::default()), ..self }
    }

    /// The sweep, with the fate of every component known.
    pub(crate) fn knowing(self, fates: ComponentSides) -> Self {
        Self { known: Some(fates), ..self }
    }

    /// Side of a run, if the fates are known.
    pub(crate) fn side(&self, run: Run) -> Side {
        let Some(fates) = &self.known else { return Side::Outside };
        let name = self.components.get(run.component as usize).and_then(|component| component.name);
        let side = name.and_then(|name| fates.sides.get(name as usize).copied().flatten());
        side.unwrap_or(Side::Outside)
    }

    /// The latest slice.
    pub(crate) fn last(&self) -> &Slice {
        &self.before
    }

    /// Takes the next slice, its skin in rows. An empty one behind another costs nothing.
    pub(crate) fn slice(&mut self, view: &ModelView<'_>, skin: &[SkinVoxel]) {
        // A slice without skin is all outside.
        if skin.is_empty() && self.begun && self.before.skin.is_empty() {
            return;
        }
        let mut slice = Slice::default();
        let mut voxels = skin.iter().peekable();
        for row in 0..self.height {
            let mut start = 0;
            while let Some(found) =
                voxels.next_if(|v| v.y.wrapping_sub(self.low[1]).wrapping_add(1) as usize == row)
            {
                let x = found.x.wrapping_sub(self.low[0]).wrapping_add(1);
                if x < start || x >= self.width {
                    // The voxel did not exist when the model was measured: its file is being overwritten.
                    continue;
                }
                if x > start {
                    slice.runs.push(Run { start, end: x, component: 0 });
                }
                start = x + 1;
                let code = found.code(view);
                #[expect(clippy::cast_possible_truncation, reason = "parts of a direction")]
                let outward = code.map_or([0.0; 3], |code| self.outward.of(code).map(|c| c as f32));
                slice.skin.push(SkinItem { x, outward });
            }
            if start < self.width {
                slice.runs.push(Run { start, end: self.width, component: 0 });
            }
            self.connect(&mut slice, row);
            slice.skin.end_row();
            slice.runs.end_row();
        }
        self.vote(&slice);
        self.settle(&mut slice);
        self.before = slice;
        self.begun = true;
    }

    /// Connects the runs of the row that was just filled to the components that they touch.
    fn connect(&mut self, slice: &mut Slice, row: usize) {
        let (above, new) = slice.runs.last_and_open();
        let behind = self.before.runs.row(row);
        let (mut a, mut b) = (0, 0);
        for run in new {
            let mut component = None;
            for (others, at) in [(above, &mut a), (behind, &mut b)] {
                while others.get(*at).is_some_and(|other| other.end <= run.start) {
                    *at += 1;
                }
                for other in others[*at..].iter().take_while(|other| other.start < run.end) {
                    component = Some(match component {
                        None => root(&mut self.components, other.component),
                        Some(known) => join(&mut self.components, &mut self.kept, known, other.component),
                    });
                }
            }
            let component = component.unwrap_or_else(|| {
                let new = index(self.components.len());
                let outer = !self.begun;
                self.components.push(Component { parent: new, outer, ..Component::default() });
                new
            });
            run.component = component;
            if let Some(found) = self.components.get_mut(component as usize) {
                found.voxels += u64::from(run.end - run.start);
            }
        }
    }

    /// Adds the normals' components towards the runs next to them.
    fn vote(&mut self, slice: &Slice) {
        for row in 0..self.height {
            let (skin, runs) = (slice.skin.row(row), slice.runs.row(row));
            let mut at = 0;
            for item in skin {
                while runs.get(at).is_some_and(|run| run.end < item.x) {
                    at += 1;
                }
                if let Some(run) = runs.get(at).filter(|run| run.end == item.x) {
                    tell(&mut self.components, run.component, -item.outward[0]);
                    at += 1;
                }
                if let Some(run) = runs.get(at).filter(|run| run.start == item.x + 1) {
                    tell(&mut self.components, run.component, item.outward[0]);
                }
            }
            if let Some(above) = row.checked_sub(1) {
                tell_all(&mut self.components, skin, slice.runs.row(above), |n| -n[1]);
                tell_all(&mut self.components, slice.skin.row(above), runs, |n| n[1]);
            }
            tell_all(&mut self.components, skin, self.before.runs.row(row), |n| -n[2]);
            tell_all(&mut self.components, self.before.skin.row(row), runs, |n| n[2]);
        }
    }

    /// Renumbers the components of the slice, and counts those that do not reach it.
    fn settle(&mut self, slice: &mut Slice) {
        let mut numbers = vec![u32::MAX; self.components.len()];
        let mut kept: Vec<Component> = Vec::new();
        for run in slice.runs.items_mut() {
            let root = root(&mut self.components, run.component) as usize;
            if numbers[root] == u32::MAX {
                numbers[root] = index(kept.len());
                let mut component = Component { parent: index(kept.len()), ..self.components[root] };
                component.name = component.name.or_else(|| self.new_name());
                kept.push(component);
            }
            run.component = numbers[root];
        }
        for (at, component) in self.components.iter().enumerate() {
            if numbers[at] == u32::MAX && component.parent as usize == at {
                self.found.add(component, &mut self.kept);
            }
        }
        self.components = kept;
    }

    fn new_name(&mut self) -> Option<u32> {
        let name = self.names;
        self.names = self.names.saturating_add(1);
        if let Some(fates) = &mut self.kept {
            fates.parents.push(name);
            fates.sides.push(None);
        }
        Some(name)
    }

    /// The counts after the last slice; and the fates, if they were kept.
    pub(crate) fn finish(mut self) -> (Enclosed, ComponentSides) {
        self.settle(&mut Slice::default());
        let mut fates = self.kept.unwrap_or_default();
        fates.flatten();
        fates.unknown = self.found.unknown;
        (self.found, fates)
    }
}

impl Enclosed {
    fn add(&mut self, component: &Component, kept: &mut Option<ComponentSides>) {
        let Component { outer, toward, size, voxels, .. } = *component;
        let side = if outer {
            Side::Outside
        } else if toward > AGREE * size {
            self.cavities += voxels;
            Side::Outside
        } else if toward < -AGREE * size {
            self.inside += voxels;
            Side::Inside
        } else {
            self.unknown += voxels;
            // The better guess; without normals, enclosed components are taken as full.
            if toward > 0.0 { Side::Outside } else { Side::Inside }
        };
        if let (Some(fates), Some(name)) = (kept, component.name) {
            fates.settle(name, side);
        }
    }
}

/// Numbers of components of one slice; a slice has at most 2^32 voxels, and runs lie between others.
fn index(count: usize) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX)
}

fn root(components: &mut [Component], mut at: u32) -> u32 {
    while let Some(parent) = components.get(at as usize).map(|c| c.parent).filter(|parent| *parent != at) {
        // Halving the path keeps it short.
        let above = components.get(parent as usize).map_or(parent, |c| c.parent);
        if let Some(component) = components.get_mut(at as usize) {
            component.parent = above;
        }
        at = parent;
    }
    at
}

/// Joins two components; the lower number stays.
fn join(components: &mut [Component], kept: &mut Option<ComponentSides>, a: u32, b: u32) -> u32 {
    let (a, b) = (root(components, a), root(components, b));
    let (to, from) = (a.min(b), a.max(b));
    if to != from
        && let Some(part) = components.get(from as usize).copied()
        && let Some(whole) = components.get_mut(to as usize)
    {
        whole.outer |= part.outer;
        whole.voxels += part.voxels;
        whole.toward += part.toward;
        whole.size += part.size;
        whole.name = match (whole.name, part.name) {
            (Some(a), Some(b)) => {
                if let Some(fates) = kept {
                    fates.join(a, b);
                }
                Some(a.min(b))
            }
            (a, b) => a.or(b),
        };
        components[from as usize].parent = to;
    }
    to
}

fn tell(components: &mut [Component], component: u32, toward: f32) {
    let at = root(components, component);
    if let Some(component) = components.get_mut(at as usize) {
        component.toward += f64::from(toward);
        component.size += f64::from(toward.abs());
    }
}

/// Adds the normals of a row of skin to the runs next to it.
fn tell_all(components: &mut [Component], skin: &[SkinItem], runs: &[Run], part: impl Fn(&[f32; 3]) -> f32) {
    let mut at = 0;
    for item in skin {
        while runs.get(at).is_some_and(|run| run.end <= item.x) {
            at += 1;
        }
        if let Some(run) = runs.get(at).filter(|run| run.start <= item.x) {
            tell(components, run.component, part(&item.outward));
        }
    }
}

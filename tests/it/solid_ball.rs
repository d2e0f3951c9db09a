//! A solid that is not a volume: an analytic ball, built out of core by the same builder, in the few lines of
//! [`Ball`] and nothing else. If this fails, the builder has grown to need samples, or to depend on which boxes a
//! solid knows to be all in or all out: models of meshes and of primitives would cost volume, or have holes.

use crate::prelude::*;
use infobyte::builder::{
    Cover, ItemForm, OccupancyRows, ScanSummary, SkinSlice, Solid, SolidWorker, Tile, VoxelBox, build_solid,
};

/// Voxels whose centre is at most a radius from a point of the lattice.
struct Ball {
    dims: Dims,
    center: [i64; 3],
    radius: i64,
    /// Does it tell the cover of boxes?
    covers: bool,
    /// Voxels whose bits were asked for.
    asked: AtomicU64,
}

impl Ball {
    fn new(dims: [u32; 3], center: [i64; 3], radius: i64) -> Self {
        let dims = Dims::new(dims[0], dims[1], dims[2]).unwrap();
        Self { dims, center, radius, covers: true, asked: AtomicU64::new(0) }
    }
}

impl Solid for Ball {
    fn dims(&self) -> Dims {
        self.dims
    }

    fn metadata(&self, _: &ScanSummary) -> Metadata {
        Metadata { gradient: "analytic".into(), ..Metadata::of_grid(self.dims, "ball") }
    }

    fn form(&self, channel: Channel, _: &ScanSummary) -> Option<ItemForm> {
        match channel {
            Channel::Normal => Some(ItemForm::AsIs { bytes: 2 }),
            Channel::Offset => Some(ItemForm::AsIs { bytes: 1 }),
            _ => None,
        }
    }

    fn worker_bytes(&self, _: &Tile) -> u64 {
        3 * SkinSlice::MAX_VOXELS as u64
    }

    fn worker(&self, _: &Tile) -> Box<dyn SolidWorker + '_> {
        Box::new(BallWorker { ball: self, normals: Vec::new(), offsets: Vec::new() })
    }
}

struct BallWorker<'a> {
    ball: &'a Ball,
    normals: Vec<u8>,
    offsets: Vec<u8>,
}

impl SolidWorker for BallWorker<'_> {
    fn start(&mut self, _: &VoxelBox) -> Result<(), SourceError> {
        Ok(())
    }

    fn cover(&mut self, region: &VoxelBox) -> Cover {
        let (mut nearest, mut farthest) = (0, 0);
        for (range, c) in [&region.x, &region.y, &region.z].into_iter().zip(self.ball.center) {
            let (low, high) = (i64::from(range.start), i64::from(range.end) - 1);
            nearest += (c.clamp(low, high) - c).pow(2);
            farthest += (low - c).abs().max((high - c).abs()).pow(2);
        }
        match self.ball.radius.pow(2) {
            _ if !self.ball.covers => Cover::Mixed,
            r if farthest <= r => Cover::Inside,
            r if nearest > r => Cover::Outside,
            _ => Cover::Mixed,
        }
    }

    fn occupancy(&mut self, rows: &mut OccupancyRows<'_>) -> Result<(), SourceError> {
        let [cx, cy, cz] = self.ball.center;
        self.ball.asked.fetch_add((rows.x().len() * rows.y().len()) as u64, Ordering::Relaxed);
        for y in rows.y() {
            let left =
                self.ball.radius.pow(2) - (i64::from(y) - cy).pow(2) - (i64::from(rows.z()) - cz).pow(2);
            let half = if left < 0 { 0 } else { left.isqrt() + 1 };
            let at = |x: i64| u32::try_from(x.max(0)).unwrap();
            rows.set_row(y, at(cx - half + 1)..at(cx + half));
        }
        Ok(())
    }

    #[expect(clippy::cast_possible_truncation, reason = "a radius of voxels, and steps of 1/64")]
    fn describe(&mut self, skin: &SkinSlice<'_>) -> Result<(), SourceError> {
        self.normals.clear();
        self.offsets.clear();
        for voxel in skin.voxels() {
            let d: [f64; 3] = std::array::from_fn(|a| (i64::from(voxel[a]) - self.ball.center[a]) as f64);
            let inwards = self.ball.radius as f64 - d.iter().map(|c| c * c).sum::<f64>().sqrt();
            self.normals.extend(normal::encode(d.map(|c| c as f32)).to_le_bytes());
            self.offsets.extend(((inwards * 64.0) as i8).to_le_bytes());
        }
        Ok(())
    }

    fn items(&self, channel: Channel) -> &[u8] {
        if channel == Channel::Normal { &self.normals } else { &self.offsets }
    }
}

fn options(share_mib: u64, threads: usize) -> BuildOptions {
    BuildOptions {
        channels: Some(Channels::from([Channel::Normal, Channel::Offset])),
        ..share(share_mib, threads)
    }
}

fn build(ball: &Ball, options: &BuildOptions, to: &Path) -> BuildReport {
    build_solid(ball, options, to, &Silent).unwrap()
}

/// The skin by the definition, one voxel at a time, in Morton order.
fn skin_of(ball: &Ball, connectivity: Connectivity) -> Vec<u64> {
    let n = ball.dims.to_array().map(i64::from);
    let inside = |p: [i64; 3]| {
        let apart: i64 = (0..3).map(|a| (p[a] - ball.center[a]).pow(2)).sum();
        (0..3).all(|a| (0..n[a]).contains(&p[a])) && apart <= ball.radius.pow(2)
    };
    let steps: Vec<[i64; 3]> = (0..27_i64)
        .map(|i| [i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1])
        .filter(|d| connectivity == Connectivity::Thick6 || d.iter().map(|c| c.abs()).sum::<i64>() == 1)
        .collect();
    let mut codes = Vec::new();
    for (z, y, x) in (0..n[2]).flat_map(|z| (0..n[1]).flat_map(move |y| (0..n[0]).map(move |x| (z, y, x)))) {
        if inside([x, y, z]) && steps.iter().any(|d| !inside([x + d[0], y + d[1], z + d[2]])) {
            let [x, y, z] = [x, y, z].map(|c| u32::try_from(c).unwrap());
            codes.push(morton::encode(x, y, z));
        }
    }
    codes.sort_unstable();
    codes
}

#[test]
fn a_ball_is_built_as_it_is_defined_wherever_it_lies() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("ball.oct");
    for (dims, center, radius) in [
        ([150, 140, 130], [75, 70, 65], 60),
        // Cut by every side of the grid, and grids that end within a word or a brick.
        ([129, 97, 66], [64, 40, 30], 70),
        ([33, 200, 5], [0, 100, 2], 40),
        ([640, 35, 35], [320, 17, 17], 400),
        ([1, 1, 1], [0, 0, 0], 1),
    ] {
        for connectivity in [Connectivity::Thin26, Connectivity::Thick6] {
            let ball = Ball::new(dims, center, radius);
            let report = build(&ball, &BuildOptions { connectivity, ..options(16, 2) }, &file);
            let want = skin_of(&ball, connectivity);
            assert_eq!(report.skin_voxels, want.len() as u64, "{dims:?} {connectivity:?}");
            let model = Model::open(&file).unwrap();
            verify(&model).unwrap();
            let code = |at: [u32; 3]| morton::encode(at[0], at[1], at[2]);
            let got: Vec<u64> = finest(&model).into_iter().map(|(at, _)| code(at)).collect();
            assert!(got == want, "{dims:?} {connectivity:?}");
            let (normals, offsets) =
                (model.items(Channel::Normal).unwrap(), model.items(Channel::Offset).unwrap());
            for (at, code) in (0..).zip(&got) {
                let d: [f64; 3] =
                    std::array::from_fn(|a| (i64::from(morton::decode(*code)[a]) - center[a]) as f64);
                let n = normal::decode(u16::from_le_bytes(normals.get(at).unwrap().try_into().unwrap()));
                let length = d.iter().map(|c| c * c).sum::<f64>().sqrt();
                let along: f64 = d.iter().zip(n).map(|(d, n)| d * f64::from(n)).sum();
                assert!(along >= 0.9999 * length, "{n:?} at {d:?}");
                if connectivity == Connectivity::Thin26 && length > radius as f64 - 1.9 {
                    let offset = f64::from(offsets.get(at).unwrap()[0].cast_signed()) / 64.0;
                    assert!((radius as f64 - length - offset).abs() < 1.0 / 64.0, "{offset} at {d:?}");
                }
            }
        }
    }
}

#[test]
fn boxes_all_in_or_all_out_are_not_asked_for_and_change_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let dims = [512, 500, 480];
    let mut ball = Ball::new(dims, [250, 260, 240], 200);
    let report = build(&ball, &options(16, 2), &at("a.oct"));
    assert!(report.skin_voxels > 300_000, "{}", report.skin_voxels);
    let voxels = ball.dims.voxels();
    let asked = std::mem::take(ball.asked.get_mut());
    assert!(asked * 3 < voxels, "{asked} of {voxels} voxels were looked at");
    ball.covers = false;
    let refused = build_solid(&ball, &options(0, 1), &at("b.oct"), &Silent).unwrap_err();
    let smallest = refused.minimum_bytes().unwrap();
    let small = BuildOptions { memory: MemoryCap::Share(smallest), ..options(0, 5) };
    assert_eq!(build(&ball, &small, &at("b.oct")).threads, 1);
    assert!(*ball.asked.get_mut() > voxels);
    ball.covers = true;
    build(&ball, &options(64, 5), &at("c.oct"));
    let [a, b, c] = ["a.oct", "b.oct", "c.oct"].map(|name| std::fs::read(at(name)).unwrap());
    assert!(a == b && a == c, "the same bytes");
}

#[test]
fn what_cannot_be_built_is_refused_and_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("ball.oct");
    let away = Ball::new([40, 40, 40], [-500, 20, 20], 100);
    let refused = build_solid(&away, &options(16, 1), &file, &Silent).unwrap_err().to_string();
    assert!(refused.starts_with("ball: no voxel is inside"), "{refused}");
    let colored = BuildOptions { channels: Some(Channels::from([Channel::Color])), ..options(16, 1) };
    let refused = build_solid(&Ball::new([40, 40, 40], [20; 3], 10), &colored, &file, &Silent).unwrap_err();
    assert!(refused.to_string().contains("does not have the channel 'color'"), "{refused}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

//! `oct export`: what other programs are given is closed, has every sample on its side, and lies where the model lies.
//! If this fails, prints of scans have holes, or are mirrored.

#![expect(clippy::cast_possible_truncation, reason = "small files")]

use crate::prelude::*;
use std::collections::HashSet;

use infobyte::builder::Tolerance;
use infobyte::jobs::export::ExportReport;

/// A folder with a model in it.
struct Case {
    folder: tempfile::TempDir,
    dims: [u32; 3],
}

impl Case {
    /// Inside is what is above 0.
    fn new(
        dims: [u32; 3],
        surface: SurfaceKind,
        affine: Affine,
        depth: impl Fn([u32; 3]) -> f32 + Sync,
    ) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let [nx, ny, nz] = dims;
        let volume = Voxels::from_fn(Dims::new(nx, ny, nz).unwrap(), depth).placed(affine);
        let options = BuildOptions {
            threshold: Threshold::Iso(0.0),
            surface: Some(surface),
            ..BuildOptions::default()
        };
        infobyte::build(&volume, &options, folder.path().join("m.oct")).unwrap();
        Self { folder, dims }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn export(&self, name: &str) -> ExportReport {
        let request = Self::request(name, None);
        let report = export(&self.path("m.oct"), &self.path(name), request, &Silent).unwrap();
        assert_eq!(report.closed, request.form.has_triangles().then_some(true));
        report
    }

    fn request(name: &str, error: Option<Tolerance>) -> ExportRequest<'static> {
        let form = ExportForm::of(Path::new(name)).unwrap();
        ExportRequest { error, ..ExportRequest::of(form) }
    }

    fn within(&self, name: &str, error: Tolerance) -> (ExportReport, Mesh) {
        let request = Self::request(name, Some(error));
        let report = export(&self.path("m.oct"), &self.path(name), request, &Silent).unwrap();
        (report, Mesh::read(&self.path(name)))
    }

    fn mesh(&self) -> Mesh {
        let report = self.export("m.ply");
        let mesh = Mesh::read(&self.path("m.ply"));
        assert_eq!(report.separate_bodies, Some(mesh.bodies()));
        mesh
    }

    /// The voxels that a mask has set.
    fn mask(&self) -> Vec<bool> {
        self.export("m.nii");
        fs::read(self.path("m.nii")).unwrap()[352..].iter().map(|b| *b == 1).collect()
    }

    /// The octree of the solid that a file holds, on the grid of the model in voxels of 1 mm.
    fn built_again(&self, name: &str) -> Vec<u8> {
        let (file, model) = (self.path(name), self.path("again.oct"));
        let size = self.dims.map(|n| n.to_string()).join("x");
        let grid = ["--voxel", "1", "--origin", "-0.5,-0.5,-0.5", "--dims", &size];
        let what = if name.contains(".n") { &["--iso", "0.5"][..] } else { &grid[..] };
        oct(&[&["build", file.to_str().unwrap(), "-o", model.to_str().unwrap(), "--json"], what].concat())
            .json();
        Model::open(&model).unwrap().section_bytes(SectionKind::Nodes).unwrap().to_vec()
    }
}

/// Corners in mm, and triangles.
struct Mesh {
    corners: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Reads the binary PLY that the program writes: the counts from its header, the rest as bytes.
    fn read(path: &Path) -> Self {
        let bytes = fs::read(path).unwrap();
        let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        let head = std::str::from_utf8(&bytes[..end]).unwrap();
        let count = |name: &str| -> usize {
            let line = head.lines().find_map(|line| line.strip_prefix(&format!("element {name} ")));
            line.map_or(0, |n| n.parse().unwrap())
        };
        let words = if head.contains("property float nx") { 6 } else { 3 };
        let float = |at: usize| f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        let triple = |at: usize| [float(at), float(at + 4), float(at + 8)];
        let corner = |i: usize| end + 4 * words * i;
        let faces = corner(count("vertex"));
        let face = |i: usize| {
            let at = faces + 13 * i;
            assert_eq!(bytes[at], 3);
            [1, 5, 9].map(|o| u32::from_le_bytes(bytes[at + o..at + o + 4].try_into().unwrap()))
        };
        assert_eq!(bytes.len(), faces + 13 * count("face"));
        Self {
            corners: (0..count("vertex")).map(|i| triple(corner(i))).collect(),
            normals: if words == 6 {
                (0..count("vertex")).map(|i| triple(corner(i) + 12)).collect()
            } else {
                Vec::new()
            },
            triangles: (0..count("face")).map(face).collect(),
        }
    }

    /// Every edge has two triangles, which run along it in opposite directions; and the triangles around a corner form
    /// one ring.
    fn is_closed_manifold(&self) {
        let mut edges = HashSet::new();
        let mut around: HashMap<u32, HashMap<u32, u32>> = HashMap::new();
        for [a, b, c] in &self.triangles {
            assert!(a != b && b != c && c != a);
            for (from, to, third) in [(a, b, c), (b, c, a), (c, a, b)] {
                assert!(edges.insert((*from, *to)), "an edge is used twice in one direction");
                around.entry(*from).or_default().insert(*to, *third);
            }
        }
        assert!(edges.iter().all(|(from, to)| edges.contains(&(*to, *from))), "an edge has one triangle");
        assert_eq!(around.len(), self.corners.len(), "a corner without triangles");
        for ring in around.values() {
            let start = *ring.keys().next().unwrap();
            let (mut at, mut steps) = (ring[&start], 1);
            while at != start {
                at = ring[&at];
                steps += 1;
            }
            assert_eq!(steps, ring.len(), "two rings meet in a corner");
        }
    }

    fn volume(&self) -> f64 {
        self.triangles.iter().map(|triangle| self.volume_under(triangle)).sum::<f64>() / 6.0
    }

    fn volume_under(&self, triangle: &[u32; 3]) -> f64 {
        let [p, q, r] = triangle.map(|i| self.corners[i as usize].map(f64::from));
        p[0] * (q[1] * r[2] - q[2] * r[1])
            + p[1] * (q[2] * r[0] - q[0] * r[2])
            + p[2] * (q[0] * r[1] - q[1] * r[0])
    }

    /// Sets of triangles with common corners that enclose something.
    fn bodies(&self) -> u64 {
        let mut around = vec![Vec::new(); self.corners.len()];
        for triangle in &self.triangles {
            triangle.iter().for_each(|corner| around[*corner as usize].push(triangle));
        }
        let (mut seen, mut bodies) = (HashSet::new(), 0);
        for first in &self.triangles {
            let (mut waiting, mut volume) = (vec![first], 0.0);
            while let Some(triangle) = waiting.pop() {
                if seen.insert(triangle) {
                    volume += self.volume_under(triangle);
                    waiting.extend(triangle.iter().flat_map(|corner| &around[*corner as usize]));
                }
            }
            bodies += u64::from(volume > 0.0);
        }
        bodies
    }
}

fn identity() -> Affine {
    Affine::from_spacing([1.0; 3])
}

fn ball(middle: f64, radius: f64) -> impl Fn([u32; 3]) -> f32 + Sync {
    move |p| {
        let d = p.map(|c| (f64::from(c) - middle).powi(2)).iter().sum::<f64>().sqrt();
        (radius - d) as f32
    }
}

/// Noise has all 256 patterns of eight samples, and all faces with inside corners on a diagonal.
#[test]
fn noise_gives_closed_manifolds_that_keep_every_sample() {
    for (seed, percent) in [(1, 10), (2, 35), (3, 50), (4, 70), (5, 90)] {
        let mut random = Random(seed);
        let values: Vec<f32> =
            (0..14 * 13 * 12).map(|_| if random.below(100) < percent { 1.0 } else { -1.0 }).collect();
        let case = Case::new([14, 13, 12], SurfaceKind::Skin, identity(), |[x, y, z]| {
            values[((z * 13 + y) * 14 + x) as usize]
        });
        let mesh = case.mesh();
        mesh.is_closed_manifold();
        case.export("m.nrrd");
        let (of_mesh, of_mask) = (case.built_again("m.ply"), case.built_again("m.nrrd"));
        assert_eq!(of_mesh, of_mask, "{percent} % inside");
        // All skin is inside; what it encloses was judged by normals, of which noise has none that say much.
        let inside = case.mask();
        let agree = inside.iter().zip(&values).filter(|(a, b)| **a == (**b > 0.0)).count();
        assert!(agree * 100 >= inside.len() * 95, "{agree} of {}", inside.len());
    }
}

#[test]
fn a_round_trip_gives_the_same_solid_voxel_by_voxel() {
    // Two balls that touch, one of them hollow, and a plate one voxel thick.
    let depth = |p: [u32; 3]| {
        let hollow = ball(14.0, 10.0)(p).min(-ball(14.0, 5.0)(p));
        let plate = if p[2] == 30 && p[0] > 3 && p[1] > 3 { 0.5 } else { -1.0 };
        hollow.max(ball(27.0, 8.0)(p)).max(plate)
    };
    let case = Case::new([40, 38, 37], SurfaceKind::Skin, identity(), depth);
    case.mesh().is_closed_manifold();
    let report = case.export("m.ply");
    assert_eq!(report.cavities, Some(1));
    let text = report.text();
    assert!(text.contains(" with 1 cavity, ") && text.contains("for a solid without them"), "{text}");
    let mask = case.mask();
    let mut at = 0;
    for z in 0..37 {
        for y in 0..38 {
            for x in 0..40 {
                assert_eq!(mask[at], depth([x, y, z]) >= 0.0, "{x} {y} {z}");
                at += 1;
            }
        }
    }
    let model = Model::open(case.path("m.oct")).unwrap();
    let nodes = model.section_bytes(SectionKind::Nodes).unwrap();
    case.export("m.nii.gz");
    for name in ["m.ply", "m.nii", "m.nii.gz"] {
        assert!(case.built_again(name) == nodes, "{name}");
    }
}

/// Sums of blobs, some of them negative: smooth, as what skin encloses is judged by normals, which say nothing about a
/// pit of one voxel in a crease.
#[test]
fn random_bodies_have_the_same_skin_again_once_exported() {
    for seed in 0..3 * u64::from(long()) {
        let mut random = Random(seed);
        let mut place = || 10.0 + 20.0 * random.unit();
        let blobs: Vec<[f64; 4]> = (0..8).map(|_| [place(), place(), place(), place() / 3.0]).collect();
        let depth = |p: [u32; 3]| {
            let all = blobs.iter().zip([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, -0.7, -0.7]).map(
                |([x, y, z, wide], sign)| {
                    let from = [f64::from(p[0]) - x, f64::from(p[1]) - y, f64::from(p[2]) - z];
                    sign * (-from.map(|c| c * c).iter().sum::<f64>() / (wide * wide)).exp()
                },
            );
            (all.sum::<f64>() - 0.4) as f32
        };
        let case = Case::new([41, 39, 40], SurfaceKind::Skin, identity(), depth);
        let model = Model::open(case.path("m.oct")).unwrap();
        let nodes = model.section_bytes(SectionKind::Nodes).unwrap();
        for name in ["m.ply", "m.stl", "m.obj", "m.glb", "m.3mf", "m.nii", "m.nrrd"] {
            case.export(name);
            assert!(case.built_again(name) == nodes, "seed {seed}, {name}");
        }
    }
}

#[test]
fn cells_are_exported_true_below_the_voxel() {
    let case = Case::new([48; 3], SurfaceKind::Cells, identity(), ball(23.3, 17.7));
    let mesh = case.mesh();
    mesh.is_closed_manifold();
    let radius = |p: &[f32; 3]| p.iter().map(|c| (f64::from(*c) - 23.3).powi(2)).sum::<f64>().sqrt();
    let worst = mesh.corners.iter().map(|p| (radius(p) - 17.7).abs()).fold(0.0, f64::max);
    assert!(worst < 0.05, "{worst}");
    for (corner, normal) in mesh.corners.iter().zip(&mesh.normals) {
        let along: f64 = (0..3).map(|a| (f64::from(corner[a]) - 23.3) * f64::from(normal[a])).sum();
        assert!(along / radius(corner) > 0.999, "{corner:?} {normal:?}");
    }
    // A skin of the same samples has the same solid.
    let skin = Case::new([48; 3], SurfaceKind::Skin, identity(), ball(23.3, 17.7));
    assert_eq!(case.mask(), skin.mask());
    assert_eq!(mesh.triangles.len(), skin.mesh().triangles.len());
}

/// Triangles by the least x of their corners, and the most that one of them reaches along x.
struct Surface {
    triangles: Vec<[[f64; 3]; 3]>,
    reach: f64,
}

fn least_x(t: &[[f64; 3]; 3]) -> f64 {
    t[0][0].min(t[1][0]).min(t[2][0])
}

impl Surface {
    fn of(mut triangles: Vec<[[f64; 3]; 3]>) -> Self {
        triangles.sort_by(|a, b| least_x(a).total_cmp(&least_x(b)));
        let reach = triangles.iter().map(|t| t[0][0].max(t[1][0]).max(t[2][0]) - least_x(t));
        Self { reach: reach.fold(0.0, f64::max), triangles }
    }

    /// The least distance of a point: of the triangles before and behind it, until all others are further along x.
    fn distance(&self, p: [f64; 3]) -> f64 {
        let (before, behind) = self.triangles.split_at(self.triangles.partition_point(|t| least_x(t) < p[0]));
        let mut least = f64::INFINITY;
        for t in before.iter().rev() {
            if p[0] - least_x(t) - self.reach >= least {
                break;
            }
            least = least.min(distance(p, t));
        }
        for t in behind {
            if least_x(t) - p[0] >= least {
                break;
            }
            least = least.min(distance(p, t));
        }
        least
    }
}

/// The distance of a point to a triangle.
fn distance(p: [f64; 3], [a, b, c]: &[[f64; 3]; 3]) -> f64 {
    let sub = |a: [f64; 3], b: [f64; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let to_edge = |a: [f64; 3], b: [f64; 3]| {
        let (ab, ap) = (sub(b, a), sub(p, a));
        let along = (dot(ab, ap) / dot(ab, ab)).clamp(0.0, 1.0);
        let away = sub(ap, [ab[0] * along, ab[1] * along, ab[2] * along]);
        dot(away, away).sqrt()
    };
    let (u, v, w) = (sub(*b, *a), sub(*c, *a), sub(p, *a));
    let (uu, uv, vv, uw, vw) = (dot(u, u), dot(u, v), dot(v, v), dot(u, w), dot(v, w));
    let whole = uu * vv - uv * uv;
    let [s, t] = [(vv * uw - uv * vw) / whole, (uu * vw - uv * uw) / whole];
    if s >= 0.0 && t >= 0.0 && s + t <= 1.0 {
        let from = |k: usize| w[k] - s * u[k] - t * v[k];
        let away = [from(0), from(1), from(2)];
        return dot(away, away).sqrt();
    }
    to_edge(*a, *b).min(to_edge(*b, *c)).min(to_edge(*c, *a))
}

impl Mesh {
    fn faces(&self) -> Vec<[[f64; 3]; 3]> {
        self.triangles.iter().map(|f| f.map(|i| self.corners[i as usize].map(f64::from))).collect()
    }
}

/// Bodies of several patches, which are reduced by themselves.
#[test]
fn meshes_within_an_error_are_closed_smaller_and_near() {
    let skewed = Affine { rows: [[0.8, 0.1, 0.0, -40.0], [0.0, -1.1, 0.2, 3.0], [0.1, 0.0, 1.4, 900.0]] };
    let wavy = |p: [u32; 3], middle: [f64; 3]| {
        let [x, y, z] = p.map(f64::from);
        let wave = 2.0 * (x * 0.3).sin() * (y * 0.25).cos();
        let away = [x - middle[0], y - middle[1], z - middle[2] + wave].map(|c| c * c).iter().sum::<f64>();
        (middle[0] * 2.0 / 3.0 - away.sqrt()) as f32
    };
    let is_long = long() > 1;
    for (surface, affine, is_large) in [
        (SurfaceKind::Cells, identity(), true),
        (SurfaceKind::Cells, skewed, is_long),
        (SurfaceKind::Skin, identity(), is_long),
    ] {
        let (dims, middle) =
            if is_large { ([48, 46, 50], [24.0, 22.0, 26.0]) } else { ([35, 33, 36], [17.0, 16.0, 18.0]) };
        let case = Case::new(dims, surface, affine, |p| wavy(p, middle));
        let fine = case.mesh();
        let least = affine.spacing_mm().into_iter().fold(f64::INFINITY, f64::min);
        let mut last = fine.triangles.len();
        for bound in [0.05, 0.1, 0.3] {
            let (report, mesh) = case.within("e.ply", Tolerance::Voxels(bound));
            mesh.is_closed_manifold();
            assert_eq!((report.closed, report.within_mm), (Some(true), Some(bound * least)));
            assert!(report.distance_mm.is_some_and(|mm| mm <= bound * least), "{report:?}");
            let counts = [report.triangles, report.vertices].map(|n| usize::try_from(n).unwrap());
            assert_eq!(counts, [mesh.triangles.len(), mesh.corners.len()]);
            assert_eq!(report.fine_triangles, Some(fine.triangles.len() as u64));
            assert!(mesh.triangles.len() < last, "{surface:?} {bound}: {} of {last}", mesh.triangles.len());
            last = mesh.triangles.len();
            let (old, new) = (fine.faces(), mesh.faces());
            let middle = |t: &[[f64; 3]; 3]| [0, 1, 2].map(|k| (t[0][k] + t[1][k] + t[2][k]) / 3.0);
            let (old, new) = (Surface::of(old), Surface::of(new));
            let there = old.triangles.iter().map(|t| new.distance(t[0]).max(new.distance(middle(t))));
            let back = new.triangles.iter().map(|t| old.distance(middle(t)));
            let worst = there.chain(back).fold(0.0, f64::max) / least;
            assert!(worst <= bound, "{surface:?} {bound}: {worst}");
            let corners: HashSet<[u64; 3]> =
                old.triangles.iter().flatten().map(|at| at.map(f64::to_bits)).collect();
            let squares = corners.iter().map(|at| new.distance(at.map(f64::from_bits)).powi(2));
            let rms = (squares.sum::<f64>() / corners.len() as f64).sqrt();
            let stated = report.rms_mm.unwrap();
            assert!(corners.len() < 20_000 && (stated - rms).abs() < 0.01 * rms, "{stated} {rms}");
        }
        // Smooth cells at a tenth of a voxel: half of the triangles or fewer, of bodies that are large enough.
        let (report, _) = case.within("e.ply", Tolerance::Mm(0.1 * least));
        assert!(
            surface == SurfaceKind::Skin || !is_large || 2 * report.triangles <= fine.triangles.len() as u64
        );
        let same = case.within("none.ply", Tolerance::Voxels(0.0)).0;
        assert_eq!(same.fine_triangles, None);
        assert_eq!(fs::read(case.path("none.ply")).unwrap(), fs::read(case.path("m.ply")).unwrap());
    }
    // Whatever the samples are, and in every format.
    let mut random = Random(5);
    let values: Vec<f32> = (0..26_u32.pow(3)).map(|_| random.below(1000) as f32 / 500.0 - 0.9).collect();
    let case = Case::new([26; 3], SurfaceKind::Cells, identity(), |[x, y, z]| {
        values[((z * 26 + y) * 26 + x) as usize]
    });
    let (report, mesh) = case.within("e.ply", Tolerance::Voxels(0.2));
    mesh.is_closed_manifold();
    for name in ["e.stl", "e.obj", "e.glb", "e.3mf"] {
        let request = Case::request(name, Some(Tolerance::Voxels(0.2)));
        let other = export(&case.path("m.oct"), &case.path(name), request, &Silent).unwrap();
        assert_eq!((other.triangles, other.vertices), (report.triangles, report.vertices), "{name}");
    }
}

/// A larger error gives no more triangles, however rough a body is.
#[test]
fn a_larger_error_gives_no_more_triangles() {
    let mut random = Random(3);
    let noise: Vec<f64> = (0..40_u32.pow(3)).map(|_| random.unit() - 0.5).collect();
    for (name, scale, rough) in
        [("in whole numbers", 10.0, 0.0), ("rough", 100.0, 1.0), ("noise", 300.0, 30.0)]
    {
        let case = Case::new([40; 3], SurfaceKind::Cells, identity(), |p| {
            let [x, y, z] = p.map(|c| f64::from(c) * std::f64::consts::TAU / 20.0);
            let gyroid = x.sin() * y.cos() + y.sin() * z.cos() + z.sin() * x.cos();
            ((gyroid + rough * noise[((p[2] * 40 + p[1]) * 40 + p[0]) as usize]) * scale).round() as f32
        });
        let mut least = u64::MAX;
        for bound in [0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 2.0] {
            let found = case.within("e.ply", Tolerance::Voxels(bound)).0.triangles;
            assert!(found <= least.saturating_add(least / 50), "{name} {bound}: {found} {least}");
            least = least.min(found);
        }
    }
}

/// To a number, within more than a voxel, and both: closed where corners at one place are one, and as near as stated.
#[test]
fn meshes_of_a_number_of_triangles_are_closed_and_as_near_as_stated() {
    let wavy = |p: [u32; 3]| {
        let [x, y, z] = p.map(f64::from);
        let wave = 3.0 * (x * 0.4).sin() * (y * 0.35).cos() * (z * 0.3).cos();
        (18.0 - ((x - 24.0).powi(2) + (y - 22.0).powi(2) + (z - 26.0).powi(2)).sqrt() + wave) as f32
    };
    let affine = Affine { rows: [[0.5, 0.0, 0.0, -40.0], [0.0, -0.5, 0.0, 3.0], [0.0, 0.0, 1.0, 900.0]] };
    for surface in [SurfaceKind::Cells, SurfaceKind::Skin] {
        let case = Case::new([48, 46, 52], surface, affine, wavy);
        let fine = case.mesh();
        let old = Surface::of(fine.faces());
        let reduced = |name: &str, triangles: Option<u64>, error: Option<f64>| {
            let request = ExportRequest { triangles, ..Case::request(name, error.map(Tolerance::Mm)) };
            export(&case.path("m.oct"), &case.path(name), request, &Silent).unwrap()
        };
        let mut wide = u64::MAX;
        for (triangles, error) in [
            (Some(5000), None),
            (Some(500), None),
            (None, Some(0.8)),
            (None, Some(1.6)),
            (Some(500), Some(0.6)),
        ] {
            let report = reduced("few.ply", triangles, error);
            let mesh = Mesh::read(&case.path("few.ply"));
            mesh.is_closed_manifold();
            let places: HashSet<_> = mesh.corners.iter().map(|p| p.map(f32::to_bits)).collect();
            assert_eq!(places.len(), mesh.corners.len());
            assert_eq!(report.triangles, mesh.triangles.len() as u64);
            let stated = report.distance_mm.unwrap();
            assert!(error.is_none_or(|error| stated <= error), "{stated}");
            match (triangles, error) {
                (Some(wanted), None) => assert!((wanted * 99 / 100..=wanted).contains(&report.triangles)),
                (Some(wanted), Some(_)) => assert!(report.triangles >= wanted * 99 / 100),
                (None, _) => {
                    assert!(report.triangles < wide, "{}", report.triangles);
                    wide = report.triangles;
                }
            }
            let middle = |t: &[[f64; 3]; 3]| [0, 1, 2].map(|k| (t[0][k] + t[1][k] + t[2][k]) / 3.0);
            let new = Surface::of(mesh.faces());
            let there = old.triangles.iter().map(|t| new.distance(t[0]).max(new.distance(middle(t))));
            let back = new.triangles.iter().map(|t| old.distance(middle(t)));
            let found = there.chain(back).fold(0.0, f64::max);
            assert!(found <= stated + 1e-4 && stated <= 2.0 * found, "{stated} of {found}");
            let at = report.distance_at_mm.unwrap().map(f64::from);
            assert!(old.distance(at) < 1e-4 && new.distance(at) <= stated + 1e-4, "{at:?}: {stated}");
        }
        // Of a number and a distance counts what is reached first.
        let alone = reduced("alone.ply", None, Some(0.8)).triangles;
        for wanted in [alone / 2, alone + 100] {
            let both = reduced("both.ply", Some(wanted), Some(0.8));
            assert!(both.triangles <= alone.max(wanted), "{alone}, {wanted}: {both:?}");
            assert!(both.triangles >= wanted * 9 / 10, "{alone}, {wanted}: {both:?}");
        }
        let all = reduced("all.ply", Some(1 << 40), None);
        assert_eq!((all.triangles, all.distance_mm), (fine.triangles.len() as u64, Some(0.0)));
        assert_eq!(all.distance_at_mm, None);
        assert!(all.warnings[0].contains("no more than asked for"), "{:?}", all.warnings);
        assert!(reduced("one.ply", Some(1), None).warnings[0].contains("no closed surface of 1"));
    }
    let none = oct(&["export", "m.oct", "-o", "m.stl", "--triangles", "0"]);
    none.refused(2, &["'0' is not a number of triangles; give 1 or more"]);
}

#[test]
fn noise_of_cells_is_closed_too() {
    for (seed, percent) in [(7, 20), (8, 50), (9, 80)] {
        let mut random = Random(seed);
        let values: Vec<f32> = (0..12_u32.pow(3))
            .map(|_| {
                let size = random.below(1000) as f32 / 500.0 + 0.01;
                if random.below(100) < percent { size } else { -size }
            })
            .collect();
        let case = Case::new([12; 3], SurfaceKind::Cells, identity(), |[x, y, z]| {
            values[((z * 12 + y) * 12 + x) as usize]
        });
        case.mesh().is_closed_manifold();
        assert_eq!(case.built_again("m.ply"), {
            case.export("m.nrrd");
            case.built_again("m.nrrd")
        });
    }
}

/// A mirrored and sheared grid far from the origin: outside stays outside, and everything is where the affine says.
#[test]
fn the_surface_lies_where_the_model_lies() {
    let affine = Affine { rows: [[0.5, 0.0, 0.1, -40.0], [0.0, -0.5, 0.3, 60.0], [0.0, 0.0, 2.0, 7.0]] };
    assert!(affine.determinant() < 0.0);
    for surface in [SurfaceKind::Skin, SurfaceKind::Cells] {
        let case = Case::new([40; 3], surface, affine, ball(19.0, 15.0));
        let mesh = case.mesh();
        mesh.is_closed_manifold();
        let due = 4.0 / 3.0 * std::f64::consts::PI * 15.0_f64.powi(3) * 0.5;
        assert!((mesh.volume() - due).abs() < 0.01 * due, "{} {due}", mesh.volume());
        let middle = affine.apply([19.0; 3]);
        for axis in 0..3 {
            let along = mesh.corners.iter().map(|p| f64::from(p[axis]));
            let (least, most) = along.fold((f64::MAX, f64::MIN), |(l, m), v| (l.min(v), m.max(v)));
            assert!(((least + most) / 2.0 - middle[axis]).abs() < 0.02, "{axis}");
        }
        // Points lie on the skin, or on the surface of cells.
        let request = ExportRequest::of(ExportForm::Points);
        export(&case.path("m.oct"), &case.path("p.ply"), request, &Silent).unwrap();
        let points = Mesh::read(&case.path("p.ply"));
        let back = affine.inverse().unwrap();
        for point in &points.corners {
            let p = back.apply(point.map(f64::from));
            let r = p.iter().map(|c| (c - 19.0).powi(2)).sum::<f64>().sqrt();
            let within = if surface == SurfaceKind::Skin { 13.2..15.01 } else { 14.8..15.2 };
            assert!(within.contains(&r), "{r}");
        }
    }
}

#[test]
fn all_formats_hold_the_same_triangles() {
    let case = Case::new([20; 3], SurfaceKind::Cells, identity(), ball(9.4, 6.1));
    let mesh = case.mesh();
    let due: Vec<[[f32; 3]; 3]> =
        mesh.triangles.iter().map(|t| t.map(|corner| mesh.corners[corner as usize])).collect();
    let float = |bytes: &[u8]| f32::from_le_bytes(bytes.try_into().unwrap());
    let triple = |bytes: &[u8]| [float(&bytes[..4]), float(&bytes[4..8]), float(&bytes[8..12])];

    case.export("m.stl");
    let stl = fs::read(case.path("m.stl")).unwrap();
    assert_eq!(u32::from_le_bytes(stl[80..84].try_into().unwrap()) as usize, due.len());
    assert_eq!(stl.len(), 84 + 50 * due.len());
    for (record, due) in stl[84..].chunks_exact(50).zip(&due) {
        assert_eq!([12, 24, 36].map(|at| triple(&record[at..])), *due);
        let normal: f32 = triple(record).iter().map(|c| c * c).sum();
        assert!((normal - 1.0).abs() < 1e-5);
    }

    case.export("m.obj");
    let obj = fs::read_to_string(case.path("m.obj")).unwrap();
    let of = |start: &str| {
        obj.lines().filter_map(|l| l.strip_prefix(start).map(str::to_owned)).collect::<Vec<_>>()
    };
    let corners: Vec<[f32; 3]> = of("v ")
        .iter()
        .map(|l| l.split(' ').map(|w| w.parse().unwrap()).collect::<Vec<f32>>().try_into().unwrap())
        .collect();
    assert_eq!(of("vn ").len(), corners.len());
    for (line, due) in of("f ").iter().zip(&due) {
        let numbers: Vec<usize> =
            line.split(' ').map(|w| w.split_once("//").unwrap().0.parse().unwrap()).collect();
        assert_eq!(numbers.iter().map(|n| corners[n - 1]).collect::<Vec<_>>(), due);
    }

    let report = case.export("m.glb");
    let glb = fs::read(case.path("m.glb")).unwrap();
    let word = |at: usize| u32::from_le_bytes(glb[at..at + 4].try_into().unwrap()) as usize;
    assert_eq!((&glb[..4], word(4), word(8)), (&b"glTF"[..], 2, glb.len()));
    assert_eq!(report.bytes, glb.len() as u64);
    let json: serde_json::Value = serde_json::from_slice(&glb[20..20 + word(12)]).unwrap();
    let data = &glb[28 + word(12)..];
    assert_eq!(
        (data.len(), json["buffers"][0]["byteLength"].as_u64().unwrap()),
        (word(20 + word(12)), data.len() as u64)
    );
    let view = |i: usize| json["bufferViews"][i]["byteOffset"].as_u64().unwrap_or(0) as usize;
    let last = json["meshes"][0]["primitives"][0]["indices"].as_u64().unwrap() as usize;
    for (record, due) in data[view(last)..].chunks_exact(12).zip(&due) {
        let corner = |at: usize| u32::from_le_bytes(record[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!([0, 4, 8].map(|at| triple(&data[12 * corner(at)..])), *due);
    }
    // In glTF the head is up and the face looks forward: x, z, -y of the patient, in metres.
    let m: Vec<f64> =
        json["nodes"][0]["matrix"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    let turned = |p: [f64; 3]| [0, 1, 2].map(|row| (0..3).map(|a| m[4 * a + row] * p[a]).sum::<f64>());
    assert_eq!(turned([1000.0, 2000.0, 3000.0]), [1.0, 3.0, -2.0]);
}

#[test]
fn a_packed_model_gives_the_same_files_and_pictures() {
    let case = Case::new([24; 3], SurfaceKind::Cells, identity(), ball(11.0, 8.0));
    let text = |name: &str| case.path(name).to_str().unwrap().to_owned();
    oct(&["pack", &text("m.oct"), "-o", &text("p.oct"), "--json"]).json();
    for name in ["a.ply", "a.stl", "a.nrrd"] {
        case.export(name);
        oct(&["export", &text("p.oct"), "-o", &text(&format!("p{name}")), "--json"]).json();
        assert_eq!(fs::read(case.path(name)).unwrap(), fs::read(case.path(&format!("p{name}"))).unwrap());
    }
    for command in [&["render", "--size", "40x30"][..], &["thumbnail"]] {
        let picture = |model: &str, name: &str| {
            oct(&[command, &[&text(model), "-o", &text(name), "--json"]].concat()).json();
            fs::read(case.path(name)).unwrap()
        };
        assert_eq!(picture("m.oct", "m.png"), picture("p.oct", "p.png"));
    }
    assert_eq!(oct(&["selfcheck", &text("p.oct"), "--rays", "1000"]).code, 0);
}

#[test]
fn what_cannot_be_exported_is_refused_in_a_sentence() {
    options_that_do_not_apply();
    let case = Case::new([16; 3], SurfaceKind::Skin, identity(), ball(8.0, 5.0));
    let model = case.path("m.oct").to_str().unwrap().to_owned();
    let at = |name: &str| case.path(name).to_str().unwrap().to_owned();
    oct(&["export", &model, "-o", &at("x.doc")]).refused(2, &["x.doc", ".stl", "--as"]);
    oct(&["export", &model, "-o", "-"]).refused(2, &["--as"]);
    oct(&["export", &model, "-o", &model, "--as", "stl"]).refused(2, &["is the input"]);
    oct(&["export", &model, "-o", &at("no/x.stl")]).refused(5, &["folder does not exist"]);
    oct(&["export", &at("nothing.oct"), "-o", &at("x.stl")]).refused(3, &["nothing.oct"]);
    // Infobytes that say other things than the header: nothing is left.
    let mut bytes = fs::read(&model).unwrap();
    let nodes = Model::open(&model).unwrap();
    let start = nodes.sections().iter().find(|e| e.kind == Some(SectionKind::Nodes)).unwrap().offset as usize;
    let len = nodes.section_bytes(SectionKind::Nodes).unwrap().len();
    bytes[start..start + len].fill(0xff);
    fs::write(case.path("bad.oct"), &bytes).unwrap();
    oct(&["export", &at("bad.oct"), "-o", &at("x.stl")]).refused(3, &["bad.oct"]);
    assert!(!case.path("x.stl").exists());
    // Far from the origin coordinates get coarse, which is told.
    let far = Affine { rows: [[0.01, 0.0, 0.0, 3e6], [0.0, 0.01, 0.0, 0.0], [0.0, 0.0, 0.01, 0.0]] };
    let away = Case::new([16; 3], SurfaceKind::Skin, far, ball(8.0, 5.0));
    assert!(away.export("m.stl").is_far && !away.export("m.nii").is_far && !case.export("m.stl").is_far);
    // Only the skin, on request.
    let whole = oct(&["export", &model, "-o", &at("w.nrrd"), "--json"]).json();
    let skin = oct(&["export", &model, "-o", &at("s.nrrd"), "--skin", "--json"]).json();
    let voxels = Model::open(&model).unwrap().header().voxels;
    assert_eq!(skin["inside_voxels"], voxels);
    assert!(whole["inside_voxels"].as_u64().unwrap() > voxels);
}

/// Options and names that say something else than what is written, and damage that still gives a closed surface.
fn options_that_do_not_apply() {
    let case = Case::new([20; 3], SurfaceKind::Skin, identity(), ball(9.0, 6.0));
    let model = case.path("m.oct");
    let run = |to: &Path, more: &[&str]| {
        oct(&[&["export", model.to_str().unwrap(), "-o", to.to_str().unwrap()], more].concat())
    };
    let stl = case.path("m.stl");
    assert_eq!(run(&stl, &[]).code, 0);
    let before = fs::read(&stl).unwrap();
    run(&stl, &["--as", "nrrd"]).refused(2, &["m.stl", "nrrd", "--force"]);
    run(&stl, &["--skin"]).refused(2, &["--skin", "masks"]);
    run(&case.path("m.nrrd"), &["--error", "0.1"]).refused(2, &["--error", "triangles"]);
    run(&stl, &["--error", "-1"]).refused(2, &["--error", "-1"]);
    assert_eq!(fs::read(&stl).unwrap(), before);
    assert_eq!(run(&case.path("other.stl"), &["--as", "nrrd", "--force"]).code, 0);
    assert_eq!(run(&case.path("points.ply"), &["--as", "points"]).code, 0);
    let mut bytes = fs::read(&model).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&model, bytes).unwrap();
    run(&stl, &[]).refused(3, &["m.oct"]);
    assert_eq!(fs::read(&stl).unwrap(), before);
}

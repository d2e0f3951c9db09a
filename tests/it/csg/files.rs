//! Leaves that are read from files: volumes and meshes.

use crate::prelude::*;
use infobyte::jobs::build::{BuildJob, BuildSummary, GridOptions, convert as convert_inputs};
use infobyte::jobs::measure::measure;
use infobyte::source::SubjectKind;

use super::{GRID, STEPS, dot, exact, options, skin, skin_of};

/// A raw volume of u8 whose value falls from 200 at its middle, and its side-car.
fn put_volume(folder: &Path, dims: [u32; 3], spacing: [f64; 3]) -> impl Fn([u32; 3]) -> u8 {
    let value = move |p: [u32; 3]| {
        let d: f64 =
            (0..3).map(|k| ((f64::from(p[k]) - f64::from(dims[k]) / 2.0) * spacing[k]).powi(2)).sum();
        (200.0 - 4.0 * d.sqrt()).max(0.0) as u8
    };
    let [nx, ny, nz] = dims;
    let voxels: Vec<u8> =
        (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z]))).map(value).collect();
    std::fs::write(folder.join("ct.raw"), voxels).unwrap();
    let text = format!("{{\"dims\": {dims:?}, \"dtype\": \"u8\", \"spacing_mm\": {spacing:?}}}");
    std::fs::write(folder.join("ct.json"), text).unwrap();
    value
}

fn bytes_of(samples: &[f32]) -> Vec<u8> {
    samples.iter().flat_map(|sample| sample.to_le_bytes()).collect()
}

/// A box as an STL file, corners in mm.
fn put_box(path: &Path, low: [f32; 3], high: [f32; 3]) {
    let corner = |k: usize| [0, 1, 2].map(|a| if k >> a & 1 == 1 { high[a] } else { low[a] });
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let mut bytes = vec![0_u8; 80];
    bytes.extend(12_u32.to_le_bytes());
    for [a, b, c, d] in faces {
        for t in [[a, b, c], [a, c, d]] {
            bytes.extend([0; 12]);
            t.iter().flat_map(|k| corner(*k)).for_each(|c| bytes.extend(c.to_le_bytes()));
            bytes.extend([0; 2]);
        }
    }
    std::fs::write(path, bytes).unwrap();
}

/// Builds a text as the command does.
fn convert(folder: &Path, text: &str, csg: &CsgOptions, options: &BuildOptions) -> Result<PathBuf, String> {
    let (tree, output) = (folder.join("tree.csg"), folder.join("tree.oct"));
    std::fs::write(&tree, text).unwrap();
    built(tree, csg, options, &output).map(|_| output)
}

fn built(
    tree: PathBuf,
    csg: &CsgOptions,
    options: &BuildOptions,
    output: &Path,
) -> Result<BuildSummary, String> {
    let grid = GridOptions { grid: csg.grid, unit_mm: csg.unit_mm, ..GridOptions::default() };
    let job = BuildJob { clean: &CleanOptions::default(), grid: &grid, options, output, progress: &Silent };
    convert_inputs(SubjectKind::Tree, &[tree], &OpenOptions::default(), &job)
        .map_err(|error| error.to_string())
}

const OWN: CsgOptions = CsgOptions { grid: None, unit_mm: 1.0 };

#[test]
fn a_volume_is_cut_by_a_mesh_and_a_torus() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (dims, spacing) = ([70, 66, 40], [1.0, 1.0, 2.0]);
    let value = put_volume(folder, dims, spacing);
    put_box(&folder.join("guide.stl"), [-5.0, -5.0, 35.25], [80.0, 40.25, 60.75]);
    let text = "difference() { volume(\"ct.raw\", iso = 80); mesh(\"guide.stl\");
        multmatrix([[1,0,0,35],[0,1,0,33],[0,0,1,20],[0,0,0,1]]) { torus(20.3, 5.17); } }";
    let file = convert(folder, text, &OWN, &options(16, 2)).unwrap();
    let model = Model::open(&file).unwrap();
    verify(&model).unwrap();
    assert_eq!(model.dims().to_array(), dims);
    assert_eq!(model.affine().column(2), [0.0, 0.0, 2.0]);
    let mut left_out = 0;
    let want = skin(
        |p| {
            let at = p.map(|c| c / STEPS - 0.5);
            let mm = [at[0], at[1], 2.0 * at[2]];
            let ring = ((mm[0] - 35.0).hypot(mm[1] - 33.0) - 20.3).hypot(mm[2] - 20.0) - 5.17;
            let guide = mm[1] < 40.25 && mm[2] > 35.25 && mm[2] < 60.75;
            value(at.map(|c| c.round() as u32)) >= 80 && !guide && ring > 0.0
        },
        dims,
    );
    let got = skin_of(&model);
    // Of the torus the lattice moves some middles across its surface.
    let voxels: BTreeSet<[u32; 3]> = got.iter().map(|(voxel, _)| *voxel).collect();
    let wrong: Vec<_> = voxels.symmetric_difference(&want).collect();
    assert!(
        wrong.len() <= 4,
        "{} of {}: {:?}",
        wrong.len(),
        want.len(),
        wrong.iter().take(9).collect::<Vec<_>>()
    );
    for (voxel, n) in got {
        let n = n.map(f64::from);
        let mm = [f64::from(voxel[0]), f64::from(voxel[1]), 2.0 * f64::from(voxel[2])];
        let out = [mm[0] - 35.0, mm[1] - 33.0, mm[2] - 40.0];
        let length = dot(out, out).sqrt();
        let of_torus = ((mm[0] - 35.0).hypot(mm[1] - 33.0) - 20.0).hypot(mm[2] - 20.0) < 7.5;
        let of_guide = mm[1] < 42.0 && mm[2] > 33.0 && mm[2] < 63.0;
        if !of_torus && !of_guide {
            // The volume's own surface.
            assert!(dot(n, out) > 0.97 * length, "{voxel:?} {n:?}");
        } else if !of_torus && of_guide && mm[1] < 38.0 && length < 26.0 {
            assert!(n[2].abs() > 0.99 && n[2] * (47.0 - mm[2]) > 0.0, "{voxel:?} {n:?}");
            left_out += 1;
        }
    }
    assert!(left_out > 500, "{left_out}");
    // The same bytes whatever the memory and the threads.
    let bytes = std::fs::read(&file).unwrap();
    for (share, threads) in [(5, 1), (64, 5)] {
        let again = convert(folder, text, &OWN, &options(share, threads)).unwrap();
        assert!(std::fs::read(again).unwrap() == bytes, "{share} {threads}");
    }
}

#[test]
fn a_radius_next_to_a_diameter_is_noted() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let how = CsgOptions { grid: Some(GridChoice::Side { voxels: 32, margin: 1 }), unit_mm: 1.0 };
    let made = |text: &str| {
        let (tree, output) = (folder.join("tree.csg"), folder.join("tree.oct"));
        std::fs::write(&tree, text).unwrap();
        let told = built(tree, &how, &options(16, 1), &output).unwrap().warnings.join(" ");
        (skin_of(&Model::open(&output).unwrap()), told)
    };
    for (text, same, note) in [
        ("sphere(4, d = 20);", "sphere(r = 10);", "line 1: sphere has both d and r; d is used"),
        (
            "\ncylinder(h = 8, r1 = 1, d1 = 12, r2 = 3); *sphere(r = 1, d = 1);",
            "cylinder(h = 8, r1 = 6, d2 = 6);",
            "line 2: cylinder has both d1 and r1; d1 is used, as in OpenSCAD",
        ),
        ("cube(4) { sphere(9); }", "cube(4) { }", "line 1: cube has children, which are left out"),
        ("union() { sphere(1, d = 9); sphere(2, d = 9); }", "sphere(4.5);", "so it is with 1 more"),
    ] {
        let ((found, told), (due, silent)) = (made(text), made(same));
        assert!(found == due && told.contains(note), "{text}: {told}");
        assert!(!silent.contains("OpenSCAD"), "{silent}");
    }
}

#[test]
fn notes_on_the_files_of_a_tree_name_them() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let _ = put_volume(folder, [20, 20, 20], [1.0; 3]);
    let head = format!("{:117}\n", "{'descr': '<f4', 'fortran_order': False, 'shape': (10, 10, 10)}");
    let npy =
        [b"\x93NUMPY\x01\0\x76\0", head.as_bytes(), &bytes_of(&[f32::NAN, 500.0, 500.0, 0.0].repeat(250))];
    std::fs::write(folder.join("nan.npy"), npy.concat()).unwrap();
    let corners = "v 0 0 0 1 0 0\nv 9 0 0 1 0 0\nv 0 9 0 1 0 0\nv 0 0 9 1 0 0\n";
    std::fs::write(folder.join("open.obj"), corners.to_owned() + "f 1 3 2\nf 1 2 4\nf 1 4 3\n").unwrap();
    let told = |text: &str| {
        let (tree, output) = (folder.join("tree.csg"), folder.join("tree.oct"));
        std::fs::write(&tree, text).unwrap();
        let how = CsgOptions { grid: Some(GridChoice::Side { voxels: 16, margin: 1 }), unit_mm: 1.0 };
        let how = if text.starts_with("volume") { OWN } else { how };
        built(tree, &how, &options(16, 1), &output).unwrap().warnings
    };
    for (text, due) in [
        ("mesh(\"open.obj\");", "open.obj is open: 3 edges in 1 loops were closed by caps"),
        ("mesh(\"open.obj\");", "open.obj has colours, which the model of a tree does not keep"),
        ("volume(\"nan.npy\", iso = 400);", "nan.npy: an .npy file states no spacing; 1 mm is assumed"),
        ("volume(\"nan.npy\", iso = 400);", "some samples are not numbers (NaN); these voxels are outside"),
        (
            "translate([0.5, 0, 0]) volume(\"nan.npy\", iso = 400);",
            "nan.npy: some samples are not numbers (NaN); these voxels are outside",
        ),
    ] {
        let twice = format!("{text} translate([1, 0, 0]) mesh(\"open.obj\");");
        for text in [text.to_owned(), twice] {
            let told = told(&text);
            assert!(told.iter().filter(|note| *note == due).count() == 1, "{text}: {told:?}");
        }
    }
    assert_eq!(told("cube(9);").len(), 1);
}

#[test]
fn a_mask_has_its_surface_midway_whatever_lies_outside_and_whatever_its_numbers_are() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let inside = |at: usize| {
        let [x, y, z] = [at % 20, at / 20 % 20, at / 400].map(|c| c as f64 - 9.6);
        x * x + y * y + z * z < 49.0
    };
    let volume = |values: [f32; 2], iso: f64, place: &str| {
        let samples: Vec<f32> = (0..8000).map(|at| values[usize::from(inside(at))]).collect();
        std::fs::write(folder.join("m.raw"), bytes_of(&samples)).unwrap();
        let text = "{\"dims\": [20, 20, 20], \"dtype\": \"f32\", \"spacing_mm\": [1, 1, 1]}";
        std::fs::write(folder.join("m.json"), text).unwrap();
        let options = BuildOptions { surface: Some(SurfaceKind::Cells), ..options(16, 1) };
        let grid =
            GridChoice::Exact { edge_mm: 1.0, origin_mm: [-1.0; 3], dims: Dims::new(26, 22, 22).unwrap() };
        let how = if place.is_empty() { OWN } else { CsgOptions { grid: Some(grid), unit_mm: 1.0 } };
        let file =
            convert(folder, &format!("{place} volume(\"m.raw\", iso = {iso});"), &how, &options).unwrap();
        let model = Model::open(file).unwrap();
        measure(&model.view(), model.dims(), &model.affine(), false).unwrap().volume_mm3.unwrap().0
    };
    let count = (0..8000).filter(|at| inside(*at)).count() as f64;
    for place in ["", "translate([3.3, 0, 0])"] {
        let due = volume([0.0, 1.0], 0.5, place);
        assert!((due / count - 1.0).abs() < 0.02, "{place} {due} {count}");
        for (values, iso) in
            [([0.0, 1.0], 1.0), ([0.0, 255.0], 128.0), ([f32::NAN, 7.0], 7.0), ([-9.0, 3.0], 3.0)]
        {
            let found = volume(values, iso, place);
            assert!((found / due - 1.0).abs() < 1e-4, "{place} {values:?} {iso}: {found} {due}");
        }
    }
}

#[test]
fn what_reaches_out_of_a_volumes_grid_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let _ = put_volume(folder, [20, 20, 20], [1.0, 1.0, 2.0]);
    put_box(&folder.join("far.stl"), [2.0; 3], [9.0, 9.0, 90.0]);
    let told = |text: &str| {
        let (tree, output) = (folder.join("tree.csg"), folder.join("tree.oct"));
        std::fs::write(&tree, text).unwrap();
        built(tree, &OWN, &options(16, 1), &output).unwrap().warnings.join(" ")
    };
    let volume = "volume(\"ct.raw\", iso = 150);";
    for (text, cut) in [
        (volume.to_owned(), None),
        (format!("difference() {{ {volume} sphere(r = 15); }}"), None),
        (
            format!(
                "union() {{ {volume} multmatrix([[1,0,0,10],[0,1,0,10],[0,0,1,10],[0,0,0,1]]) sphere(r = 5); }}"
            ),
            None,
        ),
        (format!("union() {{ {volume} sphere(r = 5); }}"), Some("(low x, low y, low z)")),
        (format!("union() {{ {volume} mesh(\"far.stl\"); }}"), Some("(high z)")),
    ] {
        let told = told(&text);
        assert_eq!(told.contains("cut off"), cut.is_some(), "{text}: {told}");
        assert!(told.contains(cut.unwrap_or_default()), "{text}: {told}");
    }
}

#[test]
fn a_mesh_as_a_leaf_is_the_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    put_box(&folder.join("a.stl"), [3.3, 4.4, 5.5], [20.25, 17.5, 30.5]);
    let own =
        "multmatrix([[1,0,0,3.3],[0,1,0,4.4],[0,0,1,5.5],[0,0,0,1]]) { cube(size = [16.95, 13.1, 25]); }";
    let build = |text: &str| {
        let file = convert(folder, text, &exact(GRID), &options(16, 2)).unwrap();
        skin_of(&Model::open(&file).unwrap())
    };
    let one: BTreeSet<[u32; 3]> =
        build("import(file = \"a.stl\", layer = \"\");").into_iter().map(|v| v.0).collect();
    let other: BTreeSet<[u32; 3]> = build(own).into_iter().map(|v| v.0).collect();
    assert_eq!(one, other);
    // Around a mesh the grid is as around any leaf.
    let side = CsgOptions { grid: Some(GridChoice::Side { voxels: 27, margin: 1 }), unit_mm: 1.0 };
    let file = convert(folder, "mesh(\"a.stl\");", &side, &options(16, 1)).unwrap();
    assert_eq!(Model::open(file).unwrap().dims().to_array(), [19, 16, 27]);
}

#[test]
fn files_that_a_tree_names_stay_in_its_folder_and_volumes_where_they_lie() {
    let outer = tempfile::tempdir().unwrap();
    let folder = outer.path().join("own");
    std::fs::create_dir(&folder).unwrap();
    put_box(&outer.path().join("a.stl"), [1.0; 3], [9.0; 3]);
    symlink(outer.path().join("a.stl"), folder.join("a.stl")).unwrap();
    let refusal = |text: &str, csg: &CsgOptions| convert(&folder, text, csg, &options(16, 1)).unwrap_err();
    let told = refusal("mesh(\"a.stl\");", &exact(GRID));
    assert!(told.contains("a link that leads out of its folder"), "{told}");
    // Thin, so that a grid of 512 voxels along it has few.
    let _ = put_volume(&folder, [20, 3, 3], [1.0; 3]);
    let told = refusal("volume(\"ct.raw\", iso = 150);", &exact(GRID));
    assert!(told.contains("leave out grid"), "{told}");
    let moved = "multmatrix([[1,0,0,1],[0,1,0,0],[0,0,1,0],[0,0,0,1]]) { volume(\"ct.raw\", iso = 150); }";
    let flat = "multmatrix([[1,0,0,1],[0,1,0,0],[0,0,0,0],[0,0,0,1]]) { volume(\"ct.raw\", iso = 150); }";
    let told = refusal(flat, &exact(GRID));
    assert!(told.contains("line 1"), "{told}");
    let inches = CsgOptions { unit_mm: 25.4, ..exact(GRID) };
    let told = refusal(moved, &inches);
    assert!(told.contains("unit_mm alone"), "{told}");
    let told = refusal("mesh(\"none.stl\");", &exact(GRID));
    assert!(told.contains("none.stl"), "{told}");
    assert!(!folder.join("tree.oct").exists());
    // What has no grid of its own has 512 voxels along its longest side.
    for text in ["cube([8, 1, 1]);", moved] {
        let built = convert(&folder, text, &OWN, &options(64, 2)).unwrap();
        let dims = Model::open(&built).unwrap().dims().to_array();
        assert_eq!(dims.into_iter().max(), Some(512), "{text}: {dims:?}");
    }
}

/// A volume whose voxels are not mirror image of themselves.
fn put_odd_volume(folder: &Path, [nx, ny, nz]: [u32; 3]) -> impl Fn([u32; 3]) -> u8 {
    let value = |[x, y, z]: [u32; 3]| {
        let mut hash = (x * 73 + y * 179 + z * 283) ^ (x * y + 3 * z);
        hash = hash.wrapping_mul(2_654_435_761) >> 24;
        let [dx, dy, dz] = [f64::from(x) - 9.0, f64::from(y) - 8.0, f64::from(z) - 6.0];
        let ball = 190.0 - 9.0 * (dx * dx + dy * dy / 2.0 + dz * dz).sqrt() + f64::from(hash) / 6.0;
        ball.clamp(0.0, 255.0) as u8
    };
    let voxels: Vec<u8> =
        (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z]))).map(value).collect();
    std::fs::write(folder.join("odd.raw"), voxels).unwrap();
    let text =
        format!("{{\"dims\": [{nx}, {ny}, {nz}], \"dtype\": \"u8\", \"spacing_mm\": [1.0, 1.0, 1.0]}}");
    std::fs::write(folder.join("odd.json"), text).unwrap();
    value
}

/// Voxel i has its middle at i mm, as sample i of the volume.
fn around_samples(dims: [u32; 3]) -> CsgOptions {
    let dims = infobyte::geom::Dims::new(dims[0], dims[1], dims[2]).unwrap();
    CsgOptions { grid: Some(GridChoice::Exact { edge_mm: 1.0, origin_mm: [-0.5; 3], dims }), unit_mm: 1.0 }
}

#[test]
fn a_volume_moved_by_whole_voxels_or_mirrored_keeps_its_voxels() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let dims = [19, 30, 13];
    let _ = put_odd_volume(folder, dims);
    let voxels = |file: PathBuf| -> BTreeSet<[u32; 3]> {
        let model = Model::open(&file).unwrap();
        verify(&model).unwrap();
        skin_of(&model).into_iter().map(|v| v.0).collect()
    };
    let own = voxels(convert(folder, "volume(\"odd.raw\", iso = 150);", &OWN, &options(16, 1)).unwrap());
    assert!(own.len() > 300);
    // Rows of signed axes, and what is added.
    let cases = [
        ([(0_usize, 1_i32), (1, 1), (2, 1)], [5, 3, 2]),
        ([(0, -1), (1, 1), (2, 1)], [22, 1, 0]),
        ([(1, 1), (2, -1), (0, 1)], [2, 17, 4]),
        ([(2, -1), (0, -1), (1, -1)], [14, 21, 33]),
    ];
    for (rows, shift) in cases {
        let matrix: Vec<String> = rows
            .iter()
            .zip(shift)
            .map(|((axis, sign), by)| {
                let mut row = [0, 0, 0, by];
                row[*axis] = *sign;
                format!("{row:?}")
            })
            .collect();
        let text = format!("multmatrix([{}, [0,0,0,1]]) volume(\"odd.raw\", iso = 150);", matrix.join(","));
        let mut want = BTreeSet::new();
        for voxel in &own {
            want.insert([0, 1, 2].map(|k| {
                let (axis, sign) = rows[k];
                (voxel[axis].cast_signed() * sign + shift[k]).cast_unsigned()
            }));
        }
        for (share, threads) in [(16, 1), (6, 2)] {
            let file = convert(folder, &text, &around_samples([40; 3]), &options(share, threads)).unwrap();
            assert!(voxels(file) == want, "{text}");
        }
    }
}

#[test]
fn a_turned_volume_is_where_its_values_between_samples_are() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let dims = [19, 30, 13];
    let value = put_odd_volume(folder, dims);
    // Turned by an angle of 3, 4, 5, stretched along z, and moved.
    let text = "difference() { multmatrix([[0.6,-0.8,0,25.25],[0.8,0.6,0,3.5],[0,0,1.5,4.125],[0,0,0,1]]) \
                volume(\"odd.raw\", iso = 150); multmatrix([[1,0,0,0],[0,1,0,0],[0,0,1,14.2],[0,0,0,1]]) \
                halfspace([0, 0, -1], 0); }";
    let sides = [48, 48, 32];
    let file = convert(folder, text, &around_samples(sides), &options(16, 2)).unwrap();
    let model = Model::open(&file).unwrap();
    verify(&model).unwrap();
    let got: BTreeSet<[u32; 3]> = skin_of(&model).into_iter().map(|v| v.0).collect();
    let is_inside = |p: [f64; 3]| {
        let [x, y, z] = p.map(|c| c / STEPS - 0.5);
        if z > 14.2 {
            return false;
        }
        let [x, y, z] = [x - 25.25, y - 3.5, z - 4.125];
        let at = [0.6 * x + 0.8 * y, 0.6 * y - 0.8 * x, z / 1.5].map(|c| (c * STEPS).round() / STEPS);
        if (0..3).any(|k| at[k] < 0.0 || at[k] > f64::from(dims[k] - 1)) {
            return false;
        }
        let low = at.map(f64::floor);
        let mut sum = 0.0;
        for corner in 0..8 {
            let far = [0, 1, 2].map(|k| corner >> k & 1 == 1);
            let weight: f64 =
                (0..3).map(|k| if far[k] { at[k] - low[k] } else { 1.0 - at[k] + low[k] }).product();
            if weight > 0.0 {
                let sample = [0, 1, 2].map(|k| low[k] as u32 + u32::from(far[k]));
                sum += weight * f64::from(value(sample));
            }
        }
        sum as f32 >= 150.0
    };
    let want = skin(is_inside, sides);
    assert!(got == want, "{} of {} voxels differ", got.symmetric_difference(&want).count(), want.len());
    assert!(got.len() > 400);
    // The same bytes whatever the memory and the threads; of cells, too.
    for surface in [infobyte::format::SurfaceKind::Skin, infobyte::format::SurfaceKind::Cells] {
        let mut first = None;
        for (share, threads) in [(6, 1), (64, 5), (16, 2)] {
            let how = BuildOptions { surface: Some(surface), ..options(share, threads) };
            let file = convert(folder, text, &around_samples(sides), &how).unwrap();
            verify(&Model::open(&file).unwrap()).unwrap();
            let bytes = std::fs::read(file).unwrap();
            assert!(*first.get_or_insert_with(|| bytes.clone()) == bytes, "{share} {threads}");
        }
    }
    // Around it the grid is as around any leaf.
    let side = CsgOptions { grid: Some(GridChoice::Side { voxels: 50, margin: 1 }), unit_mm: 1.0 };
    assert!(convert(folder, text, &side, &options(16, 1)).is_ok());
}

#[test]
fn cells_of_a_cut_volume_have_its_surface() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let _ = put_volume(folder, [60, 60, 60], [1.0; 3]);
    let text = "difference() { volume(\"ct.raw\", iso = 120); multmatrix([[1,0,0,0],[0,1,0,0],[0,0,1,33.3],[0,0,0,1]]) \
                halfspace([0, 0, -1], 0); }";
    let how = BuildOptions { surface: Some(infobyte::format::SurfaceKind::Cells), ..options(16, 2) };
    let model = Model::open(convert(folder, text, &OWN, &how).unwrap()).unwrap();
    verify(&model).unwrap();
    let caster = infobyte::RayCaster::new(&model).unwrap();
    for (x, y) in [(30.0, 30.0), (22.2, 37.1), (40.4, 18.9)] {
        let above = caster.first_hit([x, y, 100.0], [0.0, 0.0, -1.0]).unwrap().unwrap();
        assert!((above.position_mm[2] - 33.3).abs() < 0.01 && above.normal.unwrap()[2] > 0.999, "{above:?}");
        let below = caster.first_hit([x, y, -50.0], [0.0, 0.0, 1.0]).unwrap().unwrap();
        let d = below.position_mm.map(|c| c - 30.0);
        let length = dot(d, d).sqrt();
        // Values are whole numbers, rounded down: an eighth of a voxel on the average.
        assert!((length - 20.0).abs() < 0.35, "{below:?} {length}");
        assert!(dot(d, below.normal.unwrap()) > 0.98 * length, "{below:?}");
    }
}

/// A mesh is read while the bodies before it are held: a large one takes as much more there than behind it.
#[test]
fn the_named_memory_of_a_tree_holds_the_bodies_before_a_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    put_box(&folder.join("box.stl"), [0.0; 3], [30.0; 3]);
    let corner = |i: u32| {
        let angle = f64::from(i) * std::f64::consts::TAU / 3000.0;
        let radius = f64::from(20 + i % 2);
        format!("[{}, {}]", radius * angle.cos(), radius * angle.sin())
    };
    let points = (0..3000).map(corner).collect::<Vec<_>>().join(", ");
    let body = format!("linear_extrude(height = 9) polygon([{points}]);");
    let (tree, mesh) = (folder.join("tree.csg"), "import(\"box.stl\");");
    let build = |bytes: u64| {
        let subject = infobyte::Subject::open(std::slice::from_ref(&tree), &OpenOptions::default()).unwrap();
        let side = Some(GridChoice::Side { voxels: 16, margin: 1 });
        let grid = GridOptions { grid: side, unit_mm: 1.0, ..GridOptions::default() };
        let how = BuildOptions { memory: MemoryCap::Share(bytes), ..options(16, 1) };
        infobyte::build_subject(subject, &grid, &how, folder.join("tree.oct"))
    };
    for [first, second] in [[&body, mesh], [mesh, &body]] {
        std::fs::write(&tree, format!("union() {{ {first} {second} }}")).unwrap();
        let Err(infobyte::Error::Build(error)) = build(0) else { panic!("built in nothing") };
        let named = error.minimum_bytes().unwrap();
        let report = build(named).unwrap();
        assert!(report.skin_voxels > 100 && report.plan_bytes <= named, "{report:?}");
    }
}

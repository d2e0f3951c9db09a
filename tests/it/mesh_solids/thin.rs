//! Surfaces alone, and walls thinner than a voxel: none may have a hole that a path from face to face leads through.

use super::*;

fn surface(dims: [u32; 3]) -> MeshOptions {
    MeshOptions { fill: Some(Fill::Surface), ..exact(dims) }
}

fn keep_thin(dims: [u32; 3]) -> MeshOptions {
    MeshOptions { keep_thin: true, ..exact(dims) }
}

fn built(place: &Place, body: &Body, mesh: &MeshOptions) -> (BTreeSet<[u32; 3]>, MeshFacts) {
    let file = place.put("body.stl", &body.stl());
    let facts = place.build(&[file], mesh, &options(16, 2)).unwrap().facts;
    (skin_of(&place.model()), facts)
}

/// The normals, in the order of voxels.
fn normals(place: &Place) -> Vec<[f32; 3]> {
    let model = place.model();
    let items = model.items(Channel::Normal).unwrap();
    let decode = |at| normal::decode(u16::from_le_bytes(items.get(at).unwrap().try_into().unwrap()));
    (0..model.header().voxels).map(decode).collect()
}

/// Does a path from face to face lead from a corner of the grid to a voxel?
fn leads_to(voxels: &BTreeSet<[u32; 3]>, side: u32, goal: [u32; 3]) -> bool {
    let mut seen = BTreeSet::from([[0_u32; 3]]);
    let mut left = vec![[0_u32; 3]];
    while let Some(at) = left.pop() {
        for axis in 0..3 {
            for next in [at[axis].wrapping_sub(1), at[axis] + 1] {
                let mut to = at;
                to[axis] = next;
                if next < side && !voxels.contains(&to) && seen.insert(to) {
                    left.push(to);
                }
            }
        }
    }
    seen.contains(&goal)
}

fn square(from: u32, to: u32, z: u32) -> BTreeSet<[u32; 3]> {
    (from..to).flat_map(|x| (from..to).map(move |y| [x, y, z])).collect()
}

fn sheet(z: f64) -> Body {
    let corners = [[5.0, 5.0, z], [35.0, 5.0, z], [35.0, 35.0, z], [5.0, 35.0, z]];
    Body::new(&corners, &[[0, 1, 2], [0, 2, 3]])
}

/// A sphere of triangles smaller than a voxel that face all ways.
fn crumpled(radius: f64) -> Body {
    let mut body = Body::sphere([20.3, 19.8, 20.1], radius, 5);
    let mut state = 5_u32;
    for v in body.vertices.iter_mut().flatten() {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        *v += i64::from(state >> 20) / 2 - 1024;
    }
    body
}

#[test]
fn a_plate_between_centres_is_kept_once() {
    let place = Place::new();
    let plate = |low, high| Body::cuboid([5.0, 5.0, low], [35.0, 35.0, high]);
    // The wall begins in the upper half of voxel 19, whose centre lies below it.
    let (voxels, facts) = built(&place, &plate(19.8, 20.2), &keep_thin([40; 3]));
    assert!(facts.keep_thin && facts.fill == Fill::Winding);
    assert_eq!(voxels, square(5, 35, 19));
    assert!(normals(&place).iter().all(|n| *n == [0.0, 0.0, -1.0]));
    // In one voxel above its centre, and below.
    assert_eq!(built(&place, &plate(19.6, 19.9), &keep_thin([40; 3])).0, square(5, 35, 19));
    assert_eq!(built(&place, &plate(20.1, 20.4), &keep_thin([40; 3])).0, square(5, 35, 20));
    assert!(normals(&place).iter().all(|n| *n == [0.0, 0.0, 1.0]));
    // Faces through centres: as moved centres see them, 19 lies above the plate and 18 within it.
    assert_eq!(built(&place, &plate(18.5, 19.5), &keep_thin([40; 3])).0, square(5, 35, 18));
    // The same along y.
    let upright = Body::cuboid([5.0, 19.8, 5.0], [35.0, 20.2, 35.0]);
    let want: BTreeSet<[u32; 3]> = square(5, 35, 19).iter().map(|[x, z, y]| [*x, *y, *z]).collect();
    assert_eq!(built(&place, &upright, &keep_thin([40; 3])).0, want);
    let across = Body::cuboid([19.8, 5.0, 5.0], [20.2, 35.0, 35.0]);
    let want: BTreeSet<[u32; 3]> = square(5, 35, 19).iter().map(|[y, z, x]| [*x, *y, *z]).collect();
    assert_eq!(built(&place, &across, &keep_thin([40; 3])).0, want);
}

#[test]
fn what_is_thick_stays_as_it_is() {
    let place = Place::new();
    for body in [
        Body::cuboid([5.3; 3], [30.7, 28.1, 26.9]),
        // Faces through centres and between voxels.
        Body::cuboid([5.5, 5.0, 6.5], [30.5, 28.0, 26.5]),
        Body::cuboid([-50.0, 5.0, -3.0], [90.0, 28.0, 45.0]),
    ] {
        built(&place, &body, &exact([40; 3]));
        let plain = place.bytes();
        built(&place, &body, &keep_thin([40; 3]));
        assert!(place.bytes() == plain);
    }
}

#[test]
fn a_sheet_is_the_voxels_that_it_lies_in_and_looks_where_its_triangles_do() {
    let place = Place::new();
    for (z, up) in [(10.3, true), (10.5, true), (10.9, false), (10.0, false)] {
        let body = if up { sheet(z) } else { sheet(z).reversed() };
        let (voxels, facts) = built(&place, &body, &surface([40; 3]));
        assert_eq!((facts.boundary, facts.fill, facts.asked_for), (Boundary::Sheet, Fill::Surface, true));
        assert_eq!(voxels, square(5, 35, 10), "{z}");
        let want = [0.0, 0.0, if up { 1.0 } else { -1.0 }];
        assert!(normals(&place).iter().all(|n| *n == want), "{z}");
    }
    // Of a slope of one half every column has one voxel, and every other row two columns.
    let slope = Body::new(&[[5.0, 5.0, 10.1], [35.0, 5.0, 25.1], [35.0, 35.0, 25.1]], &[[0, 1, 2]])
        .with(&Body::new(&[[5.0, 5.0, 10.1], [35.0, 35.0, 25.1], [5.0, 35.0, 10.1]], &[[0, 1, 2]]));
    let want: BTreeSet<[u32; 3]> = (5..35_u32)
        .flat_map(|x| (5..35).map(move |y| [x, y, (40 + 2 * (x - 5) + 1).div_euclid(4)]))
        .collect();
    assert_eq!(built(&place, &slope, &surface([40; 3])).0, want);
}

#[test]
fn neither_shells_nor_surfaces_have_holes() {
    let place = Place::new();
    let goal = [20; 3];
    let shell = |outer: Body, inner: Body| outer.with(&inner.reversed());
    let thin = [
        shell(Body::cuboid([5.7; 3], [34.4; 3]), Body::cuboid([6.0; 3], [34.1; 3])),
        shell(Body::octahedron([20.2; 3], 17.0), Body::octahedron([20.2; 3], 16.6)),
        shell(Body::sphere([20.1; 3], 15.0, 4), Body::sphere([20.1; 3], 14.8, 4)),
        // Here thick, there thin.
        shell(Body::sphere([20.1; 3], 15.0, 4), Body::sphere([20.6, 20.1, 19.8], 14.5, 4)),
        shell(crumpled(15.0), crumpled(14.9)),
    ];
    for (at, body) in thin.iter().enumerate() {
        let (voxels, facts) = built(&place, body, &keep_thin([40; 3]));
        assert!(facts.keep_thin);
        assert!(!leads_to(&voxels, 40, goal), "shell {at}");
        let file = place.put("body.stl", &body.stl());
        let holes = match place.build(&[file], &exact([40; 3]), &options(16, 2)) {
            Err(refused) => refused.to_string().contains("no voxel is inside"),
            Ok(_) => leads_to(&skin_of(&place.model()), 40, goal),
        };
        assert!(holes, "shell {at} is thick");
    }
    for (at, body) in thin.iter().chain([&crumpled(9.0), &Body::cuboid([7.5; 3], [30.5; 3])]).enumerate() {
        assert!(!leads_to(&built(&place, body, &surface([40; 3])).0, 40, goal), "surface {at}");
    }
}

#[test]
fn a_surface_cut_by_the_walls_of_the_grid_reaches_them() {
    let place = Place::new();
    let corners = [[-90.0, -90.0, 10.3], [130.0, -90.0, 10.3], [130.0, 130.0, 10.3], [-90.0, 130.0, 10.3]];
    let body = Body::new(&corners, &[[0, 1, 2], [0, 2, 3]]);
    assert_eq!(built(&place, &body, &surface([40; 3])).0, square(0, 40, 10));
    // The last slice, and the first of a bin.
    for z in [31, 32, 39] {
        assert_eq!(built(&place, &sheet(f64::from(z) + 0.9), &surface([40; 3])).0, square(5, 35, z));
        let low = f64::from(z) + 0.6;
        let plate = Body::cuboid([5.0, 5.0, low], [35.0, 35.0, low + 0.3]);
        assert_eq!(built(&place, &plate, &keep_thin([40; 3])).0, square(5, 35, z));
    }
}

#[test]
fn thin_models_do_not_depend_on_budget_threads_or_order() {
    let place = Place::new();
    let body = Body::sphere([70.0; 3], 60.0, 4)
        .with(&Body::sphere([70.2; 3], 59.5, 4).reversed())
        .with(&Body::cuboid([5.5, 60.0, 60.3], [139.0, 80.0, 60.6]))
        .snapped(4);
    let mut shuffled = body.clone();
    let n = shuffled.faces.len();
    for at in 0..n {
        shuffled.faces.swap(at, at * 7919 % n);
        shuffled.faces[at].rotate_left(at % 3);
    }
    for mesh in [surface([150, 140, 145]), keep_thin([150, 140, 145])] {
        let file = place.put("a.stl", &body.stl());
        place.build(std::slice::from_ref(&file), &mesh, &options(32, 1)).unwrap();
        let first = place.bytes();
        let same = |what: &str, inputs: &[PathBuf], options: &BuildOptions| {
            std::fs::remove_file(place.path("a.oct")).unwrap();
            place.build(inputs, &mesh, options).unwrap();
            assert!(place.bytes() == first, "{what}");
        };
        for (share_mib, threads) in [(6, 1), (12, 2), (16, 5), (1024, 2)] {
            same("budget and threads", std::slice::from_ref(&file), &options(share_mib, threads));
        }
        same("shuffled", &[place.put("b.stl", &shuffled.stl())], &options(16, 2));
        same("refined", &[place.put("c.stl", &body.refined().stl())], &options(16, 2));
    }
}

#[test]
fn more_triangles_in_a_slice_than_there_is_room_for() {
    let place = Place::new();
    let mut body = sheet(10.3);
    let crumb = Body::new(&[[10.1, 10.1, 10.3], [10.9, 10.1, 10.3], [10.1, 10.9, 10.3]], &[[0, 1, 2]]);
    (0..9000).for_each(|_| body = std::mem::take(&mut body).with(&crumb));
    assert_eq!(built(&place, &body, &surface([40; 3])).0, square(5, 35, 10));
}

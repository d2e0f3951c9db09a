//! Middles of voxels that lie exactly on a surface.

use super::*;

#[test]
fn middles_on_a_surface_are_moved_for_every_leaf() {
    // 3-4-5 and others: many middles lie exactly on it.
    let middle = |to: f64| {
        let mut affine = Affine { rows: [[0.0; 4]; 3] };
        affine.rows.iter_mut().enumerate().for_each(|(k, row)| (row[k], row[3]) = (to, 25.5));
        affine
    };
    for (side, what) in [(1.0, "as it is"), (-1.0, "mirrored")] {
        let leaf = |shape: Shape| Plain::Leaf(shape, middle(side));
        let shapes = [
            Shape::Ellipsoid { radii: [15.0; 3] },
            Shape::Ellipsoid { radii: [15.0, 10.0, 20.0] },
            Shape::Cylinder { z: [-10.0, 10.0], radii: [15.0; 2] },
            Shape::Cylinder { z: [-10.0, 10.0], radii: [15.0, 5.0] },
            Shape::Torus { major: 16.0, minor: 4.0 },
            Shape::Cuboid { low: [-10.0; 3], high: [10.0; 3] },
        ];
        for shape in shapes {
            assert!(check(&leaf(shape.clone()), [51, 51, 51], what) > 1000, "{shape:?} {what}");
        }
        let ball = || leaf(Shape::Ellipsoid { radii: [15.0; 3] });
        for normal in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, -1.0, 0.0], [0.0, 1.0, -1.0]]
        {
            let half = leaf(Shape::HalfSpace { normal, offset: 0.0 });
            check(&Plain::Joined(Operation::Intersection, vec![ball(), half]), [51, 51, 51], what);
        }
    }
}

/// Whatever its outline, a slab has the same slices; so a hole made of another kind of leaf leaves no film over it.
#[test]
fn leaves_between_the_same_planes_have_the_same_slices() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.oct");
    let slabs = [
        "linear_extrude(height = 2.5) circle(r = 10);",
        "linear_extrude(height = 2.5) square([16, 16], center = true);",
        "linear_extrude(height = 2.5) polygon([[-9, -9], [9, -9], [0, 9]]);",
        "linear_extrude(height = 2.5) circle(r = 10, $fn = 7);",
        "cylinder(h = 2.5, r1 = 10, r2 = 10);",
        "cylinder(h = 2.5, r1 = 10, r2 = 7);",
        "multmatrix([[1,0,0,-8],[0,1,0,-8],[0,0,1,0],[0,0,0,1]]) cube([16, 16, 2.5]);",
        "intersection() { cylinder(h = 9, r1 = 10, r2 = 10, center = true); \
         multmatrix([[1,0,0,0],[0,1,0,0],[0,0,1,2.5],[0,0,0,1]]) halfspace([0, 0, 1], 0); halfspace([0, 0, -1], 0); }",
    ];
    // Along x, y and z, and upside down.
    let ways = [
        "[[0,0,1,16],[1,0,0,16.2],[0,1,0,16.2],[0,0,0,1]]",
        "[[1,0,0,16.2],[0,0,-1,16],[0,1,0,16.2],[0,0,0,1]]",
        "[[1,0,0,16.2],[0,1,0,16.2],[0,0,1,16],[0,0,0,1]]",
        "[[1,0,0,16.2],[0,1,0,16.2],[0,0,-1,16],[0,0,0,1]]",
    ];
    let grid = || {
        let dims = Dims::new(64, 64, 64).unwrap();
        // Middles at multiples of half a millimetre.
        CsgOptions {
            grid: Some(GridChoice::Exact { edge_mm: 0.5, origin_mm: [-0.25; 3], dims }),
            unit_mm: 1.0,
        }
    };
    for (axis, way) in [0, 1, 2, 2].into_iter().zip(ways) {
        let slices = slabs.map(|slab| {
            let text = format!("multmatrix({way}) {{ {slab} }}");
            build_to(parsed(&text), &grid(), &options(16, 1), &path).unwrap();
            let all: BTreeSet<u32> =
                skin_of(&Model::open(&path).unwrap()).into_iter().map(|(voxel, _)| voxel[axis]).collect();
            all
        });
        assert!(slices.iter().all(|one| one.len() == 5 && one == &slices[0]), "{way}: {slices:?}");
    }
    let film = format!(
        "multmatrix({}) {{ difference() {{ {} {} }} }}",
        ways[2],
        slabs[4],
        slabs[6].replace("16, 16", "40, 40").replace("-8", "-20")
    );
    let built = build_to(parsed(&film), &grid(), &options(16, 1), &path);
    assert!(built.is_err_and(|e| e.to_string().contains("no voxel is inside")));
}

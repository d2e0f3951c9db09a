//! What a ray may be, in every symmetry of the cube and in volumes of every kind; compared with the walk over plain
//! bits, and with the oracle that knows no rounding.

/// One hard ray in a grid of 16 cells a side, and the voxel that it must hit first when all are skin.
pub(crate) struct Hard {
    name: &'static str,
    origin: [f64; 3],
    direction: [f64; 3],
    t_min: f64,
    /// First voxel on the ray; `None` when the ray visits none.
    first: Option<[u32; 3]>,
}

/// A bug, and the rays that show it.
pub(crate) struct Bug {
    pub(crate) name: &'static str,
    /// What would break.
    pub(crate) breaks: &'static str,
    /// Where it was seen.
    pub(crate) shipped: &'static str,
    rays: &'static [Hard],
}

use crate::prelude::*;
use crate::traversal::sealed_hit;

const fn ray(name: &'static str, origin: [f64; 3], direction: [f64; 3], first: Option<[u32; 3]>) -> Hard {
    limited(name, origin, direction, 0.0, first)
}

const fn limited(
    name: &'static str,
    origin: [f64; 3],
    direction: [f64; 3],
    t_min: f64,
    first: Option<[u32; 3]>,
) -> Hard {
    Hard { name, origin, direction, t_min, first }
}

/// What others shipped, each with the rays that show it; the grid has 16 cells a side.
pub(crate) const BUGS: &[Bug] = &[
    Bug {
        name: "zero_components",
        breaks: "A direction component of 0 divides to NaN or infinity: an empty mask, an endless loop.",
        shipped: "gvdb-voxels #115, hyperion #909, Ray-casting-test #2",
        rays: &[ray("zero components", [-3.0, 4.5, 7.5], [1.0, 0.0, 0.0], Some([0, 4, 7]))],
    },
    Bug {
        name: "negative_zeros",
        breaks: "-0.0 is taken for a ray that runs backwards: the wrong side of a plane, or a miss.",
        shipped: "drjit #311",
        rays: &[
            ray("negative zero components", [-3.0, 4.5, 7.5], [1.0, -0.0, -0.0], Some([0, 4, 7])),
            ray("negative zero origin", [-0.0, -0.0, -0.0], [1.0, 2.0, 3.0], Some([0, 0, 0])),
            ray(
                "along a grid edge with negative zeros",
                [-3.0, 4.0, 7.0],
                [1.0, -0.0, -0.0],
                Some([0, 4, 7]),
            ),
        ],
    },
    Bug {
        name: "along_grid_edges",
        breaks: "A ray exactly along an edge of the grid lies in four cells or in none.",
        shipped: "drjit #311",
        rays: &[
            ray("along a grid edge", [-3.0, 4.0, 7.0], [1.0, 0.0, 0.0], Some([0, 4, 7])),
            ray("along the grid's own lowest edge", [-3.0, 0.0, 0.0], [1.0, 0.0, 0.0], Some([0, 0, 0])),
            ray("along the grid's own highest edge", [-3.0, 16.0, 16.0], [1.0, 0.0, 0.0], None),
        ],
    },
    Bug {
        name: "axis_parallel_through_faces",
        breaks: "An axis-parallel ray through a node's face starts in the wrong child.",
        shipped: "cpu_voxel_raycaster #3",
        rays: &[ray("axis-parallel through a node face", [8.0, -4.0, 8.5], [0.0, 1.0, 0.0], Some([8, 0, 8]))],
    },
    Bug {
        name: "starts_on_corners",
        breaks: "A ray that starts or ends on a corner aborts, while one 1e-9 beside it works.",
        shipped: "nether-pathfinder #23",
        rays: &[
            ray("starts on a corner", [4.0, 4.0, 4.0], [1.0, 1.0, 1.0], Some([4, 4, 4])),
            ray("starts on a corner, backwards", [4.0, 4.0, 4.0], [-1.0, -1.0, -1.0], Some([3, 3, 3])),
            ray("starts on a corner, mixed signs", [4.0, 4.0, 4.0], [1.0, -2.0, 0.0], Some([4, 3, 4])),
            ray(
                "starts a hair off a corner",
                [4.0 + 1e-9, 4.0, 4.0 - 1e-9],
                [1.0, 1.0, 1.0],
                Some([4, 4, 4]),
            ),
            ray("starts on the last corner, outwards", [16.0, 16.0, 16.0], [1.0, 1.0, 1.0], None),
            ray(
                "starts on the last corner, inwards",
                [16.0, 16.0, 16.0],
                [-1.0, -1.0, -1.0],
                Some([15, 15, 15]),
            ),
        ],
    },
    Bug {
        name: "corners_of_the_grid",
        breaks: "Entering, leaving or touching the grid in a corner or an edge alone.",
        shipped: "fast_voxel_traversal #5, cgyurgyik fast-voxel-traversal #2 (the last voxel is skipped: an endless loop)",
        rays: &[
            ray("enters by a corner", [-2.0, -2.0, -2.0], [1.0, 1.0, 1.0], Some([0, 0, 0])),
            ray("leaves by a corner", [14.5, 14.5, 14.5], [1.0, 1.0, 1.0], Some([14, 14, 14])),
            ray("touches a corner only", [-1.0, 1.0, 8.5], [1.0, -1.0, 0.0], None),
            ray("touches an edge from outside", [15.0, 17.0, 8.5], [1.0, -1.0, 0.0], None),
            ray("first voxel of the grid", [-1.0, 0.5, 0.5], [1.0, 0.0, 0.0], Some([0, 0, 0])),
            ray("last voxel of the grid", [17.0, 15.5, 15.5], [-1.0, 0.0, 0.0], Some([15, 15, 15])),
        ],
    },
    Bug {
        name: "negative_coordinates",
        breaks: "Truncation in the place of floor: everything below 0 is one cell off.",
        shipped: "Javidx9 #82",
        rays: &[ray("negative coordinates", [-5.5, -7.25, -3.0], [7.0, 9.0, 5.0], Some([0, 0, 1]))],
    },
    Bug {
        name: "ties",
        breaks: "Two or three planes are crossed at once, or the main axis is not the only longest one: a step too many or a cell in between.",
        shipped: "the paper, section 3 (its main axis without absolute values); cgyurgyik fast-voxel-traversal #2",
        rays: &[
            ray("two crossings at once", [-1.0, 3.0, 2.5], [1.0, 1.0, 0.0], Some([0, 4, 2])),
            ray("three crossings at once", [2.0, 3.0, 4.0], [1.0, 1.0, 1.0], Some([2, 3, 4])),
            ray("three crossings at once, mixed signs", [2.0, 13.0, 4.0], [1.0, -1.0, 1.0], Some([2, 12, 4])),
            ray("slope exactly 1", [0.5, 0.5, 8.5], [1.0, 1.0, 0.0], Some([0, 0, 8])),
            ray("slope exactly -1", [0.5, 15.5, 8.5], [1.0, -1.0, 0.0], Some([0, 15, 8])),
            ray("slopes of small whole numbers", [0.0, 0.0, 0.0], [3.0, 2.0, 1.0], Some([0, 0, 0])),
        ],
    },
    Bug {
        name: "grazing_faces",
        breaks: "A ray within a face of the grid belongs to the inner cell on one side and to nobody on the other.",
        shipped: "VoxelRT's notes (a constant epsilon moves such rays)",
        rays: &[
            ray("grazes the low x face", [0.0, -2.0, 3.5], [0.0, 1.0, 0.0], Some([0, 0, 3])),
            ray("grazes the high x face", [16.0, -2.0, 3.5], [0.0, 1.0, 0.0], None),
            ray("grazes the low y face", [3.5, 0.0, -2.0], [0.0, 0.0, 1.0], Some([3, 0, 0])),
            ray("grazes the high y face", [3.5, 16.0, -2.0], [0.0, 0.0, 1.0], None),
            ray("grazes the low z face", [-2.0, 3.5, 0.0], [1.0, 0.0, 0.0], Some([0, 3, 0])),
            ray("grazes the high z face", [-2.0, 3.5, 16.0], [1.0, 0.0, 0.0], None),
            ray("just inside a face", [-2.0, 3.5, 16.0 - 1.0 / 65536.0], [1.0, 0.0, 0.0], Some([0, 3, 15])),
            ray("just outside a face", [-2.0, 3.5, 16.0 + 1.0 / 65536.0], [1.0, 0.0, 0.0], None),
        ],
    },
    Bug {
        name: "between_voxels_and_bricks",
        breaks: "A ray in the plane between two voxels or two bricks finds neither.",
        shipped: "gvdb-voxels #99 (gaps at brick boundaries)",
        rays: &[
            ray("in the plane between two voxels", [-2.0, 5.0, 3.25], [1.0, 0.0, 0.125], Some([0, 5, 3])),
            ray("in the plane between two bricks", [-2.0, 8.0, 3.25], [1.0, 0.0, -0.0625], Some([0, 8, 3])),
        ],
    },
    Bug {
        name: "tiny_and_huge_components",
        breaks: "Components clamped to an epsilon lose their sign, denormal ones divide to infinity.",
        shipped: "sparse-voxel-octrees (|d| below 1e-4 becomes +1e-4), BioDynaMo #259",
        rays: &[
            ray("a component of 1e-38", [-2.0, 5.0, 3.5], [1.0, 1e-38, -1e-38], Some([0, 5, 3])),
            ray("a denormal component", [-2.0, 5.5, 3.5], [1.0, 5e-324, -5e-324], Some([0, 5, 3])),
            ray("a direction of denormals", [-2.0, 5.5, 3.5], [5e-324, 0.0, 0.0], Some([0, 5, 3])),
            ray("a direction of 1e-12", [-2.0, 5.5, 3.5], [4e-12, 1e-12, 0.0], Some([0, 6, 3])),
            ray("a direction of 1e12", [-2.0, 5.5, 3.5], [4e12, 1e12, 0.0], Some([0, 6, 3])),
            ray("nearly along an axis", [-2.0, 8.0, 8.0], [1.0, 1e-4, -1e-4], Some([0, 8, 7])),
        ],
    },
    Bug {
        name: "summed_steps",
        breaks: "Steps of a fraction are added up until the last voxel is missed.",
        shipped: "OpenVDB #1500 (a step of 1.0001), fast_voxel_traversal #5",
        rays: &[ray(
            "a long shallow ray to the last voxel",
            [0.0, 15.0, 15.0],
            [16.0, 0.9999, 0.9999],
            Some([0, 15, 15]),
        )],
    },
    Bug {
        name: "far_cameras",
        breaks: "From far away the hit's place is rounded to whole voxels.",
        shipped: "VoxelRT's notes",
        rays: &[
            ray("camera 1e7 voxels away", [-1e7, 5.5, 3.5], [1.0, 0.0, 0.0], Some([0, 5, 3])),
            ray("camera 1e7 voxels away, diagonal", [1e7, 1e7, 1e7], [-1.0, -1.0, -1.0], Some([15, 15, 15])),
        ],
    },
    Bug {
        name: "reversed_at_boundaries",
        breaks: "A ray that runs backwards gets stuck where tiles meet.",
        shipped: "OpenVDB #7",
        rays: &[
            ray("reversed at a tile boundary", [8.0, 8.5, 8.5], [-1.0, 0.0, 0.0], Some([7, 8, 8])),
            ray("reversed, on all tile boundaries", [8.0, 8.0, 8.0], [-1.0, -1.0, -0.5], Some([7, 7, 7])),
        ],
    },
    Bug {
        name: "starts_inside",
        breaks: "A ray that starts within a voxel misses it, or zero is read as a sign: a hit at the origin.",
        shipped: "fvdb-core #698",
        rays: &[
            ray("origin in a voxel", [5.25, 6.5, 7.75], [-0.25, 1.0, 0.5], Some([5, 6, 7])),
            ray("origin at zero, along x", [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], Some([0, 0, 0])),
            ray("leaves at once", [0.0, 5.5, 5.5], [-1.0, 0.0, 0.0], None),
        ],
    },
    Bug {
        name: "misses",
        breaks: "A ray beside or behind the grid, or into an empty one, never returns.",
        shipped: "OpenVDB #1710",
        rays: &[
            ray("behind the grid", [20.0, 5.5, 5.5], [1.0, 0.0, 0.0], None),
            ray("beside the grid", [-3.0, 17.0, 5.5], [1.0, 0.5, 0.0], None),
        ],
    },
    Bug {
        name: "near_limits",
        breaks: "A near limit within or on the face of a voxel loses that voxel, or shows what lies before it.",
        shipped: "found here: the limit counts along the ray, not along its main axis (the paper, E7)",
        rays: &[
            limited("t_min within a voxel", [-3.0, 5.5, 5.5], [1.0, 0.0, 0.0], 7.5, Some([4, 5, 5])),
            limited("t_min on a face", [-3.0, 5.5, 5.5], [2.0, 0.0, 0.0], 4.0, Some([5, 5, 5])),
            limited("t_min on a face, backwards", [19.0, 5.5, 5.5], [-1.0, 0.0, 0.0], 7.0, Some([11, 5, 5])),
            limited("t_min behind the grid", [-3.0, 5.5, 5.5], [1.0, 0.0, 0.0], 19.0, None),
            limited("t_min before the grid", [-3.0, 5.5, 5.5], [1.0, 0.0, 0.0], 1.0, Some([0, 5, 5])),
        ],
    },
];

/// The scenes that hard rays are sent into; all have a grid of 16.
pub(crate) fn hard_scenes() -> Vec<Scene> {
    vec![
        Scene::set("full solid", [16; 3], |_| true),
        Scene::set("empty", [16; 3], |_| false),
        Scene::set("checkerboard", [16; 3], |[x, y, z]| (x + y + z) % 2 == 0),
        noise("noise 2 %", [16; 3], 0.02, 5),
        noise("noise 20 %", [16; 3], 0.2, 6),
        Scene::skin("ball", [16; 3], |c| in_ball(c, 16)),
        Scene::set("walls beside the middle", [16; 3], |c| c.contains(&7)),
        Scene::set("far corner", [16; 3], |c| c == [15; 3]),
        Scene::set("near corner", [16; 3], |c| c == [0; 3]),
        Scene::set("two voxels with a seam", [16; 3], |[x, y, z]| x == 9 && (y == 4 || y == 5) && z == 3),
        Scene::set("non-cubic dims beside padding", [16, 3, 9], |[x, y, z]| x == 15 || y == 2 || z == 8),
    ]
}

#[test]
fn hard_cases_hit_the_expected_voxel_under_all_symmetries() {
    let scenes = hard_scenes();
    let (mut compared, mut unrounded) = (0, 0);
    for symmetry in Symmetry::all() {
        let turned: Vec<Scene> = scenes
            .iter()
            .map(|s| {
                Scene::new(s.name.clone(), [16; 3], s.cells.iter().map(|c| symmetry.cell(*c, 16)).collect())
            })
            .collect();
        for case in BUGS.iter().flat_map(|bug| bug.rays) {
            let straight = Ray::new(4, case.origin, case.direction, case.t_min).unwrap();
            let turned_ray =
                Ray::new(4, symmetry.point(case.origin, 16.0), symmetry.vector(case.direction), case.t_min)
                    .unwrap();
            // A ray that runs within a plane of cells belongs to the cells above it (d = 0: floor), also
            // after a mirror: there the hit does not permute, by definition.
            let in_plane = |r: &Ray| (0..3).any(|a| r.direction()[a] == 0 && r.origin()[a] % 65536 == 0);
            let permutes = !straight.as_ref().is_some_and(in_plane) || symmetry.mirror == [false; 3];
            for (scene, turned) in scenes.iter().zip(&turned) {
                let label = format!("{} in {} under {symmetry:?}", case.name, scene.name);
                let hit = straight.and_then(|ray| first_hit(&scene.tree, &ray, 0).hit);
                let turned_hit = turned_ray.and_then(|ray| first_hit(&turned.tree, &ray, 0).hit);
                if scene.name == "full solid" {
                    assert_eq!(hit.map(|h| h.cell), case.first, "{label}");
                }
                if permutes {
                    assert_eq!(
                        turned_hit.map(|h| h.cell),
                        hit.map(|h| symmetry.cell(h.cell, 16)),
                        "{label}: the hit must turn with the scene"
                    );
                    assert_eq!(turned_hit.map(|h| h.t), hit.map(|h| h.t), "{label}");
                }
                if let Some(ray) = turned_ray {
                    let trace = first_hit(&turned.tree, &ray, 0);
                    assert!(trace.steps <= step_limit(4), "{label}");
                    let got = trace.hit.map(|h| (h.cell, h.face));
                    let walked = reference::walk(&turned.bits, &ray, false, |_| {}).map(|h| (h.cell, h.face));
                    assert_eq!(got, walked, "{label}");
                    let sealed = sealed_hit(&turned.tree, &ray, 0).map(|h| h.cell);
                    // What the ray was before it was rounded, wherever that changes nothing.
                    let exact = ExactRay::new(
                        symmetry.point(case.origin, 16.0),
                        symmetry.vector(case.direction),
                        case.t_min,
                    );
                    if exact.is(&ExactRay::of_fixed(&ray)) {
                        let truth = exact.first_in(&turned.tree).map(|h| h.cell);
                        assert_eq!(got.map(|(cell, _)| cell), truth, "{label}, without rounding");
                        unrounded += 1;
                    }
                    let want = reference::walk(&turned.bits, &ray, true, |_| {}).map(|h| h.cell);
                    assert_eq!(sealed, want, "{label}, sealed");
                    compared += 1;
                }
            }
        }
    }
    assert!(compared > 48 * 40 * scenes.len(), "{compared}");
    assert!(unrounded > compared / 4, "{unrounded} of {compared}");
}

#[test]
fn all_26_sign_and_tie_directions_are_exact() {
    let scenes = hard_scenes();
    let mut counts = Mismatches::default();
    for code in (0..27).filter(|code| *code != 13) {
        let direction = [code % 3 - 1, code / 3 % 3 - 1, code / 9 - 1].map(f64::from);
        for scene in &scenes {
            for at in crate::common::scenes::all_cells([9; 3]) {
                // Lattice points inside and on the grid, and the same pushed back outside it.
                for back in [0.0, 20.0] {
                    let origin = std::array::from_fn(|a| f64::from(at[a]) * 2.0 - back * direction[a]);
                    if let Some(ray) = Ray::new(4, origin, direction, 0.0).unwrap() {
                        counts.compare(&scene.tree.view(), &scene.bits, &ray);
                    }
                }
            }
        }
    }
    assert_eq!(counts.total(), 0, "{counts:?}");
    assert!(counts.rays > 200_000, "{counts:?}");
}

//! Affines: tiny, huge, oblique, mirrored, nearly flat.

use super::{Built, build, dot, hard_cases, unit};
use crate::prelude::*;

const SIDE: u32 = 24;
const CENTRE: [f64; 3] = [11.7, 11.4, 11.6];

/// A ball of radius 8 voxels with a soft edge, placed by an affine.
fn ball(affine: Affine) -> Built {
    let voxels = Voxels::from_fn(Dims::new(SIDE, SIDE, SIDE).unwrap(), |at| {
        let off: [f64; 3] = std::array::from_fn(|a| f64::from(at[a]) - CENTRE[a]);
        (1000.0 * (8.0 - dot(off, off).sqrt()).clamp(-3.0, 3.0)).round() as i16
    });
    build(&voxels.placed(affine), Threshold::Iso(0.0)).unwrap()
}

fn of_columns(columns: [[f64; 3]; 3], origin: [f64; 3]) -> Affine {
    let row = |i: usize| [columns[0][i], columns[1][i], columns[2][i], origin[i]];
    Affine { rows: [row(0), row(1), row(2)] }
}

/// Rays towards the ball from all around hit the same voxels as without the affine, and nowhere else.
fn hits_are_those_of_the_plain_ball(affine: Affine, name: &str) {
    let (plain, placed) = (ball(Affine::from_spacing([1.0; 3])), ball(affine));
    assert_eq!(plain.cells(), placed.cells(), "{name}: voxels are never resampled");
    let (plain, placed) = (plain.model(), placed.model());
    let (plain, placed) = (RayCaster::new(&plain).unwrap(), RayCaster::new(&placed).unwrap());
    let mut other = 0;
    for i in 0..300_u32 {
        // Directions that cover the sphere evenly.
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / 300.0;
        let turn = f64::from(i) * 2.399_963;
        let r = (1.0 - z * z).sqrt();
        let from: [f64; 3] =
            std::array::from_fn(|a| CENTRE[a] + 40.0 * [r * turn.cos(), r * turn.sin(), z][a]);
        let way: [f64; 3] = std::array::from_fn(|a| CENTRE[a] + 0.3 - from[a]);
        let expected = plain.first_hit(from, way).unwrap().expect("aims at the ball");
        let hit = placed.first_hit(affine.apply(from), affine.apply_vector(way)).unwrap();
        let hit = hit.unwrap_or_else(|| panic!("{name}: ray {i} is lost"));
        // What the affine rounds away may move a ray over an edge, to a neighbour.
        let near = (0..3).all(|a| hit.voxel[a].abs_diff(expected.voxel[a]) <= 1);
        assert!(near, "{name} ray {i}: {:?} {:?}", hit.voxel, expected.voxel);
        other += u32::from(hit.voxel != expected.voxel);
        assert!((hit.t - expected.t).abs() < 0.05, "{name} ray {i}");
    }
    assert!(other <= 3, "{name}: {other} of 300 hit a neighbour");
}

hard_cases! {
    spacings_from_atoms_to_stars:
        "A fixed epsilon in mm takes small voxels for flat ones, and large ones for one.",
        "ITK #3333, #2674 (small voxels refused as no affine)" => {
        for scale in [1e-12, 1e-6, 1e-3, 1e3, 1e6, 1e12] {
            hits_are_those_of_the_plain_ball(Affine::from_spacing([scale; 3]), &format!("{scale:e}"));
        }
    }

    far_from_the_origin:
        "A volume at coordinates of millions loses its voxels' places to rounding.",
        "VoxelRT's notes (far origins), all-is-cubes" => {
        let at = |offset: f64, scale: f64| {
            of_columns([[scale, 0.0, 0.0], [0.0, scale, 0.0], [0.0, 0.0, scale]], [offset, -offset, 0.3 * offset])
        };
        hits_are_those_of_the_plain_ball(at(1e6, 1.0), "1e6 voxels away");
        hits_are_those_of_the_plain_ball(at(1.0, 1e-6), "1e-6 mm at 1 mm");
        hits_are_those_of_the_plain_ball(at(1e6, 1e-3), "1e9 voxels away");
    }

    spacings_that_differ_a_thousandfold:
        "One length is taken for all axes: hits beside the voxel, normals along the long axis.",
        "ospray #446, pygfx #1295 (normals without the scale of the axes)" => {
        hits_are_those_of_the_plain_ball(Affine::from_spacing([1.0, 1.0, 1000.0]), "1:1:1000");
        hits_are_those_of_the_plain_ball(Affine::from_spacing([1e-3, 1.0, 30.0]), "1:1000:30000");
    }

    normals_stay_perpendicular_under_any_affine:
        "Normals are turned like points where they need the inverse transposed: lighting that does not fit the shape.",
        "ospray #446 (non-uniform scale)" => {
        for affine in [
            Affine::from_spacing([1.0, 2.0, 0.5]),
            of_columns([[1.0, 0.2, 0.0], [-0.3, 0.9, 0.1], [0.2, 0.4, 1.5]], [3.0, 4.0, 5.0]),
            of_columns([[0.0, 0.0, -2.0], [0.7, 0.0, 0.0], [0.0, 1.0, 0.0]], [0.0; 3]),
        ] {
            let built = ball(affine);
            let model = built.model();
            let caster = RayCaster::new(&model).unwrap();
            let inverse = affine.inverse().unwrap();
            let mut worst = 0.0_f64;
            for i in 0..400_u32 {
                let (u, v) = (f64::from(i % 20) * 0.7 + 4.7, f64::from(i / 20) * 0.7 + 4.4);
                let hit = caster.first_hit(affine.apply([u, v, -30.0]), affine.apply_vector([0.0, 0.0, 1.0]));
                let Some(hit) = hit.unwrap() else { continue };
                // The gradient of the ball's equation in the world: the index radius through the inverse transposed.
                let r: [f64; 3] = std::array::from_fn(|a| f64::from(hit.voxel[a]) - CENTRE[a]);
                let world: [f64; 3] =
                    std::array::from_fn(|i| (0..3).map(|a| inverse.rows[a][i] * r[a]).sum::<f64>());
                let cosine = dot(unit(world), hit.normal.unwrap());
                worst = worst.max(cosine.clamp(-1.0, 1.0).acos().to_degrees());
            }
            assert!(worst < 4.0, "{affine:?}: {worst}");
        }
    }

    mirrored_volumes_keep_their_outside:
        "A left-handed affine turns normals inside out, or the picture into its mirror image.",
        "dcm2niix #1018 (the sign of an axis), many viewers" => {
        let mirrored = of_columns([[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [23.0, 0.0, 0.0]);
        hits_are_those_of_the_plain_ball(mirrored, "mirrored");
        let built = ball(mirrored);
        let model = built.model();
        let hit = RayCaster::new(&model).unwrap().first_hit([60.0, 11.4, 11.6], [-1.0, 0.0, 0.0]).unwrap().unwrap();
        assert!(hit.normal.unwrap()[0] > 0.95 && hit.voxel[0] < 6, "{hit:?}");
    }

    centred_exactly_on_the_origin:
        "A translation that cancels the middle of the volume makes a matrix look degenerate.",
        "nibabel #182" => {
        let middle = f64::from(SIDE - 1) / -2.0;
        let affine = of_columns([[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [-middle, middle, middle]);
        hits_are_those_of_the_plain_ball(affine, "centred");
    }

    sheared_affines_up_to_nearly_flat:
        "A shear is dropped, or one that is nearly singular is inverted all the same: pictures of noise.",
        "highdicom #440, napari-nninteractive #10 (a singular matrix is found when it is too late)" => {
        for shear in [0.3, 3.0, 30.0] {
            let affine = of_columns([[1.0, 0.0, 0.0], [shear, 1.0, 0.0], [0.0, 0.2, 1.0]], [0.0; 3]);
            hits_are_those_of_the_plain_ball(affine, &format!("shear {shear}"));
        }
        let dims = Dims::new(8, 8, 8).unwrap();
        for (flat, height) in [(true, 0.0), (true, 1e-12), (false, 1e-6)] {
            let affine = of_columns([[1.0, 0.0, 0.0], [1.0, height, 0.0], [0.0, 0.0, 1.0]], [0.0; 3]);
            let space = GridSpace::new(dims, &affine);
            assert_eq!(space.is_err_and(|error| error.to_string().contains("axes are (nearly) parallel")), flat, "{height}");
            let ball = Voxels::from_fn(dims, |_| 1_u8).placed(affine);
            if flat {
                // Built or refused, never a panic; and what was built says so when it is shown.
                let folder = tempfile::tempdir().unwrap();
                let path = folder.path().join("flat.oct");
                if infobyte::build(&ball, &skin_options(), &path).is_ok() {
                    let model = infobyte::Model::open(&path).unwrap();
                    assert!(infobyte::render(&model, &RenderRequest::default()).is_err());
                }
            }
        }
    }

    affines_that_are_no_numbers:
        "NaN or infinity in the affine passes for a place.",
        "VisIt #703, spec2nii #123 (a column of zeros)" => {
        let dims = Dims::new(4, 4, 4).unwrap();
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, 0.0] {
            for (row, column) in [(0, 0), (1, 1), (2, 2)] {
                let mut affine = Affine::from_spacing([1.0; 3]);
                affine.rows[row][column] = bad;
                let space = GridSpace::new(dims, &affine);
                assert!(space.is_err_and(|error| error.to_string().contains("axes are (nearly) parallel")), "{bad} at {row} {column}");
            }
        }
        let mut affine = Affine::from_spacing([1.0; 3]);
        affine.rows[1][3] = f64::NAN;
        assert!(GridSpace::new(dims, &affine).is_err());
    }
}

//! Where a picture may be taken from.

use crate::prelude::*;
use infobyte::RenderReport;

use super::{Built, build, hard_cases};

/// A hollow box: walls from 4 to 5 and from 26 to 27 along every axis.
fn hollow() -> Built {
    let wall = |at: [u32; 3]| at.iter().all(|c| (4..28).contains(c)) && at.iter().any(|c| *c < 6 || *c >= 26);
    let voxels = Voxels::from_fn(Dims::new(32, 32, 32).unwrap(), |at| u8::from(wall(at)));
    build(&voxels, Threshold::Iso(1.0)).unwrap()
}

fn look(
    built: &Built,
    eye: [f64; 3],
    look_at: [f64; 3],
    up: Option<[f64; 3]>,
) -> Result<RenderReport, RenderError> {
    let request = RenderRequest {
        size: Some([48; 2]),
        point: Some(ViewPoint::Free { eye, look_at, up }),
        projection: Some(Projection::Perspective),
        fov_deg: Some(60.0),
        ..RenderRequest::default()
    };
    picture(built, &request)
}

fn picture(built: &Built, request: &RenderRequest) -> Result<RenderReport, RenderError> {
    match infobyte::render(&built.model(), request) {
        Ok((_, report)) => Ok(report),
        Err(infobyte::Error::Render(error)) => Err(error),
        Err(other) => panic!("{other}"),
    }
}

hard_cases! {
    looking_along_the_upward_direction:
        "The product of sight and upward direction is 0 and the camera's axes NaN: a black picture.",
        "glm #881, libgdx #1198, rayrender #7, gl-matrix #466" => {
        let model = hollow();
        for eye in [[15.5, 15.5, 90.0], [15.5, 15.5, -60.0]] {
            let report = look(&model, eye, [15.5; 3], None).unwrap();
            assert!(report.hits > 100, "{report:?}");
        }
        let up = Some([0.0, 0.0, 2.0]);
        let refused = look(&model, [15.5, 15.5, 90.0], [15.5; 3], up);
        assert!(refused.unwrap_err().to_string().contains("the up direction is along the line of sight"));
        // A hair beside it is a camera like others.
        assert!(look(&model, [15.5, 15.6, 90.0], [15.5; 3], up).unwrap().hits > 100);
    }

    an_eye_in_what_it_looks_at:
        "A sight of length 0 is divided by its length.",
        "ifc-lite #2450 (a view matrix of NaN)" => {
        let refused = look(&hollow(), [3.0; 3], [3.0; 3], None);
        assert!(refused.unwrap_err().to_string().contains("the eye is at the point that it looks at"));
    }

    cameras_that_are_no_numbers:
        "NaN or infinity reaches the rays: an endless loop, or a picture of nothing without a word.",
        "fast_voxel_traversal #5 (an endless loop)" => {
        let model = hollow();
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert!(look(&model, [bad, 0.0, 0.0], [15.5; 3], None).is_err());
            assert!(look(&model, [0.0; 3], [15.5, bad, 15.5], None).is_err());
            assert!(look(&model, [0.0; 3], [15.5; 3], Some([0.0, 0.0, bad])).is_err());
        }
        for fov_deg in [0.0, -10.0, 180.0, 1e9, f64::NAN] {
            let request = RenderRequest { fov_deg: Some(fov_deg), ..RenderRequest::default() };
            assert!(picture(&model, &request).is_err(), "{fov_deg}");
        }
        for (width, height) in [(0, 10), (10, 0), (u32::MAX, u32::MAX)] {
            let request = RenderRequest { size: Some([width, height]), ..RenderRequest::default() };
            let refused = picture(&model, &request).unwrap_err().to_string();
            assert!(refused.contains(&format!("a picture of {width}x{height} is not possible")), "{refused}");
        }
    }

    an_eye_within_the_model:
        "Hits behind the eye are shown, or the walls around it are lost where the main axis of a ray changes.",
        "the paper, section 3 (a limit along the main axis lets hits behind the eye through)" => {
        let model = hollow();
        // Near a corner, off every axis, on a corner, an edge and a face of voxels and in the middle of one, in a wall: each
        // ray meets the wall from within.
        let anywhere = [[6.1, 6.2, 6.3], [25.4, 7.0, 16.0], [15.5, 15.5, 26.2]];
        let between = [[15.5; 3], [15.0, 15.5, 15.5], [15.0, 15.0, 15.5], [15.0; 3]];
        for eye in anywhere.into_iter().chain(between) {
            for look_at in [[100.0, 15.0, 15.0], [0.0, 0.0, 0.0], [15.5, -80.0, 31.0], [40.0, 40.0, -40.0]] {
                let report = look(&model, eye, look_at, None).unwrap();
                assert_eq!(report.hits, report.rays, "{eye:?} {look_at:?}");
            }
        }
    }

    an_eye_on_a_face_an_edge_or_a_corner:
        "A ray that starts exactly on the border of a voxel belongs to both sides or to neither.",
        "nether-pathfinder #23 (starts on corners)" => {
        let built = hollow();
        let model = built.model();
        let caster = RayCaster::new(&model).unwrap();
        // Voxel (4, 10, 10) reaches from 3.5 to 4.5 in the world.
        for origin in [[3.5, 10.0, 10.0], [3.5, 9.5, 10.0], [3.5, 9.5, 9.5]] {
            let hit = caster.first_hit(origin, [1.0, 0.1, 0.1]).unwrap().unwrap();
            assert_eq!((hit.voxel, hit.t), ([4, 10, 10], 0.0), "{origin:?}");
            // Away from it, the ray leaves at once.
            assert_eq!(caster.first_hit(origin, [-1.0, 0.0, 0.0]).unwrap(), None, "{origin:?}");
        }
        // Within the wall, and within a voxel of the skin.
        assert_eq!(caster.first_hit([4.0, 10.0, 10.0], [-1.0, 0.0, 0.0]).unwrap().unwrap().t, 0.0);
    }

    a_camera_ten_million_voxels_away:
        "Distances are rounded to whole voxels: stripes, or nothing at all.",
        "VoxelRT's notes (far origins)" => {
        let built = hollow();
        let model = built.model();
        let caster = RayCaster::new(&model).unwrap();
        for far in [1e5, 1e7, 1e9] {
            for (a, sign) in (0..3).flat_map(|a| [(a, 1.0), (a, -1.0)]) {
                let mut origin = [12.3, 13.4, 14.2];
                let mut direction = [0.0; 3];
                origin[a] += sign * far;
                direction[a] = -sign;
                let hit = caster.first_hit(origin, direction).unwrap().unwrap();
                let mut expected = [12, 13, 14];
                expected[a] = if sign > 0.0 { 27 } else { 4 };
                assert_eq!(hit.voxel, expected, "{far} {a} {sign}");
                let wall = f64::from(expected[a]) + sign * 0.5;
                assert!((hit.position_mm[a] - wall).abs() <= far * 1e-15, "{far} {hit:?}");
            }
        }
        let report = look(&built, [15.5, -1e7, 15.5], [15.5; 3], None).unwrap();
        // The whole model is smaller than a pixel.
        assert!(report.hits <= 1, "{report:?}");
    }

    pictures_of_one_pixel_and_of_one_row:
        "A picture of a single pixel, row or column divides by its size less 1.",
        "ifc-lite #2441 (thin models and thin pictures)" => {
        let model = hollow();
        // Odd sides, so that a pixel looks at the middle.
        for (width, height) in [(1, 1), (1, 301), (301, 1), (7, 3), (9, 9), (9, 7)] {
            for projection in [Projection::Parallel, Projection::Perspective] {
                let request = RenderRequest {
                    size: Some([width, height]),
                    projection: Some(projection),
                    ..RenderRequest::default()
                };
                let report = picture(&model, &request).unwrap();
                assert!(report.hits >= 1, "{width}x{height} {projection:?}: {report:?}");
            }
        }
    }

    a_model_of_one_voxel_fills_the_picture:
        "The frame around a model without any extent is empty, or infinitely large.",
        "found here: the extent of a single voxel is its box, not its centre" => {
        for spacing in [[1.0; 3], [1e-9, 1e-9, 1e-9], [1e6, 1e6, 1e6]] {
            let voxel = Voxels::from_fn(Dims::new(1, 1, 1).unwrap(), |_| 1_u8).placed(Affine::from_spacing(spacing));
            let built = build(&voxel, Threshold::Iso(1.0)).unwrap();
            for projection in [Projection::Parallel, Projection::Perspective] {
                let request = RenderRequest {
                    size: Some([64; 2]),
                    projection: Some(projection),
                    ..RenderRequest::default()
                };
                let report = picture(&built, &request).unwrap();
                assert!(report.hits >= 2500, "{spacing:?} {projection:?}: {report:?}");
            }
        }
    }
}

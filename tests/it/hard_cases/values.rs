//! Samples and thresholds.

use crate::prelude::*;
use infobyte::volume::Scalar;

use super::{Rescaled, build, dot, hard_cases, skin, unit};

const SIDE: u32 = 20;
const DIMS: [u32; 3] = [SIDE; 3];
const CENTRE: [f64; 3] = [9.3, 9.6, 9.4];

fn from(at: [u32; 3]) -> [f64; 3] {
    std::array::from_fn(|a| f64::from(at[a]) - CENTRE[a])
}

fn distance(at: [u32; 3]) -> f64 {
    dot(from(at), from(at)).sqrt()
}

fn volume<T: Scalar>(sample: impl FnMut([u32; 3]) -> T) -> Voxels<T> {
    Voxels::from_fn(Dims::new(SIDE, SIDE, SIDE).unwrap(), sample)
}

/// Greatest angle of a normal to the ball's radius, in degrees; every voxel has a normal of length 1.
fn worst_angle(built: &super::Built) -> f64 {
    let angle = |(at, normal): ([u32; 3], Option<[f64; 3]>)| {
        let normal = normal.expect("every voxel has a normal");
        assert!((dot(normal, normal) - 1.0).abs() < 1e-3, "{at:?}: {normal:?}");
        dot(normal, unit(from(at))).clamp(-1.0, 1.0).acos().to_degrees()
    };
    built.voxels().into_iter().map(angle).fold(0.0, f64::max)
}

/// Builds a ball of radius 6 whose steps are `low` and `high` of a type; the threshold is `iso`.
fn ball_of<T: Scalar>(low: T, high: T, iso: f64) -> f64 {
    let built =
        build(&volume(|at| if distance(at) <= 6.0 { high } else { low }), Threshold::Iso(iso)).unwrap();
    assert_eq!(built.cells(), skin(DIMS, |at| distance(at) <= 6.0), "{:?}", T::TYPE);
    worst_angle(&built)
}

/// A ramp that falls outwards from 8 at the middle; inside is what is at least 2.
fn ramp(at: [u32; 3]) -> f64 {
    8.0 - distance(at)
}

hard_cases! {
    extremes_of_every_type_do_not_wrap:
        "Differences of samples at both ends of their type wrap around or saturate: normals point anywhere, and the \
         threshold compares wrong numbers.",
        "dwave image-segmentation #10, SimpleCV #354 (u8 differences wrap)" => {
        let worst = [
            ball_of(0_u8, u8::MAX, 1.0),
            ball_of(i8::MIN, i8::MAX, 0.0),
            ball_of(0_u16, u16::MAX, 65535.0),
            ball_of(i16::MIN, i16::MAX, 32767.0),
            ball_of(0_u32, u32::MAX, f64::from(u32::MAX)),
            ball_of(i32::MIN, i32::MAX, f64::from(i32::MIN + 1)),
        ];
        // The same ball in the same two levels has the same normals.
        assert!(worst.iter().all(|w| (w - worst[0]).abs() < 0.7 && *w < 40.0), "{worst:?}");
    }

    nan_is_outside_and_gives_no_nan:
        "NaN among the samples is taken for inside, or reaches the normals of its neighbours.",
        "mkazhdan IsoSurfaceExtraction #4, instant-ngp #1391 (NaN vertices and normals)" => {
        let hole = |at: [u32; 3]| at[0] > 9 && at[1] > 9 || at == [9, 9, 3];
        let value = |at: [u32; 3]| if hole(at) { f64::NAN } else { ramp(at) };
        let inside = |at: [u32; 3]| value(at) >= 2.0;
        let double = build(&volume(value), Threshold::Iso(2.0)).unwrap();
        let single = build(&volume(|at| value(at) as f32), Threshold::Iso(2.0)).unwrap();
        for built in [double, single] {
            assert_eq!(built.cells(), skin(DIMS, inside));
            assert!(built.voxels().iter().all(|(_, n)| n.is_some_and(|n| (dot(n, n) - 1.0).abs() < 1e-3)));
        }
    }

    infinity_is_a_value_like_others:
        "Plus infinity is dropped though it is at least the threshold, or infinity minus infinity makes normals NaN.",
        "widgetti ipyvolume #39 (gradients of rows with NaN)" => {
        let value = |at: [u32; 3]| match distance(at) {
            d if d < 4.0 => f32::INFINITY,
            d if d > 7.0 => f32::NEG_INFINITY,
            _ => 3.0,
        };
        let built = build(&volume(value), Threshold::Iso(2.0)).unwrap();
        assert_eq!(built.cells(), skin(DIMS, |at| distance(at) <= 7.0));
        assert!(worst_angle(&built) < 45.0, "{}", worst_angle(&built));
        let inner = build(&volume(value), Threshold::Range(4.0, f64::INFINITY)).unwrap();
        assert_eq!(inner.cells(), skin(DIMS, |at| distance(at) < 4.0));
    }

    otsu_leaves_nan_and_infinity_out:
        "A NaN indexes a bin of the histogram that is not there, or infinity stretches all others into one bin.",
        "NiftySeg #12 (a crash), CellProfiler #624, mantidimaging #2532" => {
        let value = |at: [u32; 3]| match at {
            [0, 0, z] if z % 2 == 0 => f32::NAN,
            [1, 0, z] if z % 2 == 0 => f32::INFINITY,
            [2, 0, z] if z % 2 == 0 => f32::NEG_INFINITY,
            _ if distance(at) <= 6.0 => 900.0,
            _ => 100.0,
        };
        let built = build(&volume(value), Threshold::Otsu).unwrap();
        let lo = built.report.selection.lo;
        assert!((100.0..=900.0).contains(&lo), "{lo}");
        assert_eq!(built.cells(), skin(DIMS, |at| f64::from(value(at)) >= lo));
    }

    otsu_of_one_value_is_refused:
        "A volume of one value has nothing to split: an index out of an empty list, or everything inside in silence.",
        "scikit-image #1856" => {
        for error in [
            build(&volume(|_| 7_u16), Threshold::Otsu).err(),
            build(&volume(|_| 7.5_f64), Threshold::Otsu).err(),
        ] {
            assert!(matches!(error, Some(BuildError::EmptyResult { .. })), "{error:?}");
        }
        let nothing = build(&volume(|_| f32::NAN), Threshold::Otsu).err();
        assert!(matches!(nothing, Some(BuildError::NoNumbers { .. })), "{nothing:?}");
    }

    otsu_of_two_values_splits_them:
        "Empty bins before the first value pull the threshold to 0: everything is inside.",
        "scikit-image #5496" => {
        for (low, high) in [(60_000_u16, 60_001), (0, 1), (0, 65535)] {
            let built = build(&volume(|at| if distance(at) <= 6.0 { high } else { low }), Threshold::Otsu).unwrap();
            assert_eq!(built.cells(), skin(DIMS, |at| distance(at) <= 6.0), "{low} {high}");
        }
    }

    denormals_keep_their_direction:
        "The square of a tiny gradient is 0: a division by zero makes its normal NaN, though the gradient is not 0.",
        "biodynamo #259 (a gradient of 1.4e-45 has norm 0)" => {
        let built = build(&volume(|at| (ramp(at) * 1e-42) as f32), Threshold::Iso(2e-42)).unwrap();
        assert!(worst_angle(&built) < 20.0, "{}", worst_angle(&built));
        let built = build(&volume(|at| ramp(at) * 1e-300), Threshold::Iso(2e-300)).unwrap();
        // In single precision the gradient is 0 there: the exposed faces say where the outside is.
        assert!(worst_angle(&built) < 60.0, "{}", worst_angle(&built));
    }

    huge_values_do_not_overflow_gradients:
        "Sums of samples near the greatest number are infinite, and normals NaN.",
        "found here: weights of a 5x5x5 kernel add up to thousands" => {
        for scale in [1e36, 4e37] {
            let built = build(&volume(|at| (ramp(at) * scale) as f32), Threshold::Iso(2.0 * scale)).unwrap();
            assert!(worst_angle(&built) < 60.0, "{scale}: {}", worst_angle(&built));
        }
        let built = build(&volume(|at| ramp(at) * 2e307), Threshold::Iso(4e307)).unwrap();
        assert!(worst_angle(&built) < 60.0, "{}", worst_angle(&built));
    }

    values_equal_to_the_threshold_are_inside:
        "Samples that are the threshold itself count as inside in one place and as outside in another: holes.",
        "scikit-image #8116 (holes), geometry-central #251 (contours dropped)" => {
        let value = |at: [u32; 3]| [0.0_f32, 2.0, 5.0][((at[0] * 7 + at[1] * 3 + at[2]) % 3) as usize];
        let iso = build(&volume(value), Threshold::Iso(2.0)).unwrap();
        assert_eq!(iso.cells(), skin(DIMS, |at| value(at) >= 2.0));
        let only = build(&volume(value), Threshold::Range(2.0, 2.0)).unwrap();
        assert_eq!(only.cells(), skin(DIMS, |at| value(at) == 2.0));
        let both = build(&volume(value), Threshold::Range(0.0, 2.0)).unwrap();
        assert_eq!(both.cells(), skin(DIMS, |at| value(at) <= 2.0));
    }

    minus_zero_is_zero:
        "A comparison of bits takes -0.0 for less than 0.0, or for the least of all numbers.",
        "drjit #311 (of rays)" => {
        let value = |at: [u32; 3]| if distance(at) <= 6.0 { -0.0_f64 } else { -1.0 };
        for threshold in [Threshold::Iso(0.0), Threshold::Iso(-0.0), Threshold::Range(-0.0, 0.0)] {
            let built = build(&volume(value), threshold).unwrap();
            assert_eq!(built.cells(), skin(DIMS, |at| distance(at) <= 6.0), "{threshold:?}");
        }
        let single = build(&volume(|at| value(at) as f32), Threshold::Otsu).unwrap();
        assert_eq!(single.cells(), skin(DIMS, |at| distance(at) <= 6.0));
    }

    the_threshold_need_not_be_zero:
        "Code that was tried with a threshold of 0 alone forgets it where it interpolates or derives.",
        "libigl #1032, MarchingCubes.jl #5" => {
        let model = |offset: f64| {
            build(&volume(|at| (16.0 * ramp(at) + offset).round() as i32), Threshold::Iso(32.0 + offset)).unwrap()
        };
        let (plain, moved) = (model(0.0), model(1024.0));
        assert_eq!(plain.voxels(), moved.voxels());
    }

    empty_and_inverted_ranges_are_refused:
        "A range without values, or with its ends exchanged, gives an empty model and exit code 0.",
        "ooc_svo_builder 1.6.4 (an empty octree, exit code 0), SimVascular #746 (a message that names no numbers)" => {
        let field = volume(|at| ramp(at) as f32);
        let empty = build(&field, Threshold::Range(100.0, 200.0)).err();
        assert!(
            matches!(empty, Some(BuildError::EmptyResult { min, max, .. }) if min < -7.0 && max > 7.0),
            "{empty:?}"
        );
        for (lo, hi) in [(3.0, 2.0), (f64::NAN, 1.0), (0.0, f64::NAN), (f64::INFINITY, f64::NEG_INFINITY)] {
            let inverted = build(&field, Threshold::Range(lo, hi)).err();
            assert!(matches!(inverted, Some(BuildError::EmptyRange { .. })), "{lo}..{hi}: {inverted:?}");
        }
        assert!(matches!(build(&field, Threshold::Iso(f64::NAN)).err(), Some(BuildError::EmptyRange { .. })));
        // Between two whole numbers there is none.
        let between = build(&volume(|at| at[0] as u8), Threshold::Range(3.2, 3.8)).err();
        assert!(matches!(between, Some(BuildError::EmptyResult { .. })), "{between:?}");
    }

    limits_beyond_the_type_are_clipped_not_cast:
        "A threshold beyond the samples' type is cast into it: 70000 becomes 4464 of 16 bits, -1 becomes 255.",
        "tobac #367 and others (thresholds of another type than the samples)" => {
        let bytes = volume(|at| (at[0] * 12) as u8);
        let all = build(&bytes, Threshold::Range(-1e9, 1e9)).unwrap();
        assert_eq!(all.cells(), skin(DIMS, |_| true));
        assert_eq!(build(&bytes, Threshold::Iso(-1.0)).unwrap().cells(), all.cells());
        assert!(build(&bytes, Threshold::Iso(256.0)).is_err());
        assert!(build(&volume(|at| at[1] as u16), Threshold::Iso(65536.0 + 3.0)).is_err());
        let part = build(&bytes, Threshold::Range(f64::NEG_INFINITY, 100.5)).unwrap();
        assert_eq!(part.cells(), skin(DIMS, |at| at[0] * 12 <= 100));
    }

    whole_numbers_above_2_to_24_are_told_apart:
        "Samples pass through single precision on their way to the threshold: neighbours become equal.",
        "found here: the fast kernels are single precision" => {
        let (low, high) = (16_777_216_u32, 16_777_217_u32);
        assert!(ball_of(low, high, f64::from(high)) < 90.0);
        assert!(ball_of(-i32::MAX, -i32::MAX + 1, f64::from(-i32::MAX + 1)) < 90.0);
        let built = build(
            &volume(|at| if distance(at) <= 6.0 { 1.0 + 1e-12 } else { 1.0 }),
            Threshold::Iso(1.0 + 5e-13),
        );
        assert_eq!(built.unwrap().cells(), skin(DIMS, |at| distance(at) <= 6.0));
    }

    a_falling_scale_turns_inside_and_normals_around:
        "A negative slope is applied to the values but not to the comparison, or not to the gradient's sign.",
        "dcm2niix #363 #978 (slopes per slice left out)" => {
        let falling = Rescaled::new(
            volume(|at| (1000.0 - 100.0 * ramp(at)) as i16),
            Rescale { slope: -0.01, intercept: 10.0 },
        );
        let built = build(&falling, Threshold::Iso(2.0)).unwrap();
        assert!(worst_angle(&built) < 5.0, "{}", worst_angle(&built));
        let inside = |at: [u32; 3]| -0.01 * f64::from((1000.0 - 100.0 * ramp(at)) as i16) + 10.0 >= 2.0;
        assert_eq!(built.cells(), skin(DIMS, inside));
        for slope in [1e-12, 1e12, -1e-12] {
            let scaled = Rescaled::new(volume(|at| (100.0 * ramp(at)) as i16), Rescale { slope, intercept: 0.0 });
            let threshold =
                if slope > 0.0 { Threshold::Iso(200.0 * slope) } else { Threshold::Iso(-200.0 * slope.abs()) };
            let built = build(&scaled, threshold).unwrap();
            let inside = |at: [u32; 3]| ((100.0 * ramp(at)) as i16 >= 200) == (slope > 0.0)
                || (slope < 0.0 && (100.0 * ramp(at)) as i16 == 200);
            assert_eq!(built.cells(), skin(DIMS, inside), "{slope}");
        }
    }
}

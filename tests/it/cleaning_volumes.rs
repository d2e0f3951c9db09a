//! Crop, mean and occupancy as sources of a build, held to their definitions sample by sample, for every type.
//! If this fails, a model is not where the volume is, or shows values that nobody measured.

use crate::prelude::*;
use std::ops::Range;

use infobyte::clean::ComponentConnectivity;

use volume::decode;

fn samples(source: &dyn VolumeSource) -> Vec<f64> {
    let info = source.info();
    let [nx, ny, nz] = info.dims.to_array();
    let row = nx as usize * info.scalar.bytes();
    let mut out = vec![0; row * ny as usize];
    let mut all = Vec::new();
    for z in 0..nz {
        source.read_rows(z, 0..ny, 0..nx, &mut out).unwrap();
        all.extend(out.chunks_exact(info.scalar.bytes()).map(|b| decode(info.scalar, b)));
    }
    all
}

/// Any part of any slice, with and without a pitch, is that of the whole.
fn check_parts(source: &dyn VolumeSource, whole: &[f64], random: &mut Random) {
    let info = source.info();
    let [nx, ny, nz] = info.dims.to_array();
    let bytes = info.scalar.bytes();
    let mut range = |n: u32| {
        let start = random.below(n);
        start..start + 1 + random.below(n - start)
    };
    for _ in 0..12 {
        let (cols, rows, z) = (range(nx), range(ny), range(nz).start);
        let pitch = cols.len() * bytes + 3 * bytes;
        let mut block = vec![0; cols.len() * rows.len() * bytes];
        let mut pitched = vec![0xee; pitch * (rows.len() - 1) + cols.len() * bytes];
        source.read_rows(z, rows.clone(), cols.clone(), &mut block).unwrap();
        source.read_pitched(z, rows.clone(), cols.clone(), pitch, &mut pitched).unwrap();
        for (i, y) in rows.enumerate() {
            for (j, x) in cols.clone().enumerate() {
                let want = whole[((z * ny + y) * nx + x) as usize].to_bits();
                let at = (i * cols.len() + j) * bytes;
                assert_eq!(decode(info.scalar, &block[at..at + bytes]).to_bits(), want);
                let at = i * pitch + j * bytes;
                assert_eq!(decode(info.scalar, &pitched[at..at + bytes]).to_bits(), want);
            }
        }
        let gap = &pitched[cols.len() * bytes..pitch.min(pitched.len())];
        assert!(gap.iter().all(|b| *b == 0xee), "what lies between rows stays");
    }
}

/// A volume with waves and noise, and for floats some NaN and infinities.
fn volume(dims: [u32; 3], scalar: ScalarType, random: &mut Random) -> MemoryVolume {
    let count = dims.iter().map(|n| *n as usize).product();
    let span = match scalar {
        ScalarType::U8 => (0.0, 255.0),
        ScalarType::I8 => (-128.0, 127.0),
        ScalarType::U32 => (0.0, 4.0e9),
        ScalarType::I32 => (-2.0e9, 2.0e9),
        ScalarType::U16 => (0.0, 4000.0),
        _ => (-1000.0, 3000.0),
    };
    let float = matches!(scalar, ScalarType::F32 | ScalarType::F64);
    let values: Vec<f64> = (0..count)
        .map(|_| match random.below(if float { 60 } else { 40 }) {
            57 => f64::INFINITY,
            58 => f64::NEG_INFINITY,
            59 => f64::NAN,
            _ => span.0 + (span.1 - span.0) * random.unit(),
        })
        .collect();
    MemoryVolume::new(dims, scalar, &values)
}

fn near(a: [f64; 3], b: [f64; 3]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-12 * (1.0 + b.abs()))
}

fn dims_of(source: &dyn VolumeSource) -> [u32; 3] {
    source.info().dims.to_array()
}

#[test]
fn a_crop_is_the_part_and_stays_where_it_was() {
    let mut random = Random(1);
    for scalar in ScalarType::ALL {
        let whole = volume([23, 19, 17], scalar, &mut random);
        let values = whole.samples();
        let affine = whole.info().affine;
        let roi: [Range<u32>; 3] = [3..20, 0..19, 5..6];
        let options = CleanOptions { roi: Some(roi.clone()), ..Default::default() };
        let part = options.reshape(Box::new(whole)).unwrap();
        assert_eq!(dims_of(&*part), [17, 19, 1]);
        let want: Vec<f64> = roi[2]
            .clone()
            .flat_map(|z| (0..19).flat_map(move |y| (3..20).map(move |x| (z * 19 + y) * 23 + x)))
            .map(|i| values[i as usize])
            .collect();
        let got = samples(&*part);
        assert!(got.iter().zip(&want).all(|(a, b)| a.to_bits() == b.to_bits()));
        check_parts(&*part, &got, &mut random);
        assert_eq!(part.info().affine.apply([0.0; 3]), affine.apply([3.0, 0.0, 5.0]));
        assert_eq!(part.info().affine.apply([2.0, 1.0, 0.0]), affine.apply([5.0, 1.0, 5.0]));
    }
}

/// A mask of NaN is as wide as before, not a block wider.
#[test]
fn downsampling_keeps_nan_outside() {
    let value = |p: [u32; 3]| if p[0] < 5 && p[1] < 7 { 1.0 } else { f64::NAN };
    let all = (0..512).map(|i: u32| value([i % 8, i / 8 % 8, i / 64])).collect::<Vec<_>>();
    let options = CleanOptions { downsample: Some(2), ..Default::default() };
    let whole = MemoryVolume::new([8; 3], ScalarType::F32, &all);
    let got = samples(&*options.reshape(Box::new(whole)).unwrap());
    for (i, got) in (0..).zip(got) {
        // The blocks at x = 4 are half NaN, as are those at y = 6; those in both are NaN for the most part.
        let [x, y] = [i % 4, i / 4 % 4];
        assert_eq!(got.is_nan(), x == 3 || x == 2 && y == 3, "{x} {y}");
    }
}

#[test]
fn downsampling_takes_the_mean_and_keeps_the_box_in_the_world() {
    let mut random = Random(2);
    for scalar in ScalarType::ALL {
        for factor in [2_u32, 4] {
            for dims in [[24, 16, 8], [23, 9, 5], [1, 2, 3], [1100, 5, 4]] {
                let whole = volume(dims, scalar, &mut random);
                let values = whole.samples();
                let (affine, spacing) = (whole.info().affine, whole.info().spacing_mm);
                let options = CleanOptions { downsample: Some(factor), ..Default::default() };
                let small = options.reshape(Box::new(whole)).unwrap();
                let size = dims_of(&*small);
                assert_eq!(size, dims.map(|n| n.div_ceil(factor)));
                let wide = matches!(scalar, ScalarType::U32 | ScalarType::I32 | ScalarType::F64);
                assert_eq!(small.info().scalar, if wide { ScalarType::F64 } else { ScalarType::F32 });
                let got = samples(&*small);
                let block = |i: u32, n: u32| i * factor..((i + 1) * factor).min(n);
                for (i, got) in got.iter().enumerate() {
                    let i = u32::try_from(i).unwrap();
                    let [x, y, z] = [i % size[0], i / size[0] % size[1], i / size[0] / size[1]];
                    let (mut sum, mut count, mut missing) = (0.0, 0.0, 0.0);
                    for z in block(z, dims[2]) {
                        for y in block(y, dims[1]) {
                            for x in block(x, dims[0]) {
                                let v = values[((z * dims[1] + y) * dims[0] + x) as usize];
                                if !v.is_nan() {
                                    (sum, count) = (sum + v, count + 1.0);
                                } else {
                                    missing += 1.0;
                                }
                            }
                        }
                    }
                    let mean: f64 = if missing > count { f64::NAN } else { sum / count };
                    #[expect(clippy::cast_possible_truncation, reason = "as documented")]
                    let want = if wide { mean } else { f64::from(mean as f32) };
                    assert!(*got == want || got.is_nan() && want.is_nan(), "{scalar} {factor} {got} {want}");
                }
                check_parts(&*small, &got, &mut random);
                // Corners of the box, half a voxel before the first centre and after the last.
                let new = small.info().affine;
                assert!(near(new.apply([-0.5; 3]), affine.apply([-0.5; 3])));
                assert!(near(new.spacing_mm(), spacing.map(|s| s * f64::from(factor))));
                assert_eq!(new.spacing_mm(), small.info().spacing_mm);
                if dims.iter().all(|n| n % factor == 0) {
                    let high = |n: [u32; 3]| n.map(|n| f64::from(n) - 0.5);
                    assert!(near(new.apply(high(size)), affine.apply(high(dims))));
                }
            }
        }
    }
}

#[test]
fn an_oblique_volume_keeps_its_corners() {
    let mut random = Random(3);
    let rows = [[0.5, 0.1, 0.3, -20.0], [-0.1, 0.6, 0.0, 7.5], [0.05, -0.2, 1.5, 100.0]];
    let whole = volume([32, 24, 16], ScalarType::I16, &mut random).placed(Affine { rows });
    let roi = [4..28, 8..24, 0..16];
    let options = CleanOptions { roi: Some(roi), downsample: Some(4), ..Default::default() };
    let small = options.reshape(Box::new(whole)).unwrap();
    let affine = Affine { rows };
    for corner in 0..8 {
        let at = |low: [f64; 3], high: [f64; 3]| {
            std::array::from_fn(|axis| if corner >> axis & 1 == 1 { high[axis] } else { low[axis] })
        };
        let new = small.info().affine.apply(at([-0.5; 3], [5.5, 3.5, 3.5]));
        let old = affine.apply(at([3.5, 7.5, -0.5], [27.5, 23.5, 15.5]));
        assert!(near(new, old), "{new:?} {old:?}");
    }
}

fn build_options(threshold: Threshold, threads: usize) -> BuildOptions {
    BuildOptions {
        threshold,
        memory: MemoryCap::Share(8 << 20),
        threads,
        scratch: Some(std::env::temp_dir()),
        ..skin_options()
    }
}

/// Cleans and returns the samples afterwards.
fn cleaned(source: &dyn VolumeSource, options: &CleanOptions, build: &BuildOptions) -> Vec<f64> {
    let cleaned = options.clean(source, build, Path::new("unused.oct"), &Silent).unwrap().unwrap();
    let got = samples(cleaned.source());
    check_parts(cleaned.source(), &got, &mut Random(4));
    let info = cleaned.source().info();
    assert_eq!(
        (info.dims, info.scalar, info.affine),
        (source.info().dims, source.info().scalar, source.info().affine)
    );
    got
}

/// Keeps the largest component by a flood fill through faces.
fn largest(dims: [u32; 3], inside: &[bool]) -> Vec<bool> {
    let mut labels = vec![0_usize; inside.len()];
    let mut best = (0, 0);
    let mut label = 0;
    for first in 0..inside.len() {
        if !inside[first] || labels[first] != 0 {
            continue;
        }
        label += 1;
        let (mut stack, mut size) = (vec![first], 0);
        labels[first] = label;
        while let Some(at) = stack.pop() {
            size += 1;
            let [nx, ny, nz] = dims.map(i64::from);
            let i = i64::try_from(at).unwrap();
            let p = [i % nx, i / nx % ny, i / nx / ny];
            for [x, y, z] in [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]] {
                let [x, y, z] = [p[0] + x, p[1] + y, p[2] + z];
                if (0..nx).contains(&x) && (0..ny).contains(&y) && (0..nz).contains(&z) {
                    let next = usize::try_from((z * ny + y) * nx + x).unwrap();
                    if inside[next] && labels[next] == 0 {
                        labels[next] = label;
                        stack.push(next);
                    }
                }
            }
        }
        if size > best.0 {
            best = (size, label);
        }
    }
    labels.iter().map(|l| *l == best.1 && best.1 != 0).collect()
}

#[test]
fn removed_voxels_get_the_nearest_value_outside_and_others_keep_theirs() {
    let mut random = Random(5);
    for scalar in ScalarType::ALL {
        for (round, rescale) in
            [Rescale::IDENTITY, Rescale { slope: -0.5, intercept: 10.0 }].into_iter().enumerate()
        {
            let dims = [70, 20, 15];
            let source = volume(dims, scalar, &mut random).rescaled(rescale);
            let values = source.samples();
            let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
            sorted.sort_by(f64::total_cmp);
            // One voxel in ten is inside: many components.
            let (low, high) = (sorted[sorted.len() * 6 / 10], sorted[sorted.len() * 7 / 10]);
            let (a, b) = (rescale.apply(low), rescale.apply(high));
            let threshold = Threshold::Range(a.min(b), a.max(b));
            let options = CleanOptions { keep_largest: Some(1), ..Default::default() };
            let got = cleaned(&source, &options, &build_options(threshold, 1 + round));
            let is_inside = |v: f64| {
                let physical = rescale.apply(v);
                a.min(b) <= physical && physical <= a.max(b)
            };
            let inside: Vec<bool> = values.iter().map(|v| is_inside(*v)).collect();
            let kept = largest(dims, &inside);
            let (mut below, mut above) = (0, 0);
            for ((new, old), (was, stays)) in got.iter().zip(&values).zip(inside.iter().zip(&kept)) {
                assert_eq!(is_inside(*new), *stays);
                if was == stays {
                    assert_eq!(new.to_bits(), old.to_bits());
                } else if new < old {
                    below += 1;
                    assert!(
                        *new < low && old - new <= high - old + 1.0 + (high - low) * 1e-6,
                        "{scalar} {old} {new}"
                    );
                } else {
                    above += 1;
                    assert!(
                        *new > high && new - old <= old - low + 1.0 + (high - low) * 1e-6,
                        "{scalar} {old} {new}"
                    );
                }
            }
            assert!(below > 10 && above > 10, "{scalar}: {below} {above}");
        }
    }
}

#[test]
fn operations_compose_in_their_fixed_order() {
    // Two rooms with walls that leak by one voxel; specks around them.
    let dims = [44, 30, 26];
    let wall = |x: u32, y: u32, z: u32| {
        let room = |a: u32, b: u32, c: u32, d: u32| {
            let on = |v: u32, lo: u32, hi: u32| v == lo || v == hi;
            (a..=b).contains(&x)
                && (c..=d).contains(&y)
                && (4..=20).contains(&z)
                && (on(x, a, b) || on(y, c, d) || on(z, 4, 20))
        };
        (room(4, 18, 4, 24) && (x, y, z) != (11, 14, 20))
            || room(24, 40, 6, 20)
            || (x == 2 && y == 2 && z == 24)
    };
    let values: Vec<f64> = (0..dims[2])
        .flat_map(|z| {
            (0..dims[1])
                .flat_map(move |y| (0..dims[0]).map(move |x| f64::from(u8::from(wall(x, y, z))) * 90.0))
        })
        .collect();
    let source = MemoryVolume::new(dims, ScalarType::U8, &values);
    let build = build_options(Threshold::Iso(50.0), 2);
    let count =
        |options: CleanOptions| cleaned(&source, &options, &build).iter().filter(|v| **v >= 50.0).count();
    let full = |a: usize, b: usize| a * b * 17;
    let shells = values.iter().filter(|v| **v > 0.0).count();
    let fill = CleanOptions { fill_cavities: true, ..Default::default() };
    // The leak lets the outside into the first room; the second is filled.
    assert_eq!(count(fill.clone()), shells + 15 * 13 * 15);
    // Closed first, both are.
    let both = CleanOptions { close: 1, ..fill };
    let filled = count(both.clone());
    assert!(filled > full(15, 21) + full(17, 15), "{filled}");
    // The larger of both remains, filled: components come last.
    let one = CleanOptions { keep_largest: Some(1), ..both.clone() };
    assert_eq!(count(one), full(15, 21));
    let two = CleanOptions { drop_below: Some(SizeLimit::PercentOfLargest(1.0)), ..both };
    assert_eq!(count(two.clone()), full(15, 21) + full(17, 15));
    let thin = CleanOptions { connectivity: ComponentConnectivity::Corners26, ..two };
    assert_eq!(count(thin), full(15, 21) + full(17, 15));
}

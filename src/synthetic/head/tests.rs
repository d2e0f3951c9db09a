use super::*;

fn read(head: &SyntheticHead, z: u32, rows: Range<u32>, cols: Range<u32>) -> Vec<i16> {
    let mut out = vec![0_i16; rows.len() * cols.len()];
    head.read_rows(z, rows, cols, bytemuck::cast_slice_mut(&mut out)).unwrap();
    out
}

fn whole(head: &SyntheticHead) -> Vec<i16> {
    (0..head.side).flat_map(|z| read(head, z, 0..head.side, 0..head.side)).collect()
}

/// Indices of all voxels that satisfy `keep`.
fn voxels(samples: &[i16], side: usize, keep: impl Fn(i16) -> bool) -> Vec<[usize; 3]> {
    let at = |i: usize| [i % side, i / side % side, i / side / side];
    samples.iter().enumerate().filter(|(_, v)| keep(**v)).map(|(i, _)| at(i)).collect()
}

/// Nearest index of a position in mm.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the cube")]
fn index(mm: f32, side: u32) -> u32 {
    ((mm / EDGE_MM + 0.5) * side as f32) as u32
}

#[test]
fn any_range_of_a_slice_equals_the_same_range_of_the_whole() {
    // Wider than a piece, so that almost every range splits into other pieces.
    let side = 300_u32;
    let head = SyntheticHead::new(side).unwrap();
    let n = side as usize;
    // A generator with a fixed seed; the hash is random enough to choose ranges.
    let pick = |i: u32, below: u32| hash(i, 7, 11) % below;
    for (k, z) in [0, 40, 81, 106, 113, 118, 140, 201, 241, 299].into_iter().enumerate() {
        let full = read(&head, z, 0..side, 0..side);
        for j in 0..40 {
            let seed = u32::try_from(k).unwrap() * 1000 + j * 10;
            let (x0, y0) = (pick(seed, side), pick(seed + 1, side));
            let (x1, y1) = (x0 + 1 + pick(seed + 2, side - x0), y0 + 1 + pick(seed + 3, (side - y0).min(9)));
            let part = read(&head, z, y0..y1, x0..x1);
            for (row, y) in part.chunks(x1 as usize - x0 as usize).zip(y0 as usize..) {
                assert_eq!(row, &full[y * n + x0 as usize..y * n + x1 as usize], "{x0}..{x1} {y} {z}");
            }
        }
    }
    assert!(read(&head, 5, 3..3, 0..side).is_empty());
    assert!(read(&head, 5, 0..side, 9..9).is_empty());
}

#[test]
fn samples_are_the_same_on_every_machine() {
    let samples = whole(&SyntheticHead::new(64).unwrap());
    // FNV-1a over the samples in little-endian order.
    let sum = samples
        .iter()
        .flat_map(|v| v.to_le_bytes())
        .fold(0xCBF2_9CE4_8422_2325_u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0000_0100_0000_01B3));
    assert_eq!(sum, 0xd078_fca4_7f65_ce0e, "{sum:#018x}");
}

#[test]
fn the_face_looks_to_the_front_and_up_is_up() {
    let side = 96_usize;
    let head = SyntheticHead::new(96).unwrap();
    let samples = whole(&head);
    let skin = voxels(&samples, side, |v| f64::from(v) >= -400.0);
    let nose = skin.iter().min_by_key(|v| v[1]).unwrap();
    assert!((side / 2 - 5..side / 2 + 5).contains(&nose[0]), "the foremost voxel {nose:?} is in the middle");
    assert!(nose[2] < side / 2 && nose[2] > side / 4, "and below the middle: {nose:?}");
    let teeth = voxels(&samples, side, |v| (1800..2300).contains(&v));
    assert!(teeth.len() > 100);
    // The ring's own edges pass through the teeth's values; all teeth lie to its right.
    for [x, y, z] in teeth.into_iter().filter(|v| v[0] < 3 * side / 4) {
        assert!(y < side / 2 && z < side / 2, "a tooth at {x} {y} {z}");
    }
    assert!(skin.iter().all(|v| v[2] < side - 1), "air above the head");
}

#[test]
fn the_patients_left_is_marked_and_lies_at_high_x() {
    let side = 128_u32;
    let head = SyntheticHead::new(side).unwrap();
    let samples = whole(&head);
    let metal = voxels(&samples, 128, |v| v > 2400);
    assert!(!metal.is_empty());
    assert!(metal.iter().all(|v| v[0] > 90), "the ring hangs at the left ear: {metal:?}");
    let (c, _) = BURR_HOLE;
    let at = |x: f32| {
        read(
            &head,
            index(c[2], side),
            index(c[1], side)..index(c[1], side) + 1,
            index(x, side)..index(x, side) + 1,
        )[0]
    };
    assert!(f64::from(at(c[0])) < SyntheticHead::BONE_ISO_HU, "a hole on the left");
    assert!(f64::from(at(-c[0])) > SyntheticHead::BONE_ISO_HU, "bone on the right");
}

#[test]
fn without_the_marks_the_head_is_symmetric_up_to_noise() {
    let side = 100_u32;
    let head = SyntheticHead::new(side).unwrap();
    for z in [25, 40, 52, 60] {
        for row in read(&head, z, 0..side, 0..side).chunks(side as usize) {
            let marked = row.iter().any(|v| *v > 2400);
            // The folds of the brain have no mirror symmetry either.
            let brain = |v: &i16| (-20..=110).contains(v);
            for (a, b) in row.iter().zip(row.iter().rev()).filter(|(a, b)| !(brain(a) && brain(b))) {
                assert!(marked || (i32::from(*a) - i32::from(*b)).abs() <= 25, "{a} {b} at {z}");
            }
        }
    }
}

#[test]
fn every_size_works_and_the_middle_is_the_origin() {
    for side in [1, 2, 3, 7, 33] {
        let head = SyntheticHead::new(side).unwrap();
        let samples = whole(&head);
        assert!(samples.iter().all(|v| (-1012..=3012).contains(v)));
        let middle = f64::from(side - 1) / 2.0;
        let world = head.info().affine.apply([middle; 3]);
        assert!(world.iter().all(|mm| mm.abs() < 1e-9), "{world:?}");
        assert_eq!(head.info().description.bytes, 2 * u64::from(side).pow(3));
    }
    assert!(SyntheticHead::new(0).is_none());
    assert!(SyntheticHead::new(65_537).is_none());
}

#[test]
fn polynomial_waves_are_sines_and_cosines() {
    for i in -20_000..=20_000 {
        let angle = 0.002 * i as f32;
        let [s, c] = sin_cos(angle);
        let (sin, cos) = f64::from(angle).sin_cos();
        assert!((f64::from(s) - sin).abs() < 2e-6 && (f64::from(c) - cos).abs() < 2e-6, "{angle}");
    }
}

#[test]
fn noise_is_centred_and_bounded() {
    // A corner of the cube holds only air.
    let air: Vec<f64> = (0..8)
        .flat_map(|z| read(&SyntheticHead::new(512).unwrap(), z + 500, 0..8, 0..500))
        .map(f64::from)
        .collect();
    let count = air.len() as f64;
    let mean = air.iter().sum::<f64>() / count;
    let deviation = (air.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / count).sqrt();
    assert!((mean + 1000.0).abs() < 0.2, "{mean}");
    assert!((deviation - 4.9).abs() < 0.2, "{deviation}");
}

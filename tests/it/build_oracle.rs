//! The built model is the skin of the volume, whole and nothing else: compared voxel by voxel, node by
//! node and value by value with a slow builder of plain loops that holds everything in memory. If this
//! fails, models have holes or ghosts, or their coarse levels show what the fine ones do not hold.

use crate::prelude::*;
use infobyte::builder::build_volume as build;

/// Interleaves the bits of a cell, one at a time.
fn morton(cell: [u32; 3]) -> u64 {
    (0..17).fold(0, |code, bit| {
        (0..3).fold(code, |code, axis| code | u64::from(cell[axis] >> bit & 1) << (3 * bit + axis))
    })
}

/// What the definition says of a volume.
struct Truth {
    dims: [u32; 3],
    /// Skin voxels by Morton code: the sample, and the sum of the directions to faces that are not inside.
    skin: BTreeMap<u64, (f64, [i32; 3])>,
}

impl Truth {
    /// Plain loops: `lo <= physical <= hi` is inside; skin has a neighbour that is not.
    fn new(
        dims: [u32; 3],
        samples: &[f64],
        rescale: Rescale,
        (lo, hi): (f64, f64),
        thick: Connectivity,
    ) -> Self {
        let [nx, ny, nz] = dims.map(i64::from);
        let at = |x: i64, y: i64, z: i64| usize::try_from((z * ny + y) * nx + x).unwrap();
        let inside: Vec<bool> = samples
            .iter()
            .map(|s| {
                let physical = rescale.slope * s + rescale.intercept;
                lo <= physical && physical <= hi
            })
            .collect();
        let open = |x: i64, y: i64, z: i64| {
            let beyond = x < 0 || y < 0 || z < 0 || x >= nx || y >= ny || z >= nz;
            beyond || !inside[at(x, y, z)]
        };
        let mut neighbours = Vec::new();
        for [dx, dy, dz] in (0..27).map(|i| [i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1]) {
            let distance: i64 = dx * dx + dy * dy + dz * dz;
            if distance == 1 || thick == Connectivity::Thick6 && distance > 0 {
                neighbours.push([dx, dy, dz]);
            }
        }
        let mut skin = BTreeMap::new();
        for z in 0..nz {
            for y in 0..ny {
                for x in 0..nx {
                    let near = |d: &[i64; 3]| open(x + d[0], y + d[1], z + d[2]);
                    if !inside[at(x, y, z)] || !neighbours.iter().any(near) {
                        continue;
                    }
                    let face = |d: [i64; 3]| i32::from(near(&d));
                    let exposed = [
                        face([1, 0, 0]) - face([-1, 0, 0]),
                        face([0, 1, 0]) - face([0, -1, 0]),
                        face([0, 0, 1]) - face([0, 0, -1]),
                    ];
                    let code = morton([x, y, z].map(|c| u32::try_from(c).unwrap()));
                    skin.insert(code, (samples[at(x, y, z)], exposed));
                }
            }
        }
        Self { dims, skin }
    }

    fn depth(&self) -> u32 {
        (0..=16).find(|l| self.dims.iter().all(|n| *n <= 1 << l)).unwrap()
    }
}

/// Codes of the boxes of every depth, read from the infobytes front to back without any directory.
fn boxes_of(nodes: &[u8], depth: u32) -> Vec<Vec<u64>> {
    let mut bytes = nodes.iter();
    let mut levels = vec![vec![0_u64]];
    for level in 0..depth as usize {
        let mut below = Vec::new();
        for code in &levels[level] {
            let infobyte = *bytes.next().expect("as many infobytes as nodes");
            below.extend((0..8).filter(|i| infobyte >> i & 1 == 1).map(|i| code * 8 + i));
        }
        levels.push(below);
    }
    assert_eq!(bytes.len(), 0, "no infobytes beyond the nodes");
    levels
}

/// Compares a finished file with the truth; `name` says which case failed.
fn check(
    file: &Path,
    truth: &Truth,
    options: &BuildOptions,
    info: &infobyte::volume::VolumeInfo,
    name: &str,
) {
    let bytes = std::fs::read(file).unwrap();
    verify(&bytes[..]).unwrap_or_else(|fault| panic!("{name}: {fault:?}"));
    let model = Model::from_bytes(&bytes).unwrap();
    let depth = truth.depth();
    let nodes = model.section_bytes(SectionKind::Nodes).unwrap();
    let levels = boxes_of(nodes, depth);

    let want: Vec<u64> = truth.skin.keys().copied().collect();
    if levels[depth as usize] != want {
        let missing = want.iter().filter(|c| levels[depth as usize].binary_search(c).is_err()).count();
        let ghosts = levels[depth as usize].iter().filter(|c| want.binary_search(c).is_err()).count();
        panic!("{name}: {missing} of {} skin voxels are missing, {ghosts} are ghosts", want.len());
    }
    let mut first = 0;
    for d in 0..=depth {
        let mut boxes: Vec<u64> = want.iter().map(|c| c >> (3 * (depth - d))).collect();
        boxes.dedup();
        assert_eq!(levels[d as usize], boxes, "{name}: boxes of depth {d}");
        assert_eq!(model.levels()[d as usize], first, "{name}: first node of depth {d}");
        first += if d < depth { boxes.len() as u64 } else { 0 };
    }
    assert_eq!((model.header().nodes, model.header().voxels), (first, want.len() as u64), "{name}");

    let codes = model.section_bytes(SectionKind::Voxels(Channel::Normal)).map(|b| b.as_chunks::<2>().0);
    assert_eq!(codes.is_some(), options.channels.unwrap().contains(Channel::Normal), "{name}");
    let codes: Vec<u16> = codes.unwrap_or_default().iter().map(|c| u16::from_le_bytes(*c)).collect();
    for (code, (_, exposed)) in codes.iter().zip(truth.skin.values()) {
        let n = normal::decode(*code);
        let outward: f32 = (0..3).map(|a| n[a] * exposed[a] as f32).sum();
        // The code is at most 0.64 degrees off the direction that was chosen, which never points inwards.
        assert!(outward >= -0.02, "{name}: normal {n:?} against open faces {exposed:?}");
    }
    let stored = check_values(&model, truth, options, info, name);
    check_means(&model, &levels, &want, &codes, &stored, options.lod, name);
}

/// The value channel against the samples; returns the stored values.
fn check_values(
    model: &Model<&Vec<u8>>,
    truth: &Truth,
    options: &BuildOptions,
    info: &infobyte::volume::VolumeInfo,
    name: &str,
) -> Vec<u16> {
    let count = truth.skin.len() as u64;
    let stored: Vec<u16> = (0..count).filter_map(|v| model.value(VoxelIndex::new(v))).collect();
    assert_eq!(
        stored.len() as u64,
        if options.channels.unwrap().contains(Channel::Value) { count } else { 0 },
        "{name}"
    );
    let [scale, offset] = model.metadata().value_scale;
    let rescale = info.rescale;
    let wide = info.scalar.bytes() > 2 || matches!(info.scalar, ScalarType::F32);
    // Samples that no single holds stand at its ends.
    let held = |s: f64| if wide { s.clamp(f64::from(f32::MIN), f64::from(f32::MAX)) } else { s };
    for (value, (sample, _)) in stored.iter().zip(truth.skin.values()) {
        let physical = rescale.slope * held(*sample) + rescale.intercept;
        let got = scale * f64::from(*value) + offset;
        // Narrow types are kept exactly; wide ones to half a step, and as exactly as a single has them.
        let single = held(*sample).abs() * 2.0_f64.powi(-23) * rescale.slope.abs();
        let most = if wide { 0.501 * scale.abs() + 2.0 * single } else { physical.abs() * 1e-12 };
        assert!((got - physical).abs() <= most, "{name}: value {got} of {physical}, allowed {most}");
    }
    stored
}

/// Every mean against its definition (SPEC 4.6, 4.7), from the model's own voxels.
fn check_means(
    model: &Model<&Vec<u8>>,
    levels: &[Vec<u64>],
    voxels: &[u64],
    codes: &[u16],
    stored: &[u16],
    lod: bool,
    name: &str,
) {
    let depth = levels.len() - 1;
    let (mut normals, mut values) = (Vec::new(), Vec::new());
    for (d, boxes) in levels.iter().enumerate().take(depth.saturating_sub(1)) {
        let shift = 3 * (depth - d);
        let mut at = 0;
        for code in boxes {
            let end = at + voxels[at..].partition_point(|v| v >> shift == *code);
            if let Some(codes) = codes.get(at..end) {
                let mut sum = [0_i64; 3];
                for v in codes.iter().map(|c| normal::decode_l1(*c)) {
                    (0..3).for_each(|a| sum[a] += i64::from(v[a]));
                }
                normals.push(if sum == [0; 3] { codes[0] } else { normal::encode(sum.map(|c| c as f32)) });
            }
            if let Some(part) = stored.get(at..end) {
                let sum: u64 = part.iter().map(|v| u64::from(*v)).sum();
                let mean = (sum as f64 / part.len() as f64 + 0.5).floor();
                values.push(mean);
            }
            at = end;
        }
    }
    let section = |kind| model.section_bytes(kind).unwrap_or_default();
    let got: Vec<u16> = section(SectionKind::Means(Channel::Normal))
        .as_chunks::<2>()
        .0
        .iter()
        .map(|c| u16::from_le_bytes(*c))
        .collect();
    assert_eq!(got, if lod { normals } else { Vec::new() }, "{name}: mean normals");
    let wide = model.frame().section(SectionKind::Voxels(Channel::Value)).is_some_and(|e| e.item_bytes == 2);
    let got: Vec<f64> = section(SectionKind::Means(Channel::Value))
        .chunks_exact(if wide { 2 } else { 1 })
        .map(|c| f64::from(u16::from_le_bytes([c[0], c.get(1).copied().unwrap_or(0)])))
        .collect();
    assert_eq!(got, if lod { values } else { Vec::new() }, "{name}: mean values");
}

/// Shapes that a volume is filled with: a field of 0..1, inside from 0.5 on.
#[derive(Clone, Copy, Debug)]
enum Shape {
    Noise(f64),
    Checkerboard,
    Solid,
    Plane(usize),
    Ball,
    Waves,
}

const SHAPES: [Shape; 11] = [
    Shape::Noise(0.001),
    Shape::Noise(0.01),
    Shape::Noise(0.1),
    Shape::Noise(0.5),
    Shape::Checkerboard,
    Shape::Solid,
    Shape::Plane(0),
    Shape::Plane(1),
    Shape::Plane(2),
    Shape::Ball,
    Shape::Waves,
];

fn fill(dims: [u32; 3], shape: Shape, random: &mut Random) -> Vec<f64> {
    let size = dims.map(|n| f64::from(n).max(2.0));
    let mut field = Vec::new();
    for z in 0..dims[2] {
        for y in 0..dims[1] {
            for x in 0..dims[0] {
                let cell = [x, y, z];
                let centred = [0, 1, 2].map(|a| f64::from(cell[a]) / size[a] - 0.5);
                let mask = match shape {
                    Shape::Noise(density) => random.unit() < density,
                    Shape::Checkerboard => (x + y + z) % 2 == 0,
                    Shape::Solid => true,
                    Shape::Plane(axis) => cell[axis] == dims[axis] / 2,
                    Shape::Ball => {
                        field.push(0.85 - centred.iter().map(|c| c * c).sum::<f64>() * 2.0);
                        continue;
                    }
                    Shape::Waves => {
                        let wave = (centred[0] * 17.0).sin() + (centred[1] * 11.0).cos();
                        field.push(0.5 + 0.2 * (wave + (centred[2] * 13.0).sin()) + random.unit() * 0.02);
                        continue;
                    }
                };
                field.push(0.4 * random.unit() + if mask { 0.6 } else { 0.0 });
            }
        }
    }
    field
}

/// Lowest and highest samples that a field is spread over.
fn window(scalar: ScalarType) -> (f64, f64) {
    match scalar {
        ScalarType::U8 => (0.0, 255.0),
        ScalarType::I8 => (-128.0, 127.0),
        ScalarType::U16 => (0.0, 65535.0),
        ScalarType::I16 => (-1024.0, 3071.0),
        ScalarType::U32 => (0.0, 4_294_967_295.0),
        ScalarType::I32 => (-2e9, 2e9),
        ScalarType::F32 => (-1.0, 2.5e3),
        ScalarType::F64 => (-1e-3, 7e-3),
    }
}

fn between(window: (f64, f64), share: f64) -> f64 {
    window.0 + (window.1 - window.0) * share
}

/// Between-class variance of the split `< t` and `>= t`, of finite samples.
fn otsu_quality(samples: &[f64], t: f64) -> f64 {
    let class = |high: bool| {
        samples
            .iter()
            .filter(|s| s.is_finite() && (**s >= t) == high)
            .fold((0.0, 0.0), |(n, sum), s| (n + 1.0, sum + s))
    };
    let ((below, low), (above, high)) = (class(false), class(true));
    if below == 0.0 || above == 0.0 { 0.0 } else { below * above * (low / below - high / above).powi(2) }
}

/// Holds the threshold that was found to Otsu's definition: no split of the values is better.
fn check_otsu(physical: &[f64], lo: f64, binned: bool, name: &str) {
    let mut distinct: Vec<f64> = physical.iter().copied().filter(|v| v.is_finite()).collect();
    distinct.sort_by(f64::total_cmp);
    distinct.dedup();
    let step = distinct.len().div_ceil(500);
    let best = distinct.iter().step_by(step).map(|t| otsu_quality(physical, *t)).fold(0.0, f64::max);
    let got = otsu_quality(physical, lo);
    // Wide types are counted in 65,536 bins.
    let allowed = if binned { 1e-3 } else { 1e-9 };
    assert!(got > 0.0 && got >= best * (1.0 - allowed), "{name}: Otsu's {lo} gives {got}, best is {best}");
}

/// One random case from its seed; says whether it was built (and not refused for lack of skin).
fn case(seed: u64, dims: [u32; 3], shape: Shape) -> bool {
    let mut random = Random(seed);
    let scalar = ScalarType::ALL[usize::try_from(seed % 8).unwrap()];
    let span = window(scalar);
    let float = matches!(scalar, ScalarType::F32 | ScalarType::F64);
    let mut values: Vec<f64> = fill(dims, shape, &mut random).iter().map(|f| between(span, *f)).collect();
    if float && random.below(2) == 0 {
        for v in values.iter_mut() {
            *v = match random.below(60) {
                0 => f64::NAN,
                1 => f64::INFINITY,
                2 => f64::NEG_INFINITY,
                _ => *v,
            };
        }
    }
    let rescale = random.pick(&[
        Rescale::IDENTITY,
        Rescale { slope: 0.5, intercept: -1024.0 },
        Rescale { slope: -2.0, intercept: 10.0 },
    ]);
    let source = MemoryVolume::new(dims, scalar, &values).rescaled(rescale);
    let samples = source.samples();
    // Ends within the field, wherever the physical scale puts them.
    let ends = |a: f64, b: f64| {
        let (a, b) = (rescale.apply(between(span, a)), rescale.apply(between(span, b)));
        (a.min(b), a.max(b))
    };
    let threshold = match random.below(4) {
        0 | 1 => Threshold::Iso(rescale.apply(between(span, 0.5))),
        2 => {
            let (lo, hi) = ends(0.5, 0.9);
            Threshold::Range(lo, hi)
        }
        _ => Threshold::Otsu,
    };
    let options = BuildOptions {
        threshold,
        connectivity: random.pick(&[Connectivity::Thin26, Connectivity::Thick6]),
        channels: Some(
            [(Channel::Normal, 4), (Channel::Value, 3)]
                .into_iter()
                .filter(|(_, one_in)| random.below(*one_in) > 0)
                .map(|(channel, _)| channel)
                .collect(),
        ),
        lod: random.below(4) > 0,
        memory: MemoryCap::Process(1 << 30),
        threads: 1 + random.below(3_usize),
        ..skin_options()
    };
    let name = format!("seed {seed} {dims:?} {scalar} {shape:?} {rescale:?} {options:?}");
    let folder = tempfile::tempdir().unwrap();
    // Headerless files have no rescale; with it, the volume is read from memory.
    if rescale == Rescale::IDENTITY {
        let endian = random.pick(&[Endian::Little, Endian::Big]);
        let path = folder.path().join("v.raw");
        let bytes = if endian == Endian::Big { source.big_endian() } else { source.bytes.clone() };
        std::fs::write(&path, bytes).unwrap();
        let raw = RawOptions {
            dims: Dims::new(dims[0], dims[1], dims[2]).unwrap(),
            scalar,
            endian,
            spacing_mm: [0.7, 0.7, 2.0],
            skip: 0,
            orientation: Orientation::LPS,
        };
        let file = RawVolume::open(&[path], &raw).unwrap();
        compare(&file, &samples, &options, folder.path(), &format!("{name} {endian:?}"))
    } else {
        compare(&source, &samples, &options, folder.path(), &name)
    }
}

/// Builds a source and compares the file with the truth, or the refusal with the values there are.
fn compare(
    source: &dyn VolumeSource,
    samples: &[f64],
    options: &BuildOptions,
    folder: &Path,
    name: &str,
) -> bool {
    let info = source.info();
    let dims = info.dims.to_array();
    let output = folder.join("v.oct");
    let outcome = build(source, options, &output, &Silent);
    let finite: Vec<f64> =
        samples.iter().copied().filter(|s| s.is_finite()).map(|s| info.rescale.apply(s)).collect();
    let min = finite.iter().copied().fold(f64::INFINITY, f64::min);
    let max = finite.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let selection = match (&outcome, options.threshold) {
        (Ok(report), _) => (report.selection.lo, report.selection.hi),
        (Err(_), Threshold::Iso(lo)) => (lo, f64::INFINITY),
        (Err(_), Threshold::Range(lo, hi)) => (lo, hi),
        (Err(_), Threshold::Chosen(chosen)) => (chosen.lo, chosen.hi),
        (Err(_), Threshold::Otsu) => {
            assert!(finite.is_empty() || min == max, "{name}: Otsu refuses {min}..{max}");
            (f64::NAN, f64::NAN)
        }
    };
    let truth = Truth::new(dims, samples, info.rescale, selection, options.connectivity);
    match outcome {
        Ok(report) => {
            if options.threshold == Threshold::Otsu {
                let physical: Vec<f64> = samples.iter().map(|s| info.rescale.apply(*s)).collect();
                check_otsu(&physical, report.selection.lo, info.scalar.bytes() > 2, name);
            }
            assert_eq!(report.skin_voxels, truth.skin.len() as u64, "{name}");
            check(&output, &truth, options, info, name);
            return true;
        }
        Err(error) if error.value_range().is_some() => {
            assert!(truth.skin.is_empty(), "{name}: refused, but {} voxels are skin", truth.skin.len());
            assert_eq!(error.value_range(), Some([min, max]), "{name}");
            assert!(!output.exists(), "{name}");
        }
        Err(error) if finite.is_empty() => {
            assert!(error.to_string().contains("holds no finite value"), "{name}")
        }
        Err(e) => panic!("{name}: {e}"),
    }
    false
}

const SMALL: [[u32; 3]; 17] = [
    [1, 1, 1],
    [2, 1, 1],
    [1, 2, 1],
    [1, 1, 33],
    [129, 1, 2],
    [1, 40, 1],
    [3, 3, 3],
    [5, 300, 3],
    [3, 2, 270],
    [37, 5, 64],
    [31, 32, 33],
    [63, 1, 65],
    [64, 64, 5],
    [65, 63, 31],
    [70, 33, 34],
    [7, 4, 515],
    [33, 64, 40],
];

fn random_cases(seeds: std::ops::Range<u64>) {
    let mut built = 0;
    for seed in seeds {
        let mut random = Random(seed + 1000);
        let dims = random.pick(&SMALL);
        // Types follow the seed; shapes step through their list at another rhythm.
        let shape = SHAPES[usize::try_from(seed / 8 % 11).unwrap()];
        built += u32::from(case(seed, dims, shape));
    }
    assert!(built >= 75, "only {built} of 100 volumes have a skin");
}

#[test]
fn first_hundred_random_volumes_are_as_by_plain_loops() {
    random_cases(0..100);
}

#[test]
fn second_hundred_random_volumes_are_as_by_plain_loops() {
    random_cases(100..200);
}

#[test]
fn larger_volumes_are_as_by_plain_loops() {
    for (seed, dims, shape) in [
        (1002, [33, 64, 129], Shape::Noise(0.1)),
        (1003, [33, 64, 129], Shape::Waves),
        (1006, [100, 100, 100], Shape::Ball),
        (1005, [100, 100, 100], Shape::Plane(1)),
        (1001, [100, 100, 100], Shape::Noise(0.01)),
        (1008, [300, 40, 37], Shape::Waves),
    ] {
        assert!(case(seed, dims, shape), "{seed}");
    }
}

/// Every other voxel of rows of bricks is skin, with both channels: what a brick gathers is swapped out in
/// several fragments, which must join again in order.
#[test]
fn bricks_of_several_fragments_are_joined_in_order() {
    let dims = [129, 40, 70];
    for (scalar, shape, threads) in [
        (ScalarType::U16, Shape::Checkerboard, 1),
        (ScalarType::F64, Shape::Noise(0.5), 2),
        (ScalarType::U8, Shape::Noise(0.5), 1),
        (ScalarType::F32, Shape::Checkerboard, 3),
    ] {
        for connectivity in [Connectivity::Thin26, Connectivity::Thick6] {
            let span = window(scalar);
            let field = fill(dims, shape, &mut Random(5));
            let values: Vec<f64> = field.iter().map(|f| between(span, *f)).collect();
            let source = MemoryVolume::new(dims, scalar, &values);
            let options = BuildOptions {
                threshold: Threshold::Iso(between(span, 0.5)),
                connectivity,
                channels: Some(Channels::from([Channel::Normal, Channel::Value])),
                memory: MemoryCap::Process(1 << 30),
                threads,
                ..skin_options()
            };
            let folder = tempfile::tempdir().unwrap();
            let name = format!("{scalar} {shape:?} {connectivity:?}");
            assert!(compare(&source, &source.samples(), &options, folder.path(), &name));
        }
    }
}

/// A solid gathers nothing but its faces; the inside must stay empty at every size of the border.
#[test]
fn the_skin_of_a_solid_is_its_six_faces() {
    for dims in SMALL {
        let source = MemoryVolume::new(dims, ScalarType::I16, &fill(dims, Shape::Solid, &mut Random(1)));
        let options = BuildOptions {
            threshold: Threshold::Iso(-5.0),
            channels: Some(Channels::from([Channel::Normal, Channel::Value])),
            memory: MemoryCap::Process(1 << 30),
            threads: 2,
            ..skin_options()
        };
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("v.oct");
        let report = build(&source, &options, &output, &Silent).unwrap();
        let all: u64 = dims.iter().map(|n| u64::from(*n)).product();
        let core: u64 = dims.iter().map(|n| u64::from(n.saturating_sub(2))).product();
        assert_eq!(report.skin_voxels, all - core, "{dims:?}");
        let name = format!("solid {dims:?}");
        assert!(compare(&source, &source.samples(), &options, folder.path(), &name));
    }
}

/// Normals are functions of the neighbourhood alone: a thing may stand anywhere in the grid, within a
/// brick, across bricks or words, and keeps its normals.
#[test]
fn normals_do_not_depend_on_where_in_the_grid_a_thing_stands() {
    let side = 14;
    for scalar in ScalarType::ALL {
        let span = window(scalar);
        let thing = fill([side; 3], Shape::Waves, &mut Random(9));
        let mut first: Option<(Vec<[u32; 3]>, Vec<u16>)> = None;
        for offset in [[3, 3, 3], [26, 3, 25], [57, 20, 3], [29, 30, 31], [60, 4, 24], [20, 25, 8]] {
            let dims = [80, 48, 50];
            let mut values = vec![between(span, 0.1); 80 * 48 * 50];
            for (i, f) in thing.iter().enumerate() {
                let s = side as usize;
                let [x, y, z] = [i % s, i / s % s, i / s / s];
                let at = [x + offset[0], y + offset[1], z + offset[2]];
                values[(at[2] * 48 + at[1]) * 80 + at[0]] = between(span, *f);
            }
            let source = MemoryVolume::new(dims, scalar, &values);
            let options = BuildOptions {
                threshold: Threshold::Iso(between(span, 0.5)),
                lod: false,
                memory: MemoryCap::Process(1 << 30),
                threads: 2,
                ..skin_options()
            };
            let folder = tempfile::tempdir().unwrap();
            let output = folder.path().join("v.oct");
            build(&source, &options, &output, &Silent).unwrap();
            let bytes = std::fs::read(&output).unwrap();
            let model = Model::from_bytes(&bytes).unwrap();
            let levels = boxes_of(model.section_bytes(SectionKind::Nodes).unwrap(), 7);
            let mut voxels: Vec<([u32; 3], u16)> = levels[7]
                .iter()
                .map(|code| infobyte::geom::morton::decode(*code))
                .map(|cell| std::array::from_fn(|a| cell[a] - u32::try_from(offset[a]).unwrap()))
                .zip(model.section_bytes(SectionKind::Voxels(Channel::Normal)).unwrap().as_chunks::<2>().0)
                .map(|(cell, code)| (cell, u16::from_le_bytes(*code)))
                .collect();
            voxels.sort_unstable();
            let found = voxels.into_iter().unzip();
            match &first {
                None => first = Some(found),
                Some(first) => assert!(*first == found, "{scalar} at {offset:?} differs from [3, 3, 3]"),
            }
        }
    }
}

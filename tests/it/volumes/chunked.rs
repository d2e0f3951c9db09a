//! Zarr arrays and OME-Zarr images: however chunks are stored, the model is that of the samples in one file; levels,
//! times and channels are chosen, and damage is named with its chunk.

use super::foreign::sections;
use crate::common::compress::blosc;
use crate::prelude::*;
use serde_json::{Value, json};

/// Sides of the volume, x first; no multiple of those of a chunk, z first.
const DIMS: [u32; 3] = [37, 29, 23];
const CHUNK: [usize; 3] = [8, 16, 16];

/// Samples of a chunk of these sides at this place, x fastest; zero outside.
fn chunk(object: &Object, sides: [usize; 3], at: [usize; 3]) -> Vec<u8> {
    let size = object.scalar.bytes();
    let [nx, ny, nz] = object.dims.map(|side| side as usize);
    let mut bytes = Vec::new();
    let [zs, ys, xs] = std::array::from_fn(|axis| at[axis] * sides[axis]..(at[axis] + 1) * sides[axis]);
    for z in zs {
        for y in ys.clone() {
            for x in xs.clone() {
                let from = ((z * ny + y) * nx + x) * size;
                let is_inside = z < nz && y < ny && x < nx;
                bytes.extend_from_slice(if is_inside {
                    &object.bytes[from..from + size]
                } else {
                    &[0; 8][..size]
                });
            }
        }
    }
    bytes
}

/// Places of all chunks of these sides, and their samples.
fn chunks(object: &Object, sides: [usize; 3]) -> Vec<([usize; 3], Vec<u8>)> {
    let counts: [usize; 3] =
        std::array::from_fn(|axis| (object.dims[2 - axis] as usize).div_ceil(sides[axis]));
    let mut all = Vec::new();
    for z in 0..counts[0] {
        for y in 0..counts[1] {
            (0..counts[2]).for_each(|x| all.push(([z, y, x], chunk(object, sides, [z, y, x]))));
        }
    }
    all
}

/// A file in a folder that is made for it.
fn put_in(at: &Path, name: &str, bytes: &[u8]) {
    let path = at.join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, bytes).unwrap();
}

fn shape() -> [u32; 3] {
    [DIMS[2], DIMS[1], DIMS[0]]
}

/// Metadata of an array of version 2.
fn version_2(object: &Object, compressor: &Value) -> Value {
    let dtype = match object.scalar {
        ScalarType::U8 => "|u1",
        ScalarType::F32 => "<f4",
        _ => "<u2",
    };
    json!({"zarr_format": 2, "shape": shape(), "chunks": CHUNK, "dtype": dtype, "compressor": compressor,
           "fill_value": 0, "order": "C", "filters": null})
}

/// Metadata of an array of version 3.
fn version_3(object: &Object, chunk: [usize; 3], codecs: &Value) -> Value {
    let kind = match object.scalar {
        ScalarType::U8 => "uint8",
        ScalarType::F32 => "float32",
        _ => "uint16",
    };
    json!({"zarr_format": 3, "node_type": "array", "shape": shape(), "data_type": kind, "fill_value": 0,
           "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": chunk}},
           "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}}, "codecs": codecs})
}

/// An array of version 2, packed by `pack`.
fn put_2(at: &Path, object: &Object, compressor: &Value, pack: &dyn Fn(&[u8]) -> Vec<u8>) {
    put_in(at, ".zarray", version_2(object, compressor).to_string().as_bytes());
    for ([z, y, x], bytes) in chunks(object, CHUNK) {
        put_in(at, &format!("{z}.{y}.{x}"), &pack(&bytes));
    }
}

fn checked(bytes: Vec<u8>) -> Vec<u8> {
    let sum = crc32c::crc32c(&bytes).to_le_bytes();
    [bytes, sum.to_vec()].concat()
}

/// An array of version 3 in shards of 2x2x2 chunks, each packed by zstd with a checksum.
fn put_shards(at: &Path, object: &Object) {
    let inner = json!([{"name": "bytes", "configuration": {"endian": "little"}},
        {"name": "zstd", "configuration": {"level": 3}}, {"name": "crc32c"}]);
    let index = json!([{"name": "bytes", "configuration": {"endian": "little"}}, {"name": "crc32c"}]);
    let sharding = json!([{"name": "sharding_indexed", "configuration":
        {"chunk_shape": CHUNK, "codecs": inner, "index_codecs": index, "index_location": "end"}}]);
    put_in(at, "zarr.json", version_3(object, CHUNK.map(|side| 2 * side), &sharding).to_string().as_bytes());
    let mut shards = std::collections::BTreeMap::new();
    for (place, bytes) in chunks(object, CHUNK) {
        let (shard, within) = (place.map(|at| at / 2), place.map(|at| at % 2));
        let (body, entries): &mut (Vec<u8>, [[u64; 2]; 8]) =
            shards.entry(shard).or_insert((Vec::new(), [[u64::MAX; 2]; 8]));
        let packed = checked(zstd::bulk::compress(&bytes, 3).unwrap());
        entries[within[0] * 4 + within[1] * 2 + within[2]] = [body.len() as u64, packed.len() as u64];
        body.extend(packed);
    }
    for ([z, y, x], (body, entries)) in shards {
        let index = entries.as_flattened().iter().flat_map(|n| n.to_le_bytes()).collect();
        put_in(at, &format!("c/{z}/{y}/{x}"), &[body, checked(index)].concat());
    }
}

/// The model of the samples in one file.
fn wanted(at: &Path, object: &Object, extra: &[&str]) -> Vec<Vec<u8>> {
    let raw = file(at, "a.raw", &object.bytes);
    let (dims, kind) = (DIMS.map(|side| side.to_string()).join("x"), object.scalar.to_string());
    let layout = ["--dims", &dims, "--dtype", &kind, "--spacing", "1x1x1"];
    built(at, &raw, &[&layout[..], extra].concat())
}

fn built(at: &Path, input: &Path, extra: &[&str]) -> Vec<Vec<u8>> {
    let model = at.join("m.oct");
    let run = command::build(&[&input], &model, &[&["--channels", "normal,value"], extra].concat());
    assert_eq!(run.code, 0, "{}: {run:?}", input.display());
    sections(&model)
}

#[test]
fn chunks_make_the_model_of_their_samples_however_they_are_stored() {
    for (scalar, iso) in [(ScalarType::U8, "128"), (ScalarType::U16, "1000"), (ScalarType::F32, "1000")] {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        let object = Object::new(DIMS, scalar, [1.0; 3]);
        let size = scalar.bytes();
        let model = wanted(at, &object, &["--iso", iso]);
        let blosc_of = |bits, split| move |plain: &[u8]| blosc(plain, size, bits, split);
        let lz4 = |plain: &[u8]| {
            [&u32::try_from(plain.len()).unwrap().to_le_bytes()[..], &lz4_flex::block::compress(plain)]
                .concat()
        };
        let zstd = |plain: &[u8]| zstd::bulk::compress(plain, 3).unwrap();
        type Pack<'a> = &'a dyn Fn(&[u8]) -> Vec<u8>;
        let ways: [(&str, Value, Pack<'_>); 8] = [
            ("plain", Value::Null, &<[u8]>::to_vec),
            ("gzip", json!({"id": "gzip"}), &gzip),
            ("zlib", json!({"id": "zlib"}), &zlib),
            ("zstd", json!({"id": "zstd"}), &zstd),
            ("lz4", json!({"id": "lz4"}), &lz4),
            ("bytes", json!({"id": "blosc"}), &blosc_of(false, true)),
            ("whole", json!({"id": "blosc"}), &blosc_of(false, false)),
            ("bits", json!({"id": "blosc"}), &blosc_of(true, false)),
        ];
        for (name, compressor, pack) in ways {
            put_2(&at.join(name), &object, &compressor, pack);
            for threads in ["1", "3"] {
                let got = built(at, &at.join(name), &["--iso", iso, "--threads", threads]);
                assert!(got == model, "{scalar} {name} {threads}");
            }
        }
        put_shards(&at.join("shards"), &object);
        assert!(built(at, &at.join("shards"), &["--iso", iso]) == model, "{scalar} shards");
        // Version 3 with the names of version 2, in folders, which it does not state.
        let bytes = json!([{"name": "bytes", "configuration": {"endian": "little"}}]);
        let mut named = version_3(&object, CHUNK, &bytes);
        named["chunk_key_encoding"] = json!({"name": "v2"});
        for (name, separator) in [("folders", "/"), ("points", ".")] {
            put_in(&at.join(name), "zarr.json", named.to_string().as_bytes());
            for (place, bytes) in chunks(&object, CHUNK) {
                put_in(&at.join(name), &place.map(|at| at.to_string()).join(separator), &bytes);
            }
            assert!(built(at, &at.join(name), &["--iso", iso]) == model, "{scalar} {name}");
        }
        // What was never written has the value that the metadata states.
        fs::remove_file(at.join("zstd/1.0.1")).unwrap();
        let mut holed = Object::new(DIMS, scalar, [1.0; 3]);
        let [nx, ny] = [DIMS[0] as usize, DIMS[1] as usize];
        for (z, y) in (8..16).flat_map(|z| (0..16).map(move |y| (z, y))) {
            let row = ((z * ny + y) * nx + 16) * size;
            holed.bytes[row..row + 16 * size].fill(0);
        }
        assert!(built(at, &at.join("zstd"), &["--iso", iso]) == wanted(at, &holed, &["--iso", iso]));
    }
}

#[test]
fn chunks_are_unpacked_in_slabs_which_take_the_places_of_one_another() {
    let some = ["--iso", "1000", "--threads", "3"];
    let (one, half, filled) = (["--threads", "1"], ["--downsample", "2"], ["--fill-cavities"]);
    // Slices of 17 blocks and a bit, and of 18; and more chunks than have a place at a time: what is asked for decides the
    // order in which slices are read, and chunks where they are unpacked.
    type Case<'a> = ([u32; 3], [usize; 3], &'a [&'a [&'a str]]);
    let cases: [Case<'_>; 3] = [
        ([100, 99, 150], [70, 91, 95], &[&some, &one, &half, &filled]),
        ([100, 99, 150], [72, 96, 96], &[&some]),
        ([40, 300, 150], [4, 4, 40], &[&some, &filled]),
    ];
    for (dims, sides, ways) in cases {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        let object = Object::new(dims, ScalarType::U16, [1.0; 3]);
        let raw = file(at, "a.raw", &object.bytes);
        let size = dims.map(|side| side.to_string()).join("x");
        let layout = ["--dims", &size, "--dtype", "u16", "--spacing", "1x1x1"];
        let zarr = at.join("zarr");
        let [x, y, z] = dims;
        let what = json!({"zarr_format": 2, "shape": [z, y, x], "chunks": sides, "dtype": "<u2",
            "compressor": {"id": "blosc"}, "fill_value": 0, "order": "C", "filters": null});
        put_in(&zarr, ".zarray", what.to_string().as_bytes());
        for ([z, y, x], bytes) in chunks(&object, sides) {
            put_in(&zarr, &format!("{z}.{y}.{x}"), &blosc(&bytes, 2, false, true));
        }
        for &extra in ways {
            let wanted = built(at, &raw, &[&layout[..], extra].concat());
            assert!(built(at, &zarr, extra) == wanted, "{sides:?} {extra:?}");
        }
    }
}

#[test]
fn times_and_channels_are_chosen_by_the_names_of_their_axes() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let objects: Vec<Object> = (0..6)
        .map(|number: u16| {
            let mut object = Object::new(DIMS, ScalarType::U16, [1.0; 3]);
            let moved =
                |sample: &[u8]| (u16::from_le_bytes([sample[0], sample[1]]) + 40 * number).to_le_bytes();
            object.bytes = object.bytes.chunks(2).flat_map(moved).collect();
            object
        })
        .collect();
    // Two times, in chunks of three channels.
    let (image, array) = (at.join("image"), at.join("image/0"));
    let axes = ["t", "c", "z", "y", "x"].map(|name| json!({"name": name}));
    let level =
        json!({"path": "0", "coordinateTransformations": [{"type": "scale", "scale": [1, 1, 1, 1, 1]}]});
    let what = json!({"multiscales": [{"axes": axes, "datasets": [level]}]});
    put_in(&image, ".zattrs", what.to_string().as_bytes());
    let (whole, part) = ([&[2, 3], &shape()[..]].concat(), [&[1, 3], &CHUNK[..]].concat());
    let what = json!({"zarr_format": 2, "shape": whole, "chunks": part, "dtype": "<u2",
        "compressor": {"id": "blosc"}, "fill_value": 0, "order": "C", "filters": null});
    put_in(&array, ".zarray", what.to_string().as_bytes());
    for (time, channels) in objects.chunks(3).enumerate() {
        let all: Vec<_> = channels.iter().map(|object| chunks(object, CHUNK)).collect();
        for (number, ([z, y, x], _)) in all[0].iter().enumerate() {
            let bytes: Vec<u8> = all.iter().flat_map(|chunks| chunks[number].1.clone()).collect();
            put_in(&array, &format!("{time}.0.{z}.{y}.{x}"), &blosc(&bytes, 2, false, true));
        }
    }
    for (number, object) in objects.iter().enumerate() {
        let model = wanted(at, object, &["--iso", "1000"]);
        let (index, volume) = (format!("c={},t={}", number % 3, number / 3), (number + 1).to_string());
        for extra in [["--index", &index], ["--volume", &volume]] {
            assert!(built(at, &image, &[&extra[..], &["--iso", "1000"]].concat()) == model, "{extra:?}");
        }
        let level = ["--index", &format!("t={},c={}", number / 3, number % 3), "--iso", "1000"];
        assert!(built(at, &array, &level) == model, "{level:?}");
    }
    // The parts of a plan are those of the same volume.
    let job = at.join("job");
    let words =
        ["--index", "t=1,c=0", "--iso", "1000", "--channels", "normal,value", "--parts", "2", "--out"];
    let planned = oct(&[&["plan", image.to_str().unwrap()], &words[..], &[job.to_str().unwrap()]].concat());
    assert_eq!(planned.code, 0, "{planned:?}");
    let plan = job.join("plan.json");
    for number in ["0", "1"] {
        assert_eq!(oct(&["part", plan.to_str().unwrap(), number]).code, 0);
    }
    let merged = at.join("merged.oct");
    assert_eq!(oct(&["merge", plan.to_str().unwrap(), "-o", merged.to_str().unwrap()]).code, 0);
    assert!(sections(&merged) == wanted(at, &objects[3], &["--iso", "1000"]));

    let refused = |input: &Path, index: &str, words: &[&str]| {
        command::build(&[&input], &at.join("m.oct"), &["--index", index]).refused(2, words);
    };
    for index in ["t=1", "t=1,c=3", "t=1,c=0,q=0", "t=1,c=0,c=1"] {
        refused(&image, index, &["--index", "t (of 2), c (of 3)"]);
    }
    refused(&image, "t", &["'t' is not a place", "t=12,c=0"]);
    let one = at.join("one");
    put_2(&one, &objects[0], &Value::Null, &<[u8]>::to_vec);
    refused(&one, "t=0", &["has no axes before z"]);
    put_in(at, "v.nrrd", b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 1 1 2\nencoding: raw\n\n\x00\x01");
    refused(&at.join("v.nrrd"), "t=0", &["has no axes before z"]);
    command::build(&[&image], &at.join("m.oct"), &["--index", "t=0,c=0", "--volume", "1"])
        .refused(2, &["--volume"]);
}

#[test]
fn an_image_gives_its_finest_level_and_each_other_by_its_folder_in_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let object = Object::new(DIMS, ScalarType::U16, [1.0; 3]);
    let axes = ["z", "y", "x"].map(|name| json!({"name": name, "type": "space", "unit": "micrometer"}));
    let level = |path: &str, scale: f64| {
        json!({"path": path, "coordinateTransformations": [{"type": "scale", "scale": [4.0 * scale, 2.0 * scale, scale]},
            {"type": "translation", "translation": [30, 20, 10]}]})
    };
    let image = json!([{"axes": axes, "datasets": [level("0", 1.0), level("1", 2.0)],
        "coordinateTransformations": [{"type": "scale", "scale": [1, 1, 1]}]}]);
    let old = json!({"multiscales": image});
    let new = json!({"zarr_format": 3, "node_type": "group", "attributes": {"ome": {"version": "0.5", "multiscales": image}}});
    for (name, head, what) in [("old.zarr", ".zattrs", old), ("new.zarr", "zarr.json", new)] {
        let zarr = at.join(name);
        put_in(&zarr, head, what.to_string().as_bytes());
        put_2(&zarr.join("0"), &object, &Value::Null, &<[u8]>::to_vec);
        put_shards(&zarr.join("1"), &object);
        for (input, scale) in [(zarr.clone(), 1e-3), (zarr.join("0"), 1e-3), (zarr.join("1"), 2e-3)] {
            built(at, &input, &["--iso", "1000"]);
            let model = Model::open(at.join("m.oct")).unwrap();
            let affine = model.metadata().affine;
            for axis in 0..3 {
                let step = scale * [1.0, 2.0, 4.0][axis];
                let place = [0.01, 0.02, 0.03][axis];
                assert!((affine[axis][axis] - step).abs() < 1e-12, "{name} {axis}: {affine:?}");
                assert!((affine[axis][3] - place).abs() < 1e-12, "{name} {axis}: {affine:?}");
            }
        }
        // A folder of images holds one volume for each.
        let listed = oct(&["scan", at.to_str().unwrap(), "--json"]).json();
        let found = listed["items"].as_array().unwrap().iter();
        let own = found.filter(|row| row["input"].as_str().unwrap().contains(name)).count();
        assert_eq!(own, 1, "{listed}");
    }
}

#[test]
fn damaged_arrays_are_refused_with_the_file_and_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let object = Object::new(DIMS, ScalarType::U16, [1.0; 3]);
    let refused = |input: &Path, words: &[&str]| {
        command::build(&[&input], &at.join("m.oct"), &["--iso", "1000"]).refused(3, words);
        assert!(!at.join("m.oct").exists());
    };
    let zstd = |plain: &[u8]| zstd::bulk::compress(plain, 3).unwrap();
    put_2(&at.join("a"), &object, &json!({"id": "zstd"}), &zstd);
    let chunk = at.join("a/1.1.1");
    let whole = fs::read(&chunk).unwrap();
    fs::write(&chunk, &whole[..whole.len() / 2]).unwrap();
    refused(&at.join("a"), &["1.1.1", "copy it again"]);
    fs::write(&chunk, [&whole[..], &[0; 9]].concat()).unwrap();
    refused(&at.join("a"), &["1.1.1", "damaged"]);
    fs::write(&chunk, zstd(&[0; 100])).unwrap();
    refused(&at.join("a"), &["1.1.1", "cut short"]);
    // A frame that states the greatest length.
    fs::write(&chunk, [&[0x28, 0xb5, 0x2f, 0xfd, 0xe0][..], &[0xff; 16]].concat()).unwrap();
    refused(&at.join("a"), &["1.1.1", "damaged (its length)"]);
    // A checksum behind each chunk, and behind the index of a shard.
    put_shards(&at.join("s"), &object);
    let shard = at.join("s/c/0/0/0");
    let whole = fs::read(&shard).unwrap();
    for place in [20, whole.len() - 10, whole.len() - 140] {
        let mut changed = whole.clone();
        changed[place] ^= 4;
        fs::write(&shard, changed).unwrap();
        refused(&at.join("s"), &["c/0/0/0", "damaged"]);
    }
    fs::write(&shard, &whole[..60]).unwrap();
    refused(&at.join("s"), &["c/0/0/0", "cut short"]);
    let head = fs::read_to_string(at.join("s/zarr.json")).unwrap();
    let vast = head.replace("[16,32,32]", "[17179869184,34359738368,34359738368]");
    assert!(vast != head);
    fs::write(at.join("s/zarr.json"), vast).unwrap();
    refused(&at.join("s"), &["zarr.json", "thousands of millions of chunks"]);
    // Metadata that promises too much, or says something else.
    let good = version_2(&object, &Value::Null);
    for (key, value, words) in [
        ("shape", json!([70_000, 4, 4]), ["a side of 0 voxels", "more than"]),
        ("shape", json!([0, 4, 4]), ["`shape`", "damaged"]),
        ("shape", json!("none"), ["`shape`", "damaged"]),
        ("chunks", json!([1, 1]), ["`chunks`", "damaged"]),
        ("chunks", json!([1 << 20, 1 << 20, 1 << 20]), ["a terabyte", "in Python"]),
        ("dtype", json!("<c8"), ["`<c8`", "in Python"]),
        ("dtype", json!([["a", "<u2"]]), ["records", "in Python"]),
        ("order", json!("F"), ["Fortran", "in Python"]),
        ("compressor", json!({"id": "bz2"}), ["`bz2`", "in Python"]),
        ("filters", json!([{"id": "delta"}]), ["`delta`", "in Python"]),
        ("zarr_format", json!(4), ["`zarr_format`", "damaged"]),
        ("order", json!(7), ["`order`", "damaged"]),
        ("dtype", json!("?u2"), ["`dtype`", "damaged"]),
        ("filters", json!({"id": "delta"}), ["the filter", "in Python"]),
        ("dimension_separator", json!(1), ["`dimension_separator`", "damaged"]),
    ] {
        let mut bad = good.clone();
        bad[key] = value;
        put_in(&at.join("m"), ".zarray", bad.to_string().as_bytes());
        refused(&at.join("m"), &words);
    }
    // What states places and is not what belongs there is not taken for missing.
    let image = |unit: Value, by: Value| {
        let axes = ["z", "y", "x"].map(|name| json!({"name": name, "unit": unit}));
        json!({"multiscales": [{"axes": axes, "datasets": [{"path": "0", "coordinateTransformations": by}]}]})
    };
    put_in(&at.join("i/0"), ".zarray", good.to_string().as_bytes());
    for (attributes, words) in [
        (image(json!(5), json!([])).to_string(), "`axes`"),
        (image(json!("micrometer"), json!({"type": "scale"})).to_string(), "`coordinateTransformations`"),
        ("{ \"multiscales\": ".to_owned(), "cannot be parsed as JSON"),
    ] {
        put_in(&at.join("i"), ".zattrs", attributes.as_bytes());
        refused(&at.join("i/0"), &[".zattrs", words]);
    }
    let codecs = json!([{"name": "bytes", "configuration": {"endian": "middle"}}]);
    let text = version_3(&object, [4; 3], &codecs).to_string();
    put_in(&at.join("v"), "zarr.json", text.as_bytes());
    refused(&at.join("v"), &["`endian`", "damaged"]);
    let mut many = good;
    (many["shape"], many["chunks"]) = (json!([60_000, 60_000, 60_000]), json!([1, 1, 1]));
    put_in(&at.join("m"), ".zarray", many.to_string().as_bytes());
    refused(&at.join("m"), &["of chunks", "in Python"]);
    put_in(&at.join("m"), ".zarray", b"{ \"zarr_format\": 2, ");
    refused(&at.join("m"), &[".zarray", "JSON"]);
}

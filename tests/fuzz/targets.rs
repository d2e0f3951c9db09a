//! What is done with any bytes: opened, read, built, rendered, packed, by each reader of the program.
//!
//! Bytes are taken for the content of a file, but for those of a codec, which are taken for the pixels of a DICOM
//! image of fitting size; and models get right checksums first, as a fuzzer does not guess them.

use std::error::Error as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use infobyte::budget::{Budget, MemoryCap};
use infobyte::builder::{BuildOptions, LabelChoice, Silent, Threshold, build_volume};
use infobyte::csg::{CsgInput, CsgOptions, read_tree};
use infobyte::discovery::Catalogue;
use infobyte::export::ExportForm;
use infobyte::format::{
    Channel, Channels, ENTRY_BYTES, FormatError, HEADER_BYTES, MAX_SECTIONS, SectionEntry, SectionKind,
    align_up,
};
use infobyte::geom::{Dims, VoxelIndex};
use infobyte::jobs::export::{ExportRequest, export};
use infobyte::jobs::names::read_label_names;
use infobyte::jobs::parts::{Plan, merge};
use infobyte::jobs::picture::{Outputs, render_file};
use infobyte::jobs::scene::read_scene;
use infobyte::jobs::{measure, pack, render};
use infobyte::load::{Frame, Model, NodeView, verify};
use infobyte::mesh::{GridChoice, MeshFacts, MeshOptions, UpAxis};
use infobyte::render::reference::BitVolume;
use infobyte::render::selfcheck::mismatches;
use infobyte::source::OpenOptions;
use infobyte::volume::{VolumeSource, Voxels, Workspace};
use infobyte::{NamedView, Projection, RayCaster, RenderRequest, Samples, ViewPoint};
use sha2::{Digest, Sha256};

use crate::common::frames::{Spec, encapsulated};
use crate::common::models::{build_csg, build_mesh, skin_options};
use crate::second::{self, Second};

/// Most memory that a case may take: what reading and building are allowed, twice, and the case itself.
pub(crate) const MAX_BYTES: usize = 40 << 20;

/// What unrolling a volume, and building from it, may hold.
const ALLOWED: u64 = 8 << 20;

/// Volumes of more voxels are read in part, and not built.
const MAX_BUILT: u64 = 512;

/// Volumes of a file that are looked at.
const MAX_VOLUMES: usize = 3;

/// Most pixels of a frame of a codec; a frame that says more is a wrong one.
const MAX_PIXELS: u64 = 1 << 16;

/// One way into the program.
#[derive(Clone, Copy)]
pub(crate) struct Target {
    pub(crate) name: &'static str,
    run: fn(&[u8]) -> bool,
}

impl Target {
    /// Takes bytes; true if they were accepted, false if they were refused.
    pub(crate) fn run(&self, bytes: &[u8]) -> bool {
        (self.run)(bytes)
    }
}

macro_rules! targets {
    ($($name:ident: $run:expr),* $(,)?) => { [$(Target { name: stringify!($name), run: $run }),*] };
}

pub(crate) const TARGETS: [Target; 33] = targets! {
    oct: |bytes| model(bytes),
    packed: |bytes| archive(bytes),
    dicom: |bytes| volume("case.dcm", bytes, MAX_BUILT),
    jpeg: |bytes| codec(bytes, &["4.50", "4.51", "4.57", "4.70"], jpeg_frame),
    jpeg_passes: |bytes| codec(bytes, &["4.53", "4.55"], jpeg_frame),
    jpegls: |bytes| codec(bytes, &["4.80", "4.81"], jpeg_frame),
    jpeg2000: |bytes| codec(bytes, &["4.90", "4.91", "4.201"], jpeg2000_frame),
    rle: |bytes| codec(bytes, &["5"], rle_frame),
    nrrd: |bytes| volume("case.nrrd", bytes, MAX_BUILT),
    nifti: |bytes| volume("case.nii", bytes, MAX_BUILT),
    tiff: |bytes| volume("case.tif", bytes, MAX_BUILT),
    png: |bytes| volume("case.png", bytes, MAX_BUILT),
    npy: |bytes| volume("case.npy", bytes, MAX_BUILT),
    metaimage: |bytes| volume("case.mha", bytes, MAX_BUILT),
    mrc: |bytes| volume("case.mrc", bytes, MAX_BUILT),
    vgi: |bytes| {
        put("case.vol", &[40; 512]);
        volume("case.vgi", bytes, MAX_BUILT)
    },
    vtk: |bytes| volume("case.vtk", bytes, MAX_BUILT),
    amira: |bytes| volume("case.am", bytes, MAX_BUILT),
    stl: |bytes| text_mesh("case.stl", bytes, second::stl),
    ply: |bytes| text_mesh("case.ply", bytes, second::ply),
    obj: |bytes| text_mesh("case.obj", bytes, second::obj),
    off: |bytes| text_mesh("case.off", bytes, second::off),
    csg: |bytes| solids(bytes),
    glb: |bytes| mesh("case.glb", bytes),
    gltf: |bytes| mesh("case.gltf", bytes),
    threemf: |bytes| mesh("case.3mf", bytes),
    scene: |bytes| scene(bytes),
    zarr: |bytes| zarr(bytes),
    part: |bytes| part(bytes),
    labels: |bytes| labels(bytes),
    names: |bytes| names(bytes),
    mtl: |bytes| looks(bytes, b"no picture"),
    texture: |bytes| looks(b"newmtl m\nmap_Kd case.img\n", bytes),
};

/// A folder in memory, if the system has one.
pub(crate) fn folder() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let shared = Path::new("/dev/shm");
        let parent = if shared.is_dir() { shared.to_path_buf() } else { std::env::temp_dir() };
        let folder = parent.join(format!("infobyte-fuzz-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        folder
    })
}

fn put(name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder().join(name);
    fs::write(&path, bytes).unwrap();
    path
}

fn options() -> BuildOptions {
    let threshold = Threshold::Iso(40.0);
    BuildOptions { threshold, memory: MemoryCap::Share(ALLOWED), threads: 1, ..skin_options() }
}

/// Finds, opens, unrolls and reads the volumes of a file, and builds those of up to `built` voxels.
fn volume(name: &str, bytes: &[u8], built: u64) -> bool {
    volumes_at(put(name, bytes), built)
}

fn volumes_at(path: PathBuf, built: u64) -> bool {
    let catalogue = match Catalogue::survey(&[path], &OpenOptions::default(), folder()) {
        Ok(catalogue) => catalogue,
        Err(refused) => return told(&refused.to_string()),
    };
    let mut any = false;
    for finding in
        (0..catalogue.len().min(MAX_VOLUMES)).flat_map(|index| catalogue.open(index)).take(MAX_VOLUMES)
    {
        match finding.subject {
            Ok(subject) => any |= subject.into_volume().is_some_and(|source| read(source, built)),
            Err(refused) => any |= told(&refused.to_string()),
        }
    }
    any
}

/// A chunked array of version 2 or 3, or an image of one level. The first byte chooses, two more are the length of the
/// metadata, and what follows that is a chunk.
fn zarr(bytes: &[u8]) -> bool {
    let Some(([kind, low, high], rest)) = bytes.split_first_chunk::<3>() else { return false };
    let (metadata, chunk) = rest.split_at(rest.len().min(u16::from_le_bytes([*low, *high]).into()));
    let array = folder().join("case.zarr");
    let _ = fs::remove_dir_all(&array);
    let write = |name: &str, bytes: &[u8]| {
        let path = array.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    };
    let level = ZARR_LEVELS[usize::from(kind & 1)].as_bytes();
    match kind & 3 {
        0 => write(".zarray", metadata),
        1 => write("zarr.json", metadata),
        2 => {
            write(".zgroup", b"{\"zarr_format\":2}");
            write(".zattrs", metadata);
            write("0/.zarray", level);
        }
        _ => {
            write("zarr.json", metadata);
            write("0/zarr.json", level);
        }
    }
    let within = if kind & 2 == 0 { "" } else { "0/" };
    for name in if kind & 1 == 0 { ["0.0.0", "1.0.0", "0.1.0"] } else { ["c/0/0/0", "c/1/0/0", "c/0/1/0"] } {
        write(&format!("{within}{name}"), chunk);
    }
    volumes_at(array, MAX_BUILT)
}

/// The level of an image of each version: 2 x 3 x 4 bytes.
const ZARR_LEVELS: [&str; 2] = [
    r#"{"zarr_format":2,"shape":[2,3,4],"chunks":[2,3,4],"dtype":"|u1","compressor":null,"fill_value":0,"order":"C","filters":null}"#,
    r#"{"zarr_format":3,"node_type":"array","shape":[2,3,4],"data_type":"uint8","fill_value":0,"chunk_grid":{"name":"regular","configuration":{"chunk_shape":[2,3,4]}},"chunk_key_encoding":{"name":"default"},"codecs":[{"name":"bytes"}]}"#,
];

/// The first part of a plan that says of itself what the part does; the checksums are made right before.
fn part(bytes: &[u8]) -> bool {
    let mut bytes = bytes.to_vec();
    seal_part(&mut bytes);
    let Some(head) = bytes.get(12..64) else { return false };
    let digest: String = head[..32].iter().map(|byte| format!("{byte:02x}")).collect();
    let word = |at: usize| u32::from_le_bytes(std::array::from_fn(|i| head[at + i]));
    let (parts, dims) = (word(36), [word(40), word(44), word(48)]);
    let [x, y, z] = dims;
    let text = |checksum: &str| {
        format!(
            r#"{{"program":"p","digest":"{digest}","dims":[{x},{y},{z}],"parts":{parts},"folder":"/","command":[],"checksum":"{checksum}"}}"#
        )
    };
    let text = text(&format!("{:x}", Sha256::digest(text(""))));
    let plan = match Plan::read(&put("plan.json", text.as_bytes())) {
        Ok(plan) => plan,
        Err(refused) => return told(&refused.to_string()),
    };
    let path = plan.part_path(0).unwrap();
    fs::write(&path, &bytes).unwrap();
    let merged = merge(&plan, &folder().join("merged.oct"), &Silent);
    fs::remove_file(path).unwrap();
    match merged {
        Ok(_) => true,
        Err(refused) => told(&refused.to_string()),
    }
}

/// Gives a part the checksums and lengths that its contents ask for, as far as it has a tail.
fn seal_part(bytes: &mut [u8]) {
    let number = |bytes: &[u8], at: usize| {
        let at = bytes.get(at..at + 8).and_then(|b| b.try_into().ok()).map(u64::from_le_bytes);
        at.and_then(|at| usize::try_from(at).ok())
    };
    let Some(tail) = bytes.len().checked_sub(24).filter(|tail| *tail >= 64) else { return };
    let head = u32::from_le_bytes([bytes[8], bytes[9], bytes[10], bytes[11]]) as usize;
    if (64..tail).contains(&head) {
        let crc = crc32c::crc32c(&bytes[..head - 4]).to_le_bytes();
        bytes[head - 4..head].copy_from_slice(&crc);
    }
    let Some(footer) = number(bytes, tail).filter(|footer| *footer <= tail) else { return };
    let entries: Vec<usize> = (footer..tail).step_by(56).filter(|at| at + 56 <= tail).collect();
    for (entry, next) in entries.iter().zip(entries.iter().skip(1).map(Some).chain([None])) {
        let begin = number(bytes, entry + 8);
        let end = next.map_or(Some(footer), |next| number(bytes, next + 8));
        if let (Some(begin), Some(end)) = (begin, end)
            && let Some(record) = bytes.get(begin..end)
        {
            let crc = crc32c::crc32c(record).to_le_bytes();
            bytes[entry + 16..entry + 20].copy_from_slice(&crc);
        }
    }
    let crc = crc32c::crc32c(&bytes[footer..tail]).to_le_bytes();
    bytes[tail + 16..tail + 20].copy_from_slice(&crc);
    bytes[tail + 20..].copy_from_slice(b"PEND");
}

/// A volume of labels from its sides and its numbers, built with labels, packed and shown.
fn labels(bytes: &[u8]) -> bool {
    let Some(([x, y, z, wide], numbers)) = bytes.split_first_chunk::<4>() else { return false };
    let sides = [x, y, z].map(|side| 1 + u32::from(*side) % 24);
    let Some(dims) = Dims::new(sides[0], sides[1], sides[2]).filter(|_| !numbers.is_empty()) else {
        return false;
    };
    let at = |p: [u32; 3]| numbers[(p[0] + sides[0] * (p[1] + sides[1] * p[2])) as usize % numbers.len()];
    let volume = Voxels::from_fn(dims, |p| u16::from(at(p)) << (wide % 9));
    let options = BuildOptions { labels: Some(LabelChoice::All), ..options() };
    let path = folder().join("labels.oct");
    match build_volume(&volume, &options, &path, &Silent) {
        Ok(_) => model(&fs::read(&path).unwrap()) || panic!("what is built is not sound"),
        Err(refused) => told(&refused.to_string()),
    }
}

/// A table of names of labels, by every suffix that matters.
fn names(bytes: &[u8]) -> bool {
    let mut any = false;
    for name in ["case.txt", "case.ctbl"] {
        match read_label_names(&put(name, bytes), true) {
            Ok(_) => any = true,
            Err(refused) => any |= told(&refused.to_string()),
        }
    }
    any
}

/// A pyramid whose looks are in a library and whose texture is in an image.
fn looks(library: &[u8], image: &[u8]) -> bool {
    const BODY: &str = "mtllib case.mtl\nusemtl m\nv 0 0 0\nv 9 0 0\nv 0 9 0\nv 0 0 9\nvt 0 0\nvt 1 0\nvt 0 1\n\
                        f 1/1 3/2 2/3\nf 1/1 2/2 4/3\nf 1/1 4/2 3/3\nf 2/1 3/2 4/3\n";
    put("case.mtl", library);
    put("case.img", image);
    let channels = Channels::from([Channel::Normal, Channel::Color]);
    built_mesh("looks.obj", BODY.as_bytes(), &BuildOptions { channels: Some(channels), ..options() })
        .is_some()
}

/// Most models, lights and bounces of a scene that is shown: more take longer than a case may.
const MAX_SHOWN: usize = 3;

/// Reads a scene, and shows it small if it is a simple one of the model beside it.
fn scene(bytes: &[u8]) -> bool {
    static MODEL: OnceLock<PathBuf> = OnceLock::new();
    let model = MODEL.get_or_init(|| {
        let ball =
            Voxels::from_fn(Dims::new(7, 6, 5).unwrap(), |p| u8::from(p.iter().all(|c| (1..4).contains(c))));
        let path = folder().join("m.oct");
        let all = Channels::from([Channel::Normal, Channel::Value]);
        let options = BuildOptions { threshold: Threshold::Iso(1.0), channels: Some(all), ..options() };
        build_volume(&ball, &options, &path, &Silent).unwrap();
        path
    });
    let path = put("case.toml", bytes);
    let simple = match read_scene(&path) {
        Ok(scene) => {
            let few = scene.models.len().max(scene.lights.len()) <= MAX_SHOWN;
            let known = scene.models.iter().all(|one| model.file_name() == Some(one.file.as_os_str()));
            let is_fast = !matches!(scene.samples, Some(Samples::Sixteen | Samples::SixtyFour));
            few && known && scene.bounces as usize <= MAX_SHOWN && is_fast
        }
        Err(refused) => return told(&refused.to_string()),
    };
    if !simple {
        return true;
    }
    let picture = folder().join("case.png");
    let _ = fs::remove_file(&picture);
    let outputs = Outputs::of(&picture);
    let request =
        RenderRequest { size: Some([7, 5]), ambient_rays: 3, threads: 1, ..RenderRequest::default() };
    match render_file(&path, &outputs, &request, &Silent) {
        Ok(_) => true,
        Err(refused) => told(&refused.to_string()),
    }
}

/// A refusal is one sentence.
fn told(sentence: &str) -> bool {
    assert!(!sentence.is_empty() && !sentence.contains('\n'), "{sentence}");
    false
}

fn read(mut source: Box<dyn VolumeSource>, built: u64) -> bool {
    let workspace = Workspace { scratch: folder(), memory: Budget::new(ALLOWED), progress: &Silent };
    if let Err(refused) = source.prepare(&workspace) {
        return told(&refused.to_string());
    }
    let (dims, width) = (source.info().dims, source.info().scalar.bytes());
    let rows = 0..dims.ny().min(3);
    let cols = 0..dims.nx().min(4096);
    let mut out = vec![0; rows.len() * cols.len() * width];
    for z in [0, dims.nz() / 2, dims.nz() - 1] {
        if let Err(refused) = source.read_rows(z, rows.clone(), cols.clone(), &mut out) {
            return told(&refused.to_string());
        }
    }
    if dims.voxels() > built {
        return true;
    }
    let output = folder().join("built.oct");
    match build_volume(source.as_ref(), &options(), &output, &Silent) {
        Ok(_) => verify(&fs::File::open(&output).unwrap()).is_ok() || panic!("what is built is not sound"),
        Err(refused) => told(&refused.to_string()),
    }
}

/// Reads a mesh and builds it in a small grid.
fn mesh(name: &str, bytes: &[u8]) -> bool {
    built_mesh(name, bytes, &options()).is_some()
}

/// A mesh that a slow second reading may read, too: with the same triangles, between the same corners.
fn text_mesh(name: &str, bytes: &[u8], second: fn(&[u8]) -> Option<Second>) -> bool {
    let Some(facts) = built_mesh(name, bytes, &options()) else { return false };
    if let Some(Second { triangles, range: [low, high] }) = second(bytes) {
        assert_eq!(facts.triangles, triangles, "another number of triangles");
        // A grid of 12 voxels, one of them on either side of the longest.
        let longest = (0..3).map(|a| high[a] - low[a]).fold(0.0, f64::max);
        let far = (0..3).map(|a| low[a].abs().max(high[a].abs())).fold(0.0, f64::max);
        let near = |a: f64, b: f64| (a - b).abs() <= 1e-5 * far;
        assert!(near(facts.voxel_mm, longest / 10.0), "voxels of {}, not {}", facts.voxel_mm, longest / 10.0);
        // Along the others the grid has whole voxels, and the mesh lies in its middle.
        for a in 0..3 {
            let before = low[a] - facts.voxel_mm - facts.origin_mm[a];
            let most = if high[a] - low[a] == longest { 0.0 } else { facts.voxel_mm / 2.0 };
            assert!(before >= -1e-5 * far && before <= most + 1e-5 * far, "begins {before} mm before");
        }
    }
    true
}

/// The facts of a mesh that is built; `None` if it is refused.
fn built_mesh(name: &str, bytes: &[u8], options: &BuildOptions) -> Option<MeshFacts> {
    let path = put(name, bytes);
    let how = MeshOptions {
        grid: GridChoice::Side { voxels: 12, margin: 1 },
        unit_mm: 1.0,
        up: UpAxis::Z,
        fill: None,
        keep_thin: false,
        follow_links: false,
    };
    let output = folder().join("mesh.oct");
    match build_mesh(&[path], &how, options, &output, &Silent) {
        Ok(report) => {
            verify(&fs::File::open(&output).unwrap()).expect("what is built is sound");
            Some(report.facts)
        }
        Err(refused) => {
            told(&refused.to_string());
            None
        }
    }
}

/// Reads a tree of solids, and builds it if it names no file.
fn solids(bytes: &[u8]) -> bool {
    let path = put("case.csg", bytes);
    let (tree, root) = match read_tree(&path, options().memory) {
        Ok(read) => read,
        Err(refused) => return told(&refused.to_string()),
    };
    if tree.files().next().is_some() {
        return true;
    }
    let how = CsgOptions { grid: Some(GridChoice::Side { voxels: 12, margin: 1 }), unit_mm: 1.0 };
    let input = CsgInput { tree, root, name: path, volumes: Vec::new() };
    let output = folder().join("csg.oct");
    match build_csg(input, &how, &options(), &output, &Silent) {
        Ok(_) => {
            verify(&fs::File::open(&output).unwrap()).expect("what is built is sound");
            true
        }
        Err(refused) => told(&refused.to_string()),
    }
}

/// Two small pictures, one from within, and a ray.
fn picture<D: AsRef<[u8]>>(model: &Model<D>) -> bool {
    let (dims, affine) = (model.dims(), model.affine());
    let request = RenderRequest {
        size: Some([24, 17]),
        point: Some(ViewPoint::Named(NamedView::Iso)),
        threads: 1,
        depth: true,
        normals: true,
        ..RenderRequest::default()
    };
    let within = RenderRequest {
        point: Some(ViewPoint::Free {
            eye: affine.apply([0.5; 3]),
            look_at: affine.apply([9.0, 8.0, 7.0]),
            up: None,
        }),
        projection: Some(Projection::Perspective),
        lod: true,
        ..request.clone()
    };
    let mut any = false;
    for request in [request, within] {
        match render::render_view(&model.view(), dims, &affine, &request) {
            Ok(_) => any = true,
            Err(refused) => any |= told(&refused.to_string()),
        }
    }
    if let Ok(caster) = RayCaster::new(model) {
        let _ = caster.first_hit([-50.0, 1.0, 2.0], [1.0, 0.01, 0.02]);
    }
    any
}

/// Shows, measures and verifies a model; a sound one is also packed and traced against the reference.
fn model(bytes: &[u8]) -> bool {
    let mut bytes = bytes.to_vec();
    seal(&mut bytes);
    let model = match Model::from_bytes(bytes.as_slice()) {
        Ok(model) => model,
        Err(refused) => return told(&refused.to_string()),
    };
    let _ = picture(&model);
    let _ = measure::measure(&model.view(), model.dims(), &model.affine(), false);
    for far in [0, 1, u64::MAX] {
        let _ = model.value(VoxelIndex::new(far));
    }
    if verify(bytes.as_slice()).is_err() {
        return false;
    }
    let view = model.view();
    // The reference knows voxels and cells, not larger leaves.
    let has_leaves = Frame::read(bytes.as_slice()).is_ok_and(|frame| frame.header.leaves);
    if view.depth() <= 5 && !has_leaves {
        let bits = BitVolume::decode(&view).expect("shallow enough");
        let found = mismatches(&view, &bits, 16, 7);
        assert_eq!(found.total(), 0, "{found:?}");
    }
    let [mapped, packed, again] = ["mapped.oct", "packed.oct", "again.oct"].map(|name| folder().join(name));
    fs::write(&mapped, &bytes).unwrap();
    // A mask of the largest grid takes longer than a case may.
    if view.depth() <= 8 {
        // A page begins with a picture of its full size, which takes seconds with the counters of coverage.
        let of_pages = [ExportForm::Html, ExportForm::Linked];
        let written = ExportForm::ALL.into_iter().filter(|form| !of_pages.contains(form));
        for form in written {
            // Walls of labels alone are moved.
            let has_labels = view.labels().is_some();
            let smooth = has_labels.then(|| f64::from(bytes.last().copied().unwrap_or(0)) / 510.0);
            let request = ExportRequest { smooth, ..ExportRequest::of(form) };
            if let Err(refused) = export(&mapped, &folder().join("export"), request, &Silent) {
                told(&refused.to_string());
            }
        }
    }
    // The packed form leaves out what follows from the rest, and must bring it back.
    if pack::pack(&mapped, &packed).is_ok() {
        pack::unpack(&packed, &again).expect("what is packed can be unpacked");
        assert!(fs::read(&again).unwrap() == bytes, "unpacked to other bytes");
    }
    true
}

/// Unpacks a model; what comes out has to be sound as far as its opening looks.
fn archive(bytes: &[u8]) -> bool {
    let mut bytes = bytes.to_vec();
    seal(&mut bytes);
    let [packed, mapped] = ["archive.oct", "unpacked.oct"].map(|name| folder().join(name));
    // Checksums of contents are known when these have been decoded: one more with each try.
    for _ in 0..u32::from(MAX_SECTIONS) {
        fs::write(&packed, &bytes).unwrap();
        let _ = fs::remove_file(&mapped);
        match pack::unpack(&packed, &mapped) {
            Ok(_) => {
                let model = Model::open(&mapped).expect("what is unpacked can be opened");
                let _ = picture(&model);
                let _ = verify(&fs::File::open(&mapped).unwrap());
                return true;
            }
            Err(refused) => {
                told(&refused.to_string());
                let cause = refused.source().and_then(|cause| cause.downcast_ref::<FormatError>());
                let Some(&FormatError::Checksum { of, stated, found }) = cause else {
                    return false;
                };
                let Ok(frame) = Frame::read(bytes.as_slice()) else { return false };
                let name =
                    |entry: &SectionEntry| entry.kind.map_or("a section of unknown kind", SectionKind::name);
                let Some(at) = frame.sections.iter().position(|entry| name(entry) == of) else {
                    return false;
                };
                let at = HEADER_BYTES + at * ENTRY_BYTES + 44;
                if bytes[at..at + 4] != stated.to_le_bytes() {
                    return false;
                }
                bytes[at..at + 4].copy_from_slice(&found.to_le_bytes());
                seal(&mut bytes);
            }
        }
    }
    false
}

/// Gives a model the magic, offsets and checksums that its contents ask for (SPEC 3, 4.1, 4.2), as far as there
/// are any.
fn seal(bytes: &mut [u8]) {
    fn put(bytes: &mut [u8], at: usize, value: &[u8]) {
        bytes[at..at + value.len()].copy_from_slice(value);
    }
    let number = |bytes: &[u8], at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
    let length = bytes.len();
    if length < HEADER_BYTES {
        return;
    }
    put(bytes, 0, &[0x89, b'O', b'C', b'T', 0x0d, 0x0a, 0x1a, 0x0a, 1, 0]);
    put(bytes, 16, &(length as u64).to_le_bytes());
    let side = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    if let Some(dims) = Dims::new(side(40), side(44), side(48)) {
        bytes[13] = u8::try_from(dims.depth()).unwrap();
    }
    let sections = usize::from(u16::from_le_bytes([bytes[14], bytes[15]]).min(MAX_SECTIONS));
    let table_end = HEADER_BYTES + sections * ENTRY_BYTES;
    if table_end <= length {
        let mut end = table_end as u64;
        for entry in (HEADER_BYTES..table_end).step_by(ENTRY_BYTES) {
            let offset = align_up(end);
            put(bytes, entry + 8, &offset.to_le_bytes());
            let stored = number(bytes, entry + 16);
            end = offset.saturating_add(stored);
            let range = usize::try_from(offset).ok().zip(usize::try_from(end).ok());
            if let Some(content) = range.and_then(|(from, to)| bytes.get(from..to)) {
                let crc = crc32c::crc32c(content).to_le_bytes();
                put(bytes, entry + 40, &crc);
                if bytes[entry + 4] == 0 {
                    put(bytes, entry + 44, &crc);
                }
            }
        }
        let crc = crc32c::crc32c(&bytes[HEADER_BYTES..table_end]).to_le_bytes();
        put(bytes, 56, &crc);
    }
    let crc = crc32c::crc32c(&bytes[..60]).to_le_bytes();
    put(bytes, 60, &crc);
}

/// What a codestream says of its image: columns, rows, components, bits.
type Stated = (u32, u32, u16, u16);

/// Takes a codestream for the pixels of a DICOM image that states the same size; the first byte chooses among
/// what DICOM states as well.
fn codec(bytes: &[u8], syntaxes: &[&str], stated: fn(&[u8]) -> Option<Stated>) -> bool {
    let Some((choice, stream)) = bytes.split_first() else { return false };
    let (columns, rows, samples, precision) = stated(stream)
        .filter(|s| u64::from(s.0) * u64::from(s.1) <= MAX_PIXELS && s.0.max(s.1) <= u32::from(u16::MAX))
        .unwrap_or((16, 16, 1, 8));
    let precision = precision.clamp(1, 32);
    let allocated = if precision <= 8 && choice & 1 == 0 { 8 } else { precision.next_multiple_of(16) };
    let syntax = syntaxes[usize::from(choice >> 3) % syntaxes.len()];
    let spec = Spec {
        size: [columns, rows].map(|side| u16::try_from(side).unwrap_or(1)),
        bits: [allocated, precision, precision - 1],
        signed: choice & 2 != 0,
        samples,
        photometric: if samples == 3 { "RGB" } else { "MONOCHROME2" },
        ..Spec::default()
    };
    // Two fragments where the choice says so: a decoder does not see where one ends.
    let middle = if choice & 4 == 0 { stream.len() } else { stream.len() / 4 * 2 };
    let fragments: Vec<Vec<u8>> = [&stream[..middle], &stream[middle..]]
        .into_iter()
        .filter(|part| !part.is_empty())
        .map(even)
        .collect();
    let file = encapsulated(&format!("1.2.840.10008.1.2.{syntax}"), spec, &[], &fragments);
    volume("case.dcm", &file, 0)
}

/// Fragments have an even length.
fn even(part: &[u8]) -> Vec<u8> {
    let mut part = part.to_vec();
    part.resize(part.len().next_multiple_of(2), 0);
    part
}

/// JPEG and JPEG-LS: the first start of a frame.
fn jpeg_frame(stream: &[u8]) -> Option<Stated> {
    let is_start =
        |code: u8| code == 0xf7 || (matches!(code, 0xc0..=0xcf) && !matches!(code, 0xc4 | 0xc8 | 0xcc));
    let at = stream.windows(2).position(|pair| pair[0] == 0xff && is_start(pair[1]))?;
    let [.., precision, r0, r1, c0, c1, components] = *stream.get(at + 2..)?.first_chunk::<8>()?;
    let pair = |high, low| u32::from(u16::from_be_bytes([high, low]));
    Some((pair(c0, c1), pair(r0, r1), components.into(), precision.into()))
}

/// JPEG 2000: the segment of sizes.
fn jpeg2000_frame(stream: &[u8]) -> Option<Stated> {
    let at = stream.windows(2).position(|pair| pair == [0xff, 0x51])?;
    let size = stream.get(at + 2..)?.first_chunk::<39>()?;
    let number = |at: usize| u32::from_be_bytes(size[at..at + 4].try_into().unwrap_or_default());
    let (columns, rows) = (number(4).checked_sub(number(12))?, number(8).checked_sub(number(16))?);
    Some((columns, rows, u16::from_be_bytes([size[36], size[37]]).min(4), u16::from(size[38] & 0x7f) + 1))
}

/// RLE says nothing of its image: as many bytes of a sample as segments.
fn rle_frame(stream: &[u8]) -> Option<Stated> {
    let segments = u16::from(*stream.first()?);
    Some(match segments {
        3 => (12, 9, 3, 8),
        2 => (12, 9, 1, 16),
        4 => (12, 9, 1, 32),
        _ => (12, 9, 1, 8),
    })
}

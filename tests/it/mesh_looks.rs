//! Colours, textures, parts and smooth normals of meshes: the same from every format, at any budget, and true at the
//! nearest point of the surface.

#![allow(clippy::cast_possible_truncation, reason = "small numbers")]

use crate::prelude::*;
use std::fmt::Write;

const SIDE: u32 = 40;

fn all_channels() -> Channels {
    Channels::from([Channel::Normal, Channel::Color, Channel::Material])
}

fn build(inputs: &[PathBuf], channels: Channels, threads: usize, mib: u64) -> Result<Vec<u8>, String> {
    build_as(SurfaceKind::Skin, inputs, channels, (threads, mib))
}

fn build_as(
    surface: SurfaceKind,
    inputs: &[PathBuf],
    channels: Channels,
    (threads, mib): (usize, u64),
) -> Result<Vec<u8>, String> {
    let mesh = on_grid(exact_grid([SIDE; 3]));
    let options = BuildOptions { surface: Some(surface), channels: Some(channels), ..share(mib, threads) };
    let model = inputs[0].with_extension("oct");
    build_mesh(inputs, &mesh, &options, &model, &Silent).map_err(|e| e.to_string())?;
    Ok(fs::read(&model).unwrap())
}

/// A material of glTF with the first texture.
fn metallic() -> Value {
    json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
}

/// The first parts of what is told of a mesh that lacks something.
fn notes(input: &Path) -> Vec<String> {
    let mesh = on_grid(GridChoice::Side { voxels: 8, margin: 1 });
    let options = BuildOptions { channels: Some(Channels::default().with(Channel::Color)), ..share(8, 1) };
    let model = input.with_extension("oct");
    let report = build_mesh(&[input.to_path_buf()], &mesh, &options, &model, &Silent).unwrap();
    report.notes.iter().map(|note| note.to_string().split(';').next().unwrap().to_owned()).collect()
}

/// A skin voxel or cell: where its centre is, and what is stored of it.
struct Voxel {
    at: [f64; 3],
    color: Option<[u8; 3]>,
    material: Option<u8>,
    normal: [f64; 3],
}

fn voxels(bytes: &[u8]) -> Vec<Voxel> {
    verify(bytes).unwrap();
    let model = Model::from_bytes(bytes).unwrap();
    let mut found = Vec::new();
    for (corner, number) in finest(&model) {
        let item = |channel| model.items(channel).and_then(|items| items.get(number.get()));
        let [x, y, z] = normal::decode_l1(model.voxel_normal(number).unwrap()).map(f64::from);
        let length = (x * x + y * y + z * z).sqrt();
        found.push(Voxel {
            at: corner.map(|c| f64::from(c) + if model.view().cells().is_some() { 0.0 } else { 0.5 }),
            color: item(Channel::Color).map(|c| [c[0], c[1], c[2]]),
            material: item(Channel::Material).map(|m| m[0]),
            normal: [x / length, y / length, z / length],
        });
    }
    found
}

/// An image of 4 x 4 texels: red and green above, blue and white below.
fn image() -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 4, 4);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header().unwrap();
    let row = |left: [u8; 3], right: [u8; 3]| [left, left, right, right].concat();
    let (above, below) = (row([255, 0, 0], [0, 255, 0]), row([0, 0, 255], [255, 255, 255]));
    writer.write_image_data(&[above.clone(), above, below.clone(), below].concat()).unwrap();
    writer.finish().unwrap();
    bytes
}

/// A box whose side at high x carries the image: y runs to the right and z up on it.
const LOW: [f64; 3] = [8.0; 3];
const HIGH: [f64; 3] = [32.0; 3];

fn place([_, y, z]: [f64; 3]) -> [f64; 2] {
    [(y - LOW[1]) / (HIGH[1] - LOW[1]), (z - LOW[2]) / (HIGH[2] - LOW[2])]
}

fn corners(body: &Body) -> Vec<[f64; 3]> {
    body.faces
        .iter()
        .flatten()
        .map(|at| body.vertices[*at].map(|c| c as f64 / meshes::STEPS as f64))
        .collect()
}

fn textured_obj(body: &Body) -> String {
    let mut text = String::from("mtllib looks.mtl\nusemtl the look\n");
    for (at, p) in corners(body).iter().enumerate() {
        let [u, v] = place(*p);
        writeln!(text, "v {} {} {}\nvt {u} {v}", p[0], p[1], p[2]).unwrap();
        if at % 3 == 2 {
            writeln!(text, "f {0}/{0} {1}/{1} {2}/{2}", at - 1, at, at + 1).unwrap();
        }
    }
    text
}

fn textured_glb(body: &Body, image: &[u8], material: &Value) -> Vec<u8> {
    let corners = corners(body);
    let mut bytes = Vec::new();
    let mut floats = |values: &[f64]| values.iter().for_each(|v| bytes.extend((*v as f32).to_le_bytes()));
    corners.iter().for_each(|p| floats(p));
    // Down the image.
    corners.iter().map(|p| place(*p)).for_each(|[u, v]| floats(&[u, 1.0 - v]));
    let (count, from) = (corners.len(), bytes.len());
    bytes.extend(image);
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    let described = json!({
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "matrix": containers::MILLIMETRES}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]}],
        "materials": [material],
        "textures": [{"source": 0}],
        "images": [{"bufferView": 2, "mimeType": "image/png"}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5126, "count": count, "type": "VEC2"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 12 * count},
            {"buffer": 0, "byteOffset": 12 * count, "byteLength": 8 * count},
            {"buffer": 0, "byteOffset": from, "byteLength": image.len()},
        ],
        "buffers": [{"byteLength": bytes.len()}],
    });
    glb(&described, &bytes)
}

#[test]
fn a_texture_stands_upright_whichever_way_its_format_counts() {
    let folder = tempfile::tempdir().unwrap();
    let body = Body::cuboid(LOW, HIGH);
    put(folder.path(), "image of it.png", &image());
    put(
        folder.path(),
        "looks.mtl",
        b"newmtl other\nKd 1 0 0\nnewmtl the look\nKd 1 1 1\nmap_Kd -s 1 1 1 image of it.png\n",
    );
    let channels = Channels::from([Channel::Normal, Channel::Color]);
    let obj = put(folder.path(), "a.obj", textured_obj(&body).as_bytes());
    let obj = build(&[obj], channels, 1, 8).unwrap();
    let glb = put(folder.path(), "b.glb", &textured_glb(&body, &image(), &metallic()));
    assert!(build(std::slice::from_ref(&glb), channels, 1, 8).unwrap() == obj, "glTF and OBJ");
    let glossy =
        json!({"extensions": {"KHR_materials_pbrSpecularGlossiness": {"diffuseTexture": {"index": 0}}}});
    let glossy = put(folder.path(), "c.glb", &textured_glb(&body, &image(), &glossy));
    assert!(build(&[glossy], channels, 1, 8).unwrap() == obj, "the older kind of material");
    assert!(build(&[glb], channels, 2, 256).unwrap() == obj, "at another budget");
    let mut seen = 0;
    for voxel in voxels(&obj) {
        let [u, v] = place(voxel.at);
        // Away from the edges of the side and of the image's quarters.
        let inner = |c: f64| (0.15..0.35).contains(&c) || (0.65..0.85).contains(&c);
        if voxel.at[0] > 31.0 && inner(u) && inner(v) {
            let wanted = match (u < 0.5, v < 0.5) {
                (true, false) => [255, 0, 0],
                (false, false) => [0, 255, 0],
                (true, true) => [0, 0, 255],
                (false, true) => [255; 3],
            };
            assert_eq!(voxel.color, Some(wanted), "{:?}", voxel.at);
            seen += 1;
        }
    }
    assert!(seen > 50, "{seen}");
}

/// Nearest to the plane, not to the middle: a slab of less than a cell has another colour on either side.
#[test]
fn cells_have_the_colours_and_parts_of_the_mesh_at_their_planes() {
    let folder = tempfile::tempdir().unwrap();
    let body = Body::cuboid([8.0, 8.0, 19.6], [32.0, 32.0, 20.6]);
    let mut ply = format!(
        "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n\
         element face {}\nproperty list uchar int vertex_indices\nproperty uchar red\nproperty uchar green\n\
         property uchar blue\nend_header\n",
        body.faces.len()
    );
    let places = body.vertices.iter().map(|v| v.map(|c| c as f64 / meshes::STEPS as f64));
    let places: Vec<[f64; 3]> = places.collect();
    for [x, y, z] in &places {
        writeln!(ply, "{x} {y} {z}").unwrap();
    }
    for face in &body.faces {
        let [a, b, c] = face.map(|at| places[at][2]);
        let color = if a == b && b == c { if a < 20.0 { "255 0 0" } else { "0 255 0" } } else { "0 0 255" };
        writeln!(ply, "3 {} {} {} {color}", face[0], face[1], face[2]).unwrap();
    }
    let ply = put(folder.path(), "a.ply", ply.as_bytes());
    let of = |ply: &PathBuf, at| {
        build_as(SurfaceKind::Cells, std::slice::from_ref(ply), all_channels(), at).unwrap()
    };
    let built = of(&ply, (1, 8));
    assert!(of(&ply, (2, 256)) == built, "at another budget");
    let mut seen = [0; 2];
    for cell in voxels(&built) {
        assert_eq!(cell.material, Some(0));
        if cell.at[..2].iter().all(|c| (10.0..30.0).contains(c)) {
            let is_low = cell.normal[2] < 0.0;
            assert_eq!(cell.color, Some(if is_low { [255, 0, 0] } else { [0, 255, 0] }), "{:?}", cell.at);
            seen[usize::from(is_low)] += 1;
        }
    }
    assert!(seen[0] == seen[1] && seen[0] > 300, "{seen:?}");
    let model = put(folder.path(), "a.oct", &built);
    let shown = oct(&["info", &text(&model)]).stdout;
    assert!(shown.contains("\ncolors        one for each cell\n"), "{shown}");
    // Without colours the bytes are those of a mesh that never had any.
    let normals = Channels::default();
    let stl = put(folder.path(), "a.stl", &body.stl());
    let [plain, bare] = [&ply, &stl]
        .map(|path| build_as(SurfaceKind::Cells, std::slice::from_ref(path), normals, (1, 8)).unwrap());
    assert!(plain == bare);
}

#[test]
fn many_texels_on_a_voxel_are_averaged_in_linear_light() {
    // Black and white texels, 512 on 24 voxels: linear grey of one half, which is 188.
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 512, 512);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Eight);
    let texels: Vec<u8> = (0..512 * 512).map(|i| if (i + i / 512) % 2 == 0 { 255 } else { 0 }).collect();
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(&texels).unwrap();
    writer.finish().unwrap();
    let path = put(folder.path(), "a.glb", &textured_glb(&Body::cuboid(LOW, HIGH), &bytes, &metallic()));
    let built = build(&[path], all_channels(), 1, 64).unwrap();
    for voxel in voxels(&built).iter().filter(|voxel| voxel.at[0] > 31.0) {
        assert_eq!(voxel.color, Some([188; 3]), "{:?}", voxel.at);
    }
}

#[test]
fn colours_of_vertices_are_the_same_from_every_format() {
    let folder = tempfile::tempdir().unwrap();
    let body = Body::cuboid(LOW, HIGH);
    let places: Vec<[f64; 3]> =
        body.vertices.iter().map(|v| v.map(|c| c as f64 / meshes::STEPS as f64)).collect();
    let color = |p: &[f64; 3]| p.map(|c| if c > 20.0 { 255_u8 } else { 0 });
    let mut obj = String::new();
    let mut ply = format!(
        "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nelement face {}\n\
         property list uchar int vertex_indices\nend_header\n",
        body.faces.len()
    );
    let mut binary = ply.replace("ascii", "binary_little_endian").into_bytes();
    for p in &places {
        let [r, g, b] = color(p);
        writeln!(ply, "{} {} {} {r} {g} {b}", p[0], p[1], p[2]).unwrap();
        writeln!(obj, "v {} {} {} {} {} {}", p[0], p[1], p[2], r / 255, g / 255, b / 255).unwrap();
        p.iter().for_each(|c| binary.extend((*c as f32).to_le_bytes()));
        binary.extend([r, g, b]);
    }
    for [a, b, c] in &body.faces {
        writeln!(ply, "3 {a} {b} {c}").unwrap();
        writeln!(obj, "f {} {} {}", a + 1, b + 1, c + 1).unwrap();
        binary.push(3);
        [a, b, c].iter().for_each(|at| binary.extend(u32::try_from(**at).unwrap().to_le_bytes()));
    }
    let build =
        |name: &str, bytes: &[u8]| build(&[put(folder.path(), name, bytes)], all_channels(), 1, 8).unwrap();
    let wanted = build("a.ply", ply.as_bytes());
    assert!(build("b.ply", &binary) == wanted, "binary");
    assert!(build("c.obj", obj.as_bytes()) == wanted, "OBJ");
    let short = ["red", "green", "blue"].iter().fold(ply, |ply, name| ply.replace(name, &name[..1]));
    assert!(build("d.ply", short.as_bytes()) == wanted, "r, g, b");
    for voxel in voxels(&wanted) {
        // Linear light runs evenly along every edge; sRGB does not.
        let [r, g, b] = voxel.color.unwrap();
        for (axis, part) in [r, g, b].into_iter().enumerate() {
            let light = ((voxel.at[axis] - 8.0) / 24.0).clamp(0.0, 1.0);
            let code = f64::from(part) / 255.0;
            let got = if code <= 0.04045 { code / 12.92 } else { ((code + 0.055) / 1.055).powf(2.4) };
            assert!((got - light).abs() < 0.03, "{:?}: {part} at {axis}", voxel.at);
        }
    }
}

#[test]
fn colours_of_3mf_are_those_of_its_groups() {
    let folder = tempfile::tempdir().unwrap();
    let body = Body::cuboid(LOW, HIGH);
    let mut text = String::from(
        "<model unit=\"millimeter\" xmlns=\"http://schemas.microsoft.com/3dmanufacturing/core/2015/02\"><resources>\
         <basematerials id=\"5\"><base name=\"a\" displaycolor=\"#FF8000\"/></basematerials>\
         <object id=\"1\" pid=\"5\" pindex=\"0\"><mesh><vertices>",
    );
    for v in &body.vertices {
        let [x, y, z] = v.map(|c| c as f64 / meshes::STEPS as f64);
        write!(text, "<vertex x=\"{x}\" y=\"{y}\" z=\"{z}\"/>").unwrap();
    }
    text += "</vertices><triangles>";
    for [a, b, c] in &body.faces {
        write!(text, "<triangle v1=\"{a}\" v2=\"{b}\" v3=\"{c}\"/>").unwrap();
    }
    text += "</triangles></mesh></object></resources><build><item objectid=\"1\"/></build></model>";
    let bytes = archive(&[("3D/3dmodel.model", text.into_bytes(), 8)]);
    let built = build(&[put(folder.path(), "a.3mf", &bytes)], all_channels(), 1, 8).unwrap();
    assert!(voxels(&built).iter().all(|voxel| voxel.color == Some([255, 128, 0])));
}

#[test]
fn parts_are_the_numbers_of_files_and_colours_stay_out_where_there_are_none() {
    let folder = tempfile::tempdir().unwrap();
    let low = put(folder.path(), "a.stl", &Body::cuboid([4.0; 3], [16.0; 3]).stl());
    let high = put(folder.path(), "b.stl", &Body::cuboid([20.0; 3], [36.0; 3]).stl());
    let built = build(&[low.clone(), high.clone()], all_channels(), 1, 8).unwrap();
    for voxel in voxels(&built) {
        assert_eq!((voxel.material, voxel.color), (Some(u8::from(voxel.at[0] > 18.0)), None));
    }
    assert!(build(&[low.clone(), high.clone()], all_channels(), 2, 64).unwrap() == built);
    // Asked for or not: a mesh without colours gives the bytes that it always gave.
    let plain = build(&[low.clone(), high.clone()], Channels::default(), 1, 8).unwrap();
    let asked = Channels::default().with(Channel::Color);
    assert!(build(&[low, high], asked, 1, 8).unwrap() == plain);
}

#[test]
fn normals_of_vertices_make_a_coarse_ball_smooth() {
    let folder = tempfile::tempdir().unwrap();
    let (center, radius) = ([20.0; 3], 15.0);
    let body = Body::sphere(center, radius, 2);
    let mut text = String::new();
    for v in &body.vertices {
        let p = v.map(|c| c as f64 / meshes::STEPS as f64);
        // On either side: the model knows where outside is.
        let n: [f64; 3] = std::array::from_fn(|k| center[k] - p[k]);
        writeln!(text, "v {} {} {}\nvn {} {} {}", p[0], p[1], p[2], n[0], n[1], n[2]).unwrap();
    }
    let mut flat = text.clone();
    for [a, b, c] in &body.faces {
        let [a, b, c] = [a + 1, b + 1, c + 1];
        writeln!(text, "f {a}//{a} {b}//{b} {c}//{c}").unwrap();
        writeln!(flat, "f {a} {b} {c}").unwrap();
    }
    let mean = |name: &str, text: &str| {
        let built = build(&[put(folder.path(), name, text.as_bytes())], Channels::default(), 1, 8).unwrap();
        let all = voxels(&built);
        let angles = all.iter().map(|voxel| {
            let d: [f64; 3] = std::array::from_fn(|k| voxel.at[k] - center[k]);
            let length = d.iter().map(|c| c * c).sum::<f64>().sqrt();
            let cosine: f64 = (0..3).map(|k| voxel.normal[k] * d[k] / length).sum();
            cosine.clamp(-1.0, 1.0).acos().to_degrees()
        });
        angles.sum::<f64>() / all.len() as f64
    };
    let (smooth, flat) = (mean("smooth.obj", &text), mean("flat.obj", &flat));
    assert!(smooth < 2.0 && flat > 4.0, "{smooth} {flat}");
}

/// Faces have colours where vertices have none, behind or before their corners, in any order of bytes.
#[test]
fn colours_of_faces_are_the_same_from_text_and_binary() {
    let folder = tempfile::tempdir().unwrap();
    let body = Body::cuboid(LOW, HIGH);
    let places: Vec<[f32; 3]> =
        body.vertices.iter().map(|v| v.map(|c| (c as f64 / meshes::STEPS as f64) as f32)).collect();
    // Red where the normal is along z.
    let color = |t: &[[f32; 3]; 3]| {
        if t[0][2] == t[1][2] && t[1][2] == t[2][2] { [255_u8, 0, 0] } else { [0, 0, 255] }
    };
    let head = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n\
             element face {}\nproperty uchar red\nproperty list uchar int vertex_indices\nproperty uchar green\n\
             property uchar blue\nend_header\n",
            body.faces.len()
        )
    };
    let mut text = head("ascii");
    let (mut little, mut big) =
        (head("binary_little_endian").into_bytes(), head("binary_big_endian").into_bytes());
    for p in &places {
        writeln!(text, "{} {} {}", p[0], p[1], p[2]).unwrap();
        p.iter().for_each(|c| little.extend(c.to_le_bytes()));
        p.iter().for_each(|c| big.extend(c.to_be_bytes()));
    }
    for face in &body.faces {
        let [r, g, b] = color(&face.map(|at| places[at]));
        let [a0, a1, a2] = face.map(|at| u32::try_from(at).unwrap());
        writeln!(text, "{r} 3 {a0} {a1} {a2} {g} {b}").unwrap();
        little.extend([r, 3]);
        big.extend([r, 3]);
        [a0, a1, a2].iter().for_each(|at| little.extend(at.to_le_bytes()));
        [a0, a1, a2].iter().for_each(|at| big.extend(at.to_be_bytes()));
        little.extend([g, b]);
        big.extend([g, b]);
    }
    let of = |name: &str, bytes: &[u8], channels| {
        build(&[put(folder.path(), name, bytes)], channels, 1, 8).unwrap()
    };
    let wanted = of("a.ply", text.as_bytes(), all_channels());
    let capitals = ["red", "green", "blue"].iter().fold(text.clone(), |text, name| {
        text.replace(name, &format!("{}{}", name[..1].to_uppercase(), &name[1..]))
    });
    assert!(of("d.ply", capitals.as_bytes(), all_channels()) == wanted, "capitals");
    assert!(of("b.ply", &little, all_channels()) == wanted, "little-endian");
    assert!(of("c.ply", &big, all_channels()) == wanted, "big-endian");
    let mut seen = [0, 0];
    // On an edge either face may be the nearest.
    let within = |v: &&Voxel| v.at.iter().filter(|c| (10.0..30.0).contains(*c)).count() == 2;
    for voxel in voxels(&wanted).iter().filter(within) {
        let is_red = voxel.normal[2].abs() > 0.99;
        assert_eq!(voxel.color, Some(if is_red { [255, 0, 0] } else { [0, 0, 255] }), "{:?}", voxel.at);
        seen[usize::from(is_red)] += 1;
    }
    assert!(seen[0] > 1000 && seen[1] > 500, "{seen:?}");
    // Those who ask for normals alone get them.
    assert!(voxels(&of("b.ply", &little, Channels::default())).iter().all(|v| v.color.is_none()));
}

#[test]
fn what_is_missing_is_left_out_and_what_is_damaged_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let body = Body::cuboid(LOW, HIGH);
    let obj = put(folder.path(), "a.obj", textured_obj(&body).as_bytes());
    let asked = Channels::default().with(Channel::Color);
    // Neither the materials nor their image are handed on with many files.
    assert!(
        voxels(&build(std::slice::from_ref(&obj), asked, 1, 8).unwrap()).iter().all(|v| v.color.is_none())
    );
    assert_eq!(notes(&obj), ["a.obj takes colours from looks.mtl, which is not there"]);
    put(folder.path(), "looks.mtl", b"newmtl another\nKd 1 0 0\n");
    assert_eq!(notes(&obj), ["a.obj uses the material the look, which its libraries do not define"]);
    put(folder.path(), "looks.mtl", b"newmtl the look\nKd 1 0 0\nmap_kd none.png\n");
    assert_eq!(notes(&obj), ["a.obj takes colours from none.png, which is not there"]);
    let red = build(std::slice::from_ref(&obj), asked, 1, 8).unwrap();
    assert!(voxels(&red).iter().all(|v| v.color == Some([255, 0, 0])));
    // The library may stand behind the faces.
    let (library, faces) =
        textured_obj(&body).split_once('\n').map(|(a, b)| (a.to_owned(), b.to_owned())).unwrap();
    let behind = put(folder.path(), "b.obj", format!("{faces}{library}\n").as_bytes());
    assert!(build(&[behind], asked, 1, 8).unwrap() == red);
    // Damaged anywhere: refused in a sentence, or built.
    put(folder.path(), "looks.mtl", b"newmtl the look\nmap_Kd i.png\n");
    let whole = image();
    for cut in (0..whole.len()).step_by(7) {
        put(folder.path(), "i.png", &whole[..cut]);
        if let Err(told) = build(std::slice::from_ref(&obj), asked, 1, 8) {
            assert!(told.contains("i.png") && told.contains("channels normal"), "{told}");
        }
        let mut changed = whole.clone();
        changed[cut] ^= 0x5a;
        put(folder.path(), "i.png", &changed);
        let _either = build(std::slice::from_ref(&obj), asked, 1, 8);
    }
    // An image that its bytes do not justify.
    let mut huge = whole.clone();
    huge[16..24].copy_from_slice(&[0, 0, 0x7f, 0xff, 0, 0, 0x7f, 0xff]);
    let mut sum = flate2::Crc::new();
    sum.update(&huge[12..29]);
    huge[29..33].copy_from_slice(&sum.sum().to_be_bytes());
    put(folder.path(), "i.png", &huge);
    let told = build(std::slice::from_ref(&obj), asked, 1, 8).unwrap_err();
    assert!(told.contains("32767 x 32767"), "{told}");
    put(folder.path(), "i.png", b"GIF89a, which is not read");
    assert!(build(&[obj], asked, 1, 8).unwrap_err().contains("PNG or JPEG"));
}

/// A box of two colours, one on either side of the middle, as PLY.
fn two_colors(low: [u8; 3], high: [u8; 3]) -> String {
    let left = Body::cuboid(LOW, [20.0, HIGH[1], HIGH[2]]);
    let right = Body::cuboid([20.0, LOW[1], LOW[2]], HIGH);
    let both = left.clone().with(&right);
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nelement face {}\n\
         property list uchar int vertex_indices\nend_header\n",
        both.vertices.len(),
        both.faces.len()
    );
    for (at, p) in both.vertices.iter().enumerate() {
        let [x, y, z] = p.map(|c| c as f64 / meshes::STEPS as f64);
        let [r, g, b] = if at < left.vertices.len() { low } else { high };
        writeln!(text, "{x} {y} {z} {r} {g} {b}").unwrap();
    }
    both.faces.iter().for_each(|[a, b, c]| writeln!(text, "3 {a} {b} {c}").unwrap());
    text
}

#[test]
fn colours_come_back_from_what_was_exported() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for (low, high) in [([250, 20, 128], [0, 77, 255]), ([1, 0, 3], [2, 12, 254])] {
        let model = build(
            &[put(folder.path(), "a.ply", two_colors(low, high).as_bytes())],
            Channels::from([Channel::Normal, Channel::Color]),
            1,
            8,
        );
        let color = |p: [f64; 3]| if p[0] < 20.0 { low } else { high };
        let wanted = voxels(&model.unwrap());
        // Beside the seam the walls between both halves are as near.
        assert!(wanted.iter().all(|v| (v.at[0] - 20.0).abs() < 1.0 || v.color == Some(color(v.at))));
        for (name, form) in
            [("m.ply", ExportForm::Ply), ("m.glb", ExportForm::Glb), ("points.ply", ExportForm::Points)]
        {
            let request = ExportRequest::of(form);
            export(&at("a.oct"), &at(name), request, &infobyte::progress::Silent).unwrap();
            if form == ExportForm::Points {
                continue;
            }
            // What is built of the export has the same colours, but for those that vertices between both mix.
            let again = put(folder.path(), "b.ply", b"");
            let again = again.with_extension(name.rsplit('.').next().unwrap());
            fs::copy(at(name), &again).unwrap();
            let again =
                voxels(&build(&[again], Channels::from([Channel::Normal, Channel::Color]), 1, 8).unwrap());
            assert!(again.len() > 2000, "{name}: {}", again.len());
            for voxel in again {
                let far = (voxel.at[0] - 20.0).abs() > 1.5;
                assert!(
                    !far || voxel.color == Some(color(voxel.at)),
                    "{name} {:?} {:?}",
                    voxel.at,
                    voxel.color
                );
            }
        }
        let points = fs::read(at("points.ply")).unwrap();
        let end = points.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        let records = points[end..].as_chunks::<27>();
        assert_eq!((records.0.len(), records.1.len()), (wanted.len(), 0));
        for record in records.0 {
            let x = f32::from_le_bytes(record[..4].try_into().unwrap());
            assert!((x - 20.0).abs() < 1.0 || record[24..] == color([f64::from(x), 0.0, 0.0]));
        }
        // Colours of glTF are light, and its material does not tint them.
        let glb = fs::read(at("m.glb")).unwrap();
        let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
        let told: serde_json::Value = serde_json::from_slice(&glb[20..20 + length]).unwrap();
        assert_eq!(
            told["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"],
            json!([1.0, 1.0, 1.0, 1.0])
        );
        let accessor = &told["accessors"][2];
        assert_eq!((&accessor["componentType"], &accessor["normalized"]), (&json!(5123), &json!(true)));
        let from = told["bufferViews"][2]["byteOffset"].as_u64().unwrap() as usize + 28 + length;
        let light = |c: u8| {
            let s = f64::from(c) / 255.0;
            let light = if s <= 0.040_45 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) };
            (light * 65535.0).round() as u16
        };
        let wanted: Vec<u8> =
            low.map(light).into_iter().chain([u16::MAX]).flat_map(u16::to_le_bytes).collect();
        let first = &glb[from..from + 8];
        assert!(first == wanted, "{first:?} {wanted:?}");
    }
}

#[test]
fn objects_and_nodes_are_parts_of_their_own_and_files_count_on() {
    let folder = tempfile::tempdir().unwrap();
    let first = Body::cuboid([4.0; 3], [10.0; 3]);
    let second = Body::cuboid([14.0, 4.0, 4.0], [20.0, 10.0, 10.0]);
    let mut obj = String::new();
    for (at, body) in [&first, &second].into_iter().enumerate() {
        for p in &body.vertices {
            let [x, y, z] = p.map(|c| c as f64 / meshes::STEPS as f64);
            writeln!(obj, "v {x} {y} {z}").unwrap();
        }
        writeln!(obj, "o part {at}\ng half").unwrap();
        for (n, face) in body.faces.iter().enumerate() {
            if n == 6 && at == 1 {
                writeln!(obj, "g other half").unwrap();
            }
            let [a, b, c] = face.map(|v| v + 1 + 8 * at);
            writeln!(obj, "f {a} {b} {c}").unwrap();
        }
    }
    let obj = put(folder.path(), "a.obj", obj.as_bytes());
    let stl = put(folder.path(), "b.stl", &Body::cuboid([24.0; 3], [36.0; 3]).stl());
    let third = |v: &Voxel| v.at[0] > 22.0;
    for channels in [all_channels(), Channels::from([Channel::Normal, Channel::Material])] {
        let built = voxels(&build(&[obj.clone(), stl.clone()], channels, 1, 8).unwrap());
        for voxel in &built {
            let wanted = match voxel.at[0] {
                x if x < 12.0 => &[0][..],
                _ if third(voxel) => &[3],
                _ => &[1, 2],
            };
            assert!(wanted.contains(&voxel.material.unwrap()), "{:?} {:?}", voxel.at, voxel.material);
        }
        let has = |part: u8| built.iter().any(|voxel| voxel.material == Some(part));
        assert!((0..4).all(has));
    }
    // Two nodes with the same mesh, and two items of one object.
    let mut described = containers::description(&first);
    let mut aside = containers::MILLIMETRES;
    aside[12] = 0.012;
    described["nodes"] =
        json!([{"mesh": 0, "matrix": containers::MILLIMETRES}, {"mesh": 0, "matrix": aside}]);
    described["scenes"][0]["nodes"] = json!([0, 1]);
    let nodes = put(folder.path(), "c.glb", &glb(&described, &containers::buffer(&first)));
    let items = "<item objectid=\"1\"/><item objectid=\"1\" transform=\"1 0 0 0 1 0 0 0 1 12 0 0\"/>";
    let text = containers::text("millimeter", &containers::object(&first, 1, 1.0), items);
    let items = put(folder.path(), "d.3mf", &containers::packed(&text, 8));
    for file in [nodes, items] {
        let built = voxels(&build(std::slice::from_ref(&file), all_channels(), 1, 8).unwrap());
        for voxel in &built {
            assert_eq!(voxel.material, Some(u8::from(voxel.at[0] > 12.0)), "{}", file.display());
        }
        assert!(built.iter().any(|voxel| voxel.at[0] > 12.0));
    }
}

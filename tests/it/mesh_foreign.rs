//! Meshes as other programs write them, and as attackers do: every way to write one body gives one model; what is
//! not well-formed is refused at the line that is wrong; what is not built is said in a note. If this fails, parts of
//! a mesh vanish without a word, or good files are refused.
#![allow(clippy::cast_possible_truncation, reason = "numbers here are small by construction")]

use crate::prelude::*;
use containers::{RELATIONS, buffer, description, glb, object, packed, text as model_text, threemf};
use std::fmt::Write;

/// Skin, normals and, in a note each, what is missing.
pub(crate) fn build_on(
    folder: &Path,
    name: &str,
    bytes: &[u8],
    grid: GridChoice,
) -> Result<(Vec<u8>, Vec<String>), String> {
    let (path, model) = (put(folder, name, bytes), folder.join("model.oct"));
    let options = BuildOptions { channels: Some(Channels::default().with(Channel::Color)), ..share(8, 1) };
    let report = build_mesh(&[path], &on_grid(grid), &options, &model, &Silent).map_err(|e| e.to_string())?;
    Ok((fs::read(&model).unwrap(), report.notes.iter().map(ToString::to_string).collect()))
}

pub(crate) fn build(folder: &Path, name: &str, bytes: &[u8]) -> Result<(Vec<u8>, Vec<String>), String> {
    build_on(folder, name, bytes, exact_grid([24; 3]))
}

pub(crate) fn body() -> Body {
    Body::octahedron([10.0, 11.5, 9.25], 7.5)
}

pub(crate) fn vertices(body: &Body) -> Vec<[f64; 3]> {
    body.vertices.iter().map(|v| v.map(|c| c as f64 / meshes::STEPS as f64)).collect()
}

pub(crate) fn obj(body: &Body, corner: &dyn Fn(usize) -> String) -> Vec<u8> {
    let mut text = String::new();
    vertices(body).iter().for_each(|[x, y, z]| writeln!(text, "v {x} {y} {z}").unwrap());
    for [a, b, c] in &body.faces {
        writeln!(text, "f {} {} {}", corner(a + 1), corner(b + 1), corner(c + 1)).unwrap();
    }
    text.into_bytes()
}

/// The body as strips of one triangle each, every other one begun at its second corner, so that it is turned over.
fn strips(body: &Body, form: &str) -> Vec<u8> {
    let numbers: Vec<i32> =
        body.faces.iter().flat_map(|f| [f[0] as i32, f[1] as i32, f[2] as i32, -1]).collect();
    let mut file = format!(
        "ply\nformat {form} 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element tristrips 1\nproperty list int int vertex_indices\nend_header\n",
        body.vertices.len()
    )
    .into_bytes();
    if form == "ascii" {
        vertices(body).iter().for_each(|[x, y, z]| file.extend(format!("{x} {y} {z}\n").bytes()));
        let words: Vec<String> = numbers.iter().map(ToString::to_string).collect();
        file.extend(format!("{} {}\n", numbers.len(), words.join(" ")).bytes());
        return file;
    }
    let four = |n: [u8; 4]| if form == "binary_big_endian" { [n[3], n[2], n[1], n[0]] } else { n };
    vertices(body).as_flattened().iter().for_each(|c| file.extend(four((*c as f32).to_le_bytes())));
    let length = i32::try_from(numbers.len()).unwrap();
    [length].iter().chain(&numbers).for_each(|n| file.extend(four(n.to_le_bytes())));
    file
}

/// Every end of a line replaced.
fn lines(text: &[u8], end: &str) -> Vec<u8> {
    String::from_utf8(text.to_vec()).unwrap().replace('\n', end).into_bytes()
}

/// A PLY header whose lines end in CR alone, before the samples.
fn header_lines(ply: Vec<u8>) -> Vec<u8> {
    let end = ply.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    [lines(&ply[..end], "\r"), ply[end..].to_vec()].concat()
}

/// An archive with 64-bit numbers throughout, as lib3mf and .NET write even small ones.
fn zip64(archive: &[u8]) -> Vec<u8> {
    let end = archive.len() - 22;
    let four = |at: usize| u32::from_le_bytes(archive[at..at + 4].try_into().unwrap());
    let (count, list) = (u16::from_le_bytes(archive[end + 10..end + 12].try_into().unwrap()), four(end + 16));
    let mut out = archive[..list as usize].to_vec();
    let mut at = list as usize;
    for _ in 0..count {
        let name = usize::from(archive[at + 28]);
        let mut entry = archive[at..at + 46 + name].to_vec();
        let numbers = [four(at + 24), four(at + 20), four(at + 42)].map(u64::from);
        [20, 24, 42].iter().for_each(|at| entry[*at..at + 4].fill(0xff));
        entry[30..32].copy_from_slice(&33_u16.to_le_bytes());
        // Something else first, then the numbers.
        entry.extend([7, 0, 1, 0, 9, 1, 0, 24, 0]);
        numbers.iter().for_each(|n| entry.extend(n.to_le_bytes()));
        out.extend(entry);
        at += 46 + name;
    }
    let (length, record) = (out.len() as u64 - u64::from(list), out.len() as u64);
    out.extend(b"PK\x06\x06\x2c\0\0\0\0\0\0\0\x2d\0\x2d\0\0\0\0\0\0\0\0\0");
    [count.into(), count.into(), length, list.into()].iter().for_each(|n: &u64| out.extend(n.to_le_bytes()));
    out.extend(b"PK\x06\x07\0\0\0\0");
    out.extend(record.to_le_bytes());
    out.extend(b"\x01\0\0\0PK\x05\x06\0\0\0\0");
    out.extend([0xff; 12]);
    out.extend([0; 2]);
    out
}

/// A text of 3MF with the body as object 1, changed.
pub(crate) fn changed(from: &str, to: &str) -> Vec<u8> {
    let text = model_text("millimeter", &object(&body(), 1, 1.0), "<item objectid=\"1\"/>");
    let text = text.replace("xmlns:p=", "xmlns:x=\"urn:x\" xmlns:p=");
    assert!(text.contains(from), "{from}");
    packed(&text.replacen(from, to, 1), 8)
}

#[test]
fn every_way_to_write_a_body_gives_the_same_model() {
    let folder = tempfile::tempdir().unwrap();
    let body = body();
    let (wanted, _) = build(folder.path(), "a.stl", &body.stl()).unwrap();
    let stl = body.stl_text();
    let off = String::from_utf8(body.off()).unwrap();
    let plain = obj(&body, &|at| at.to_string());
    let slices = "<resources><s:slicestack xmlns:s=\"http://schemas.microsoft.com/3dmanufacturing/slice/2015/07\" \
         id=\"9\"><s:slice><s:vertices><s:vertex x=\"1\" y=\"2\"/></s:vertices></s:slice></s:slicestack>";
    for (what, name, bytes) in [
        ("STL in one line", "a.stl", lines(&stl, " ")),
        (
            "STL, a comment's sign in its name",
            "a.stl",
            String::from_utf8(lines(&stl, " ")).unwrap().replace("a body", "# body").into(),
        ),
        (
            "STL with words in lines of their own",
            "a.stl",
            String::from_utf8(stl.clone())
                .unwrap()
                .replace(' ', "\n")
                .replace("solid\na\nbody", "solid a body")
                .into(),
        ),
        ("STL, capitals", "a.stl", stl.to_ascii_uppercase()),
        ("STL, capitals, by another name", "a.txt", stl.to_ascii_uppercase()),
        ("STL, CR", "a.stl", lines(&stl, "\r")),
        ("STL, CR LF", "a.stl", lines(&stl, "\r\n")),
        ("PLY, CR", "a.ply", lines(&body.ply("ascii"), "\r")),
        ("PLY, CR LF", "a.ply", lines(&body.ply("ascii"), "\r\n")),
        ("PLY, binary, CR", "a.ply", header_lines(body.ply("binary_little_endian"))),
        ("PLY, strips", "a.ply", strips(&body, "ascii")),
        ("PLY, strips, little-endian", "a.ply", strips(&body, "binary_little_endian")),
        ("PLY, strips, big-endian", "a.ply", strips(&body, "binary_big_endian")),
        ("OFF, CR", "a.off", lines(off.as_bytes(), "\r")),
        ("OFF, faces over lines", "a.off", off.replace("\n3 ", "\n3\n").into()),
        ("OBJ", "a.obj", plain.clone()),
        ("OBJ, CR", "a.obj", lines(&plain, "\r")),
        ("OBJ, places and normals of nothing", "a.obj", obj(&body, &|at| format!("{at}/{at}/{at}"))),
        ("3MF", "a.3mf", threemf(&body)),
        ("3MF, ZIP64", "a.3mf", zip64(&threemf(&body))),
        ("3MF, attributes of others", "a.3mf", changed("<vertex x=", "<vertex x:x=\"99\" x=")),
        (
            "3MF, transforms of others",
            "a.3mf",
            changed("<item ", "<item x:transform=\"1 0 0 0 1 0 0 0 1 5 5 5\" "),
        ),
        (
            "3MF, elements of others",
            "a.3mf",
            changed(
                "<vertices>",
                "<x:vertices><vertex x=\"1\" y=\"2\" z=\"3\"/></x:vertices><vertices><x:vertex/>",
            ),
        ),
        (
            "3MF, triangles of others",
            "a.3mf",
            changed("<triangles>", "<triangles><x:triangle v1=\"0\" v2=\"1\" v3=\"5\"/>"),
        ),
        ("3MF, slices with the mesh", "a.3mf", changed("<resources>", slices)),
        ("3MF, all of it with a prefix", "a.3mf", prefixed()),
    ] {
        let (got, _) = build(folder.path(), name, &bytes).unwrap_or_else(|e| panic!("{what}: {e}"));
        assert!(got == wanted, "{what}");
    }
}

/// The core's elements with a prefix, and another namespace without one.
fn prefixed() -> Vec<u8> {
    let mut text = model_text("millimeter", &object(&body(), 1, 1.0), "<item objectid=\"1\"/>");
    for name in [
        "model",
        "resources",
        "object",
        "mesh",
        "vertices",
        "vertex",
        "triangles",
        "triangle",
        "build",
        "item",
    ] {
        for (from, to) in [
            (format!("<{name} "), format!("<c:{name} ")),
            (format!("<{name}>"), format!("<c:{name}>")),
            (format!("</{name}>"), format!("</c:{name}>")),
        ] {
            text = text.replace(&from, &to);
        }
    }
    let text = text.replace("xmlns=", "xmlns=\"urn:x\" xmlns:c=");
    packed(&text.replace("<c:vertices>", "<c:vertices><vertex x=\"0\" y=\"0\" z=\"0\"/>"), 8)
}

#[test]
fn what_is_not_well_formed_is_refused_where_it_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let body = body();
    let stl = String::from_utf8(body.stl_text()).unwrap();
    let off = String::from_utf8(body.off()).unwrap();
    let ply = String::from_utf8(body.ply("ascii")).unwrap();
    let header = ply.lines().position(|line| line == "end_header").unwrap() + 1;
    let lengthened = ply.replacen("\n3 ", " 8\n3 ", 1);
    let face = header + body.vertices.len();
    let short = "cut short";
    let line = |n: usize| format!("line {n} cannot be understood");
    for (what, name, bytes, words) in [
        ("STL without its end", "a.stl", stl.replace("endsolid a body\n", ""), short.into()),
        ("STL, a corner too many", "a.stl", stl.replacen(" endloop", "  vertex 1 2 3\n endloop", 1), line(7)),
        ("STL, a corner too few", "a.stl", stl.replacen(" endloop\n", "", 1), line(7)),
        ("STL, another word", "a.stl", stl.replacen("endfacet", "endface", 1), line(8)),
        ("OFF, a face of -3 corners", "a.off", off.replacen("\n3 ", "\n-3 ", 1), line(10)),
        ("OFF, a short face", "a.off", off.replacen(" 4\n", "\n", 1), line(10)),
        ("PLY, a list of -3 items", "a.ply", ply.replacen("\n3 ", "\n-3 ", 1), line(face + 1)),
        ("PLY, a number too many", "a.ply", lengthened, line(face)),
        ("PLY, a word", "a.ply", ply.replacen("\n7 ", "\n7 x", 1), line(header + 1)),
        ("glTF, empty", "a.gltf", " ".into(), line(1)),
        ("glTF, a buffer of an empty name", "a.gltf", nameless(), "names a file by an empty name".into()),
    ] {
        let said =
            build(folder.path(), name, bytes.as_bytes()).err().unwrap_or_else(|| panic!("{what} was built"));
        assert!(said.contains(&words), "{what}: {words:?} is missing: {said}");
    }
    for (what, from, to, words) in [
        ("an attribute twice", "x=\"10", "x=\"10\" x=\"10", "line 3 cannot be understood"),
        ("a wrong closing tag", "</vertices>", "</vertexes>", "line 3 cannot be understood"),
        ("two elements at the top", "</model>", "</model><model/>", "cannot be understood"),
        (
            "a prefix of nothing",
            "<item ",
            "<item y:transform=\"1 0 0 0 1 0 0 0 1 5 5 5\" ",
            "cannot be understood",
        ),
        ("a path of nothing", "<item ", "<item q:path=\"/3D/a.model\" ", "cannot be understood"),
    ] {
        let said = build(folder.path(), "a.3mf", &changed(from, to))
            .err()
            .unwrap_or_else(|| panic!("{what} was built"));
        assert!(said.contains(words), "{what}: {words:?} is missing: {said}");
    }
    // A record of 64-bit numbers that leads nowhere, and entries whose numbers are missing.
    let whole = zip64(&threemf(&body));
    for at in [whole.len() - 34, whole.len() - 50] {
        let mut wrong = whole.clone();
        wrong[at..at + 8].fill(0xee);
        assert!(build(folder.path(), "a.3mf", &wrong).is_err(), "{at}");
    }
}

fn nameless() -> String {
    let mut described = description(&body());
    described["buffers"][0]["uri"] = json!("");
    described.to_string()
}

/// Bytes of a description and its buffer, with more accessors behind it: each a type, its components and numbers.
fn with_items(mut described: Value, mut bytes: Vec<u8>, items: &[(&str, u32, usize, Vec<u8>)]) -> Vec<u8> {
    for (kind, component, count, data) in items {
        let views = described["bufferViews"].as_array_mut().unwrap();
        let view = json!({"buffer": 0, "byteOffset": bytes.len(), "byteLength": data.len()});
        views.push(view);
        let at = views.len() - 1;
        let accessor = json!({"bufferView": at, "componentType": component, "count": count, "type": kind});
        described["accessors"].as_array_mut().unwrap().push(accessor);
        bytes.extend(data);
        bytes.resize(bytes.len().next_multiple_of(4), 0);
    }
    described["buffers"][0]["byteLength"] = json!(bytes.len());
    glb(&described, &bytes)
}

fn singles(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

#[test]
fn instances_of_gltf_are_built_where_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let grid = exact_grid([40; 3]);
    let small = Body::octahedron([5.0, 6.5, 4.25], 3.5);
    let moved = |by: [i64; 3]| {
        let mut body = small.clone();
        body.vertices.iter_mut().for_each(|v| (0..3).for_each(|a| v[a] += by[a] * meshes::STEPS));
        body
    };
    // Copies at three places of the node's own axes, which are turned upright with it; the last one is twice as large.
    let large = Body {
        vertices: small.vertices.iter().map(|v| v.map(|c| 2 * c)).collect(),
        faces: small.faces.clone(),
    };
    let wanted = moved([0; 3]).with(&moved([20, 3, 1])).with(&{
        let mut body = large;
        body.vertices.iter_mut().for_each(|v| v[2] += 20 * meshes::STEPS);
        body
    });
    let (wanted, _) = build_on(folder.path(), "a.stl", &wanted.stl(), grid).unwrap();
    let mut described = description(&small);
    described["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    described["nodes"][0]["extensions"] =
        json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 2, "ROTATION": 3, "SCALE": 4}}});
    let rotations: Vec<u8> =
        [[0_i8, 0, 0, 127]; 3].as_flattened().iter().map(|b| b.cast_unsigned()).collect();
    let items = [
        ("VEC3", 5126, 3, singles(&[0.0, 0.0, 0.0, 20.0, 3.0, 1.0, 0.0, 0.0, 20.0])),
        ("VEC4", 5120, 3, rotations),
        ("VEC3", 5126, 3, singles(&[1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0])),
    ];
    let mut file = with_items(described.clone(), buffer(&small), &items);
    // Bytes are parts of 127.
    let mark = b"\"componentType\":5120,";
    let at = file.windows(mark.len()).position(|w| w == mark).unwrap();
    file.splice(at..at, *b"\"normalized\":true,");
    let file = reframed(&file);
    let (got, _) = build_on(folder.path(), "a.glb", &file, grid).unwrap();
    assert!(got == wanted, "instances");
    // More triangles than their bytes justify.
    let many = ("VEC3", 5126, 1000, vec![0; 12_000]);
    described["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = json!({"TRANSLATION": 2});
    let primitive = described["meshes"][0]["primitives"][0].clone();
    described["meshes"][0]["primitives"] = vec![primitive; 2000].into();
    let said =
        build_on(folder.path(), "a.glb", &with_items(described, buffer(&small), &[many]), grid).unwrap_err();
    assert!(said.contains("repeats its parts"), "{said}");
}

#[test]
fn transforms_of_gltf_are_read_as_they_are_meant_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let small = Body::octahedron([15.0, 16.5, 14.25], 3.5);
    let build = |node: Value| {
        let mut described = description(&small);
        // Above the node that turns the body upright.
        let upright = described["nodes"][0].clone();
        described["nodes"] = json!([node, upright]);
        described["nodes"][0]["children"] = json!([1]);
        build_on(folder.path(), "a.glb", &glb(&described, &buffer(&small)), exact_grid([40; 3]))
    };
    let same = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
    let mut projective = same;
    projective[3] = 1;
    let unmoved = build(json!({})).unwrap().0;
    assert!(build(json!({"matrix": same})).unwrap().0 == unmoved);
    // A small turn around y, and the same with a length that quantisation explains.
    let turned = build(json!({"rotation": [0, 0.01, 0, 0.99995]})).unwrap().0;
    let quantised = build(json!({"rotation": [0, 0.0102, 0, 1.019_949]})).unwrap().0;
    assert!(turned == quantised);
    for (node, sentence) in [
        (json!({"rotation": [0, 0, 0, 0]}), "quaternion of length 0.000"),
        (json!({"rotation": [0, 0, 1, 1]}), "quaternion of length 1.414"),
        (json!({"matrix": projective}), "last row is not 0, 0, 0, 1"),
        (json!({"matrix": same, "scale": [1, 1, 1]}), "by a matrix and by translation, rotation or scale"),
    ] {
        let said = build(node).unwrap_err();
        assert!(said.contains(sentence), "{said}");
    }
}

#[test]
fn a_skin_of_gltf_bends_its_mesh_as_it_rests() {
    let folder = tempfile::tempdir().unwrap();
    let grid = exact_grid([40; 3]);
    // A skin of two joints: the upper half of a body hangs at a joint that is moved, and the node's own place is nothing.
    let body = Body::cuboid([4.0, 4.0, 4.0], [12.0, 12.0, 20.0]);
    let bent = Body {
        vertices: body
            .vertices
            .iter()
            .map(|v| {
                if v[2] > 10 * meshes::STEPS {
                    [v[0] + 9 * meshes::STEPS, v[1] + 2 * meshes::STEPS, v[2]]
                } else {
                    *v
                }
            })
            .collect(),
        faces: body.faces.clone(),
    };
    let (wanted, _) = build_on(folder.path(), "a.stl", &bent.stl(), grid).unwrap();
    let mut described = description(&body);
    let upright = described["nodes"][0]["matrix"].clone();
    described["nodes"] = json!([
        {"mesh": 0, "skin": 0, "translation": [7, 8, 9]},
        {"matrix": upright, "children": [2]},
        {"translation": [10, 2, 0]},
    ]);
    described["scenes"][0]["nodes"] = json!([0, 1]);
    described["skins"] = json!([{"joints": [1, 2], "inverseBindMatrices": 4}]);
    let attributes = &mut described["meshes"][0]["primitives"][0]["attributes"];
    attributes["JOINTS_0"] = json!(2);
    attributes["WEIGHTS_0"] = json!(3);
    let joints: Vec<u8> = [0, 1, 0, 0].repeat(8);
    let weights: Vec<f32> = body
        .vertices
        .iter()
        .flat_map(|v| if v[2] > 10 * meshes::STEPS { [0.0, 0.5, 0.0, 0.0] } else { [1.0, 0.0, 0.0, 0.0] })
        .collect();
    let mut matrices = [[0.0_f32; 16]; 2];
    for (at, matrix) in matrices.iter_mut().enumerate() {
        [0, 5, 10, 15].iter().for_each(|k| matrix[*k] = 1.0);
        matrix[12] = if at == 1 { -1.0 } else { 0.0 };
    }
    let items = [
        ("VEC4", 5121, 8, joints),
        ("VEC4", 5126, 8, singles(&weights)),
        ("MAT4", 5126, 2, singles(matrices.as_flattened())),
    ];
    let skinned = with_items(described.clone(), buffer(&body), &items);
    let (got, _) = build_on(folder.path(), "a.glb", &skinned, grid).unwrap();
    assert!(got == wanted, "a skin");
    for (what, change) in [("a joint outside the scene", json!([0])), ("joints of nothing", json!([0, 1, 7]))]
    {
        let mut wrong = described.clone();
        wrong["scenes"][0]["nodes"] = change;
        assert!(
            build_on(folder.path(), "a.glb", &with_items(wrong, buffer(&body), &items), grid).is_err(),
            "{what}"
        );
    }
    let mut wrong = items.clone();
    wrong[0].3[0] = 2;
    let said =
        build_on(folder.path(), "a.glb", &with_items(described, buffer(&body), &wrong), grid).unwrap_err();
    assert!(said.contains("a skin or a joint"), "{said}");
}

/// A binary file whose description has grown, with the lengths that it has now.
fn reframed(file: &[u8]) -> Vec<u8> {
    let end = file.windows(4).position(|w| w == b"BIN\0").unwrap() - 4;
    let described: Value = serde_json::from_slice(file[20..end].trim_ascii_end()).unwrap();
    glb(&described, &file[end + 8..])
}

#[test]
fn what_is_not_built_is_said_in_a_note() {
    let folder = tempfile::tempdir().unwrap();
    let body = body();
    let mut morphed = description(&body);
    morphed["meshes"][0]["primitives"][0]["targets"] = json!([{"POSITION": 0}]);
    let still = glb(&morphed, &buffer(&body));
    morphed["nodes"][0]["weights"] = json!([0.5]);
    let textured = String::from_utf8(body.ply("ascii"))
        .unwrap()
        .replace("comment a body", "comment TextureFile a b.png");
    let layers = "<resources><m:multiproperties id=\"8\" pids=\"3 4\"/>";
    let coarse = "<object xmlns:s=\"http://schemas.microsoft.com/3dmanufacturing/slice/2015/07\" s:meshresolution=\"lowres\" ";
    let own: Vec<u8> = model_text("millimeter", &object(&body, 1, 1.0), "<item objectid=\"1\"/>").into();
    let second = RELATIONS.replace("</Relationships>", "<Relationship Target=\"/3D/b.model\" Id=\"s\" Type=\"http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel\"/></Relationships>");
    let starts = archive(&[
        ("3D/a.model", own, 8),
        ("3D/b.model", b"<nothing/>".to_vec(), 0),
        ("_rels/.rels", second.into(), 0),
    ]);
    for (name, bytes, note) in [
        ("a.glb", still, None),
        ("a.glb", glb(&morphed, &buffer(&body)), Some("morph targets")),
        ("a.ply", textured.into(), Some("the texture a b.png, which is not read from PLY")),
        ("a.3mf", changed("<resources>", layers), Some("several layers")),
        ("a.3mf", changed("<object ", coarse), Some("slices, which are not read")),
        ("a.3mf", starts, Some("begins with 2 texts; the first was built")),
        (
            "a.obj",
            obj(&body, &|at| format!("{at}/{at}")),
            Some("places in a texture (vt) that it does not hold"),
        ),
        ("a.obj", obj(&body, &|at| format!("{at}//-1")), Some("normals (vn) that it does not hold")),
    ] {
        let (_, notes) = build(folder.path(), name, &bytes).unwrap_or_else(|e| panic!("{note:?}: {e}"));
        assert_eq!(notes.len(), usize::from(note.is_some()), "{notes:?}");
        assert!(note.is_none_or(|words| notes[0].contains(words)), "{note:?}: {notes:?}");
    }
}

#[test]
fn parts_thinner_than_a_voxel_are_counted_in_a_note() {
    let folder = tempfile::tempdir().unwrap();
    let large = Body::cuboid([1.0; 3], [31.0; 3]);
    let mut text = String::new();
    let mut first = 1;
    // Between two centres; across one; in a corner of its own.
    for (name, body) in [
        ("large", large),
        ("between", Body::cuboid([40.0, 1.0, 1.6], [60.0, 30.0, 2.4])),
        ("across", Body::cuboid([40.0, 1.0, 8.4], [60.0, 30.0, 8.6])),
        ("crumb", Body::octahedron([50.0, 40.0, 20.0], 0.3)),
    ] {
        writeln!(text, "o {name}").unwrap();
        vertices(&body).iter().for_each(|[x, y, z]| writeln!(text, "v {x} {y} {z}").unwrap());
        body.faces
            .iter()
            .for_each(|f| writeln!(text, "f {} {} {}", f[0] + first, f[1] + first, f[2] + first).unwrap());
        first += body.vertices.len();
    }
    let grid = GridChoice::Voxel { edge_mm: 1.0, margin: 1 };
    let (_, notes) = build_on(folder.path(), "a.obj", text.as_bytes(), grid).unwrap();
    let wanted = "a.obj has 4 parts, of which 2 are thinner than a voxel and not in the model; fill surface or smaller voxels keep them";
    assert_eq!(notes, [wanted]);
    let fine = GridChoice::Voxel { edge_mm: 0.1, margin: 1 };
    assert_eq!(build_on(folder.path(), "a.obj", text.as_bytes(), fine).unwrap().1, Vec::<String>::new());
    let mesh = MeshOptions { fill: Some(infobyte::mesh::Fill::Surface), ..on_grid(grid) };
    let report = build_mesh(
        &[folder.path().join("a.obj")],
        &mesh,
        &share(8, 1),
        &folder.path().join("m.oct"),
        &Silent,
    );
    assert_eq!(report.unwrap().notes, []);
}

#[test]
fn a_fin_of_a_body_that_vanishes_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    // A block with a fin of .8 voxel along each axis in turn, between two centres; and one that is met.
    for axis in 0..3 {
        for (low, high, met) in [(1.6, 2.4, false), (1.4, 2.6, true)] {
            let at = |along: f64, thin: f64, wide: f64| {
                let mut place = [wide; 3];
                (place[axis], place[(axis + 1) % 3]) = (along, thin);
                place
            };
            let mut body = Body::cuboid([1.0; 3], [31.0; 3]);
            let fin = Body::cuboid(at(20.0, low, 2.0), at(45.0, high, 30.0));
            let first = body.vertices.len();
            body.vertices.extend(fin.vertices);
            body.faces.extend(fin.faces.iter().map(|face| face.map(|at| at + first)));
            for surface in [SurfaceKind::Skin, SurfaceKind::Cells] {
                let grid = GridChoice::Voxel { edge_mm: 1.0, margin: 1 };
                let input = file(folder.path(), "fin.stl", &body.stl());
                let options = BuildOptions { surface: Some(surface), ..share(8, 2) };
                let model = folder.path().join("m.oct");
                let report = build_mesh(&[input], &on_grid(grid), &options, &model, &Silent).unwrap();
                let notes: Vec<_> = report.notes.iter().map(ToString::to_string).collect();
                let wanted = "fin.stl extends 14 voxels beyond the model: that part is thinner than a voxel; fill surface or smaller voxels keep it";
                assert_eq!(notes, if met { vec![] } else { vec![wanted.to_owned()] }, "{axis} {surface:?}");
            }
        }
    }
}

#[test]
fn an_open_shell_around_nothing_is_told_of_the_fill_that_keeps_it() {
    let folder = tempfile::tempdir().unwrap();
    // A square between two layers of centres: its cap is itself.
    let corners = [[4.0, 4.0], [20.0, 4.0], [20.0, 20.0], [4.0, 20.0]].map(|[x, y]| [x, y, 5.9]);
    let sheet = Body::new(&corners, &[[0, 1, 2], [0, 2, 3]]);
    let input = file(folder.path(), "sheet.stl", &sheet.stl());
    for surface in [SurfaceKind::Skin, SurfaceKind::Cells] {
        let (grid, options) = (exact_grid([24; 3]), BuildOptions { surface: Some(surface), ..share(8, 2) });
        let model = folder.path().join("m.oct");
        let build = |mesh| build_mesh(std::slice::from_ref(&input), &mesh, &options, &model, &Silent);
        let sentence = build(on_grid(grid)).unwrap_err().to_string();
        assert!(sentence.contains("fill surface"), "{surface:?}: {sentence}");
    }
}

/// A body of several balls and boxes, on lattice points that singles hold.
fn random_body(random: &mut Random) -> Body {
    let mut body = Body::default();
    for _ in 0..1 + random.below(4_u32) {
        let mut place = || 8.0 + 24.0 * random.unit();
        let centre = [place(), place(), place()];
        let reach = 2.0 + 5.0 * random.unit();
        body = body.with(&if random.below(2_u32) == 0 {
            Body::sphere(centre, reach, random.below(4_u32))
        } else {
            Body::cuboid(centre.map(|c| c - reach), centre.map(|c| c + reach))
        });
    }
    body
}

#[test]
fn a_random_body_gives_the_same_model_in_every_format() {
    let folder = tempfile::tempdir().unwrap();
    for seed in 0..8 * u64::from(long()) {
        let body = random_body(&mut Random(seed));
        let grid = exact_grid([40; 3]);
        let wanted = build_on(folder.path(), "a.stl", &body.stl(), grid).unwrap().0;
        for (name, bytes) in [
            ("t.stl", body.stl_text()),
            ("t.ply", body.ply("ascii")),
            ("l.ply", body.ply("binary_little_endian")),
            ("b.ply", body.ply("binary_big_endian")),
            ("a.obj", obj(&body, &|at| at.to_string())),
            ("a.off", body.off()),
            ("a.glb", glb(&description(&body), &buffer(&body))),
            ("a.3mf", threemf(&body)),
        ] {
            let got = build_on(folder.path(), name, &bytes, grid)
                .unwrap_or_else(|e| panic!("seed {seed}, {name}: {e}"));
            assert!(got.0 == wanted, "seed {seed}, {name}");
        }
    }
}

/// Skin voxels and their normals.
fn skin_of(model: &[u8]) -> BTreeMap<[u32; 3], [f64; 3]> {
    let model = Model::from_bytes(model).unwrap();
    model.voxels().map(|found| (found.voxel, found.normal.unwrap())).collect()
}

#[test]
fn a_mirrored_or_turned_body_gives_a_mirrored_or_turned_model() {
    const SIDE: u32 = 40;
    let folder = tempfile::tempdir().unwrap();
    for seed in 0..2 * u64::from(long()) {
        let body = random_body(&mut Random(seed));
        let build = |body: &Body| {
            skin_of(&build_on(folder.path(), "a.stl", &body.stl(), exact_grid([SIDE; 3])).unwrap().0)
        };
        let plain = build(&body);
        for symmetry in Symmetry::all().skip(1).step_by(5) {
            let side = i64::from(SIDE) * meshes::STEPS;
            let turned = body.vertices.iter().map(|v| {
                std::array::from_fn(|k| {
                    let c = v[symmetry.from[k]];
                    if symmetry.mirror[k] { side - c } else { c }
                })
            });
            let turned = Body { vertices: turned.collect(), faces: body.faces.clone() };
            let found = build(&if symmetry.is_odd() { turned.reversed() } else { turned });
            assert_eq!(found.len(), plain.len(), "seed {seed}: {symmetry:?}");
            let mut alike = 0;
            for (voxel, normal) in &plain {
                let own = found.get(&symmetry.cell(*voxel, SIDE));
                let own = own.unwrap_or_else(|| panic!("seed {seed}: {symmetry:?}, {voxel:?}"));
                alike += usize::from(dot(*own, symmetry.vector(*normal)) > 0.999);
            }
            // Where two triangles are equally near, either may be the nearest.
            assert!(alike * 100 >= plain.len() * 95, "seed {seed}: {symmetry:?}: {alike} of {}", plain.len());
        }
    }
}

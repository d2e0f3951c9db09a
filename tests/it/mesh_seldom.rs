//! Meshes as other programs seldom write them: forms that are read, numbers that are refused, faces that are not convex.

#![allow(clippy::cast_possible_truncation, reason = "numbers here are small by construction")]
use super::mesh_foreign::{body, build, build_on, changed, obj, vertices};
use crate::prelude::*;
use containers::{RELATIONS, buffer, description, glb, object, text as model_text};

/// An empty line, comments, a mark of the byte order, trailing bytes, lists and orders that are seldom: the same body.
#[test]
fn seldom_forms_give_the_same_model() {
    let folder = tempfile::tempdir().unwrap();
    let body = body();
    let (expected, _) = build(folder.path(), "a.stl", &body.stl()).unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    let (off, stl, ply) = (text(body.off()), text(body.stl_text()), text(body.ply("ascii")));
    let obj = text(obj(&body, &|at| at.to_string()));
    let many = format!("# {}\n\n{off}", "x".repeat(900));
    let counts = &off[off.find(&format!("{} {}", body.vertices.len(), body.faces.len())).unwrap()..];
    let normals = off.lines().enumerate().map(|(at, line)| match at {
        0 => "NOFF\n".into(),
        at if (3..3 + body.vertices.len()).contains(&at) => format!("{line} 0 0 1\n"),
        _ => format!("{line}\n"),
    });
    for (name, bytes) in [
        ("a.off", format!("OFF{counts}")),
        ("a.off", format!("nOFF\n3\n{counts}")),
        ("a.off", format!("# a comment\n\n{off}")),
        ("a.off", many),
        ("a.off", counts.to_owned()),
        ("a.off", normals.collect()),
        ("a.off", format!("\u{feff}{off}")),
        ("a.stl", format!("\u{feff}{stl}")),
        ("a.ply", format!("\u{feff}{ply}")),
        ("a.obj", format!("\u{feff}{obj}")),
        (
            "a.obj",
            obj.lines().map(|l| format!("{l}{}\n", if l.starts_with('v') { " 1" } else { "" })).collect(),
        ),
        ("a.gltf", format!("\u{feff}{}", self::gltf())),
    ] {
        let made =
            build(folder.path(), name, bytes.as_bytes()).unwrap_or_else(|told| panic!("{name}: {told}"));
        assert!(made.0 == expected, "{name}: {}", &bytes[..bytes.len().min(60)]);
    }
    for more in [1, 49, 50, 1000] {
        let (made, notes) = build(folder.path(), "a.stl", &[body.stl(), vec![7; more]].concat()).unwrap();
        let noted = notes.iter().any(|note| note.contains("bytes behind the"));
        assert!(made == expected && noted == (more >= 50), "{more}: {notes:?}");
    }
    for (at, mark) in [(20, &b"COLOR=\xff\0\0\xff"[..]), (84 + 48, b"\x1f\xfc")] {
        let mut colored = body.stl();
        colored[at..at + mark.len()].copy_from_slice(mark);
        let (made, notes) = build(folder.path(), "a.stl", &colored).unwrap();
        assert!(
            made == expected && notes[0].contains("has colours, which are not read from STL"),
            "{notes:?}"
        );
    }
    for (tail, noted) in [
        ("\0", false),
        ("   \n\n", false),
        ("\x1a", false),
        ("\0\0\0\n\0", false),
        ("a comment 1 2\nvertex\n", true),
        ("solid b\nendsolid b\n", false),
        ("a comment\nsolid b\nendsolid b\n", true),
    ] {
        let (made, notes) = build(folder.path(), "a.stl", format!("{stl}{tail}").as_bytes()).unwrap();
        let is_told = notes.iter().any(|note| note.contains("other text behind a solid, in line"));
        assert!(made == expected && is_told == noted, "{tail:?}: {notes:?}");
    }
    let (little, seldom) = ("binary_little_endian", seldom_ply(&body, "binary_big_endian", 2));
    for (ply, most) in [(body.ply(little), 15), (seldom, 13), (seldom_ply(&body, little, 1), usize::MAX)] {
        for more in [0, 1, 12, 13, 14, 15, 1000] {
            let (made, notes) = build(folder.path(), "a.ply", &[&ply[..], &vec![7; more]].concat()).unwrap();
            let noted = notes.iter().any(|note| note.contains("has more behind the"));
            assert!(made == expected && noted == (more >= most), "{more}: {notes:?}");
        }
    }
    let first = ply.lines().position(|line| line == "end_header").unwrap() + 1;
    let packed = ply.lines().enumerate().map(|(at, line)| match line {
        "property float z" => format!("{line}\nproperty uint rgba\n"),
        _ if (first..first + body.vertices.len()).contains(&at) => format!("{line} 4278190080\n"),
        _ => format!("{line}\n"),
    });
    fs::write(folder.path().join("m.mtl"), "newmtl a\nKd 1 0 0\n").unwrap();
    for (name, text, words) in [
        ("a.off", format!("{}\n3 0 1 2\n", off.trim_end()), "has more behind the"),
        ("a.ply", format!("{}\n3 0 1 2\n", ply.trim_end()), "has more behind the"),
        ("a.off", format!("{} 1 0 0\n", off.trim_end()), "has colours, which are not read from OFF"),
        ("a.ply", packed.collect(), "has colours in one number (rgba), which are not read"),
        ("a.obj", format!("mtllib m.mtl m.mtl\n{obj}"), ""),
    ] {
        let (_, notes) = build(folder.path(), name, text.as_bytes()).unwrap();
        let notes = notes.join("; ");
        assert!(notes.contains(words) && !notes.contains("not there"), "{name}: {notes}");
    }
    for form in ["ascii", "binary_little_endian", "binary_big_endian"] {
        for (at, seldom) in
            [seldom_ply(&body, form, 0), seldom_ply(&body, form, 1), seldom_ply(&body, form, 2)]
                .iter()
                .enumerate()
        {
            let (made, _) =
                build(folder.path(), "a.ply", seldom).unwrap_or_else(|told| panic!("{form} {at}: {told}"));
            assert!(made == expected, "{form} {at}");
        }
    }
}

#[test]
fn looks_that_are_not_read_and_hidden_nodes_are_noted() {
    let (folder, body) = (tempfile::tempdir().unwrap(), body());
    let obj = String::from_utf8(obj(&body, &|at| at.to_string())).unwrap();
    let (expected, _) = build(folder.path(), "a.stl", &body.stl()).unwrap();
    let grey = pngs(&Object::new([1, 1, 1], ScalarType::U8, [1.0; 3]), &folder.path().join("png"));
    let png = fs::read(&grey[0]).unwrap();
    let mut hidden = description(&body);
    hidden["scenes"][0]["nodes"] = serde_json::json!([0, 1]);
    hidden["buffers"] = serde_json::from_str::<serde_json::Value>(&gltf()).unwrap()["buffers"].clone();
    let shown = hidden["nodes"][0].clone();
    hidden["nodes"] = serde_json::json!([
        shown,
        {"children": [2], "extensions": {"KHR_node_visibility": {"visible": false}}},
        {"mesh": 0}
    ]);
    for (name, bytes) in
        [("empty.mtl", &b"# empty\n"[..]), ("t.mtl", b"newmtl a\nmap_Kd t.png\n"), ("t.png", &png)]
    {
        fs::write(folder.path().join(name), bytes).unwrap();
    }
    for (name, text, words) in [
        (
            "a.obj",
            format!("mtllib empty.mtl\n{obj}"),
            "takes colours from empty.mtl, which defines no material",
        ),
        ("a.obj", format!("mtllib t.mtl\nusemtl a\n{obj}"), "without places in it (texture coordinates)"),
        ("a.obj", format!("{obj}#MRGB ffff0000ffff0000\n"), "in comments (#MRGB), which are not read"),
        ("a.gltf", hidden.to_string(), "has 1 hidden node (KHR_node_visibility)"),
    ] {
        let (made, notes) = build(folder.path(), name, text.as_bytes()).unwrap();
        assert!(notes.join("; ").contains(words), "{name}: {notes:?}");
        assert!(made == expected || words.contains("texture"), "{name}: {words}");
    }
}

fn gltf() -> String {
    String::from_utf8(containers::gltf(&body())).unwrap()
}

/// A PLY file with another element first that holds lists, a list before x, or faces before vertices.
fn seldom_ply(body: &Body, form: &str, which: usize) -> Vec<u8> {
    let vertex = format!(
        "element vertex {}\n{}property float x\nproperty float y\nproperty float z\n",
        body.vertices.len(),
        if which == 1 { "property list uchar short tags\n" } else { "" }
    );
    let face = format!("element face {}\nproperty list uchar int vertex_index\n", body.faces.len());
    let other = "element other 2\nproperty list uchar float things\nproperty uchar thing\n";
    let head = match which {
        0 => format!("{other}{vertex}{face}"),
        1 => format!("{vertex}{face}{other}"),
        _ => format!("{face}{vertex}"),
    };
    let mut file = format!("ply\nformat {form} 1.0\n{head}end_header\n").into_bytes();
    let (ascii, big) = (form == "ascii", form == "binary_big_endian");
    let number = |file: &mut Vec<u8>, kind: char, value: f64| {
        let bytes = match kind {
            'c' => vec![value as u8],
            's' => (value as i16).to_le_bytes().to_vec(),
            'i' => (value as i32).to_le_bytes().to_vec(),
            _ => (value as f32).to_le_bytes().to_vec(),
        };
        match (ascii, big) {
            (true, _) => file.extend(format!("{value} ").bytes()),
            (_, true) => file.extend(bytes.iter().rev()),
            _ => file.extend(bytes),
        }
    };
    let end = |file: &mut Vec<u8>| {
        if ascii {
            file.push(b'\n')
        }
    };
    let others = |file: &mut Vec<u8>| {
        for count in [3, 0] {
            number(file, 'c', f64::from(count));
            (0..count).for_each(|at| number(file, 'f', f64::from(at) + 0.5));
            number(file, 'c', 7.0);
            end(file);
        }
    };
    let faces = |file: &mut Vec<u8>| {
        for face in &body.faces {
            number(file, 'c', 3.0);
            face.iter().for_each(|at| number(file, 'i', *at as f64));
            end(file);
        }
    };
    if which == 0 {
        others(&mut file);
    } else if which == 2 {
        faces(&mut file);
    }
    for (at, vertex) in vertices(body).iter().enumerate() {
        if which == 1 {
            number(&mut file, 'c', (at % 3) as f64);
            (0..at % 3).for_each(|tag| number(&mut file, 's', tag as f64));
        }
        vertex.iter().for_each(|c| number(&mut file, 'f', *c));
        end(&mut file);
    }
    if which < 2 {
        faces(&mut file);
    }
    if which == 1 {
        others(&mut file);
    }
    file
}

/// What is not a number, or one too many, is not read as something else.
#[test]
fn misread_numbers_are_refused_with_their_line() {
    let folder = tempfile::tempdir().unwrap();
    let solid = |corner: &str, normal: &str| {
        format!(
            "solid a\nfacet normal {normal}\nouter loop\nvertex {corner}\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n"
        )
    };
    let obj = |line: &str| format!("v 0 0 0\nv 1 0 0\nv 0 1 0\n{line}\nf 1 2 3\n");
    let off = |vertex: &str, face: &str| format!("OFF\n3 1 0\n{vertex}\n1 0 0\n0 1 0\n{face}\n");
    let utf16 = |text: &str| text.encode_utf16().flat_map(u16::to_le_bytes).collect::<Vec<u8>>();
    std::fs::write(folder.path().join("a.mtl"), "newmtl a\nKd 0,5 1 1\n").unwrap();
    std::fs::write(folder.path().join("b.mtl"), "newmtl a\nKd 200 0.5 1\n").unwrap();
    for (name, bytes, words) in [
        ("a.stl", solid("0,5 0 0", "0 0 1").into_bytes(), "line 4 cannot be understood: `0,5` is not a number"),
        ("a.stl", solid("0 0 0 0", "0 0 1").into_bytes(), "line 4 cannot be understood: `0` is one number more"),
        ("a.stl", solid("0 0 0", "0,0 0,0 1,0").into_bytes(), "line 2 cannot be understood: `0,0` is not a number"),
        ("a.obj", obj("v 1,5 0 0").into_bytes(), "line 4 cannot be understood: `1,5` is not a number"),
        ("a.obj", obj("v 1 0").into_bytes(), "line 4 cannot be understood: a vertex has 2 numbers"),
        ("a.obj", obj("v 1 0 0 1 1").into_bytes(), "line 4 cannot be understood: a vertex has 5 numbers"),
        ("a.obj", obj("vn 0 0 1 1").into_bytes(), "line 4 cannot be understood: a normal has 4 numbers"),
        ("a.obj", obj("vt 0,5 1").into_bytes(), "line 4 cannot be understood: `0,5` is not a number"),
        ("a.obj", obj("mtllib a.mtl").into_bytes(), "names a.mtl: line 2 cannot be understood: `0,5` is not a number"),
        ("a.obj", obj("mtllib b.mtl").into_bytes(), "names b.mtl: line 2 cannot be understood: 200 is not a part of a colour, from 0 to 1"),
        ("a.obj", b"v 0 0 0 128 64 0\nv 1 0 0 128 64 0\nv 0 1 0 128 64 0\nf 1 2 3\n".to_vec(), "128 is not a part of a colour"),
        ("a.obj", b"v 0 0 0 0 -1 0\nv 1 0 0 0 -1 0\nv 0 1 0 0 -1 0\nf 1 2 3\n".to_vec(), "-1 is not a part of a colour"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float x\n".to_vec(), "line 5 of its header cannot be understood"),
        ("a.off", off("0,5 0 0", "3 0 1 2").into_bytes(), "line 3 cannot be understood: `0,5` is not a number"),
        ("a.off", off("0 0 0 0", "3 0 1 2").into_bytes(), "line 3 cannot be understood: a vertex"),
        ("a.off", off("0 0 0", "3 0 1 2 1 2").into_bytes(), "line 6 cannot be understood: the colour of a face"),
        ("a.off", b"OFF BINARY\n\0\0\0\x08\0\0\0\x06\0\0\0\0".to_vec(), "is binary OFF"),
        ("a.off", b"4OFF\n1 1 0\n".to_vec(), "is OFF of 4 coordinates"),
        ("a.off", b"nOFF\n5\n1 1 0\n".to_vec(), "is OFF of 5 coordinates"),
        ("a.off", b"4nOFF\n3\n1 1 0\n".to_vec(), "is OFF of 4 coordinates"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty int red\nproperty int green\nproperty int blue\nelement face 1\nproperty list uchar int vertex_index\nend_header\n0 0 0 255 0 0\n1 0 0 255 0 0\n0 1 0 255 0 0\n3 0 1 2\n".to_vec(), "255 is not a part of a colour: these are uchar (0 to 255)"),
        ("a.ply", seldom_ply(&body(), "ascii", 0).iter().map(|b| if *b == b'.' { b',' } else { *b }).collect(), "is not a number"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n".to_vec(), "has no faces"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\n".to_vec(), "has no faces"),
        ("a.3mf", changed("x=\"10", "x=\"1,0"), "line 3 cannot be understood: x: `1,0"),
        ("a.3mf", changed("objectid=\"1\"", "objectid=\"1\" transform=\"1,0 0 0 0 1 0 0 0 1 0 0 0\""), "which is not 12 numbers"),
        ("a.gltf", br#"{"asset": {"version": "1.0"}, "meshes": {}}"#.to_vec(), "is glTF of version 1"),
        ("a.gltf", br#"{"meshes": {"a": {"primitives": []}}}"#.to_vec(), "is glTF of version 1"),
        ("a.obj", [&[0xff, 0xfe][..], &utf16("v 0 0 0\n")].concat(), "UTF-16"),
        ("a.off", utf16("OFF\n1 1 0\n"), "UTF-16"),
        ("a.ply", [&[0xff, 0xfe][..], &utf16("ply\n")].concat(), "UTF-16"),
        ("a.gltf", [&[0xff, 0xfe][..], &utf16("{ }")].concat(), "UTF-16"),
    ] {
        let told = build(folder.path(), name, &bytes).err().unwrap_or_else(|| panic!("{words}: was built"));
        assert!(told.contains(words), "{words:?} is missing: {told}");
    }
}

/// Supports, and what slicers' side files mark, are not part of a model.
#[test]
fn supports_are_left_out_with_a_note() {
    let folder = tempfile::tempdir().unwrap();
    let (body, other) = (body(), Body::octahedron([10.0, 11.5, 9.25], 9.0));
    let (expected, _) = build(folder.path(), "a.stl", &body.stl()).unwrap();
    let both = |kind: &str, items: &str| {
        let support = object(&other, 2, 1.0).replace("type=\"model\"", kind);
        model_text("millimeter", &format!("{}{support}", object(&body, 1, 1.0)), items)
    };
    let items = "<item objectid=\"1\"/><item objectid=\"2\"/>";
    // One mesh of both, of which a side file marks the second, and an object of two components.
    let joined = {
        let mut both = body.clone();
        let first = both.vertices.len();
        both.vertices.extend(&other.vertices);
        both.faces.extend(other.faces.iter().map(|face| face.map(|at| at + first)));
        model_text("millimeter", &object(&both, 1, 1.0), "<item objectid=\"1\"/>")
    };
    let count = body.faces.len();
    let volume = |from: usize, to: usize, kind: &str| {
        format!(
            "<volume firstid=\"{from}\" lastid=\"{to}\"><metadata type=\"volume\" key=\"volume_type\" value=\"{kind}\"/></volume>"
        )
    };
    let prusa = |kind: &str| {
        format!(
            "<config><object id=\"1\">{}{}</object></config>",
            volume(0, count - 1, "ModelPart"),
            volume(count, 2 * count - 1, kind)
        )
    };
    let components = model_text(
        "millimeter",
        &format!(
            "{}{}<object id=\"3\"><components><component objectid=\"1\"/><component objectid=\"2\"/></components></object>",
            object(&body, 1, 1.0),
            object(&other, 2, 1.0)
        ),
        "<item objectid=\"3\"/>",
    );
    let bambu = "<config><object id=\"3\"><part id=\"1\" subtype=\"normal_part\"></part><part id=\"2\" subtype=\"support_blocker\"></part></object></config>";
    let cura = |mark: &str, value: &str| {
        let text = both("type=\"model\"", items);
        let at = text.rfind("<mesh>").unwrap();
        let group = format!(
            "<metadatagroup><metadata name=\"cura:{mark}\" type=\"xs:string\"> {value}\n</metadata></metadatagroup>"
        );
        format!("{}{group}{}", &text[..at], &text[at..])
    };
    for (what, text, side) in [
        ("a support", both("type=\"support\"", items), None),
        ("a support of Cura", cura("support_mesh", "True"), None),
        ("a blocker of Cura", cura("anti_overhang_mesh", "true"), None),
        ("a modifier of Cura", cura("infill_mesh", "True"), None),
        ("a cut volume of Cura", cura("cutting_mesh", "True"), None),
        ("a solid support", both("type=\"solidsupport\"", items), None),
        ("another object", both("type=\"other\"", items), None),
        ("a quoted mark of Cura", cura("support_mesh", "<!-- a -->\n <![CDATA[ True]]>"), None),
        ("not printed", both("", "<item objectid=\"1\"/><item objectid=\"2\" printable=\"0\"/>"), None),
        (
            "not printed either",
            both("", "<item objectid=\"1\"/><item objectid=\"2\" printable=\"false\"/>"),
            None,
        ),
        ("a blocker", joined.clone(), Some(("Metadata/Slic3r_PE_model.config", prusa("SupportBlocker")))),
        ("a modifier", joined, Some(("Metadata/Slic3r_PE_model.config", prusa("ParameterModifier")))),
        ("a component", components, Some(("Metadata/model_settings.config", bambu.to_owned()))),
    ] {
        let mut parts = vec![("_rels/.rels", RELATIONS.into(), 8), ("3D/a.model", text.into(), 8)];
        parts.extend(side.map(|(name, text)| (name, text.into(), 8)));
        let (made, notes) = build(folder.path(), "a.3mf", &containers::archive(&parts))
            .unwrap_or_else(|told| panic!("{what}: {told}"));
        assert!(made == expected, "{what}");
        assert!(notes.iter().any(|note| note.contains("left out")), "{what}: {notes:?}");
        assert!(!notes.iter().any(|note| note.contains("in 2 parts")), "{what}: {notes:?}");
    }
    let metadata =
        "<metadatagroup><metadata name=\"cura:support_mesh\">True</metadata></metadatagroup></item>";
    let of_item = both("", &format!("<item objectid=\"1\"/><item objectid=\"2\">{metadata}"));
    for text in [cura("support_mesh", "False"), cura("drop_to_buildplate", "True"), of_item] {
        let parts = [("_rels/.rels", RELATIONS.into(), 8), ("3D/a.model", text.into(), 8)];
        let (made, notes) = build(folder.path(), "a.3mf", &containers::archive(&parts)).unwrap();
        assert!(made != expected && notes.is_empty(), "{notes:?}");
    }
    let no = both("", "<item objectid=\"1\"/><item objectid=\"2\" printable=\"no\"/>");
    let parts = [("_rels/.rels", RELATIONS.into(), 8), ("3D/a.model", no.into(), 8)];
    let told = build(folder.path(), "a.3mf", &containers::archive(&parts)).unwrap_err().to_string();
    assert!(told.contains("`printable` is `no`"), "{told}");
    let parts =
        [("_rels/.rels", RELATIONS.into(), 8), ("3D/a.model", both("type=\"suport\"", items).into(), 8)];
    let (_, notes) = build(folder.path(), "a.3mf", &containers::archive(&parts)).unwrap();
    assert!(notes.iter().any(|note| note.contains("the type suport")), "{notes:?}");
}

/// A notch of a face that is not convex stays open: the prism of a U, whichever corner its faces begin with.
#[test]
fn faces_that_are_not_convex_are_cut_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let outline = [
        [1.0, 1.0],
        [21.0, 1.0],
        [21.0, 19.0],
        [18.0, 19.0],
        [18.0, 4.5],
        [4.0, 4.5],
        [4.0, 19.0],
        [1.0, 19.0],
    ];
    let vertices: Vec<[f64; 3]> = [2.0, 6.5].iter().flat_map(|z| outline.map(|[x, y]| [x, y, *z])).collect();
    let cut = [[0, 1, 4], [0, 4, 5], [1, 2, 3], [1, 3, 4], [0, 5, 6], [0, 6, 7]];
    let walls = (0..8).flat_map(|at| {
        let next = (at + 1) % 8;
        [[at, next, next + 8], [at, next + 8, at + 8]]
    });
    let caps = cut.iter().flat_map(|[a, b, c]| [[*a, *c, *b], [a + 8, b + 8, c + 8]]);
    let body = Body::new(&vertices, &walls.chain(caps).collect::<Vec<_>>());
    let of_fill = |name: &str, bytes: &[u8]| {
        let (path, model) = (put(folder.path(), name, bytes), folder.path().join("model.oct"));
        let mesh = MeshOptions { fill: Some(infobyte::mesh::Fill::Surface), ..on_grid(exact_grid([24; 3])) };
        build_mesh(&[path], &mesh, &share(8, 1), &model, &Silent).unwrap();
        fs::read(model).unwrap()
    };
    let expected = of_fill("a.stl", &body.stl());
    for first in 0..8 {
        let cap = |below: bool| -> Vec<usize> {
            let turned = (0..8).map(|at| (at + first) % 8);
            if below { turned.rev().collect() } else { turned.map(|at| at + 8).collect() }
        };
        let wall = |at: usize| vec![at, (at + 1) % 8, (at + 1) % 8 + 8, at + 8];
        let faces: Vec<Vec<usize>> = [cap(true), cap(false)].into_iter().chain((0..8).map(wall)).collect();
        let lines = |from: usize, count: bool| {
            faces.iter().fold(String::new(), |text, face| {
                let corners: Vec<String> = face.iter().map(|at| (at + from).to_string()).collect();
                text + &format!(
                    "{}{}\n",
                    if count { format!("{} ", face.len()) } else { "f ".into() },
                    corners.join(" ")
                )
            })
        };
        let points = |mark: &str| {
            vertices.iter().fold(String::new(), |text, [x, y, z]| text + &format!("{mark}{x} {y} {z}\n"))
        };
        let header = |form: &str| {
            format!(
                "ply\nformat {form} 1.0\nelement vertex 16\nproperty float x\nproperty float y\nproperty float z\nelement face 10\nproperty list uchar int vertex_index\nend_header\n"
            )
        };
        let mut binary = header("binary_little_endian").into_bytes();
        vertices.as_flattened().iter().for_each(|c| binary.extend((*c as f32).to_le_bytes()));
        for face in &faces {
            binary.push(face.len() as u8);
            face.iter().for_each(|at| binary.extend((*at as u32).to_le_bytes()));
        }
        for (name, bytes) in [
            ("a.obj", (points("v ") + &lines(1, false)).into_bytes()),
            ("a.off", (format!("OFF\n16 10 0\n{}{}", points(""), lines(0, true))).into_bytes()),
            ("a.ply", (header("ascii") + &points("") + &lines(0, true)).into_bytes()),
            ("b.ply", binary),
        ] {
            assert!(of_fill(name, &bytes) == expected, "{name}, from corner {first}");
        }
    }
}

/// The sides of a closed box are no parts that vanish; a closed sliver beside it is one.
#[test]
fn open_parts_of_a_closed_mesh_are_not_missed() {
    let folder = tempfile::tempdir().unwrap();
    let obj = |body: &Body, apart: bool, from: usize| {
        let points =
            vertices(body).iter().fold(String::new(), |text, [x, y, z]| text + &format!("v {x} {y} {z}\n"));
        body.faces.iter().enumerate().fold(points, |text, (at, [a, b, c])| {
            let group = if apart {
                format!("g side{}\n", at / 2)
            } else if at == 0 {
                "g all\n".into()
            } else {
                String::new()
            };
            text + &format!("{group}f {} {} {}\n", a + from, b + from, c + from)
        })
    };
    let grid = GridChoice::Side { voxels: 24, margin: 1 };
    let notes = |text: &str| build_on(folder.path(), "a.obj", text.as_bytes(), grid).unwrap().1;
    let thin = |notes: &[String]| notes.iter().any(|note| note.contains("thinner than a voxel"));
    let cube = obj(&Body::cuboid([0.0; 3], [9.0; 3]), true, 1);
    assert!(!thin(&notes(&cube)), "{:?}", notes(&cube));
    let both = cube + &obj(&Body::cuboid([2.0, 2.0, 12.01], [7.0, 7.0, 12.05]), false, 9);
    assert!(thin(&notes(&both)), "{:?}", notes(&both));
}

/// The cap that a refusal states is one in which the mesh is built.
#[test]
fn a_stated_cap_works() {
    let folder = tempfile::tempdir().unwrap();
    let mut described = description(&body());
    // A node and a mesh for each of many parts.
    let (node, mesh) = (described["nodes"][0].clone(), described["meshes"][0].clone());
    let many = 1500;
    described["nodes"] = (0..many)
        .map(|at| {
            let mut node = node.clone();
            node["mesh"] = json!(at);
            node
        })
        .collect();
    described["meshes"] = (0..many).map(|_| mesh.clone()).collect();
    described["scenes"] = json!([{"nodes": (0..many).collect::<Vec<u32>>()}]);
    let path = put(folder.path(), "a.glb", &glb(&described, &buffer(&body())));
    let build = |bytes: u64| {
        let options = BuildOptions { memory: MemoryCap::Share(bytes), threads: 1, ..BuildOptions::default() };
        build_mesh(
            std::slice::from_ref(&path),
            &on_grid(exact_grid([24; 3])),
            &options,
            &folder.path().join("m.oct"),
            &Silent,
        )
    };
    let refused = build(3 << 20).unwrap_err();
    let stated = refused.minimum_bytes().unwrap_or_else(|| panic!("{refused}"));
    build(stated).unwrap();
}

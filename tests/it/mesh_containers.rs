//! glTF and 3MF hold meshes within descriptions: what these say of places, units and parts gives the same model as
//! the triangles written out, and whatever else they say is refused in a sentence, in time and within memory.

use crate::prelude::*;
use containers::{buffer, description, gltf, object, packed, text, threemf};
use infobyte::csg::read_tree;

fn exact(side: u32) -> MeshOptions {
    on_grid(exact_grid([side; 3]))
}

fn build(folder: &Path, name: &str, bytes: &[u8], mesh: &MeshOptions) -> Result<Vec<u8>, String> {
    let (path, model) = (put(folder, name, bytes), folder.join("model.oct"));
    build_mesh(&[path], mesh, &share(8, 1), &model, &Silent).map_err(|e| e.to_string())?;
    Ok(fs::read(&model).unwrap())
}

fn body() -> Body {
    Body::octahedron([10.0, 11.5, 9.25], 7.5)
}

#[test]
fn every_way_to_write_a_body_gives_the_same_model() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let body = body();
    let wanted = build(at, "a.stl", &body.stl(), &exact(24)).unwrap();
    let same = |name: &str, bytes: &[u8], what: &str| {
        let got = build(at, name, bytes, &exact(24)).unwrap_or_else(|e| panic!("{what}: {e}"));
        assert!(got == wanted, "{what}");
    };
    let (described, bytes) = (description(&body), buffer(&body));
    same("a.glb", &glb(&described, &bytes), "binary");
    same("a.gltf", &gltf(&body), "text with its data");
    // A buffer beside it, whose name has a blank.
    let mut beside = described.clone();
    beside["buffers"][0]["uri"] = json!("its%20data.bin");
    fs::write(at.join("its data.bin"), &bytes).unwrap();
    same("b.gltf", beside.to_string().as_bytes(), "text with its data beside it");
    // Metres, y up, in nodes within nodes, which mirror twice.
    let mut placed = described.clone();
    placed["nodes"] = json!([
        {"children": [1], "scale": [-0.001, 0.001, 0.001]},
        {"mesh": 0, "matrix": [-1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1]},
    ]);
    same("a.glb", &glb(&placed, &bytes), "nodes");
    // Mirrored once, and written mirrored: the direction of faces does not matter to what is inside.
    let mirrored = json!([{"mesh": 0, "translation": [0.020, 0, 0], "scale": [-1, 1, 1], "children": []}]);
    let other = Body {
        vertices: body.vertices.iter().map(|[x, y, z]| [20 * 4096 - x, *z, -*y]).collect(),
        faces: body.faces.clone(),
    };
    let mut reflected = described.clone();
    reflected["nodes"] = mirrored;
    reflected["nodes"][0]["scale"] = json!([-0.001, 0.001, 0.001]);
    same("a.glb", &glb(&reflected, &buffer(&other)), "mirrored");
    // Corners written out, as strips and as fans.
    let corners: Vec<[i64; 3]> = body.faces.iter().flatten().map(|at| body.vertices[*at]).collect();
    let loose = Body { faces: (0..8).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(), vertices: corners };
    let mut plain = description(&loose);
    plain["meshes"][0]["primitives"][0].as_object_mut().unwrap().remove("indices");
    same("a.glb", &glb(&plain, &buffer(&loose)), "without corners");
    for mode in [5, 6] {
        let mut parts = description(&loose);
        let primitive = |t: usize| json!({"attributes": {"POSITION": 2 + t}, "mode": mode});
        let view = |t: usize| json!({"bufferView": 0, "byteOffset": 36 * t, "componentType": 5126, "count": 3, "type": "VEC3"});
        parts["meshes"][0]["primitives"] = (0..8).map(primitive).collect();
        let accessors = parts["accessors"].as_array_mut().unwrap();
        accessors.extend((0..8).map(view));
        same("a.glb", &glb(&parts, &buffer(&loose)), "strips and fans");
    }
    // 3MF: packed or not, in another unit, of parts that are moved.
    same("a.3mf", &threemf(&body), "3MF");
    let plain = text("centimeter", &object(&body, 7, 10.0), "<item objectid=\"7\"/>");
    same("a.3mf", &packed(&plain, 0), "3MF in centimetres");
    let moved = Body {
        vertices: body.vertices.iter().map(|[x, y, z]| [y - 4096, *x, *z]).collect(),
        faces: body.faces.iter().map(|[a, b, c]| [*a, *c, *b]).collect(),
    };
    let parts = format!(
        "{}<object id=\"2\"><components><component objectid=\"1\" transform=\"0 1 0 1 0 0 0 0 1 0 1 -3\"/></components></object>",
        object(&moved, 1, 1.0)
    );
    let whole = text("millimeter", &parts, "<item objectid=\"2\" transform=\"1 0 0 0 1 0 0 0 1 0 0 3\"/>");
    same("a.3mf", &packed(&whole, 8), "parts");
    let path = text("millimeter", "", "<item objectid=\"1\" p:path=\"/3D/other.model\"/>");
    let other = text("millimeter", &object(&body, 1, 1.0), "");
    let several = archive(&[
        ("3D/other.model", other.into(), 8),
        ("_rels/.rels", containers::RELATIONS.into(), 0),
        ("3D/a.model", path.into(), 8),
    ]);
    same("a.3mf", &several, "texts that name others");
}

#[test]
fn a_file_that_states_its_unit_keeps_it() {
    let folder = tempfile::tempdir().unwrap();
    let inches = MeshOptions { unit_mm: 25.4, ..exact(24) };
    for (name, bytes) in
        [("a.glb", glb(&description(&body()), &buffer(&body()))), ("a.3mf", threemf(&body()))]
    {
        let plain = build(folder.path(), name, &bytes, &exact(24)).unwrap();
        let asked = build(folder.path(), name, &bytes, &inches).unwrap();
        // But for the last digit of a product.
        assert_eq!(plain.len(), asked.len(), "{name}");
    }
}

/// A description with a change, as a file.
fn changed(change: &dyn Fn(&mut Value)) -> Vec<u8> {
    let mut described = description(&body());
    change(&mut described);
    glb(&described, &buffer(&body()))
}

#[test]
fn what_cannot_be_read_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |name: &str, bytes: &[u8], words: &str| {
        let said = build(folder.path(), name, bytes, &exact(24))
            .err()
            .unwrap_or_else(|| panic!("{words} was built"));
        assert!(said.contains(words) && !said.contains('\n'), "{words:?} is missing: {said}");
    };
    type Change = (&'static str, fn(&mut Value));
    let changes: [Change; 21] = [
        ("Draco", |d| d["extensionsRequired"] = json!(["KHR_draco_mesh_compression"])),
        ("meshopt", |d| d["extensionsRequired"] = json!(["EXT_meshopt_compression"])),
        ("meshopt", |d| d["bufferViews"][0]["extensions"] = json!({"EXT_meshopt_compression": {}})),
        ("the extension EXT_new", |d| d["extensionsRequired"] = json!(["EXT_new"])),
        ("sparse", |d| d["accessors"][0]["sparse"] = json!({"count": 1})),
        ("without bytes", |d| drop(d["accessors"][0].as_object_mut().unwrap().remove("bufferView"))),
        ("version 1.0", |d| d["asset"]["version"] = json!("1.0")),
        ("a reader of glTF 2.1", |d| d["asset"]["minVersion"] = json!("2.1")),
        ("a reader of glTF new", |d| d["asset"]["minVersion"] = json!("new")),
        ("states 4000000000 elements", |d| d["accessors"][0]["count"] = json!(4_000_000_000_u32)),
        ("states 4000000000 bytes", |d| d["buffers"][0]["byteLength"] = json!(4_000_000_000_u32)),
        ("a view of a buffer", |d| d["bufferViews"][0]["byteOffset"] = json!(u64::MAX)),
        ("a view of a buffer", |d| d["bufferViews"][0]["byteStride"] = json!(4)),
        ("an accessor", |d| d["accessors"][0]["type"] = json!("MAT4")),
        ("a node", |d| d["scenes"][0]["nodes"] = json!([7])),
        ("a mesh", |d| d["nodes"][0]["mesh"] = json!(1)),
        ("contain themselves", |d| d["nodes"][0]["children"] = json!([0])),
        ("infinite", |d| d["nodes"] = json!([{"mesh": 0, "scale": [1e308, 1, 1]}])),
        ("not below its own folder", |d| d["buffers"][0]["uri"] = json!("../a.bin")),
        ("cannot be read", |d| d["buffers"][0]["uri"] = json!("none.bin")),
        ("not well-formed base64", |d| d["buffers"][0]["uri"] = json!("data:;base64,***")),
    ];
    for (words, change) in changes {
        refused("a.glb", &changed(&change), words);
    }
    refused("a.glb", &changed(&|d| d["accessors"][1]["count"] = json!(0)), "states 0 elements");
    // A corner beyond the vertices.
    let mut bytes = glb(&description(&body()), &buffer(&body()));
    let last = bytes.len() - 1;
    bytes[last] = 9;
    refused("a.glb", &bytes, "names a vertex that does not exist (6 are stated)");
    refused("a.gltf", b"{\"asset\": {\"version\": \"2.0\"},\n", "line 2 cannot be understood");
    refused("a.gltf", format!("{}{}", "[".repeat(5000), "]".repeat(5000)).as_bytes(), "line 1");
    // Many copies of one mesh, and a description of very many parts.
    let repeated = |count: usize| {
        changed(&|d| {
            d["nodes"] = (0..count).map(|_| json!({"mesh": 0})).collect();
            d["scenes"][0]["nodes"] = (0..count).collect();
            d["meshes"][0]["primitives"] =
                (0..count).map(|_| json!({"attributes": {"POSITION": 0}, "indices": 1})).collect();
        })
    };
    refused("a.glb", &repeated(2000), "repeats its parts");
    refused("a.glb", &repeated(20_000), "is too small");
    #[cfg(unix)]
    {
        symlink("/dev/null", folder.path().join("linked.bin")).unwrap();
        refused("a.glb", &changed(&|d| d["buffers"][0]["uri"] = json!("linked.bin")), "follow_links");
    }
    let model = |resources: &str, items: &str| packed(&text("millimeter", resources, items), 8);
    let own = object(&body(), 1, 1.0);
    let item = "<item objectid=\"1\"/>";
    for (words, bytes) in [
        ("does not hold a triangle", model(&own, "")),
        ("an object that does not exist", model(&own, "<item objectid=\"2\"/>")),
        (
            "a part of the archive that does not exist",
            model(&own, "<item objectid=\"1\" p:path=\"/none.model\"/>"),
        ),
        ("does not exist (6 are stated)", model(&own.replace("v3=\"4\"", "v3=\"4000000000\""), item)),
        ("line 3 cannot be understood", model(&own.replace("x=\"", "x=\"a"), item)),
        ("infinite or not a number", model(&own.replace("x=\"10", "x=\"nan"), item)),
        (
            "nest too deep",
            model("<object id=\"1\"><components><component objectid=\"1\"/></components></object>", item),
        ),
        (
            "repeats its parts",
            model(
                &(2..40).fold(own.clone(), |all, id| {
                    let part = format!("<component objectid=\"{}\"/>", id - 1);
                    format!("{all}<object id=\"{id}\"><components>{part}{part}</components></object>")
                }),
                "<item objectid=\"39\"/>",
            ),
        ),
        ("beams", model("<object id=\"1\"><mesh><b:beamlattice xmlns:b=\"urn:b\"/></mesh></object>", item)),
        ("cannot be understood", packed("<!DOCTYPE a [<!ENTITY b \"c\">]><model/>", 8)),
        ("UTF-16", packed("\u{0}<", 0)),
        ("would unpack", packed(&text("millimeter", &"<object id=\"1\"/>".repeat(500_000), item), 8)),
        ("archive that is damaged", threemf(&body())[..300].to_vec()),
        ("a part of the archive", archive(&[("3D/b.model", vec![1], 0)])),
        (
            "requires the extension urn:x",
            packed(&text("millimeter", &own, item).replace("=\"p m\"", "=\"q\" xmlns:q=\"urn:x\""), 8),
        ),
    ] {
        refused("a.3mf", &bytes, words);
    }
    let mut encrypted = threemf(&body());
    let entry = encrypted.windows(4).rposition(|w| w == b"PK\x01\x02").unwrap();
    encrypted[entry + 8] |= 1;
    refused("a.3mf", &encrypted, "encrypted");
    let mut packing = threemf(&body());
    packing[entry + 10] = 12;
    refused("a.3mf", &packing, "method 12");
    // A checksum that does not fit.
    let mut wrong = threemf(&body());
    wrong[entry + 16] ^= 1;
    refused("a.3mf", &wrong, "archive that is damaged");
}

/// Builds a file in a small grid, as what its name says.
fn attempt(folder: &Path, name: &str, bytes: &[u8], mesh: &MeshOptions) -> Result<(), String> {
    if !name.ends_with("csg") {
        return build(folder, name, bytes, mesh).map(|_| ());
    }
    let path = folder.join(name);
    fs::write(&path, bytes).unwrap();
    let options = share(8, 1);
    let csg = CsgOptions { grid: Some(mesh.grid), unit_mm: 1.0 };
    let (tree, root) = read_tree(&path, options.memory).map_err(|e| e.to_string())?;
    let input = CsgInput { tree, root, name: path, volumes: Vec::new() };
    let model = folder.join("model.oct");
    build_csg(input, &csg, &options, &model, &Silent).map(|_| ()).map_err(|e| e.to_string())
}

/// A tree of most modules.
const TREE: &str = "difference() {
  union() { multmatrix([[1,0,0,3],[0,1,0,0.5],[0,0,1,0],[0,0,0,1]]) { sphere($fn = 0, r = 2); }
    offset3d(r = 0.5) cube(size = [1, 2, 3], center = true);
    linear_extrude(height = 2) { polygon(points = [[0,0],[3,0],[0,3]], paths = undef); } }
  halfspace([0, 0, 1], -1.5);
  intersection() { torus(2, 0.4); cylinder($fn = 5, h = 1, r1 = 1, r2 = 0.2); }
  polyhedron(points = [[0,0,0],[5,0,0],[0,5,0],[0,0,5]], faces = [[0,1,2],[0,3,1],[0,2,3],[1,3,2]]);
}
";

/// In long runs every format of meshes and trees is changed, and figures are printed.
#[test]
fn whatever_is_cut_off_or_changed_ends_in_time_and_without_a_panic() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = on_grid(GridChoice::Side { voxels: 8, margin: 1 });
    let mut random = Random(5);
    let small = Body::octahedron([4.0; 3], 2.0);
    let mut files = vec![
        ("a.glb", glb(&description(&small), &buffer(&small))),
        ("a.gltf", gltf(&small)),
        ("a.3mf", threemf(&small)),
        ("b.3mf", packed(&text("millimeter", &object(&small, 1, 1.0), "<item objectid=\"1\"/>"), 0)),
    ];
    let is_long = long() > 1;
    if is_long {
        files.extend([
            ("b.stl", small.stl()),
            ("t.stl", small.stl_text()),
            ("t.ply", small.ply("ascii")),
            ("l.ply", small.ply("binary_little_endian")),
            ("b.ply", small.ply("binary_big_endian")),
            ("a.obj", small.obj()),
            ("a.off", small.off()),
            ("a.csg", TREE.into()),
        ]);
    }
    for (name, whole) in files {
        attempt(folder.path(), name, &whole, &mesh).unwrap_or_else(|e| panic!("{name}: {e}"));
        let (mut built, mut refused, mut slowest) = (0, 0, Duration::ZERO);
        let mut case = |bytes: &[u8], what: &str| {
            // A machine that stands still for a while does so once.
            let mut fast = false;
            for _ in 0..2 {
                let started = Instant::now();
                let done = catch_unwind(AssertUnwindSafe(|| attempt(folder.path(), name, bytes, &mesh)));
                let took = started.elapsed();
                let told = done.unwrap_or_else(|_| panic!("{name}: {what}"));
                assert!(told.is_ok() || !told.as_ref().unwrap_err().contains('\n'), "{name}: {what}");
                fast = took < Duration::from_secs(5);
                if fast {
                    slowest = slowest.max(took);
                    *(if told.is_ok() { &mut built } else { &mut refused }) += 1;
                    break;
                }
            }
            assert!(fast, "{name}: {what}");
        };
        for n in 0..100 {
            let length = n * whole.len() / 100;
            case(&whole[..length], &format!("{length} bytes"));
        }
        for n in 0..600 * long() {
            let at = usize::try_from(random.below(whole.len() as u64)).unwrap();
            let new = [random.below(256), 0xff, 0, 1 << random.below(8)][usize::try_from(n % 4).unwrap()];
            let mut bytes = whole.clone();
            bytes[at] = u8::try_from(new).unwrap();
            case(&bytes, &format!("byte {at} = {new}"));
        }
        if is_long {
            let (slowest, peak) = (slowest.as_millis(), peak_rss_bytes() >> 10);
            eprintln!(
                "{name}: {built} built, {refused} refused, slowest {slowest} ms, peak so far {peak} KiB"
            );
        }
    }
}

//! The text of trees: a dump, damage, and what is refused with its line.

use super::{build_to, exact, options, parsed};
use crate::prelude::*;

const SAMPLE: &str = include_str!("../../../fixtures/csg/bracket.csg");

#[test]
fn a_dump_as_openscad_writes_it_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.oct");
    let grid = CsgOptions { grid: Some(GridChoice::Side { voxels: 64, margin: 1 }), unit_mm: 1.0 };
    let report = build_to(parsed(SAMPLE), &grid, &options(16, 2), &file).unwrap();
    let model = Model::open(&file).unwrap();
    verify(&model).unwrap();
    assert!(report.skin_voxels > 3000, "{}", report.skin_voxels);
    assert_eq!(model.dims().to_array(), [64, 44, 29]);
}

#[test]
fn whatever_is_cut_or_changed_is_refused_or_read() {
    for end in 0..SAMPLE.len() {
        let _ = parse_tree(&SAMPLE.as_bytes()[..end], Path::new(""));
    }
    let mut random = Random(5);
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.oct");
    let grid = CsgOptions { grid: Some(GridChoice::Side { voxels: 12, margin: 1 }), unit_mm: 1.0 };
    let (mut read, mut built) = (0, 0);
    for _ in 0..2000 {
        let mut text = SAMPLE.as_bytes().to_vec();
        for _ in 0..=random.below(3_u32) {
            let at = random.below(text.len());
            text[at] =
                if random.below(2_u32) == 0 { random.byte() } else { random.pick(b"0123456789.-e[](){};,") };
        }
        if let Ok(tree) = parse_tree(&text, Path::new("")) {
            read += 1;
            if read % 8 == 0 {
                built += u32::from(build_to(tree, &grid, &options(16, 1), &file).is_ok());
            }
        }
    }
    assert!(read > 50 && built > 5, "{read} read, {built} built");
}

fn refused(text: &str) -> String {
    match parse_tree(text.as_bytes(), Path::new("")) {
        Err(fault) => fault.to_string(),
        Ok(tree) => {
            let folder = tempfile::tempdir().unwrap();
            match build_to(tree, &exact([8, 8, 8]), &options(16, 1), &folder.path().join("a.oct")) {
                Err(refused) => refused.to_string(),
                other => panic!("{text}: {other:?}"),
            }
        }
    }
}

#[test]
fn what_is_not_supported_is_named_with_its_line() {
    for module in "hull minkowski projection text surface rotate_extrude offset roof x".split(' ') {
        let fault = refused(&format!("group() {{\n\n\t{module}(a = 1) {{ cube(); }}\n}}"));
        assert!(fault.starts_with(&format!("line 3: {module} is not supported")), "{fault}");
    }
    assert!(refused("circle(r = 1);").starts_with("line 1: circle is flat"));
    assert!(refused("linear_extrude(height = 2) { cube(); }").contains("is not flat and cannot be extruded"));
    let twisted = refused("\nlinear_extrude(height = 2, twist = 5) { circle(); }");
    assert!(twisted.starts_with("line 2: linear_extrude with twist"), "{twisted}");
    for name in ["/etc/passwd", "../a.stl", "a/../../b.stl", ""] {
        assert!(
            refused(&format!("mesh(\"{name}\");")).contains("which lies outside of its folder"),
            "{name}"
        );
    }
}

/// As far as a voxel can tell, so many sides are round.
#[test]
fn more_than_256_sides_are_round() {
    for solid in ["sphere($fn = COUNT, r = 1);", "cylinder($fn = COUNT, h = 2, r1 = 1, r2 = 0.5);"] {
        let of = |count: &str| format!("{:?}", parsed(&solid.replace("COUNT", count)));
        assert_eq!(of("5000"), of("0"), "{solid}");
        assert_ne!(of("256"), of("0"), "{solid}");
    }
}

/// A name that is not taken would change the solid without a word.
#[test]
fn arguments_that_a_module_does_not_take_are_refused() {
    for (text, name) in [
        ("cube(size = [3, 3, 3], centre = true);", Some("centre")),
        ("sphere(r = 5, $fnn = 3);", Some("$fnn")),
        ("volume(\"ct.nrrd\", iso = 200, foo = 3);", Some("foo")),
        ("group(1) { cube(); }", None),
        ("torus(9, 2, 1);", None),
    ] {
        let told = refused(text);
        let expected =
            name.map_or(" has more values than it takes".into(), |name| format!(" does not take {name}"));
        assert!(told.starts_with("line 1: ") && told.contains(&expected), "{text}: {told}");
    }
    let told = refused("cube(centre = true);");
    assert!(told.contains("cube does not take centre; it takes size, center"), "{told}");
    let told = refused("import(\"a.stl\", center = true);");
    assert!(told.contains("import(center = true) is not read"), "{told}");
    // As OpenSCAD writes them.
    for text in [
        "sphere($fn = 0, $fa = 12, $fs = 2, r = 5);",
        "linear_extrude(height = 2, center = false, convexity = 1, twist = 0, slices = 1, scale = [1, 1], $fn = 0, $fa = 12, $fs = 2) { circle($fn = 0, $fa = 12, $fs = 2, r = 1); }",
        "import(file = \"a.stl\", layer = \"\", origin = [0, 0], scale = 1, convexity = 1, $fn = 0, $fa = 12, $fs = 2, timestamp = 0);",
        "color([1, 0, 0, 1]) { render(convexity = 2) { cylinder($fn = 0, $fa = 12, $fs = 2, h = 1, r1 = 1, r2 = 1, center = false); } }",
    ] {
        assert!(parse_tree(text.as_bytes(), Path::new("")).is_ok(), "{text}");
    }
}

#[test]
fn numbers_that_make_no_sense_are_refused() {
    for text in [
        "sphere(r = -1);",
        "sphere(r = nan);",
        "sphere(r = inf);",
        "sphere(r = 1e400);",
        "cube(size = [1, -1, 1]);",
        "cube(size = [1, nan, 1]);",
        "cylinder(h = 1, r1 = -1, r2 = 2);",
        "torus(1, 2);",
        "halfspace([0, 0, 0]);",
        "halfspace([0, 0, 1], inf);",
    ] {
        assert!(refused(text).contains("a size is below 0, not a number"), "{text}: {}", refused(text));
    }
    let placed = |matrix: &str| format!("multmatrix({matrix}) {{ sphere(r = 1); }}");
    for matrix in [
        "[[1,0,0,0],[1,0,0,0],[0,0,1,0],[0,0,0,1]]",
        "[[0,0,0,0],[0,0,0,0],[0,0,0,0],[0,0,0,1]]",
        "[[1,0,0,0],[0,1,0,0],[0,0,inf,0],[0,0,0,1]]",
        "[[1,0,0,nan],[0,1,0,0],[0,0,1,0],[0,0,0,1]]",
    ] {
        assert!(refused(&placed(matrix)).contains("a matrix makes its solid flat or infinite"), "{matrix}");
    }
    let far = ["sphere(r = 1e12);".into(), placed("[[1,0,0,1e300],[0,1,0,0],[0,0,1,0],[0,0,0,1]]")];
    for (text, line) in far.iter().zip(["line 1: reaches more than", "reaches more than"]) {
        assert!(refused(text).contains(line), "{text}: {}", refused(text));
    }
    for text in
        ["multmatrix([[1,0],[0,1]]) { cube(); }", "polyhedron(points = [[0,0,0]], faces = [[0,1,2]]);"]
    {
        assert!(refused(text).contains("is missing or makes no sense"), "{text}");
    }
    let open = "polyhedron(points = [[0,0,0],[5,0,0],[0,5,0],[0,0,5]], faces = [[0,1,2],[0,1,3],[1,2,3]]);";
    assert!(refused(open).contains("line 1: the faces of the polyhedron leave holes"));
    for text in [
        "cube(",
        "cube)",
        "cube() cube();",
        "{",
        "}",
        "cube() {",
        "/* ",
        "\"",
        "cube(size = [1, 2);",
        "!cube();",
    ] {
        assert!(refused(text).starts_with("line 1: expected "), "{text}");
    }
}

/// What people write is the tree that OpenSCAD's matrices make.
#[test]
fn places_are_matrices() {
    let folder = tempfile::tempdir().unwrap();
    let built = |text: &str| {
        let file = folder.path().join("a.oct");
        let tree =
            parse_tree(text.as_bytes(), Path::new("")).unwrap_or_else(|fault| panic!("{text}: {fault}"));
        build_to(tree, &exact([24, 24, 24]), &options(16, 1), &file).unwrap();
        std::fs::read(file).unwrap()
    };
    let moved = "multmatrix([[1,0,0,9],[0,1,0,8],[0,0,1,7],[0,0,0,1]])";
    for (short, long) in [
        ("translate([2, 3, 4]) cube(5);", "multmatrix([[1,0,0,2],[0,1,0,3],[0,0,1,4],[0,0,0,1]]) cube(5);"),
        (
            "M rotate([0, 0, 90]) cube([1, 4, 2]);",
            "M multmatrix([[0,-1,0,0],[1,0,0,0],[0,0,1,0]]) cube([1, 4, 2]);",
        ),
        ("M rotate(90) cube([1, 4, 2]);", "M multmatrix([[0,-1,0,0],[1,0,0,0],[0,0,1,0]]) cube([1, 4, 2]);"),
        (
            "M rotate(a = 90, v = [2, 0, 0]) cube([1, 4, 2]);",
            "M multmatrix([[1,0,0,0],[0,0,-1,0],[0,1,0,0]]) cube([1, 4, 2]);",
        ),
        // About x first, then about z.
        (
            "M rotate([90, 0, 90]) cube([1, 4, 2]);",
            "M rotate([0, 0, 90]) rotate([90, 0, 0]) cube([1, 4, 2]);",
        ),
        ("scale([2, 3, 1]) cube(5);", "cube([10, 15, 5]);"),
        ("scale(2) cube([1, 2, 3]);", "cube([2, 4, 6]);"),
        ("M mirror([1, 0, 0]) cube(5);", "M multmatrix([[-1,0,0,0],[0,1,0,0],[0,0,1,0]]) cube(5);"),
        ("resize([10, 0, 0], auto = true) cube([5, 4, 3]);", "cube([10, 8, 6]);"),
        (
            "resize([10, 6, 0]) union() { cube([5, 4, 3]); cube(1); }",
            "union() { cube([10, 6, 3]); cube([2, 1.5, 1]); }",
        ),
        ("resize([0, 0, 9], auto = [true, false, false]) cube([5, 4, 3]);", "cube([15, 4, 9]);"),
        ("linear_extrude(v = [0, 0, 7]) square(4);", "cube([4, 4, 7]);"),
        ("linear_extrude(5) translate([2, 3]) square(4);", "translate([2, 3, 0]) cube([4, 4, 5]);"),
        (
            "$fn = 6; M sphere(5); M cylinder(h = 2, r = 3, $fn = 8);",
            "M sphere(5, $fn = 6); M cylinder(h = 2, r = 3, $fn = 8);",
        ),
        ("M union($fn = 6) { color(\"red\") sphere(5); }", "M sphere(5, $fn = 6);"),
        ("$fa = 1; $fs = 0.4; %#cube(9); #%cube(8); ##cube(4);", "cube(4);"),
    ] {
        let [short, long] = [short, long].map(|text| text.replace("M ", &format!("{moved} ")));
        assert!(built(&short) == built(&long), "{short}");
    }
    let mark = built("\u{feff}cube(4);");
    assert!(mark == built("cube(4);"));
}

/// A number with a comma is another one; what belongs to a program names the way out.
#[test]
fn misread_numbers_and_programs_are_refused() {
    for (text, words) in [
        ("cube(size = 1,5);", "line 1: cube has a value 5 without a name behind one with a name"),
        ("cube([1, 2, 3], size = 4);", "line 1: cube has size twice"),
        ("cube(size = 4, size = 5);", "line 1: cube has size twice"),
        ("cube(size = [1, 2, 3, 4]);", "size of cube is missing or makes no sense"),
        ("color([1, 0, 0, 0, 0]) cube();", "c of color is missing or makes no sense"),
        ("color(0.5) cube();", "c of color is missing or makes no sense"),
        ("translate([1,5, 2, 3]) cube();", "v of translate is missing or makes no sense"),
        ("cube(size = [1 2 3]);", "expected one comma between the items of a list"),
        ("cube(size = [1,,2,3]);", "expected one comma between the items of a list"),
        ("cube(size = 1.5.2);", "line 1: 1.5.2 is not a number"),
        ("cube(size = 5mm);", "line 1: 5mm is not a number"),
        ("resize([9, 9, 9]) difference() { cube(4); cube(1); }", "resize is read of solids whose size"),
        ("cube(3); $fn = 50;", "$fn counts for all that stands before it"),
    ] {
        assert!(refused(text).contains(words), "{text}: {}", refused(text));
    }
    for text in [
        "w = 5; cube(w);",
        "cube(w);",
        "module a() { cube(); }",
        "hull() cube();",
        "minkowski() { cube(); }",
        "use <a.scad>",
        "for (i = [1:3]) cube(i);",
        "cube(2 * 3);",
    ] {
        assert!(refused(text).ends_with("openscad -o part.csg part.scad"), "{text}: {}", refused(text));
    }
    let utf16: Vec<u8> = "cube(4);".encode_utf16().flat_map(u16::to_le_bytes).collect();
    let told = parse_tree(&[&[0xff, 0xfe][..], &utf16].concat(), Path::new("")).unwrap_err().to_string();
    assert!(told.contains("UTF-16"), "{told}");
}

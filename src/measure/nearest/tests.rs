use super::*;
use crate::builder::Tolerance;
use crate::random::Random;
use crate::{BuildOptions, Model, Threshold, Voxels};

/// Signed distance to a ball, a torus and a box, below 0 inside.
const BODIES: [fn([f64; 3]) -> f64; 3] = [
    |p| dot3(p, p).sqrt() - 9.3,
    |p| (p[0].hypot(p[1]) - 8.2).hypot(p[2]) - 3.6,
    |p| {
        let over = [p[0].abs() - 8.3, p[1].abs() - 6.6, p[2].abs() - 7.4];
        let beyond = over.map(|c| c.max(0.0));
        dot3(beyond, beyond).sqrt() + over[0].max(over[1]).max(over[2]).min(0.0)
    },
];

fn dot3(a: [f64; 3], b: [f64; 3]) -> f64 {
    crate::geom::dot(a, b)
}

const SIDE: u32 = 30;

/// A body in a cube of 30, scaled to voxels of other sizes and shaken by noise of this size, in voxels.
fn model(body: fn([f64; 3]) -> f64, spacing: [f64; 3], noise: f64, error: Option<f64>) -> Model<Vec<u8>> {
    let mut random = Random(7);
    let dims = Dims::new(SIDE, SIDE, SIDE).unwrap();
    let mut samples = Vec::new();
    for i in 0..SIDE.pow(3) {
        let p = [i % SIDE, i / SIDE % SIDE, i / SIDE / SIDE];
        let at = std::array::from_fn(|a| (f64::from(p[a]) - 14.6) * spacing[a]);
        #[expect(clippy::cast_possible_truncation, reason = "samples in single precision")]
        samples.push((-body(at) + noise * (random.unit() * 2.0 - 1.0)) as f32);
    }
    let sample = |p: [u32; 3]| samples[(p[0] + SIDE * (p[1] + SIDE * p[2])) as usize];
    let volume = Voxels::from_fn(dims, sample).placed(Affine::from_spacing(spacing));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.oct");
    let options = BuildOptions {
        threshold: Threshold::Iso(0.0),
        error: error.map(Tolerance::Voxels),
        ..Default::default()
    };
    crate::build(&volume, &options, &path).unwrap();
    Model::read(path).unwrap()
}

/// The nearest point by asking every facet.
fn brute(surface: &Surface<'_>, point: [f64; 3], query: &Query<'_>) -> Option<Found> {
    let mut best: Option<Found> = None;
    let mut waiting = vec![OctreeBox { number: BoxIndex::ROOT, low: [0; 3], level: surface.view.depth() }];
    while let Some(place) = waiting.pop() {
        if place.level == 0 || surface.is_leaf(place) {
            surface.facets(place, |part, facet| {
                let (square, at) = facet.nearest(facet.relative(point));
                let key = (square, place.number, part);
                let is_facing = query.facing.is_none_or(|(d, least)| dot3(d, facet.normal) >= least - 1e-9);
                let is_better = best.is_none_or(|b| key < (b.square, b.place.number, b.part));
                if is_facing && square <= query.within * query.within && is_better {
                    let height = facet.height(point);
                    best = Some(Found { square, point: at, normal: facet.normal, place, part, height });
                }
            });
            continue;
        }
        for octant in crate::geom::Octant::ALL {
            if let Some(number) = surface.view.child(place.number.node(), octant) {
                let low = std::array::from_fn(|a| place.low[a] + (octant.high()[a] << (place.level - 1)));
                waiting.push(OctreeBox { number, low, level: place.level - 1 });
            }
        }
    }
    best
}

#[test]
fn the_search_finds_what_all_facets_say() {
    for (body, spacing, noise, error) in [
        (BODIES[0], [1.0; 3], 0.0, None),
        (BODIES[1], [1.0; 3], 0.9, None),
        (BODIES[2], [1.0, 1.0, 1.0], 0.0, Some(0.3)),
        (BODIES[1], [1.0, 1.3, 5.0], 0.5, None),
    ] {
        let model = model(body, spacing, noise, error);
        let view = model.view();
        let surface = Surface::open(&view, &model.affine(), model.dims()).unwrap();
        let mut search = surface.search();
        let mut random = Random(3);
        for i in 0..150 {
            let mut point = [0, 1, 2].map(|a| (random.unit() * 1.6 - 0.3) * f64::from(SIDE) * spacing[a]);
            if i % 3 == 0 {
                // On middles, faces and corners of cells, where facets are as near as others.
                point = std::array::from_fn(|a| (point[a] / spacing[a] * 2.0).round() / 2.0 * spacing[a]);
            }
            if i % 10 == 0 {
                search.start_at(None);
            }
            let mut query = if i % 4 == 0 { Query::within(4.0) } else { Query::ANY };
            if i % 5 == 0 {
                query.facing = Some(([0.6, 0.0, 0.8], 0.0));
            }
            assert_eq!(search.nearest(point, &query), brute(&surface, point, &query), "{point:?}");
        }
    }
}

#[test]
fn sides_are_those_of_the_body() {
    for body in BODIES {
        let model = model(body, [1.0; 3], 0.0, None);
        let view = model.view();
        let surface = Surface::open(&view, &model.affine(), model.dims()).unwrap();
        let mut search = surface.search();
        let mut random = Random(11);
        let mut worst = 0.0_f64;
        for _ in 0..4000 {
            let world = [0; 3].map(|_: u32| (random.unit() * 1.4 - 0.2) * f64::from(SIDE));
            let due = body(world.map(|c| c - 14.6));
            let point = surface.space.to_frame(world);
            let found = search.nearest(point, &Query::ANY).unwrap();
            let got = search.signed(point, &found);
            assert!(due.abs() < 0.6 || due * got > 0.0, "{world:?}: {got} {due}");
            worst = worst.max((got - due).abs());
        }
        assert!(worst < 1.0, "{worst}");
    }
}

fn facet_in(middle: [f64; 3], half: [f64; 3], normal: [i32; 3], offset: f64) -> Facet {
    Facet::new(middle, [half, half.map(|h| 1.0 / h)], normal, offset)
}

#[test]
fn nearest_points_lie_on_planes_and_in_boxes_and_none_is_nearer() {
    let mut random = Random(5);
    for round in 0..400 {
        let half = [0.5, 0.7, 0.5 + 2.0 * random.unit()];
        let normal = crate::format::normal::decode_l1(u16::try_from(random.below(65535)).unwrap());
        let offset = [-127.0, 127.0, 0.0, 60.0, -126.0][round % 5];
        let facet = facet_in([3.0, -2.0, 9.0], half, normal, offset);
        let point = [3.0, -2.0, 9.0].map(|c| c + random.unit() * 8.0 - 4.0);
        let (square, at) = facet.nearest(facet.relative(point));
        let is_within = |p: [f64; 3]| (0..3).all(|a| (p[a] - facet.middle[a]).abs() <= half[a] + 1e-12);
        assert!(facet.height(at).abs() < 1e-12 && is_within(at), "{facet:?} {at:?}");
        assert!(facet.may_reach(facet.relative(point), square * (1.0 + 1e-12) + 1e-12));
        assert!(!facet.may_reach(facet.relative(point), facet.height(point).powi(2) * (1.0 - 1e-9) - 1e-12));
        // Points of the facet: places of the box drawn onto the plane.
        for _ in 0..200 {
            let any: [f64; 3] =
                std::array::from_fn(|a| facet.middle[a] + half[a] * (random.unit() * 2.0 - 1.0));
            let on = crate::geom::add_scaled(any, -facet.height(any), facet.normal);
            let apart = facet::minus(point, on);
            assert!(!is_within(on) || dot3(apart, apart) >= square - 1e-9);
        }
        let (area, centroid) = facet.section();
        assert!(area >= 0.0 && facet.height(centroid).abs() < 1e-9 && is_within(centroid));
        let (due, place) = facet.section_by_corners();
        assert!((area - due).abs() < 1e-9 && facet::minus(centroid, place).iter().all(|c| c.abs() < 1e-7));
    }
    // A face, half a face's diagonal, a corner.
    for (normal, offset, due) in [
        ([127, 0, 0], 127.0, 1.0),
        ([63, 64, 0], 0.0, f64::hypot(1.0, 63.0 / 64.0)),
        ([42, 42, 43], 127.0, 0.0),
    ] {
        let (area, _) = facet_in([0.5; 3], [0.5; 3], normal, offset).section();
        assert!((area - due).abs() < 1e-9, "{normal:?}: {area}");
    }
}

#[test]
fn facets_of_octants_fit_the_interpolated_values() {
    let mut random = Random(11);
    let mut met = 0;
    for _ in 0..500 {
        let corners: [i8; CORNERS] =
            std::array::from_fn(|_| i8::try_from(random.below(255)).map_or(127, |c| c - 127));
        let value = |at: [f64; 3]| {
            let weight = |c: usize, a: usize| if c >> a & 1 == 1 { at[a] } else { 1.0 - at[a] };
            (0..CORNERS)
                .map(|c| weight(c, 0) * weight(c, 1) * weight(c, 2) * f64::from(corners[c]))
                .sum::<f64>()
        };
        octants(&corners, [0.5; 3], [[0.5; 3], [2.0; 3]], |octant, facet| {
            // The mean at the middle, the falls between means of opposite faces.
            let low: [f64; 3] = std::array::from_fn(|a| f64::from(octant >> a & 1) / 2.0);
            let near = |c: usize| std::array::from_fn(|a| low[a] + if c >> a & 1 == 1 { 0.5 } else { 0.0 });
            let values: [f64; CORNERS] = std::array::from_fn(|c| value(near(c)));
            let falls: [f64; 3] = std::array::from_fn(|a| {
                (0..CORNERS).map(|c| if c >> a & 1 == 1 { -values[c] } else { values[c] }).sum()
            });
            let length = dot3(falls, falls).sqrt();
            let off = facet::minus(falls.map(|f| f / length), facet.normal);
            // A unit of the octant is a quarter of the cell's edge.
            let offset = values.iter().sum::<f64>() / length / 4.0;
            let height = facet.height(low.map(|c| c + 0.25));
            assert!(dot3(off, off) < 1e-20 && (height + offset).abs() < 1e-12, "{corners:?} {octant}");
            met += 1;
        });
    }
    assert!(met > 1000, "{met}");
}

#[test]
fn frames_without_right_angles_and_skins_are_refused() {
    let model = model(BODIES[0], [1.0; 3], 0.0, None);
    let view = model.view();
    let mut sheared = model.affine();
    sheared.rows[0][2] = 0.1;
    let open = |affine: &Affine| Surface::open(&view, affine, model.dims()).map_err(|fault| fault.text);
    assert!(open(&sheared).unwrap_err().contains("right angles"));
    assert!(open(&Affine::from_spacing([1.0, 1.0, 101.0])).unwrap_err().contains("times as long"));
}

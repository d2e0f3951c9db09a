//! The syntax of `synthetic:NAME@N?key=value,key=value`.

use super::body::{Body, Shape};
use super::head::SyntheticHead;
use super::lattice::{Lattice, Pattern};
use super::math::Vector;
use super::smooth::{Smooth, Turn};
use super::wave::Wave;
use crate::fault::{Fault, usage};
use crate::geom::Dims;
use std::fmt::Display;

/// The prefix of the name.
pub(super) const PREFIX: &str = "synthetic:";

/// Name of the head, which is not a [`Body`].
pub(super) const HEAD: &str = "head";

/// Names of the bodies, each with its keys other than keys of the sampling.
const BODIES: [(&str, &[&str]); 11] = [
    ("sphere", &["radius"]),
    ("ellipsoid", &["radii", "turn"]),
    ("torus", &["ring", "tube", "turn"]),
    ("box", &["edges", "turn"]),
    ("slab", &["thickness", "turn"]),
    ("gyroid", &["period"]),
    ("marschner-lobb", &["frequency", "depth"]),
    ("menger", &["levels"]),
    ("checkerboard", &["cell"]),
    ("comb", &["cell"]),
    ("salt", &["cell", "share"]),
];

/// Names of the bodies.
pub(super) fn bodies() -> [&'static str; 11] {
    BODIES.map(|(name, _)| name)
}

/// Sampling of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sampling {
    /// True to sample inside or outside, with nothing in between.
    pub binary: bool,
    /// Standard deviation of the point spread in units of the finest spacing; 0 for a sharp edge.
    pub psf: f64,
    /// Thickness that a slice averages over, as a part of the distance between slices; 0 for points.
    pub slab: f64,
    /// Standard deviation of the noise, as a part of the step from air to body.
    pub noise: f64,
    /// Seed of the noise, and of salt.
    pub seed: u64,
    /// Bits of a sample: 1 to 16 (steps of whole numbers), or 32 (single precision).
    pub bits: u32,
    /// Distance in mm between samples along x, y, z.
    pub spacing_mm: [f64; 3],
}

/// A body and its sampling.
#[derive(Clone, Debug)]
pub(super) struct Spec {
    pub(super) body: Body,
    pub(super) dims: Dims,
    pub(super) sampling: Sampling,
}

/// The volume that a text describes.
pub(super) enum Request {
    Head(Box<SyntheticHead>),
    Body(Box<Spec>),
}

/// Keys of the sampling.
const SAMPLING: [&str; 7] = ["sample", "psf", "slab", "noise", "seed", "bits", "spacing"];

/// Parameters, each to be taken once.
struct Keys<'a> {
    body: &'static str,
    given: Vec<(&'a str, &'a str)>,
}

impl<'a> Keys<'a> {
    /// Reads `key=value` pairs, separated by `,` or `&`.
    fn new(body: &'static str, text: Option<&'a str>, known: &[&'static str]) -> Result<Self, Fault> {
        let mut given: Vec<(&str, &str)> = Vec::new();
        for part in text.into_iter().flat_map(|t| t.split([',', '&'])) {
            let (key, value) = part.split_once('=').unwrap_or((part, ""));
            if !known.contains(&key) {
                return Err(match known {
                    [] => usage!("the {body} has no parameters, so '{key}' has no meaning there"),
                    _ => usage!("the {body} has no parameter '{key}'; it has {}", known.join(", ")),
                });
            }
            if given.iter().any(|(other, _)| *other == key) {
                return Err(usage!("the parameter '{key}' is given twice"));
            }
            given.push((key, value));
        }
        Ok(Self { body, given })
    }

    fn text(&self, key: &str) -> Option<&'a str> {
        self.given.iter().find(|(given, _)| *given == key).map(|(_, value)| *value)
    }

    fn wrong(key: &str, given: &str, wanted: impl Display) -> Fault {
        usage!("'{given}' is not a value of the parameter '{key}'; give {wanted}")
    }

    fn number(&self, key: &str, usual: f64, [low, high]: [f64; 2]) -> Result<f64, Fault> {
        let Some(text) = self.text(key) else { return Ok(usual) };
        let value = text.parse::<f64>().ok().filter(|v| (low..=high).contains(v));
        value.ok_or_else(|| Self::wrong(key, text, format_args!("a number from {low} to {high}")))
    }

    fn whole(&self, key: &str, usual: u64, [low, high]: [u64; 2]) -> Result<u64, Fault> {
        let Some(text) = self.text(key) else { return Ok(usual) };
        let value = text.parse::<u64>().ok().filter(|v| (low..=high).contains(v));
        value.ok_or_else(|| Self::wrong(key, text, format_args!("a whole number from {low} to {high}")))
    }

    fn three(&self, key: &str, usual: Vector, [low, high]: [f64; 2]) -> Result<Vector, Fault> {
        let Some(text) = self.text(key) else { return Ok(usual) };
        let number = |part: &str| part.parse::<f64>().ok().filter(|v| (low..=high).contains(v));
        let all: Option<Vec<f64>> = text.split('x').map(number).collect();
        let all = all.and_then(|all| Vector::try_from(all).ok());
        all.ok_or_else(|| {
            Self::wrong(key, text, format_args!("three numbers from {low} to {high}, as in 1x1x6"))
        })
    }

    fn word(&self, key: &str, words: &'static [&'static str]) -> Result<usize, Fault> {
        let Some(text) = self.text(key) else { return Ok(0) };
        let at = words.iter().position(|w| *w == text);
        at.ok_or_else(|| Self::wrong(key, text, format_args!("one of {}", words.join(", "))))
    }
}

/// Range of lengths in units.
const LENGTHS: [f64; 2] = [0.01, 65536.0];
const ANGLES: [f64; 2] = [-360.0, 360.0];

fn wrong_size(given: &str) -> Fault {
    usage!(
        "'{given}' is not the size of a volume; write N or NXxNYxNZ with sides of 1 to 65536 (the head: 1 to 65536, all alike)"
    )
}

pub(super) fn no_body(name: &str, known: &[&str]) -> Fault {
    usage!(
        "there is no synthetic body '{name}'; choose {}, for example synthetic:sphere@256",
        known.join(", ")
    )
}

/// Reads the text behind [`PREFIX`].
pub(super) fn parse(text: &str) -> Result<Request, Fault> {
    let (front, keys) = text.split_once('?').map_or((text, None), |(front, keys)| (front, Some(keys)));
    let (name, size) = front.split_once('@').map_or((front, None), |(name, size)| (name, Some(size)));
    let all = || std::iter::once((HEAD, &[][..])).chain(BODIES);
    let Some((name, own_keys)) = all().find(|(known, _)| *known == name) else {
        return Err(no_body(name, &all().map(|(known, _)| known).collect::<Vec<_>>()));
    };
    let size = size.ok_or_else(|| {
        usage!(
            "a synthetic volume needs its size in voxels: write synthetic:NAME@N or synthetic:NAME@NXxNYxNZ"
        )
    })?;
    if name == HEAD {
        Keys::new(HEAD, keys, own_keys)?;
        let head = size.parse().ok().and_then(SyntheticHead::new);
        return head.map(|head| Request::Head(Box::new(head))).ok_or_else(|| wrong_size(size));
    }
    let known: Vec<&str> = own_keys
        .iter()
        .copied()
        .chain(SAMPLING)
        // The signal is sampled unchanged, without an edge that could be blurred.
        .filter(|key| !(name == "marschner-lobb" && *key == "psf"))
        .collect();
    let keys = Keys::new(name, keys, &known)?;
    let sampling = sampling(&keys)?;
    let dims = dims(size, &sampling).ok_or_else(|| wrong_size(size))?;
    let body = Body { name, shape: shape(&keys, dims, &sampling)? };
    Ok(Request::Body(Box::new(Spec { body, dims, sampling })))
}

fn sampling(keys: &Keys<'_>) -> Result<Sampling, Fault> {
    let binary = keys.word("sample", &["density", "binary"])? == 1;
    let of_grey_levels = ["psf", "slab", "noise", "bits"].into_iter().find(|key| keys.text(key).is_some());
    if let (true, Some(key)) = (binary, of_grey_levels) {
        return Err(usage!(
            "'{key}' is about grey levels, which sample=binary does not have; leave one of the two out"
        ));
    }
    let bits = keys.whole("bits", 16, [4, 32])?;
    if bits > 16 && bits != 32 {
        let given = bits.to_string();
        return Err(Keys::wrong("bits", &given, "a whole number from 4 to 16"));
    }
    Ok(Sampling {
        binary,
        psf: keys.number("psf", 0.8, [0.0, 8.0])?,
        slab: keys.number("slab", 0.0, [0.0, 2.0])?,
        noise: keys.number("noise", 0.0, [0.0, 1.0])?,
        seed: keys.whole("seed", 1, [0, u64::MAX])?,
        bits: u32::try_from(bits).unwrap_or(16),
        spacing_mm: keys.three("spacing", [1.0; 3], [1e-3, 1e3])?,
    })
}

impl Sampling {
    /// Distance between samples in units of the finest.
    pub(super) fn spacing(&self) -> Vector {
        let [x, y, z] = self.spacing_mm;
        let finest = x.min(y).min(z);
        self.spacing_mm.map(|s| s / finest)
    }
}

/// `N` units a side, with fewer samples along a coarser axis; or as many samples as stated.
fn dims(text: &str, sampling: &Sampling) -> Option<Dims> {
    let side = |text: &str| text.parse::<u32>().ok();
    let parts: Vec<u32> = text.split('x').map(side).collect::<Option<_>>()?;
    match parts.as_slice() {
        [n] => {
            let samples = sampling.spacing().map(|s| (f64::from(*n) / s).round().max(1.0));
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most the side")]
            let [x, y, z] = samples.map(|s| s as u32);
            (*n > 0).then(|| Dims::new(x, y, z)).flatten()
        }
        [x, y, z] => Dims::new(*x, *y, *z),
        _ => None,
    }
}

/// The body, in units, in a volume of this size. A body in the middle is moved slightly off it, so that
/// samples do not lie on its planes of symmetry.
fn shape(keys: &Keys<'_>, dims: Dims, sampling: &Sampling) -> Result<Shape, Fault> {
    const BESIDE: Vector = [0.17, -0.31, 0.43];
    let spacing = sampling.spacing();
    let counts = dims.to_array();
    let edge: Vector = std::array::from_fn(|a| f64::from(counts[a]) * spacing[a]);
    let centre: Vector = std::array::from_fn(|a| 0.5 * edge[a] + BESIDE[a]);
    let n = edge[0].min(edge[1]).min(edge[2]);
    let length = |key: &str, part: f64| keys.number(key, part * n, LENGTHS);
    let turned = |shape: Smooth, usual: Vector| {
        Ok(Shape::Smooth { shape, centre, turn: Turn::new(keys.three("turn", usual, ANGLES)?) })
    };
    let half = |v: Vector| v.map(|c| 0.5 * c);
    let lattice = |pattern: Pattern, cell: f64| {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 65536 / 0.01")]
        let size = edge.map(|e| ((e / cell).floor() as u32).max(1));
        Shape::Lattice(Lattice { pattern, cell, origin: [0.0; 3], size })
    };
    let cell = || keys.number("cell", 1.0, [0.25, 1024.0]);
    match keys.body {
        "sphere" => turned(Smooth::Sphere { radius: length("radius", 0.42)? }, [0.0; 3]),
        "ellipsoid" => {
            let radii = keys.three("radii", [0.42 * n, 0.3 * n, 0.2 * n], LENGTHS)?;
            turned(Smooth::Ellipsoid { radii }, [20.0, 30.0, 40.0])
        }
        "torus" => {
            let (ring, tube) = (length("ring", 0.28)?, length("tube", 0.11)?);
            turned(Smooth::Torus { ring, tube }, [20.0, 30.0, 0.0])
        }
        "box" => {
            let edges = keys.three("edges", [0.56 * n, 0.42 * n, 0.3 * n], LENGTHS)?;
            turned(Smooth::Box { half: half(edges) }, [20.0, 30.0, 40.0])
        }
        "slab" => {
            let thickness = keys.number("thickness", 6.0, LENGTHS)?;
            turned(Smooth::Slab { half: 0.5 * thickness }, [20.0, 30.0, 0.0])
        }
        "gyroid" => {
            let period = length("period", 0.4)?;
            Ok(Shape::Wave(Wave::Gyroid { frequency: std::f64::consts::TAU / period }))
        }
        "marschner-lobb" => {
            let frequency = keys.number("frequency", 6.0, [0.1, 1000.0])?;
            let depth = keys.number("depth", 0.25, [0.0, 4.0])?;
            Ok(Shape::Wave(Wave::MarschnerLobb { edge, frequency, depth }))
        }
        "menger" => {
            let edge = 0.84 * n;
            // The finest cubes are some samples wide.
            let fitting =
                (1..=4).rev().find(|levels| edge / f64::from(3_u32.pow(*levels)) >= 4.0).unwrap_or(1);
            let levels = keys.whole("levels", u64::from(fitting), [1, 9])?;
            let levels = u32::try_from(levels).unwrap_or(1);
            let cubes = 3_u32.saturating_pow(levels);
            let origin = centre.map(|c| c - 0.5 * edge);
            let cell = edge / f64::from(cubes);
            Ok(Shape::Lattice(Lattice {
                pattern: Pattern::Menger { levels },
                cell,
                origin,
                size: [cubes; 3],
            }))
        }
        "checkerboard" => Ok(lattice(Pattern::Checkerboard, cell()?)),
        "comb" => Ok(lattice(Pattern::Comb, cell()?)),
        _ => {
            let share = keys.number("share", 0.01, [0.0, 1.0])?;
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 2^32")]
            let chance = (share * 4_294_967_296.0).round() as u64;
            Ok(lattice(Pattern::Salt { chance, seed: sampling.seed }, cell()?))
        }
    }
}

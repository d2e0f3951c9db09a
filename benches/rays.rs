//! Rays per second of the traversal's forms, and that all agree.
//!
//! `cargo bench --bench rays -- MODEL.oct... [--size 1024] [--rounds 5] [--threads 1,2] [--random 200000]`
//!
//! The camera is that of the figures in README: it looks along (0.3, 0.8, -0.35) through the middle of the
//! volume, of which the picture covers the longest side; in perspective from twice that side away. Rounds
//! are taken in turns. Best and median of the rounds are printed; and with one thread, what a round takes if
//! every row of tiles takes the least time it took in any round: on a machine that others use, too, that is
//! nearest to what it does alone.

use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use infobyte::cpu::Form;
use infobyte::geom::{Affine, Dims};
use infobyte::load::{Model, ModelView, NodeView};
use infobyte::render::pixel_rays::PixelRays;
use infobyte::render::ray::Ray;
use infobyte::render::selfcheck::{Random, random_ray};
use infobyte::render::surface::Skin;
use infobyte::render::tile::{TILE, Tile, Tracer};
use infobyte::render::traverse::Hit;
use infobyte::render::{Camera, GridSpace, Projection, ViewPoint, single};

/// What is measured.
#[derive(Clone, Copy, PartialEq)]
enum Way {
    Single(Form),
    Tile(Form),
}

impl Way {
    fn form(self) -> Form {
        let (Self::Single(form) | Self::Tile(form)) = self;
        form
    }

    fn name(self) -> String {
        match self {
            Self::Single(form) => format!("single {}", form.name()),
            Self::Tile(form) => format!("tile {}", form.name()),
        }
    }
}

struct Settings {
    models: Vec<String>,
    size: u32,
    rounds: usize,
    threads: Vec<usize>,
    random: usize,
    ways: String,
}

fn settings() -> Settings {
    let mut settings = Settings {
        models: Vec::new(),
        size: 1024,
        rounds: 5,
        threads: vec![1, 2],
        random: 200_000,
        ways: String::new(),
    };
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().expect("the option has a value");
        match argument.as_str() {
            "--bench" => {}
            "--size" => settings.size = value().parse().expect("a number"),
            "--rounds" => settings.rounds = value().parse().expect("a number"),
            "--random" => settings.random = value().parse().expect("a number"),
            "--ways" => settings.ways = value(),
            "--threads" => {
                settings.threads = value().split(',').map(|n| n.parse().expect("a number")).collect();
            }
            _ => settings.models.push(argument),
        }
    }
    settings
}

fn camera(dims: Dims, projection: Projection) -> Camera {
    let side = dims.to_array().into_iter().max().map_or(1.0, f64::from);
    let centre = dims.to_array().map(|n| f64::from(n) / 2.0 - 0.5);
    let direction = [0.3, 0.8, -0.35_f64];
    let length = direction.iter().map(|c| c * c).sum::<f64>().sqrt();
    let eye = std::array::from_fn(|a| centre[a] - direction[a] / length * 2.0 * side);
    let fov_deg = 2.0 * 0.25_f64.atan().to_degrees();
    let point = ViewPoint::Free { eye, look_at: centre, up: Some([0.0, 0.0, 1.0]) };
    Camera::new(point, projection, fov_deg, 1.0, |_| 0.0).expect("the camera makes sense")
}

/// Numbers of hits, and a checksum of all of them.
type Sum = (u64, u64);

fn add(sum: &mut Sum, pixel: u64, hit: Option<&Hit>) {
    if let Some(hit) = hit {
        sum.0 += 1;
        let face = hit.face.map_or(7, |f| u64::from(2 * f.axis + u8::from(f.high)));
        let mix = (hit.box_number ^ hit.t.to_bits().rotate_left(17) ^ face << 60).wrapping_mul(pixel | 1);
        sum.1 = sum.1.wrapping_add(mix ^ mix >> 29);
    }
}

/// One frame: seconds, and the sum of its hits. `rows` gets the least seconds of each row of tiles.
fn frame(
    view: &ModelView<'_>,
    sight: &PixelRays<'_>,
    size: u32,
    way: Way,
    threads: usize,
    rows: &Mutex<Vec<f64>>,
) -> (f64, Sum) {
    let across = (size as usize).div_ceil(TILE);
    rows.lock().expect("no worker panics").resize(across, f64::INFINITY);
    let next = AtomicUsize::new(0);
    let work = || {
        let mut sum = (0, 0);
        let mut tracer = match way {
            Way::Tile(form) => Tracer::new(form),
            _ => Tracer::default(),
        };
        loop {
            let row = next.fetch_add(1, Ordering::Relaxed);
            if row >= across {
                return sum;
            }
            let start = Instant::now();
            for column in 0..across {
                let corner = (column * TILE, row * TILE);
                let limits = (size as usize - corner.0, size as usize - corner.1);
                let number =
                    |ray: usize| ((corner.1 + ray / TILE) * size as usize + corner.0 + ray % TILE) as u64;
                if matches!(way, Way::Tile(_)) {
                    let hits = tracer.trace(view, &Skin, sight, Tile { corner, limits, lod_edge_log2: 0 });
                    let mut left = hits.bits();
                    while left != 0 {
                        let ray = left.trailing_zeros() as usize;
                        left &= left - 1;
                        add(&mut sum, number(ray), hits.hit(ray).as_ref());
                    }
                    continue;
                }
                for ray in 0..TILE * TILE {
                    let (x, y) = (corner.0 + ray % TILE, corner.1 + ray / TILE);
                    let Some(exact) = sight.ray(x as f64 + 0.5, y as f64 + 0.5) else { continue };
                    let trace = single::trace(way.form(), view, &Skin, &exact, 0);
                    add(&mut sum, number(ray), trace.hit.as_ref());
                }
            }
            let seconds = start.elapsed().as_secs_f64();
            let least = &mut rows.lock().expect("no worker panics")[row];
            *least = least.min(seconds);
        }
    };
    let start = Instant::now();
    let sums: Vec<Sum> = std::thread::scope(|scope| {
        let others: Vec<_> = (1..threads).map(|_| scope.spawn(work)).collect();
        let mut sums = vec![work()];
        sums.extend(others.into_iter().map(|other| other.join().expect("a worker ends")));
        sums
    });
    let seconds = start.elapsed().as_secs_f64();
    let sum = sums.iter().fold((0, 0_u64), |a, b| (a.0 + b.0, a.1.wrapping_add(b.1)));
    (seconds, sum)
}

/// Rays that are timed together when they have no picture.
const GROUP: usize = 1024;

fn incoherent(view: &ModelView<'_>, rays: &[Ray], way: Way, groups: &Mutex<Vec<f64>>) -> (f64, Sum) {
    let all = Instant::now();
    let mut sum = (0, 0);
    let mut groups = groups.lock().expect("no worker panics");
    groups.resize(rays.len().div_ceil(GROUP), f64::INFINITY);
    for (least, (group, rays)) in groups.iter_mut().zip(rays.chunks(GROUP).enumerate()) {
        let start = Instant::now();
        for (i, ray) in rays.iter().enumerate() {
            let trace = single::trace(way.form(), view, &Skin, ray, 0);
            add(&mut sum, (group * GROUP + i) as u64, trace.hit.as_ref());
        }
        *least = least.min(start.elapsed().as_secs_f64());
    }
    (all.elapsed().as_secs_f64(), sum)
}

/// Runs all ways in turns; prints a line for each.
fn compare(
    label: &str,
    rays: f64,
    rounds: usize,
    ways: &[Way],
    mut run: impl FnMut(Way, &Mutex<Vec<f64>>) -> (f64, Sum),
) {
    let mut times = vec![Vec::new(); ways.len()];
    let parts: Vec<Mutex<Vec<f64>>> = ways.iter().map(|_| Mutex::new(Vec::new())).collect();
    let mut want = None;
    for _ in 0..rounds {
        for ((way, times), parts) in ways.iter().zip(&mut times).zip(&parts) {
            let (seconds, sum) = run(*way, parts);
            times.push(seconds);
            assert_eq!(*want.get_or_insert(sum), sum, "{label}: {} hits differently", way.name());
        }
    }
    for ((way, times), parts) in ways.iter().zip(&mut times).zip(parts) {
        times.sort_by(f64::total_cmp);
        let rate = |seconds: f64| rays / seconds / 1e6;
        println!(
            "{label}  {:<16} {:>7.2} best {:>7.2} median {:>7.2} undisturbed M rays/s  ({} hits)",
            way.name(),
            rate(times[0]),
            rate(times[times.len() / 2]),
            rate(parts.into_inner().expect("no worker panics").iter().sum()),
            want.map_or(0, |w| w.0)
        );
    }
}

fn main() {
    let settings = settings();
    let forms: Vec<Form> = Form::available().collect();
    let mut singles: Vec<Way> = forms.iter().map(|form| Way::Single(*form)).collect();
    let mut ways = singles.clone();
    ways.extend(forms.iter().map(|form| Way::Tile(*form)));
    let wanted = |ways: &mut Vec<Way>| {
        ways.retain(|w| settings.ways.is_empty() || settings.ways.split(',').any(|name| w.name() == name));
    };
    wanted(&mut ways);
    wanted(&mut singles);
    for path in &settings.models {
        let model = Model::open(Path::new(path)).expect("the model opens");
        let view = model.view();
        let dims = model.dims();
        println!("{path}: {dims}, {} voxels", view.voxel_count());
        let space = GridSpace::new(dims, &Affine::from_spacing([1.0; 3])).expect("a unit grid");
        let size = settings.size;
        for projection in [Projection::Perspective, Projection::Parallel] {
            let camera = camera(dims, projection);
            let sight = PixelRays::new(&space, &camera, size, size);
            for threads in &settings.threads {
                let label = format!("{projection:?} {size}^2 {threads}t");
                let rays = f64::from(size) * f64::from(size);
                compare(&label, rays, settings.rounds, &ways, |way, rows| {
                    frame(&view, &sight, size, way, *threads, rows)
                });
            }
        }
        let mut random = Random::new(1);
        let rays: Vec<Ray> =
            (0..settings.random).filter_map(|_| random_ray(&mut random, dims.depth())).collect();
        if !rays.is_empty() {
            let count = rays.len() as f64;
            compare("random 1t", count, settings.rounds, &singles, |way, groups| {
                incoherent(&view, &rays, way, groups)
            });
        }
    }
}

//! `oct view`: a model in a browser of this machine, by the page that an export writes.
//!
//! A server of one model on 127.0.0.1 under a path that cannot be guessed. It answers GET and HEAD of two things: the
//! page, and pictures of a camera, which the page asks for where there is no WebGL2 or the model is too large for a page.
//! It refuses other hosts' names (a page from elsewhere could otherwise reach it by a name that leads here) and long or
//! slow requests, and answers 16 at a time.

use std::fs::File;
use std::io::{self, BufWriter, Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::export::still;
use super::opened::open_model;
use super::render::{RenderRequest, render_view};
use super::scene::{SceneRequest, picture_of};
use super::verify::verify_unless_packed;
use crate::error::Error;
use crate::load::Model;
use crate::page::{self, Way};
use crate::platform::FileExt;
use crate::render::{GridSpace, Projection, ViewPoint};
use crate::scene::LabelRule;
use crate::scratch::unnamed;
use crate::text::data;

/// Longest request in bytes: browsers send some hundred.
const MAX_REQUEST: usize = 8 << 10;
/// Requests that are answered at a time.
const MAX_CLIENTS: usize = 16;
/// How long a client may take to ask, and to read what it asked for.
const PATIENCE: Duration = Duration::from_secs(10);
/// Pixels along a side of a picture.
const MAX_SIDE: u32 = 4096;
/// How often it is looked at whether to stop.
const BEAT: Duration = Duration::from_millis(50);

/// How a model is served.
#[derive(Clone, Copy, Debug, Default)]
pub struct ViewRequest {
    /// Port on 127.0.0.1; 0 for one that is free.
    pub port: u16,
    /// Stop when nothing has been asked for so long.
    pub idle: Option<Duration>,
}

/// Serves the model at `input` until `stopped` says so, or for `idle` without a request; `ready` gets the address.
///
/// Memory: the model is mapped, its page lies in a scratch file in `scratch`, a picture takes its pixels. Cost: pages and
/// pictures are made when they are asked for.
///
/// # Errors
/// The model is damaged or changes meanwhile; the port is taken ([`Error::Port`]).
pub fn view(
    input: &Path,
    request: ViewRequest,
    scratch: &Path,
    ready: &dyn Fn(&str),
    stopped: &(dyn Fn() -> bool + Sync),
) -> Result<(), Error> {
    verify_unless_packed(input)?;
    let model = open_model(input)?;
    let refused = |cause| Error::Port { port: request.port, cause };
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, request.port)).map_err(refused)?;
    listener.set_nonblocking(true).map_err(refused)?;
    let port = listener.local_addr().map_err(refused)?.port();
    let server = Server {
        input,
        scratch,
        model: &model,
        page: Mutex::new(None),
        port,
        secret: secret().map_err(refused)?,
    };
    ready(&format!("http://127.0.0.1:{port}/{}/", server.secret));
    let clients = AtomicUsize::new(0);
    let mut last = Instant::now();
    std::thread::scope(|scope| {
        while !stopped() {
            let client = match listener.accept() {
                Ok((client, _)) => client,
                Err(cause) if cause.kind() == io::ErrorKind::WouldBlock => {
                    if clients.load(Ordering::Acquire) > 0 {
                        last = Instant::now();
                    } else if request.idle.is_some_and(|idle| last.elapsed() > idle) {
                        return Ok(());
                    }
                    std::thread::sleep(BEAT);
                    continue;
                }
                // A client that went away before it was looked at.
                Err(cause) if cause.kind() == io::ErrorKind::ConnectionAborted => continue,
                Err(cause) => return Err(refused(cause)),
            };
            last = Instant::now();
            if clients.fetch_add(1, Ordering::AcqRel) >= MAX_CLIENTS {
                clients.fetch_sub(1, Ordering::AcqRel);
                continue;
            }
            let (server, clients) = (&server, &clients);
            scope.spawn(move || {
                // A client that closes early needs no more.
                let _gone = server.answer(client);
                clients.fetch_sub(1, Ordering::AcqRel);
            });
        }
        Ok(())
    })
}

/// Random hexadecimal digits.
fn secret() -> io::Result<String> {
    let mut bytes = [0; 16];
    File::open("/dev/urandom")?.read_exact(&mut bytes)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// What is answered instead of content.
enum Refused {
    /// With this status, and a word why.
    Status(u16, &'static str),
    /// The connection failed.
    Gone,
}

impl From<io::Error> for Refused {
    fn from(_: io::Error) -> Self {
        Self::Gone
    }
}

struct Server<'a> {
    input: &'a Path,
    scratch: &'a Path,
    model: &'a Model,
    /// Once it has been made.
    page: Mutex<Option<File>>,
    port: u16,
    secret: String,
}

/// A request without its body, which none has.
struct Asked {
    is_head: bool,
    /// Behind the secret part of the path.
    what: String,
}

impl Server<'_> {
    fn answer(&self, mut client: TcpStream) -> Result<(), Refused> {
        client.set_nonblocking(false)?;
        client.set_write_timeout(Some(PATIENCE))?;
        let found = self.read(&mut client).and_then(|asked| self.send(&mut client, &asked));
        if let Err(Refused::Status(status, why)) = found {
            head(&mut client, &format!("{status} {why}"), "text/plain", why.len() as u64)?;
            client.write_all(why.as_bytes())?;
        }
        Ok(())
    }

    /// Reads a request, and checks who asks for what.
    fn read(&self, client: &mut TcpStream) -> Result<Asked, Refused> {
        let started = Instant::now();
        let mut bytes = Vec::new();
        while !bytes.ends_with(b"\r\n\r\n") {
            let left = PATIENCE.checked_sub(started.elapsed()).filter(|left| !left.is_zero());
            client.set_read_timeout(Some(left.ok_or(Refused::Status(408, "too slow"))?))?;
            let mut some = [0; 1024];
            let count = client.read(&mut some)?;
            if count == 0 {
                return Err(Refused::Gone);
            }
            bytes.extend_from_slice(some.get(..count).unwrap_or_default());
            if bytes.len() > MAX_REQUEST {
                return Err(Refused::Status(431, "too long"));
            }
        }
        let text = str::from_utf8(&bytes).map_err(|_| Refused::Status(400, "not text"))?;
        let mut lines = text.split("\r\n");
        let mut words = lines.next().unwrap_or_default().split(' ');
        let (method, path) = (words.next().unwrap_or_default(), words.next().unwrap_or_default());
        let hosts: Vec<&str> = lines
            .filter_map(|line| line.split_once(':'))
            .filter(|(name, _)| name.eq_ignore_ascii_case("host"))
            .map(|(_, value)| value.trim())
            .collect();
        let port = self.port;
        if ![format!("127.0.0.1:{port}"), format!("localhost:{port}")].iter().any(|host| hosts == [host]) {
            return Err(Refused::Status(421, "another host"));
        }
        if !matches!(method, "GET" | "HEAD") {
            return Err(Refused::Status(405, "only GET and HEAD"));
        }
        let what = path.strip_prefix('/').and_then(|path| path.strip_prefix(&self.secret)?.strip_prefix('/'));
        let what = what.ok_or(Refused::Status(404, "not here"))?.to_owned();
        Ok(Asked { is_head: method == "HEAD", what })
    }

    fn send(&self, client: &mut TcpStream, asked: &Asked) -> Result<(), Refused> {
        if asked.what.is_empty() {
            let page = self.page()?;
            let bytes = page.metadata()?.len();
            head(client, "200 OK", "text/html; charset=utf-8", bytes)?;
            let (mut at, mut part) = (0, vec![0; 64 << 10]);
            while !asked.is_head && at < bytes {
                let count = page.read_at(&mut part, at)?;
                client.write_all(part.get(..count).filter(|part| !part.is_empty()).ok_or(Refused::Gone)?)?;
                at += count as u64;
            }
            return Ok(());
        }
        let camera = asked.what.strip_prefix("picture?").ok_or(Refused::Status(404, "not here"))?;
        let (request, hidden) = picture(camera).ok_or(Refused::Status(400, "not a camera"))?;
        let model = self.model;
        let made = if hidden.is_empty() {
            let made = render_view(&model.view(), model.dims(), &model.affine(), &request);
            made.map(|(image, _)| image).map_err(Error::from)
        } else {
            picture_of(self.input, model, &with_labels(&request, hidden))
        };
        let image = made.map_err(|_| Refused::Status(400, "not a camera"))?;
        if model.check_unchanged(self.input).is_err() {
            return Err(Refused::Status(410, "the model was changed"));
        }
        let mut png = Vec::new();
        image.write_png_to(&mut png)?;
        head(client, "200 OK", "image/png", png.len() as u64)?;
        if !asked.is_head {
            client.write_all(&png)?;
        }
        Ok(())
    }

    /// The page in a scratch file.
    fn page(&self) -> Result<File, Refused> {
        let mut page = self.page.lock().unwrap_or_else(PoisonError::into_inner);
        if page.is_none() {
            let file = unnamed(self.scratch)?;
            let failed = |_| Refused::Status(500, "the model cannot be drawn");
            let space = GridSpace::new(self.model.dims(), &self.model.affine()).map_err(failed)?;
            let picture = still(self.model, &crate::progress::Silent)
                .map_err(|_| Refused::Status(500, "no picture"))?;
            let title = self.input.file_stem().map_or_else(String::new, |stem| data(&PathBuf::from(stem)));
            let is_large = self.model.header().file_bytes > page::MAX_BYTES
                || self.model.frame().labels.len() > page::MAX_LABELS;
            let way = if is_large { Way::Pictures } else { Way::Served };
            page::write(self.model, &space, &title, &picture, way, &mut BufWriter::new(&file))?;
            *page = Some(file);
        }
        Ok(page.as_ref().ok_or(Refused::Gone)?.try_clone()?)
    }
}

/// The head of an answer. Pages from elsewhere may not read it, and nothing keeps it.
fn head(client: &mut TcpStream, status: &str, kind: &str, bytes: u64) -> io::Result<()> {
    write!(
        client,
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {bytes}\r\nConnection: close\r\n\
         Cache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\n\
         Cross-Origin-Resource-Policy: same-origin\r\n\r\n"
    )
}

/// The picture of an address such as `f=0,1,0&u=0,0,1&t=0,0,0&h=120&p=1&w=640&s=480`: as the page writes its view, with
/// width and height, and `x=5,7..20` for labels that are hidden; `None` for one that makes no sense.
fn picture(text: &str) -> Option<(RenderRequest, Vec<LabelRule>)> {
    let value = |name: &str| text.split('&').find_map(|part| part.strip_prefix(name)?.strip_prefix('='));
    let point = |name| -> Option<[f64; 3]> {
        let numbers: Vec<f64> = value(name)?.split(',').map(str::parse).collect::<Result<_, _>>().ok()?;
        numbers.try_into().ok()
    };
    let side = |name| value(name)?.parse::<u32>().ok().filter(|side| (1..=MAX_SIDE).contains(side));
    let (forward, up, target) = (point("f")?, point("u")?, point("t")?);
    let half: f64 = value("h")?.parse().ok()?;
    let (width, height) = (side("w")?, side("s")?);
    let length = forward.iter().map(|c| c * c).sum::<f64>().sqrt();
    let distance = half / (page::FOV_DEG / 2.0).to_radians().tan();
    let eye = std::array::from_fn(|a| target[a] - distance * forward[a] / length);
    let is_perspective = value("p") == Some("1");
    let hide = |text: &str| Some(LabelRule { labels: text.parse().ok()?, opacity: 0.0 });
    let hidden = value("x").map_or(Some(Vec::new()), |text| text.split(',').map(hide).collect())?;
    let request = RenderRequest {
        width,
        height,
        point: ViewPoint::Free { eye, look_at: target, up: Some(up) },
        projection: if is_perspective { Projection::Perspective } else { Projection::Parallel },
        fov_deg: page::FOV_DEG,
        ..RenderRequest::default()
    };
    Some((request, hidden))
}

/// The same picture with some labels hidden.
fn with_labels(request: &RenderRequest, labels: Vec<LabelRule>) -> SceneRequest {
    SceneRequest {
        size: Some([request.width, request.height]),
        point: Some(request.point),
        projection: Some(request.projection),
        fov_deg: Some(request.fov_deg),
        labels,
        threads: request.threads,
        ..SceneRequest::default()
    }
}

//! `oct view`: a model, a scene or a folder of models in a browser of this machine, by the page of an export.
//!
//! A server on 127.0.0.1 under a path that cannot be guessed. It answers GET and HEAD: of pages, of a folder's contact
//! sheet, and of pictures from a camera, for pages without WebGL2, of a scene, or of a model that is too large for a
//! page. It refuses other hosts' names (a page from elsewhere could otherwise reach it by a name that resolves to this
//! machine) and long or slow requests, answers 16 at a time, and makes one picture at a time. Idle connections take no
//! thread, and the oldest of many makes room. Of a folder's models the latest ones stay open.
//!
//! | file | content |
//! |---|---|
//! | `subject` | a model or a scene: its page, its pictures |
//! | `sheet` | the models of a folder, and their contact sheet |

mod sheet;
mod subject;

use std::fs::File;
use std::io::{self, BufWriter, ErrorKind, Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use crate::error::Error;
use crate::jobs::batch::page::HOME;
use crate::load::survive_torn_files;
use crate::platform::{FileExt, open_files_limit};
use crate::scratch::unnamed;
use sheet::{BatchSheet, Entry};
use subject::Subject;

/// Longest request in bytes: browsers send some hundred.
const MAX_REQUEST: usize = 8 << 10;
/// Requests answered at a time.
const MAX_CLIENTS: usize = 16;
/// Most connections without a request; beyond that the oldest is closed.
const MAX_WAITING: usize = 64;
/// Models that stay open.
const MAX_OPEN: usize = 16;
/// Time limit of a request.
const ASKING: Duration = Duration::from_secs(3);
/// Time limit of an answer, plus its size over `MIN_RATE`.
const PATIENCE: Duration = Duration::from_secs(10);
/// Bytes a second that a client has to receive.
const MIN_RATE: u64 = 1 << 20;
/// Pixels along a side of the pictures of a contact sheet.
const THUMBNAIL: u32 = 256;
/// Intervals of looking for new clients: idle, and while some wait.
const BEATS: [Duration; 2] = [Duration::from_millis(20), Duration::from_millis(2)];

/// Options of the server.
#[derive(Clone, Copy, Debug, Default)]
pub struct ViewRequest {
    /// Port on 127.0.0.1; 0 for one that is free.
    pub port: u16,
    /// Idle time after which the server stops; `None` for never.
    pub idle: Option<Duration>,
}

/// Serves the model, the scene or the folder of models at `input` until `stopped` says so, or for `idle` without a request;
/// `ready` gets the address.
///
/// Memory: models are mapped, a page lies in a scratch file in `scratch`, a picture takes its pixels. Cost: pages and
/// pictures are made when they are asked for; of a folder only names are read before.
///
/// # Errors
/// The model is damaged or changes meanwhile; the folder has none; the port is taken ([`Error::Port`]).
pub fn view(
    input: &Path,
    request: ViewRequest,
    scratch: &Path,
    ready: &dyn Fn(&str),
    stopped: &(dyn Fn() -> bool + Sync),
) -> Result<(), Error> {
    survive_torn_files();
    let is_folder = input.is_dir();
    let entries = if is_folder { sheet::entries(input)? } else { vec![Entry::of(input)] };
    let refused = |cause| Error::Port { port: request.port, cause };
    let mut open = Vec::new();
    if let (false, [only]) = (is_folder, &*entries) {
        open.push(only.open()?);
    }
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, request.port)).map_err(refused)?;
    listener.set_nonblocking(true).map_err(refused)?;
    let port = listener.local_addr().map_err(refused)?.port();
    let folder = is_folder.then_some(input);
    let server = Server {
        sheet: folder.and_then(|folder| BatchSheet::of(folder, &entries)),
        folder,
        entries,
        open: Mutex::new(open),
        scratch,
        page: Mutex::new(None),
        drawing: Mutex::new(()),
        port,
        secret: secret().map_err(refused)?,
    };
    ready(&format!("http://127.0.0.1:{port}/{}/", server.secret));
    let answering = AtomicUsize::new(0);
    let few = few_files();
    let (mut waiting, mut last) = (Vec::new(), Instant::now());
    std::thread::scope(|scope| {
        while !stopped() && request.idle.is_none_or(|idle| last.elapsed() <= idle) {
            if accept(&listener, &mut waiting, few.min(MAX_WAITING)) || answering.load(Ordering::Acquire) > 0
            {
                last = Instant::now();
            }
            for mut client in std::mem::take(&mut waiting) {
                match client.ask() {
                    Ok(true) if answering.load(Ordering::Acquire) < few.min(MAX_CLIENTS) => {
                        answering.fetch_add(1, Ordering::AcqRel);
                        let (server, answering) = (&server, &answering);
                        let answer = move || {
                            // An early close by the client is not an error.
                            let _gone = server.answer(client);
                            answering.fetch_sub(1, Ordering::AcqRel);
                        };
                        // Without a thread the client is dropped, and may ask again.
                        if std::thread::Builder::new().spawn_scoped(scope, answer).is_err() {
                            answering.fetch_sub(1, Ordering::AcqRel);
                        }
                    }
                    Ok(_) => waiting.push(client),
                    Err(refused) => drop(client.refuse(refused)),
                }
            }
            std::thread::sleep(BEATS[usize::from(!waiting.is_empty())]);
        }
    });
    Ok(())
}

/// Number of files for each kind of use: an eighth of those that a process may have open.
fn few_files() -> usize {
    let most =
        open_files_limit().map_or(MAX_WAITING, |limit| usize::try_from(limit / 8).unwrap_or(MAX_WAITING));
    most.max(4)
}

/// Accepts new clients, and keeps at most `most` waiting; true if there were new ones.
fn accept(listener: &TcpListener, waiting: &mut Vec<Client>, most: usize) -> bool {
    let mut any = false;
    for _ in 0..MAX_WAITING {
        match listener.accept() {
            Ok((stream, _)) => {
                any = true;
                waiting.extend(Client::new(stream));
            }
            Err(cause) if cause.kind() == ErrorKind::WouldBlock => break,
            // The client went away before it was accepted.
            Err(cause) if cause.kind() == ErrorKind::ConnectionAborted => {}
            // Too many open files, as a rule.
            Err(_) => {
                waiting.drain(..waiting.len().min(1));
                break;
            }
        }
        waiting.drain(..waiting.len().saturating_sub(most));
    }
    any
}

/// Random hexadecimal digits.
fn secret() -> io::Result<String> {
    let mut bytes = [0; 16];
    File::open("/dev/urandom")?.read_exact(&mut bytes)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Reason for an answer without content.
enum Refused {
    /// HTTP status, and a sentence on the reason.
    Status(u16, String),
    /// The connection failed.
    Gone,
}

impl Refused {
    fn because(status: u16, why: impl ToString) -> Self {
        Self::Status(status, why.to_string())
    }
}

impl From<io::Error> for Refused {
    fn from(_: io::Error) -> Self {
        Self::Gone
    }
}

struct Server<'a> {
    /// Folder of the contact sheet.
    folder: Option<&'a Path>,
    /// The sheet that a batch wrote there.
    sheet: Option<BatchSheet>,
    /// Models of the folder; a single one without a folder.
    entries: Vec<Entry>,
    /// Models in the order of their last use.
    open: Mutex<Vec<Arc<Subject>>>,
    scratch: &'a Path,
    /// Page of the last request, with its entry's number.
    page: Mutex<Option<(usize, File)>>,
    /// Held while a picture is made.
    drawing: Mutex<()>,
    port: u16,
    secret: String,
}

/// A request; none has a body.
struct Asked {
    is_head: bool,
    /// Path and query behind the secret part.
    what: String,
}

/// A client with a time limit.
struct Client {
    stream: TcpStream,
    /// Bytes of the request so far.
    asked: Vec<u8>,
    until: Instant,
}

impl Client {
    /// A client before its request; `None` if it is gone.
    fn new(stream: TcpStream) -> Option<Self> {
        stream.set_nonblocking(true).ok()?;
        Some(Self { stream, asked: Vec::new(), until: Instant::now() + ASKING })
    }

    /// Reads the bytes that have come; true once they are a whole request.
    fn ask(&mut self) -> Result<bool, Refused> {
        let mut some = [0; 1024];
        while !self.asked.ends_with(b"\r\n\r\n") {
            let count = match self.stream.read(&mut some) {
                Ok(0) => return Err(Refused::Gone),
                Ok(count) => count,
                Err(cause) if cause.kind() == ErrorKind::WouldBlock => {
                    self.left().map_err(|_| Refused::because(408, "too slow"))?;
                    return Ok(false);
                }
                Err(_) => return Err(Refused::Gone),
            };
            self.asked.extend_from_slice(some.get(..count).unwrap_or_default());
            if self.asked.len() > MAX_REQUEST {
                return Err(Refused::because(431, "too long"));
            }
        }
        Ok(true)
    }

    /// Answers with the reason for missing content.
    fn refuse(&mut self, refused: Refused) -> io::Result<()> {
        let Refused::Status(status, why) = refused else { return Ok(()) };
        self.head(status, "text/plain; charset=utf-8", why.len() as u64, "")?;
        self.write_all(why.as_bytes())
    }

    fn left(&self) -> io::Result<Duration> {
        let left = self.until.checked_duration_since(Instant::now()).filter(|left| !left.is_zero());
        left.ok_or_else(|| io::ErrorKind::TimedOut.into())
    }

    /// The head of an answer of so many bytes with additional lines, each with its line end, and its time limit. It
    /// forbids pages from elsewhere to read it, and caches to keep it.
    fn head(&mut self, status: u16, kind: &str, bytes: u64, more: &str) -> io::Result<()> {
        self.until = Instant::now() + PATIENCE + Duration::from_secs(bytes / MIN_RATE);
        let word = if status == 200 { "OK" } else { "refused" };
        let head = format!(
            "HTTP/1.1 {status} {word}\r\nContent-Type: {kind}\r\nContent-Length: {bytes}\r\nConnection: close\r\n\
             Cache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\n\
             Cross-Origin-Resource-Policy: same-origin\r\n{more}\r\n"
        );
        self.write_all(head.as_bytes())
    }

    /// An answer that is in memory, or its head alone.
    fn send(&mut self, asked: &Asked, kind: &str, bytes: &[u8], more: &str) -> io::Result<()> {
        self.head(200, kind, bytes.len() as u64, more)?;
        if asked.is_head { Ok(()) } else { self.write_all(bytes) }
    }
}

impl Write for Client {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.stream.set_write_timeout(Some(self.left()?))?;
        self.stream.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Server<'_> {
    fn answer(&self, mut client: Client) -> io::Result<()> {
        client.stream.set_nonblocking(false)?;
        let sent = self.read(&client.asked).and_then(|asked| self.send(&mut client, &asked));
        sent.or_else(|refused| client.refuse(refused))
    }

    /// Reads a request, and checks its origin and path.
    fn read(&self, bytes: &[u8]) -> Result<Asked, Refused> {
        let text = str::from_utf8(bytes).map_err(|_| Refused::because(400, "not text"))?;
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
            return Err(Refused::because(421, "another host"));
        }
        if !matches!(method, "GET" | "HEAD") {
            return Err(Refused::because(405, "only GET and HEAD"));
        }
        if path == "/favicon.ico" {
            // Browsers request it and complain if it is missing.
            return Err(Refused::because(204, ""));
        }
        let what = path.strip_prefix('/').and_then(|path| path.strip_prefix(&self.secret)?.strip_prefix('/'));
        let what = what.ok_or_else(|| Refused::because(404, "not here"))?.to_owned();
        Ok(Asked { is_head: method == "HEAD", what })
    }

    fn send(&self, client: &mut Client, asked: &Asked) -> Result<(), Refused> {
        let nothing = || Refused::because(404, "not here");
        let (number, what) = match self.folder {
            None => (0, &*asked.what),
            Some(folder) if self.send_sheet(client, folder, asked)? => return Ok(()),
            Some(folder) if asked.what.is_empty() => {
                let sheet = sheet::page(folder, &self.entries);
                return Ok(client.send(asked, "text/html; charset=utf-8", sheet.as_bytes(), "")?);
            }
            Some(_) => {
                let (number, what) = asked.what.split_once('/').ok_or_else(nothing)?;
                (number.parse().map_err(|_| nothing())?, what)
            }
        };
        let entry = self.entries.get(number).ok_or_else(nothing)?;
        let subject = self.opened(entry)?;
        if what.is_empty() {
            return self.send_page(client, (number, &subject), asked.is_head);
        }
        let png = {
            let _one = self.drawing.lock().unwrap_or_else(PoisonError::into_inner);
            match what.strip_prefix("picture?") {
                Some(camera) => subject.picture(camera)?,
                None if what == "still" => subject.still(THUMBNAIL)?,
                None => return Err(nothing()),
            }
        };
        Ok(client.send(asked, "image/png", &png, "")?)
    }

    /// Sends a part of a batch's contact sheet; false if the request is for something else.
    fn send_sheet(&self, client: &mut Client, folder: &Path, asked: &Asked) -> Result<bool, Refused> {
        let Some(sheet) = &self.sheet else { return Ok(false) };
        if let Some(number) = sheet::linked(&self.entries, &asked.what) {
            let place = format!("Location: /{}/{number}/\r\n", self.secret);
            client.head(302, "text/plain; charset=utf-8", 0, &place)?;
            return Ok(true);
        }
        let file = match &*asked.what {
            HOME => Some(("text/javascript; charset=utf-8", sheet.home.clone().into_bytes())),
            name => sheet.file(folder, name),
        };
        let Some((kind, bytes)) = file else { return Ok(false) };
        let policy = format!("Content-Security-Policy: {}\r\n", BatchSheet::policy());
        client.send(asked, kind, &bytes, &policy)?;
        Ok(true)
    }

    /// The opened model of an entry; opened again if its file was changed.
    fn opened(&self, entry: &Entry) -> Result<Arc<Subject>, Refused> {
        let failed = |error| Refused::because(if entry.was_opened() { 410 } else { 500 }, error);
        let subject = entry.open().map_err(failed)?;
        let mut open = self.open.lock().unwrap_or_else(PoisonError::into_inner);
        open.retain(|other| !Arc::ptr_eq(other, &subject));
        if let Err(changed) = subject.check_unchanged() {
            *self.page.lock().unwrap_or_else(PoisonError::into_inner) = None;
            return Err(changed);
        }
        open.push(Arc::clone(&subject));
        let before = open.len().saturating_sub(few_files().min(MAX_OPEN));
        open.drain(..before);
        Ok(subject)
    }

    fn send_page(&self, client: &mut Client, of: (usize, &Subject), is_head: bool) -> Result<(), Refused> {
        let page = self.page(of)?;
        let bytes = page.metadata()?.len();
        client.head(200, "text/html; charset=utf-8", bytes, "")?;
        let (mut at, mut part) = (0, vec![0; 64 << 10]);
        while !is_head && at < bytes {
            let count = page.read_at(&mut part, at)?;
            client.write_all(part.get(..count).filter(|part| !part.is_empty()).ok_or(Refused::Gone)?)?;
            at += count as u64;
        }
        Ok(())
    }

    /// The page of an entry in a scratch file.
    fn page(&self, (number, subject): (usize, &Subject)) -> Result<File, Refused> {
        let mut page = self.page.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, file)) = page.as_ref().filter(|(of, _)| *of == number) {
            return Ok(file.try_clone()?);
        }
        let file = unnamed(self.scratch)?;
        let mut out = BufWriter::new(&file);
        subject.write_page(&mut out)?;
        out.flush()?;
        drop(out);
        *page = Some((number, file.try_clone()?));
        Ok(file)
    }
}

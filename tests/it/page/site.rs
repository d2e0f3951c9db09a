//! A web server of the tests, of files in memory: with and without ranges, and with answers that no server should give.

use super::*;
use std::net::TcpListener;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};

/// How files other than pages are sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Manner {
    /// By the ranges that are asked for.
    Ranges,
    /// As wholes, whatever is asked for.
    Whole,
    /// As wholes of unknown length.
    Unstated,
    /// By ranges, of which the one from here on waits until the gate opens.
    Gated(usize),
    /// Refused with this status.
    Status(u16),
    /// Half of what is stated, then the connection ends.
    Short,
    /// A range that begins later than asked for.
    Elsewhere,
    /// A range without saying which.
    Unnamed,
    /// After the first range, a file with another tag.
    Tagged,
    /// After the first range, a longer file.
    Grown,
    /// After the first range, other bytes under the same tag.
    Rewritten,
    /// After the first range, nothing.
    Silent,
}

type Files = dyn Fn(&str) -> Option<Vec<u8>> + Send + Sync;

pub(super) struct Site {
    port: u16,
    pub(super) gate: Arc<AtomicBool>,
    /// Bytes of models that were sent.
    pub(super) sent: Arc<AtomicU64>,
    ended: Arc<AtomicBool>,
}

impl Site {
    /// Serves what `files` gives for names.
    pub(super) fn start(
        manner: Manner,
        files: impl Fn(&str) -> Option<Vec<u8>> + Send + Sync + 'static,
    ) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap().port();
        let site = Self { port, gate: Arc::default(), sent: Arc::default(), ended: Arc::default() };
        let (gate, sent, ended) = (site.gate.clone(), site.sent.clone(), site.ended.clone());
        let (files, asked): (Arc<Files>, _) = (Arc::new(files), Arc::new(AtomicU32::new(0)));
        std::thread::spawn(move || {
            for client in listener.incoming() {
                if ended.load(Ordering::Acquire) {
                    return;
                }
                let (gate, sent, files, asked) = (gate.clone(), sent.clone(), files.clone(), asked.clone());
                std::thread::spawn(move || {
                    let _gone = answer(&mut client.unwrap(), manner, (&gate, &sent, &asked), &*files);
                });
            }
        });
        site
    }

    /// Serves the files of a folder.
    pub(super) fn of(manner: Manner, folder: &Path) -> Self {
        let folder = folder.to_path_buf();
        Self::start(manner, move |name| fs::read(folder.join(name)).ok())
    }

    pub(super) fn address(&self, what: &str) -> String {
        format!("http://127.0.0.1:{}/{what}", self.port)
    }
}

impl Drop for Site {
    fn drop(&mut self) {
        self.ended.store(true, Ordering::Release);
        self.gate.store(true, Ordering::Release);
        let _ = TcpStream::connect(("127.0.0.1", self.port));
    }
}

/// Answers one request.
fn answer(
    client: &mut TcpStream,
    manner: Manner,
    (gate, sent, asked): (&AtomicBool, &AtomicU64, &AtomicU32),
    files: &Files,
) -> std::io::Result<()> {
    let mut lines = BufReader::new(client.try_clone()?).lines();
    let first = lines.next().unwrap_or_else(|| Ok(String::new()))?;
    let path = first.split(' ').nth(1).unwrap_or_default().trim_start_matches('/');
    let name = path.split('?').next().unwrap_or_default().replace("%20", " ");
    let mut range = None;
    for line in lines {
        let line = line?.to_lowercase();
        if line.is_empty() {
            break;
        }
        if let Some((from, to)) = line.strip_prefix("range: bytes=").and_then(|range| range.split_once('-')) {
            range = Some((from.parse::<usize>().unwrap(), to.parse::<usize>().unwrap()));
        }
    }
    let mut head =
        |text: String| client.write_all(format!("HTTP/1.1 {text}Connection: close\r\n\r\n").as_bytes());
    let Some(mut bytes) = files(&name) else { return head("404 none\r\nContent-Length: 0\r\n".into()) };
    let kind = if name.ends_with(".html") { "text/html" } else { "application/octet-stream" };
    let (total, is_first) =
        (bytes.len(), !name.ends_with(".oct") || asked.fetch_add(1, Ordering::AcqRel) == 0);
    let Some((from, to)) = range.filter(|_| !matches!(manner, Manner::Whole | Manner::Unstated)) else {
        let length = format!("Content-Length: {total}\r\n");
        let length = if manner == Manner::Unstated { "" } else { &length };
        head(format!("200 OK\r\nContent-Type: {kind}\r\n{length}"))?;
        sent.fetch_add(if name.ends_with(".oct") { total as u64 } else { 0 }, Ordering::AcqRel);
        return client.write_all(&bytes);
    };
    if from >= total {
        return head("416 nothing\r\nContent-Length: 0\r\n".into());
    }
    let to = (to + 1).min(total);
    let (mut tag, mut stated, mut named) = ("a", total, from);
    match manner {
        Manner::Status(status) => return head(format!("{status} no\r\nContent-Length: 0\r\n")),
        Manner::Gated(place) if from == place => {
            while !gate.load(Ordering::Acquire) {
                std::thread::sleep(Duration::from_millis(5));
            }
        }
        Manner::Elsewhere => named += 8,
        Manner::Tagged if !is_first => tag = "b",
        Manner::Grown if !is_first => stated += 64,
        Manner::Rewritten if !is_first => bytes.iter_mut().for_each(|byte| *byte ^= 1),
        Manner::Silent if !is_first => return Ok(()),
        _ => {}
    }
    let part = bytes.get(from..to).unwrap_or_default();
    let range = format!("Content-Range: bytes {named}-{}/{stated}\r\n", to - 1);
    let range = if manner == Manner::Unnamed { "" } else { &range };
    head(format!(
        "206 part\r\nETag: \"{tag}\"\r\nContent-Type: {kind}\r\n{range}Content-Length: {}\r\n",
        part.len()
    ))?;
    sent.fetch_add(if name.ends_with(".oct") { part.len() as u64 } else { 0 }, Ordering::AcqRel);
    client.write_all(if manner == Manner::Short { &part[..part.len() / 2] } else { part })
}

//! `oct view`: what it serves to its own page, and that no request gets anything else.
//!
//! With INFOBYTE_LONG=50 a hundred thousand hostile requests.

use super::*;

/// Sends bytes to a server, and gives the status and content of its answer; 0 where there is none.
pub(super) fn answered(port: u16, request: &str) -> (u16, Vec<u8>) {
    let mut client = TcpStream::connect(("127.0.0.1", port)).unwrap();
    let _ = client.write_all(request.as_bytes());
    let _ = client.shutdown(Shutdown::Write);
    let mut answer = Vec::new();
    let _ = client.read_to_end(&mut answer);
    let end = answer.windows(4).position(|four| four == b"\r\n\r\n").map_or(answer.len(), |at| at + 4);
    let status =
        str::from_utf8(&answer[..end]).unwrap().split(' ').nth(1).map_or(0, |code| code.parse().unwrap());
    (status, answer.split_off(end))
}

/// Begins to serve a model; the address.
pub(super) fn served(model: &Path, more: &[&str]) -> (Child, String) {
    let mut child = Command::new(binary())
        .args(["view", &text(model), "--no-open"])
        .args(more)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    (child, line.trim().to_owned())
}

#[test]
fn a_server_gives_its_page_and_pictures_to_this_machine_and_nothing_to_others() {
    let folder = tempfile::tempdir().unwrap();
    let (_, page) = paged(folder.path(), "m", &["synthetic:head@48", "--surface", "cells"]);
    let model = page.with_extension("oct");
    let (mut child, address) = served(&model, &["--idle", "2"]);
    let (host, path) = address.strip_prefix("http://").unwrap().split_once('/').unwrap();
    let port: u16 = host.strip_prefix("127.0.0.1:").unwrap().parse().unwrap();
    assert_eq!(path.len(), 33, "{address}");
    let ask = |method: &str, what: &str, host: &str| {
        answered(port, &format!("{method} {what} HTTP/1.1\r\nHost: {host}\r\n\r\n"))
    };
    let (status, served) = ask("GET", &format!("/{path}"), host);
    let served = String::from_utf8(served).unwrap();
    assert!(status == 200 && served.contains("img-src blob: data: 'self'") && served.contains("data-part"));
    let camera = "f=0,1,0&u=0,0,1&t=23,23,23&h=40&w=64&s=48";
    let (status, png) = ask("GET", &format!("/{path}picture?{camera}"), host);
    assert!(status == 200 && png.starts_with(b"\x89PNG"));
    let decoded = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap();
    assert_eq!((decoded.info().width, decoded.info().height), (64, 48));
    assert_eq!(ask("HEAD", &format!("/{path}"), &format!("localhost:{port}")), (200, vec![]));
    let long = format!("/{path}{}", "a".repeat(9000));
    for (method, what, host, wanted) in [
        ("GET", format!("/{path}"), "evil.example", 421),
        ("GET", "/".to_owned(), host, 404),
        ("GET", format!("/{}/", "0".repeat(32)), host, 404),
        ("GET", format!("/{path}../m.oct"), host, 404),
        ("GET", format!("/{path}picture?f=0,1,0"), host, 400),
        ("GET", format!("/{path}picture?{}", camera.replace("w=64", "w=99999")), host, 400),
        ("GET", format!("/{path}picture?{}", camera.replace("f=0,1,0", "f=0,0,0")), host, 400),
        ("POST", format!("/{path}"), host, 405),
        ("GET", long, host, 431),
    ] {
        let (status, content) = ask(method, &what, host);
        assert_eq!(status, wanted, "{method} {what} {host}");
        assert!(content.len() < 100, "{method} {what}");
    }
    assert_eq!(answered(port, "GET / HTTP/1.1\r\n").0, 0);
    assert_eq!(answered(port, "\u{1}\r\n\r\n").0, 421);
    // Idle, it ends by itself; the port of another cannot be had.
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let run =
        oct(&["view", &text(&model), "--no-open", "--port", &taken.local_addr().unwrap().port().to_string()]);
    run.refused(5, &["cannot be used", "--port"]);
    assert!(child.wait().unwrap().success());
    oct(&["view", &text(&folder.path().join("none.oct"))]).refused(3, &["none.oct"]);
}

/// The most memory that a process has had so far, in bytes.
fn peak_of(child: &Child) -> u64 {
    let status = fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap();
    let line = status.lines().find(|line| line.starts_with("VmHWM:")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse::<u64>().unwrap() << 10
}

/// Where a server is, and what a right request is.
struct Target {
    port: u16,
    host: String,
    path: String,
}

const CAMERA: &str = "f=0,1,0&u=0,0,1&t=23,23,23&h=40&w=64&s=48";

impl Target {
    fn of(address: &str) -> Self {
        let (host, path) = address.strip_prefix("http://").unwrap().split_once('/').unwrap();
        let port = host.strip_prefix("127.0.0.1:").unwrap().parse().unwrap();
        Self { port, host: host.to_owned(), path: path.to_owned() }
    }

    /// Paths that lead nowhere, or to something else.
    fn path(&self, random: &mut Random) -> String {
        let own = &self.path;
        let any = |random: &mut Random, list: &[&str]| list[random.below(list.len())].to_owned();
        let up = any(random, &["../", "..%2f", "%2e%2e/", "..\\", "....//", "%252e%252e/", "/", "./"])
            .repeat(1 + random.below(6_usize));
        let what = any(
            random,
            &["secret.txt", "etc/passwd", "m.oct", "still", "0/", "0/../", "%00", "\u{feff}", "picture"],
        );
        match random.below(6_u32) {
            0 => format!("/{own}{up}{what}"),
            1 => format!("/{up}{what}"),
            2 => {
                // The secret, but for a letter.
                let at = random.below(own.len() - 1);
                let letter = if own.as_bytes()[at] == b'0' { "1" } else { "0" };
                format!("/{}{letter}{}", &own[..at], &own[at + 1..])
            }
            3 => format!("//{}/{own}", self.host),
            4 => {
                let name = any(random, &["f", "u", "t", "h", "w", "s", "x", "p"]);
                let value = any(
                    random,
                    &[
                        "",
                        "0",
                        "NaN,inf,-inf",
                        "1e999,0,0",
                        "0,0,0",
                        "-1",
                        "4294967296",
                        "4096",
                        "1,2",
                        "..",
                        "9..2",
                        "%",
                        "1e-300",
                    ],
                );
                format!("/{own}picture?{name}={value}&w=4096&s=4096&{CAMERA}")
            }
            _ => format!("/{own}{}", "a".repeat(1 + random.below(12_000_usize))),
        }
    }

    /// Something that no browser sends for its page.
    fn hostile(&self, random: &mut Random) -> Vec<u8> {
        let (host, own) = (&self.host, &self.path);
        let text = match random.below(8_u32) {
            0 | 1 => format!("GET {} HTTP/1.1\r\nHost: {host}\r\n\r\n", self.path(random)),
            2 => {
                let bad = [
                    "evil.example",
                    "",
                    "127.0.0.1",
                    "localhost",
                    "0.0.0.0",
                    "[::1]",
                    "127.0.0.1:1",
                    "127.0.0.1.evil",
                ];
                format!("GET /{own} HTTP/1.1\r\nHost: {}\r\n\r\n", bad[random.below(bad.len())])
            }
            3 => format!("GET /{own} HTTP/1.1\r\nHost: {host}\r\nhost: evil.example\r\n\r\n"),
            4 => {
                let bad =
                    ["POST", "PUT", "DELETE", "OPTIONS", "TRACE", "CONNECT", "get", "", "GET\t", "\u{0}"];
                format!("{} /{own} HTTP/1.1\r\nHost: {host}\r\n\r\n", bad[random.below(bad.len())])
            }
            5 => format!("GET /{own} HTTP/1.1\r\n{}", "X: y\r\n".repeat(random.below(3000_usize))),
            6 => return (0..random.below(9000_usize)).map(|_| random.byte()).chain(*b"\r\n\r\n").collect(),
            _ => format!("GET /{own} HTTP/1.1\nHost: {host}\n\n\r\n\r\n"),
        };
        text.into_bytes()
    }
}

/// Sends many requests, and holds some connections open; how many were answered.
fn besiege(target: &Target, seed: u64, count: u32) -> u32 {
    let (mut random, mut answers, mut held) = (Random(seed), 0, Vec::new());
    for _ in 0..count {
        let right = || format!("GET /{} HTTP/1.1\r\nHost: {}\r\n\r\n", target.path, target.host);
        match random.below(40_u32) {
            0 => {
                // A slow one, which is let go later.
                let mut client = TcpStream::connect(("127.0.0.1", target.port)).unwrap();
                let _ = client.write_all(&right().as_bytes()[..random.below(20_usize)]);
                held.push(client);
            }
            1 => {
                // One that asks and does not read.
                let mut client = TcpStream::connect(("127.0.0.1", target.port)).unwrap();
                let _ = client.write_all(right().as_bytes());
                held.push(client);
            }
            _ => {
                let request = target.hostile(&mut random);
                let mut client = TcpStream::connect(("127.0.0.1", target.port)).unwrap();
                let _ = client.write_all(&request);
                let _ = client.shutdown(Shutdown::Write);
                let mut answer = Vec::new();
                let _ = client.take(1 << 20).read_to_end(&mut answer);
                let shown = || String::from_utf8_lossy(&request).chars().take(300).collect::<String>();
                assert!(answer.len() < 2000, "{}: {} bytes", shown(), answer.len());
                let answer = String::from_utf8_lossy(&answer).into_owned();
                assert!(!answer.contains("TOP SECRET") && !answer.contains("root:"), "{}: {answer}", shown());
                assert!(answer.is_empty() || answer.starts_with("HTTP/1.1 4"), "{}: {answer}", shown());
                answers += u32::from(!answer.is_empty());
            }
        }
        if held.len() > 2 {
            held.remove(0);
        }
    }
    answers
}

#[test]
fn hostile_requests_get_nothing_and_take_no_memory() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("secret.txt"), "TOP SECRET").unwrap();
    let (_, page) = paged(folder.path(), "m", &["synthetic:head@48", "--surface", "cells"]);
    let (mut child, address) = served(&page.with_extension("oct"), &["--idle", "4"]);
    let target = Target::of(&address);
    let ask = |what: &str| {
        answered(
            target.port,
            &format!("GET /{}{what} HTTP/1.1\r\nHost: {}\r\n\r\n", target.path, target.host),
        )
    };
    // What a page asks for, as large as it may be.
    let large = format!("picture?{}&p=1", CAMERA.replace("w=64&s=48", "w=4096&s=2048"));
    assert_eq!((ask("").0, ask(&large).0, ask(&large.replace("2048", "2049")).0), (200, 200, 400));
    let (before, started) = (peak_of(&child), Instant::now());
    let count = 1000 * long();
    let answers: u32 = std::thread::scope(|scope| {
        let threads: Vec<_> = (1..3)
            .map(|seed| {
                scope.spawn({
                    let target = &target;
                    move || besiege(target, seed, count)
                })
            })
            .collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).sum()
    });
    let after = peak_of(&child);
    println!(
        "{} requests, {answers} answered, {:.1} s; memory {before} bytes at most before them, {after} after",
        2 * count,
        started.elapsed().as_secs_f64()
    );
    assert!(answers > count, "{answers}");
    // Heads of 8 KiB and buffers of 64 KiB, of sixteen at a time, and their threads.
    assert!(after < before + (8 << 20), "{before} {after}");
    assert_eq!(ask(&format!("picture?{CAMERA}")).0, 200);
    assert!(child.wait().unwrap().success());
}

/// More models than files may be open, connections that never ask, a model that is cut short and then put back.
#[test]
fn a_folder_is_served_whatever_becomes_of_its_models_and_clients() {
    let folder = tempfile::tempdir().unwrap();
    let models = folder.path().join("models");
    fs::create_dir(&models).unwrap();
    let (_, page) =
        paged(folder.path(), "m", &["synthetic:gyroid@160", "--iso", "0.5", "--surface", "cells"]);
    let model = fs::read(page.with_extension("oct")).unwrap();
    assert!(model.len() > 1 << 20, "it has to be mapped");
    for number in 0..40 {
        fs::hard_link(page.with_extension("oct"), models.join(format!("{number:03}.oct"))).unwrap();
    }
    fs::write(models.join("999.oct"), &model).unwrap();
    let script = "ulimit -Sn 45; exec \"$OCT\" view \"$1\" --no-open --idle 4";
    let mut child = Command::new("sh")
        .args(["-c", script, "sh", &text(&models)])
        .env("OCT", binary())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut address = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut address).unwrap();
    let target = Target::of(address.trim());
    let ask = |what: String| {
        let request = format!("GET /{}{what} HTTP/1.1\r\nHost: {}\r\n\r\n", target.path, target.host);
        answered(target.port, &request)
    };
    std::thread::scope(|scope| {
        for first in 0..3 {
            scope.spawn(move || {
                for number in (first..40).step_by(3) {
                    assert_eq!(ask(format!("{number}/still")).0, 200, "{number}");
                }
            });
        }
    });
    let silent: Vec<_> = (0..200).map(|_| TcpStream::connect(("127.0.0.1", target.port)).unwrap()).collect();
    assert_eq!(ask(format!("5/picture?{CAMERA}")).0, 200);
    let last = silent.last().unwrap();
    let mut refusal = String::new();
    (&*last).read_to_string(&mut refusal).unwrap();
    assert!(refusal.starts_with("HTTP/1.1 408"), "{refusal}");
    let cut = models.join("999.oct");
    assert_eq!(ask("40/".to_owned()).0, 200);
    fs::OpenOptions::new().write(true).open(&cut).unwrap().set_len(5000).unwrap();
    let (status, why) = ask("40/".to_owned());
    assert!(status == 410 && String::from_utf8_lossy(&why).contains("999.oct"), "{status}");
    assert_eq!((ask("40/still".to_owned()).0, ask("7/still".to_owned()).0), (410, 200));
    fs::write(&cut, &model).unwrap();
    assert_eq!(ask("40/still".to_owned()).0, 200);
    assert!(child.wait().unwrap().success());
}

#[test]
fn the_folder_of_a_batch_is_its_contact_sheet_with_folders_and_reasons() {
    let folder = tempfile::tempdir().unwrap();
    let (top, out) = (folder.path().join("ward"), folder.path().join("out"));
    fs::create_dir(&top).unwrap();
    oct(&["demo", "--size", "32", "--write-raw", &text(&top.join("a.raw"))]);
    let head = "ObjectType = Image\nNDims = 3\nDimSize = 32 32 32\nElementType = MET_SHORT\nElementDataFile = a.raw\n";
    fs::write(top.join("a b.mhd"), head).unwrap();
    fs::write(top.join("bad.mhd"), head.replace("a.raw", "gone.raw")).unwrap();
    let run = oct(&["batch", &text(&top), "--out", &text(&out), "--iso", "400"]);
    assert_eq!(run.code, 8, "{}", run.stderr);
    let (mut child, address) = served(&out, &["--idle", "2"]);
    let target = Target::of(&address);
    let ask = |path: &str| {
        let (status, bytes) =
            answered(target.port, &format!("GET {path} HTTP/1.1\r\nHost: {}\r\n\r\n", target.host));
        (status, String::from_utf8_lossy(&bytes).into_owned())
    };
    let at = |what: &str| ask(&format!("/{}{what}", target.path));
    let (status, sheet) = at("");
    assert!(status == 200 && sheet.contains("id=\"q\"") && sheet.contains("<dt>spacing</dt>"), "{sheet}");
    let (status, home) = at("report.js");
    assert!(status == 200 && home.contains("ward/a b.mhd") && home.contains("gone.raw"), "{home}");
    let model = names(&out).into_iter().find(|name| name.ends_with(".oct")).unwrap();
    for link in [model.clone(), format!("viewer.html?model={model}")] {
        assert_eq!(at(&link).0, 302, "{link}");
    }
    assert_eq!((at(&model.replace(".oct", ".png")).0, at("0/").0, at("report.csv").0), (200, 200, 404));
    assert_eq!(ask("/favicon.ico").0, 204);
    // A model that the batch does not know: the sheet of files shows all.
    assert!(child.wait().unwrap().success());
    fs::copy(out.join(&model), out.join("more.oct")).unwrap();
    let (mut child, address) = served(&out, &["--idle", "2"]);
    let target = Target::of(&address);
    let (_, bytes) =
        answered(target.port, &format!("GET /{} HTTP/1.1\r\nHost: {}\r\n\r\n", target.path, target.host));
    assert!(String::from_utf8_lossy(&bytes).contains("<p>2 models</p>"));
    assert!(child.wait().unwrap().success());
}

#[test]
fn scenes_and_folders_are_served_as_pages() {
    let folder = tempfile::tempdir().unwrap();
    let models = folder.path().join("models");
    fs::create_dir_all(models.join("more")).unwrap();
    let (_, page) = paged(folder.path(), "m", &["synthetic:head@32", "--surface", "cells"]);
    let model = page.with_extension("oct");
    fs::copy(&model, models.join("a <b>.oct")).unwrap();
    fs::copy(&model, models.join("more/b.oct")).unwrap();
    fs::write(models.join("bad.oct"), "no model").unwrap();
    fs::write(models.join("secret.txt"), "TOP SECRET").unwrap();
    let (mut child, address) = served(&models, &["--idle", "2"]);
    let target = Target::of(&address);
    let ask = |target: &Target, what: &str| {
        let (status, bytes) = answered(
            target.port,
            &format!("GET /{}{what} HTTP/1.1\r\nHost: {}\r\n\r\n", target.path, target.host),
        );
        (status, String::from_utf8_lossy(&bytes).into_owned())
    };
    let (status, sheet) = ask(&target, "");
    assert_eq!((status, sheet.matches("<img").count()), (200, 3), "{sheet}");
    assert!(sheet.contains("a &lt;b&gt;.oct") && sheet.contains("more/b.oct") && !sheet.contains("secret"));
    let (status, page) = ask(&target, "0/");
    assert!(status == 200 && page.contains("data-part>"));
    assert_eq!((ask(&target, "2/still").0, ask(&target, &format!("2/picture?{CAMERA}")).0), (200, 200));
    let (status, why) = ask(&target, "1/");
    assert!(status == 500 && why.contains("bad.oct"), "{why}");
    for what in ["3/", "secret.txt", "0", "-1/", "0/../", "0/secret.txt", "1e1/", "99999999999999999999/"] {
        assert_eq!(ask(&target, what).0, 404, "{what}");
    }
    assert!(child.wait().unwrap().success());
    // A scene, of which all pictures come from the server.
    let scene = folder.path().join("two.toml");
    fs::write(&scene, "[[model]]\nfile = \"m.oct\"\n[[model]]\nfile = \"m.oct\"\nmove = [40, 0, 0]\n[camera]\nview = \"top\"\n")
        .unwrap();
    let (mut child, address) = served(&scene, &["--idle", "2"]);
    let target = Target::of(&address);
    let (status, page) = ask(&target, "");
    assert!(status == 200 && page.contains("<title>two</title>") && !page.contains("data-part>"));
    assert!(page.contains("\"start\":\"v=top\""));
    let seen = |camera: &str| {
        answered(
            target.port,
            &format!("GET /{}picture?{camera} HTTP/1.1\r\nHost: {}\r\n\r\n", target.path, target.host),
        )
    };
    let (one, both) = (seen(CAMERA), seen(&CAMERA.replace("h=40", "h=90")));
    assert!(one.0 == 200 && both.0 == 200 && one.1 != both.1);
    assert!(child.wait().unwrap().success());
    // What cannot be looked at.
    fs::create_dir(folder.path().join("empty")).unwrap();
    oct(&["view", &text(&folder.path().join("empty"))]).refused(2, &["empty", "no models"]);
    fs::write(&scene, "[[model]]\nfile = \"none.oct\"\n").unwrap();
    oct(&["view", &text(&scene)]).refused(3, &["two.toml", "none.oct"]);
}

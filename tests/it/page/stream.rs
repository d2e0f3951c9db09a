//! A model in a folder of a web server, in a page that fetches it: coarse first, by ranges or without them, in frames of
//! other pages and from the contact sheet of a batch; and what a server may do wrong ends with a sentence.
//!
//! With INFOBYTE_LONG=20 two thousand damaged files are served.

use super::driver::Driver;
use super::site::{Manner, Site};
use super::*;
use infobyte::geom::Level;

/// Sums of all that a page knows of its model, and of a picture of it if that is asked for, whose program takes seconds to
/// compile; the same of every page of a model.
const SUMS: &str = r"(pictured => {
    const sum = bytes => bytes.reduce((sum, byte) => Math.imul(sum ^ byte, 16777619) >>> 0, 2166136261);
    const {head, sections} = page.model, found = {};
    for (const kind of Object.keys(sections).sort()) found[kind] = [sections[kind].length, sum(sections[kind])];
    found.texels = sum(page.model.texels);
    for (const key of ['depth', 'dims', 'nodes', 'voxels', 'leaves', 'cells', 'affine', 'value_bytes', 'value_scale', 'patient']) found[key] = head[key];
    found.labels = (head.labels ?? []).map(({number, name, color, voxels}) => [number, name, color, voxels]);
    found.list = document.getElementById('list').textContent;
    page.view.read('f=-0.5,0.7,-0.4&u=0,0,1&t=3,2,1&h=50&p=1');
    if (pictured) found.picture = sum(page.drawing.numbers(page.view, 96, 96));
    return found;
})";

/// A page that fetches a model.
fn linked(model: &Path, page: &Path) {
    let run = oct(&["export", &text(model), "-o", &text(page), "--as", "linked", "--json"]);
    assert_eq!((run.code, &run.json()["form"]), (0, &"linked".into()), "{}", run.stderr);
}

impl Driver {
    /// Waits for the end of loading; what the page says then.
    fn ended(&mut self, how: &str) -> String {
        self.until("typeof main === 'object' && !!main.dataset.opened");
        let said = self.text("$('said').textContent");
        assert_eq!(self.text("main.dataset.opened"), how, "{said}");
        said
    }
}

#[test]
fn a_page_fetches_the_same_model_as_a_page_holds() {
    let Some(browser) = chromium() else { return };
    let folder = tempfile::tempdir().unwrap();
    let mut random = Random(7);
    let map: Vec<u8> = (0..24 * 20 * 16).map(|i| if i % 5 == 0 { random.byte() % 20 } else { 3 }).collect();
    let object =
        Object { bytes: map, ..Object::new([24, 20, 16], infobyte::ScalarType::U8, [1.0, 0.5, 2.0]) };
    let labels = text(&file(folder.path(), "labels", &nrrd(&object, "raw", false, "")));
    fs::write(folder.path().join("one.raw"), [200_u8]).unwrap();
    let one = text(&folder.path().join("one.raw"));
    // A usual run ends with the fourth.
    let cases: [(&str, &[&str]); 6] = [
        ("skin", &["synthetic:head@96", "--surface", "skin", "--channels", "normal,value"]),
        ("corners", &["synthetic:sphere@40?noise=0.4", "--surface", "cells"]),
        ("walls", &[&labels, "--labels", "all", "--surface", "cells"]),
        ("leaves", &["synthetic:head@96", "--surface", "cells", "--error", "0.2"]),
        ("cells", &["synthetic:head@96", "--surface", "cells"]),
        ("a one", &[&one, "--dims", "1x1x1", "--dtype", "u8", "--iso", "100", "--surface", "skin"]),
    ];
    let mut driver = Driver::start(&browser);
    let (ranges, whole) = (Site::of(Manner::Ranges, folder.path()), Site::of(Manner::Whole, folder.path()));
    let unstated = Site::of(Manner::Unstated, folder.path());
    let count = if long() > 1 { 6 } else { 4 };
    for (number, (name, arguments)) in cases.into_iter().enumerate().take(count) {
        let (_, page) = paged(folder.path(), name, arguments);
        linked(&page.with_extension("oct"), &folder.path().join("viewer.html"));
        driver.open(&page, "");
        driver.ended("whole");
        // What a server can do says nothing of what the model is: two of them try all.
        let sites = [&ranges, &whole, &unstated];
        let sites = if long() > 1 || number % 4 == 1 { &sites[..] } else { &sites[..1] };
        // The same numbers give the same picture: of skin, of cells and of walls.
        let is_pictured = long() > 1 || number < 3;
        let sums = format!("{SUMS}({is_pictured})");
        let pictured = driver.ask(&sums);
        let wanted = driver.ask(&format!("{SUMS}(false)"));
        for site in sites {
            for query in ["", "?model=./"] {
                let query = if query.is_empty() { String::new() } else { format!("{query}{name}.oct") };
                driver.visit("about:blank");
                driver.visit(&site.address(&format!("viewer.html{query}")));
                assert_eq!(driver.ended("whole"), "", "{name}");
                assert_eq!(driver.ask(&format!("{SUMS}(false)")), wanted, "{name}{query}");
                assert_eq!(driver.text("document.title"), name);
                // The page's own picture is of its own model.
                assert_eq!(driver.ask("$('still').hidden"), !query.is_empty());
            }
        }
        assert_eq!(driver.ask(&sums), pictured, "{name}");
    }
}

#[test]
fn the_coarse_model_comes_first_and_is_that_of_its_depth() {
    let Some(browser) = chromium_at_length() else { return };
    let folder = tempfile::tempdir().unwrap();
    let mut driver = Driver::start(&browser);
    for (name, arguments) in [
        ("cells", &["synthetic:head@128", "--surface", "cells"][..]),
        ("leaves", &["synthetic:head@256", "--surface", "cells", "--error", "0.1"]),
        ("skin", &["synthetic:head@256", "--surface", "skin"]),
    ] {
        let (model, page) = paged(folder.path(), name, arguments);
        linked(&page.with_extension("oct"), &page);
        let normals = model
            .sections()
            .iter()
            .find(|entry| entry.kind.is_some_and(|kind| kind.tag() == *b"NORM"))
            .unwrap();
        let site = Site::of(Manner::Gated(normals.offset as usize), folder.path());
        driver.visit("about:blank");
        driver.visit(&site.address(&format!("{name}.html")));
        driver.whole();
        let head = driver.ask("page.model.head");
        let (size, depth) = (head["coarse"].as_u64().unwrap(), head["depth"].as_u64().unwrap());
        assert_eq!(size << depth, 1 << model.view().depth(), "{head}");
        let level = model.frame().level(Level::new(u32::try_from(depth).unwrap()));
        assert_eq!(
            (head["nodes"].as_u64(), head["voxels"].as_u64()),
            (Some(level.start), Some(level.end - level.start))
        );
        let sent = site.sent.load(std::sync::atomic::Ordering::Acquire);
        let bytes = model.header().file_bytes;
        assert!(
            sent + 2 * model.header().voxels <= bytes,
            "{name}: {sent} of {bytes} bytes before the normals"
        );
        assert!(driver.text("$('said').textContent").starts_with("Opening the model"));
        // What is drawn is what is picked, and where the model is: no ray passes through more than it does.
        let differ = "(() => {
            const found = page.drawing.numbers(page.view, 64, 64);
            let differ = 0, hits = 0;
            for (let i = 0; i < 64 * 64; i++) {
                const hit = page.view.pick(page.model, (2 * (i % 64) + 1) / 64 - 1, 1 - (2 * (i >> 6) + 1) / 64, 1);
                const box = hit ? (hit.voxel < 0 ? hit.leaf : hit.voxel + page.model.nodes) + 1 : 0;
                differ += box !== found[4 * i];
                hits += !!hit;
            }
            return [differ, hits];
        })()";
        let coarse = driver.ask(differ);
        assert!(coarse[0].as_u64().unwrap() <= 4 && coarse[1].as_u64().unwrap() > 1000, "{name}: {coarse}");
        driver.click([160.0, 120.0]);
        assert_eq!(driver.text("$('said').textContent"), "Positions come with the whole model.");
        driver.fine();
        driver.shot(&format!("coarse-{name}"));
        let state = driver.text("page.view.toString()");
        site.gate.store(true, std::sync::atomic::Ordering::Release);
        assert_eq!(driver.ended("whole"), "");
        assert_eq!(
            driver.ask("[page.model.head.coarse ?? 0, page.model.voxels]"),
            serde_json::json!([0, model.header().voxels])
        );
        assert_eq!(driver.text("page.view.toString()"), state, "the view stays");
        let fine = driver.ask(differ);
        assert!(fine[1].as_u64() <= coarse[1].as_u64(), "{name}: {coarse} {fine}");
        driver.click([160.0, 120.0]);
        assert!(driver.text("$('said').textContent").starts_with("x "));
        driver.fine();
        driver.shot(&format!("whole-{name}"));
    }
}

#[test]
fn answers_that_no_server_should_give_end_with_a_sentence() {
    let Some(browser) = chromium_at_length() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (_, page) = paged(folder.path(), "m", &["synthetic:head@128", "--surface", "cells"]);
    linked(&page.with_extension("oct"), &page);
    let mut driver = Driver::start(&browser);
    for (manner, sentence, is_seen) in [
        (Manner::Status(404), "m.oct is not on the server.", false),
        (Manner::Status(403), "m.oct is refused: 403.", false),
        (Manner::Status(416), "m.oct is refused: 416.", false),
        (Manner::Status(500), "m.oct is refused: 500.", false),
        (Manner::Short, "m.oct is ", false),
        (Manner::Elsewhere, "m.oct came in a wrong part.", false),
        (Manner::Unnamed, "m.oct came in a wrong part.", false),
        (Manner::Tagged, "m.oct has changed: load the page again.", true),
        (Manner::Grown, "m.oct has changed: load the page again.", true),
        (Manner::Rewritten, "m.oct is damaged, or has changed: load the page again.", true),
        (Manner::Silent, "m.oct cannot be fetched: no answer.", true),
    ] {
        let site = Site::of(manner, folder.path());
        driver.visit("about:blank");
        driver.visit(&site.address("m.html"));
        let said = driver.ended("failed");
        assert!(said.starts_with(sentence), "{manner:?}: {said}");
        // What has come is shown, or the picture of the page.
        let seen = driver.ask("[main.classList.contains('live'), !!page.model?.head.coarse, getComputedStyle($('still')).visibility]");
        let still = if is_seen { "hidden" } else { "visible" };
        assert_eq!(seen, serde_json::json!([is_seen, is_seen, still]), "{manner:?}");
        driver.shot(&format!("answer-{manner:?}"));
    }
    // What is no model, or none of this page's.
    let sound = fs::read(page.with_extension("oct")).unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::write(at("empty.oct"), b"").unwrap();
    fs::write(at("foreign.oct"), vec![7_u8; 100_000]).unwrap();
    fs::write(at("cut.oct"), &sound[..sound.len() / 2]).unwrap();
    let mut later = sound.clone();
    later[8] = 2;
    let sum = crc32c::crc32c(&later[..60]);
    later[60..64].copy_from_slice(&sum.to_le_bytes());
    fs::write(at("later.oct"), later).unwrap();
    assert_eq!(oct(&["pack", &text(&page.with_extension("oct")), "-o", &text(&at("packed.oct"))]).code, 0);
    oct(&["export", &text(&at("packed.oct")), "-o", &text(&at("p.html")), "--as", "linked"])
        .refused(3, &["packed.oct", "unpack"]);
    for manner in [Manner::Ranges, Manner::Whole] {
        let site = Site::of(manner, folder.path());
        for (name, sentence) in [
            ("none.oct", "is not on the server."),
            ("empty.oct", "is "),
            ("foreign.oct", "is not a model, or cut short."),
            ("cut.oct", "is cut short."),
            ("later.oct", "is newer than this page."),
            ("packed.oct", "is packed: use oct unpack."),
        ] {
            driver.visit(&site.address(&format!("m.html?model={name}")));
            driver.until(&format!("location.search.endsWith('{name}') && typeof main === 'object'"));
            let said = driver.ended("failed");
            assert!(said.starts_with(&format!("{name} {sentence}")), "{manner:?}: {said}");
        }
        driver.visit(&site.address("m.html?model=https://127.0.0.1/m.oct"));
        driver.until("location.search.includes('https')");
        assert_eq!(driver.ended("failed"), "A page shows models of its own server only.");
    }
    // A file's page may read no other.
    driver.visit(&format!("file://{}", page.display()));
    driver.until("location.protocol === 'file:' && typeof main === 'object'");
    assert!(driver.ended("failed").contains("oct view shows m.oct"));
}

#[test]
fn damaged_models_that_are_served_give_a_sentence_or_a_picture() {
    let Some(browser) = chromium_at_length() else { return };
    let folder = tempfile::tempdir().unwrap();
    let mut driver = Driver::start(&browser);
    let (mut refused, mut opened) = (0, 0);
    for (seed, (name, arguments)) in (1_u64..).zip([
        ("skin", &["synthetic:head@32", "--surface", "skin"][..]),
        ("corners", &["synthetic:sphere@32?noise=0.4", "--surface", "cells"]),
        ("leaves", &["synthetic:head@48", "--surface", "cells", "--error", "0.2"]),
    ]) {
        let (_, page) = paged(folder.path(), name, arguments);
        linked(&page.with_extension("oct"), &page);
        let (sound, html) = (fs::read(page.with_extension("oct")).unwrap(), fs::read(&page).unwrap());
        let site = Site::start(if seed == 2 { Manner::Whole } else { Manner::Ranges }, move |file| {
            if file.ends_with(".html") {
                return Some(html.clone());
            }
            let number = file.strip_prefix("bad-").and_then(|rest| rest.strip_suffix(".oct"));
            Some(number.map_or_else(
                || sound.clone(),
                |number| damaged(&sound, seed * 100_000 + number.parse::<u64>().unwrap()),
            ))
        });
        driver.visit(&site.address("page.html"));
        driver.whole();
        driver.ended("whole");
        driver.ask(&format!("{}; true", include_str!("served.js")));
        driver.ask("page.drawing.numbers(page.view, 8, 8).length");
        for batch in 0..long() {
            let said = driver.ask(&format!("served(17, {})", batch * 17));
            assert_eq!(said["strange"], serde_json::json!([]), "{name}: {said}");
            refused += said["refused"].as_u64().unwrap();
            opened += said["opened"].as_u64().unwrap();
            println!("{name}, {batch}: {said}");
        }
        driver.key("7");
        driver.whole();
    }
    println!("{refused} refused, {opened} opened");
    assert!(refused > 20 && opened > 0, "{refused} {opened}");
}

/// A damaged file, of which most sums are right again.
fn damaged(sound: &[u8], seed: u64) -> Vec<u8> {
    let mut random = Random(seed);
    let table = HEADER_BYTES + Frame::read(sound).unwrap().sections.len() * ENTRY_BYTES;
    let mut bad = sound.to_vec();
    if seed.is_multiple_of(5) {
        // The header or the table, too, with sums that are right.
        for _ in 0..=random.below(3) {
            let at = 12 + random.below(table - 12);
            bad[at] = random.byte();
        }
        let sum = crc32c::crc32c(&bad[HEADER_BYTES..table]);
        bad[56..60].copy_from_slice(&sum.to_le_bytes());
        let sum = crc32c::crc32c(&bad[..60]);
        bad[60..64].copy_from_slice(&sum.to_le_bytes());
        return bad;
    }
    if seed.is_multiple_of(7) {
        bad.truncate(random.below(bad.len()));
        return bad;
    }
    for _ in 0..1 + random.below(6) {
        let at = table + random.below(bad.len() - table);
        bad[at] = random.byte();
    }
    if seed.is_multiple_of(3) { bad } else { crate::damage::forge_crcs(&bad, sound) }
}

/// The page that the documentation gives.
fn page_of_docs() -> String {
    let docs = include_str!("../../../src/jobs/COMMANDS.md");
    docs.split_once("```html\n").unwrap().1.split_once("```").unwrap().0.to_owned()
}

/// Fetches wait in a page that has what is seen, until they are let go.
const HELD: &str = r"{
    const real = window.fetch;
    const held = new Promise(done => { window.release = done; });
    window.fetch = async (...all) => {
        if (typeof page === 'object' && page.model?.head.coarse === 1) await held;
        return real(...all);
    };
}";

#[test]
fn normals_that_are_seen_come_before_the_others() {
    let Some(browser) = chromium() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (model, page) = paged(folder.path(), "m", &["synthetic:head@512", "--surface", "skin"]);
    linked(&page.with_extension("oct"), &page);
    let site = Site::of(Manner::Ranges, folder.path());
    let mut driver = Driver::start(&browser);
    driver.call("Page.addScriptToEvaluateOnNewDocument", serde_json::json!({ "source": HELD }));
    driver.visit(&site.address("m.html"));
    driver.until("typeof main === 'object' && page.model?.head.coarse === 1 && !!page.drawing");
    let pictures = "['front', 'back'].map(name => (page.view.named(name, 4 / 3), page.drawing.numbers(page.view, 200, 150)))";
    driver.ask(&format!("window.early = {pictures}; true"));
    let sent = site.sent.load(std::sync::atomic::Ordering::Acquire);
    let (all, normals) = (model.header().file_bytes, 2 * model.header().voxels);
    println!("{sent} of {all} bytes for what is seen");
    assert!(sent + normals / 4 < all, "{sent} of {all}");
    driver.ask("window.release(); true");
    assert_eq!(driver.ended("whole"), "");
    driver.ask(&format!("window.late = {pictures}; true"));
    let other = "window.late.map((words, k) => words.filter((word, i) => i % 4 > 1 && word !== window.early[k][i]).length)";
    let [front, back] = [0, 1].map(|k| driver.number(&format!("{other}[{k}]")));
    println!("{front} other words of normals in front, {back} behind");
    // Some pixels are between those that were looked at.
    assert!(front < 0.002 * 30000.0 && back > 0.1 * 30000.0, "{front} and {back} words of 30000 pixels");
    let again = site.sent.load(std::sync::atomic::Ordering::Acquire);
    assert!(again < all + (1 << 16), "{again} of {all} bytes: nothing is fetched twice");
}

#[test]
fn a_page_of_twenty_lines_shows_models_in_frames() {
    let Some(browser) = chromium() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (_, page) = paged(folder.path(), "bone", &["synthetic:head@48", "--surface", "cells"]);
    linked(&page.with_extension("oct"), &folder.path().join("viewer.html"));
    fs::copy(page.with_extension("oct"), folder.path().join("implant.oct")).unwrap();
    let docs = page_of_docs();
    assert!(docs.lines().count() <= 20, "{docs}");
    fs::write(folder.path().join("embeds.html"), docs).unwrap();
    let site = Site::of(Manner::Ranges, folder.path());
    let mut driver = Driver::start(&browser);
    for (name, size, is_phone, is_dark) in
        [("desktop", [900, 600], false, false), ("phone", [390, 844], true, true)]
    {
        let scheme = if is_dark { "dark" } else { "light" };
        let feature =
            serde_json::json!({ "features": [{ "name": "prefers-color-scheme", "value": scheme }] });
        driver.call("Emulation.setEmulatedMedia", feature);
        driver.size(size, is_phone);
        driver.visit("about:blank");
        driver.visit(&site.address("embeds.html"));
        let frames = "[...document.querySelectorAll('iframe')].map(frame => frame.contentDocument?.querySelector('main'))";
        // The fine picture of the larger ones takes software for graphics a minute.
        let drawn =
            if is_phone { "main.dataset.drawn === 'fine'" } else { "main.classList.contains('live')" };
        driver.until(&format!(
            "{frames}.length === 2 && {frames}.every(main => main?.dataset.opened === 'whole' && {drawn})"
        ));
        assert_eq!(driver.ask("document.documentElement.scrollWidth <= innerWidth"), true, "{name}");
        driver.shot(&format!("embeds-{name}-{scheme}"));
    }
    // Another model in the same place.
    driver.ask("document.querySelector('infobyte-view').setAttribute('src', 'none.oct'), true");
    driver.until("document.querySelector('infobyte-view iframe').contentDocument?.querySelector('#said')?.textContent === 'none.oct is not on the server.'");
}

#[test]
fn the_contact_sheet_of_a_batch_leads_to_its_models() {
    let Some(browser) = chromium() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (top, out) = (folder.path().join("in"), folder.path().join("out"));
    fs::create_dir(&top).unwrap();
    for name in ["a b&c", "d#e"] {
        let ball: Vec<u8> = (0..24_u32.pow(3))
            .map(|i| {
                [i % 24, i / 24 % 24, i / 576].map(|c| (f64::from(c) - 11.5).powi(2)).iter().sum::<f64>()
            })
            .map(|r| if r < 90.0 { 200 } else { 0 })
            .collect();
        let mut object = Object { bytes: ball, ..Object::new([24; 3], infobyte::ScalarType::U8, [1.0; 3]) };
        object.bytes[0] = name.len() as u8;
        fs::write(top.join(format!("{name}.nrrd")), nrrd(&object, "raw", false, "")).unwrap();
    }
    let run = oct(&["batch", &text(&top), "--out", &text(&out), "--iso", "100"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let site = Site::of(Manner::Ranges, &out);
    let mut driver = Driver::start(&browser);
    driver.size([1280, 800], false);
    driver.visit(&site.address("index.html"));
    driver.until("document.readyState === 'complete' && document.querySelectorAll('.shot a').length === 2");
    driver.shot("sheet");
    let name = driver.text("document.querySelector('h3').textContent");
    driver.ask("document.querySelector('.shot a').click(), true");
    driver.until("location.pathname === '/viewer.html' && typeof main === 'object'");
    assert_eq!(driver.ended("whole"), "");
    assert_eq!(driver.text("document.title"), name);
    driver.fine();
    driver.shot("sheet-model");
    // From a file the pictures lead to larger ones, and the page of a model says what to do.
    driver.visit(&format!("file://{}/index.html", out.display()));
    driver.until("location.protocol === 'file:' && document.querySelectorAll('.shot a').length === 2");
    assert!(driver.text("document.querySelector('.shot a').href").ends_with(".png"));
    driver.visit(&format!("file://{}/viewer.html?model=a.oct", out.display()));
    driver.until("location.pathname.endsWith('viewer.html') && typeof main === 'object'");
    assert!(driver.ended("failed").contains("oct view shows a.oct"));
    driver.shot("sheet-file");
}

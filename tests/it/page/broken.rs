//! Models that are damaged, in pages and on the way into them: a sentence or a picture, no hang, and no tab that is lost.
//!
//! With INFOBYTE_LONG=20 a thousand models are damaged within pages, and nearly as many files.

use super::driver::Driver;
use super::*;
use infobyte::jobs::export::{ExportRequest, export};

/// Texts of a page's elements with data, and its head.
fn data_of(html: &str) -> (Vec<&str>, &str) {
    let parts = html.split("data-part>").skip(1).map(|part| part.split_once("</script>").unwrap().0);
    let (_, head) = html.split_once("id=\"head\">").unwrap();
    (parts.collect(), head.split_once("</script>").unwrap().0)
}

#[test]
fn damaged_models_give_a_sentence_or_a_picture_and_the_graphics_live_on() {
    let Some(browser) = chromium_at_length() else { return };
    let folder = tempfile::tempdir().unwrap();
    let mut driver = Driver::start(&browser);
    let cases: [(&str, &[&str]); 3] = [
        ("skin", &["synthetic:head@32", "--surface", "skin"]),
        ("corners", &["synthetic:sphere@32?noise=0.4", "--surface", "cells"]),
        ("leaves", &["synthetic:head@48", "--surface", "cells", "--error", "0.2"]),
    ];
    let (mut refused, mut opened, mut met) = (0, 0, 0);
    for (seed, (name, arguments)) in (1..).zip(cases) {
        let (_, page) = paged(folder.path(), name, arguments);
        driver.open(&page, "");
        let html = fs::read_to_string(&page).unwrap();
        let (parts, head) = data_of(&html);
        driver.ask(&format!("globalThis.KEPT = {}; true", serde_json::json!(parts)));
        driver.ask(&format!("globalThis.HEAD = {}; true", serde_json::json!(head)));
        driver.ask(&format!("{}; true", include_str!("broken.js")));
        // The program for numbers, which all share.
        driver.ask("page.drawing.numbers(page.view, 8, 8).length");
        for batch in 0..long() {
            let said = driver.ask(&format!("broken(17, {})", seed * 1000 + batch));
            assert_eq!(said["strange"], serde_json::json!([]), "{name}: {said}");
            let count = |key: &str| said[key].as_u64().unwrap();
            refused += count("refused");
            opened += count("opened");
            met += count("met");
            println!("{name}, {batch}: {said}");
        }
        // The page itself is as it was.
        driver.key("7");
        driver.whole();
    }
    println!("{refused} refused, {opened} opened, {met} of them seen");
    assert!(refused > 10 && opened > 10 && met > 5, "{refused} {opened} {met}");
}

#[test]
fn pages_that_are_cut_or_changed_end_with_a_sentence() {
    let Some(browser) = chromium_at_length() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (_, page) = paged(folder.path(), "m", &["synthetic:head@32", "--surface", "cells"]);
    let html = fs::read(&page).unwrap();
    let text = str::from_utf8(&html).unwrap();
    let begins = text.find("data-part>").unwrap();
    let mut driver = Driver::start(&browser);
    let mut random = Random(30);
    let (mut failed, mut whole) = (0, 0);
    for round in 0..12 * long() {
        let mut bad = html.clone();
        let at = begins + random.below(html.len() - begins);
        if round % 3 == 0 {
            bad.truncate(at);
        } else {
            let some = random.below(4_u32);
            (0..=some).for_each(|_| {
                bad[begins + random.below(html.len() - begins)] = b"Az09+/=<\"\n"[random.below(10_usize)]
            });
        }
        let path = folder.path().join(format!("bad-{}.html", round % 2));
        fs::write(&path, &bad).unwrap();
        driver.visit("about:blank");
        driver.visit(&format!("file://{}", path.display()));
        driver.until("typeof main === 'object' && !!main.dataset.opened");
        let said = driver.text("$('said').textContent");
        if driver.ask("main.dataset.opened") == "failed" {
            failed += 1;
            assert!(said.contains(' ') && said.len() > 20 && !said.contains("undefined"), "{said}");
            assert_eq!(driver.ask("getComputedStyle($('still')).visibility"), "visible");
        } else {
            whole += 1;
            driver.whole();
        }
    }
    println!("{failed} pages end with a sentence, {whole} with a picture");
    assert!(failed > 4, "{failed} {whole}");
}

#[test]
fn damaged_files_become_a_sentence_or_a_page_that_opens() {
    let folder = tempfile::tempdir().unwrap();
    let (_, page) = paged(folder.path(), "m", &["synthetic:head@32", "--surface", "cells"]);
    let sound = fs::read(page.with_extension("oct")).unwrap();
    let (path, out) = (folder.path().join("bad.oct"), folder.path().join("bad.html"));
    let table = HEADER_BYTES + Frame::read(&*sound).unwrap().sections.len() * ENTRY_BYTES;
    let request = ExportRequest::of(ExportForm::Html);
    let mut random = Random(31);
    let (mut refused, mut pages) = (0, Vec::new());
    for round in 0..40 * long() {
        let mut bad = sound.clone();
        for _ in 0..1 + random.below(8) {
            let at = table + random.below(bad.len() - table);
            bad[at] = random.byte();
        }
        // Sums that are right again, so that what they guard is read.
        fs::write(&path, if round % 4 == 0 { bad } else { crate::damage::forge_crcs(&bad, &sound) }).unwrap();
        match export(&path, &out, request, &Silent) {
            Ok(_) => pages.push(fs::read(&out).unwrap()),
            Err(error) => {
                refused += 1;
                assert!(error.to_string().contains("bad.oct"), "{error}");
            }
        }
    }
    println!("{refused} refused, {} became pages", pages.len());
    assert!(refused > 20, "{refused}");
    let Some(browser) = chromium() else { return };
    let mut driver = Driver::start(&browser);
    for html in pages.iter().take(if long() > 1 { 40 } else { 10 }) {
        fs::write(&out, html).unwrap();
        driver.open(&out, "");
    }
}

//! A page in a user's hands: mouse, wheel, fingers and keys as the browser gets them, another size, another page and back,
//! graphics that are lost, and what is read to those who do not see.

use super::driver::Driver;
use super::*;

const SIZE: [u32; 2] = [640, 440];
const MIDDLE: [f64; 2] = [320.0, 220.0];

/// A page of a head, and a browser that shows it.
fn shown_head(folder: &Path) -> Option<(Driver, PathBuf)> {
    shown_by(Driver::start, folder)
}

fn shown_by(start: impl Fn(&Path) -> Driver, folder: &Path) -> Option<(Driver, PathBuf)> {
    let browser = chromium()?;
    let (_, page) = paged(folder, "head", &["synthetic:head@48", "--surface", "cells"]);
    let mut driver = start(&browser);
    driver.size(SIZE, false);
    driver.open(&page, "");
    Some((driver, page))
}

impl Driver {
    fn state(&mut self) -> String {
        self.text("page.view.toString()")
    }

    /// The view as at the beginning, without points.
    fn reset(&mut self) {
        self.ask("canvas.focus(), document.activeElement === canvas");
        self.key("Escape");
        self.key("0");
    }

    /// Keeps the point of the model at the picture's middle, and says where it is on the page.
    fn mark(&mut self) -> [f64; 2] {
        self.ask("globalThis.marked = page.view.pick(page.model, 0, 0, aspect()).at; true");
        self.marked()
    }

    fn marked(&mut self) -> [f64; 2] {
        let at = self.ask("onPage(marked)");
        [0, 1].map(|a| at[a].as_f64().unwrap())
    }

    fn is_near(&mut self, wanted: [f64; 2], what: &str) {
        let at = self.marked();
        assert!((0..2).all(|a| (at[a] - wanted[a]).abs() < 1.5), "{what}: {at:?}, not {wanted:?}");
    }

    fn said(&mut self) -> String {
        self.text("$('said').textContent")
    }
}

#[test]
fn a_model_follows_the_mouse_the_wheel_and_fingers() {
    let folder = tempfile::tempdir().unwrap();
    let Some((mut page, path)) = shown_head(folder.path()) else { return };
    // What is in front goes with the mouse.
    page.reset();
    let from = page.mark();
    page.drag(MIDDLE, [60.0, 0.0], "left");
    assert!(page.marked()[0] > from[0] + 10.0, "{:?}", page.marked());
    page.reset();
    page.drag(MIDDLE, [0.0, 40.0], "left");
    assert!(page.marked()[1] > from[1] + 5.0, "{:?}", page.marked());
    page.reset();
    page.drag(MIDDLE, [-80.0, 50.0], "right");
    page.is_near([from[0] - 80.0, from[1] + 50.0], "pan");
    // The place under the pointer stays there.
    for turn in [-240.0, 240.0] {
        page.reset();
        let half = page.number("page.view.half");
        page.drag(MIDDLE, [80.0, -40.0], "right");
        let at = page.marked();
        page.wheel(at, turn);
        page.until(&format!("page.view.half !== {half}"));
        assert_eq!(page.number("page.view.half") < half, turn < 0.0);
        page.is_near(at, "wheel");
    }
    // The face of a cut looks at the viewer, and the menu follows the key.
    page.ask("page.view.named('back', aspect()), cutBy('y'), changed(''), true");
    assert!(page.state().ends_with("&c=y,0.5,1"), "{}", page.state());
    page.reset();
    assert_eq!(page.text("$('named').value"), "front");
    // A click is no drag, and a drag no click.
    page.reset();
    let before = page.state();
    page.click(MIDDLE);
    assert_eq!((page.state(), page.number("page.points.length")), (before, 1.0));
    page.drag(MIDDLE, [30.0, 0.0], "left");
    assert_eq!(page.number("page.points.length"), 1.0);
    // Fingers, on a phone.
    page.size([390, 844], true);
    page.open(&path, "#");
    page.reset();
    let middle = page.mark();
    page.touch(&[middle], &[[middle[0] + 50.0, middle[1]]]);
    assert!(page.marked()[0] > middle[0] + 5.0, "{:?}", page.marked());
    page.reset();
    let half = page.number("page.view.half");
    let aside = |by: f64| [middle[0] + by, middle[1]];
    page.touch(&[aside(-40.0), aside(40.0)], &[aside(-80.0), aside(80.0)]);
    let now = page.number("page.view.half");
    assert!((half / now - 2.0).abs() < 0.05, "{half} {now}");
    page.is_near(middle, "pinch");
    page.touch(&[middle], &[middle]);
    assert_eq!(page.number("page.points.length"), 1.0, "a tap");
    // A phone's page is not zoomed or scrolled by it.
    assert_eq!(page.ask("[visualViewport.scale, scrollX, scrollY]"), serde_json::json!([1, 0, 0]));
}

#[test]
fn places_distances_and_angles_are_those_of_the_model() {
    let folder = tempfile::tempdir().unwrap();
    let Some((mut page, _)) = shown_head(folder.path()) else { return };
    page.reset();
    let places = [MIDDLE, [345.0, 200.0], [300.0, 190.0]];
    let picks: Vec<[f64; 3]> = places
        .iter()
        .map(|at| {
            let found =
                page.ask(&format!("page.view.pick(page.model, ...place({}, {}), aspect()).at", at[0], at[1]));
            [0, 1, 2].map(|a| found[a].as_f64().unwrap())
        })
        .collect();
    page.click(places[0]);
    let said = page.said();
    let wanted = format!("x {:.2}, y {:.2}, z {:.2} mm", picks[0][0], picks[0][1], picks[0][2]);
    assert!(said.starts_with(&wanted), "{said}, not {wanted}");
    page.click([20.0, 300.0]);
    assert_eq!(page.said(), "Nothing is there.");
    let from = |a: usize, b: usize| [0, 1, 2].map(|i| picks[a][i] - picks[b][i]);
    let length = |v: [f64; 3]| dot(v, v).sqrt();
    page.key("m");
    page.click(places[0]);
    page.click(places[1]);
    let said = page.said();
    let mm: f64 = said.strip_prefix("distance ").unwrap().strip_suffix(" mm").unwrap().parse().unwrap();
    assert!((mm - length(from(0, 1))).abs() < 0.01, "{said}");
    page.shot("distance");
    page.key("m");
    places.iter().for_each(|at| page.click(*at));
    let said = page.said();
    let degrees: f64 = said.strip_prefix("angle ").unwrap().strip_suffix('°').unwrap().parse().unwrap();
    let (one, other) = (from(0, 1), from(2, 1));
    let wanted = (dot(one, other) / length(one) / length(other)).acos().to_degrees();
    assert!((degrees - wanted).abs() < 0.06, "{said}, not {wanted}");
    page.shot("angle");
    page.key("Escape");
    assert_eq!(page.number("$('marks').childElementCount + page.points.length"), 0.0);
    // Behind the plane nothing is picked.
    page.key("m");
    page.ask("page.view.read('c=sight,1'), changed(), true");
    page.click(MIDDLE);
    assert_eq!(page.said(), "Nothing is there.");
}

#[test]
fn a_page_is_used_without_a_mouse_and_read_aloud() {
    let folder = tempfile::tempdir().unwrap();
    let Some((mut page, _)) = shown_head(folder.path()) else { return };
    // From one control to the next, all of them, each with a mark of its own.
    let mut reached = Vec::new();
    for _ in 0..20 {
        page.key("Tab");
        let at = page.text("document.activeElement.id || document.activeElement.tagName");
        assert!(
            at == "BODY"
                || page.ask("getComputedStyle(document.activeElement).outlineStyle !== 'none'") == true,
            "{at} has no mark"
        );
        reached.push(at);
    }
    for id in ["canvas", "named", "projection", "cut", "tool", "dark", "save", "help"] {
        assert!(reached.iter().any(|at| at == id), "{id} of {reached:?}");
    }
    let focus = |page: &mut Driver, id: &str| {
        page.ask("document.activeElement.blur(), canvas.focus(), true");
        for _ in 0..20 {
            if page.text("document.activeElement.id") == id {
                return;
            }
            page.key("Tab");
        }
        panic!("{id} is not reached");
    };
    focus(&mut page, "named");
    page.key("ArrowDown");
    let state = page.state();
    assert!(state.starts_with("f=0,-1,0&"), "back: {state}");
    focus(&mut page, "cut");
    page.key("ArrowDown");
    focus(&mut page, "place");
    (0..10).for_each(|_| page.key("ArrowRight"));
    assert!(page.state().ends_with("&c=x,0.51"), "{}", page.state());
    focus(&mut page, "flip");
    page.key("Enter");
    assert!(page.state().ends_with("&c=x,0.51,1"), "{}", page.state());
    focus(&mut page, "help");
    page.key(" ");
    assert_eq!(page.ask("$('keys').hidden"), false);
    page.reset();
    for (key, held) in
        [("ArrowLeft", 0), ("ArrowUp", 0), ("ArrowDown", 8), ("+", 0), ("p", 0), ("c", 0), ("7", 0)]
    {
        let before = page.state();
        page.key_with(key, held);
        assert_ne!(page.state(), before, "{key}");
    }
    page.reset();
    let before = page.state();
    page.key_with("s", 2);
    page.key_with("p", 2);
    assert_eq!(page.state(), before, "keys with control are the browser's");
    page.key("Enter");
    let said = page.said();
    assert!(said.starts_with("x "), "{said}");
    // What is read: everything that can be used has a name, the state of what is pressed, and what was found.
    let tree = page.call("Accessibility.getFullAXTree", serde_json::json!({}));
    let nodes: Vec<&Value> =
        tree["nodes"].as_array().unwrap().iter().filter(|node| node["ignored"] == false).collect();
    let is = |node: &Value, name: &str| {
        node["properties"]
            .as_array()
            .is_some_and(|all| all.iter().any(|one| one["name"] == name && one["value"]["value"] == true))
    };
    let used: Vec<&&Value> =
        nodes.iter().filter(|node| is(node, "focusable") && node["role"]["value"] != "RootWebArea").collect();
    assert!(used.len() >= 8, "{}", used.len());
    for node in used {
        assert_ne!(node["name"]["value"].as_str().unwrap_or_default(), "", "{node}");
    }
    let status = nodes.iter().find(|node| node["role"]["value"] == "status").unwrap();
    assert!(status["properties"].to_string().contains("polite"), "{status}");
    assert!(nodes.iter().any(|node| node["name"]["value"] == said.as_str()), "{said} is not read");
}

#[test]
fn a_page_keeps_its_state_in_another_size_reloaded_and_after_another_page() {
    let folder = tempfile::tempdir().unwrap();
    let Some((mut page, path)) = shown_head(folder.path()) else { return };
    for (size, is_phone) in
        [([390, 844], true), ([1200, 500], false), ([800, 600], false), ([320, 480], true)]
    {
        page.size(size, is_phone);
        let ratio = if is_phone { 2 } else { 1 };
        // On a phone and a narrow page the tools have two rows of their own, on a low one a row.
        let height = size[1] - if size[0] <= 860 { 84 } else { 48 };
        page.until(&format!("canvas.width === {} && canvas.height === {}", ratio * size[0], ratio * height));
        page.whole();
        assert_eq!(page.ask("document.documentElement.scrollWidth <= innerWidth"), true, "{size:?}");
        let within = "(box => !box.width || box.right <= innerWidth && box.bottom <= 84)(tool.getBoundingClientRect())";
        assert_eq!(page.ask(&format!("[...$('tools').children].every(tool => {within})")), true, "{size:?}");
        let name = "getComputedStyle($('said'), '::before').content";
        assert!(page.ask(name).as_str().is_some_and(|name| name.starts_with("\"head · ")), "{size:?}");
    }
    page.size([320, 240], false);
    page.reset();
    ["2", "p", "c", "ArrowLeft", "b", "+"].iter().for_each(|key| page.key(key));
    let state = page.state();
    page.until(&format!("location.hash === '#{state}'"));
    page.fine();
    page.shot("state");
    // The address has seven digits.
    let boxes = "[...page.drawing.numbers(page.view, 64, 64)].filter((_, i) => i % 4 === 0)";
    let before = page.ask(boxes);
    page.ask("globalThis.old = true");
    page.call("Page.reload", serde_json::json!({}));
    page.until("typeof page === 'object' && !globalThis.old && !!page.view");
    page.fine();
    assert_eq!(page.state(), state);
    let after = page.ask(boxes);
    let pairs = before.as_array().unwrap().iter().zip(after.as_array().unwrap());
    assert!(pairs.filter(|(a, b)| a != b).count() <= 8, "another picture");
    page.visit("about:blank");
    page.until("location.href === 'about:blank'");
    page.back();
    page.until("typeof page === 'object' && !!page.view");
    page.whole();
    assert_eq!(page.state(), state, "back");
    // A link to another state, and back from there.
    page.ask("location.hash = 'f=1,0,0&u=0,0,1', true");
    page.until("page.view.toString().startsWith('f=1,0,0&')");
    page.whole();
    page.back();
    page.until(&format!("page.view.toString() === '{state}'"));
    // An address without sense, of a page that has shown nothing yet.
    page.visit("about:blank");
    page.open(&path, "#f=0,0,0&u=NaN&t=1e99,0,0&h=-5&c=w,9&p=x&x=9..1,..,%00");
    assert!(page.state().starts_with("f=0,1,0&u=0,0,1&"), "{}", page.state());
}

#[test]
fn a_page_comes_back_when_the_graphics_were_lost() {
    let folder = tempfile::tempdir().unwrap();
    let Some((mut page, _)) = shown_by(Driver::drawing, folder.path()) else { return };
    let drawn = "page.drawing.numbers(page.view, 32, 32).reduce((sum, n) => sum + n % 1000, 0)";
    page.key("2");
    let (state, before) = (page.state(), page.number(drawn));
    page.ask(
        "globalThis.lose = page.drawing.gl.getExtension('WEBGL_lose_context'); lose.loseContext(), true",
    );
    page.until("!main.classList.contains('live')");
    assert!(page.said().contains("lost"));
    // Keys while there are none.
    page.key("ArrowLeft");
    page.key("ArrowRight");
    page.shot("lost");
    page.ask("lose.restoreContext(), true");
    page.until("main.classList.contains('live') && !!page.drawing");
    page.whole();
    assert_eq!((page.state(), page.number(drawn)), (state, before));
}

//! A browser by its debugging protocol over pipes: input as it comes from a user's hand, and what the user sees and hears.

use super::*;
use std::process::{ChildStdin, ChildStdout};

/// What every browser of these tests is started with.
pub(super) const ARGUMENTS: [&str; 6] = [
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
];

/// Gives pages one colour for a picture, where `NUMBERS` still come from rays: software for graphics takes seconds to
/// compile the program of pictures, in every page, and seconds more for what it draws.
pub(super) const FLAT: &str = r"{
    const contexts = WebGL2RenderingContext.prototype, real = contexts.shaderSource;
    contexts.shaderSource = function (shader, text) {
        const drawn = text.includes('isSmooth') && !text.includes('#define NUMBERS');
        real.call(this, shader, drawn ? '#version 300 es\nprecision highp float; layout(location = 0) out vec4 found; void main() { found = vec4(1); }' : text);
    };
}";

/// Are pictures drawn as users see them: where they are kept, or tests are long?
pub(super) fn are_drawn() -> bool {
    long() > 1 || std::env::var_os("INFOBYTE_SHOTS").is_some()
}

/// Looks for what is waited for, 50 ms apart: five minutes.
const MAX_LOOKS: usize = 6000;

pub(super) struct Driver {
    child: Child,
    to: ChildStdin,
    from: BufReader<ChildStdout>,
    number: u64,
    session: Option<String>,
    _profile: tempfile::TempDir,
}

impl Driver {
    /// Starts a browser whose pages have pictures of one colour, unless these are kept.
    pub(super) fn start(browser: &Path) -> Self {
        let mut driver = Self::drawing(browser);
        if !are_drawn() {
            driver.call("Page.addScriptToEvaluateOnNewDocument", serde_json::json!({ "source": FLAT }));
        }
        driver
    }

    /// Starts a browser with an empty page, whose window is small, as software for graphics takes its time for each pixel.
    pub(super) fn drawing(browser: &Path) -> Self {
        let profile = tempfile::tempdir().unwrap();
        // It reads commands from file 3, and answers in file 4.
        let mut child = Command::new("sh")
            .args(["-c", "exec \"$0\" \"$@\" 3<&0 4>&1 </dev/null >/dev/null 2>&1"])
            .arg(browser)
            .args(ARGUMENTS)
            .args(["--remote-debugging-pipe", "--window-size=1000,700"])
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .arg("about:blank")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let (to, from) = (child.stdin.take().unwrap(), BufReader::new(child.stdout.take().unwrap()));
        let mut driver = Self { child, to, from, number: 0, session: None, _profile: profile };
        let pages = driver.call("Target.getTargets", serde_json::json!({}));
        let page = pages["targetInfos"].as_array().unwrap().iter().find(|target| target["type"] == "page");
        let target = page.unwrap()["targetId"].clone();
        let session = serde_json::json!({ "targetId": target, "flatten": true });
        let session = driver.call("Target.attachToTarget", session);
        driver.session = Some(session["sessionId"].as_str().unwrap().to_owned());
        for domain in ["Page", "Runtime", "Accessibility"] {
            driver.call(&format!("{domain}.enable"), serde_json::json!({}));
        }
        driver.size([400, 300], false);
        driver
    }

    /// Calls a method of the protocol, and waits for what it gives.
    pub(super) fn call(&mut self, method: &str, parameters: Value) -> Value {
        self.tried(method, parameters).unwrap_or_else(|error| panic!("{method}: {error}"))
    }

    /// The same, with what the browser says where it refuses.
    fn tried(&mut self, method: &str, parameters: Value) -> Result<Value, Value> {
        self.number += 1;
        let mut message = serde_json::json!({ "id": self.number, "method": method, "params": parameters });
        if let Some(session) = &self.session {
            message["sessionId"] = session.as_str().into();
        }
        let mut bytes = message.to_string().into_bytes();
        bytes.push(0);
        self.to.write_all(&bytes).unwrap();
        loop {
            let mut answer = Vec::new();
            self.from.read_until(0, &mut answer).unwrap();
            assert_eq!(answer.pop(), Some(0), "{method}: the browser is gone");
            let mut answer: Value = serde_json::from_slice(&answer).unwrap();
            assert_ne!(answer["method"], "Inspector.targetCrashed", "{method}: the tab was lost");
            if answer["id"] == self.number {
                let error = answer["error"].take();
                return if error.is_null() { Ok(answer["result"].take()) } else { Err(error) };
            }
        }
    }

    /// What an expression is in the page, which knows nothing of it.
    pub(super) fn ask(&mut self, expression: &str) -> Value {
        self.asked(expression).unwrap_or_else(|error| panic!("{expression}: {error}"))
    }

    fn asked(&mut self, expression: &str) -> Result<Value, Value> {
        let asked =
            serde_json::json!({ "expression": expression, "returnByValue": true, "awaitPromise": true });
        let mut answer = self.tried("Runtime.evaluate", asked)?;
        assert!(answer["exceptionDetails"].is_null(), "{expression}: {answer}");
        Ok(answer["result"]["value"].take())
    }

    /// Goes back in the history, once the call has been answered.
    pub(super) fn back(&mut self) {
        self.ask("setTimeout(() => history.back()), true");
    }

    pub(super) fn number(&mut self, expression: &str) -> f64 {
        self.ask(expression).as_f64().unwrap_or_else(|| panic!("{expression} is not a number"))
    }

    pub(super) fn text(&mut self, expression: &str) -> String {
        self.ask(expression).as_str().unwrap_or_else(|| panic!("{expression} is not a text")).to_owned()
    }

    /// Waits until an expression is true. A page that is just left for another gives no answer.
    pub(super) fn until(&mut self, expression: &str) {
        for _ in 0..MAX_LOOKS {
            match self.asked(expression) {
                Ok(found) if found == true => return,
                Err(error) if error["message"] != "Inspected target navigated or closed" => {
                    panic!("{expression}: {error}")
                }
                _ => {}
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        panic!("it never came: {expression}");
    }

    pub(super) fn open(&mut self, page: &Path, state: &str) {
        let address = format!("file://{}{state}", page.canonicalize().unwrap().display());
        self.visit(&address);
        self.whole();
    }

    pub(super) fn visit(&mut self, address: &str) {
        self.call("Page.navigate", serde_json::json!({ "url": address }));
    }

    /// Waits for the page and its first picture.
    pub(super) fn whole(&mut self) {
        self.until("typeof main === 'object' && !!page.pictured && main.classList.contains('live')");
    }

    /// Waits for the fine picture.
    pub(super) fn fine(&mut self) {
        self.until("typeof main === 'object' && main.dataset.drawn === 'fine'");
    }

    pub(super) fn size(&mut self, [width, height]: [u32; 2], is_phone: bool) {
        let size = serde_json::json!({
            "width": width, "height": height, "deviceScaleFactor": if is_phone { 2 } else { 1 }, "mobile": is_phone
        });
        self.call("Emulation.setDeviceMetricsOverride", size);
        self.call("Emulation.setTouchEmulationEnabled", serde_json::json!({ "enabled": is_phone }));
    }

    fn mouse(&mut self, kind: &str, [x, y]: [f64; 2], button: &str, more: Value) {
        let held = i32::from(kind != "mouseReleased");
        let bits = match button {
            "left" => 1,
            "right" => 2,
            _ => 0,
        };
        let mut event = serde_json::json!({
            "type": kind, "x": x, "y": y, "button": button, "buttons": held * bits, "clickCount": 1
        });
        event.as_object_mut().unwrap().extend(more.as_object().cloned().unwrap_or_default());
        self.call("Input.dispatchMouseEvent", event);
    }

    pub(super) fn click(&mut self, at: [f64; 2]) {
        self.mouse("mousePressed", at, "left", Value::Null);
        self.mouse("mouseReleased", at, "left", Value::Null);
    }

    /// Presses a button, moves in some steps and lets it go.
    pub(super) fn drag(&mut self, from: [f64; 2], by: [f64; 2], button: &str) {
        self.mouse("mousePressed", from, button, Value::Null);
        let at = |part: f64| [0, 1].map(|a| from[a] + by[a] * part);
        for step in 1..=4 {
            self.mouse("mouseMoved", at(f64::from(step) / 4.0), button, Value::Null);
        }
        self.mouse("mouseReleased", at(1.0), button, Value::Null);
    }

    pub(super) fn wheel(&mut self, at: [f64; 2], by: f64) {
        self.mouse("mouseWheel", at, "none", serde_json::json!({ "deltaX": 0, "deltaY": by }));
    }

    /// Fingers that move from some places to others.
    pub(super) fn touch(&mut self, from: &[[f64; 2]], to: &[[f64; 2]]) {
        let points = |part: f64| -> Value {
            let at = |(id, (from, to)): (usize, (&[f64; 2], &[f64; 2]))| {
                let [x, y] = [0, 1].map(|a| from[a] + (to[a] - from[a]) * part);
                serde_json::json!({ "x": x, "y": y, "id": id })
            };
            from.iter().zip(to).enumerate().map(at).collect()
        };
        let mut send = |kind: &str, points: Value| {
            self.call("Input.dispatchTouchEvent", serde_json::json!({ "type": kind, "touchPoints": points }));
        };
        send("touchStart", points(0.0));
        (1..=4).for_each(|step| send("touchMove", points(f64::from(step) / 4.0)));
        send("touchEnd", serde_json::json!([]));
    }

    /// Presses a key; `held` has 8 for shift, 2 for control.
    pub(super) fn key_with(&mut self, name: &str, held: u32) {
        let codes = [
            ("Tab", 9),
            ("Enter", 13),
            ("Escape", 27),
            (" ", 32),
            ("End", 35),
            ("Home", 36),
            ("ArrowLeft", 37),
        ];
        let more = [("ArrowUp", 38), ("ArrowRight", 39), ("ArrowDown", 40)];
        let code = codes.iter().chain(&more).find(|(of, _)| *of == name).map(|(_, code)| *code);
        let code = code.unwrap_or_else(|| name.to_ascii_uppercase().bytes().next().unwrap().into());
        let mut event = serde_json::json!({
            "type": "keyDown", "key": name, "code": name, "windowsVirtualKeyCode": code, "modifiers": held
        });
        if name.chars().count() == 1 && held & 2 == 0 {
            event["text"] = name.into();
        } else if name == "Enter" {
            event["text"] = "\r".into();
        }
        self.call("Input.dispatchKeyEvent", event.clone());
        event["type"] = "keyUp".into();
        event.as_object_mut().unwrap().remove("text");
        self.call("Input.dispatchKeyEvent", event);
    }

    pub(super) fn key(&mut self, name: &str) {
        self.key_with(name, 0);
    }

    /// What is on the screen, as a PNG; kept where INFOBYTE_SHOTS names a folder.
    pub(super) fn shot(&mut self, name: &str) -> Vec<u8> {
        let shot = self.call("Page.captureScreenshot", serde_json::json!({ "format": "png" }));
        let png = STANDARD.decode(shot["data"].as_str().unwrap()).unwrap();
        if let Some(folder) = std::env::var_os("INFOBYTE_SHOTS") {
            fs::write(Path::new(&folder).join(format!("{name}.png")), &png).unwrap();
        }
        png
    }
}

impl Drop for Driver {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

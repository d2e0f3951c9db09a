#!/usr/bin/env python3
"""What a browser takes to open a page of `oct export`, over several openings: medians of times and of memory.

    scripts/measure_page.py PAGE.html [TIMES] [BROWSER ARGUMENTS...]

Times begin when the browser begins to fetch the page: `decoded` when the model is in memory, `picture` when its first
frame is drawn. Memory, in openings of its own, is the sum of private and shared pages by parts (Pss) of all the browser's
processes: the most that was seen until a second after the first picture, then, and two seconds after the fine one. What the
model costs is that less the same of a page of a single voxel, which has the scripts, the graphics and the window's
buffers, too; both are printed above an empty page besides. The page of a voxel
is made by `oct` (INFOBYTE_OCT, else target/release/oct). Sizes of the window and other arguments are for all three.
"""

import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import threading
import time

USUAL = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


class Browser:
    """Chromium by its debugging protocol over pipes."""

    def __init__(self, arguments: list[str]):
        self.profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        # It reads commands from file 3, and answers in file 4.
        command = ["sh", "-c", 'exec "$0" "$@" 3<&0 4>&1 </dev/null >/dev/null 2>&1', os.environ.get("INFOBYTE_BROWSER", "chromium")]
        command += ["--headless=new", "--no-sandbox", "--remote-debugging-pipe", "--window-size=1000,700"]
        command += [f"--user-data-dir={self.profile.name}", *arguments, "about:blank"]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self.out, self.back = self.process.stdin.fileno(), self.process.stdout.fileno()
        self.number, self.rest, self.session = 0, b"", None
        page = next(t for t in self.call("Target.getTargets")["targetInfos"] if t["type"] == "page")
        self.session = self.call("Target.attachToTarget", targetId=page["targetId"], flatten=True)["sessionId"]

    def call(self, method: str, **params):
        self.number += 1
        message = {"id": self.number, "method": method, "params": params}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.out, json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in self.rest:
                self.rest += os.read(self.back, 1 << 20)
            one, self.rest = self.rest.split(b"\0", 1)
            answer = json.loads(one)
            if answer.get("id") == self.number:
                if "error" in answer:
                    raise RuntimeError(answer["error"])
                return answer["result"]

    def ask(self, expression: str):
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(json.dumps(answer["exceptionDetails"])[:2000])
        return answer["result"].get("value")

    def until(self, expression: str, seconds: float = 120):
        end = time.monotonic() + seconds
        while not self.ask(expression):
            if time.monotonic() > end:
                raise TimeoutError(expression)
            time.sleep(0.005)

    def open(self, address: str):
        self.call("Page.enable")
        self.call("Page.navigate", url=address)

    def memory(self) -> int:
        """Bytes of the browser's processes."""
        parents = {}
        for status in pathlib.Path("/proc").glob("[0-9]*/stat"):
            try:
                parents[int(status.parent.name)] = int(status.read_text().rsplit(")", 1)[1].split()[1])
            except OSError:
                pass
        ours = {self.process.pid}
        for _ in range(8):
            ours |= {child for child, parent in parents.items() if parent in ours}
        total = 0
        for process in ours:
            try:
                rollup = pathlib.Path(f"/proc/{process}/smaps_rollup").read_text()
                total += next(int(line.split()[1]) << 10 for line in rollup.splitlines() if line.startswith("Pss:"))
            except (OSError, StopIteration):
                pass
        return total

    def close(self):
        self.process.kill()
        self.process.wait()
        self.profile.cleanup()


def one_voxel(folder: pathlib.Path) -> pathlib.Path:
    """The page of a model of one voxel."""
    default = pathlib.Path(__file__).resolve().parent.parent / "target/release/oct"
    program = os.environ.get("INFOBYTE_OCT", str(default))
    raw, model, page = folder / "one.raw", folder / "one.oct", folder / "one.html"
    raw.write_bytes(b"\xc8")
    build = ["build", raw, "--dims", "1x1x1", "--dtype", "u8", "--iso", "100", "--surface", "skin", "-o", model, "--quiet"]
    subprocess.run([program, *build], check=True)
    subprocess.run([program, "export", model, "-o", page, "--quiet"], check=True)
    return page


READY = "typeof page === 'object' && (page.pictured || page.error)"
# The model is opened when the still picture has been seen, which is a matter of chance else; and the fine picture begins
# two seconds after the first one, in place of .16.
STEADY = """const usual = setTimeout, add = document.addEventListener;
const seen = opens => requestAnimationFrame(() => requestAnimationFrame(() => usual(opens, 200)));
window.setTimeout = (does, ms, ...more) => usual(does, ms === 160 ? 2000 : ms, ...more);
document.addEventListener = (name, does) => add.call(document, name, name === 'DOMContentLoaded' ? () => seen(does) : does);"""
TIMES = "({ready: page.began, decoded: page.began + page.opened, picture: page.pictured, error: page.error})"


def started(arguments: list[str]) -> Browser:
    browser = Browser(arguments)
    browser.until("document.readyState === 'complete'")
    time.sleep(2)
    return browser


def times_of(page: pathlib.Path, arguments: list[str]) -> dict:
    """Times of an opening in ms."""
    browser = started(arguments)
    browser.open(page.resolve().as_uri())
    browser.until(READY)
    row = dict(browser.ask(TIMES))
    browser.until("document.querySelector('main').dataset.drawn || page.error")
    row["fine"] = browser.ask("performance.now()")
    browser.close()
    print(page.name, json.dumps(row), file=sys.stderr)
    return row


class Watch(threading.Thread):
    """The most memory of a browser that is seen, some fifty times a second."""

    def __init__(self, browser: Browser):
        super().__init__(daemon=True)
        self.browser, self.most, self.ends = browser, 0, threading.Event()
        self.start()

    def run(self):
        while not self.ends.wait(0.02):
            self.most = max(self.most, self.browser.memory())

    def end(self) -> int:
        self.ends.set()
        self.join()
        return self.most


def memory_of(page: pathlib.Path, arguments: list[str]) -> dict:
    """Memory of an opening above an empty page, in MB."""
    browser = started(arguments)
    empty = browser.memory()
    browser.call("Page.enable")
    browser.call("Page.addScriptToEvaluateOnNewDocument", source=STEADY)
    watch = Watch(browser)
    browser.open(page.resolve().as_uri())
    browser.until(READY)
    time.sleep(1)
    most, first = watch.end(), browser.memory()
    browser.until("document.querySelector('main').dataset.drawn || page.error")
    time.sleep(2)
    rest = browser.memory()
    browser.close()
    row = {name: (sum_ - empty) / 1e6 for name, sum_ in (("most", most), ("first", first), ("rest", rest))}
    print(page.name, json.dumps(row), file=sys.stderr)
    return row


def main():
    page = pathlib.Path(sys.argv[1])
    times = int(sys.argv[2]) if len(sys.argv) > 2 else 5
    arguments = USUAL + sys.argv[3:]
    result = {}
    rows = [times_of(page, arguments) for _ in range(times)]
    for name in ("ready", "decoded", "picture", "fine"):
        result[name] = round(statistics.median(row[name] for row in rows), 1)
    with tempfile.TemporaryDirectory() as folder:
        one = one_voxel(pathlib.Path(folder))
        # In turns.
        rows = [(memory_of(page, arguments), memory_of(one, arguments)) for _ in range(times)]
    for name in ("most", "first", "rest"):
        ours, base = (statistics.median(row[of][name] for row in rows) for of in (0, 1))
        result[f"{name}_mb"] = {"model": round(ours - base, 1), "above empty": round(ours, 1), "voxel above empty": round(base, 1)}
    print(json.dumps(result))


if __name__ == "__main__":
    main()

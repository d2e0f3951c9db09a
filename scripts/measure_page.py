#!/usr/bin/env python3
"""What a browser takes to open a page of `oct export`, over several openings: medians, and the memory of all its processes.

    scripts/measure_page.py PAGE.html [TIMES] [BROWSER ARGUMENTS...]

Times begin when the browser begins to fetch the page: `decoded` when the model is in memory, `picture` when its first
frame is drawn. Memory is private and shared pages by parts (Pss), less that of an empty page.
"""

import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
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


def main():
    page = pathlib.Path(sys.argv[1]).resolve().as_uri()
    times = int(sys.argv[2]) if len(sys.argv) > 2 else 5
    rows = []
    for _ in range(times):
        browser = Browser(sys.argv[3:] or USUAL)
        browser.until("document.readyState === 'complete'")
        time.sleep(1)
        before = browser.memory()
        browser.open(page)
        browser.until("typeof page === 'object' && (page.pictured || page.error)")
        row = dict(browser.ask("({ready: page.began, decoded: page.began + page.opened, picture: page.pictured, error: page.error})"))
        row["memory_mb"] = (browser.memory() - before) / 1e6
        browser.until("document.querySelector('main').dataset.drawn || page.error")
        row["fine"] = browser.ask("performance.now()")
        time.sleep(2)
        row["rest_mb"] = (browser.memory() - before) / 1e6
        rows.append(row)
        browser.close()
        print(json.dumps(row), file=sys.stderr)
    numbers = [name for name in rows[0] if name != "error"]
    print(json.dumps({name: round(statistics.median(row[name] for row in rows), 1) for name in numbers}))


if __name__ == "__main__":
    main()

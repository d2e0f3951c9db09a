"""Runs one command and tells what it took; shared by memory.py and bench.py. Standard library only.

Peak memory is the trap: a process started from Python inherits Python's own peak in `ru_maxrss` (the
kernel folds the old image's peak into the process when it execs, so an exec shim does not help). Two
figures are free of that: GNU time, which forks from its own small image, and `VmHWM` of the child,
which belongs to the memory image and restarts at exec. `VmHWM` is polled, so it may miss the last
moments; the program's own `peak_rss_bytes`, read at its end, is the third.
"""

import json
import os
import subprocess
import tempfile
import time

GNU_TIME = "/usr/bin/time"


def has_gnu_time():
    """Is there a `time` that understands -f?"""
    try:
        done = subprocess.run([GNU_TIME, "-f", "%M", "true"], capture_output=True, text=True, check=False)
    except OSError:
        return False
    return done.returncode == 0 and done.stderr.strip().isdigit()


def poll_peak_bytes(process):
    """Largest VmHWM seen until the process ends."""
    peak = 0
    while process.poll() is None:
        try:
            with open(f"/proc/{process.pid}/status", encoding="ascii", errors="replace") as status:
                for line in status:
                    if line.startswith("VmHWM:"):
                        peak = max(peak, int(line.split()[1]) * 1024)
        except (OSError, ValueError):
            pass
        time.sleep(0.001)
    return peak


class Run:
    """Result of one command: exit code, wall_s, peak_bytes by outside measure, json object, errors."""

    def __init__(self, code, wall_s, peak_bytes, how, stdout, stderr):
        self.code, self.wall_s, self.peak_bytes, self.how = code, wall_s, peak_bytes, how
        self.stdout, self.stderr = stdout, stderr
        try:
            self.json = json.loads(stdout)
        except ValueError:
            self.json = {}
        if not isinstance(self.json, dict):
            self.json = {}

    def own_peak_bytes(self):
        """What the program says of itself, or 0."""
        return int(self.json.get("peak_rss_bytes", 0) or 0)

    def worst_bytes(self):
        """The larger of both figures."""
        return max(self.peak_bytes, self.own_peak_bytes())

    def message(self):
        """Last line of its errors."""
        lines = self.stderr.strip().splitlines()
        return lines[-1] if lines else ""


def run(command, cgroup_procs=None):
    """Runs a command to its end; with `cgroup_procs` the command is moved into that group first."""
    command = [str(part) for part in command]
    if cgroup_procs:
        # The shell joins the group, then becomes the command.
        command = ["/bin/sh", "-c", 'echo $$ > "$0" && exec "$@"', str(cgroup_procs)] + command
    gnu = has_gnu_time()
    with tempfile.TemporaryDirectory() as folder:
        figure = os.path.join(folder, "peak_kib")
        if gnu:
            command = [GNU_TIME, "-f", "%M", "-o", figure] + command
        with open(os.path.join(folder, "out"), "w+b") as out, open(os.path.join(folder, "err"), "w+b") as err:
            start = time.perf_counter()
            process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=out, stderr=err)
            peak = 0
            if gnu:
                process.wait()
            else:
                peak = poll_peak_bytes(process)
            wall_s = time.perf_counter() - start
            out.seek(0)
            err.seek(0)
            stdout, stderr = (f.read().decode("utf-8", "replace") for f in (out, err))
        if gnu:
            with open(figure, encoding="ascii") as text:
                # A failing command puts a sentence before the figure.
                peak = int(text.read().split()[-1]) * 1024
    return Run(process.returncode, wall_s, peak, "GNU time" if gnu else "VmHWM, polled", stdout, stderr)


def size_bytes(text):
    """Bytes of `8MiB`, `64M`, `1GiB`, `4096` (binary units, as the command reads them)."""
    number = text.strip().rstrip("iBbKMGkmg")
    unit = text.strip()[len(number):].lower().rstrip("b").rstrip("i")
    return int(float(number) * {"": 1, "k": 1 << 10, "m": 1 << 20, "g": 1 << 30}[unit])


def table(head, rows):
    """Prints rows under a heading, columns aligned."""
    cells = [[str(c) for c in row] for row in [head] + rows]
    widths = [max(len(row[i]) for row in cells) for i in range(len(head))]
    for i, row in enumerate(cells):
        print("  ".join(c.ljust(w) if j == 0 else c.rjust(w) for j, (c, w) in enumerate(zip(row, widths))))
        if i == 0:
            print("  ".join("-" * w for w in widths))


DEMO_ISO = 400  # the skull, in Hounsfield units


def write_demo(oct_path, side, path):
    """Writes the synthetic head, `side` cubed, as raw i16 samples."""
    done = run([oct_path, "demo", "--size", side, "--write-raw", path])
    if done.code != 0:
        raise SystemExit(f"{oct_path} demo --write-raw failed ({done.code}): {done.message()}")


def find_oct(given):
    """The program to measure: as given, else the release build beside these scripts."""
    top = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    target = os.environ.get("CARGO_TARGET_DIR", os.path.join(top, "target"))
    path = given or os.path.join(target, "release", "oct")
    if not os.access(path, os.X_OK):
        raise SystemExit(f"{path}: no program there; run `cargo build --release` or give --oct PATH")
    return path

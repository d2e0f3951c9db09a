#!/usr/bin/env python3
"""Fuzzes every reader of the program, guided by coverage, and keeps what is worth replaying in fixtures/fuzz.

Each target of tests/fuzz/targets.rs has its turn until it had its hours of processor time; what was found stays in
target/fuzz and later calls go on from there. Needs a stable compiler, and one of C++. A find is a panic, a case of more
than 5 s, or one that takes more memory than it may; cases that do not fail a second time (the machine slept, say) are
counted apart. Exit code 1 if there are finds.

  scripts/fuzz.py                          an hour for each target, two at a time
  scripts/fuzz.py --hours 0.1 --targets nrrd,npy
  scripts/fuzz.py --hours 0 --keep         only writes fixtures/fuzz anew from what target/fuzz holds
"""
import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
WORK = ROOT / "target" / "fuzz"
KEPT = ROOT / "fixtures" / "fuzz"
TRIPLE = "x86_64-unknown-linux-gnu"
FLAGS = (
    "-Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 -Cllvm-args=-sanitizer-coverage-trace-compares "
    "-Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table "
    "--cfg fuzzing"
)
# Longest input in bytes, where 4096 are not enough for what a sound one needs.
LONGEST = {"oct": 16384, "packed": 16384, "dicom": 8192, "part": 20480}
TARGETS = re.findall(r"^    (\w+): \|", (ROOT / "tests/fuzz/targets.rs").read_text(), re.M)


def parse():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=1, help="processor time that each target gets (1)")
    parser.add_argument("--targets", default=",".join(TARGETS), help="some of " + ", ".join(TARGETS))
    parser.add_argument("--jobs", type=int, default=2, help="targets at a time (2)")
    parser.add_argument("--turn", type=int, default=180, help="seconds of a turn (180)")
    parser.add_argument("--timeout", type=int, default=5, help="seconds that a case may take (5)")
    parser.add_argument("--rss-mb", type=int, default=1024, help="memory of the whole fuzzer (1024)")
    parser.add_argument("--nice", type=int, default=19, help="how far to stand back for other programs (19)")
    parser.add_argument("--program", help="a program built before, instead of building it")
    parser.add_argument("--keep", action="store_true", help="write the smallest corpus into fixtures/fuzz at the end")
    parser.add_argument("--keep-kib", type=int, default=24, help="most of it for each target (24)")
    args = parser.parse_args()
    args.targets = args.targets.split(",")
    unknown = [name for name in args.targets if name not in TARGETS]
    if unknown:
        parser.error(f"no such target: {', '.join(unknown)}")
    return args


def build():
    """The fuzzer's program, built with counters of coverage; and the first inputs, written by the test."""
    # Without the program, which would lack the counters' functions.
    command = ["cargo", "test", "--locked", "--target", TRIPLE, "--no-default-features", "--features", "fuzz",
               "--test", "fuzz", "--no-run"]
    environment = os.environ | {"RUSTFLAGS": FLAGS, "CARGO_TARGET_DIR": str(WORK)}
    out = subprocess.run(command + ["--message-format=json"], cwd=ROOT, env=environment, stdout=subprocess.PIPE, check=True)
    messages = (json.loads(line) for line in out.stdout.splitlines() if line.startswith(b"{"))
    programs = [m["executable"] for m in messages if m.get("executable") and m["target"]["name"] == "fuzz"]
    return programs[-1]


def cases(path):
    """The cases of a kept file: a length of four bytes before each."""
    data, at = path.read_bytes(), 0
    while at < len(data):
        length = int.from_bytes(data[at : at + 4], "little")
        yield data[at + 4 : at + 4 + length]
        at += 4 + length


class Campaign:
    def __init__(self, args, program):
        self.args, self.program = args, program
        self.lock = threading.Lock()
        self.state_file = WORK / "state.json"
        self.state = json.loads(self.state_file.read_text()) if self.state_file.exists() else {}
        for name in TARGETS:
            self.state.setdefault(name, {"cpu_s": 0.0, "runs": 0, "finds": {}, "unrepeated": 0})
            for folder in (self.corpus(name), self.finds(name)):
                folder.mkdir(parents=True, exist_ok=True)
            kept = KEPT / f"{name}.cases"
            for number, case in enumerate(cases(kept) if kept.exists() else []):
                (self.corpus(name) / f"kept-{number}").write_bytes(case)
        self.busy, self.ended, self.stop = set(), {}, False

    def corpus(self, name):
        return WORK / "corpus" / name

    def finds(self, name):
        return WORK / "finds" / name

    def run(self, name, arguments):
        """Runs the program; its exit code, what it said, and its processor time."""
        process = subprocess.Popen(
            ["nice", "-n", str(self.args.nice), self.program, f"-timeout={self.args.timeout}", f"-rss_limit_mb={self.args.rss_mb}",
             f"-max_len={LONGEST.get(name, 4096)}", *arguments],
            cwd=WORK, env=os.environ | {"INFOBYTE_FUZZ_TARGET": name, "RUST_BACKTRACE": "0"},
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        said = process.stderr.read().decode(errors="replace")
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        shutil.rmtree(f"/dev/shm/infobyte-fuzz-{process.pid}", ignore_errors=True)
        return process.returncode, said, used.ru_utime + used.ru_stime

    def turn(self, name):
        before = set(self.finds(name).iterdir())
        code, said, cpu_s = self.run(name, [
            f"-max_total_time={self.args.turn}", f"-artifact_prefix={self.finds(name)}/", "-print_final_stats=1",
            "-reload=0", f"-use_value_profile={self.state[name]['runs'] % 2}", str(self.corpus(name))])
        runs = re.findall(r"number_of_executed_units:\s*(\d+)", said) or re.findall(r"^#(\d+)\s", said, re.M)
        fresh = sorted(set(self.finds(name).iterdir()) - before)
        with self.lock:
            state = self.state[name]
            state["cpu_s"] += cpu_s
            state["runs"] += int(runs[-1]) if runs else 0
        for case in fresh:
            self.judge(name, case)
        if code and not fresh:
            # A find that is kept already, or no memory: this target is left, the others go on.
            print(f"\n{name}: the fuzzer ended with {code}\n{said[-2000:]}", file=sys.stderr)
            self.ended[name] = code

    def judge(self, name, case):
        """Runs a find alone; what fails again is kept, one for each place."""
        code, said, _ = self.run(name, ["-runs=1", str(case)])
        place = re.search(r"panicked at ([^\n]*?):?\n([^\n]*)", said)
        kind = case.name.split("-")[0]
        where = f"{place[1]} {place[2]}" if place else f"{kind} {case.name}"
        with self.lock:
            state = self.state[name]
            if code == 0:
                state["unrepeated"] += 1
                case.unlink()
            elif where in state["finds"]:
                case.unlink()
            else:
                state["finds"][where] = case.name
                print(f"\r{name}: {where}: {case}", file=sys.stderr)

    def next(self):
        with self.lock:
            hungry = [n for n in self.args.targets
                      if n not in self.busy | self.ended.keys() and self.state[n]["cpu_s"] < self.args.hours * 3600]
            if self.stop or not hungry:
                return None
            name = min(hungry, key=lambda n: self.state[n]["cpu_s"])
            self.busy.add(name)
            return name

    def work(self):
        while (name := self.next()) is not None:
            self.turn(name)
            with self.lock:
                self.busy.discard(name)
                self.state_file.write_text(json.dumps(self.state, indent=1))

    def bar(self):
        due = self.args.hours * 3600 * len(self.args.targets)
        had = sum(min(self.state[n]["cpu_s"], self.args.hours * 3600) for n in self.args.targets)
        full = int(40 * had / due) if due else 40
        finds = sum(len(s["finds"]) for s in self.state.values())
        runs = sum(s["runs"] for s in self.state.values())
        text = f"[{'#' * full}{'.' * (40 - full)}] {had / 3600:.2f} of {due / 3600:.2f} h, {runs} runs, {finds} finds"
        print(f"\r{text} {' '.join(sorted(self.busy)):30}", end="", file=sys.stderr, flush=True)

    def fuzz(self):
        workers = [threading.Thread(target=self.work, daemon=True) for _ in range(self.args.jobs)]
        for worker in workers:
            worker.start()
        try:
            while any(worker.is_alive() for worker in workers):
                if sys.stderr.isatty():
                    self.bar()
                time.sleep(1)
        except KeyboardInterrupt:
            self.stop = True
        self.state_file.write_text(json.dumps(self.state, indent=1))

    def table(self):
        print(f"{'target':12} {'hours':>6} {'runs':>12} {'inputs':>7} {'finds':>6} {'unrepeated':>10}")
        for name in self.args.targets:
            s = self.state[name]
            inputs = sum(1 for _ in self.corpus(name).iterdir())
            print(f"{name:12} {s['cpu_s'] / 3600:6.2f} {s['runs']:12} {inputs:7} {len(s['finds']):6} {s['unrepeated']:10}")

    def keep(self, name):
        """The fewest inputs that reach what all of them reach, smallest first, as far as there is room; finds first."""
        small = WORK / "small" / name
        shutil.rmtree(small, ignore_errors=True)
        small.mkdir(parents=True)
        code, said, _ = self.run(name, ["-set_cover_merge=1", str(small), str(self.corpus(name))])
        if code:
            print(f"{name}: the corpus could not be made smaller\n{said[-2000:]}", file=sys.stderr)
            return
        by_size = lambda folder: sorted((p.read_bytes() for p in folder.iterdir()), key=lambda b: (len(b), b))
        chosen, left = [], self.args.keep_kib * 1024
        for case in by_size(self.finds(name)) + by_size(small):
            if case not in chosen and len(case) + 4 <= left:
                chosen.append(case)
                left -= len(case) + 4
        KEPT.mkdir(exist_ok=True)
        data = b"".join(len(case).to_bytes(4, "little") + case for case in chosen)
        (KEPT / f"{name}.cases").write_bytes(data)
        print(f"{name}: {len(chosen)} cases, {len(data)} bytes")


def main():
    args = parse()
    WORK.mkdir(parents=True, exist_ok=True)
    program = args.program or build()
    campaign = Campaign(args, program)
    seeds = os.environ | {"INFOBYTE_FUZZ_SEEDS": str(WORK / "corpus")}
    if not all(any(campaign.corpus(name).iterdir()) for name in args.targets):
        # The test fails where nothing is kept yet; the first inputs are written before.
        subprocess.run(["cargo", "test", "--locked", "--test", "corpus"], cwd=ROOT, env=seeds, check=False)
    campaign.fuzz()
    campaign.table()
    if args.keep:
        for name in args.targets:
            campaign.keep(name)
    found = [(n, w, c) for n in args.targets for w, c in campaign.state[n]["finds"].items()]
    for name, where, case in found:
        print(f"find: {name}: {where}: {campaign.finds(name) / case}")
    for name, code in campaign.ended.items():
        print(f"not fuzzed to the end: {name}: the fuzzer ended with {code}")
    sys.exit(bool(found or campaign.ended))


main()

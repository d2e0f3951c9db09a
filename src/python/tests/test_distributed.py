"""Parts on a cluster of Dask make the bytes of one build, whatever happens to the workers."""

import json
import os
import random
import re
import shutil
import signal
import sysconfig
import threading
import time

import numpy as np
import pytest

import infobyte
from conftest import bumps_of

distributed = pytest.importorskip("distributed")

OPTIONS = {"iso": 500, "dims": (90, 300, 700), "dtype": "i16"}
PARTS = 12


@pytest.fixture(scope="module")
def cluster():
    settings = {"distributed.scheduler.allowed-failures": 1, "distributed.comm.timeouts.connect": "20s"}
    import dask

    with dask.config.set(settings):
        local = distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None)
        with local, distributed.Client(local):
            yield local


@pytest.fixture
def raw(oct):
    bumps_of((700, 300, 90)).tofile("a.raw")
    oct("build", "a.raw", "-o", "whole.oct", "--dims", "90x300x700", "--dtype", "i16", "--iso", "500")
    with open("whole.oct", "rb") as file:
        return file.read()


def stand_in(text: str) -> str:
    """A program in place of `oct`, which the workers of later tasks call."""
    real = shutil.which("oct", path=sysconfig.get_path("scripts"))
    path = os.path.abspath("stand-in")
    with open(path, "w") as file:
        file.write(f"#!/bin/sh\n{text}\nexec {real} \"$@\"\n")
    os.chmod(path, 0o755)
    return path


def built(**more):
    from infobyte.distributed import build

    return build("a.raw", "a.oct", parts=PARTS, **{"progress": False, **OPTIONS, **more})


def check(model, whole):
    with open(model.path, "rb") as file:
        assert file.read() == whole
    left = {name for name in os.listdir() if name.endswith(".parts") or name.endswith(".oct")}
    assert left == {"a.oct", "whole.oct"}


def with_program(client, program):
    def use(program):
        if program is None:
            os.environ.pop("INFOBYTE_OCT", None)
        else:
            os.environ["INFOBYTE_OCT"] = program

    client.run(use, program)
    use(program)


@pytest.fixture
def program(cluster):
    """Names the program of all workers; their own again at the end."""
    client = distributed.get_client()
    yield lambda text: with_program(client, stand_in(text))
    client.wait_for_workers(2)
    with_program(client, None)


def test_parts_are_merged_into_the_bytes_of_one_build(cluster, raw):
    steps = []
    check(built(progress=lambda *step: steps.append(step)), raw)
    assert steps == [("parts", number, PARTS) for number in range(PARTS + 1)]


def test_lost_workers_are_made_good(cluster, raw, program):
    program('case "$1" in part) sleep 0.2;; esac')
    client, stop, killed = distributed.get_client(), threading.Event(), []

    def kill():
        luck = random.Random(3)
        while not stop.wait(0.5):
            workers = [info["pid"] for info in client.run(lambda: {"pid": os.getpid()}, on_error="ignore").values()]
            if workers and len(killed) < 3:
                killed.append(luck.choice(sorted(workers)))
                os.kill(killed[-1], signal.SIGKILL)

    thread = threading.Thread(target=kill)
    thread.start()
    try:
        check(built(retries=20), raw)
    finally:
        stop.set()
        thread.join()
    assert killed


def test_what_may_pass_is_tried_again_and_the_rest_is_raised(cluster, raw, program):
    # A full disk, once for each part; then a signal.
    program('if [ "$1" = part ] && mkdir "$2.$3" 2>/dev/null; then echo "oct: the disk is full" >&2; exit 5; fi')
    check(built(), raw)
    program('if [ "$1" = part ] && mkdir "$2.$3" 2>/dev/null; then kill -9 $$; fi')
    check(built(), raw)
    program('if [ "$1 $3" = "part 7" ]; then echo "oct: the disk is full" >&2; exit 5; fi')
    os.remove("a.oct")
    with pytest.raises(OSError, match="the disk is full"):
        built(retries=2)
    assert not os.path.exists("a.oct")
    # All others are there for the next time.
    program("")
    check(built(), raw)


def test_errors_that_stay_are_of_their_kind_and_end_the_build(cluster, raw):
    with pytest.raises(infobyte.UsageError, match="surface"):
        built(surface="plane")
    with pytest.raises(infobyte.InputError, match="iso"):
        built(iso=1e6)
    with pytest.raises(infobyte.BudgetError):
        built(memory="1MiB")
    np.zeros(5, "i2").tofile("a.raw")
    with pytest.raises(infobyte.InfobyteError):
        built()
    assert not os.path.exists("a.oct")


def test_a_plan_whose_input_changes_underneath_is_refused(cluster, raw, program):
    program('if [ "$1 $3" = "part 5" ]; then sleep 1; fi; if [ "$1 $3" = "part 0" ]; then touch a.raw; fi'.replace("a.raw", os.path.abspath("a.raw")))
    with pytest.raises(infobyte.InfobyteError, match="a.raw|plan"):
        built()
    assert not os.path.exists("a.oct")


def test_an_exception_in_progress_cancels_and_keeps_what_is_done(cluster, raw):
    class Enough(Exception):
        pass

    def stop(stage, done, total):
        if done == 3:
            raise Enough

    with pytest.raises(Enough):
        built(progress=stop)
    time.sleep(0.2)
    assert len([name for name in os.listdir("a.oct.parts") if name.endswith(".part")]) >= 3
    assert not os.path.exists("a.oct")
    check(built(), raw)


def test_the_threshold_is_found_in_stages(cluster, raw, oct):
    oct("build", "a.raw", "-o", "whole.oct", "--dims", "90x300x700", "--dtype", "i16")
    with open("whole.oct", "rb") as file:
        whole = file.read()
    steps = []
    check(built(iso=None, progress=lambda stage, done, _: steps.append((stage, done))), whole)
    assert steps == [(stage, number) for stage in ("histogram", "parts") for number in range(PARTS + 1)]


@pytest.fixture
def studies(oct):
    """Volumes in folders, two of the same name among them, a copy, and one that is refused."""
    for number in range(17):
        os.makedirs(f"studies/{number % 5}", exist_ok=True)
        np.save(f"studies/{number % 5}/v{number // 2}.npy", bumps_of((20 + number, 30, 40)))
    shutil.copy("studies/0/v0.npy", "studies/3/copy.npy")
    np.save("studies/4/flat.npy", np.zeros((9, 9, 9), "i2"))
    oct("batch", "studies", "--out", "one", "--jobs", "1", "--quiet", expect=8)
    return "studies"


def made_of(folder):
    """Bytes of models, thumbnails and the contact sheet, and what the report says of volumes but for times and memory."""
    found = {}
    for name in sorted(os.listdir(folder)):
        with open(os.path.join(folder, name), "rb") as file:
            if name.endswith((".oct", ".png")):
                found[name] = file.read()
    with open(os.path.join(folder, "report.json")) as file:
        report = json.load(file)
    spent = {"wall_s", "memory_bytes", "memory_plan_bytes", "scratch_bytes"}
    for item in report["items"]:
        model = {name: value for name, value in (item["model"] or {}).items() if name not in spent}
        # Made by a worker, so that the last run leaves it as it is.
        status = "converted" if item["status"] == "skipped" and item["model"] else item["status"]
        found["item " + item["input"].split("studies/")[-1]] = (status, item["name"], item["warnings"], item["reason"], model)
    return found


def test_a_batch_is_that_of_one_machine_whatever_happens_to_workers(cluster, studies, oct, program):
    from infobyte.distributed import batch

    steps = []
    report = batch(studies, "many", bundle=3, progress=lambda *step: steps.append(step))
    assert (report["converted"], report["skipped"], report["failed"]) == (0, 18, 1)
    assert steps[-1] == ("bundles", 6, 6)
    assert made_of("many") == made_of("one")
    # The contact sheet of the second run on one machine.
    oct("batch", "studies", "--out", "one", "--quiet", expect=8)
    sheets = []
    for folder in ("one", "many"):
        with open(f"{folder}/index.html") as file:
            # But for the memory and the time of the run.
            sheets.append(re.sub(r"[\d.]+ (KiB|MiB|s)\b", "", file.read()))
    assert sheets[0] == sheets[1]

    shutil.rmtree("many")
    program('case "$1" in batch) sleep 0.3;; esac')
    client, stop, killed = distributed.get_client(), threading.Event(), []

    def kill():
        luck = random.Random(4)
        while not stop.wait(0.6):
            workers = [info["pid"] for info in client.run(lambda: {"pid": os.getpid()}, on_error="ignore").values()]
            if workers and len(killed) < 3:
                killed.append(luck.choice(sorted(workers)))
                os.kill(killed[-1], signal.SIGKILL)

    thread = threading.Thread(target=kill)
    thread.start()
    try:
        batch(studies, "many", bundle=2, retries=20, progress=False)
    finally:
        stop.set()
        thread.join()
    assert killed
    assert made_of("many") == made_of("one")
    assert not [name for name in os.listdir("many") if name.startswith(".") and name != ".oct-key"]
    # What is there is not made again.
    before = {name: os.stat(os.path.join("many", name)).st_mtime_ns for name in os.listdir("many") if name.endswith(".oct")}
    batch(studies, "many", bundle=4, progress=False)
    assert before == {name: os.stat(os.path.join("many", name)).st_mtime_ns for name in before}

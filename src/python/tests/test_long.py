"""Ctrl-C ends what takes long, soon; `progress` shows how far it is."""

import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import infobyte
from conftest import ball_of

#: What is called again and again until Ctrl-C.
JOBS = {
    "render": "model.render(6000, shading='ao', ao_rays=64, samples=64)",
    "png": "model.png(6000, shading='ao', ao_rays=64, samples=64)",
    "section": "model.render(12000, section=('z', 60))",
    "first_hits": "model.first_hits(*rays, threads=1)",
    "any_hit": "model.any_hit(*rays, threads=1)",
    "nearest": "model.nearest(rays[0], threads=1)",
    "to_mesh": "model.to_mesh()",
    "export": "model.export('out.ply', error=0.9)",
    "compare": "infobyte.compare(model, 'other.oct', threads=1)",
    "measure": "model.measure()",
}

PROGRAM = """
import sys
import numpy as np
import infobyte
model = infobyte.open("model.oct")
rays = np.random.default_rng(1).uniform(-60, 60, (2, 4_000_000 if "rays" in sys.argv[1] else 1, 3))
print("ready", flush=True)
try:
    while True:
        exec(sys.argv[1])
except KeyboardInterrupt:
    print("stopped")
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder of a model and another one."""
    folder = tmp_path_factory.mktemp("long")
    for name, radius in [("model.oct", 60), ("other.oct", 59)]:
        infobyte.build(ball_of(160, radius), folder / name, iso=0, progress=False)
    return folder


@pytest.mark.parametrize("job", JOBS)
def test_ctrl_c_ends_what_takes_long(job, folder):
    with subprocess.Popen([sys.executable, "-c", PROGRAM, JOBS[job]], cwd=folder, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout.readline() == "ready\n"
            time.sleep(0.3)
            process.send_signal(signal.SIGINT)
            began = time.monotonic()
            said, _ = process.communicate(timeout=120)
        finally:
            process.kill()
    # Half a second where the machine is free.
    took = time.monotonic() - began
    print(f"{job}: {took:.2f} s")
    assert said == "stopped\n" and took < 10
    assert {path.name for path in folder.iterdir()} <= {"model.oct", "other.oct", "out.ply"}


def test_progress_is_a_bar_or_lines_where_it_is_asked_for(ball, monkeypatch, capfd):
    calls = {
        "build": lambda **options: infobyte.build(ball, "a.oct", iso=0, **options),
        "to_mesh": lambda **options: infobyte.open("a.oct").to_mesh(**options),
        "export": lambda **options: infobyte.open("a.oct").export("a.stl", **options),
        "render": lambda **options: infobyte.open("a.oct").render(300, **options),
        "compare": lambda **options: infobyte.compare("a.oct", "a.oct", **options),
        "thickness": lambda **options: infobyte.thickness("a.oct", **options),
        "pores": lambda **options: infobyte.pores("a.oct", **options),
        "pack": lambda **options: infobyte.pack("a.oct", "b.oct", **options),
        "unpack": lambda **options: infobyte.unpack("b.oct", "c.oct", **options),
    }
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    for name, call in calls.items():
        call()
        assert capfd.readouterr().err == "", name
        call(progress=True)
        assert all(line.endswith(" %") for line in capfd.readouterr().err.splitlines()), name
        stages = []
        call(progress=lambda *now: stages.append(now))
        assert all(0 <= done <= total for _, done, total in stages), name


def test_lines_of_progress_are_few(capfd):
    from infobyte._progress import _lines

    tell = _lines()
    for done in range(1001):
        tell("scan", done, 1000)
    assert capfd.readouterr().err.splitlines() == [f"scan: {tenth}0 %" if tenth else "scan: 0 %" for tenth in range(11)]


def test_pores_state_their_gap():
    z, y, x = np.ogrid[-31.5:32, -31.5:32, -31.5:32]
    hollow = np.minimum(28 - np.sqrt(z**2 + y**2 + x**2), np.sqrt((z - 12) ** 2 + y**2 + x**2) - 6).astype("f4")
    infobyte.build(hollow, "hollow.oct", iso=0, progress=False)
    table = infobyte.pores("hollow.oct", gap=True)["table"]
    assert table.dtype.names[-1] == "gap_mm" and table["gap_mm"] == pytest.approx([10], abs=0.1)
    assert "gap_mm" not in infobyte.pores("hollow.oct")["table"].dtype.names
    with pytest.raises(infobyte.UsageError, match="from pores, not from bodies"):
        infobyte.pores("hollow.oct", bodies=True, gap=True)

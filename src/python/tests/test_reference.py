"""The reference is what the docstrings say, and their examples run."""

import doctest
import pathlib
import subprocess
import sys

import numpy as np
import pytest

import infobyte

TOP = pathlib.Path(__file__).resolve().parents[3]


@pytest.mark.parametrize("name", ["infobyte", *infobyte.__all__])
def test_examples_run(name, ball):
    model = infobyte.build(ball, "ball.oct", iso=0, spacing=0.5, surface="cells", progress=False)
    names = {"infobyte": infobyte, "np": np, "ball": ball, "model": model}
    item = infobyte if name == "infobyte" else getattr(infobyte, name)
    runner, examples = doctest.DocTestRunner(), 0
    for test in doctest.DocTestFinder(recurse=name != "infobyte").find(item, name, module=False, globs=names):
        runner.run(test)
        examples += len(test.examples)
    assert runner.failures == 0
    assert examples or name in ("unpack", "render_scene") or name.endswith("Error")


def test_the_page_is_current():
    script = TOP / "src/python/reference.py"
    done = subprocess.run([sys.executable, script, "--check"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_everything_public_is_documented_and_typed():
    for name in infobyte.__all__:
        item = getattr(infobyte, name)
        assert item.__doc__ and (item.__doc__[0].isupper() or item.__doc__[0] == "`"), name
        if isinstance(item, type):
            for attribute, value in vars(item).items():
                is_method = callable(value) or isinstance(value, property)
                if is_method and not attribute.startswith("_"):
                    assert value.__doc__, f"{name}.{attribute}"
    package = pathlib.Path(infobyte.__file__).parent
    assert (package / "py.typed").exists() and (package / "_infobyte.pyi").exists()


def test_the_stub_names_what_the_module_has():
    import ast

    from infobyte import _infobyte

    tree = ast.parse((pathlib.Path(infobyte.__file__).parent / "_infobyte.pyi").read_text())
    functions = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    handle = next(node for node in tree.body if isinstance(node, ast.ClassDef))
    methods = {node.name for node in handle.body if isinstance(node, ast.FunctionDef)}
    own = {name for name in dir(_infobyte) if not name.startswith("_")}
    assert functions | {"Handle"} == own
    assert {name for name in methods if not name.startswith("_")} == {name for name in dir(_infobyte.Handle) if not name.startswith("_")}


def test_the_notebook_runs():
    cells = notebook_cells()
    assert len(cells) > 3
    names = {"__name__": "__main__"}
    for cell in cells:
        exec(compile(cell, "notebook", "exec"), names)


def notebook_cells():
    import json

    notebook = json.loads((TOP / "src/python/example.ipynb").read_text())
    return ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]


def test_the_notebook_runs_in_a_kernel():
    nbclient, nbformat = pytest.importorskip("nbclient"), pytest.importorskip("nbformat")
    pytest.importorskip("ipykernel")
    notebook = nbformat.read(TOP / "src/python/example.ipynb", as_version=4)
    nbclient.NotebookClient(notebook, timeout=120, kernel_name="python3").execute()
    shown = [kind for cell in notebook.cells for output in cell.get("outputs", []) for kind in output.get("data", {})]
    assert "image/png" in shown

"""Writes docs/PYTHON.md from the docstrings of the installed package; with --check compares it.

    python src/python/reference.py [--check]
"""

import inspect
import pathlib
import re
import sys

HERE = pathlib.Path(__file__).resolve().parent
# The installed package, not its sources, which lack the compiled module.
sys.path[:] = [path for path in sys.path if pathlib.Path(path).resolve() != HERE]

import infobyte  # noqa: E402
from infobyte import _types, distributed  # noqa: E402

PAGE = HERE.parents[1] / "docs/PYTHON.md"

ORDER = ["build", "open", "Model", "Hits", "Nearest", "Mesh", "compare", "thickness", "pores", "pack", "unpack", "verify", "render_scene"]
#: Types that are a choice of names.
NAMED = {name: str(of).removeprefix("typing.") for name, of in vars(_types).items() if str(of).startswith("typing.Literal[")}
NAMED |= {"NamedView": NAMED["View"], "Label": "str | int", "Opacity": "Mapping[str | int, float]"}
ERRORS = ["InfobyteError", "UsageError", "InputError", "BudgetError"]

HEAD = """# Python

This page is made from the docstrings of the package by `src/python/reference.py`.

`pip install .` in a clone builds the package, and the command `oct` with it; that needs Rust, and takes some minutes.
Python 3.11 and newer, Linux. The model is written to the file that is named, and replaces what it held. Only numpy is needed; objects of other packages are recognised, not imported.

```python
import infobyte
model = infobyte.build(array, "model.oct", iso=300, spacing=(1.25, 0.5, 0.5))   # z, y, x
model                                     # a notebook shows a picture of it
model.view()                              # and here the model itself, to be turned, cut and measured
picture = model.render(512, view="iso")   # H x W x 4, and model.png(512, view="iso") the bytes of a PNG
hits = model.first_hits(origins, directions)
model.to_pyvista().plot()                 # with pyvista installed; or model.to_trimesh()
```

`src/python/example.ipynb` is a notebook that shows all of it.
"""


def shown(text: str) -> str:
    """A docstring as Markdown: examples become code, the rest stays."""
    lines, code = [], False
    for line in inspect.cleandoc(text).splitlines():
        is_code = line.startswith((">>> ", "... ")) or (code and line.strip() != "")
        if is_code != code:
            lines.append("```" + ("pycon" if is_code else ""))
            code = is_code
        # A heading of a list needs an empty line before the list.
        if line.startswith("- ") and lines and lines[-1] and not lines[-1].startswith(("- ", "  ")):
            lines.append("")
        lines.append(line)
    return "\n".join(lines + ["```"] * code)


def signature(name: str, item: object) -> str:
    text = str(inspect.signature(item))
    text = re.sub(r"(: |-> )'([^']*)'", r"\1\2", text)
    # Names are listed; overloads are described in the text.
    text = re.sub(r"(?<=[ \[])\w+(?=[\], ])", lambda word: NAMED.get(word[0], word[0]), text)
    text = text.replace("Unpack[Picture]", "Any")
    text = text.replace("(self, ", "(").replace("(self)", "()").replace("NDArray[np.", "NDArray[")
    call = f"{name}{text}"
    if len(call) > 100:
        call = re.sub(r", (?=\w+:|\*,|\*\*)", ",\n    ", call).replace("(", "(\n    ", 1)
        call = call.replace(") -> ", ",\n) -> ")
    return f"```python\n{call}\n```"


def of_class(name: str, cls: type) -> list[str]:
    # Classes are of the package for their users; their text is in the module.
    text = inspect.getsource(sys.modules["infobyte._model"])
    bases = [re.search(rf"^class {base.__name__}\b.*?(?=^\S)", text, re.M | re.S) for base in reversed(cls.__mro__)]
    source = "".join(base.group() for base in bases if base)
    parts = [f"## `{name}`", shown(cls.__doc__)]
    fields = [f"- `{field}`: {inspect.cleandoc(text)}" for field, text in re.findall(r'^    (\w+): .*\n    """(.*)"""', source, re.M)]
    parts += ["\n".join(fields)] if fields else []
    for attribute, value in vars(cls).items():
        if attribute.startswith("_") and attribute != "__len__" or not getattr(value, "__doc__", None):
            continue
        if isinstance(value, property):
            parts.append(f"**`.{attribute}`** {shown(value.__doc__)}")
        elif attribute == "__len__":
            parts.append(f"**`len(model)`** {shown(value.__doc__)}")
        elif inspect.isfunction(value):
            parts += [f"### `{name}.{attribute}`", signature(attribute, value), shown(value.__doc__)]
    return parts


def page() -> str:
    parts = [HEAD.strip(), shown(infobyte.__doc__)]
    for name in ORDER:
        item = getattr(infobyte, name)
        if isinstance(item, type):
            parts += of_class(name, item)
        else:
            parts += [f"## `infobyte.{name}`", signature(name, item), shown(item.__doc__)]
    for name in distributed.__all__:
        what = getattr(distributed, name)
        parts += [f"## `infobyte.distributed.{name}`", signature(name, what), shown(what.__doc__)]
    rows = [f"| `{name}` | {inspect.cleandoc(getattr(infobyte, name).__doc__)} |" for name in ERRORS]
    system = "| `FileNotFoundError`, `PermissionError`, `OSError`, ... | What the system refuses, with `errno` and `filename`; also `InfobyteError`. |"
    parts += ["## Exceptions", "\n".join(["| class | meaning |", "|---|---|", *rows, system])]
    assert set(ORDER + ERRORS) == set(infobyte.__all__)
    return "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    if "--check" in sys.argv:
        if PAGE.read_text() != page():
            sys.exit("docs/PYTHON.md is not what the docstrings say; run src/python/reference.py")
    else:
        PAGE.write_text(page())

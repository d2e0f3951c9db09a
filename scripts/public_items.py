#!/usr/bin/env python3
"""Lists the public items of the library in docs/PUBLIC.txt, from the page of all items that rustdoc writes.

    scripts/public_items.py             writes the list
    scripts/public_items.py --check     compares it with the committed one, and fails where they differ

Each line is a kind and a path below the crate; methods and fields belong to their types. Standard library only.
"""

import difflib
import html.parser
import os
import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
LIST = ROOT / "docs" / "PUBLIC.txt"


class Items(html.parser.HTMLParser):
    """The links of the page: `builder/struct.BuildOptions.html` is `struct builder::BuildOptions`."""

    def __init__(self):
        super().__init__()
        self.lines, self.inside = [], False

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        if tag == "ul":
            self.inside = "all-items" in attrs.get("class", "")
        elif tag == "a" and self.inside:
            folder, _, page = attrs["href"].rpartition("/")
            kind, name, _ = page.split(".")
            self.lines.append(f"{kind} {'::'.join([*folder.split('/'), name]).removeprefix('::')}\n")


def public_items():
    target = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    subprocess.run(["cargo", "doc", "--locked", "--lib", "--no-deps", "--quiet"], cwd=ROOT, check=True)
    items = Items()
    items.feed((target / "doc" / "infobyte" / "all.html").read_text())
    return sorted(items.lines)


def main():
    lines = public_items()
    if "--check" not in sys.argv[1:]:
        LIST.write_text("".join(lines))
        print(f"{len(lines)} public items")
        return
    before = LIST.read_text().splitlines(keepends=True)
    if before == lines:
        print(f"{len(lines)} public items, as listed")
        return
    sys.stdout.writelines(difflib.unified_diff(before, lines, "docs/PUBLIC.txt", "public items"))
    sys.exit("the public items differ from docs/PUBLIC.txt; if that is meant, run scripts/public_items.py")


if __name__ == "__main__":
    main()

#!/bin/sh
# The accuracy of cells at the size of the table in the research notes (192^3): prints a row for each body.
set -eu
cd "$(dirname "$0")/.."
INFOBYTE_CELLS_SIDE="${1:-192}" cargo test --locked --release --test it -- --nocapture cells_accuracy::

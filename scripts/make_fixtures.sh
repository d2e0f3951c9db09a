#!/usr/bin/env bash
# Makes the files of fixtures/ that are missing, and checks that those that are there can be made again.
# How each is made stands in tests/it/fixtures.rs, what each is in fixtures/README.md; none is rewritten.
set -euo pipefail
cd "$(dirname "$0")/.."
INFOBYTE_ADD_FIXTURES=1 cargo test --locked --test it -- --nocapture fixtures::
cargo test --locked --test it pack::the_files_of_every_version

//! The `oct` command: arguments in, one call into the library, an exit code out.

fn main() {}

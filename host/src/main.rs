//! The `libella` command.

fn main() {}

//! The README shows programs that are compiled and run.

use std::path::Path;

#[test]
fn the_readmes_program_is_the_one_that_is_tested() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let read = |name: &str| std::fs::read_to_string(root.join(name)).unwrap();
    let (readme, program) = (read("README.md"), read("c_examples/first.c"));
    let shown = readme
        .split("```c\n")
        .nth(1)
        .and_then(|rest| rest.split("```").next());
    assert_eq!(shown, Some(program.as_str()));
}

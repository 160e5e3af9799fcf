//! Writes `include/spinney.h`: `cargo run --manifest-path capi/header/Cargo.toml >
//! capi/include/spinney.h`.

use std::io;
use std::path::Path;

fn main() {
    let crate_directory = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the library's directory");
    let config = cbindgen::Config::from_file(crate_directory.join("cbindgen.toml")).expect("cbindgen.toml");
    let sources = [
        "status", "warnings", "dataset", "layers", "queries", "exact", "blocks", "model", "levels", "meshes",
        "shells", "sections", "parts",
    ];
    let builder = cbindgen::Builder::new().with_config(config);
    let builder = sources.into_iter().fold(builder, |builder, name| {
        builder.with_src(crate_directory.join("src").join(name).with_extension("rs"))
    });
    builder.generate().expect("valid sources").write(io::stdout());
}

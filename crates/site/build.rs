//! Says that the crate is compiled anew when the package for browsers was built: its files become part of the program.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    // (Without optimization, what is compiled reads the files when they are asked for.)
    if std::env::var("PROFILE").as_deref() == Ok("release") {
        println!("cargo::rerun-if-changed=page");
        println!("cargo::rerun-if-changed=../../wasm/dist");
    }
}

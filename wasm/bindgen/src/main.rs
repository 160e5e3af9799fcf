//! Generates a module's JavaScript bindings, and the module adapted to them:
//!
//!     spinney-bindgen MODULE.wasm DIRECTORY

use std::path::PathBuf;
use std::process::ExitCode;

use wasm_bindgen_cli_support::Bindgen;

fn main() -> ExitCode {
    let arguments: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [module, directory] = &arguments[..] else {
        eprintln!("usage: spinney-bindgen MODULE.wasm DIRECTORY");
        return ExitCode::from(2);
    };
    let made = Bindgen::new()
        .input_path(module)
        .out_name("module")
        .typescript(false)
        .remove_name_section(true)
        .remove_producers_section(true)
        // (A panic is followed by a new instance.)
        .reset_state_function(true)
        .web(true)
        .and_then(|bindgen| bindgen.generate(directory));
    match made {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("spinney-bindgen: {error:#}");
            ExitCode::FAILURE
        }
    }
}

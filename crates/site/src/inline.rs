//! The page as one file. It contains modules and libraries, so that it works from a local disk,
//! where browsers block requests for other files.
//!
//! Modules are `data:` URLs in an import map. Workers do not support import maps, so the modules of
//! a worker are nested in each other as `data:` URLs.

use std::collections::BTreeMap;

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use serde_json::json;

use super::asset::{PACKAGE, bytes, names, text};

/// Maximum depth to which modules of a worker import each other.
const MAX_DEPTH: usize = 16;

/// The `data:` URL of a module.
fn module_url(text: &str) -> String {
    format!("data:text/javascript;base64,{}", BASE64_STANDARD.encode(text))
}

/// Replaces the names of all modules that a source imports from its own directory.
fn renamed(source: &str, name: &mut dyn FnMut(&str) -> String) -> String {
    let mut made = source.to_owned();
    for mark in ["from \"", "import(\"", "import \""] {
        let whole = std::mem::take(&mut made);
        let own = format!("{mark}./");
        let mut parts = whole.split(&own);
        made += parts.next().unwrap_or_default();
        for part in parts {
            let (module, after) = part.split_once('"').unwrap_or((part, ""));
            made = made + mark + &name(module) + "\"" + after;
        }
    }
    made
}

/// The `data:` URL of a module with all of its imports nested inside.
fn nested(directory: &str, module: &str, known: &mut BTreeMap<String, String>, depth: usize) -> String {
    if let Some(url) = known.get(module) {
        return url.clone();
    }
    assert!(depth < MAX_DEPTH, "the package has cyclic imports");
    let source = text(&format!("{directory}{module}"));
    let url = module_url(&renamed(source, &mut |other| nested(directory, other, known, depth + 1)));
    known.insert(module.to_owned(), url.clone());
    url
}

/// An HTML element that contains a file in base64.
fn element(name: &str) -> String {
    let base64 = BASE64_STANDARD.encode(bytes(name));
    format!("<script type=\"text/plain\" data-name=\"{name}\">{base64}</script>\n")
}

/// The styles as HTML elements.
pub(crate) fn styles() -> String {
    ["page.css", "vendor/maplibre-gl.css"].map(|name| format!("<style>{}</style>\n", text(name))).concat()
}

/// The program and the files that it needs as HTML elements.
pub(crate) fn program() -> String {
    let mut imports = BTreeMap::new();
    let mut files = String::new();
    for name in names() {
        let directory = name.rsplit_once('/').map_or("", |(directory, _)| directory);
        match directory {
            "js" | "spinney" if name.ends_with(".js") => {
                let own = renamed(text(name), &mut |module| format!("{directory}/{module}"));
                imports.insert(name, module_url(&own));
            }
            "vendor" if name.ends_with(".js") || name.ends_with(".txt") => files += &element(name),
            "spinney" if name.ends_with(".wasm") => files += &element(name),
            _ => (),
        }
    }
    let worker = nested(PACKAGE, "worker.js", &mut BTreeMap::new(), 0);
    files += &format!("<script type=\"text/plain\" data-name=\"worker\">{worker}</script>\n");
    let map = json!({ "imports": imports });
    format!(
        "<script type=\"importmap\">{map}</script>\n{files}<script type=\"module\">import \"js/main.js\";</script>"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn imported_modules_are_renamed() {
        let text = "import { a } from \"./a.js\";\nconst b = await import(\"./b.js\");\nconst c = \"./c.js\";\nimport \"./d.js\";\n";
        let made = renamed(text, &mut |name| format!("x/{name}"));
        let expected = "import { a } from \"x/a.js\";\nconst b = await import(\"x/b.js\");\nconst c = \"./c.js\";\nimport \"x/d.js\";\n";
        assert_eq!(made, expected);
    }
}

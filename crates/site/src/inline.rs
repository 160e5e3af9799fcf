//! The page as one file: modules and libraries inside it, so that it opens from a disk, where a browser loads no file beside it.
//!
//! Modules of the page name each other by an import map whose addresses have the modules' bytes (`data:`). A worker knows no
//! import map: those that it needs are put into each other.

use std::collections::BTreeMap;

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use serde_json::json;

use super::asset::{PACKAGE, names, needed, needed_text};
use spinney_base::Result;

/// Depth to which modules of a worker may import each other.
const MAX_STEPS: usize = 16;

/// An address that has a module's text.
fn module_url(text: &str) -> String {
    format!("data:text/javascript;base64,{}", BASE64_STANDARD.encode(text))
}

/// Gives each module that a text imports from its own folder another name.
fn renamed(text: &str, name: &mut dyn FnMut(&str) -> Result<String>) -> Result<String> {
    let mut made = text.to_owned();
    for mark in ["from \"", "import(\"", "import \""] {
        let whole = std::mem::take(&mut made);
        let own = format!("{mark}./");
        let mut parts = whole.split(&own);
        made += parts.next().unwrap_or_default();
        for part in parts {
            let (module, after) = part.split_once('"').unwrap_or((part, ""));
            made = made + mark + &name(module)? + "\"" + after;
        }
    }
    Ok(made)
}

/// The address of a module with all that it imports inside.
fn nested(folder: &str, module: &str, known: &mut BTreeMap<String, String>, steps: usize) -> Result<String> {
    if let Some(url) = known.get(module) {
        return Ok(url.clone());
    }
    assert!(steps < MAX_STEPS, "modules of the package import each other in circles");
    let text = needed_text(&format!("{folder}{module}"))?;
    let url = module_url(&renamed(&text, &mut |other| nested(folder, other, known, steps + 1))?);
    known.insert(module.to_owned(), url.clone());
    Ok(url)
}

/// A file inside the page, in base64.
fn element(name: &str, base64: &str) -> String {
    format!("<script type=\"text/plain\" data-name=\"{name}\">{base64}</script>\n")
}

/// Styles inside the page.
pub(crate) fn styles() -> Result<String> {
    let texts = ["page.css", "vendor/maplibre-gl.css"].map(needed_text);
    let mut made = String::new();
    for text in texts {
        made = made + "<style>" + &text? + "</style>\n";
    }
    Ok(made)
}

/// The program inside the page.
pub(crate) fn program() -> Result<String> {
    let mut imports = BTreeMap::new();
    let mut files = String::new();
    for name in names() {
        let folder = name.rsplit_once('/').map_or("", |(folder, _)| folder);
        match folder {
            "js" | "spinney" if name.ends_with(".js") => {
                let own = renamed(&needed_text(&name)?, &mut |module| Ok(format!("{folder}/{module}")))?;
                imports.insert(name, module_url(&own));
            }
            "vendor" if name.ends_with(".js") || name.ends_with("coastlines.txt") => {
                files += &element(&name, &BASE64_STANDARD.encode(needed(&name)?));
            }
            _ => (),
        }
    }
    let module = format!("{PACKAGE}module_bg.wasm");
    files += &element(&module, &BASE64_STANDARD.encode(needed(&module)?));
    let worker = nested(PACKAGE, "worker.js", &mut BTreeMap::new(), 0)?;
    files += &format!("<script type=\"text/plain\" data-name=\"worker\">{worker}</script>\n");
    let map = json!({ "imports": imports });
    Ok(format!(
        "<script type=\"importmap\">{map}</script>\n{files}<script type=\"module\">import \"js/main.js\";</script>"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn imports_get_other_names() {
        let text = "import { a } from \"./a.js\";\nconst b = await import(\"./b.js\");\nconst c = \"./c.js\";\nimport \"./d.js\";\n";
        let made = renamed(text, &mut |name| Ok(format!("x/{name}"))).unwrap();
        let expected = "import { a } from \"x/a.js\";\nconst b = await import(\"x/b.js\");\nconst c = \"./c.js\";\nimport \"x/d.js\";\n";
        assert_eq!(made, expected);
    }
}

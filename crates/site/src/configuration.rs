//! HTML of the page, including its configuration: the files to show.

use serde_json::{Value, json};

use super::asset::{PACKAGE, TEMPLATE, names};
use super::content::PageContent;

/// A file that the page shows.
#[derive(Clone, Debug)]
pub struct PageSource {
    /// Unique name, by which links select the file.
    pub name: String,
    /// Displayed title.
    pub title: String,
    /// URL, absolute or relative to the page, percent-encoded.
    pub url: String,
    /// File size in bytes, if an enclosing page reads the file. Its URL is then `parent:`.
    pub size: Option<u64>,
    /// Content type. The map library is preloaded for maps, and content that no page shows cannot
    /// be selected.
    pub content: PageContent,
    /// Layer, commit and style that the page starts with.
    pub start: PageStart,
}

/// Layer, commit and style of a file that a page starts with.
#[derive(Clone, Debug, Default)]
pub struct PageStart {
    /// Name of the layer; `None` is the first layer.
    pub layer: Option<String>,
    /// Commit number; `None` is the newest commit.
    pub commit: Option<u64>,
    /// Style document or style name; `None` is the default style of the file.
    pub style: Option<String>,
}

/// Configuration of a page: the files to show, and the location of its own files.
#[derive(Clone, Debug)]
pub struct PageConfiguration {
    /// Title of the page.
    pub title: String,
    /// Files to show. The page starts with the first one.
    pub sources: Vec<PageSource>,
    /// Directory of the page's own files, relative to the page, with a trailing `/`.
    pub assets: String,
}

impl PageConfiguration {
    /// The configuration in the JSON format that the page reads.
    fn json(&self) -> Value {
        let source = |PageSource { name, title, url, size, content, start }: &PageSource| {
            let PageStart { layer, commit, style } = start;
            json!({"name": name, "title": title, "url": url, "size": size, "content": content.name(), "layer": layer, "commit": commit, "style": style})
        };
        json!({
            "assets": self.assets,
            "sources": self.sources.iter().map(source).collect::<Vec<_>>(),
        })
    }

    /// The configuration as HTML element. `<` is escaped, since it could end the element.
    pub(crate) fn element(&self) -> String {
        let text = self.json().to_string().replace('<', "\\u003c");
        format!("<script type=\"application/json\" id=\"configuration\">{text}</script>")
    }
}

/// Modules that are loaded later: for octrees and exact models, or by a worker only.
const LATER: [&str; 4] = ["js/model.js", "js/scene.js", "js/solid.js", "spinney/worker.js"];
/// Modules that only maps need.
const OF_MAPS: [&str; 2] = ["js/map.js", "vendor/maplibre-gl.js"];
/// Files that modules fetch: on all pages, and for maps only.
const FETCHED: &str = "spinney/module_bg.wasm";
const FETCHED_BY_MAPS: &str = "vendor/coastlines.txt";

/// Returns the HTML of a page that loads its files from the directory `assets`.
pub fn index(configuration: &PageConfiguration) -> String {
    // The page starts with the first source that it can show.
    let first = configuration.sources.iter().find(|source| source.content.is_shown());
    let is_map = first.is_some_and(|source| source.content == PageContent::Map);
    let link = |kind: &str, name: &str| {
        let address = escaped(&format!("{}{name}", configuration.assets));
        format!("<link rel={kind} href=\"{address}\">\n")
    };
    let is_needed = |name: &str| {
        let is_own = name.starts_with("js/") || name.starts_with(PACKAGE);
        let is_of_maps = OF_MAPS.contains(&name);
        name.ends_with(".js") && !LATER.contains(&name) && (is_map || !is_of_maps) && (is_own || is_of_maps)
    };
    // Request everything at once, the largest file first, so that no request waits for the file
    // that refers to it.
    let mut head = link("\"preload\" as=\"fetch\" crossorigin", FETCHED);
    head.extend(names().filter(|name| is_needed(name)).map(|name| link("\"modulepreload\"", name)));
    if is_map {
        head += &link("\"preload\" as=\"fetch\" crossorigin", FETCHED_BY_MAPS);
    }
    head.extend(["page.css", "vendor/maplibre-gl.css"].map(|name| link("\"stylesheet\"", name)));
    let main = escaped(&format!("{}js/main.js", configuration.assets));
    page_of(configuration, &head, &format!("<script type=\"module\" src=\"{main}\"></script>"))
}

/// Inserts title, styles, configuration and program into the template.
pub(crate) fn page_of(configuration: &PageConfiguration, styles: &str, program: &str) -> String {
    let title = format!("<title>{}</title>", escaped(&configuration.title));
    let parts = [
        ("<title>Spinney</title>", title.as_str()),
        ("<!-- styles -->", styles),
        ("<!-- configuration -->", &configuration.element()),
        ("<!-- program -->", program),
    ];
    let mut page = String::new();
    let mut rest = TEMPLATE;
    // Replace one mark at a time, so that inserted text is not searched for marks.
    for (mark, text) in parts {
        let (before, after) = rest.split_once(mark).expect("the template has each mark");
        page.push_str(before);
        page.push_str(text);
        rest = after;
    }
    page + rest
}

/// Escapes a string for HTML.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_map_library_is_preloaded_if_the_first_shown_file_is_a_map() {
        let source = |content: PageContent| PageSource {
            name: "a".into(),
            title: "a".into(),
            url: "a".into(),
            size: None,
            content,
            start: PageStart::default(),
        };
        let html = |contents: &[PageContent]| {
            let sources = contents.iter().map(|content| source(*content)).collect();
            index(&PageConfiguration { title: "a".into(), sources, assets: "assets/".into() })
        };
        let prepares =
            |contents: &[PageContent]| html(contents).contains("href=\"assets/vendor/maplibre-gl.js\"");
        assert!(prepares(&[PageContent::Points, PageContent::Map, PageContent::Volume]));
        assert!(!prepares(&[PageContent::Points, PageContent::Volume, PageContent::Map]));
        assert!(!prepares(&[PageContent::Unknown, PageContent::Map]));
        assert!(html(&[PageContent::Points]).contains("\"content\":\"points\""));
        assert!(html(&[PageContent::Unknown]).contains("\"content\":null"));
    }
}

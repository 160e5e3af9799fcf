//! The page's HTML, with what it is told: which files there are.

use serde_json::{Value, json};

use super::asset::{PACKAGE, TEMPLATE, names};
use super::content::PageContent;

/// A file that the page shows.
#[derive(Clone, Debug)]
pub struct PageSource {
    /// Name by which links choose it; no other file has it.
    pub name: String,
    /// Title that people see.
    pub title: String,
    /// Address from the page's own, already with `%` where names need it.
    pub url: String,
    /// Bytes of the file, where whoever shows the page inside another one reads it: its address is then `parent:`.
    pub size: Option<u64>,
    /// Its content: what draws maps is loaded without waiting for the file, and what no page shows cannot be chosen.
    pub content: PageContent,
    /// Part and look that the page begins with.
    pub start: PageStart,
}

/// Part and look of a file that a page begins with.
#[derive(Clone, Debug, Default)]
pub struct PageStart {
    /// The layer's name; the first if none is named.
    pub layer: Option<String>,
    /// The commit's number; the newest if none is named.
    pub commit: Option<u64>,
    /// The style's document or name; the file's own if none is named.
    pub style: Option<String>,
}

/// Knowledge of the page about its place: the files that it shows, and where its own are.
#[derive(Clone, Debug)]
pub struct PageConfiguration {
    /// Title of the page.
    pub title: String,
    /// Files that are shown, the first one at the beginning.
    pub sources: Vec<PageSource>,
    /// Folder of the page's own files from the page, with a `/` behind it.
    pub assets: String,
}

impl PageConfiguration {
    /// The configuration as the page reads it.
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

    /// The configuration as an element of HTML. (`<` could end it.)
    pub(crate) fn element(&self) -> String {
        let text = self.json().to_string().replace('<', "\\u003c");
        format!("<script type=\"application/json\" id=\"configuration\">{text}</script>")
    }
}

/// Modules that octrees and exact models need, or a worker alone.
const LATER: [&str; 4] = ["js/model.js", "js/scene.js", "js/solid.js", "spinney/worker.js"];
/// Modules that maps need, beside those that all do.
const OF_MAPS: [&str; 2] = ["js/map.js", "vendor/maplibre-gl.js"];
/// Files that modules fetch, for all pages and for maps.
const FETCHED: &str = "spinney/module_bg.wasm";
const FETCHED_BY_MAPS: &str = "vendor/coastlines.txt";

/// The page's HTML, for a page that loads its files from the directory `assets`.
pub fn index(configuration: &PageConfiguration) -> String {
    // (The page starts with the first file that it shows.)
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
    // (Everything is asked for at once, the largest first: nothing waits for what names it.)
    let mut head = link("\"preload\" as=\"fetch\" crossorigin", FETCHED);
    head.extend(names().filter(|name| is_needed(name)).map(|name| link("\"modulepreload\"", name)));
    if is_map {
        head += &link("\"preload\" as=\"fetch\" crossorigin", FETCHED_BY_MAPS);
    }
    head.extend(["page.css", "vendor/maplibre-gl.css"].map(|name| link("\"stylesheet\"", name)));
    let main = escaped(&format!("{}js/main.js", configuration.assets));
    page_of(configuration, &head, &format!("<script type=\"module\" src=\"{main}\"></script>"))
}

/// The page's HTML around styles and a program.
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
    // (One mark at a time, so that inserted text is not searched for marks.)
    for (mark, text) in parts {
        let (before, behind) = rest.split_once(mark).expect("the page has places for its parts");
        page.push_str(before);
        page.push_str(text);
        rest = behind;
    }
    page + rest
}

/// A text as HTML has it.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_are_prepared_if_the_first_file_that_is_shown_is_one() {
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

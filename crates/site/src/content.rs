//! Content types of files, as far as a page knows them before it reads the files.

use std::path::Path;

use spinney_base::Result;
use spinney_base::io::FileAccess;
use spinney_base::space::Dimension;
use spinney_container::{Content, FileHeader};

/// Content type of a file listed in a page.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PageContent {
    /// Unknown: the page detects it when it opens the file.
    #[default]
    Unknown,
    /// A raster, shown as a map.
    Map,
    /// An octree of cells.
    Volume,
    /// An exact model.
    Model,
    /// A tree of points, which pages do not show.
    Points,
    /// A tree of lines, which pages do not show.
    Lines,
    /// A shard summary, which pages do not show.
    Shard,
}

impl PageContent {
    /// Detects the content of a local file from its header; `Unknown` if the header cannot be read.
    pub fn of(path: &Path) -> PageContent {
        PageContent::read(path).unwrap_or_default()
    }

    /// Reads the content of a local file from its header.
    ///
    /// # Errors
    /// If the file cannot be read, or is not a Spinney file.
    pub(crate) fn read(path: &Path) -> Result<PageContent> {
        let header = FileHeader::read(path, &*FileAccess::default().peek(path)?)?;
        Ok(match (header.content, header.dimension) {
            (Content::Cells, Dimension::Quad) => PageContent::Map,
            (Content::Cells, Dimension::Oct) => PageContent::Volume,
            (Content::Model, _) => PageContent::Model,
            (Content::Points, _) => PageContent::Points,
            (Content::Lines, _) => PageContent::Lines,
            (Content::Shard, _) => PageContent::Shard,
        })
    }

    /// Returns whether pages show this content. Unknown content may be shown.
    pub(crate) fn is_shown(self) -> bool {
        self.refusal().is_none()
    }

    /// Name in the page configuration; `None` if the content is unknown.
    pub(crate) fn name(self) -> Option<&'static str> {
        match self {
            PageContent::Unknown => None,
            PageContent::Map => Some("map"),
            PageContent::Volume => Some("volume"),
            PageContent::Model => Some("model"),
            PageContent::Points => Some("points"),
            PageContent::Lines => Some("lines"),
            PageContent::Shard => Some("shard"),
        }
    }

    /// Returns what was found and advice, if pages cannot show this content.
    pub(crate) fn refusal(self) -> Option<(&'static str, &'static str)> {
        match self {
            PageContent::Points => Some((
                "a page of points",
                "convert it to a raster first: `spinney transform POINTS.goblin -o OUT.goblin raster=mean,cell=1`",
            )),
            PageContent::Lines => Some((
                "a page of lines",
                "export its features first (`spinney get LINES.goblin LINES.geojson`), and build a raster from them",
            )),
            PageContent::Shard => {
                Some(("a page of a shard summary", "merge the job first: `spinney shard merge`"))
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contents_are_detected_from_headers() {
        let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/v1");
        let of = |name: &str| PageContent::of(&fixtures.join(name));
        assert_eq!(of("classes.goblin"), PageContent::Map);
        assert_eq!(of("history.autumn"), PageContent::Map);
        assert_eq!(of("ball.goblin"), PageContent::Volume);
        assert_eq!(of("chapel.goblin"), PageContent::Model);
        assert_eq!(of("missing.goblin"), PageContent::Unknown);
    }
}

//! Export of a page with its data: as a directory for any static host, or as one file.

use std::fs::{self, File};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use base64::prelude::BASE64_STANDARD;
use base64::write::EncoderWriter;

use super::asset::{bytes, names};
use super::configuration::{PageConfiguration, PageSource, PageStart, index, page_of};
use super::content::PageContent;
use super::inline;
use spinney_base::io::{NewDirectories, Output, commit_all, shown, split_query, url_of};
use spinney_base::{Error, Progress, Result};

/// Directory of the page's own files.
const ASSETS: &str = "assets/";
/// Maximum bytes of a data file inside a page, which a browser holds in memory completely.
const MAX_INSIDE: u64 = 64 << 20;
/// Bytes copied at a time.
const BLOCK_BYTES: usize = 1 << 20;

/// Description of a page to export.
#[derive(Clone, Debug)]
pub struct PageRequest {
    /// Title of the page.
    pub title: String,
    /// Tree files to show. The page starts with the first one.
    pub files: Vec<PageFile>,
    /// Whether to write a single file that contains everything, including the data.
    pub is_self_contained: bool,
}

/// A file that a page shows.
#[derive(Clone, Debug)]
pub struct PageFile {
    /// Path of the file, or its URL, from which the page then reads it.
    pub path: PathBuf,
    /// Layer, commit and style that the page starts with.
    pub start: PageStart,
}

/// Size of an exported page.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PageSummary {
    /// Number of files written.
    pub files: u64,
    /// Total size of these files in bytes.
    pub bytes: u64,
}

/// Writes a page.
///
/// The page's own files go to a directory `assets` next to it, together with copies of the local
/// data files. A self-contained page is one file instead. Missing directories are created. Existing
/// files of the same names are replaced, the page itself last.
///
/// # Errors
/// If a file cannot be read or written, two files have the same name, a file is too large for a
/// self-contained page, a file has content that pages do not show, or on cancellation.
pub fn export_page(request: &PageRequest, path: &Path, progress: &dyn Progress) -> Result<PageSummary> {
    let sources = sources(&request.files)?;
    // Remote files are not copied.
    let local = request.files.iter().zip(&sources).filter(|(file, _)| url_of(&file.path).is_none());
    let mut local: Vec<(&Path, &PageSource, u64)> =
        local.map(|(file, source)| (file.path.as_path(), source, 0)).collect();
    for (file, _, size) in &mut local {
        // Reject content that the page could not show. This includes manifests, whose files would
        // not be copied.
        if let Some((found, advice)) = PageContent::read(file)?.refusal() {
            return Err(Error::unsupported(*file, found, advice));
        }
        *size = fs::metadata(*file).map_err(Error::io(*file, "stat"))?.len();
    }
    let directory =
        path.parent().filter(|directory| !directory.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut created = NewDirectories::default();
    created.make(directory)?;
    let total = local.iter().map(|(_, _, size)| size).sum();
    let mut done = CopyProgress { bytes: 0, total, progress };
    let configuration =
        PageConfiguration { title: request.title.clone(), sources: sources.clone(), assets: ASSETS.into() };
    let mut summary = PageSummary::default();
    if request.is_self_contained {
        if let Some((file, _, size)) = local.iter().find(|(_, _, size)| *size > MAX_INSIDE) {
            let found = format!("a self-contained page with {size} bytes");
            let advice = format!(
                "a page holds at most {MAX_INSIDE}; omit --self-contained, or make a smaller file with `spinney transform`"
            );
            return Err(Error::unsupported(*file, found, advice));
        }
        let summary = write_one_file(&local, &configuration, path, &mut done)?;
        created.keep();
        return Ok(summary);
    }
    let mut outputs = Vec::new();
    for (file, source, size) in local {
        let target = directory.join(&source.name);
        // A data file that is already next to the page needs no copy.
        if is_same_file(file, &target) {
            continue;
        }
        let mut output = Output::create(&target)?;
        copy(file, &mut output, &target, &mut done)?;
        outputs.push(output);
        summary.files += 1;
        summary.bytes += size;
    }
    for name in names() {
        let target = directory.join(ASSETS).join(name);
        let own = target.parent().unwrap_or(directory);
        created.make(own)?;
        outputs.push(summary.add(&target, bytes(name))?);
        progress.check()?;
    }
    outputs.push(summary.add(path, index(&configuration).as_bytes())?);
    commit_all(outputs)?;
    created.keep();
    Ok(summary)
}

/// Returns the HTML of a page that contains everything but the data, for embedding in another page.
pub fn inline_page(configuration: &PageConfiguration) -> String {
    page_of(configuration, &inline::styles(), &inline::program())
}

/// Writes a page that contains everything.
fn write_one_file(
    local: &[(&Path, &PageSource, u64)],
    configuration: &PageConfiguration,
    path: &Path,
    done: &mut CopyProgress<'_>,
) -> Result<PageSummary> {
    const PROGRAM: &str = "<!-- program -->";
    let page = page_of(configuration, &inline::styles(), PROGRAM);
    let (before, after) = page.rsplit_once(PROGRAM).expect("the page has the mark");
    let mut output = Output::create(path)?;
    let put =
        |output: &mut Output, text: &str| output.write_all(text.as_bytes()).map_err(Error::io(path, "write"));
    put(&mut output, before)?;
    for (file, source, _) in local {
        put(&mut output, &format!("<script type=\"text/plain\" data-name=\"{}\">", source.url))?;
        let mut encoder = EncoderWriter::new(&mut output, &BASE64_STANDARD);
        copy(file, &mut encoder, path, done)?;
        encoder.finish().map_err(Error::io(path, "write"))?;
        drop(encoder);
        put(&mut output, "</script>\n")?;
    }
    put(&mut output, &inline::program())?;
    put(&mut output, after)?;
    output.commit()?;
    let bytes = fs::metadata(path).map_err(Error::io(path, "stat"))?.len();
    Ok(PageSummary { files: 1, bytes })
}

impl PageSummary {
    /// Writes a file, which is not committed yet, and counts it.
    fn add(&mut self, path: &Path, bytes: &[u8]) -> Result<Output> {
        let mut output = Output::create(path)?;
        output.write_all(bytes).map_err(Error::io(path, "write"))?;
        self.files += 1;
        self.bytes += bytes.len() as u64;
        Ok(output)
    }
}

/// Creates the page sources of files.
fn sources(files: &[PageFile]) -> Result<Vec<PageSource>> {
    let mut made: Vec<PageSource> = Vec::new();
    for PageFile { path, start } in files {
        let url = url_of(path);
        // Remote files are not opened only to detect their content.
        let content = if url.is_none() { PageContent::of(path) } else { PageContent::Unknown };
        let url_path = Path::new(url.map_or("", |url| split_query(url).0));
        let name_of = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let name = name_of(if url.is_some() { url_path } else { path });
        if made.iter().any(|other| other.name == name) {
            let found = format!("two files named {name}");
            return Err(Error::invalid("files of a page", found, "unique names"));
        }
        let title = Path::new(&name).file_stem().unwrap_or_default().to_string_lossy().into_owned();
        if url.is_some_and(|url| shown(path) != url) {
            let found = "a URL with a query or a password, which the page would publish,";
            let advice = "download the file, or publish it at a URL without credentials";
            return Err(Error::unsupported(path, found, advice));
        }
        let url = url.map_or_else(|| percent_encoded(&name), str::to_owned);
        if !url.starts_with("http") && url.contains("://") {
            let advice = "pass the URL that browsers use: https://...";
            return Err(Error::unsupported(path, "a bucket URL, which browsers cannot read,", advice));
        }
        made.push(PageSource { name, title, url, size: None, content, start: start.clone() });
    }
    Ok(made)
}

/// Percent-encodes a file name for a URL (RFC 3986).
fn percent_encoded(name: &str) -> String {
    let letter = |byte: u8| match byte {
        b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' => char::from(byte).to_string(),
        _ => format!("%{byte:02X}"),
    };
    name.bytes().map(letter).collect()
}

fn is_same_file(one: &Path, other: &Path) -> bool {
    matches!((one.canonicalize(), other.canonicalize()), (Ok(one), Ok(other)) if one == other)
}

/// Progress of copying, in bytes.
struct CopyProgress<'a> {
    bytes: u64,
    total: u64,
    progress: &'a dyn Progress,
}

/// Copies a file in blocks, with progress.
fn copy(from: &Path, to: &mut dyn Write, target: &Path, done: &mut CopyProgress<'_>) -> Result<()> {
    let mut input = File::open(from).map_err(Error::io(from, "open"))?;
    let mut block = vec![0; BLOCK_BYTES];
    loop {
        done.progress.check()?;
        let count = input.read(&mut block).map_err(Error::io(from, "read"))?;
        if count == 0 {
            return Ok(());
        }
        to.write_all(&block[..count]).map_err(Error::io(target, "write"))?;
        done.bytes += count as u64;
        done.progress.advance(count as u64, done.total);
    }
}

#[cfg(test)]
mod tests {
    use base64::Engine as _;

    use super::*;

    /// Exports a page with a fixture.
    fn page_of_fixture(path: &Path, is_self_contained: bool) -> (PathBuf, PageSummary) {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/v1/classes.goblin");
        let files = vec![PageFile { path: file.clone(), start: PageStart::default() }];
        let request = PageRequest { title: "A & B".into(), files, is_self_contained };
        (file, export_page(&request, path, &()).unwrap())
    }

    #[test]
    fn exported_directories_have_the_data_and_all_page_files() {
        let directory = tempfile::tempdir().unwrap();
        let (file, summary) = page_of_fixture(&directory.path().join("site/index.html"), false);
        let read = |name: &str| fs::read(directory.path().join("site").join(name)).unwrap();
        let page = String::from_utf8(read("index.html")).unwrap();
        assert!(page.contains("<title>A &amp; B</title>") && page.contains("\"url\":\"classes.goblin\""));
        assert_eq!(read("classes.goblin"), fs::read(file).unwrap());
        for name in names() {
            assert_eq!(read(&format!("assets/{name}")), bytes(name), "{name}");
        }
        assert_eq!(summary.files, names().count() as u64 + 2);
    }

    #[test]
    fn self_contained_pages_have_the_data_and_the_module() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("island.html");
        let (file, summary) = page_of_fixture(&path, true);
        let page = fs::read_to_string(path).unwrap();
        for bytes in [&fs::read(file).unwrap()[..], bytes("spinney/module_bg.wasm")] {
            assert!(page.contains(&BASE64_STANDARD.encode(bytes)));
        }
        assert_eq!(summary, PageSummary { files: 1, bytes: page.len() as u64 });
    }

    #[test]
    fn names_are_percent_encoded_and_unique() {
        assert_eq!(percent_encoded("a b#1.goblin"), "a%20b%231.goblin");
        let files = ["x/a.goblin", "y/a.goblin"];
        let files = files.map(|path| PageFile { path: path.into(), start: PageStart::default() });
        assert!(sources(&files).unwrap_err().to_string().contains("two files named a.goblin"));
    }
}

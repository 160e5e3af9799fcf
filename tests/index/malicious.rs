//! Malicious indexes: an error or a harmless result is required.

use std::path::{Path, PathBuf};

use spinney::raw::store::goblin::Goblin;
use spinney::{Bounds, Error, FileAccess, OpenOptions};
use spinney_references::{
    Chunk, IndexContents, IndexedSource, LayerCells, MappedWindow, SourceImage, SourceList, write_pages,
};

use crate::common::command::{complaint, is_alone, own_peak_memory};
use crate::common::{Random, with};
use crate::compare::{Directory, MEMORY, assert_whole, index, open, update, window};
use crate::targets::indexes::{index_sections, query_index, seal_pages, small_index, with_sections};
use crate::targets::seal;
use crate::tiffs::{Chunks, Packing, Tiff};

#[test]
fn mutated_sections_do_no_harm() {
    if !is_alone("malicious::mutated_sections_do_no_harm") {
        return;
    }
    let index = small_index();
    let input = index.input();
    // The sections themselves come through unchanged.
    let [list, pages] = index.sections().map(<[u8]>::to_vec);
    let (mut sealed_list, mut sealed_pages) = (list.clone(), pages.clone());
    seal_pages(&mut sealed_list, &mut sealed_pages);
    assert!(sealed_list == list && sealed_pages == pages);
    let same = index.open(with_sections(&index.bytes, [&list, &pages])).unwrap();
    assert_eq!(same.verify(MEMORY, &()).unwrap(), []);
    // It is a seed of the fuzzing corpus.
    let seed = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus/index_sections/small");
    assert!(std::fs::read(&seed).unwrap() == input, "run `cargo run --example seeds` in fuzz/");
    let mut random = Random(66);
    for _ in 0..2000 {
        let mut mutated = input.clone();
        for _ in 0..1 + random.below(3) {
            // (Half of the changes are in the list.)
            let end = if random.below(2) == 0 { 2 + list.len() } else { mutated.len() };
            let at = 2 + random.below(end as u64 - 2) as usize;
            let at = at.min(mutated.len() - 1);
            let number =
                [0, 1, 127, 250, 251, 252, 253, 254, 255, random.below(256)][random.below(10) as usize] as u8;
            match random.below(8) {
                0 => {
                    mutated.remove(at);
                }
                1 => mutated.insert(at, number),
                2 => mutated.truncate(at.max(10)),
                3..5 => mutated[at] ^= 1 << random.below(8),
                _ => mutated[at] = number,
            }
        }
        index_sections(&mutated);
    }
    assert!(own_peak_memory() < 256 << 20, "{} bytes", own_peak_memory());
}

#[test]
fn each_byte_of_the_list() {
    if !is_alone("malicious::each_byte_of_the_list") {
        return;
    }
    let input = small_index().input();
    let list = small_index().sections()[0].len();
    for at in 2..2 + list {
        for number in [0, 1, 2, 251, 252, 253, 255, input[at].wrapping_add(1), input[at].wrapping_sub(1)] {
            let mutated = with(input.clone(), |it| it[at] = number);
            index_sections(&mutated);
        }
    }
    assert!(own_peak_memory() < 256 << 20, "{} bytes", own_peak_memory());
}

/// Decoded sections of an index, to be changed.
struct Contents {
    list: SourceList,
    layers: Vec<(Option<Vec<u8>>, Vec<MappedWindow>)>,
    sources: Vec<(IndexedSource, [Vec<Chunk>; 2])>,
}

impl Contents {
    fn of(path: &Path) -> Contents {
        let file = Goblin::open(path, &OpenOptions::new()).unwrap();
        let IndexContents { formats, rules, channels, layers, sources, .. } =
            file.referring(IndexContents::read).unwrap().unwrap();
        let list = with(SourceList::default(), |it| {
            (it.formats, it.rules, it.channels) = (formats, rules, channels);
        });
        Contents { list, layers: layers.into_iter().map(|placements| (None, placements)).collect(), sources }
    }

    /// Returns the index's bytes with these contents.
    fn apply(mut self, path: &Path) -> Vec<u8> {
        self.list.layers = self
            .layers
            .into_iter()
            .map(|(nodata, placements)| LayerCells::new(nodata, &placements))
            .collect();
        let mut sources = self.sources.into_iter();
        let (list, pages) = write_pages(path, self.list, &mut || Ok(sources.next())).unwrap();
        with_sections(&std::fs::read(path).unwrap(), [&list, &pages])
    }
}

/// A directory with an index of a file, `x.goblin`.
fn indexed_file() -> Directory {
    let directory = Directory::new();
    let source = directory.path("a.tif");
    let mut tiff =
        Tiff { chunks: Chunks::Tiles(64, 64), channels: 2, has_alpha: true, ..Tiff::new([300, 280], 1) }
            .filled(2);
    tiff.set([280, 270], 8);
    tiff.write(&source);
    index(&[source], &directory.path("x.goblin"));
    directory
}

/// Opens a changed index, and reads all cells and what an update reads. Returns the first error.
fn read_all(directory: &Directory, bytes: Vec<u8>, access: FileAccess) -> Result<(), Error> {
    let path = directory.path("changed.goblin");
    std::fs::write(&path, bytes).unwrap();
    let access = access.unpacked_cache(8 << 20);
    let tree = spinney::open_with(&path, &OpenOptions::new().access(access))?;
    let read = window(&tree, tree.depth(), &Bounds::of_extent(tree.header().extent));
    let verified = tree.verify(MEMORY, &());
    assert!(verified.is_err() || read.is_ok() || !verified.unwrap().is_empty());
    let updated = directory.path("updated.goblin");
    let updated = update(&path, &updated, |_| {});
    read.map(drop).and(updated.map(drop))
}

/// A change of an index's contents.
type Change<'a> = (&'a str, &'a dyn Fn(&mut Contents));

#[test]
fn absurd_contents_are_refused() {
    if !is_alone("malicious::absurd_contents_are_refused") {
        return;
    }
    let directory = indexed_file();
    let path = directory.path("x.goblin");
    let side = (1 << 31) - 1;
    let first =
        |contents: &mut Contents, change: &dyn Fn(&mut Chunk)| change(&mut contents.sources[0].1[0][7]);
    let changes: [Change<'_>; 35] = [
        ("offset", &|it| first(it, &|chunk| chunk.offset = 1 << 40)),
        ("end of the number range", &|it| first(it, &|chunk| chunk.offset = u64::MAX - chunk.length)),
        ("length", &|it| first(it, &|chunk| chunk.length = 1 << 40)),
        ("longer by one", &|it| first(it, &|chunk| chunk.length += 1)),
        ("checksum", &|it| first(it, &|chunk| chunk.checksum ^= 1)),
        ("another chunk", &|it| it.sources[0].1[0].swap(1, 2)),
        ("a hole", &|it| first(it, &|chunk| chunk.length = 0)),
        ("few chunks", &|it| it.sources[0].1[0].truncate(9)),
        ("no chunks", &|it| it.sources[0].1[0].clear()),
        ("many chunks", &|it| {
            let chunks = it.sources[0].1[0].repeat(200);
            it.sources[0].1[0] = chunks;
        }),
        ("wide chunks", &|it| it.list.formats[0].chunk_width = side),
        ("large chunks", &|it| {
            (it.list.formats[0].chunk_width, it.list.formats[0].chunk_height) = (side, side)
        }),
        ("no chunk width", &|it| it.list.formats[0].chunk_width = 0),
        ("narrow chunks", &|it| it.list.formats[0].chunk_width = 1),
        ("large sources", &|it| it.sources[0].0.size = [side, side]),
        ("large sources of tiny chunks", &|it| {
            it.sources[0].0.size = [side, side];
            let format = &mut it.list.formats[0];
            (format.chunk_width, format.chunk_height) = (1, 1);
            (format.samples, format.planes) = (65535, 65535);
        }),
        ("a wide mask", &|it| {
            let (size, mut format) = (it.sources[0].0.size, it.list.formats[0].clone());
            (format.chunk_width, format.chunk_height) = (1, 1);
            (format.samples, format.planes) = (65535, 1);
            it.list.formats.push(format);
            it.sources[0].0.mask = Some(SourceImage::new(it.list.formats.len() as u32 - 1));
            it.sources[0].1[1] =
                vec![Chunk { offset: 0, length: 0, checksum: 0 }; (size[0] * size[1]) as usize];
        }),
        ("nodata of a rule", &|it| it.list.rules[0].nodata = Some(vec![0; 9])),
        ("no columns", &|it| it.sources[0].0.size = [0, 5]),
        ("no samples", &|it| it.list.formats[0].samples = 0),
        ("samples", &|it| it.list.formats[0].samples = 65535),
        ("planes", &|it| it.list.formats[0].planes = 2),
        ("format", &|it| it.sources[0].0.image.format = 9),
        ("hole", &|it| it.sources[0].0.hole = Vec::new()),
        ("long hole", &|it| it.sources[0].0.hole = vec![0; 9]),
        ("channels", &|it| it.list.channels[0] = vec![0, 65535]),
        ("no channels", &|it| it.list.channels[0] = Vec::new()),
        ("many channels", &|it| it.list.channels[0] = vec![0; 65535]),
        ("opacity", &|it| it.list.rules[0].opacity = Some(7)),
        ("hidden opacity", &|it| it.list.rules[0].hidden_opacity = Some(7)),
        ("window beyond the source", &|it| it.layers[0].1[0].from = [3, 3]),
        ("window far beyond", &|it| it.layers[0].1[0].from = [side - 1, side - 1]),
        ("cells beyond the extent", &|it| it.layers[0].1[0].cells.x = 2),
        ("nodata of the layer", &|it| it.layers[0].0 = Some(vec![0; 1000])),
        ("fewer cells", &|it| it.layers[0].1[0].cells.width = 1),
    ];
    for (what, change) in changes {
        let contents = with(Contents::of(&path), |it| change(it));
        let error = read_all(&directory, contents.apply(&path), FileAccess::new());
        let error = error.err().unwrap_or_else(|| panic!("{what}: no error"));
        let is_typed =
            matches!(error, Error::Corrupt { .. } | Error::Unsupported { .. } | Error::TooLarge { .. });
        assert!(is_typed, "{what}: {error:?}");
        println!("{what}: {error}");
    }
    assert!(own_peak_memory() < 512 << 20, "{} bytes", own_peak_memory());
}

#[test]
fn many_placements() {
    if !is_alone("malicious::many_placements") {
        return;
    }
    let directory = indexed_file();
    let path = directory.path("x.goblin");
    // (All have the same cells: they take 12 KB.)
    let mut contents = Contents::of(&path);
    let first = contents.layers[0].1[0];
    contents.layers[0].1.extend(vec![first; 1 << 20]);
    let error = read_all(&directory, contents.apply(&path), FileAccess::new()).unwrap_err();
    assert!(matches!(error, Error::Corrupt { .. }), "{error:?}");
    assert!(own_peak_memory() < 256 << 20, "{} bytes", own_peak_memory());
}

#[test]
fn decompression_ends_with_the_chunk() {
    if !is_alone("malicious::decompression_ends_with_the_chunk") {
        return;
    }
    let directory = Directory::new();
    let source = directory.path("a.tif");
    for packing in [Packing::Deflate, Packing::Zstd, Packing::Lzw, Packing::PackBits] {
        // Much longer data than a tile has, in place of the last tile's, which is at the end.
        let tiff = Tiff { packing, chunks: Chunks::Strips(64), ..Tiff::new([64, 128], 3) };
        tiff.write(&source);
        let path = directory.path("x.goblin");
        index(std::slice::from_ref(&source), &path);
        let zeros = packing.pack(&vec![0; if packing == Packing::Deflate { 256 << 20 } else { 4 << 20 }]);
        let mut bytes = tiff.bytes();
        let bomb = Chunk {
            offset: bytes.len() as u64,
            length: zeros.len() as u64,
            checksum: crc32c::crc32c(&zeros),
        };
        bytes.extend(zeros);
        std::fs::write(&source, bytes).unwrap();
        let contents = with(Contents::of(&path), |it| it.sources[0].1[0][1] = bomb);
        let error = read_all(&directory, contents.apply(&path), FileAccess::new()).unwrap_err();
        assert!(matches!(error, Error::Corrupt { .. }), "{packing:?}: {error}");
    }
    // (The zeros are in memory here.)
    assert!(own_peak_memory() < 512 << 20, "{} bytes", own_peak_memory());
}

/// Returns the bytes of an index whose source has another name.
pub(crate) fn renamed(path: &Path, name: &str) -> Vec<u8> {
    with(Contents::of(path), |it| it.sources[0].0.name = name.into()).apply(path)
}

#[test]
fn names_of_other_files() {
    let directory = indexed_file();
    let path = directory.path("x.goblin");
    let own = directory.name("a.tif");
    // (A local index may name any file, unless external files are refused.)
    let read = |name: &str, access: FileAccess| {
        let changed = directory.path("changed.goblin");
        std::fs::write(&changed, renamed(&path, name)).unwrap();
        let tree = spinney::open_with(&changed, &OpenOptions::new().access(access.unpacked_cache(8 << 20)))?;
        window(&tree, tree.depth(), &tree.extent_at(tree.depth()))
    };
    read("a.tif", FileAccess::new()).unwrap();
    read(&own, FileAccess::new()).unwrap();
    for name in ["a.tif", &own, "../a.tif", "https://localhost/a.tif"] {
        let error = read(name, FileAccess::new().no_external()).unwrap_err();
        assert!(
            matches!(error, Error::Unsupported { .. }) && error.to_string().contains("--no-external"),
            "{name}: {error}"
        );
    }
    for name in [
        "x.goblin",
        "changed.goblin",
        "./changed.goblin",
        "",
        ".",
        "/",
        "/dev/zero",
        "a.tif/",
        "\0",
        "b.tif",
        "https://localhost/a.tif",
        "ftp:x",
    ] {
        let error = read(name, FileAccess::new()).unwrap_err();
        let is_typed = matches!(error, Error::Corrupt { .. } | Error::Unsupported { .. } | Error::Io { .. });
        assert!(is_typed, "{name}: {error:?}");
    }
    let long = "x/".repeat(100_000);
    assert!(read(&long, FileAccess::new()).is_err());
    std::fs::write(directory.path("changed.goblin"), renamed(&path, "changed.goblin")).unwrap();
    let name = directory.name("changed.goblin");
    for arguments in [&["verify"][..], &["verify", "--quick"], &["index", "--update"]] {
        spinney_fails(&[arguments, &[&name]].concat());
    }
    let message =
        complaint(&["get", "--no-external", &directory.name("x.goblin"), &directory.name("o.npy")], 1);
    assert!(message.contains("--no-external"), "{message}");
}

/// Runs the program, which fails without a panic.
fn spinney_fails(arguments: &[&str]) {
    let run = crate::common::command::spinney(arguments).code(1);
    let said = String::from_utf8_lossy(&run.get_output().stderr).into_owned();
    assert!(!said.contains("panicked"), "{arguments:?}: {said}");
}

#[test]
fn changed_bytes_of_the_rest() {
    // Headers, directory, references: with the checksums that other programs can correct.
    let file = &small_index().bytes;
    let mut random = Random(7);
    for _ in 0..500 {
        let mut bytes = file.clone();
        let at = random.below(bytes.len() as u64) as usize;
        bytes[at] ^= 1 << random.below(8);
        seal::goblin_end(&mut bytes);
        seal::goblin(&mut bytes);
        query_index(bytes);
    }
}

#[test]
fn resolved_files_of_changed_indexes() {
    let directory = indexed_file();
    let path = directory.path("x.goblin");
    let changed = directory.path("changed.goblin");
    std::fs::write(
        &changed,
        with(Contents::of(&path), |it| it.sources[0].1[0][0].checksum ^= 1).apply(&path),
    )
    .unwrap();
    let output: PathBuf = directory.path("o.goblin");
    let convert = |from: &Path| {
        let output = spinney::Output::create(&output).unwrap();
        spinney::transform(&spinney::FileView::of(from), output, spinney::WriteOptions::new(MEMORY), &())
    };
    assert!(matches!(convert(&changed), Err(Error::Corrupt { .. })));
    assert!(!output.exists());
    convert(&path).unwrap();
    assert_whole(&output);
    open(&output);
}
